//! Tasks, results and failures come back from their messages as they were; names, checks and bounds.

mod compressed;
mod golden;
mod rule;

use std::collections::BTreeSet;

use proptest::prelude::*;

use super::*;
use crate::{Lease, LeaseNonce, MAX_TEXT_BYTES};

fn digest() -> impl Strategy<Value = Digest> {
    any::<[u8; 32]>().prop_map(Digest)
}

fn digests(most: usize) -> impl Strategy<Value = Vec<Digest>> {
    prop::collection::vec(digest(), 0..=most)
}

fn subject() -> impl Strategy<Value = Subject> {
    let bytes = || prop::collection::vec(any::<u8>(), 0..300);
    (bytes(), bytes(), ".{0,60}", any::<[u64; 3]>()).prop_map(|(preparation, descriptor, label, numbers)| {
        let [description_bytes, cloud_cost, pair_cost] = numbers;
        Subject {
            preparation: preparation.into(),
            descriptor: descriptor.into(),
            facts: Facts { label, description_bytes, cloud_cost, pair_cost },
        }
    })
}

fn rule() -> impl Strategy<Value = MatchingRule> {
    let exclude = vec![Exclusion::None, Exclusion::SameCloud, Exclusion::SameSequence];
    let objective = vec![Objective::Object, Objective::Category];
    let parts = (prop::sample::select(exclude), prop::sample::select(objective), any::<bool>());
    parts.prop_map(|(exclude, objective, margin)| MatchingRule { exclude, objective, margin })
}

fn described() -> impl Strategy<Value = Vec<DescribedSplit>> {
    let shard =
        (digest(), digest()).prop_map(|(manifest, description)| DescribedShard { manifest, description });
    let split = (any::<u32>(), digest(), prop::collection::vec(shard, 0..4));
    let split = split.prop_map(|(channel, split, shards)| DescribedSplit { channel, split, shards });
    prop::collection::vec(split, 0..3)
}

fn evaluation() -> impl Strategy<Value = Evaluation> {
    let asked = (any::<[u32; 2]>(), any::<bool>(), rule(), prop::collection::vec(1e-9f64..1e9, 0..4));
    (subject(), digests(3), digests(3), asked, described()).prop_map(
        |(subject, query, database, (clouds, want_matches, rule, scales), described)| Evaluation {
            subject,
            query,
            database,
            queries: clouds[0],
            database_clouds: clouds[1],
            want_matches,
            rule,
            scales,
            described,
        },
    )
}

fn task() -> impl Strategy<Value = Task> {
    let cell = (evaluation(), 0..=crate::MAX_CELL as u32).prop_map(|(evaluation, descriptors)| {
        let Evaluation { subject, query, database, queries, database_clouds, .. } = evaluation;
        GridCell { subject, query, database, queries, database_clouds, descriptors }
    });
    let shard = (subject(), digest(), any::<u32>());
    let tile = evaluation().prop_flat_map(|evaluation| {
        let [query, database] = [evaluation.query.len(), evaluation.database.len()];
        let of = |count| prop::collection::vec(digest(), count);
        (Just(evaluation), of(query), of(database))
    });
    let scale = (subject(), digests(3), any::<u32>(), described());
    prop_oneof![
        evaluation().prop_map(Task::Evaluation),
        scale.prop_map(|(subject, splits, clouds, described)| {
            Task::Scale(Scale { subject, splits, clouds, described })
        }),
        cell.prop_map(Task::GridCell),
        shard.prop_map(|(subject, manifest, clouds)| {
            Task::Description(Description { subject, manifest, clouds })
        }),
        tile.prop_map(|(evaluation, query_descriptions, database_descriptions)| {
            Task::Tile(Tile { evaluation, query_descriptions, database_descriptions })
        }),
    ]
}

fn found() -> impl Strategy<Value = Match> {
    let distance = || 0.0..1e9;
    let runner_up = prop::option::of((any::<u32>(), distance()));
    (any::<u32>(), distance(), runner_up).prop_map(|(nearest, distance, runner_up)| Match {
        nearest,
        distance,
        runner_up,
    })
}

