//! What is kept from run to run saves time and changes nothing else.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs};

use cache::Store;
use cache::{ByteSize, Storage};
use serde_json::Value;

use crate::experiments::{Experiment, summary};
use crate::hostile::answer_all;
use crate::impostors::lie;
use crate::peer::Peer;
use crate::process::{Finished, Running, finish, program, run};

/// Comes back to some descriptors, and validates.
const SEARCH: &str = "[ga]\npopulation = 8\n[stop]\ngenerations = 12\nstagnation = \"off\"\n\
    validation_patience = 10\n";

/// Digest and numbers of computed and remembered evaluations.
#[track_caller]
fn outcome(finished: &Finished) -> (Value, u64, u64) {
    let summary = summary(finished);
    let count = |name: &str| summary[name].as_u64().unwrap();
    (summary["run_digest"].clone(), count("evaluations_computed"), count("evaluations_remembered"))
}

/// Number of different descriptors in a run's evaluations, and of those that a worker computed.
fn evaluations(experiment: &Experiment, out: &str) -> (usize, usize) {
    let path = experiment.path(out);
    let rows = results::read_evaluations(&path).unwrap();
    let different: BTreeSet<String> = rows.iter().map(|row| format!("{:?}", row.genes)).collect();
    let frame = results::read_table(path, results::TableName::Evaluations).unwrap();
    (different.len(), frame.height() - frame.column("worker").unwrap().null_count())
}

#[test]
fn a_second_run_computes_no_evaluation_and_has_the_same_digest() {
    let experiment = Experiment::new(SEARCH);
    let cache = experiment.path("cache");
    let cold = experiment.run("cold", &["--cache", &cache]).expect_success();
    let (digest, computed, remembered) = outcome(&cold);
    assert_eq!(computed + remembered, 96);
    // Nothing is computed twice, and no request is made while an equal one is under way.
    assert_eq!(evaluations(&experiment, "cold"), (computed as usize, computed as usize));

    let warm = experiment.run("warm", &["--cache", &cache]).expect_success();
    assert_eq!(outcome(&warm), (digest.clone(), 0, 96));
    assert_eq!(evaluations(&experiment, "warm"), (computed as usize, 0));
    let fresh = experiment.run("cold", &["--cache", &cache, "--fresh"]).expect_success();
    assert_eq!(outcome(&fresh), (digest.clone(), 0, 96));
    let without = experiment.run("without", &["--no-cache"]).expect_success();
    assert_eq!(outcome(&without), (digest, computed, remembered));
    let warm = run("coordinator", ["verify", &experiment.path("warm")]).expect_success();
    assert!(warm.stdout.contains("10 fitness values recomputed"), "{warm}");
}

#[test]
fn a_run_that_was_killed_is_not_remembered() {
    let experiment = Experiment::new(&SEARCH.replace("generations = 12", "generations = 60"));
    let cache = experiment.path("cache");
    let args = experiment.run_args("killed", &["--cache", &cache]);
    let mut killed = Running::start(experiment.folder(), "killed", "coordinator", args);
    killed.wait_for("generation 3/60");
    killed.signal("KILL");
    assert!(!killed.wait().status.success());
    let after = experiment.run("after", &["--cache", &cache]).expect_success();
    let (_, computed, _) = outcome(&after);
    assert_eq!(evaluations(&experiment, "after"), (computed as usize, computed as usize));
}

/// Every file below a folder.
pub fn files(folder: &Path) -> Vec<PathBuf> {
    let (mut files, mut folders) = (Vec::new(), vec![folder.to_owned()]);
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() { folders.push(path) } else { files.push(path) }
        }
    }
    files
}

fn warnings(finished: &Finished) -> usize {
    finished.stderr.matches("WARN").count()
}

#[test]
fn damaged_entries_of_every_kind_are_made_again_and_a_few_are_told() {
    let experiment = Experiment::new(SEARCH);
    let cache = experiment.path("cache");
    let cold = experiment.run("cold", &["--cache", &cache]).expect_success();
    let entries = files(cache.as_ref());
    for kind in ["inspection", "remembered-counts", "prepared-cloud"] {
        assert!(entries.iter().any(|path| path.display().to_string().contains(kind)), "{kind}: {entries:?}");
    }
    for path in &entries {
        let mut bytes = fs::read(path).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        fs::write(path, bytes).unwrap();
    }
    let damaged = experiment.run("damaged", &["--cache", &cache]).expect_success();
    assert_eq!(outcome(&damaged), outcome(&cold));
    // The first, the second, the fourth, …
    assert_eq!(warnings(&damaged), entries.len().ilog2() as usize + 1, "{damaged}");
    let repaired = experiment.run("repaired", &["--cache", &cache]).expect_success();
    assert_eq!(outcome(&repaired).1, 0);
    assert_eq!((outcome(&repaired).0, warnings(&repaired)), (outcome(&cold).0, 0), "{repaired}");
}

