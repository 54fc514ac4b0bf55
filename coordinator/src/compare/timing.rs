//! How long a descriptor takes: all test queries and their database, from files to matches, on one thread of this
//! process.

use descriptor::Preprocess;
use results::Times;

use super::candidate::Candidate;
use crate::dataset::{Dataset, ListedCloud, Listing};
use crate::evaluate::{EvaluateError, Request, evaluate};
use crate::run::Matching;

/// Times and, so that they can be compared with those of workers, answers.
pub struct Timed {
    /// Seconds of each stage.
    pub times: Times,
    /// Mean number of keypoints that are described.
    pub keypoints_per_cloud: f64,
    /// Path of each query that could be described, in their order, path of its nearest cloud and distance.
    pub nearest: Vec<(String, String, f64)>,
}

/// Measures one candidate.
///
/// # Errors
/// As [`evaluate`].
pub fn time(
    dataset: &Dataset,
    preprocess: &Preprocess,
    candidate: &Candidate,
) -> Result<Timed, EvaluateError> {
    let listing = listing(dataset);
    let clouds = listing.clouds.len();
    let request = Request {
        listing,
        preprocess: *preprocess,
        descriptor: candidate.descriptor.clone(),
        distance: candidate.distance,
        threads: 1,
    };
    let report = evaluate(&request)?;
    let seconds = report.seconds;
    let described = clouds - report.skipped.len();
    Ok(Timed {
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
    })
}

/// The usable clouds of the final test.
fn listing(dataset: &Dataset) -> Listing {
    let (queries, database) = (Matching::Test.query_clouds(dataset), Matching::Test.database_clouds(dataset));
    let listed = |&index: &u32| {
        let cloud = &dataset.clouds.entries[index as usize];
        ListedCloud {
            path: cloud.path.clone(),
            file: dataset.clouds.file(cloud),
            category: cloud.category,
            instance: cloud.instance,
        }
    };
    Listing {
        clouds: queries.iter().chain(&database).map(listed).collect(),
        queries: queries.len(),
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
