//! One target of cargo-fuzz: the reader that is named like the binary.
#![no_main]

use libfuzzer_sys::fuzz_target;
use tests::readers::{self, Reader};

thread_local! {
    static READER: Reader = {
        let folder = tempfile::tempdir().expect("a temporary folder").keep();
        let mut readers = readers::all(folder).into_iter();
        let named = |reader: &Reader| reader.name.replace(' ', "-") == env!("CARGO_BIN_NAME");
        readers.find(named).expect("a reader of that name")
    };
}

fuzz_target!(|bytes: &[u8]| {
    READER.with(|reader| (reader.feed)(bytes));
});