fn nearest() -> impl Strategy<Value = Nearest> {
    let neighbour = || prop::option::of((any::<u32>(), 0.0..1e9));
    (neighbour(), neighbour()).prop_map(|(same, other)| Nearest { same, other })
}

fn evaluation_result() -> impl Strategy<Value = EvaluationResult> {
    let lists = (prop::collection::vec(found(), 0..5), prop::collection::vec(nearest(), 0..5));
    (any::<[u32; 3]>(), lists, prop::option::of(-1e9f64..1e9)).prop_map(
        |([queries, object_correct, category_correct], (matches, nearest), margin)| EvaluationResult {
            queries,
            object_correct,
            category_correct,
            matches,
            nearest,
            margin,
        },
    )
}

fn result() -> impl Strategy<Value = TaskResult> {
    prop_oneof![
        evaluation_result().prop_map(TaskResult::Evaluation),
        (0.0f64..1e9).prop_map(TaskResult::Scale),
        prop::collection::vec(any::<u32>(), 0..9).prop_map(TaskResult::GridCell),
        prop::collection::vec(any::<u8>(), 0..99)
            .prop_map(|bytes| TaskResult::Description(Described::new(bytes))),
    ]
}

fn failure() -> impl Strategy<Value = Failure> {
    use FailureReason::*;
    let reasons = [Other, Data, Panic, InvalidJob, Cloud, Description, InvalidResult, Overdue, Lost];
    (prop::sample::select(reasons.to_vec()), ".{0,40}")
        .prop_map(|(reason, message)| Failure::new(reason, message))
}

fn cloud() -> impl Strategy<Value = CloudEntry> {
    (digest(), any::<u64>(), any::<[u32; 2]>(), ".{0,9}", any::<Option<u32>>()).prop_map(
        |(digest, bytes, [category, instance], path, sequence)| CloudEntry {
            digest,
            bytes,
            label: Label { category, instance },
            path,
            sequence,
        },
    )
}

proptest! {
    #[test]
    fn a_task_comes_back_from_its_message(task in task()) {
        let bytes = v2::Task::from(&task).encode_to_vec();
        let back = Task::try_from(v2::Task::decode(&bytes[..]).unwrap()).unwrap();
        prop_assert_eq!(back.job(0), task.job(0));
        prop_assert_eq!(back, task);
    }

    #[test]
    fn a_report_comes_back_from_its_message(
        outcome in prop_oneof![result().prop_map(Ok), failure().prop_map(Err)],
        (job, attempt, run_seconds) in (any::<u64>(), any::<u32>(), 0.0..1e9),
    ) {
        let report = Report { lease: Lease { job: JobId(job), attempt, nonce: LeaseNonce([5; 16]) }, run_seconds, outcome };
        let bytes = v2::JobReport::from(report.clone()).encode_to_vec();
        prop_assert_eq!(bytes.len(), report.encoded_len());
        let back = Report::try_from(v2::JobReport::decode(&bytes[..]).unwrap()).unwrap();
        prop_assert_eq!(back, report);
    }

    #[test]
    fn equal_fingerprints_are_equal_results(one in result(), other in result()) {
        prop_assert_eq!(one.fingerprint() == other.fingerprint(), one == other);
    }

    #[test]
    fn a_manifest_comes_back_from_its_bytes(
        split in ".{0,9}",
        clouds in prop::collection::vec(cloud(), 0..5),
    ) {
        let manifest = SplitManifest { split, clouds };
        prop_assert_eq!(SplitManifest::decode(&manifest.clone().encode()).unwrap(), manifest);
    }

    #[test]
    fn arbitrary_bytes_are_refused_or_make_sense(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        if let Ok(message) = v2::Task::decode(&bytes[..]) && let Ok(task) = Task::try_from(message) {
            prop_assert_eq!(Task::try_from(v2::Task::from(&task)).unwrap(), task);
        }
        if let Ok(message) = v2::JobReport::decode(&bytes[..]) {
            let _ = Report::try_from(message);
        }
        let _ = SplitManifest::decode(&bytes);
    }
}

