//! What a user who begins is told: summaries that a terminal shows whole, and messages that name what differs.

use std::fs;
use std::path::Path;

use crate::experiments::{Experiment, clouds, summary};
use crate::process::{Finished, finish, program, run};

const SHORT: &str = "[ga]\npopulation = 5\n[stop]\ngenerations = 3\n";

/// A run without `--json`.
fn run_for_people(experiment: &Experiment, out: &str) -> Finished {
    let args = experiment.run_args(out, &[]);
    run("coordinator", args.iter().filter(|arg| *arg != "--json")).expect_success()
}

/// No line of the summary is wider than a terminal, but for paths.
#[track_caller]
fn expect_narrow(finished: &Finished) {
    assert!(finished.stdout.lines().count() > 1, "{finished}");
    for line in finished.stdout.lines().filter(|line| !line.contains('/')) {
        assert!(line.chars().count() <= 80, "{line}\n{finished}");
    }
}

#[test]
fn summaries_fit_80_columns() {
    let grid = "[descriptor.genes]\nshape_bins = { min = 8, max = 11 }\nm = 3\nR1 = 1.0\nR2 = 2.5\n\
        w = { min = 0.0, max = 1.0, step = 0.1 }\n";
    let experiment = Experiment::new(&format!("{SHORT}{grid}[results]\ndir = \"runs\"\n"));
    let exhaust = ["exhaust", &experiment.path("exp.toml"), "--listen", "127.0.0.1:0", "--sample", "3"];
    expect_narrow(&run("coordinator", exhaust).expect_success());
    // Now it tells its regret, too.
    let finished = run_for_people(&experiment, "out");
    assert!(finished.stdout.contains("regret"), "{finished}");
    expect_narrow(&finished);
    let compare = ["compare", &experiment.path("out"), "--listen", "127.0.0.1:0", "--radius-cm", "2.5"];
    let distances = ["--distance", "chi2", "--distance", "l1"];
    let compared = run("coordinator", compare.into_iter().chain(distances)).expect_success();
    assert!(compared.stdout.contains("interval") && !compared.stdout.contains("95 %,"), "{compared}");
    expect_narrow(&compared);
    let data = clouds().display().to_string();
    let lists = ["--query", "test.txt", "--database", "train1.txt", "--database", "train2.txt"];
    let evaluate = ["evaluate", "--data", &data].into_iter().chain(lists);
    expect_narrow(&run("coordinator", evaluate).expect_success());

    let long = "a-variant-with-a-name-that-takes-most-of-a-line";
    let sweep = format!("{SHORT}[sweep]\nseeds = [1, 20]\n[sweep.variants.{long}]\nga.population = 4\n");
    let sweep = Experiment::new(&sweep);
    let finished = run_for_people(&sweep, "out");
    assert!(finished.stdout.contains(long), "{finished}");
    expect_narrow(&finished);
}

#[test]
fn the_last_line_of_progress_counts_as_the_summary_does() {
    // Validation clouds are measured, too, and are no evaluations of individuals.
    let experiment = Experiment::new(SHORT);
    let finished = experiment.run("out", &["--no-cache"]).expect_success();
    let told = summary(&finished);
    assert!(told["validation_queries"].as_u64() > Some(0), "{finished}");
    let lines: Vec<&str> = finished.stderr.lines().filter(|line| line.starts_with("generation ")).collect();
    let last = lines.last().unwrap();
    let [computed, remembered] = ["evaluations_computed", "evaluations_remembered"].map(|key| &told[key]);
    assert!(last.contains(&format!(" {computed} computed (")), "{computed}: {finished}");
    assert!(last.contains(&format!("/s), {remembered} remembered ")), "{remembered}: {finished}");
    assert!(lines.iter().all(|line| !line.contains("at most 0 s")), "{finished}");
}

