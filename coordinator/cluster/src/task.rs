//! One task: what a job asks of a worker, and what a worker may answer.

use std::collections::BTreeSet;
use std::fmt;

use descriptor::{Descriptor, FixedDescriptor, GENES, GeneKind, Parameters};
use proto::{Digest, JobId};

use crate::evaluation::{Evaluation, EvaluationResult};
use crate::shard::{Described, Description, Tile};

/// What one job asks for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Task {
    /// One descriptor.
    Evaluation(Evaluation),
    /// Every descriptor with one R1 and one R2.
    GridCell(GridCell),
    /// The clouds of a shard under one descriptor.
    Description(Description),
    /// One descriptor, on shards that are described.
    Tile(Tile),
}

/// What a task gives.
#[derive(Clone, Debug, PartialEq)]
pub enum TaskResult {
    /// Of one descriptor, on all clouds or those of a tile.
    Evaluation(EvaluationResult),
    /// How many queries each descriptor of the cell recognises (object), in the order shape_bins, m, w, w fastest.
    GridCell(Vec<u32>),
    /// Of a shard.
    Description(Described),
}

/// Evaluate every descriptor of the search space that has this R1 and this R2.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GridCell {
    /// R1, micrometres.
    pub disk_um: u32,
    /// R2, micrometres.
    pub ring_um: u32,
    /// Split manifests of the queries, in order.
    pub query: Vec<Digest>,
    /// Split manifests of the database, in order.
    pub database: Vec<Digest>,
    /// Clouds in `query`.
    pub queries: u32,
    /// How many descriptors the cell has.
    pub descriptors: usize,
}

/// Equal for tasks that take about as long on one machine.
pub type Likeness = [u32; 3];

impl Task {
    /// The job that asks for this task, for the first time in a run (0), the second (1), …: the same name whenever the
    /// run is started again, so that a lease handed out by one start means the same job to the next.
    pub fn job(&self, occurrence: u32) -> JobId {
        let mut hasher = blake3::Hasher::new();
        let lists: &[&[Digest]] = match self {
            Self::Evaluation(evaluation) => {
                hasher.update(b"evaluation");
                hash_genes(&mut hasher, &evaluation.parameters);
                hasher.update(&[u8::from(evaluation.want_matches)]);
                &[&evaluation.query, &evaluation.database]
            }
            Self::GridCell(cell) => {
                hasher.update(b"grid cell");
                hasher.update(&cell.disk_um.to_le_bytes());
                hasher.update(&cell.ring_um.to_le_bytes());
                &[&cell.query, &cell.database]
            }
            Self::Description(shard) => {
                match &shard.descriptor {
                    Descriptor::DiskRing(parameters) => {
                        hasher.update(b"description");
                        hash_genes(&mut hasher, parameters);
                    }
                    Descriptor::Fixed(FixedDescriptor { kind, radius_um }) => {
                        hasher.update(kind.name().as_bytes());
                        hasher.update(&radius_um.to_le_bytes());
                    }
                }
                &[std::slice::from_ref(&shard.manifest)]
            }
            Self::Tile(Tile { evaluation, query_parts, database_parts }) => {
                hasher.update(b"tile");
                hash_genes(&mut hasher, &evaluation.parameters);
                hasher.update(&[u8::from(evaluation.want_matches)]);
                &[&evaluation.query, &evaluation.database, query_parts, database_parts]
            }
        };
        for digests in lists {
            hasher.update(&(digests.len() as u64).to_le_bytes());
            for digest in *digests {
                hasher.update(&digest.0);
            }
        }
        hasher.update(&occurrence.to_le_bytes());
        let mut name = [0; 8];
        hasher.finalize_xof().fill(&mut name);
        JobId(u64::from_le_bytes(name))
    }

    /// Which tasks take about as long as this one.
    pub fn likeness(&self) -> Likeness {
        match self {
            Self::Evaluation(evaluation) => [0, evaluation.queries, evaluation.database_clouds],
            Self::GridCell(cell) => [1, cell.queries, cell.descriptors as u32],
            Self::Description(shard) => match shard.descriptor {
                Descriptor::DiskRing(_) => [2, shard.clouds, 0],
                Descriptor::Fixed(fixed) => [4 + fixed.kind as u32, shard.clouds, fixed.radius_um],
            },
            Self::Tile(tile) => [3, tile.evaluation.queries, tile.evaluation.database_clouds],
        }
    }

