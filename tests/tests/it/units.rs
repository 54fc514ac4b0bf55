//! Clouds of another unit than what they are measured against: refused, not answered.

use std::fs;
use std::path::Path;

use descriptor::cloud_file;
use descriptor::pcd::{self, DataEncoding};

use crate::experiments::{Experiment, clouds};
use crate::process::run;

const SEARCH: &str = "[ga]\npopulation = 4\n[stop]\ngenerations = 2\nvalidation_patience = \"off\"\n\
    [results]\nbaselines = false\n";

/// The clouds of all lists with coordinates a thousand times as large, in a folder of the same form.
fn in_millimetres(folder: &Path) {
    for list in ["train1.txt", "train2.txt", "validation.txt", "test.txt"] {
        let listed = fs::read_to_string(clouds().join(list)).unwrap();
        for path in listed.lines() {
            let mut cloud = cloud_file::read(&fs::read(clouds().join(path)).unwrap()).unwrap();
            cloud = cloud.in_metres(1000.0);
            let file = folder.join(path);
            fs::create_dir_all(file.parent().unwrap()).unwrap();
            fs::write(file, pcd::write(&cloud, DataEncoding::Binary)).unwrap();
        }
        fs::write(folder.join(list), listed).unwrap();
    }
}

#[test]
fn clouds_of_another_unit_are_refused_wherever_they_are_measured() {
    let experiment = Experiment::new(SEARCH);
    let [millimetres, out, artefact, new] =
        ["millimetres", "out", "artefact", "new"].map(|name| experiment.path(name));
    in_millimetres(Path::new(&millimetres));
    experiment.run("out", &[]).expect_success();
    run("coordinator", ["export", &out, &artefact]).expect_success();

    let evaluate = |more: &[&str]| {
        let lists = ["--query", "test.txt", "--database", "train1.txt"];
        let args = ["evaluate", "--data", &millimetres].into_iter().chain(lists);
        run("coordinator", args.chain(more.iter().copied()))
    };
    let refused = evaluate(&[]).expect_error();
    assert!(
        refused.stderr.starts_with("error: --unit: points 0.02 to 50 mm apart expected, got "),
        "{refused}"
    );
    assert!(refused.stderr.ends_with(" clouds\nadd --unit mm\n"), "{refused}");
    evaluate(&["--unit", "mm"]).expect_success();

    let listed = fs::read_to_string(clouds().join("test.txt")).unwrap();
    let cloud = Path::new(&millimetres).join(listed.lines().next().unwrap()).display().to_string();
    let advice = "convert it: the artefact's clouds are in m";
    let recognised = run("coordinator", ["recognise", &artefact, &cloud]).expect_error();
    assert!(recognised.stderr.contains(", as if mm were read as m\n"), "{recognised}");
    assert!(recognised.stderr.contains(advice), "{recognised}");

    let assess = ["assess", &artefact, "--data", &millimetres, "--query", "test.txt"];
    let assessed = run("coordinator", assess).expect_error();
    assert!(assessed.stderr.contains("as if mm were read as m\nchoose other lists"), "{assessed}");

    let place = Path::new(&new).join("mug/new");
    fs::create_dir_all(&place).unwrap();
    fs::copy(&cloud, place.join("new_1_1.pcd")).unwrap();
    let learned = run("coordinator", ["learn", &artefact, &new]).expect_error();
    assert!(learned.stderr.contains("as if mm were read as m\n"), "{learned}");
}