fn base() -> Evaluation {
    Evaluation {
        query: vec![Digest([1; 32])],
        database: vec![Digest([2; 32])],
        ..Evaluation::sample(1, 2, 3)
    }
}

/// Two splits in two channels, of which one has two shards; `number` is in the descriptions.
fn described_by(number: u8) -> Vec<DescribedSplit> {
    let shard = |shard: u8| DescribedShard {
        manifest: Digest([shard; 32]),
        description: Digest([16 * number + shard; 32]),
    };
    vec![
        DescribedSplit { channel: 0, split: Digest([1; 32]), shards: vec![shard(1)] },
        DescribedSplit { channel: 2, split: Digest([2; 32]), shards: vec![shard(2), shard(3)] },
    ]
}

fn cell_of(evaluation: Evaluation, descriptors: u32) -> GridCell {
    let Evaluation { subject, query, database, queries, database_clouds, .. } = evaluation;
    GridCell { subject, query, database, queries, database_clouds, descriptors }
}

#[test]
fn a_job_is_named_by_all_that_is_asked_and_by_how_often() {
    let base = base();
    let other = Subject::sample(2);
    let prepared = Subject { preparation: vec![2].into(), ..base.subject.clone() };
    let shard = Description { subject: base.subject.clone(), manifest: Digest([1; 32]), clouds: 2 };
    let cell = cell_of(base.clone(), 3);
    let tile = Tile {
        evaluation: base.clone(),
        query_descriptions: vec![Digest([3; 32])],
        database_descriptions: vec![Digest([4; 32])],
    };
    let by = |change: fn(&mut MatchingRule)| {
        let mut rule = MatchingRule::default();
        change(&mut rule);
        rule
    };
    let splits = base.database.clone();
    let scale = Scale { subject: base.subject.clone(), splits, clouds: 3, described: vec![] };
    let names = [
        Task::Description(shard.clone()).job(0),
        Task::Description(Description { subject: other.clone(), ..shard.clone() }).job(0),
        Task::Description(Description { subject: prepared.clone(), ..shard.clone() }).job(0),
        Task::Description(Description { manifest: Digest([2; 32]), ..shard.clone() }).job(0),
        Task::Tile(tile.clone()).job(0),
        // A description that was corrected makes another tile.
        Task::Tile(Tile { query_descriptions: vec![Digest([5; 32])], ..tile.clone() }).job(0),
        Task::Tile(Tile { database_descriptions: vec![Digest([5; 32])], ..tile }).job(0),
        Task::Evaluation(base.clone()).job(0),
        Task::Evaluation(base.clone()).job(1),
        Task::Evaluation(Evaluation { subject: other.clone(), ..base.clone() }).job(0),
        Task::Evaluation(Evaluation { subject: prepared, ..base.clone() }).job(0),
        Task::Evaluation(Evaluation { want_matches: true, ..base.clone() }).job(0),
        Task::Evaluation(Evaluation { query: base.database.clone(), ..base.clone() }).job(0),
        Task::Evaluation(Evaluation {
            query: vec![base.query[0], base.database[0]],
            database: vec![],
            ..base.clone()
        })
        .job(0),
        Task::Evaluation(Evaluation { rule: by(|rule| rule.exclude = Exclusion::SameCloud), ..base.clone() })
            .job(0),
        Task::Evaluation(Evaluation {
            rule: by(|rule| rule.exclude = Exclusion::SameSequence),
            ..base.clone()
        })
        .job(0),
        Task::Evaluation(Evaluation {
            rule: by(|rule| rule.objective = Objective::Category),
            ..base.clone()
        })
        .job(0),
        Task::Evaluation(Evaluation { rule: by(|rule| rule.margin = true), ..base.clone() }).job(0),
        Task::Evaluation(Evaluation { scales: vec![1.0], ..base.clone() }).job(0),
        Task::Evaluation(Evaluation { scales: vec![1.0, 0.5], ..base.clone() }).job(0),
        Task::Scale(scale.clone()).job(0),
        Task::Scale(Scale { subject: other.clone(), ..scale.clone() }).job(0),
        Task::Scale(Scale { splits: vec![Digest([1; 32])], ..scale.clone() }).job(0),
        // So does one that an evaluation or a scale rests on.
        Task::Evaluation(Evaluation { described: described_by(3), ..base.clone() }).job(0),
        Task::Evaluation(Evaluation { described: described_by(4), ..base.clone() }).job(0),
        Task::Scale(Scale { described: described_by(3), ..scale.clone() }).job(0),
        Task::Scale(Scale { described: described_by(4), ..scale.clone() }).job(0),
        Task::GridCell(cell.clone()).job(0),
        Task::GridCell(GridCell { subject: other, ..cell }).job(0),
    ];
    let different: BTreeSet<JobId> = names.into();
    assert_eq!(different.len(), names.len());
    assert_eq!(names[7], Task::Evaluation(base.clone()).job(0));

    // What follows from what is asked is no part of the name.
    let mut unknown = base.clone();
    unknown.subject.facts = Facts::default();
    assert_eq!(names[7], Task::Evaluation(Evaluation { queries: 9, ..unknown }).job(0));
    assert_eq!(names[0], Task::Description(Description { clouds: 9, ..shard }).job(0));
    assert_eq!(Task::Scale(scale.clone()).job(0), Task::Scale(Scale { clouds: 9, ..scale }).job(0));
}

