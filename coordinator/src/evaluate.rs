//! One descriptor on given lists, under one or several set distances, in this process, with the time that each stage
//! takes.

use std::path::Path;
use std::time::Instant;

pub use artefact::{Seconds, stages};
use descriptor::recognise::{RecogniseError, recognise_from};
use descriptor::spacing::{WrongUnit, check_spacing, median_spacing};
use descriptor::{
    Cloud, Correct, DescribeError, Described, Describer, DescriberError, Descriptor, Label, Match,
    PrepareError, Preprocess, SetDistance, Signature, Signatures, cloud_file,
};
use proto::Message;
use rayon::prelude::*;

use crate::dataset::{ListedCloud, Listing, SPACING_CLOUDS, cloud_bytes};

/// More distances, over all channels, are not kept at once: queries are matched by pruning. They would take 256 MiB.
const LARGEST_DISTANCES: usize = 64 << 20;

/// What to evaluate.
#[derive(Clone, Debug)]
pub struct Request {
    /// On which clouds.
    pub listing: Listing,
    /// Keypoints and normals.
    pub preprocess: Preprocess,
    /// The descriptor.
    pub descriptor: Descriptor,
    /// Threads; stages are timed on each of them and added up.
    pub threads: usize,
    /// How many of the first usable database clouds the scales of a structure's channels are found by; `None`: all.
    pub scaled_by: Option<usize>,
}

/// What an evaluation under one set distance gives.
#[derive(Clone, Debug)]
pub struct Report {
    /// Counts of recognised queries.
    pub correct: Correct,
    /// Clouds in the database.
    pub database: usize,
    /// Skipped clouds: path and reason.
    pub skipped: Vec<(String, String)>,
    /// Keypoints that are described, over all clouds.
    pub keypoints: usize,
    /// Time per stage.
    pub seconds: Seconds,
    /// One a query: its path, the nearest cloud's path, and the match.
    pub matches: Vec<(String, String, Match)>,
}

