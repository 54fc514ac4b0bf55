//! Every command as a user runs it.

use std::fs;
use std::path::Path;

use results::TableName;
use serde_json::Value;

use crate::experiments::{Experiment, clouds, repository, summary};
use crate::process::{finish, program, run};

const KEYS: [&str; 12] = [
    "best",
    "train_error",
    "validation_error",
    "test_object_error",
    "test_category_error",
    "evaluations_computed",
    "evaluations_remembered",
    "generations",
    "stop_reason",
    "seconds",
    "run_digest",
    "out",
];

const SHORT: &str = "[ga]\npopulation = 6\n[stop]\ngenerations = 4\nvalidation_patience = \"off\"\n";

#[test]
fn a_run_ends_with_a_summary_whole_tables_and_a_digest_that_verifies() {
    let experiment = Experiment::new(SHORT);
    let finished = experiment.run("out", &[]).expect_success();
    let summary = summary(&finished);
    for key in KEYS {
        assert!(!summary[key].is_null(), "{key}: {finished}");
    }
    for gene in ["shape_bins", "m", "R1", "R2", "w"] {
        assert!(summary["best"][gene].is_number(), "{gene}: {finished}");
    }
    let count = |key: &str| summary[key].as_u64().unwrap();
    assert_eq!(count("evaluations_computed") + count("evaluations_remembered"), 6 * count("generations"));
    assert_eq!(summary["stop_reason"], "generations");
    // Plain progress: a line a generation, none of it on standard output.
    assert_eq!(finished.stderr.lines().filter(|line| line.starts_with("generation ")).count(), 4);

    let out = experiment.path("out");
    for table in TableName::RUN {
        let frame = results::read_table(&out, table).unwrap();
        let rows = frame.shape().0;
        let expected = match table {
            TableName::Evaluations => 24,
            TableName::Generations => 4,
            TableName::Predictions => count("validation_queries") as usize + count("test_queries") as usize,
            TableName::Skipped => 0,
            TableName::Run | TableName::Workers | TableName::Looks => 1,
            // Beside its attempts, a run may have things to tell.
            TableName::Attempts => rows.max(count("evaluations_computed") as usize),
            TableName::Events => rows,
            other => panic!("{other}: not a table of a run"),
        };
        assert_eq!(rows, expected, "{table}");
    }

    let verified = run("coordinator", ["verify", &out, "--sample", "3"]).expect_success();
    assert!(verified.stdout.contains("3 fitness values recomputed"), "{verified}");

    // The same command shows the same result again, and computes nothing.
    let again = experiment.run("out", &[]).expect_success();
    assert_eq!(self::summary(&again)["run_digest"], summary["run_digest"]);
    assert!(again.stderr.contains("this run is finished"), "{again}");
    // Another search does not fit into the same folder.
    let other = experiment.run("out", &["--seed", "6"]).expect_error();
    assert!(other.stderr.contains("holds another search") && other.stderr.contains("+ seed = 6"), "{other}");
}

#[test]
fn a_tampered_cell_is_found() {
    let experiment = Experiment::new(SHORT);
    experiment.run("out", &[]).expect_success();
    let file = Path::new(&experiment.path("out")).join("evaluations/generation-00002.parquet");
    // The checksums inside catch any change of bytes; whoever repairs those meets the digests.
    let mut bytes = fs::read(&file).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&file, bytes).unwrap();
    let verified = run("coordinator", ["verify", &experiment.path("out")]).expect_error();
    assert!(
        verified.stdout.contains("NOT sound") && verified.stdout.contains("generation-00002"),
        "{verified}"
    );
}

#[test]
fn verification_notices_other_data() {
    let experiment = Experiment::with(&format!("version = 1\n[dataset]\nroot = \"data\"\n{SHORT}"));
    let data = experiment.path("data");
    run("coordinator", ["synth", &data, "--objects", "2", "--views", "6"]).expect_success();
    experiment.run("out", &[]).expect_success();
    run("coordinator", ["verify", &experiment.path("out")]).expect_success();
    // The data set may move.
    let moved = experiment.path("moved");
    fs::rename(&data, &moved).unwrap();
    run("coordinator", ["verify", &experiment.path("out"), "--data", &moved]).expect_success();
    let list = fs::read_to_string(Path::new(&moved).join("test.txt")).unwrap();
    let cloud = Path::new(&moved).join(list.lines().next().unwrap());
    let other = Path::new(&moved).join(list.lines().next_back().unwrap());
    fs::copy(other, cloud).unwrap();
    let verified = run("coordinator", ["verify", &experiment.path("out"), "--data", &moved]).expect_error();
    assert!(verified.stdout.contains("data: digest: expected"), "{verified}");
}

