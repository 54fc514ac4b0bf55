//! Looks at the test set and comparisons: what is written is read, what is removed, and what follows from what.

use std::array::from_fn;

use tempfile::tempdir;

use super::fixture;
use crate::*;

const fn distance(query: u32, database: u32, distance: f32) -> DistanceRow {
    DistanceRow { query, database, distance }
}

pub const DISTANCES: [DistanceRow; 4] =
    [distance(0, 0, 0.5), distance(0, 1, 0.25), distance(2, 0, 1.0), distance(2, 1, 2.0)];

/// Distances 0.5 (same object), 0.5 (another), 0.75 (same), 1 (another), 1.5 (same): two points at least share one.
pub fn curves() -> [Curve; 2] {
    let point = |distance, accepted, relevant| CurvePoint { distance, accepted, relevant };
    let all = vec![point(0.5, 2, 1), point(0.75, 3, 2), point(1.0, 4, 2), point(1.5, 5, 3)];
    [
        Curve { name: "all", relevant: 3, points: all },
        Curve { name: "nearest", relevant: 3, points: vec![point(0.5, 3, 2)] },
    ]
}

pub fn pairs() -> [PairRow; 1] {
    [PairRow {
        level: "object".to_owned(),
        descriptor_a: "evolved".to_owned(),
        descriptor_b: "paper".to_owned(),
        both_right: 10,
        only_a: 4,
        only_b: 1,
        both_wrong: 5,
        difference_low: -0.3,
        difference_high: 0.05,
        p_value: 0.375,
        p_adjusted: 0.375,
    }]
}

pub fn rows() -> [ComparedRow; 2] {
    let times = Times {
        read: 0.5,
        keypoints: 0.25,
        normals: 1.0,
        describe: 2.0,
        matching: 0.125,
        total: 4.0,
        hardware: "a processor".to_owned(),
    };
    from_fn(|index| ComparedRow {
        descriptor: ["evolved", "paper"][index].to_owned(),
        kind: "disk-ring".to_owned(),
        distance: "chi2".to_owned(),
        parameters: "m=8".to_owned(),
        size: (index == 0).then_some(248),
        recogniser: Some(["nearest", "projection"][index].to_owned()),
        cloud_size: Some([496, 47][index]),
        settings: (index == 1).then(|| "100 components".to_owned()),
        database_error: (index == 1).then_some(0.125),
        note: (index == 1).then(|| "of the paper".to_owned()),
        counts: fixture::TEST,
        object_wilson: [0.1, 0.6],
        category_wilson: [0.0, 0.5],
        object_bootstrap: [0.0, 0.7],
        category_bootstrap: [0.0, 0.6],
        skipped: index as u32,
        database: 40,
        keypoints_per_cloud: (index == 0).then_some(31.5),
        cloud_seconds: (index == 1).then_some(0.002),
        times: (index == 0).then(|| times.clone()),
        area: Some(0.75),
        nearest_area: None,
        bytes: (index == 1).then(|| "0101".to_owned()),
        file_digest: (index == 0).then(|| "abcd".to_owned()),
    })
}

pub fn perturbed() -> [PerturbedRow; 2] {
    from_fn(|index| PerturbedRow {
        descriptor: "evolved".to_owned(),
        kind: "noise".to_owned(),
        strength: 0.5 * index as f64,
        unit: "mm".to_owned(),
        counts: fixture::TEST,
        unusable: index as u32,
        object_wilson: [0.1, 0.6],
        category_wilson: [0.0, 0.5],
        object_bootstrap: [0.0, 0.7],
        category_bootstrap: [0.0, 0.6],
    })
}

/// The definition: the mean, over all relevant pairs, of the precision at the threshold that lets the pair in.
#[test]
fn the_area_is_the_mean_precision_at_each_relevant_pair() {
    let [all, nearest] = curves();
    assert!((all.area().unwrap() - (1.0 / 2.0 + 2.0 / 3.0 + 3.0 / 5.0) / 3.0).abs() < 1e-15);
    // Relevant clouds that are never accepted add nothing.
    assert!((nearest.area().unwrap() - 2.0 * (2.0 / 3.0) / 3.0).abs() < 1e-15);
    assert_eq!(Curve { relevant: 0, ..nearest }.area(), None);
}

#[test]
fn differences_and_odds_are_those_of_the_errors() {
    let [pair] = pairs();
    // Of 20, the first recognises 14 and the second 11.
    assert!((pair.error_difference() - (6.0 / 20.0 - 9.0 / 20.0)).abs() < 1e-15);
    assert_eq!((pair.queries(), pair.odds_ratio()), (20, Some(4.0)));
    assert_eq!(PairRow { both_right: 1, only_a: 3, only_b: 0, both_wrong: 0, ..pair }.odds_ratio(), None);
}

