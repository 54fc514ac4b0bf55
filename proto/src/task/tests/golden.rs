//! Bytes and names of what the paper's protocol asks and answers: runs, journals and workers of the same version rest on
//! them, so that they must not change with what is added. The digests were made before there were matching rules, scales
//! and sequences.

use super::*;
use crate::WorkerId;
use crate::journal::AcceptedResult;

fn counts() -> EvaluationResult {
    let found = |index: u32| Match {
        nearest: index,
        distance: 0.1 + f64::from(index),
        runner_up: (index % 2 == 1).then_some((9, 0.3)),
    };
    EvaluationResult {
        queries: 10,
        object_correct: 4,
        category_correct: 6,
        matches: (0..3).map(found).collect(),
        ..EvaluationResult::default()
    }
}

fn check(bytes: &[u8], expected: &str) {
    assert_eq!(Digest::of(bytes).to_string(), expected);
}

#[test]
fn bytes_and_names_of_tasks_stay() {
    let with_matches = Evaluation { want_matches: true, ..base() };
    let shard = Description { subject: Subject::sample(1), manifest: Digest([1; 32]), clouds: 2 };
    let tile = Tile {
        evaluation: with_matches.clone(),
        query_descriptions: vec![Digest([3; 32])],
        database_descriptions: vec![Digest([4; 32])],
    };
    for (task, bytes, name) in [
        (
            Task::Evaluation(base()),
            "e63f54e4d26fca3298542bdcadec7524e4a6f3967e538d28ed7676eb8d185fb5",
            4_095_681_622_144_340_983,
        ),
        (
            Task::Evaluation(with_matches),
            "390c4c87d41909cd730ed46dd6045d2449f78feee1f035df7ec820c6fcf4dc00",
            13_111_337_212_941_756_955,
        ),
        (
            Task::Tile(tile),
            "997777fd86525d86eb041b02aadf79d7a084f1599c0ca5cc2188eb5bc5aa85b7",
            8_897_727_557_822_882_045,
        ),
        (
            Task::GridCell(cell_of(base(), 3)),
            "c22676b4084a36395d9795524fc43ef5f7ddf960839d6947c126080480e3fa27",
            14_311_197_442_607_845_020,
        ),
        (
            Task::Description(shard),
            "706a4ec55ecfad1e72221ec1b3109797baf8c532e08a9c10cc3eb913664b43b4",
            15_193_184_574_010_852_541,
        ),
    ] {
        check(&v2::Task::from(&task).encode_to_vec(), bytes);
        assert_eq!(task.job(0), JobId(name), "{task}");
    }
}

#[test]
fn bytes_of_results_stay() {
    let counts_only = EvaluationResult { matches: Vec::new(), ..counts() };
    for (result, bytes) in [
        (
            TaskResult::Evaluation(counts_only),
            "998b4e56c57c9befdae9db86fcaaf4eda2e724a7972838af3ac5239f029cd3f6",
        ),
        (
            TaskResult::Evaluation(counts()),
            "38c0b2bd66cb74443eeb6910f7e5d5bc47673105ad0c438e8b80dbb15bebe7fc",
        ),
        (
            TaskResult::GridCell(vec![1, 0, 300]),
            "51068e2901e45e685427eb467b5daab3f2c1d208eab999704d22a8772912141c",
        ),
        (
            TaskResult::Description(Described::new(b"bytes".to_vec())),
            "3291933443b0a8d7e53889bd9e2887ba6211a4b08538c93a6a3321943d5c71a8",
        ),
    ] {
        check(&v2::TaskResult::from(result).encode_to_vec(), bytes);
    }
}

#[test]
fn bytes_of_accepted_results_and_of_manifests_stay() {
    let accepted = AcceptedResult {
        result: TaskResult::Evaluation(counts()),
        worker_id: WorkerId([3; 16]),
        worker: "rack-3".to_owned(),
        principal: crate::Principal::Coordinator,
        seconded: None,
        assurance: crate::journal::Assurance::Audited,
        attempt: 2,
        queued: std::time::Duration::from_nanos(1_234_567_891),
        run_seconds: 0.1,
    };
    check(&accepted.encode().unwrap(), "a44e13b1e3911229eec13d349e50d8a8ac0c9fcdc8dde355b7b362d154c05e57");
    let cloud = |number: u8| CloudEntry {
        digest: Digest([number; 32]),
        bytes: 1000,
        label: Label { category: 1, instance: u32::from(number) },
        path: format!("a/a_1/a_1_1_{number}.pcd"),
        sequence: None,
    };
    let manifest = SplitManifest { split: "train1".to_owned(), clouds: vec![cloud(0), cloud(7)] };
    check(&manifest.encode(), "35d65ecd6b8d528b9a46c9493b1d7ebfacc31367281df0ef36caad3e818a3684");
}
