//! A committed entry of a prepared cloud: what is kept by one release is read by the next, or has another name.

use cache::{ByteSize, Storage, Store};
use descriptor::synth::{SynthSettings, catalogue, render};
use descriptor::{GeneTable, PreparedCloud, SearchSpace};

use super::*;

/// As [`Store::put`] wrote it.
const SAMPLE: &[u8] = include_bytes!("../../cache/testdata/prepared-cloud.entry");

/// What the sample was made from; clouds are coarse, so that it is small.
fn sample() -> (Preprocess, Preparer, PreparedCloud) {
    let preprocess = Preprocess { leaf_um: 40_000, normal_radius_um: 80_000, ..Preprocess::default() };
    let preparer = SearchSpace::DiskRing(GeneTable::paper()).preparer().unwrap();
    let settings = SynthSettings::new(3, 6, 7).unwrap();
    let cloud = render(&settings, &catalogue(&settings)[0], 0);
    let prepared = preparer.prepare(&cloud, &preprocess).unwrap();
    (preprocess, preparer, prepared)
}

#[test]
fn the_committed_entry_is_read_and_is_what_would_be_written_today() {
    let (preprocess, preparer, prepared) = sample();
    let key = prepared_cloud_key(&preprocess, &preparer, Digest::of(b"source")).unwrap();
    let store = Store::open(&Storage::in_memory(ByteSize::mib(1)), "here", EVALUATION_VERSION);
    let payload = store.adopt(PREPARED_CLOUD, key, SAMPLE).unwrap();
    let read = preparer.decode(&payload).unwrap();
    assert!(payload.len() > 1000);
    let encoded = |cloud| preparer.encode(cloud).unwrap();
    assert!(encoded(&read) == payload, "it must be read without loss");
    assert!(encoded(&prepared) == payload, "another format needs another PREPARED_CLOUD");
}
