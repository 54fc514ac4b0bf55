//! The reference clouds of an artefact as recognisers take them.

use std::collections::BTreeMap;

use descriptor::{Descriptor, Family, Label, SetDistance, Signatures};
use proto::Message;

use crate::database::{Database, DatabaseCloud, DatabasePart, DatabaseParts};
use crate::scales;

/// The signatures of the reference clouds in each channel, how they are compared, and the channel's weight over its
/// scale.
pub fn channels<'a>(
    descriptor: &Descriptor,
    scales: Option<&[f64]>,
    signatures: &'a [Signatures],
) -> Vec<(&'a Signatures, SetDistance, f64)> {
    let metrics = descriptor.channels().into_iter().map(|(channel, _)| channel.metric());
    let channels = signatures.iter().zip(metrics).zip(scales::weights(descriptor, scales));
    channels.map(|((signatures, metric), weight)| (signatures, metric, weight)).collect()
}

/// The signatures of the reference clouds in each channel; `Err` says why they are not the descriptor's.
pub fn signatures(descriptor: &Descriptor, database: &Database) -> Result<Vec<Signatures>, String> {
    let Database { clouds, parts } = database;
    let parts: &[DatabasePart] = match (descriptor.family(), parts) {
        (Family::DiskRing, DatabaseParts::ShapeColour(parts)) => parts,
        (Family::Structure, DatabaseParts::Channels(channels)) => channels,
        (family, _) => return Err(format!("columns must be those of family {family}, got others")),
    };
    let columns: Vec<_> =
        parts.iter().map(|part| [part.centroids.as_slice(), part.deviations.as_slice()]).collect();
    let count = u32::try_from(clouds.len()).map_err(|_| format!("too many clouds, got {}", clouds.len()))?;
    descriptor.signatures_of_columns(&columns, count).map_err(|error| Message::of(&error).what)
}

/// What the clouds show, by numbers.
pub fn labels(clouds: &[DatabaseCloud]) -> Vec<Label> {
    let mut categories: BTreeMap<&str, u32> = BTreeMap::new();
    let mut instances: BTreeMap<(&str, &str), u32> = BTreeMap::new();
    let mut labels = Vec::with_capacity(clouds.len());
    for DatabaseCloud { instance, category, .. } in clouds {
        let (next_category, next_instance) = (categories.len() as u32, instances.len() as u32);
        let category_number = *categories.entry(category).or_insert(next_category);
        let instance = *instances.entry((category, instance)).or_insert(next_instance);
        labels.push(Label { category: category_number, instance });
    }
    labels
}
