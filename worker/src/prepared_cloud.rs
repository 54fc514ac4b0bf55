//! Keys of cache entries that depend on how clouds are prepared.

use cache::KeyBuilder;
use descriptor::{EVALUATION_VERSION, Preparer, Preprocess, Unit};
use proto::Digest;

/// The kind of entry that holds a cloud made ready for all descriptors of a search space, and the version of its bytes.
pub const PREPARED_CLOUD: &str = "prepared cloud 2";

/// The key of a prepared cloud, given the digest of its source file; `None` of clouds that are prepared anew each time.
pub fn prepared_cloud_key(preprocess: &Preprocess, preparer: &Preparer, cloud: Digest) -> Option<Digest> {
    let form = preparer.digest()?;
    Some(preprocess_key(PREPARED_CLOUD, preprocess).part(&form).part(&cloud.0).finish())
}

/// The key of an entry of this kind that depends on how clouds are prepared, so far without anything else.
pub fn preprocess_key(kind: &str, preprocess: &Preprocess) -> KeyBuilder {
    let Preprocess { leaf_um, normal_radius_um, min_points, colour, unit } = *preprocess;
    let unit = match unit {
        Unit::Metre => 0,
        Unit::Millimetre => 1,
    };
    [leaf_um, normal_radius_um, min_points, u32::from(colour), unit]
        .into_iter()
        .fold(KeyBuilder::new(kind, EVALUATION_VERSION), KeyBuilder::number)
}

#[cfg(test)]
mod tests;