#[test]
fn a_cache_that_cannot_be_written_costs_one_warning() {
    let experiment = Experiment::new(SEARCH);
    let plain = experiment.run("plain", &["--no-cache"]).expect_success();
    assert_eq!(warnings(&plain), 0, "{plain}");
    // A file where the folder should be: nothing can be made below it, whoever runs this.
    let blocked = experiment.run("blocked", &["--cache", &experiment.path("exp.toml")]).expect_success();
    assert_eq!(outcome(&blocked), outcome(&plain));
    assert_eq!(warnings(&blocked), 1, "{blocked}");
    assert!(blocked.stderr.contains("cannot keep entries"), "{blocked}");
}

/// A program that sees `folder` as a file system of its own with so little room; `None` where nobody may mount one.
fn with_little_room(folder: &str, size: &str, args: Vec<String>) -> Option<Command> {
    let probe = Command::new("unshare").args(["--mount", "mount", "-t", "tmpfs", "none", folder]).output();
    if !probe.is_ok_and(|probe| probe.status.success()) {
        let required = env::var_os("DESCRY_REQUIRE_HOSTS").is_some_and(|value| value == "1");
        assert!(!required, "this machine must let file systems be mounted");
        eprintln!("SKIPPED: a full disk needs root, unshare and mount");
        return None;
    }
    let program = program("coordinator");
    let mut command = Command::new("unshare");
    let mount = "mount -t tmpfs -o size=\"$0\" none \"$1\" && shift && exec \"$@\"";
    command.args(["--mount", "sh", "-c", mount, size, folder]).arg(program.get_program()).args(args);
    for (name, value) in program.get_envs() {
        match value {
            Some(value) => command.env(name, value),
            None => command.env_remove(name),
        };
    }
    Some(command)
}

#[test]
fn a_full_cache_disk_costs_one_warning() {
    let experiment = Experiment::new(SEARCH);
    let plain = experiment.run("plain", &["--no-cache"]).expect_success();
    let cache = experiment.path("cache");
    fs::create_dir(&cache).unwrap();
    let args = experiment.run_args("full", &["--cache", &cache]);
    let Some(mut command) = with_little_room(&cache, "300k", args) else { return };
    let full = finish(&mut command).expect_success();
    assert_eq!(outcome(&full), outcome(&plain));
    assert_eq!(warnings(&full), 1, "{full}");
    let told = full.stderr.lines().find(|line| line.contains("WARN")).unwrap();
    assert!(told.contains("cannot keep entries") && told.contains("No space left on device"), "{full}");
    assert!(files(cache.as_ref()).is_empty(), "it was not the small file system that was written to");
}

#[test]
fn limits_on_disk_and_memory_change_no_result() {
    let experiment = Experiment::new(SEARCH);
    let plain = experiment.run("plain", &["--no-cache"]).expect_success();
    for (out, limit) in [("disk", ["--cache-size", "1MiB"]), ("memory", ["--memory", "1MiB"])] {
        // One each: what the first remembers, the second would not compute.
        let cache = experiment.path(&format!("{out}-cache"));
        let limited = experiment.run(out, &["--cache", &cache, limit[0], limit[1]]).expect_success();
        assert_eq!(outcome(&limited), outcome(&plain));
        let bytes: u64 = files(cache.as_ref()).iter().map(|path| path.metadata().unwrap().len()).sum();
        assert!(out != "disk" || bytes <= 1 << 20, "{bytes}");
    }
}

