//! Folders that hold somebody else's files, or a run without its journal: refused, and nothing in them is changed.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use crate::experiments::{Experiment, run_demo};
use crate::process::{Finished, kill_at, run};

const SHORT: &str = "[ga]\npopulation = 4\n[stop]\ngenerations = 2\n";

/// Every file below a folder with its bytes.
fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap().map(Result::unwrap) {
        if entry.file_type().unwrap().is_dir() {
            files.extend(self::files(&entry.path()));
        } else {
            files.insert(entry.path(), fs::read(entry.path()).unwrap());
        }
    }
    files
}

/// A folder of somebody who gives files the names that this program gives.
fn foreign(folder: &Path) {
    for name in [
        "run/run.parquet",
        "generations/generation-00001.parquet",
        "grid/grid.parquet",
        "README.md",
        "report.html",
        "convergence.svg",
        "seed-1/evaluations/generation-00001.parquet",
    ] {
        let file = folder.join(name);
        fs::create_dir_all(file.parent().unwrap()).unwrap();
        fs::write(file, "somebody else's").unwrap();
    }
}

#[track_caller]
fn refuses(finished: Finished, parts: &[&str]) {
    let finished = finished.expect_error();
    for part in parts {
        assert!(finished.stderr.contains(part), "no `{part}`: {finished}");
    }
}

#[test]
fn no_command_writes_into_a_folder_of_somebody_else() {
    let sweep = format!("{SHORT}[sweep]\nseeds = \"1..2\"\n");
    let [single, sweep] = [SHORT, &sweep].map(Experiment::new);
    let demo = run_demo().path("results/runs/demo");
    let folder = single.folder().join("theirs");
    foreign(&folder);
    // Without the tables that a run or grid would be recognised, and refused, by.
    for name in ["run", "grid"] {
        fs::rename(folder.join(name), folder.join(format!("their-{name}"))).unwrap();
    }
    let before = files(&folder);
    let out = folder.display().to_string();
    let free = ["--listen", "127.0.0.1:0", "--out", &out];
    let start = |command: &str, experiment: &Experiment| {
        run("coordinator", [&[command, &experiment.path("exp.toml")], &free[..]].concat())
    };
    let searched = ["theirs", "search.toml", "README.md", "choose another --out"];
    refuses(start("run", &single), &searched);
    refuses(start("run", &sweep), &searched);
    refuses(start("exhaust", &single), &searched);
    refuses(run("coordinator", ["export", &demo, &out]), &["must be a new folder or an artefact"]);
    let page = folder.join("report.html").display().to_string();
    refuses(run("coordinator", ["report", &demo, "--out", &page]), &["report.html", "another file", "--out"]);
    let page = single.path("page.html");
    refuses(
        run("coordinator", ["report", &demo, "--out", &page, "--svg", &out]),
        &["convergence.svg", "--svg", "nothing was written"],
    );
    assert!(!Path::new(&page).exists());
    refuses(run("coordinator", ["synth", &out]), &["choose another folder"]);
    let clouds = run_demo().path("results/data/demo");
    refuses(
        run("coordinator", ["split", &clouds, "--out", &out, "--protocol", "paper"]),
        &["--out", "choose another"],
    );
    assert_eq!(files(&folder), before);

    // A sweep's own folder may have one of somebody else where a run of it would go.
    sweep.run("out", &[]).expect_success();
    let member = sweep.folder().join("out/seed-2");
    fs::remove_dir_all(&member).unwrap();
    fs::create_dir(&member).unwrap();
    fs::write(member.join("notes.txt"), "mine").unwrap();
    refuses(sweep.run("out", &[]), &["seed-2", "notes.txt"]);
    assert_eq!(files(&member).len(), 1);
}

#[test]
fn an_artefact_and_a_report_replace_their_own_and_nothing_else() {
    let place = Experiment::new("");
    let demo = run_demo().path("results/runs/demo");
    let (out, page) = (place.path("objects"), place.path("page.html"));
    for _ in 0..2 {
        run("coordinator", ["export", &demo, &out]).expect_success();
        run("coordinator", ["report", &demo, "--out", &page]).expect_success();
    }
    // A folder whose one file is called as one of an artefact is no artefact.
    let readme = place.folder().join("theirs/README.md");
    fs::create_dir(readme.parent().unwrap()).unwrap();
    fs::write(&readme, "mine").unwrap();
    refuses(run("coordinator", ["export", &demo, &place.path("theirs")]), &["without descriptor.toml"]);
    assert_eq!(fs::read_to_string(readme).unwrap(), "mine");
}

#[test]
fn an_unfinished_run_whose_journal_is_gone_keeps_its_tables() {
    let long = "[search]\nmethod = \"random\"\n[ga]\npopulation = 8\n[stop]\ngenerations = 24\n\
        stagnation = \"off\"\nvalidation_patience = \"off\"\n";
    let sweep = format!("{long}[sweep]\nseeds = \"1..2\"\n");
    for (toml, progress) in [(long, "generation 2/24"), (&sweep, "seed-1: generation 2/24")] {
        let experiment = Experiment::new(toml);
        let undisturbed = experiment.run("undisturbed", &[]).expect_success();
        kill_at("coordinator", experiment.run_args("out", &[]), progress);
        let out = experiment.folder().join("out");
        let (journal, kept) = (out.join("journal.log"), experiment.folder().join("kept.log"));
        fs::rename(&journal, &kept).unwrap();
        let before = files(&out);
        let gone = ["no journal.log", "--fresh", "nothing was changed"];
        refuses(experiment.run("out", &[]), &gone);
        assert_eq!(files(&out), before);

        // With --fresh another run is made beside it, and with its journal it goes on.
        let fresh = experiment.run("out", &["--fresh"]).expect_success();
        assert!(fresh.stdout.contains("out-2"), "{fresh}");
        assert_eq!(files(&out), before);
        fs::rename(&kept, &journal).unwrap();
        let finished = experiment.run("out", &[]).expect_success();
        for again in [fresh, finished] {
            assert_eq!(digests(&again), digests(&undisturbed));
        }
    }
}

/// The run digest of each line of JSON.
fn digests(finished: &Finished) -> Vec<String> {
    let digest = |line: &str| {
        let summary: serde_json::Value = serde_json::from_str(line).unwrap();
        summary["run_digest"].as_str().unwrap().to_owned()
    };
    finished.stdout.lines().filter(|line| line.contains("run_digest")).map(digest).collect()
}