/// A run that was begun by one release of this protocol version goes on with the next: names must not change.
#[test]
fn the_name_of_a_job_stays() {
    assert_eq!(Task::Evaluation(base()).job(0), JobId(4_095_681_622_144_340_983));
}

#[test]
fn a_task_names_all_descriptions_that_it_rests_on() {
    let named = |task: Task| task.descriptions().map(|Digest(bytes)| bytes[0]).collect::<Vec<_>>();
    let evaluation = Evaluation { described: described_by(4), ..base() };
    let Evaluation { subject, database: splits, described, .. } = evaluation.clone();
    assert_eq!(named(Task::Evaluation(evaluation)), [0x41, 0x42, 0x43]);
    assert_eq!(named(Task::Scale(Scale { subject, splits, clouds: 3, described })), [0x41, 0x42, 0x43]);
    assert_eq!(named(Task::Evaluation(base())), []);
    let [query_descriptions, database_descriptions] = [5, 6].map(|number| vec![Digest([number; 32])]);
    assert_eq!(
        named(Task::Tile(Tile { evaluation: base(), query_descriptions, database_descriptions })),
        [5, 6]
    );
}

#[test]
fn signatures_of_a_split_are_known_by_all_descriptions_of_its_shards_in_order() {
    let [one, several] = described_by(4).try_into().unwrap();
    assert_eq!(one.name(), one.shards[0].description);
    let mut others = [one.clone(), several.clone(), several.clone(), several.clone()];
    others[1].shards.reverse();
    others[2].shards[1].description = Digest([9; 32]);
    others[3].shards.pop();
    assert!(others.iter().all(|other| other.name() != several.name()));
}

#[test]
fn costs_are_counted_by_clouds_and_pairs() {
    let mut base = base();
    (base.subject.facts.cloud_cost, base.subject.facts.pair_cost) = (1000, 1);
    assert_eq!(Task::Evaluation(base.clone()).cost(), 5 * 1000 + 6);
    assert_eq!(Task::GridCell(cell_of(base.clone(), 3)).cost(), 5 * 1000 + 6);
    let shard = Description { subject: base.subject.clone(), manifest: Digest([1; 32]), clouds: 2 };
    assert_eq!(Task::Description(shard).cost(), 2 * 1000);
    let scale = Scale { subject: base.subject.clone(), splits: vec![], clouds: 5, described: vec![] };
    assert_eq!(Task::Scale(scale.clone()).cost(), 5 * 1000 + 12);
    assert_eq!(Task::Scale(Scale { described: described_by(3), ..scale }).cost(), 12);
    let mut dear = base;
    dear.subject.facts.pair_cost = 100;
    let tile = Tile { evaluation: dear.clone(), query_descriptions: vec![], database_descriptions: vec![] };
    assert_eq!(Task::Tile(tile).cost(), 6 * 100);
    dear.subject.facts.cloud_cost = u64::MAX;
    assert_eq!(Task::Evaluation(dear).cost(), u64::MAX);
}