#[test]
fn looks_are_numbered_and_outlive_the_run() {
    let folder = tempdir().unwrap();
    fixture::write(folder.path());
    let mut out = RunFolder::create(folder.path(), &fixture::genes()).unwrap();
    let second = LookRow { command: "compare".to_owned(), ..fixture::look() };
    out.record_look(&second).unwrap();
    let looks = || read_table(folder.path(), TableName::Looks).unwrap();
    let commands =
        looks().column("command").unwrap().str().unwrap().iter().flatten().collect::<Vec<_>>().join(" ");
    assert_eq!(commands, "run compare");
    out.discard().unwrap();
    assert!(!out.is_finished());
    assert_eq!(looks().height(), 2);
}

#[test]
fn a_comparison_is_whole_or_not_there_and_leaves_the_run_as_it_is() {
    let folder = tempdir().unwrap();
    let digest = fixture::write(folder.path());
    let out = RunFolder::create(folder.path(), &fixture::genes()).unwrap();
    let height = |table| read_table(folder.path(), table).map(|frame| frame.height());
    assert!(matches!(height(TableName::Comparison), Err(Error::NoFiles { .. } | Error::Io { .. })));
    for round in 0..2 {
        out.begin_comparison().unwrap();
        for label in ["evolved", "pfhrgb-l1"] {
            let answers = fixture::predictions(PredictionSplit::Test);
            out.write_compared(label, &answers, &curves(), &DISTANCES).unwrap();
        }
        out.write_comparison(&rows(), &pairs()).unwrap();
        let heights = TableName::COMPARISON.map(|table| height(table).unwrap());
        assert_eq!(heights, [8, 6, 10, 1, 2], "round {round}");
    }
    let distances = read_table(folder.path(), TableName::Distances).unwrap();
    let number = |column: &str| -> Vec<u32> {
        distances.column(column).unwrap().u32().unwrap().iter().flatten().collect()
    };
    assert_eq!(number("query")[..4], [0, 0, 2, 2]);
    assert_eq!(number("database")[..4], [0, 1, 0, 1]);
    assert!(verify(folder.path()).unwrap().problems.is_empty());
    assert_eq!(read_run(folder.path()).unwrap().run_digest, digest);

    // It stays while others are added, until they are whole.
    assert_eq!(read_comparison(folder.path()).unwrap(), rows());
    out.write_compared("abandoned", &[], &[], &DISTANCES).unwrap();
    out.extend_comparison(&["evolved", "pfhrgb-l1"]).unwrap();
    assert_eq!(TableName::COMPARISON.map(|table| height(table).unwrap()), [8, 6, 10, 1, 2]);
    assert_eq!(read_comparison(folder.path()).unwrap(), rows());

    // Perturbed clouds are of the comparison: they stay as long as it does.
    assert_eq!(read_perturbed(folder.path()).unwrap(), []);
    out.write_perturbed(&perturbed()).unwrap();
    out.extend_comparison(&["evolved"]).unwrap();
    assert_eq!(read_perturbed(folder.path()).unwrap(), perturbed());

    // Another one that does not come to its end.
    out.begin_comparison().unwrap();
    assert_eq!(read_perturbed(folder.path()).unwrap(), []);
    out.write_compared("evolved", &[], &[], &[]).unwrap();
    assert!(height(TableName::Comparison).is_err());
    assert_eq!(read_comparison(folder.path()).unwrap(), []);
    // Not a number.
    out.write_compared("evolved", &[], &[], &[distance(0, 0, f32::NAN)]).unwrap_err();
}

#[test]
fn only_times_of_one_kind_and_one_processor_are_divided() {
    let measured = |hardware: &str, describe: f64, cloud_seconds: Option<f64>| {
        let [row, _] = rows();
        let times = row.times.clone().map(|times| Times { hardware: hardware.to_owned(), describe, ..times });
        ComparedRow { times, cloud_seconds, ..row }
    };
    // 1.25 s of keypoints and normals, of as many clouds.
    let [own, other] = [measured("a", 3.75, Some(1.0)), measured("a", 1.25, Some(4.0))];
    assert_eq!((own.mean_time_beside(&other), own.time_beside(&other)), (Some(2.0), Some(2.0)));
    let elsewhere = measured("b", 1.25, Some(4.0));
    assert_eq!((own.mean_time_beside(&elsewhere), own.time_beside(&elsewhere)), (None, Some(0.25)));
    // A mean is not set against a median.
    let unmeasured = ComparedRow { times: None, ..measured("a", 1.0, Some(4.0)) };
    let mean_only = measured("a", 1.0, None);
    assert_eq!((own.mean_time_beside(&unmeasured), own.time_beside(&unmeasured)), (None, Some(0.25)));
    assert_eq!((mean_only.time_beside(&unmeasured), unmeasured.time_beside(&mean_only)), (None, None));
    // What is told of each is of one kind, too, where the end of the run has measured all.
    assert_eq!(own.milliseconds_of_a_cloud(), Some(1000.0));
    assert!(mean_only.milliseconds_of_a_cloud().is_some_and(|mean| mean > 0.0));
}
