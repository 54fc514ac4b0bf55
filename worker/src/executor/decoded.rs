//! The bytes of a task that only `descriptor` reads: the one place of a worker where they are, checked.

use descriptor::grid::cell_from_bytes;
use descriptor::{BytesError, Descriptor, GENES, GeneKind, Preparation, SearchSpace};
use proto::MAX_CELL;
use proto::task::{GridCell, Task, Tile};

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
    Descriptor(Descriptor),
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
    /// One scale a channel, or none at all.
    #[error(
        "scales: must be one for each of {channels} channels, got {got}\nuse a worker and a coordinator of the same release"
    )]
    Scales {
        /// Of the descriptor.
        channels: usize,
        /// How many scales there are.
        got: usize,
    },
    /// A descriptor of several channels has no one scale.
    #[error(
        "scale: the descriptor must have 1 channel, got {channels}\nuse a worker and a coordinator of the same release"
    )]
    Channels {
        /// Of the descriptor.
        channels: usize,
    },
    /// Shards of which a split is not made, or in a channel that is not there or cannot be described alone.
    #[error(
        "described splits: must be in a channel of the descriptor and have the clouds of the split, got others in channel {channel}\nuse a worker and a coordinator of the same release"
    )]
    Described {
        /// Which channel the task names, from 0.
        channel: usize,
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
        let preparation = Preparation::from_bytes(task.subject().preparation.bytes())?;
        let subject = match task {
            Task::GridCell(cell) => Subject::Cell(radii(cell, &preparation.space)?),
            Task::Evaluation(_) | Task::Description(_) | Task::Tile(_) | Task::Scale(_) => {
                let descriptor = Descriptor::from_bytes(task.subject().descriptor.bytes())?;
                if !preparation.space.contains(&descriptor) {
                    let got = descriptor.to_string();
                    return Err(InvalidTask::OutsideSpace { what: "descriptor", got });
                }
                check_channels(task, descriptor.channels().len())?;
                Subject::Descriptor(descriptor)
            }
        };
        Ok(Self { preparation, subject })
    }
}

fn check_channels(task: &Task, channels: usize) -> Result<(), InvalidTask> {
    match task {
        Task::Evaluation(evaluation) | Task::Tile(Tile { evaluation, .. }) => {
            let got = evaluation.scales.len();
            if got == 0 || got == channels { Ok(()) } else { Err(InvalidTask::Scales { channels, got }) }
        }
        Task::Scale(_) if channels != 1 => Err(InvalidTask::Channels { channels }),
        Task::Scale(_) | Task::Description(_) | Task::GridCell(_) => Ok(()),
    }
}