#[test]
fn of_a_description_its_name_is_kept_and_two_are_equal_if_their_bytes_are() {
    let described = |bytes: &[u8]| TaskResult::Description(Described::new(bytes.to_vec()));
    let TaskResult::Description(kept) = described(b"bytes").kept().unwrap() else { panic!("another kind") };
    assert_eq!(kept, Described::named(Digest::of(b"bytes")));
    // A worker cannot answer by a name alone.
    let message = v2::TaskResult::from(TaskResult::Description(kept.clone()));
    assert_eq!(TaskResult::try_from(message), Err(InvalidMessage::Missing("result: what was asked")));
    assert_eq!(TaskResult::Description(kept).fingerprint(), described(b"bytes").fingerprint());
    assert_ne!(described(b"other").fingerprint(), described(b"bytes").fingerprint());
    assert_eq!(TaskResult::GridCell(vec![1]).kept(), None);
}

#[test]
fn a_task_takes_results_of_its_own_kind_and_size_only() {
    let evaluation = Task::Evaluation(Evaluation::sample(1, 2, 3));
    let cell = Task::GridCell(cell_of(Evaluation::sample(1, 2, 3), 3));
    let shard = Description { subject: Subject::sample(1), manifest: Digest([1; 32]), clouds: 3 };
    let shard = Task::Description(shard);
    let scale =
        Task::Scale(Scale { subject: Subject::sample(1), splits: vec![], clouds: 3, described: vec![] });
    let counts =
        EvaluationResult { queries: 2, object_correct: 1, category_correct: 2, ..Default::default() };
    let result = TaskResult::Evaluation(counts);
    assert_eq!(evaluation.check(&result), Ok(()));
    assert!([&cell, &shard, &scale].iter().all(|task| task.check(&result).is_err()));
    for (distance, good) in [
        (0.25, true),
        (f64::from(f32::MAX), true),
        (0.0, false),
        (-0.5, false),
        (f64::NAN, false),
        (f64::INFINITY, false),
        (1e-60, false),
        (1e60, false),
    ] {
        let result = TaskResult::Scale(distance);
        assert_eq!(scale.check(&result).is_ok(), good, "{distance}");
        assert!([&cell, &shard, &evaluation].iter().all(|task| task.check(&result).is_err()));
    }
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
    for (described, good) in [
        (Described::new(vec![0; 24]), true),
        (Described::named(Digest([2; 32])), true),
        (Described::new(vec![0; 20]), false),
        (Described::new(vec![]), false),
    ] {
        assert_eq!(shard.check(&TaskResult::Description(described)).is_ok(), good);
    }
}

#[test]
fn impossible_results_are_refused() {
    let asked = Evaluation { want_matches: true, ..Evaluation::sample(1, 2, 3) };
    let task = Task::Evaluation(asked.clone());
    let found = Match { nearest: 2, distance: 0.5, runner_up: Some((0, 0.75)) };
    let good = EvaluationResult {
        queries: 2,
        object_correct: 1,
        category_correct: 2,
        matches: vec![found, found],
        ..EvaluationResult::default()
    };
    assert_eq!(task.check(&TaskResult::Evaluation(good.clone())), Ok(()));
    let bad: [fn(&mut EvaluationResult); 11] = [
        |result| result.queries = 1,
        |result| result.margin = Some(0.0),
        |result| result.nearest.push(Nearest::default()),
        |result| result.queries = 3,
        |result| result.object_correct = 3,
        |result| result.category_correct = 0,
        |result| result.matches.truncate(1),
        |result| result.matches[0].nearest = 3,
        |result| result.matches[1].distance = f64::NAN,
        |result| result.matches[1].distance = -1.0,
        |result| result.matches[0].runner_up = Some((3, 1.0)),
    ];
    for spoil in bad {
        let mut result = good.clone();
        spoil(&mut result);
        let result = TaskResult::Evaluation(result);
        assert!(task.check(&result).is_err(), "{result:?}");
    }
    let counts_only = Task::Evaluation(Evaluation { want_matches: false, ..asked });
    assert!(counts_only.check(&TaskResult::Evaluation(good)).is_err());
}