/// Why there is no report.
#[derive(Debug, thiserror::Error)]
pub enum EvaluateError {
    /// A cloud.
    #[error("{path}: {what}")]
    Cloud {
        /// Its path.
        path: String,
        /// What is wrong with it.
        what: String,
    },
    /// All queries or the whole database were skipped.
    #[error(
        "{which}: no usable cloud, got {skipped} skipped ones: {first}\nchoose other lists, or other clouds"
    )]
    Empty {
        /// Which side.
        which: &'static str,
        /// How many were skipped.
        skipped: usize,
        /// The first of them and why.
        first: String,
    },
    /// Clouds whose points are as far apart as in no cloud of the unit.
    #[error("--unit: {wrong} in {cloud}, the median of {clouds} clouds\nadd --unit {}", .wrong.other)]
    Unit {
        /// The cloud with the median spacing.
        cloud: String,
        /// Clouds that were looked at.
        clouds: usize,
        /// Its spacing.
        wrong: WrongUnit,
    },
    /// The descriptor.
    #[error(transparent)]
    Descriptor(#[from] DescriberError),
    /// Nothing to match with.
    #[error(transparent)]
    Recognise(#[from] RecogniseError),
    /// No threads to be had.
    #[error("--threads: cannot start them, got {0}\nlower --threads")]
    Threads(#[from] rayon::ThreadPoolBuildError),
}

/// Queries and database under one descriptor: they are described once, whatever they are compared by.
pub struct DescribedClouds {
    pool: rayon::ThreadPool,
    descriptor: Descriptor,
    query: Side,
    database: Side,
    skipped: Vec<(String, String)>,
    keypoints: usize,
    scaled_by: Option<usize>,
    /// Of everything so far.
    seconds: Seconds,
}

impl DescribedClouds {
    /// Describes all clouds; `watch` is called after each.
    pub fn new(request: &Request, watch: &(dyn Fn() + Sync)) -> Result<Self, EvaluateError> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(request.threads).build()?;
        let describer = Describer::new(&request.descriptor)?;
        let (started, listing) = (Instant::now(), &request.listing);
        let describe = |cloud: &ListedCloud| {
            let described = describe_file(&cloud.path, &cloud.file, &request.preprocess, &describer)?;
            watch();
            Ok(described)
        };
        let described: Vec<(Result<Described, String>, Seconds)> =
            pool.install(|| listing.clouds.par_iter().map(describe).collect::<Result<_, EvaluateError>>())?;

        let mut seconds = Seconds::default();
        let mut skipped: Vec<(String, String)> = Vec::new();
        let mut total_keypoints = 0;
        let mut sides = [Side::default(), Side::default()];
        for (index, (cloud, (described, time))) in listing.clouds.iter().zip(described).enumerate() {
            seconds += time;
            let side = &mut sides[usize::from(index >= listing.queries)];
            match described {
                Ok(Described { signatures, keypoints }) => {
                    total_keypoints += keypoints;
                    side.signatures.push(signatures);
                    side.labels.push(Label { category: cloud.category, instance: cloud.instance });
                    side.paths.push(cloud.path.clone());
                }
                Err(reason) => {
                    skipped.push((cloud.path.clone(), reason));
                    side.skipped += 1;
                }
            }
        }
        let [query, database] = sides;
        for (which, side) in [("--query", &query), ("--database", &database)] {
            if side.signatures.is_empty() {
                let of_database = if which == "--query" { 0 } else { query.skipped };
                let first = skipped.get(of_database);
                let first = first.map(|(cloud, reason)| format!("{cloud}: {reason}")).unwrap_or_default();
                return Err(EvaluateError::Empty { which, skipped: side.skipped, first });
            }
        }
        seconds.total = started.elapsed();
        let (descriptor, keypoints) = (request.descriptor.clone(), total_keypoints);
        let scaled_by = request.scaled_by;
        Ok(Self { pool, descriptor, query, database, skipped, keypoints, scaled_by, seconds })
    }

    /// Matches them by a set distance; the time that it took to describe them is part of the report.
    pub fn report(&self, distance: SetDistance) -> Result<Report, EvaluateError> {
        self.pool.install(|| self.matched_by(distance, LARGEST_DISTANCES))
    }

    /// The channels of a structure, from 1, that count nothing in any cloud: all clouds are alike in them.
    pub fn empty_channels(&self) -> Vec<usize> {
        let Descriptor::Structure(structure) = &self.descriptor else { return Vec::new() };
        let clouds = || self.query.signatures.iter().chain(&self.database.signatures);
        let is_empty = |channel: &usize| {
            clouds().all(|signatures| signatures[*channel].centroid.iter().all(|&value| value == 0.0))
        };
        (0..structure.channels.len()).filter(is_empty).map(|channel| channel + 1).collect()
    }

    fn matched_by(&self, distance: SetDistance, most: usize) -> Result<Report, EvaluateError> {
        let Self { query, database, .. } = self;
        let matching = Instant::now();
        let channels = 0..self.descriptor.channels().len();
        let signatures: Vec<[Signatures; 2]> =
            channels.map(|channel| [query, database].map(|side| side.channel(channel))).collect();
        let scaled_by = self.scaled_by.unwrap_or(database.signatures.len());
        let pairs = query.signatures.len().saturating_mul(database.signatures.len());
        let matches = if pairs.saturating_mul(signatures.len()) <= most {
            let distances = self.descriptor.distances(distance, &signatures, scaled_by);
            recognise_from(query.signatures.len(), &distances, &database.labels)?
        } else {
            let [queries, known] =
                [0, 1].map(|side| signatures.iter().map(|both| &both[side]).collect::<Vec<_>>());
            let pruned = self.descriptor.pruned(distance, &known, &database.labels, scaled_by)?;
            pruned.recognise(&queries, true).0
        };
        let correct = Correct::count(&matches, &query.labels, &database.labels);
        let mut seconds = self.seconds;
        seconds.matching = matching.elapsed();
        seconds.total += seconds.matching;
        let named = query.paths.iter().zip(&matches).map(|(path, found)| {
            (path.clone(), database.paths[found.nearest.index as usize].clone(), *found)
        });
        Ok(Report {
            correct,
            database: database.signatures.len(),
            skipped: self.skipped.clone(),
            keypoints: self.keypoints,
            seconds,
            matches: named.collect(),
        })
    }
}

/// What clouds are compared by under a descriptor: in a structure χ² stands for its channels' own metrics.
pub fn compared_by(descriptor: &Descriptor, distance: SetDistance) -> &'static str {
    let own: Vec<SetDistance> = descriptor.channels().iter().map(|(channel, _)| channel.metric()).collect();
    match (distance, own.split_first()) {
        (SetDistance::ChiSquared, Some((first, others))) if others.iter().all(|metric| metric == first) => {
            first.name()
        }
        (SetDistance::ChiSquared, Some(_)) => "several metrics",
        (other, _) => other.name(),
    }
}

/// Queries, or the database.
#[derive(Default)]
struct Side {
    /// Of each cloud, one a channel.
    signatures: Vec<Vec<Signature>>,
    labels: Vec<Label>,
    paths: Vec<String>,
    skipped: usize,
}

impl Side {
    /// All clouds in one channel.
    fn channel(&self, channel: usize) -> Signatures {
        self.signatures.iter().map(|cloud| &cloud[channel]).collect()
    }
}