#[test]
fn a_taken_default_port_does_not_stop_a_run_with_workers_of_its_own() {
    // Taken by this test or by somebody else: both will do.
    let _taken = std::net::TcpListener::bind(coordinator::session::DEFAULT_LISTEN);
    let experiment = Experiment::new(SHORT);
    let args = ["run", &experiment.path("exp.toml"), "--out", &experiment.path("out")];
    let finished = run("coordinator", args).expect_success();
    assert!(finished.stderr.contains("port 7700 is in use"), "{finished}");
}

#[test]
fn a_run_shows_a_table_for_people() {
    let experiment = Experiment::new(SHORT);
    let args = experiment.run_args("out", &[]);
    let finished = run("coordinator", args.iter().filter(|arg| *arg != "--json")).expect_success();
    for part in [
        "stopped",
        "winner",
        "shape_bins",
        "R1",
        "cm",
        "object error   95 % interval  category error 95 % interval  clouds",
        "train",
        "validation",
        "test",
        "run digest",
    ] {
        assert!(finished.stdout.contains(part), "{part}: {finished}");
    }
}

#[test]
fn check_prints_the_resolved_experiment_its_clouds_and_the_search_space() {
    let experiment = Experiment::new("");
    let finished = run("coordinator", ["check", &experiment.path("exp.toml")]).expect_success();
    for part in ["population = 10", "# clouds: train1 ", "16580160 descriptors, 25 bits", "# data digest: "] {
        assert!(finished.stdout.contains(part), "{part}: {finished}");
    }
}

#[test]
fn the_demo_leaves_room_to_improve_and_evolution_uses_it() {
    let experiment = Experiment::with("");
    let demo = repository().join("experiments/demo.toml").display().to_string();
    let args = ["run", &demo, "--out", &experiment.path("demo"), "--listen", "127.0.0.1:0", "--json"];
    let finished = run("coordinator", args).expect_success();
    let first = results::read_evaluations(experiment.path("demo")).unwrap();
    // The first generation is random descriptors.
    let random: Vec<f64> =
        first.iter().filter(|row| row.generation == 1).map(|row| row.counts.object_error()).collect();
    let mean = random.iter().sum::<f64>() / random.len() as f64;
    let best = random.iter().copied().fold(f64::INFINITY, f64::min);
    let winner = summary(&finished)["train_error"].as_f64().unwrap();
    assert!(winner < best && winner < 0.75 * mean, "winner {winner}, random best {best} and mean {mean}");
}

#[test]
fn every_ready_made_experiment_is_valid() {
    let mut found = 0;
    for entry in fs::read_dir(repository().join("experiments")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "toml") {
            let overrides = coordinator::experiment::Overrides::default();
            coordinator::experiment::Experiment::read(&path, overrides)
                .unwrap_or_else(|error| panic!("{}: {error}", path.display()));
            found += 1;
        }
    }
    assert!(found >= 3);
}