#[test]
fn a_worker_elsewhere_gets_prepared_clouds_instead_of_preparing_them() {
    // Clouds of the baselines are prepared too quickly to be kept.
    let experiment = Experiment::new(&format!("{SEARCH}[results]\nbaselines = false\n"));
    let cache = experiment.path("cache");
    experiment.run("first", &["--cache", &cache]).expect_success();
    let args = experiment.run_args("second", &["--cache", &cache, "--seed", "6", "--local-workers", "0"]);
    let mut coordinator = Running::start(experiment.folder(), "coordinator", "coordinator", args);
    let address = coordinator.join_address();
    let mut worker = Running::start(
        experiment.folder(),
        "worker",
        "worker",
        ["--coordinator", &address, "--threads", "1"],
    );
    let second = coordinator.wait().expect_success();
    worker.signal("TERM");
    let worker = worker.wait().expect_success();
    assert!(worker.stderr.contains("prepared 0 and loaded "), "{worker}");
    let [told, nothing] = ["prepared ", "prepared 0 "].map(|text| worker.stderr.matches(text).count());
    assert_eq!(told, nothing, "{worker}");
    let plain = experiment.run("plain", &["--no-cache", "--seed", "6"]).expect_success();
    assert_eq!(outcome(&second).0, outcome(&plain).0);
}

/// The store in a cache folder.
pub fn store(cache: &str) -> Store {
    let size = ByteSize::gib(1);
    let storage = Storage { cache: Some(cache.into()), cache_size: size, ..Storage::in_memory(size) };
    Store::open(&storage, "liar", descriptor::EVALUATION_VERSION)
}

/// Raises the object count of every remembered record to its category count or to all queries, and keeps the entries
/// again as the store itself does.
fn improve_remembered_counts(cache: &str) -> usize {
    let store = store(cache);
    let mut improved = 0;
    for key in store.local_keys("remembered counts") {
        let mut payload = store.get_local("remembered counts", key).unwrap();
        // Magic (8 bytes), queries (4), number of sources (4) and each source with its length; a record has the length of
        // a descriptor, its 22 bytes, two counts and the number of its source.
        let queries: [u8; 4] = payload[8..12].try_into().unwrap();
        let mut records = 16;
        for _ in 0..u32::from_le_bytes(payload[12..16].try_into().unwrap()) {
            records += 4 + u32::from_le_bytes(payload[records..records + 4].try_into().unwrap()) as usize;
        }
        for record in payload[records..].chunks_exact_mut(35) {
            assert_eq!(record[0], 22);
            record[23..27].copy_from_slice(&queries);
            record[27..31].copy_from_slice(&queries);
            improved += 1;
        }
        store.put_local("remembered counts", key, &payload);
    }
    improved
}

#[test]
fn a_run_begins_again_without_remembered_counts_that_are_wrong() {
    for audit in ["0.0", "1.0"] {
        let experiment = Experiment::new(&format!("{SEARCH}[coordinator]\naudit = {audit}\n"));
        let cache = experiment.path("cache");
        let honest = experiment.run("honest", &["--cache", &cache]).expect_success();
        assert!(improve_remembered_counts(&cache) > 20);
        let misled = experiment.run("misled", &["--cache", &cache]).expect_success();
        assert_eq!(outcome(&misled).0, outcome(&honest).0, "{misled}");
        assert!(misled.stderr.contains("back to generation 1: remembered counts: shape_bins="), "{misled}");
        assert!(misled.stderr.contains("coordinator was wrong: dropped from the cache: "), "{misled}");
        let named = format!("{} rests on such answers, too", experiment.path("honest"));
        assert!(misled.stderr.contains(&named), "{misled}");
        let after = experiment.run("after", &["--cache", &cache]).expect_success();
        assert_eq!(outcome(&after), (outcome(&honest).0, 0, 96), "{after}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_stranger_alone_does_not_overrule_what_is_remembered() {
    let experiment = Experiment::new(&format!("{SEARCH}[results]\nbaselines = false\n"));
    let cache = experiment.path("cache");
    tokio::task::block_in_place(|| experiment.run("honest", &["--cache", &cache]).expect_success());
    let args = experiment.run_args("lied", &["--local-workers", "0", "--cache", &cache]);
    let mut coordinator = Running::start(experiment.folder(), "coordinator", "coordinator", args);
    let liar = Peer::join(&coordinator.join_address(), None, "liar").await.unwrap();
    let liar = tokio::spawn(answer_all(liar, lie));
    tokio::task::block_in_place(|| {
        let refused = coordinator.wait().expect_error();
        assert!(refused.stderr.contains("error: remembered counts: shape_bins="), "{refused}");
        assert!(refused.stderr.contains("which decides (--local-workers 1)"), "{refused}");
        // The run goes on where somebody decides.
        let decided = experiment.run("lied", &["--cache", &cache]).expect_success();
        let after = experiment.run("honest", &["--cache", &cache, "--fresh"]).expect_success();
        assert_eq!(outcome(&decided).0, outcome(&after).0, "{decided}");
    });
    liar.await.unwrap();
}