    /// The descriptor of the paper's kind, of what is about one only.
    pub fn parameters(&self) -> Option<&Parameters> {
        match self {
            Self::Evaluation(evaluation) => Some(&evaluation.parameters),
            Self::GridCell(_) => None,
            Self::Description(shard) => match &shard.descriptor {
                Descriptor::DiskRing(parameters) => Some(parameters),
                Descriptor::Fixed(_) => None,
            },
            Self::Tile(tile) => Some(&tile.evaluation.parameters),
        }
    }

    /// Refuses an answer that cannot be one to this task.
    pub fn check(&self, result: &TaskResult) -> Result<(), String> {
        match (self, result) {
            (Self::Evaluation(evaluation), TaskResult::Evaluation(result)) => evaluation.check(result),
            (Self::Tile(tile), TaskResult::Evaluation(result)) => tile.evaluation.check(result),
            (Self::GridCell(cell), TaskResult::GridCell(counts)) => cell.check(counts),
            (Self::Description(shard), TaskResult::Description(described)) => shard.check(described),
            (_, result) => Err(format!("must answer what was asked, got {}", result.kind())),
        }
    }
}

impl TaskResult {
    fn kind(&self) -> &'static str {
        match self {
            Self::Evaluation(_) => "an evaluation",
            Self::GridCell(_) => "a grid cell",
            Self::Description(_) => "a description",
        }
    }

    /// What is kept of it to the end of the run. Cells of a grid are large, and have files of their own; of a
    /// description its name is enough, for it can be made again.
    pub fn kept(&self) -> Option<Self> {
        match self {
            Self::Evaluation(_) => Some(self.clone()),
            Self::GridCell(_) => None,
            Self::Description(described) => Some(Self::Description(Described::named(described.digest))),
        }
    }

    /// Equal for answers that are equal bit for bit.
    pub fn fingerprint(&self) -> Digest {
        let mut bytes = Vec::new();
        match self {
            Self::Evaluation(EvaluationResult { queries, object_correct, category_correct, matches }) => {
                put_numbers(&mut bytes, &[*queries, *object_correct, *category_correct]);
                for found in matches {
                    let (index, distance) = found.runner_up.unwrap_or((u32::MAX, -1.0)); // no runner-up is like this
                    put_numbers(&mut bytes, &[found.nearest, index]);
                    bytes.extend(found.distance.to_bits().to_le_bytes());
                    bytes.extend(distance.to_bits().to_le_bytes());
                }
            }
            Self::GridCell(counts) => put_numbers(&mut bytes, counts),
            Self::Description(described) => return described.digest,
        }
        Digest::of(&bytes)
    }
}

fn hash_genes(hasher: &mut blake3::Hasher, parameters: &Parameters) {
    for spec in &GENES {
        hasher.update(&parameters.ticks(spec.kind).to_le_bytes());
    }
}

/// The names of all jobs that one client has asked for.
#[derive(Debug, Default)]
pub struct Names(BTreeSet<JobId>);

impl Names {
    /// Names the next job that asks for this task: equal for all who ask for the same as often, and in every start of
    /// a run.
    pub fn next(&mut self, task: &Task) -> JobId {
        let mut occurrence = 0;
        loop {
            let job = task.job(occurrence);
            if self.0.insert(job) {
                return job;
            }
            occurrence += 1;
        }
    }

    /// Whether this job was asked for.
    pub fn contains(&self, job: JobId) -> bool {
        self.0.contains(&job)
    }
}

fn put_numbers(bytes: &mut Vec<u8>, numbers: &[u32]) {
    bytes.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
}

impl fmt::Display for Task {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Evaluation(evaluation) => write!(f, "evaluation of {}", evaluation.parameters),
            Self::GridCell(cell) => {
                let [disk, ring] =
                    [(GeneKind::DiskRadius, cell.disk_um), (GeneKind::RingRadius, cell.ring_um)]
                        .map(|(kind, um)| GENES[kind as usize].value(um));
                write!(f, "grid cell of R1={disk} cm R2={ring} cm")
            }
            Self::Description(shard) => {
                write!(f, "description of {} clouds under {}", shard.clouds, shard.descriptor)
            }
            Self::Tile(Tile { evaluation, .. }) => write!(
                f,
                "tile of {} by {} clouds of the evaluation of {}",
                evaluation.queries, evaluation.database_clouds, evaluation.parameters
            ),
        }
    }
}

