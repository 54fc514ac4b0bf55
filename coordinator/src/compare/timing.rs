//! How long a descriptor takes: all test queries and their database, from files to matches, on one thread of this
//! process.

use descriptor::{Describer, Descriptor, Preprocess, SetDistance};
use results::{PredictionRow, Times};

use super::error::CompareError;
use crate::dataset::{CloudEntry, Dataset, ListedCloud, Listing};
use crate::evaluate::{DescribedClouds, EvaluateError, Report, Request, describe_file};
use crate::run::Matching;

/// Clouds that [`seconds_of_a_cloud`] describes at most.
const SAMPLE: usize = 16;

/// Times and, so that they can be compared with those of workers, answers.
pub struct Timed {
    /// Seconds of each stage.
    pub times: Times,
    /// Mean number of keypoints that are described.
    pub keypoints_per_cloud: f64,
    /// Path of each query that could be described, in their order, path of its nearest cloud and distance.
    nearest: Vec<(String, String, f64)>,
}

/// Measures one descriptor under each of these set distances: the stages before matching once for all of them. `watch`
/// is called after each cloud.
///
/// # Errors
/// As [`DescribedClouds::new`] and [`DescribedClouds::report`].
pub fn time(
    dataset: &Dataset,
    preprocess: &Preprocess,
    descriptor: &Descriptor,
    distances: &[SetDistance],
    watch: &(dyn Fn() + Sync),
) -> Result<Vec<Timed>, EvaluateError> {
    let listing = listing(dataset);
    let clouds = listing.clouds.len();
    let request = Request {
        listing,
        preprocess: *preprocess,
        descriptor: descriptor.clone(),
        threads: 1,
        scaled_by: Some(dataset.splits.trained()),
    };
    let described = DescribedClouds::new(&request, watch)?;
    distances.iter().map(|&distance| Ok(Timed::new(described.report(distance)?, clouds))).collect()
}

/// Seconds from a cloud's points to its signatures on this thread: the median, of two the upper, of up to [`SAMPLE`] test clouds, which
/// lie apart in their list. `None` if none of them can be read and described.
pub fn seconds_of_a_cloud(
    dataset: &Dataset,
    preprocess: &Preprocess,
    descriptor: &Descriptor,
) -> Option<f64> {
    let describer = Describer::new(descriptor).ok()?;
    let queries = Matching::Test.query_clouds(dataset);
    let sample = queries.iter().step_by(queries.len().div_ceil(SAMPLE).max(1));
    let one = |&index: &u32| {
        let cloud = &dataset.clouds.entries[index as usize];
        let file = dataset.clouds.file(cloud);
        let (described, seconds) = describe_file(&cloud.path, &file, preprocess, &describer).ok()?;
        described.ok()?;
        Some((seconds.keypoints + seconds.normals + seconds.describe).as_secs_f64())
    };
    let mut seconds: Vec<f64> = sample.filter_map(one).collect();
    seconds.sort_by(f64::total_cmp);
    seconds.get(seconds.len() / 2).copied()
}

impl Timed {
    fn new(report: Report, clouds: usize) -> Self {
        let seconds = report.seconds;
        let described = clouds - report.skipped.len();
        Self {
            times: Times {
                read: seconds.read.as_secs_f64(),
                keypoints: seconds.keypoints.as_secs_f64(),
                normals: seconds.normals.as_secs_f64(),
                describe: seconds.describe.as_secs_f64(),
                matching: seconds.matching.as_secs_f64(),
                total: seconds.total.as_secs_f64(),
                hardware: hardware(),
            },
            keypoints_per_cloud: report.keypoints as f64 / described.max(1) as f64,
            nearest: report
                .matches
                .into_iter()
                .map(|(query, nearest, found)| (query, nearest, found.nearest.distance))
                .collect(),
        }
    }

    /// Refuses answers of workers to the candidate with this label that this process does not find as well.
    ///
    /// # Errors
    /// [`CompareError::Contradiction`].
    pub fn confirm(&self, label: &str, answers: &[PredictionRow]) -> Result<(), CompareError> {
        let told = answers.iter().map(|row| (&row.cloud, &row.nearest_cloud, row.distance.to_bits()));
        let found =
            self.nearest.iter().map(|(query, nearest, distance)| (query, nearest, distance.to_bits()));
        let differs = told.clone().zip(found.clone()).find(|(told, found)| told != found);
        if differs.is_none() && told.len() == found.len() {
            return Ok(());
        }
        let said = |answer: (&String, &String, u64)| {
            format!("{} for {} at {}", answer.1, answer.0, f64::from_bits(answer.2))
        };
        let (then, now) = match differs {
            Some((told, found)) => (said(told), said(found)),
            None => (format!("{} answers", told.len()), format!("{} answers", found.len())),
        };
        Err(CompareError::Contradiction {
            label: label.to_owned(),
            what: "what this process finds",
            then,
            now,
        })
    }
}

/// The usable clouds of the final test.
pub fn listing(dataset: &Dataset) -> Listing {
    let listed = |cloud: &CloudEntry| ListedCloud {
        path: cloud.path.clone(),
        file: dataset.clouds.file(cloud),
        category: cloud.category,
        instance: cloud.instance,
    };
    Listing {
        clouds: Matching::Test.queries(dataset).chain(Matching::Test.database(dataset)).map(listed).collect(),
        queries: Matching::Test.query_clouds(dataset).len(),
        categories: dataset.clouds.categories.clone(),
        instances: dataset.clouds.instances.clone(),
    }
}

/// The processor by its own name, where the system tells it.
fn hardware() -> String {
    let told = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = told.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    name.map_or_else(|| std::env::consts::ARCH.to_owned(), |(_, name)| name.trim().to_owned())
}