#[test]
fn impossible_results_under_a_rule_are_refused() {
    let rule = MatchingRule { exclude: Exclusion::SameSequence, margin: true, ..MatchingRule::default() };
    let asked = Evaluation { rule, want_matches: true, ..Evaluation::sample(1, 3, 4) };
    let good = EvaluationResult {
        queries: 2,
        object_correct: 1,
        category_correct: 2,
        matches: Vec::new(),
        nearest: vec![
            Nearest { same: Some((3, 0.5)), other: Some((0, 0.75)) },
            Nearest { same: None, other: Some((1, 0.25)) },
            Nearest { same: Some((0, 0.0)), other: None },
        ],
        margin: Some(1.2),
    };
    let check = |asked: &Evaluation, result: &EvaluationResult| {
        Task::Evaluation(asked.clone()).check(&TaskResult::Evaluation(result.clone()))
    };
    assert_eq!(check(&asked, &good), Ok(()));
    for margin in [-2.0, 2.0, 0.0] {
        assert_eq!(check(&asked, &EvaluationResult { margin: Some(margin), ..good.clone() }), Ok(()));
    }
    let bad: [fn(&mut EvaluationResult); 14] = [
        |result| result.queries = 4,
        |result| result.queries = 3, // those with a cloud of their own are two
        |result| result.queries = 1,
        |result| result.object_correct = 3,
        |result| result.category_correct = 3,
        |result| result.matches.push(Match { nearest: 0, distance: 0.5, runner_up: None }),
        |result| result.nearest.truncate(2),
        |result| result.nearest[0].same = Some((4, 0.5)),
        |result| result.nearest[1].other = Some((1, f64::INFINITY)),
        |result| result.nearest[2].same = Some((0, -0.25)),
        |result| result.margin = None,
        |result| result.margin = Some(2.1),
        |result| result.margin = Some(-2.1),
        |result| result.margin = Some(f64::NAN),
    ];
    for spoil in bad {
        let mut result = good.clone();
        spoil(&mut result);
        assert!(check(&asked, &result).is_err(), "{result:?}");
    }
    let counts = EvaluationResult { nearest: Vec::new(), ..good.clone() };
    let counts_only = Evaluation { want_matches: false, ..asked.clone() };
    assert_eq!(check(&counts_only, &counts), Ok(()));
    assert!(check(&counts_only, &EvaluationResult { queries: 4, ..counts.clone() }).is_err());
    assert!(check(&counts_only, &good).is_err());
    let unasked = Evaluation { rule: MatchingRule { margin: false, ..rule }, ..counts_only };
    assert_eq!(check(&unasked, &EvaluationResult { margin: None, ..counts.clone() }), Ok(()));
    assert!(check(&unasked, &counts).is_err());
}

