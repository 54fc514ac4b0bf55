//! The bytes of a file, as many as are read of one.

use std::fs::{self, File};
use std::io::Read;
use std::path::Path;

/// A larger cloud, list or manifest is refused rather than read: a depth camera's cloud is some megabytes.
pub(crate) const MAX_FILE_BYTES: u64 = 256 << 20;

/// All bytes of a regular file of bounded size, or why not.
pub(crate) fn read_file(file: &Path) -> Result<Vec<u8>, String> {
    let mut bytes = Vec::new();
    // Before it is opened: opening a pipe waits for a writer.
    let metadata = fs::metadata(file).map_err(|error| error.to_string())?;
    if !metadata.is_file() {
        return Err("something that is no file".to_owned());
    }
    let opened = File::open(file).map_err(|error| error.to_string())?;
    let length = metadata.len();
    if length <= MAX_FILE_BYTES {
        bytes.reserve_exact(length as usize + 1);
    }
    opened.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes).map_err(|error| error.to_string())?;
    if bytes.len() as u64 > MAX_FILE_BYTES {
        return Err(format!("file of at most {MAX_FILE_BYTES} bytes expected, got more"));
    }
    Ok(bytes)
}
