//! The store of derived data, and names of the coordinator's own entries in it.

use std::sync::Arc;

use cache::{Storage, Store};
use descriptor::Preprocess;
use proto::Digest;
use worker::preprocess_key;

/// The store of a command that may have workers.
pub fn open(storage: &Storage) -> Arc<Store> {
    Arc::new(Store::open(storage, &transport::host_name(), descriptor::EVALUATION_VERSION))
}

/// The key of what follows from `inputs` where clouds are prepared like this.
pub fn key(kind: &str, preprocess: &Preprocess, inputs: &[&[u8]]) -> Digest {
    let key = preprocess_key(kind, preprocess);
    inputs.iter().fold(key, |key, input| key.part(input)).finish()
}

/// A store in a folder of a test.
#[cfg(test)]
pub fn store_in(folder: &std::path::Path) -> Store {
    let size = cache::ByteSize::gib(1);
    let storage = Storage { cache: Some(folder.to_owned()), cache_size: size, ..Storage::in_memory(size) };
    Store::open(&storage, "test", descriptor::EVALUATION_VERSION)
}

#[cfg(test)]
mod tests {
    use descriptor::Unit;

    use super::*;

    #[test]
    fn every_setting_and_every_input_is_part_of_the_key() {
        let base = Preprocess::default();
        let keys = [
            key("a", &base, &[b"xy", b"z"]),
            key("b", &base, &[b"xy", b"z"]),
            key("a", &base, &[b"x", b"yz"]),
            key("a", &base, &[b"xyz"]),
            key("a", &Preprocess { leaf_um: 1, ..base }, &[b"xy", b"z"]),
            key("a", &Preprocess { normal_radius_um: 1, ..base }, &[b"xy", b"z"]),
            key("a", &Preprocess { min_points: 1, ..base }, &[b"xy", b"z"]),
            key("a", &Preprocess { colour: false, ..base }, &[b"xy", b"z"]),
            key("a", &Preprocess { unit: Unit::Millimetre, ..base }, &[b"xy", b"z"]),
        ];
        let different: std::collections::BTreeSet<Digest> = keys.into();
        assert_eq!(different.len(), keys.len());
        assert_eq!(keys[0], key("a", &base, &[b"xy", b"z"]));
    }
}