#[test]
fn objects_that_the_training_clouds_lack_bound_the_error_before_the_search() {
    let experiment = Experiment::with(&format!("version = 1\n[dataset]\nroot = \"data\"\n{SHORT}"));
    let data = experiment.path("data");
    run("coordinator", ["synth", &data, "--objects", "3", "--views", "8"]).expect_success();
    let list = |name: &str| Path::new(&data).join(format!("{name}.txt"));
    let text = fs::read_to_string(list("test")).unwrap();
    let object = |line: &str| line.rsplit_once('/').unwrap().0.to_owned();
    let unseen = object(text.lines().next().unwrap());
    for name in ["train1", "train2", "validation"] {
        let kept = fs::read_to_string(list(name)).unwrap();
        let kept: Vec<&str> = kept.lines().filter(|line| object(line) != unseen).collect();
        fs::write(list(name), kept.join("\n")).unwrap();
    }
    let (all, without) = (text.lines().count(), text.lines().filter(|line| object(line) == unseen).count());
    let finished = experiment.run("out", &[]).expect_success();
    let share = without as f64 / all as f64;
    let said = format!("got {without} of {all} without (1 object: {}", unseen.rsplit_once('/').unwrap().1);
    let bound = format!("the object error of test cannot be below {:.2} %", 100.0 * share);
    for part in [&said, &bound] {
        let (told, searched) = (finished.stderr.find(part), finished.stderr.find("generation 1/"));
        assert!(told.is_some() && told < searched, "{part}: {finished}");
    }
    assert!(summary(&finished)["test_object_error"].as_f64().unwrap() >= share, "{finished}");
}

#[test]
fn clouds_that_have_changed_since_a_run_are_named_by_every_command() {
    let experiment = Experiment::with(&format!("version = 1\n[dataset]\nroot = \"data\"\n{SHORT}"));
    let data = experiment.path("data");
    run("coordinator", ["synth", &data, "--objects", "2", "--views", "8"]).expect_success();
    let (out, artefact) = (experiment.path("out"), experiment.path("artefact"));
    experiment.run("out", &[]).expect_success();
    let list = fs::read_to_string(Path::new(&data).join("train1.txt")).unwrap();
    let (first, last) = (list.lines().next().unwrap(), list.lines().next_back().unwrap());
    fs::copy(Path::new(&data).join(last), Path::new(&data).join(first)).unwrap();
    let listed: usize = ["train1", "train2", "validation", "test"]
        .iter()
        .map(|name| fs::read_to_string(Path::new(&data).join(format!("{name}.txt"))).unwrap().lines().count())
        .sum();
    let named = format!("  other bytes: 1 of {listed} clouds: {first}");
    let commands: [&[&str]; 4] = [
        &["run", &experiment.path("exp.toml"), "--out", &out, "--listen", "127.0.0.1:0"],
        &["compare", &out, "--listen", "127.0.0.1:0"],
        &["export", &out, &artefact],
        &["verify", &out],
    ];
    for command in commands {
        let refused = run("coordinator", command).expect_error();
        let told = format!("{}{}", refused.stdout, refused.stderr);
        assert!(told.contains(&named), "{command:?}: {refused}");
    }
    // A folder from before, or one whose list somebody has changed: then it is not known.
    let kept = Path::new(&out).join("clouds.tsv");
    fs::write(&kept, fs::read_to_string(&kept).unwrap().replace("train1", "train2")).unwrap();
    let refused = run("coordinator", ["export", &out, &artefact]).expect_error();
    assert!(refused.stderr.contains("which clouds differ is not known: clouds.tsv"), "{refused}");
}