fn radii(cell: &GridCell, space: &SearchSpace) -> Result<[u32; 2], InvalidTask> {
    let SearchSpace::DiskRing(genes) = space else { return Err(InvalidTask::Subject) };
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
    use descriptor::Domain;
    use descriptor::grid::cell_to_bytes;
    use descriptor::{FixedDescriptor, FixedKind, GeneTable, GlobalHue, Parameters, Preprocess};
    use proto::task::{Description, Evaluation, Scale};
    use proto::{Digest, task};

    use super::*;

    fn subject(space: &SearchSpace, bytes: Vec<u8>) -> task::Subject {
        let preparation = Preparation { preprocess: Preprocess::default(), space: space.clone() };
        task::Subject {
            preparation: preparation.to_bytes().into(),
            descriptor: bytes.into(),
            ..task::Subject::sample(1)
        }
    }

    fn describe(space: &SearchSpace, descriptor: &Descriptor) -> Task {
        let subject = subject(space, descriptor.to_bytes());
        Task::Description(Description { subject, manifest: Digest([1; 32]), clouds: 1 })
    }

    #[test]
    fn descriptors_are_read_if_they_lie_in_the_search_space() {
        let paper = SearchSpace::DiskRing(GeneTable::paper());
        let best = Descriptor::DiskRing(Parameters::PAPER_BEST);
        let fixed = Descriptor::Fixed(FixedDescriptor::new(FixedKind::ShotColor, 50_000).unwrap());
        let hue = Descriptor::GlobalHue(GlobalHue::new(16).unwrap());
        let own = |descriptor| SearchSpace::single(descriptor).unwrap();
        for (space, descriptor) in [(paper.clone(), &best), (own(&fixed), &fixed), (own(&hue), &hue)] {
            let Decoded { preparation, subject } = Decoded::new(&describe(&space, descriptor)).unwrap();
            assert_eq!(subject, Subject::Descriptor(descriptor.clone()));
            assert_eq!(preparation, Preparation { preprocess: Preprocess::default(), space });
        }
        let outside = Descriptor::DiskRing(Parameters { disk_um: 13_500, ..Parameters::PAPER_BEST });
        for (outside, got) in [(outside, "shape_bins=60"), (fixed, "shotcolor radius=5 cm")] {
            let error = Decoded::new(&describe(&paper, &outside)).unwrap_err().to_string();
            let expected = format!("descriptor: must lie in the search space, got {got}");
            assert!(error.starts_with(&expected), "{error}");
        }
    }

    #[test]
    fn scales_are_of_channels() {
        let disk_ring = Descriptor::DiskRing(Parameters::PAPER_BEST);
        let hue = Descriptor::GlobalHue(GlobalHue::new(16).unwrap());
        let outcome = |descriptor: &Descriptor, task: &dyn Fn(task::Subject) -> Task| {
            let space = SearchSpace::single(descriptor).unwrap();
            let decoded = Decoded::new(&task(subject(&space, descriptor.to_bytes())));
            decoded.map(drop).map_err(|error| error.to_string())
        };
        let refused = |outcome: Result<(), String>, expected: &str| {
            let error = outcome.unwrap_err();
            assert!(error.starts_with(expected), "{error}");
        };
        let evaluation = |scales: &[f64]| {
            let scales = scales.to_vec();
            move |subject| {
                let evaluation =
                    Evaluation { subject, scales: scales.clone(), ..Evaluation::sample(1, 2, 3) };
                Task::Evaluation(evaluation)
            }
        };
        let tile = |scales: &[f64]| {
            let evaluation = evaluation(scales);
            move |subject| {
                let Task::Evaluation(evaluation) = evaluation(subject) else { panic!("another kind") };
                let (query_descriptions, database_descriptions) = (Vec::new(), Vec::new());
                Task::Tile(Tile { evaluation, query_descriptions, database_descriptions })
            }
        };
        for scales in [&[][..], &[1.0, 0.5]] {
            assert_eq!(outcome(&disk_ring, &evaluation(scales)), Ok(()));
            assert_eq!(outcome(&disk_ring, &tile(scales)), Ok(()));
        }
        for (scales, expected) in [
            (&[1.0][..], "scales: must be one for each of 2 channels, got 1\n"),
            (&[1.0; 3], "scales: must be one for each of 2 channels, got 3\n"),
        ] {
            refused(outcome(&disk_ring, &evaluation(scales)), expected);
            refused(outcome(&disk_ring, &tile(scales)), expected);
        }
        let scale =
            |subject| Task::Scale(Scale { subject, splits: Vec::new(), clouds: 0, described: Vec::new() });
        assert_eq!(outcome(&hue, &scale), Ok(()));
        refused(outcome(&disk_ring, &scale), "scale: the descriptor must have 1 channel, got 2\n");
    }

    #[test]
    fn cells_outside_the_search_space_are_refused() {
        let cell = |genes: &GeneTable, radii_um, descriptors| {
            let Evaluation { query, database, .. } = Evaluation::sample(1, 2, 3);
            let subject = subject(&SearchSpace::DiskRing(genes.clone()), cell_to_bytes(radii_um));
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
        let mut domains = GeneKind::ALL.map(|gene| *paper.domain(gene).unwrap());
        domains[0] = Domain { low: 2, step: 1, count: 511 };
        domains[4] = Domain { low: 0, step: 1, count: 65_536 };
        let large = GeneTable::new(domains, true).unwrap();
        let error = cell(&large, [13_000, 36_000], 200_933_376).unwrap_err();
        assert!(error.contains("at most 1048576, got 200933376"), "{error}");
    }
}
