//! Names of the coordinator's own entries in the store of derived data.

use descriptor::Preprocess;
use proto::Digest;
use worker::store::KeyBuilder;

/// The key of what follows from `inputs` where clouds are prepared like this.
pub fn key(kind: &str, preprocess: &Preprocess, inputs: &[&[u8]]) -> Digest {
    let key = KeyBuilder::new(kind).preprocess(preprocess);
    inputs.iter().fold(key, |key, input| key.part(input)).finish()
}

/// A store in a folder of a test.
#[cfg(test)]
pub fn store_in(folder: &std::path::Path) -> worker::store::Store {
    let size = worker::Size::from_bytes(1 << 30);
    let storage = worker::Storage {
        cache: Some(folder.to_owned()),
        cache_size: size,
        ..worker::Storage::in_memory(size)
    };
    worker::store::Store::open(&storage, "test")
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
