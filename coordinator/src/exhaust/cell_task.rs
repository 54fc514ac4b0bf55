//! A cell of the grid as tasks name it: its bytes, label and counted cost.

use descriptor::grid::cell_to_bytes;
use descriptor::{Descriptor, GeneKind, Parameters};
use proto::task::{DescriptorBytes, Facts, Preparation, Subject};

/// The bytes by which tasks name the cell of one R1 and one R2, micrometres.
pub fn cell_bytes((disk_um, ring_um): (u32, u32)) -> DescriptorBytes {
    cell_to_bytes([disk_um, ring_um]).into()
}

/// All descriptors of a cell as tasks have them. They count as the paper's best with these radii.
pub fn cell_subject(preparation: &Preparation, (disk_um, ring_um): (u32, u32), descriptors: u32) -> Subject {
    let [disk, ring] = [(GeneKind::DiskRadius, disk_um), (GeneKind::RingRadius, ring_um)]
        .map(|(kind, um)| format!("{}={}", kind.spec().name, kind.spec().text(um)));
    let typical = Descriptor::DiskRing(Parameters { disk_um, ring_um, ..Parameters::PAPER_BEST });
    Subject {
        preparation: preparation.clone(),
        descriptor: cell_bytes((disk_um, ring_um)),
        facts: Facts {
            label: format!("{disk} {ring}"),
            description_bytes: 0,
            cloud_cost: typical.cost(1, 0).saturating_mul(descriptors.into()),
            pair_cost: typical.cost(0, 1).saturating_mul(descriptors.into()),
        },
    }
}

#[cfg(test)]
mod tests {
    use descriptor::{GeneTable, Preprocess, SearchSpace};

    use super::*;
    use crate::tasks::preparation;

    #[test]
    fn a_cell_is_labelled_by_its_radii() {
        let paper = preparation(&Preprocess::default(), SearchSpace::DiskRing(GeneTable::paper()));
        let cell = cell_subject(&paper, (13_000, 36_000), 606);
        assert_eq!(cell.facts.label, "R1=1.3 cm R2=3.6 cm");
        assert_eq!(cell.descriptor, cell_bytes((13_000, 36_000)));
        assert_ne!(cell.descriptor, cell_bytes((36_000, 13_000)));
    }
}
