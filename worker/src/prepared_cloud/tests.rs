//! A committed entry of a prepared cloud: what is kept by one release is read by the next, or has another name.

use cache::{ByteSize, Storage, Store};
use descriptor::synth::{SynthSettings, catalogue, render};
use descriptor::{GeneTable, QuantisedCloud};

use super::*;

/// As [`Store::put`] wrote it.
const SAMPLE: &[u8] = include_bytes!("../../cache/testdata/prepared-cloud.entry");

/// What the sample was made from; clouds are coarse, so that it is small.
fn sample() -> (Preprocess, Quantiser, QuantisedCloud) {
    let preprocess = Preprocess { leaf_um: 40_000, normal_radius_um: 80_000, ..Preprocess::default() };
    let quantiser = Quantiser::new(&GeneTable::paper()).unwrap();
    let settings = SynthSettings::new(3, 6, 7).unwrap();
    let cloud = render(&settings, &catalogue(&settings)[0], 0);
    let prepared = QuantisedCloud::new(&cloud, &preprocess, &quantiser).unwrap();
    (preprocess, quantiser, prepared)
}

#[test]
fn the_committed_entry_is_read_and_is_what_would_be_written_today() {
    let (preprocess, quantiser, prepared) = sample();
    let key = prepared_cloud_key(&preprocess, &quantiser, Digest::of(b"source"));
    let store = Store::open(&Storage::in_memory(ByteSize::mib(1)), "here", EVALUATION_VERSION);
    let payload = store.adopt(PREPARED_CLOUD, key, SAMPLE).unwrap();
    let read = QuantisedCloud::decode(&payload, &quantiser).unwrap();
    assert!(payload.len() > 1000);
    assert!(read.encode() == payload, "it must be read without loss");
    assert!(prepared.encode() == payload, "another format needs another PREPARED_CLOUD");
}
