//! The same points give the same answers whatever the format of their files.

use std::fs;
use std::path::Path;
use std::process::Command;

use descriptor::pcd;
use results::{EvaluationRow, read_evaluations};
use serde_json::Value;
use tests::ply_files::PlyFormat;

use crate::experiments::{Experiment, clouds, repository};
use crate::process::{Finished, finish, run};

/// Calls `each` with the clouds below a folder, by path, and copies the lists with other endings of their names.
fn convert(to: &Path, mut each: impl FnMut(usize, &Path, &Path)) {
    let mut folders = vec![clouds().to_owned()];
    let mut files = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() { folders.push(path) } else { files.push(path) }
        }
    }
    files.sort();
    for (number, file) in files.iter().enumerate() {
        let target = to.join(file.strip_prefix(clouds()).unwrap());
        fs::create_dir_all(target.parent().unwrap()).unwrap();
        match file.extension().and_then(|extension| extension.to_str()) {
            Some("pcd") => each(number, file, &target.with_extension("ply")),
            Some("txt") => {
                fs::write(target, fs::read_to_string(file).unwrap().replace(".pcd", ".ply")).unwrap()
            }
            _ => {}
        }
    }
}

/// What `evaluate --nearest` says of a data set, in the names of the PCD files.
fn nearest(data: &Path) -> String {
    let folder = tempfile::tempdir().unwrap();
    let (out, data) = (folder.path().join("nearest.txt").display().to_string(), data.display().to_string());
    let args = ["evaluate", "--data", &data, "--query", "test.txt", "--database", "train1.txt", "train2.txt"];
    run("coordinator", args.into_iter().chain(["--nearest", &out])).expect_success();
    fs::read_to_string(out).unwrap().replace(".ply", ".pcd")
}

/// What was counted of every individual of a run.
fn counts(run: &str) -> Vec<String> {
    let told = |row: EvaluationRow| format!("{} {} {:?}", row.generation, row.individual, row.counts);
    read_evaluations(run).unwrap().into_iter().map(told).collect()
}

#[test]
fn ply_files_are_searched_exported_and_recognised_as_pcd_files_are() {
    const FORMATS: [PlyFormat; 3] = [PlyFormat::Ascii, PlyFormat::LittleEndian, PlyFormat::BigEndian];
    let search = "[ga]\npopulation = 4\n[stop]\ngenerations = 2\n[results]\nbaselines = false\n";
    let of_pcd = Experiment::new(search);
    let ply = of_pcd.folder().join("ply");
    convert(&ply, |number, from, to| {
        let cloud = pcd::read(&fs::read(from).unwrap()).unwrap();
        fs::write(to, FORMATS[number % 3].write(&cloud)).unwrap();
    });
    assert_eq!(nearest(&ply), nearest(clouds()));

    let toml =
        format!("version = 1\nname = \"short\"\nseed = 5\n[dataset]\nroot = \"{}\"\n{search}", ply.display());
    let of_ply = Experiment::with(&toml);
    let mut answers = Vec::new();
    for (experiment, data, ending) in [(&of_pcd, clouds(), "pcd"), (&of_ply, &*ply, "ply")] {
        experiment.run("out", &[]).expect_success();
        let (out, artefact) = (experiment.path("out"), experiment.path("artefact"));
        run("coordinator", ["export", &out, &artefact]).expect_success();
        let example = fs::read(format!("{artefact}/example.pcd")).unwrap();
        assert!(pcd::read(&example).is_ok(), "an example is PCD, as its name says");
        let test = fs::read_to_string(data.join("test.txt")).unwrap();
        let query = data.join(test.lines().next().unwrap()).display().to_string();
        assert!(query.ends_with(ending));
        let answer = run("coordinator", ["recognise", &artefact, &query, "--json"]).expect_success();
        let mut answer: Value = serde_json::from_str(&answer.stdout).unwrap();
        // Everything but the query's own path.
        let text = |answer: &Value| answer.to_string().replace(".ply", ".pcd");
        let told = ["predicted_instance", "nearest_cloud", "distance", "runner_up_distance"];
        answers.push(told.map(|key| text(&answer[key].take())));
    }
    assert_eq!(answers[0], answers[1]);
    assert!(answers[0].iter().all(|answer| answer != "null"), "{answers:?}");
    let expected = counts(&of_pcd.path("out"));
    assert_eq!(counts(&of_ply.path("out")), expected);
    assert_eq!(expected.len(), 8);
}