#[test]
fn evaluate_reports_errors_outcomes_and_seconds_and_adds_up_lists() {
    let data = clouds().display().to_string();
    let evaluate = |lists: &[&str], more: &[&str]| -> Value {
        let mut args = vec!["evaluate", "--data", &data, "--query", "test.txt", "--json"];
        args.extend(lists.iter().flat_map(|list| ["--database", list]));
        args.extend(more);
        let finished = run("coordinator", args).expect_success();
        serde_json::from_str(&finished.stdout).unwrap()
    };
    let all = evaluate(&["train1.txt", "train2.txt", "validation.txt"], &["--threads", "2"]);
    let sizes: Vec<u64> = ["train1.txt", "train2.txt", "validation.txt"]
        .map(|list| fs::read_to_string(clouds().join(list)).unwrap().lines().count() as u64)
        .to_vec();
    assert_eq!(all["database"], sizes.iter().sum::<u64>());
    for key in ["object_error", "category_error"] {
        let error = all[key].as_f64().unwrap();
        assert!((0.0..=1.0).contains(&error), "{key}: {all}");
    }
    for stage in ["read", "keypoints", "normals", "describe", "match", "total"] {
        assert!(all["seconds"][stage].as_f64().unwrap() > 0.0, "{stage}: {all}");
    }
    assert!(all["keypoints"].as_u64().unwrap() > all["queries"].as_u64().unwrap());
    assert_eq!(all["skipped"].as_array().unwrap().len(), 0);
    // Threads change nothing but time; genes do.
    let strip = |mut value: Value| {
        value.as_object_mut().unwrap().remove("seconds");
        value
    };
    let single = evaluate(&["train1.txt", "train2.txt", "validation.txt"], &["--threads", "1"]);
    assert_eq!(strip(all), strip(single.clone()));
    let other = evaluate(&["train1.txt"], &["--set", "shape_bins=8", "--set", "r2=5", "--set", "w=0"]);
    assert_eq!(other["descriptor"]["R2"], 5.0);
    assert_ne!(strip(other), strip(single));
}

#[test]
fn evaluate_knows_the_descriptors_that_the_papers_is_compared_with() {
    let data = clouds().display().to_string();
    let folder = Experiment::with("");
    let evaluate = |more: &[&str]| {
        let lists = ["--query", "test.txt", "--database", "train1.txt", "train2.txt"];
        let args = ["evaluate", "--data", &data].into_iter().chain(lists).chain(more.iter().copied());
        run("coordinator", args.collect::<Vec<_>>())
    };
    let told = |kind: &str, distance: &str, threads: &str| -> (Value, String) {
        let file = folder.path("nearest.txt");
        let more = ["--descriptor", kind, "--distance", distance, "--threads", threads, "--radius-cm", "2.5"];
        let finished = evaluate(&[&more[..], &["--json", "--nearest", &file]].concat()).expect_success();
        let mut told: Value = serde_json::from_str(&finished.stdout).unwrap();
        told.as_object_mut().unwrap().remove("seconds");
        (told, fs::read_to_string(file).unwrap())
    };
    for kind in ["pfhrgb", "shotcolor"] {
        let (chi2, nearest) = told(kind, "chi2", "2");
        let expected = serde_json::json!({ "name": kind, "radius_cm": 2.5 });
        assert_eq!((&chi2["descriptor"], &chi2["distance"]), (&expected, &"chi2".into()));
        assert_eq!(nearest.lines().count() as u64, chi2["queries"].as_u64().unwrap());
        // There are six objects.
        assert!(chi2["object_error"].as_f64().unwrap() < 5.0 / 6.0, "no better than guessing: {chi2}");
        assert_eq!(told(kind, "chi2", "1"), (chi2, nearest.clone()), "threads change nothing");
        assert_ne!(told(kind, "l1", "2").1, nearest);
        let refused = evaluate(&["--descriptor", kind, "--set", "R1=1"]).expect_error();
        assert!(refused.stderr.contains(&format!("--set: {kind} has no genes, got R1=1\n")), "{refused}");
        let refused = evaluate(&["--descriptor", kind, "--no-colour"]).expect_error();
        assert!(refused.stderr.contains(&format!("--no-colour: {kind} needs colours")), "{refused}");
    }
    assert_eq!(evaluate(&["--descriptor", "fpfh"]).expect_error().status.code(), Some(2));
    for family in ["disk-ring", "global-hue"] {
        let refused = evaluate(&["--descriptor", family, "--radius-cm", "3"]).expect_error();
        let said = format!("error: --radius-cm: {family} has no region of one radius, got 3\n");
        assert!(refused.stderr.contains(&said), "{refused}");
    }
    // Two points of a cloud are never a metre apart: the channel tells nothing.
    let channel = "pairs = \"cloud\"\nfeatures = [\"d 5\"]\nradius_cm = 100\nsamples = 512\n";
    let file = folder.path("one.toml");
    fs::write(&file, format!("version = 1\n[[channel]]\n{channel}[[channel]]\n{channel}least_cm = 99\n"))
        .unwrap();
    let told = evaluate(&["--structure", &file]).expect_success();
    assert!(
        told.stderr.starts_with("warning: channel 2: pairs of points in some cloud expected, got none\n"),
        "{told}"
    );
    assert_eq!(told.stderr.matches("warning").count(), 1, "{told}");
    let shape = evaluate(&["--no-colour"]).expect_success();
    assert!(shape.stderr.is_empty(), "{shape}");
    // Each channel has a grid of its own.
    let refused = evaluate(&["--structure", &file, "--leaf-cm", "3"]).expect_error();
    assert!(
        refused.stderr.contains("'--structure <TOML>' cannot be used with '--leaf-cm <CM>'"),
        "{refused}"
    );
    let refused = evaluate(&["--descriptor", "structure", "--leaf-cm", "3"]).expect_error();
    assert!(
        refused.stderr.contains("--leaf-cm: channels of structure have their own grids, got 3\n"),
        "{refused}"
    );
}

