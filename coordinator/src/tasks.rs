//! Descriptors and clouds as tasks name them: the place where their bytes, labels and counted costs are made.

use cluster::scheduler::CheckDescription;
use descriptor::bytes::{cell_to_bytes, preparation_to_bytes};
use descriptor::{Descriptor, FixedDescriptor, FixedKind, GENES, GeneKind, GeneTable, Preprocess};
use proto::Digest;
use proto::task::{self, DescriptorBytes, Facts, Label, Preparation, SplitManifest, Subject};

use crate::dataset::CloudEntry;

/// Counted costs of the disk-ring descriptor: those of all others are multiples of its pair.
const CLOUD_COST: u64 = 1000;
const PAIR_COST: u64 = 1;
/// Counted costs of describing a cloud without genes, with a radius of 5 cm; they grow with its square.
const PFHRGB_COST: u64 = 3_000_000;
const SHOTCOLOR_COST: u64 = 450_000;
const USUAL_RADIUS_UM: u64 = 50_000;

/// What every task of a run has in common.
pub fn preparation(preprocess: &Preprocess, genes: &GeneTable) -> Preparation {
    preparation_to_bytes(preprocess, genes).into()
}

/// The bytes by which tasks name a descriptor.
pub fn descriptor_bytes(descriptor: &Descriptor) -> DescriptorBytes {
    descriptor.to_bytes().into()
}

/// The bytes by which tasks name the grid cell of one R1 and one R2, micrometres.
pub fn cell_bytes((disk_um, ring_um): (u32, u32)) -> DescriptorBytes {
    cell_to_bytes([disk_um, ring_um]).into()
}

/// A descriptor as tasks have it.
pub fn subject(preparation: &Preparation, descriptor: &Descriptor) -> Subject {
    let cloud_cost = match descriptor {
        Descriptor::DiskRing(_) => CLOUD_COST,
        Descriptor::Fixed(FixedDescriptor { kind, radius_um }) => {
            let usual = match kind {
                FixedKind::PfhRgb => PFHRGB_COST,
                FixedKind::ShotColor => SHOTCOLOR_COST,
            };
            let radius = u64::from(*radius_um);
            usual.saturating_mul(radius * radius) / (USUAL_RADIUS_UM * USUAL_RADIUS_UM)
        }
    };
    Subject {
        preparation: preparation.clone(),
        descriptor: descriptor_bytes(descriptor),
        facts: Facts {
            label: Facts::label(&descriptor.to_string()),
            description_bytes: descriptor.description_length(1),
            cloud_cost,
            pair_cost: PAIR_COST,
        },
    }
}

/// All descriptors of a grid cell as tasks have them.
pub fn cell_subject(preparation: &Preparation, radii_um: (u32, u32), descriptors: u32) -> Subject {
    let [disk, ring] = [(GeneKind::DiskRadius, radii_um.0), (GeneKind::RingRadius, radii_um.1)]
        .map(|(kind, um)| GENES[kind as usize].value(um));
    Subject {
        preparation: preparation.clone(),
        descriptor: cell_bytes(radii_um),
        facts: Facts {
            label: format!("R1={disk} cm R2={ring} cm"),
            description_bytes: 0,
            cloud_cost: CLOUD_COST.saturating_mul(descriptors.into()),
            pair_cost: PAIR_COST.saturating_mul(descriptors.into()),
        },
    }
}

/// Looks into a description that a worker has made.
pub const CHECK_DESCRIPTION: CheckDescription = |subject, bytes, clouds| {
    let descriptor = Descriptor::from_bytes(subject.descriptor.bytes()).map_err(|error| error.to_string())?;
    descriptor.check_description(bytes, clouds).map_err(|error| error.to_string())
};

/// The blob that lists one split's clouds.
pub fn split_manifest<'a>(split: &str, clouds: impl Iterator<Item = &'a CloudEntry>) -> Vec<u8> {
    let listed = clouds.map(|cloud| task::CloudEntry {
        digest: Digest(cloud.digest),
        bytes: cloud.bytes,
        label: Label { category: cloud.category, instance: cloud.instance },
        path: cloud.path.clone(),
    });
    SplitManifest { split: split.to_owned(), clouds: listed.collect() }.encode()
}

#[cfg(test)]
mod tests {
    use descriptor::Parameters;

    use super::*;

    #[test]
    fn what_cannot_be_a_description_is_refused() {
        let descriptor = Descriptor::DiskRing(Parameters::PAPER_BEST);
        let subject = subject(&preparation(&Preprocess::default(), &GeneTable::paper()), &descriptor);
        assert_eq!(subject.facts.label, descriptor.to_string());
        let length = 3 * subject.facts.description_bytes as usize;
        assert_eq!(length as u64, descriptor.description_length(3));
        assert_eq!(CHECK_DESCRIPTION(&subject, &vec![0; length], 3), Ok(()));
        CHECK_DESCRIPTION(&subject, &vec![0; length - 4], 3).unwrap_err();
        CHECK_DESCRIPTION(&subject, &vec![0xff; length], 3).unwrap_err(); // no numbers
    }

    #[test]
    fn a_cell_is_labelled_by_its_radii() {
        let preparation = preparation(&Preprocess::default(), &GeneTable::paper());
        let cell = cell_subject(&preparation, (13_000, 36_000), 606);
        assert_eq!(cell.facts.label, "R1=1.3 cm R2=3.6 cm");
        assert_eq!(cell.descriptor, cell_bytes((13_000, 36_000)));
        assert_ne!(cell.descriptor, cell_bytes((36_000, 13_000)));
    }
}
