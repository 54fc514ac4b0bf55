//! The bytes of a task that only `descriptor` reads: the one place of a worker where they are, checked.

use descriptor::bytes::{BytesError, cell_from_bytes, preparation_from_bytes};
use descriptor::{Descriptor, FixedDescriptor, GENES, GeneKind, GeneTable, Parameters, Preprocess};
use proto::MAX_CELL;
use proto::task::{GridCell, Task};

/// What is computed once for all parameters of a run.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct Preparation {
    /// Keypoints and normals.
    pub preprocess: Preprocess,
    /// The search space: how finely neighbours are recorded.
    pub genes: GeneTable,
}

/// What a task is about.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Decoded {
    /// How clouds are prepared.
    pub preparation: Preparation,
    /// What is evaluated.
    pub subject: Subject,
}

/// What is evaluated.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Subject {
    /// A descriptor of the preparation's search space.
    DiskRing(Parameters),
    /// One without genes.
    Fixed(FixedDescriptor),
    /// All descriptors of the search space with this R1 and this R2, micrometres.
    Cell([u32; 2]),
}

/// A task that no worker of this release can carry out.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum InvalidTask {
    /// Bytes that cannot be read.
    #[error(transparent)]
    Bytes(#[from] BytesError),
    /// A descriptor or a cell of another search space.
    #[error(
        "{what}: must lie in the search space, got {got}\nuse a worker and a coordinator of the same release"
    )]
    OutsideSpace {
        /// Which part of it.
        what: &'static str,
        /// Its value.
        got: String,
    },
    /// More descriptors than a message can count, or another number than the task says.
    #[error(
        "grid cell: must have {expected} descriptors, at most {MAX_CELL}, got {got}\nuse a worker and a coordinator of the same release"
    )]
    CellSize {
        /// As the task says.
        expected: u32,
        /// Of the search space.
        got: u64,
    },
    /// A kind of descriptor that the kind of task cannot have.
    #[error(
        "task: its kind of descriptor cannot be evaluated like this\nuse a worker and a coordinator of the same release"
    )]
    Subject,
}

impl Decoded {
    /// Reads the bytes of a task.
    ///
    /// # Errors
    /// If they make no sense.
    pub fn new(task: &Task) -> Result<Self, InvalidTask> {
        let (preprocess, genes) = preparation_from_bytes(task.subject().preparation.bytes())?;
        let subject = match task {
            Task::GridCell(cell) => Subject::Cell(radii(cell, &genes)?),
            Task::Evaluation(_) | Task::Description(_) | Task::Tile(_) => {
                match Descriptor::from_bytes(task.subject().descriptor.bytes())? {
                    Descriptor::DiskRing(parameters) if genes.contains(&parameters) => {
                        Subject::DiskRing(parameters)
                    }
                    Descriptor::DiskRing(parameters) => {
                        let got = parameters.to_string();
                        return Err(InvalidTask::OutsideSpace { what: "parameters", got });
                    }
                    Descriptor::Fixed(fixed) => Subject::Fixed(fixed),
                }
            }
        };
        Ok(Self { preparation: Preparation { preprocess, genes }, subject })
    }
}

fn radii(cell: &GridCell, genes: &GeneTable) -> Result<[u32; 2], InvalidTask> {
    let radii_um = cell_from_bytes(cell.subject.descriptor.bytes())?;
    for (kind, um) in [GeneKind::DiskRadius, GeneKind::RingRadius].into_iter().zip(radii_um) {
        if !genes.domain(kind).is_some_and(|domain| domain.values().any(|value| value == um)) {
            let what = GENES[kind as usize].name;
            return Err(InvalidTask::OutsideSpace { what, got: format!("{um} um") });
        }
    }
    let count = |kind| genes.domain(kind).map_or(1, |domain| u64::from(domain.count));
    // Three counts of at most 65536 each.
    let got = count(GeneKind::ShapeBins) * count(GeneKind::ColourBins) * count(GeneKind::ShapeWeight);
    if got > MAX_CELL || got != u64::from(cell.descriptors) {
        return Err(InvalidTask::CellSize { expected: cell.descriptors, got });
    }
    Ok(radii_um)
}

#[cfg(test)]
mod tests {
    use descriptor::FixedKind;
    use descriptor::bytes::{cell_to_bytes, preparation_to_bytes};
    use descriptor::genes::Domain;
    use proto::task::{Description, Evaluation};
    use proto::{Digest, task};

    use super::*;

    fn subject(genes: &GeneTable, bytes: Vec<u8>) -> task::Subject {
        let preparation = preparation_to_bytes(&Preprocess::default(), genes);
        task::Subject {
            preparation: preparation.into(),
            descriptor: bytes.into(),
            ..task::Subject::sample(1)
        }
    }

    fn describe(descriptor: Descriptor) -> Task {
        let subject = subject(&GeneTable::paper(), descriptor.to_bytes());
        Task::Description(Description { subject, manifest: Digest([1; 32]), clouds: 1 })
    }

    #[test]
    fn descriptors_are_read_if_they_lie_in_the_search_space() {
        let best = Parameters::PAPER_BEST;
        let Decoded { preparation, subject } = Decoded::new(&describe(Descriptor::DiskRing(best))).unwrap();
        assert_eq!(subject, Subject::DiskRing(best));
        assert_eq!((preparation.preprocess, preparation.genes), (Preprocess::default(), GeneTable::paper()));
        let fixed = FixedDescriptor { kind: FixedKind::ShotColor, radius_um: 50_000 };
        let decoded = Decoded::new(&describe(Descriptor::Fixed(fixed))).unwrap();
        assert_eq!(decoded.subject, Subject::Fixed(fixed));
        let outside = Parameters { disk_um: 13_500, ..best };
        let error = Decoded::new(&describe(Descriptor::DiskRing(outside))).unwrap_err().to_string();
        assert!(error.starts_with("parameters: must lie in the search space, got shape_bins=60"), "{error}");
    }

    #[test]
    fn cells_outside_the_search_space_are_refused() {
        let cell = |genes: &GeneTable, radii_um, descriptors| {
            let Evaluation { query, database, .. } = Evaluation::sample(1, 2, 3);
            let subject = subject(genes, cell_to_bytes(radii_um));
            let (queries, database_clouds) = (2, 3);
            let cell = GridCell { subject, query, database, queries, database_clouds, descriptors };
            Decoded::new(&Task::GridCell(cell))
                .map(|decoded| decoded.subject)
                .map_err(|error| error.to_string())
        };
        let paper = GeneTable::paper();
        let descriptors = 57 * 6 * 101;
        assert_eq!(cell(&paper, [13_000, 36_000], descriptors), Ok(Subject::Cell([13_000, 36_000])));
        for (radii_um, descriptors, expected) in [
            ([13_500, 36_000], descriptors, "R1: must lie in the search space, got 13500 um"),
            ([13_000, 60_000], descriptors, "R2: must lie in the search space, got 60000 um"),
            ([13_000, 36_000], 7, "must have 7 descriptors, at most 1048576, got 34542"),
        ] {
            let error = cell(&paper, radii_um, descriptors).unwrap_err();
            assert!(error.contains(expected), "{error}");
        }
        let mut domains = GENES.each_ref().map(|gene| *paper.domain(gene.kind).unwrap());
        domains[0] = Domain { low: 2, step: 1, count: 511 };
        domains[4] = Domain { low: 0, step: 1, count: 65_536 };
        let large = GeneTable::new(domains, true).unwrap();
        let error = cell(&large, [13_000, 36_000], 200_933_376).unwrap_err();
        assert!(error.contains("at most 1048576, got 200933376"), "{error}");
    }
}