#[test]
fn synth_writes_the_same_bytes_for_the_same_seed() {
    let experiment = Experiment::with("");
    let digest = |name: &str, seed: &str| {
        let folder = experiment.path(name);
        run("coordinator", ["synth", &folder, "--objects", "2", "--views", "4", "--seed", seed])
            .expect_success();
        let mut hasher = blake3::Hasher::new();
        let lists = ["train1", "train2", "validation", "test"];
        for list in lists {
            let text = fs::read_to_string(Path::new(&folder).join(format!("{list}.txt"))).unwrap();
            for line in text.lines() {
                hasher.update(line.as_bytes()).update(&fs::read(Path::new(&folder).join(line)).unwrap());
            }
        }
        hasher.finalize()
    };
    let first = digest("a", "1");
    assert_eq!(first, digest("b", "1"));
    assert_ne!(first, digest("c", "2"));
    // Made again: nothing to do. Made otherwise into the same place: refused.
    let folder = experiment.path("a");
    let again = run("coordinator", ["synth", &folder, "--objects", "2", "--views", "4", "--seed", "1"])
        .expect_success();
    assert!(again.stdout.contains("holds this data set already"), "{again}");
    let other = run("coordinator", ["synth", &folder, "--objects", "3", "--views", "4"]).expect_error();
    assert!(other.stderr.contains("got another one"), "{other}");
}

#[test]
fn the_schema_is_json_schema() {
    let finished = run("coordinator", ["schema"]).expect_success();
    let schema: Value = serde_json::from_str(&finished.stdout).unwrap();
    assert_eq!(schema["type"], "object");
    assert!(schema["properties"]["dataset"].is_object());
}

#[test]
fn every_option_has_help_with_an_example() {
    let commands = [
        "run",
        "resume",
        "check",
        "certs",
        "compare",
        "control",
        "evaluate",
        "exhaust",
        "export",
        "keygen",
        "query",
        "learn",
        "assess",
        "recognise",
        "report",
        "split",
        "synth",
        "verify",
        "schema",
    ];
    let orders =
        ["pause", "resume", "stop", "priority", "drain", "deny"].map(|order| ["control", "RUN", order]);
    let mut of_coordinator: Vec<&[&str]> = commands.iter().map(std::slice::from_ref).collect();
    of_coordinator.extend(orders.iter().map(|order| &order[..]));
    for (program_name, commands) in [("coordinator", of_coordinator), ("worker", vec![&[][..]])] {
        for command in commands {
            let mut help = program(program_name);
            let finished = finish(help.args(command).arg("--help").env("COLUMNS", "400")).expect_success();
            assert!(finished.stdout.contains("Example: "), "{finished}");
            let options: Vec<&str> =
                finished.stdout.split("\n  ").filter(|part| part.contains("--")).collect();
            let mut lines = finished.stdout.lines().peekable();
            while let Some(line) = lines.next() {
                let is_option = line.trim_start().starts_with("--");
                if is_option && !line.contains("--version") {
                    let text = lines.peek().copied().unwrap_or_default();
                    assert!(format!("{line} {text}").contains("for example"), "{line}: {finished}");
                }
            }
            assert!(!options.is_empty() || command == ["schema"]);
        }
    }
}