#[test]
fn messages_that_lack_something_or_hold_too_much_are_refused() {
    let refused = |change: fn(&mut v2::Task)| {
        let tile = Tile {
            evaluation: base(),
            query_descriptions: vec![Digest([3; 32])],
            database_descriptions: vec![Digest([4; 32])],
        };
        let mut message = v2::Task::from(&Task::Tile(tile));
        change(&mut message);
        Task::try_from(message).unwrap_err().to_string()
    };
    fn tile(message: &mut v2::Task) -> &mut v2::Tile {
        match message.ask.as_mut().unwrap() {
            v2::task::Ask::Tile(tile) => tile,
            other => panic!("{other:?}"),
        }
    }
    fn evaluation(message: &mut v2::Task) -> &mut v2::Evaluation {
        tile(message).evaluation.as_mut().unwrap()
    }
    type Change = fn(&mut v2::Task);
    let cases: [(Change, &str); 15] = [
        (
            |task| evaluation(task).rule = Some(v2::MatchingRule { exclude: 3, ..Default::default() }),
            "exclusion of a matching rule: must be known, got 3",
        ),
        (
            |task| evaluation(task).rule = Some(v2::MatchingRule { objective: -1, ..Default::default() }),
            "objective of a matching rule: must be known, got -1",
        ),
        (|task| evaluation(task).scales = vec![1.0, 0.0], "scale: must be a distance above 0, got 0"),
        (|task| evaluation(task).scales = vec![-1.0], "scale: must be a distance above 0, got -1"),
        (|task| evaluation(task).scales = vec![f64::NAN], "scale: must be a distance above 0, got NaN"),
        (|task| evaluation(task).scales = vec![f64::INFINITY], "scale: must be a distance above 0, got inf"),
        (|task| task.facts = None, "task: facts: missing"),
        (|task| task.ask = None, "task: what is asked: missing"),
        (|task| tile(task).evaluation = None, "tile: evaluation: missing"),
        (|task| tile(task).query_descriptions.clear(), "description of a shard: missing"),
        (|task| tile(task).database_descriptions.push(vec![0; 32]), "must be at most 1, got 2"),
        (|task| tile(task).database_descriptions[0].truncate(31), "digest: length must be 32 bytes, got 31"),
        (
            |task| evaluation(task).descriptor = vec![0; MAX_DESCRIPTOR_BYTES + 1],
            "bytes of a descriptor: must be at most 4096, got 4097",
        ),
        (
            |task| evaluation(task).preparation = vec![0; MAX_PREPARATION_BYTES + 1],
            "bytes of a preparation: must be at most 65536, got 65537",
        ),
        (|task| task.facts.as_mut().unwrap().label = "x".repeat(257), "must be at most 256, got 257"),
    ];
    for (change, expected) in cases {
        let message = refused(change);
        assert!(message.contains(expected), "{message}");
    }
    let mut cell = v2::Task::from(&Task::GridCell(cell_of(base(), 3)));
    cell.facts.as_mut().unwrap().descriptors = u32::MAX;
    assert!(
        Task::try_from(cell).unwrap_err().to_string().contains("must be at most 1048576, got 4294967295")
    );
}

#[test]
fn what_a_failure_says_is_fit_for_a_terminal_and_its_reason_survives() {
    let message = format!("\u{1b}[2Jdisk full\n{}", "x".repeat(2 * MAX_TEXT_BYTES));
    let failure = Failure::from(v2::Failure { reason: v2::FailureReason::Data.into(), message });
    assert_eq!(failure.reason, FailureReason::Data);
    assert!(failure.to_string().starts_with("data: \\u{1b}[2Jdisk full\n  xxx"), "{failure}");
    assert!(failure.message.len() <= MAX_TEXT_BYTES);
    let unknown = Failure::from(v2::Failure { reason: 99, message: String::new() });
    assert_eq!(unknown.reason, FailureReason::Other);
}

#[test]
fn a_report_without_a_lease_is_none_and_one_without_an_outcome_is_a_failure() {
    let message = v2::JobReport::default();
    assert_eq!(Report::try_from(message).unwrap_err(), InvalidMessage::Missing("report: lease"));
    let lease = Some(v2::Lease { job: 1, attempt: 1, nonce: Vec::new() });
    let message = v2::JobReport { lease, run_seconds: f64::NAN, outcome: None };
    let report = Report::try_from(message).unwrap();
    assert_eq!(report.run_seconds, 0.0);
    assert_eq!(report.outcome.unwrap_err().reason, FailureReason::InvalidResult);
}