#[test]
fn lists_and_manifests_lie_below_the_root_and_a_missing_one_names_its_key() {
    let experiment = Experiment::with("version = 1\n[dataset]\nroot = \"data\"\n");
    let data = experiment.path("data");
    run("coordinator", ["synth", &data, "--objects", "2", "--views", "6"]).expect_success();
    let toml = experiment.path("exp.toml");
    let lists: Vec<String> = ["train1", "train2", "validation", "test"]
        .iter()
        .map(|split| {
            let list = Path::new(&data).join(format!("{split}.txt"));
            let text = fs::read_to_string(&list).unwrap();
            fs::remove_file(list).unwrap();
            let row = |path: &str| {
                let parts: Vec<&str> = path.split('/').collect();
                format!("{path},{},{},{split}\n", parts[0], parts[1])
            };
            text.lines().map(row).collect()
        })
        .collect();
    let refused = run("coordinator", ["check", &toml]).expect_error();
    assert!(
        refused.stderr.contains("error: dataset.splits.train1: readable UTF-8 text file expected"),
        "{refused}"
    );
    assert!(refused.stderr.contains("set dataset.splits"), "{refused}");

    fs::write(
        &toml,
        "version = 1\n[dataset]\nroot = \"data\"\nlayout = \"manifest\"\nmanifest = \"clouds.csv\"\n",
    )
    .unwrap();
    let csv = format!("path,category,instance,split\n{}", lists.concat());
    fs::write(experiment.folder().join("clouds.csv"), &csv).unwrap();
    let refused = run("coordinator", ["check", &toml]).expect_error();
    assert!(
        refused.stderr.contains("error: dataset.manifest: readable UTF-8 text file expected"),
        "{refused}"
    );
    assert!(refused.stderr.contains("starts at dataset.root"), "{refused}");
    fs::rename(experiment.folder().join("clouds.csv"), Path::new(&data).join("clouds.csv")).unwrap();
    let resolved = run("coordinator", ["check", &toml]).expect_success();
    assert!(resolved.stdout.contains("manifest = \"clouds.csv\""), "{resolved}");
}

#[test]
fn a_query_that_takes_too_much_memory_ends_with_an_error() {
    let experiment =
        Experiment::new("[ga]\npopulation = 20\n[stop]\ngenerations = 3\nvalidation_patience = \"off\"\n");
    experiment.run("out", &[]).expect_success();
    // 60 to the fourth: 13 million rows.
    let tables = ["a", "b", "c", "d"].map(|name| format!("evaluations AS {name}"));
    let sql =
        format!("SELECT a.fitness, b.R1, c.R2, d.w FROM {} ORDER BY 1, 2, 3, 4", tables.join(" CROSS JOIN "));
    let refused =
        run("coordinator", ["query", &experiment.path("out"), &sql, "--memory", "200MiB"]).expect_error();
    assert!(refused.stderr.starts_with("error: --memory: at most 200.0 MiB expected, got "), "{refused}");
    assert!(refused.stdout.is_empty() && refused.stderr.lines().count() == 2, "{refused}");
    let few =
        ["query", &experiment.path("out"), "SELECT COUNT(*) AS n FROM evaluations", "--memory", "200MiB"];
    run("coordinator", few).expect_success();
}

#[test]
fn a_report_without_a_run_is_of_the_newest_and_may_be_written_here() {
    let experiment = Experiment::new("[ga]\npopulation = 4\n[stop]\ngenerations = 2\n");
    let here = |args: &[&str]| {
        let mut command = program("coordinator");
        command.current_dir(experiment.folder()).args(args);
        finish(&mut command)
    };
    let none = here(&["report", "--out", "demo.html"]).expect_error();
    assert!(none.stderr.contains("RUN: a run in results/runs expected, got none\n"), "{none}");
    here(&["run", "exp.toml", "--listen", "127.0.0.1:0"]).expect_success();
    let told = here(&["report", "--out", "demo.html"]).expect_success();
    assert!(
        told.stderr.starts_with("results/runs/short-") && told.stdout.starts_with("demo.html\n"),
        "{told}"
    );
    let page = fs::read_to_string(experiment.folder().join("demo.html")).unwrap();
    assert!(page.contains("short, seed 5"), "{told}");
    assert!(experiment.folder().join("convergence.svg").is_file(), "{told}");
}