/// Refuses clouds of another unit than that of the settings, by the spacing of some of them, as a run does.
///
/// # Errors
/// [`EvaluateError::Unit`]. Clouds that cannot be read are passed over.
pub fn check_units(listing: &Listing, preprocess: &Preprocess) -> Result<(), EvaluateError> {
    let every = listing.clouds.len().div_ceil(SPACING_CLOUDS).max(1);
    let some: Vec<&ListedCloud> = listing.clouds.iter().step_by(every).collect();
    let spacing = |cloud: &&ListedCloud| {
        let read = read_cloud(&cloud.path, &cloud.file, preprocess).ok()?;
        Some((median_spacing(&read.points)?, cloud.path.clone()))
    };
    let mut spaced: Vec<(f64, String)> = some.par_iter().filter_map(spacing).collect();
    spaced.sort_by(|(a, _), (b, _)| a.total_cmp(b));
    let Some((spacing, cloud)) = spaced.get(spaced.len().saturating_sub(1) / 2) else { return Ok(()) };
    check_spacing(*spacing, preprocess).map_err(|wrong| EvaluateError::Unit {
        cloud: cloud.clone(),
        clouds: spaced.len(),
        wrong,
    })
}

/// The points of a cloud, in metres.
///
/// # Errors
/// If it cannot be read.
pub fn read_cloud(path: &str, file: &Path, preprocess: &Preprocess) -> Result<Cloud, EvaluateError> {
    let failed = |what: String| EvaluateError::Cloud { path: path.to_owned(), what };
    let bytes = cloud_bytes(file).map_err(|reason| failed(format!("cannot be read, got {reason}")))?;
    let cloud = cloud_file::read(&bytes).map_err(|error| failed(error.to_string()))?;
    Ok(cloud.in_metres(preprocess.unit.metres()))
}

/// One cloud through all stages: described, or why it is skipped, and the time of each stage.
///
/// # Errors
/// If it cannot be read.
pub fn describe_file(
    path: &str,
    file: &Path,
    preprocess: &Preprocess,
    describer: &Describer,
) -> Result<(Result<Described, String>, Seconds), EvaluateError> {
    let mut seconds = Seconds::default();
    let clock = Instant::now();
    let cloud = read_cloud(path, file, preprocess)?;
    seconds.read = clock.elapsed();

    match stages(&cloud, preprocess, describer, &mut seconds) {
        Ok(described) => Ok((Ok(described), seconds)),
        Err(DescribeError::Prepare(PrepareError::Skip(skip))) => Ok((Err(skip.to_string()), seconds)),
        Err(nothing @ DescribeError::NothingDescribed { .. }) => {
            Ok((Err(Message::of(&nothing).what), seconds))
        }
        Err(error) => Err(EvaluateError::Cloud { path: path.to_owned(), what: error.to_string() }),
    }
}

#[cfg(test)]
mod tests {
    use descriptor::structure::StructureFile;
    use descriptor::{Family, Parameters};

    use super::*;

    fn side(descriptor: &Descriptor, first: u32, clouds: u32) -> Side {
        // Few values, so that some clouds are equally near.
        let values = |cloud: u32, bins: u32| -> Vec<f32> {
            (0..bins).map(|bin| ((cloud * 7 + bin * bin * (1 + cloud % 5)) % 4) as f32 / 4.0).collect()
        };
        let lengths: &[[u32; 2]] = match descriptor {
            Descriptor::DiskRing(_) => &[[60, 60], [128, 128]],
            _ => &[[50, 0], [40, 40]],
        };
        let signature = |cloud: u32, &[bins, deviations]: &[u32; 2]| Signature {
            centroid: values(cloud, bins),
            deviation: values(cloud + 1, deviations),
        };
        let clouds = first..first + clouds;
        Side {
            signatures: clouds
                .clone()
                .map(|cloud| lengths.iter().map(|lengths| signature(cloud, lengths)).collect())
                .collect(),
            labels: clouds.clone().map(|cloud| Label { category: 0, instance: cloud % 13 }).collect(),
            paths: clouds.map(|cloud| cloud.to_string()).collect(),
            skipped: 0,
        }
    }

    #[test]
    fn what_is_pruned_is_what_is_matched_in_full() {
        let structure: StructureFile = toml::from_str(
            "version = 1\n[[channel]]\npairs = \"cloud\"\nfeatures = [\"d 50\"]\nradius_cm = 5\n[[channel]]\npairs = \"neighbours\"\nfeatures = [\"f1 40\"]\nradius_cm = 5\nmetric = \"hellinger\"\n",
        )
        .unwrap();
        for descriptor in [
            Descriptor::default_of(Family::DiskRing),
            Descriptor::DiskRing(Parameters { shape_weight_ppm: 1_000_000, ..Parameters::PAPER_BEST }),
            Descriptor::Structure(structure.structure().unwrap()),
        ] {
            let clouds = DescribedClouds {
                pool: rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap(),
                query: side(&descriptor, 100, 30),
                database: side(&descriptor, 0, 75),
                descriptor,
                skipped: Vec::new(),
                keypoints: 0,
                scaled_by: Some(50),
                seconds: Seconds::default(),
            };
            for distance in SetDistance::ALL {
                let matches = |most| clouds.matched_by(distance, most).unwrap().matches;
                assert_eq!(matches(0), matches(usize::MAX));
            }
        }
    }
}
