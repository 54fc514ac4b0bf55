//! Descriptors and clouds as tasks name them: the place where their bytes, labels and counted costs are made.

use cluster::scheduler::CheckDescription;
use descriptor::grid::cell_to_bytes;
use descriptor::{Descriptor, GENES, GeneKind, Parameters, Preprocess, SearchSpace};
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

/// The bytes by which tasks name the grid cell of one R1 and one R2, micrometres.
pub fn cell_bytes((disk_um, ring_um): (u32, u32)) -> DescriptorBytes {
    cell_to_bytes([disk_um, ring_um]).into()
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

/// All descriptors of a grid cell as tasks have them. They count as the paper's best with these radii.
pub fn cell_subject(preparation: &Preparation, (disk_um, ring_um): (u32, u32), descriptors: u32) -> Subject {
    let [disk, ring] = [(GeneKind::DiskRadius, disk_um), (GeneKind::RingRadius, ring_um)]
        .map(|(kind, um)| GENES[kind as usize].value(um));
    let typical = Descriptor::DiskRing(Parameters { disk_um, ring_um, ..Parameters::PAPER_BEST });
    Subject {
        preparation: preparation.clone(),
        descriptor: cell_bytes((disk_um, ring_um)),
        facts: Facts {
            label: format!("R1={disk} cm R2={ring} cm"),
            description_bytes: 0,
            cloud_cost: typical.cost(1, 0).saturating_mul(descriptors.into()),
            pair_cost: typical.cost(0, 1).saturating_mul(descriptors.into()),
        },
    }
}

/// Looks into a description that a worker has made.
pub const CHECK_DESCRIPTION: CheckDescription = |subject, bytes, clouds| {
    let descriptor = Descriptor::from_bytes(subject.descriptor.bytes()).map_err(|error| error.to_string())?;
    descriptor.check_signatures(bytes, clouds).map_err(|error| error.to_string())
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
    use descriptor::GeneTable;

    use super::*;

    fn paper() -> Preparation {
        preparation(&Preprocess::default(), SearchSpace::DiskRing(GeneTable::paper()))
    }

    #[test]
    fn what_cannot_be_a_description_is_refused() {
        let descriptor = Descriptor::DiskRing(Parameters::PAPER_BEST);
        let subject = subject(&paper(), &descriptor);
        assert_eq!(subject.facts.label, descriptor.to_string());
        let length = 3 * subject.facts.description_bytes as usize;
        assert_eq!(length as u64, descriptor.signature_bytes(3));
        assert_eq!(CHECK_DESCRIPTION(&subject, &vec![0; length], 3), Ok(()));
        CHECK_DESCRIPTION(&subject, &vec![0; length - 4], 3).unwrap_err();
        CHECK_DESCRIPTION(&subject, &vec![0xff; length], 3).unwrap_err(); // no numbers
    }

    #[test]
    fn a_cell_is_labelled_by_its_radii() {
        let cell = cell_subject(&paper(), (13_000, 36_000), 606);
        assert_eq!(cell.facts.label, "R1=1.3 cm R2=3.6 cm");
        assert_eq!(cell.descriptor, cell_bytes((13_000, 36_000)));
        assert_ne!(cell.descriptor, cell_bytes((36_000, 13_000)));
    }
}