impl GridCell {
    fn check(&self, counts: &[u32]) -> Result<(), String> {
        if counts.len() != self.descriptors {
            return Err(format!("counts: must be {}, got {}", self.descriptors, counts.len()));
        }
        match counts.iter().find(|&&count| count > self.queries) {
            Some(count) => Err(format!("count: must be at most {}, got {count}", self.queries)),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use descriptor::FixedKind;

    use super::*;

    #[test]
    fn a_job_is_named_by_all_that_is_asked_and_by_how_often() {
        let base = Evaluation {
            parameters: Parameters::PAPER_BEST,
            query: vec![Digest([1; 32])],
            database: vec![Digest([2; 32])],
            queries: 2,
            database_clouds: 3,
            want_matches: false,
        };
        let cell = GridCell {
            disk_um: 5_000,
            ring_um: 21_000,
            query: base.query.clone(),
            database: base.database.clone(),
            queries: 2,
            descriptors: 3,
        };
        let other_genes = Parameters { shape_bins: 8, ..base.parameters };
        let of = |parameters| Descriptor::DiskRing(parameters);
        let fixed = |kind, radius_um| Descriptor::Fixed(FixedDescriptor { kind, radius_um });
        let shard = Description { descriptor: of(base.parameters), manifest: Digest([1; 32]), clouds: 2 };
        let tile = Tile {
            evaluation: base.clone(),
            query_parts: vec![Digest([3; 32])],
            database_parts: vec![Digest([4; 32])],
        };
        let names = [
            Task::Description(shard.clone()).job(0),
            Task::Description(Description { descriptor: of(other_genes), ..shard.clone() }).job(0),
            Task::Description(Description { manifest: Digest([2; 32]), ..shard.clone() }).job(0),
            Task::Description(Description { descriptor: fixed(FixedKind::PfhRgb, 50_000), ..shard.clone() })
                .job(0),
            Task::Description(Description {
                descriptor: fixed(FixedKind::ShotColor, 50_000),
                ..shard.clone()
            })
            .job(0),
            Task::Description(Description { descriptor: fixed(FixedKind::PfhRgb, 40_000), ..shard }).job(0),
            Task::Tile(tile.clone()).job(0),
            // A description that was corrected makes another tile.
            Task::Tile(Tile { query_parts: vec![Digest([5; 32])], ..tile.clone() }).job(0),
            Task::Tile(Tile { database_parts: vec![Digest([5; 32])], ..tile }).job(0),
            Task::Evaluation(base.clone()).job(0),
            Task::Evaluation(base.clone()).job(1),
            Task::Evaluation(Evaluation { parameters: other_genes, ..base.clone() }).job(0),
            Task::Evaluation(Evaluation { want_matches: true, ..base.clone() }).job(0),
            Task::Evaluation(Evaluation { query: base.database.clone(), ..base.clone() }).job(0),
            Task::Evaluation(Evaluation {
                query: vec![base.query[0], base.database[0]],
                database: vec![],
                ..base.clone()
            })
            .job(0),
            Task::GridCell(cell.clone()).job(0),
            Task::GridCell(GridCell { disk_um: 21_000, ring_um: 5_000, ..cell.clone() }).job(0),
        ];
        let different: std::collections::BTreeSet<JobId> = names.into();
        assert_eq!(different.len(), names.len());
        assert_eq!(names[9], Task::Evaluation(base).job(0));
    }

    #[test]
    fn of_a_description_its_name_is_kept_and_two_are_equal_if_their_bytes_are() {
        let described = |bytes: &[u8]| TaskResult::Description(Described::new(bytes.to_vec()));
        let TaskResult::Description(kept) = described(b"parts").kept().unwrap() else {
            panic!("another kind")
        };
        assert_eq!(kept, Described::named(Digest::of(b"parts")));
        assert_eq!(TaskResult::Description(kept).fingerprint(), described(b"parts").fingerprint());
        assert_ne!(described(b"other").fingerprint(), described(b"parts").fingerprint());
        assert_eq!(TaskResult::GridCell(vec![1]).kept(), None);
    }

    #[test]
    fn a_task_takes_answers_of_its_own_kind_and_size_only() {
        let (query, database) = (vec![], vec![]);
        let evaluation = Task::Evaluation(Evaluation::sample(2, 3));
        let cell = Task::GridCell(GridCell {
            disk_um: 5_000,
            ring_um: 21_000,
            query,
            database,
            queries: 2,
            descriptors: 3,
        });
        let result = TaskResult::Evaluation(EvaluationResult {
            queries: 2,
            object_correct: 1,
            category_correct: 2,
            matches: vec![],
        });
        assert_eq!(evaluation.check(&result), Ok(()));
        assert!(cell.check(&result).is_err());
        for (counts, good) in [
            (vec![0, 2, 1], true),
            (vec![0, 3, 1], false),
            (vec![0, 2], false),
            (vec![0, 2, 1, 0], false),
            (vec![], false),
        ] {
            let result = TaskResult::GridCell(counts);
            assert_eq!(cell.check(&result).is_ok(), good, "{result:?}");
            assert!(evaluation.check(&result).is_err());
        }
    }
}