fn python(args: &[&str]) -> Finished {
    finish(Command::new("python3").args(args))
}

/// Whether Python has some modules, which it must have where that is required.
fn can_import(modules: &str) -> bool {
    let is_there = python(&["-c", &format!("import {modules}")]).status.success();
    let required = std::env::var_os("DESCRY_REQUIRE_NUMPY").is_some_and(|value| value == "1");
    assert!(is_there || !required, "python3 cannot import {modules}");
    if !is_there {
        eprintln!("SKIPPED: python3 cannot import {modules}");
    }
    is_there
}

/// Against files that another program has written.
#[test]
fn files_of_plyfile_give_the_same_answers() {
    if !can_import("numpy, plyfile") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let script = repository().join("tests/python/ply_clouds.py").display().to_string();
    let data = clouds().display().to_string();
    python(&["-B", &script, &data, &folder.path().display().to_string()]).expect_success();
    assert_eq!(nearest(folder.path()), nearest(clouds()));
}

/// Against images, and their points as PCD, that another program has made.
#[test]
fn images_give_the_answers_of_their_points() {
    if !can_import("numpy, PIL") {
        return;
    }
    let search = "[ga]\npopulation = 4\n[stop]\ngenerations = 2\n[results]\nbaselines = false\n";
    let folder = Experiment::new(search);
    let script = repository().join("tests/python/rgbd_images.py").display().to_string();
    let data = clouds().display().to_string();
    python(&["-B", &script, &data, &folder.path("images")]).expect_success();
    let layouts = [
        ("crops", "_crop.png", "layout = \"uw\""),
        ("crops-pcd", ".pcd", "layout = \"uw\""),
        ("scenes", ".png", "layout = \"bop\""),
        ("scenes-pcd", ".pcd", "layout = \"manifest\"\nmanifest = \"clouds.csv\""),
    ];
    let mut told = Vec::new();
    for (name, ending, layout) in layouts {
        let root = folder.path(&format!("images/{name}"));
        let toml = format!(
            "version = 1\nname = \"short\"\nseed = 5\n[dataset]\nroot = \"{root}\"\n{layout}\n\
             splits = {{ train1 = \"train1.txt\", train2 = \"train2.txt\", validation = \"validation.txt\", test = \"test.txt\" }}\n\
             {search}"
        );
        let experiment = Experiment::with(&toml);
        experiment.run("out", &[]).expect_success();
        let (out, artefact) = (experiment.path("out"), experiment.path("artefact"));
        run("coordinator", ["export", &out, &artefact]).expect_success();
        let test = fs::read_to_string(format!("{root}/test.txt")).unwrap();
        let queries: Vec<String> = test.lines().take(5).map(|line| format!("{root}/{line}")).collect();
        let args = ["recognise", &artefact, "--json"].into_iter().chain(queries.iter().map(String::as_str));
        let answers = run("coordinator", args).expect_success().stdout;
        let answers: Vec<String> = answers
            .lines()
            .map(|line| {
                let mut answer: Value = serde_json::from_str(line).unwrap();
                ["predicted_instance", "nearest_cloud", "distance", "runner_up_distance"]
                    .map(|key| answer[key].take().to_string().replace(&format!("{ending}\""), "\""))
                    .join(" ")
            })
            .collect();
        assert_eq!(answers.len(), 5);
        told.push((answers, counts(&out)));
    }
    let [crops, crops_pcd, scenes, scenes_pcd] = &told[..] else { panic!("four data sets") };
    assert_eq!(crops, crops_pcd);
    assert_eq!(scenes, scenes_pcd);
    assert_ne!(crops, scenes);
    assert!(crops.0.iter().all(|answer| !answer.contains("null")), "{crops:?}");
}
