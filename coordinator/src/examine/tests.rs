//! What is explained is what was measured.

use std::path::Path;

use descriptor::Descriptor;
use descriptor::structure::Structure;
use tempfile::TempDir;

use super::*;
use crate::dataset::{Dataset, Wanted};
use crate::evaluate::{DescribedClouds, Request};
use crate::experiment::Overrides;
use crate::run::clouds::keep;

/// An experiment on clouds that it makes, with their list in a run folder.
fn run(folder: &Path) -> (Experiment, Dataset) {
    let file = folder.join("small.toml");
    let toml = "version = 1\nseed = 1\n[dataset]\nroot = \"clouds\"\nlayout = \"uw\"\nsplits = { seeded = { seed = 1, train1 = 0.25, train2 = 0.25, validation = 0.25, test = 0.25 } }\n[dataset.synthetic]\nseed = 1\nobjects = 6\nviews = 8\n";
    std::fs::write(&file, toml).unwrap();
    let experiment = Experiment::read(&file, Overrides::default()).unwrap();
    let dataset = crate::run::open_data(&experiment, Wanted::All, None, |_| {}).unwrap();
    keep(folder, &dataset).unwrap();
    (experiment, dataset)
}

/// Queries of the test against everything else, as the program matches them.
fn matches(
    descriptor: &Descriptor,
    experiment: &Experiment,
    dataset: &Dataset,
) -> Vec<(String, String, f64)> {
    let request = Request {
        listing: crate::compare::test_listing(dataset),
        preprocess: *experiment.preprocess(),
        descriptor: descriptor.clone(),
        threads: 2,
        scaled_by: Some(dataset.splits.trained()),
    };
    let report = DescribedClouds::new(&request, &|| ()).unwrap().report(SetDistance::ChiSquared).unwrap();
    report
        .matches
        .into_iter()
        .map(|(query, nearest, found)| (query, nearest, found.nearest.distance))
        .collect()
}

#[test]
fn distances_are_those_that_the_run_has_measured_and_the_channels_add_up_to_them() {
    let folder = TempDir::new().unwrap();
    let (experiment, dataset) = run(folder.path());
    let examiner = Examiner::new(folder.path(), &experiment).unwrap();
    for descriptor in [
        Descriptor::default_of(descriptor::Family::DiskRing),
        Descriptor::Structure(Structure::default()),
        Descriptor::default_of(descriptor::Family::GlobalHue),
    ] {
        let matches = matches(&descriptor, &experiment, &dataset);
        assert!(matches.len() > 5);
        for (query, nearest, distance) in &matches {
            let explained = examiner.explain(&descriptor, query, nearest).unwrap();
            assert_eq!(explained.answer_distance.to_bits(), distance.to_bits(), "{descriptor}: {query}");
            let parts: f64 = explained.channels.iter().map(|channel| channel.answer_distance).sum();
            assert_eq!(parts.to_bits(), distance.to_bits());
            for ChannelShare { layout, query_values, answer_values, .. } in &explained.channels {
                let values: u32 = layout.parts.iter().map(|part| part.bins.iter().product::<u32>()).sum();
                assert_eq!(
                    [query_values.len(), answer_values.len()],
                    [values as usize; 2],
                    "{}",
                    layout.name
                );
            }
            let own = |path: &str| {
                let CloudRecord { category, instance, .. } = examiner.record(path).unwrap();
                (category.clone(), instance.clone())
            };
            // The nearest of all clouds, if it is of the right object, is the right cloud.
            let right = explained.right.unwrap();
            assert_eq!(own(&right), own(query));
            let margin = explained.margin.unwrap();
            assert!(margin >= 0.0, "{query}: nothing is nearer than the nearest");
            assert_eq!(own(nearest) == own(query), right == *nearest);
        }
    }
}

#[test]
fn clouds_that_are_unknown_gone_or_changed_are_refused() {
    let folder = TempDir::new().unwrap();
    assert!(matches!(
        Examiner::new(folder.path(), &run(TempDir::new().unwrap().path()).0),
        Err(ExamineError::NotListed { .. })
    ));
    let (experiment, dataset) = run(folder.path());
    let examiner = Examiner::new(folder.path(), &experiment).unwrap();
    let path = dataset.clouds.entries[0].path.clone();
    assert!(!examiner.cloud(&path).unwrap().points.is_empty());
    for unknown in ["", "nothing.pcd", "../small.toml", "/etc/passwd"] {
        assert!(matches!(examiner.cloud(unknown), Err(ExamineError::UnknownCloud { .. })), "{unknown}");
    }
    let file = folder.path().join("clouds").join(&path);
    let mut bytes = std::fs::read(&file).unwrap();
    *bytes.last_mut().unwrap() ^= 1;
    std::fs::write(&file, bytes).unwrap();
    let changed = examiner.cloud(&path).unwrap_err().to_string();
    assert!(changed.contains("is another one than when the run has seen it"), "{changed}");
    std::fs::remove_file(&file).unwrap();
    let gone = examiner.cloud(&path).unwrap_err().to_string();
    assert!(gone.contains("cannot be read"), "{gone}");
}
