//! Descriptors and clouds as tasks name them: the place where their bytes, labels and counted costs are made.

use cluster::scheduler::{Channel, ChannelsOf, CheckDescription};
use descriptor::{Descriptor, Preprocess, SearchSpace};
use proto::Digest;
use proto::task::{self, DescriptorBytes, Facts, Label, Preparation, SplitManifest, Subject};

use crate::dataset::CloudEntry;

/// How clouds are prepared for the tasks of one search space.
pub fn preparation(preprocess: &Preprocess, space: SearchSpace) -> Preparation {
    descriptor::Preparation { preprocess: *preprocess, space }.to_bytes().into()
}

/// The bytes by which tasks name a descriptor.
pub fn descriptor_bytes(descriptor: &Descriptor) -> DescriptorBytes {
    descriptor.to_bytes().into()
}

/// A descriptor as tasks have it.
pub fn subject(preparation: &Preparation, descriptor: &Descriptor) -> Subject {
    Subject {
        preparation: preparation.clone(),
        descriptor: descriptor_bytes(descriptor),
        facts: Facts {
            label: Facts::label(&descriptor.to_string()),
            description_bytes: descriptor.signature_bytes(1),
            cloud_cost: descriptor.cost(1, 0),
            pair_cost: descriptor.cost(0, 1).max(1),
        },
    }
}

/// How clouds are prepared for a descriptor of a search space, and for any other as the only one of its own.
pub fn preparation_beside(
    preprocess: &Preprocess,
    space: &SearchSpace,
    descriptor: &Descriptor,
) -> Preparation {
    let own = if space.contains(descriptor) { None } else { SearchSpace::single(descriptor).ok() };
    preparation(preprocess, own.unwrap_or_else(|| space.clone()))
}

/// Looks into a description that a worker has made.
pub const CHECK_DESCRIPTION: CheckDescription = |subject, bytes, clouds| {
    let descriptor = Descriptor::from_bytes(subject.descriptor.bytes()).map_err(|error| error.to_string())?;
    descriptor.check_signatures(bytes, clouds).map_err(|error| error.to_string())
};

/// The channels of a structure, each by a hash of it alone. Workers that describe other descriptors have little to keep.
pub const CHANNELS_OF: ChannelsOf = |descriptor| {
    let channels = |descriptor: Descriptor| descriptor.channels().into_iter().map(|(channel, _)| channel);
    let channel = |channel: descriptor::Channel| {
        let alone = Descriptor::of_channel(&channel)?;
        let Digest(bytes) = Digest::of(&alone.to_bytes());
        let number = u64::from_le_bytes(*bytes.first_chunk()?);
        Some(Channel { number, cost: alone.cost(1, 0) })
    };
    let descriptor = Descriptor::from_bytes(descriptor.bytes()).ok();
    descriptor.into_iter().flat_map(channels).filter_map(channel).collect()
};

/// The blob that lists one split's clouds, with their sequences if these are wanted and known.
pub fn split_manifest<'a>(
    split: &str,
    clouds: impl Iterator<Item = &'a CloudEntry>,
    with_sequences: bool,
) -> Vec<u8> {
    let listed = clouds.map(|cloud| task::CloudEntry {
        digest: Digest(cloud.digest),
        bytes: cloud.bytes,
        label: Label { category: cloud.category, instance: cloud.instance },
        path: cloud.path.clone(),
        sequence: cloud.sequence.filter(|_| with_sequences),
    });
    SplitManifest { split: split.to_owned(), clouds: listed.collect() }.encode()
}

#[cfg(test)]
mod tests {
    use descriptor::Family;

    use super::*;

    #[test]
    fn what_cannot_be_a_description_is_refused() {
        let descriptor = Descriptor::default_of(Family::DiskRing);
        let space = SearchSpace::single(&descriptor).unwrap();
        let subject = subject(&preparation(&Preprocess::default(), space), &descriptor);
        assert_eq!(subject.facts.label, descriptor.to_string());
        let length = 3 * subject.facts.description_bytes as usize;
        assert_eq!(length as u64, descriptor.signature_bytes(3));
        assert_eq!(CHECK_DESCRIPTION(&subject, &vec![0; length], 3), Ok(()));
        CHECK_DESCRIPTION(&subject, &vec![0; length - 4], 3).unwrap_err();
        CHECK_DESCRIPTION(&subject, &vec![0xff; length], 3).unwrap_err(); // no numbers
    }
}
