//! Structures that are shipped as files are the descriptors that they are called: the nearest clouds are those of the
//! original, or of a script that nothing of this project went into.

use std::path::Path;
use std::process::Command;

use crate::experiments::{clouds, repository};
use crate::process::{finish, run};

/// A query, its nearest cloud and their distance.
type Answer = (String, String, f64);

/// What `evaluate --nearest` writes.
fn answers(text: &str) -> Vec<Answer> {
    let answer = |line: &str| -> Answer {
        let [query, nearest, distance] = line.split(' ').collect::<Vec<_>>()[..] else { panic!("{line}") };
        (query.to_owned(), nearest.to_owned(), distance.parse().unwrap())
    };
    text.lines().map(answer).collect()
}

/// The nearest clouds of train1 in train2 under a descriptor.
fn nearest(data: &Path, descriptor: [&str; 2]) -> Vec<Answer> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("nearest.txt").display().to_string();
    let data = data.display().to_string();
    let args = ["evaluate", "--data", &data, "--query", "train1.txt", "--database", "train2.txt"];
    run("coordinator", args.into_iter().chain(["--nearest", &path]).chain(descriptor)).expect_success();
    answers(&std::fs::read_to_string(path).unwrap())
}

fn shipped(name: &str) -> String {
    repository().join("experiments/descriptors").join(name).display().to_string()
}

/// Fails unless the nearest clouds are equal and the distances `factor` times as long, to so small a share.
#[track_caller]
fn assert_agree(found: &[Answer], expected: &[Answer], factor: f64, share: f64) {
    assert_eq!(found.len(), expected.len());
    assert!(!found.is_empty());
    for (found, expected) in found.iter().zip(expected) {
        assert_eq!((&found.0, &found.1), (&expected.0, &expected.1), "{found:?}, expected {expected:?}");
        let ratio = found.2 / (factor * expected.2);
        assert!((ratio - 1.0).abs() < share, "{found:?}, expected {factor} times {expected:?}");
    }
}

#[test]
fn the_papers_descriptor_is_a_member() {
    let found = nearest(clouds(), ["--structure", &shipped("paper.toml")]);
    let expected = nearest(clouds(), ["--descriptor", "disk-ring"]);
    let pairs = |answers: &[Answer]| -> Vec<[String; 2]> {
        answers.iter().map(|(query, nearest, _)| [query.clone(), nearest.clone()]).collect()
    };
    assert_eq!(pairs(&found), pairs(&expected));
    assert!(found.len() > 15, "{} queries", found.len());
}

/// Where every keypoint has three neighbours, as on these clouds, it is PFHRGB but for a factor: PCL's rows add up to 200
/// in each half, those of a channel to 1.
#[test]
fn pfhrgb_is_a_member() {
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data"); // few: all pairs within 5 cm take long
    let path = data.display().to_string();
    run("coordinator", ["synth", &path, "--objects", "3", "--views", "8", "--seed", "3"]).expect_success();
    let found = nearest(&data, ["--structure", &shipped("pfhrgb.toml")]);
    assert_agree(&nearest(&data, ["--descriptor", "pfhrgb"]), &found, 200.0, 1e-4);
}

/// Against a script that computes it in double precision from its definition. Distances differ where rounding decides:
/// of pairs on a bound of a shell, which is a whole number of micrometres here, and of bins.
#[test]
fn cospair_is_a_member() {
    let python = |args: &[&str]| finish(Command::new("python3").args(args));
    if !python(&["-c", "import numpy"]).status.success() {
        let required = std::env::var_os("DESCRY_REQUIRE_NUMPY").is_some_and(|value| value == "1");
        assert!(!required, "python3 cannot import numpy");
        eprintln!("SKIPPED: python3 cannot import numpy");
        return;
    }
    let found = nearest(clouds(), ["--structure", &shipped("cospair.toml")]);
    let script = repository().join("tests/python/cospair.py").display().to_string();
    let data = clouds().display().to_string();
    let written = python(&[&script, &data, "train1.txt", "train2.txt"]).expect_success();
    assert_agree(&found, &answers(&written.stdout), 1.0, 0.005);
    assert!(found.len() > 15, "{} queries", found.len());
}
