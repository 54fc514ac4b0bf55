//! Objects that an artefact does not know: they are told from those that it does, and can be added.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

use serde_json::Value;

use crate::experiments::{Experiment, clouds, copy_folder};
use crate::process::{Finished, PATIENCE, Running, finish, program, run};

const SEARCH: &str = "[ga]\npopulation = 4\n[stop]\ngenerations = 2\nvalidation_patience = \"off\"\n";
const METHODS: [&str; 3] = ["nearest", "projection", "kernel-ridge"];
const LISTS: [&str; 4] = ["train1.txt", "train2.txt", "validation.txt", "test.txt"];

/// A run on nine objects, beside a folder with clouds of a tenth: those of its training sequences in `new`, and a list of
/// the others.
struct Missing {
    experiment: Experiment,
    category: String,
}

/// The tenth object.
const OBJECT: &str = "own";

impl Missing {
    fn new() -> Self {
        let experiment = Experiment::with(&format!(
            "version = 1\nname = \"short\"\nseed = 5\n[dataset]\nroot = \"data\"\nlayout = \"uw\"\n{SEARCH}"
        ));
        let [data, other] = ["data", "other"].map(|name| experiment.path(name));
        run("coordinator", ["synth", &data, "--objects", "9", "--views", "12"]).expect_success();
        run("coordinator", ["synth", &other, "--objects", "2", "--views", "12", "--seed", "9"])
            .expect_success();
        let first =
            fs::read_to_string(format!("{other}/train1.txt")).unwrap().lines().next().unwrap().to_owned();
        let [category, object, _] = first.split('/').collect::<Vec<_>>()[..] else { panic!("{first}") };
        let mut listed = String::new();
        for list in LISTS {
            let list_of_all = fs::read_to_string(format!("{other}/{list}")).unwrap();
            for path in list_of_all.lines().filter(|path| path.contains(&format!("/{object}/"))) {
                let name = path.rsplit('/').next().unwrap().replace(object, OBJECT);
                let named = format!("{category}/{OBJECT}/{name}");
                let root = if list == "test.txt" { &data } else { &experiment.path("new") };
                let place = Path::new(root).join(&named);
                fs::create_dir_all(place.parent().unwrap()).unwrap();
                fs::copy(Path::new(&other).join(path), place).unwrap();
                if list == "test.txt" {
                    listed += &format!("{named}\n");
                }
            }
        }
        fs::write(format!("{data}/missing.txt"), listed).unwrap();
        experiment.run("out", &[]).expect_success();
        Self { category: category.to_owned(), experiment }
    }

    fn path(&self, name: &str) -> String {
        self.experiment.path(name)
    }

    fn export(&self, artefact: &str, more: &[&str]) -> Finished {
        let (out, artefact) = (self.path("out"), self.path(artefact));
        run("coordinator", ["export", &out, &artefact].into_iter().chain(more.iter().copied()))
    }

    fn learn(&self, artefact: &str, new: &str, more: &[&str]) -> Finished {
        let (artefact, new) = (self.path(artefact), self.path(new));
        run("coordinator", ["learn", &artefact, &new].into_iter().chain(more.iter().copied()))
    }

    fn assess(&self, artefact: &str, list: &str) -> Value {
        let (artefact, data) = (self.path(artefact), self.path("data"));
        let args = ["assess", &artefact, "--data", &data, "--query", list, "--json"];
        serde_json::from_str(&run("coordinator", args).expect_success().stdout).unwrap()
    }

    /// Answers about the clouds of a list.
    fn answers(&self, artefact: &str, list: &str, more: &[&str]) -> Vec<Value> {
        let data = self.path("data");
        let list = fs::read_to_string(format!("{data}/{list}")).unwrap();
        let mut command = program("coordinator");
        command.current_dir(&data).args(["recognise", &self.path(artefact), "--json"]).args(more);
        let answers = finish(command.args(list.lines())).expect_success();
        answers.stdout.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
    }
}

/// All files of a folder.
fn contents(folder: impl AsRef<Path>) -> Vec<(PathBuf, Vec<u8>)> {
    let mut files: Vec<PathBuf> = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files.iter().map(|file| (file.file_name().unwrap().into(), fs::read(file).unwrap())).collect()
}

#[test]
fn an_object_that_is_unknown_is_rejected_more_often_and_known_once_it_is_learned() {
    let missing = Missing::new();
    for method in METHODS {
        let exported = missing
            .export("artefact", &["--recogniser", method, "--false-rejections", "0.1"])
            .expect_success();
        assert!(exported.stdout.contains("\nreject        inside the database "), "{exported}");
        let known = missing.assess("artefact", "test.txt");
        let unknown = missing.assess("artefact", "missing.txt");
        let count = |told: &Value, key: &str| told[key].as_u64().unwrap();
        assert_eq!((count(&unknown, "known"), count(&known, "unknown")), (0, 0));
        let (of, rejected) = (count(&unknown, "unknown"), count(&unknown, "unknown_rejected"));
        let at_rate = known["curve"].as_array().unwrap().iter().find(|row| row["false_rejections"] == 0.1);
        let falsely = count(at_rate.unwrap(), "known_rejected");
        assert!(rejected * count(&known, "known") > falsely * of, "{method}: {known} {unknown}");
        assert!(known["separation"].as_f64().unwrap() > 0.5, "{method}: {known}");
        assert_eq!((count(&known, "left_out"), count(&unknown, "left_out")), (count(&known, "known"), 0));

        // What recognise says of single clouds is what was counted.
        let answers = missing.answers("artefact", "missing.txt", &[]);
        let is_unknown = |answer: &&Value| answer["unknown"] == true;
        assert_eq!(answers.iter().filter(is_unknown).count() as u64, rejected, "{method}");
        assert!(answers.iter().all(|answer| answer["known_probability"].as_f64().unwrap() <= 1.0));
        let all = missing.answers("artefact", "missing.txt", &["--accept-all"]);
        assert!(all.iter().all(|answer| answer["unknown"].is_null()), "{all:?}");

        // Learned without the run, and the same bits by any number of threads.
        let learned = missing.learn("artefact", "new", &["--layout", "uw"]).expect_success();
        assert!(learned.stdout.contains("added         8 clouds of 1 object, 1 of them new\n"), "{learned}");
        assert!(learned.stdout.contains("10 objects; before 72 of 9\n"), "{learned}");
        assert_eq!(
            learned.stdout.contains("9 values a cloud, before 8; "),
            method == "projection",
            "{learned}"
        );
        let answers = missing.answers("artefact", "missing.txt", &["--accept-all"]);
        let right = answers.iter().filter(|answer| answer["predicted_instance"] == OBJECT);
        assert!(2 * right.count() > answers.len(), "{method}: {answers:?}");
        assert!(answers.iter().any(|answer| answer["predicted_category"] == *missing.category));
        missing.export("again", &["--recogniser", method, "--false-rejections", "0.1"]).expect_success();
        let mut command = program("coordinator");
        let (again, new, out) = (missing.path("again"), missing.path("new"), missing.path("more"));
        command.env("RAYON_NUM_THREADS", "1").args(["learn", &again, &new, "--layout", "uw", "--out", &out]);
        finish(&mut command).expect_success();
        assert!(contents(&out) == contents(missing.path("artefact")), "{method}: other bytes");
        assert!(contents(&again) != contents(&out), "the first is as it was");
        let readme = fs::read_to_string(format!("{out}/README.md")).unwrap();
        assert!(readme.contains(&format!("Addition 1, clouds: 8; objects: {OBJECT}.")), "{readme}");
        assert!(readme.contains("Not measured") && readme.contains("`known_probability`"), "{readme}");
    }
    // In words; exit code 0, for it is an answer.
    missing.export("artefact", &["--false-rejections", "0.5"]).expect_success();
    let answers = missing.answers("artefact", "missing.txt", &[]);
    let unknown = answers.iter().find(|answer| answer["unknown"] == true).unwrap();
    let (artefact, cloud) = (missing.path("artefact"), unknown["cloud"].as_str().unwrap());
    let mut command = program("coordinator");
    command.current_dir(missing.path("data")).args(["recognise", &artefact, cloud]);
    let told = finish(&mut command).expect_success();
    assert!(told.stdout.starts_with(&format!("{cloud}: unknown, most like ")), "{told}");
}

#[test]
fn clouds_that_cannot_be_added_are_named_and_nothing_changes() {
    let missing = Missing::new();
    missing.export("artefact", &[]).expect_success();
    let before = contents(missing.path("artefact"));
    let refused = |args: &[&str], complaint: &str| {
        let artefact = missing.path("artefact");
        let refused = run("coordinator", [&["learn", &*artefact], args].concat()).expect_error();
        let (first, advice) =
            refused.stderr.trim_end().split_once('\n').unwrap_or_else(|| panic!("{refused}"));
        assert!(first.contains(complaint) && !advice.is_empty(), "{complaint}: {refused}");
        assert!(contents(&artefact) == before, "{complaint}: the artefact has changed");
    };
    let new = missing.path("new");
    let object = format!("{}/{OBJECT}", missing.category);
    let cloud = fs::read_dir(format!("{new}/{object}")).unwrap().next().unwrap().unwrap().path();
    let put = |folder: &str, name: &str, content: &[u8]| {
        let place = PathBuf::from(missing.path(folder)).join(name);
        fs::create_dir_all(place.parent().unwrap()).unwrap();
        fs::write(place, content).unwrap();
        missing.path(folder)
    };
    let bytes = fs::read(&cloud).unwrap();
    refused(&[&missing.path("nowhere")], "nowhere: must be a folder of clouds, got ");
    fs::create_dir(missing.path("empty")).unwrap();
    refused(
        &[&missing.path("empty")],
        "clouds at <category>/<instance>/<name>.pcd, .ply or _crop.png expected, got no files",
    );
    let broken = put("broken", "mug/mug_99/a.pcd", b"no cloud");
    refused(&[&broken], "got 1 that cannot be used, such as mug/mug_99/a.pcd: ");

    // The same content twice, among the new ones and under another name than in the artefact.
    put("twins", "mug/mug_99/a.pcd", &bytes);
    let twins = put("twins", "mug/mug_98/b.pcd", &bytes);
    refused(&[&twins], "mug/mug_99/a.pcd: content must be new, got that of mug/mug_98/b.pcd (1 such clouds)");
    let data = missing.path("data");
    let list = fs::read_to_string(format!("{data}/train1.txt")).unwrap();
    let known = list.lines().next().unwrap();
    let same = put("same", "mug/mug_99/a.pcd", &fs::read(format!("{data}/{known}")).unwrap());
    refused(&[&same], &format!("mug/mug_99/a.pcd: content must be new, got that of {known}"));
    let name = put("name", known, &bytes);
    refused(&[&name], &format!("{known}: name must be new, got that of a reference cloud"));
    let known_object = known.split('/').nth(1).unwrap();
    let moved = put("moved", &format!("teapot/{known_object}/a.pcd"), &bytes);
    refused(&[&moved], &format!("object {known_object} must be of category "));
    put("two", "mug/mug_99/a.pcd", &bytes);
    let two = put("two", "can/mug_99/b.pcd", &bytes);
    refused(&[&two], "instance of one category expected, got mug_99");
    refused(
        &[&new, "--manifest", &missing.path("none.csv")],
        "--manifest: readable UTF-8 text file expected",
    );
    refused(&[&new, "--out", &missing.path("data")], "must be a new folder or an artefact");
    let wrong = run("coordinator", ["learn", &missing.path("artefact"), &new, "--false-rejections", "2"]);
    assert_eq!(wrong.expect_error().status.code(), Some(2));

    // A damaged example is seen, too, though no answer needs it.
    let example = missing.path("artefact/example.pcd");
    fs::write(&example, b"another").unwrap();
    let damaged = missing.learn("artefact", "new", &[]).expect_error();
    assert!(damaged.stderr.contains("example.pcd: must be what the artefact was written with"), "{damaged}");
    fs::write(&example, &before.iter().find(|(name, _)| name == Path::new("example.pcd")).unwrap().1)
        .unwrap();

    // Clouds that cannot be used are skipped where others can; names may come from a manifest.
    put("new", &format!("{object}/broken.pcd"), b"no cloud");
    let manifest = missing.path("labels.csv");
    let file = cloud.strip_prefix(&new).unwrap().display();
    let rows = format!("{file},mug,mug_99,4\n{object}/broken.pcd,mug,mug_99,4\n");
    fs::write(&manifest, format!("path,category,instance,sequence\n{rows}")).unwrap();
    let out = missing.path("more");
    let learned =
        missing.learn("artefact", "new", &["--manifest", &manifest, "--out", &out]).expect_success();
    assert!(learned.stderr.contains(&format!("skipped {object}/broken.pcd: ")), "{learned}");
    assert!(learned.stdout.contains("added         1 cloud of 1 object, 1 of them new\n"), "{learned}");
    let (database, _) = artefact::read_database(format!("{out}/database.parquet")).unwrap();
    let last = database.clouds.last().unwrap();
    assert_eq!((&*last.instance, last.sequence.as_deref(), last.addition), ("mug_99", Some("4"), Some(1)));
    assert!(database.clouds[..72].iter().all(|cloud| cloud.sequence.is_some() && cloud.addition.is_none()));
    // Added once more: another addition.
    let again = put(
        "again",
        "mug/mug_99/other.pcd",
        &fs::read(format!("{data}/{}", {
            let list = fs::read_to_string(format!("{data}/missing.txt")).unwrap();
            list.lines().next().unwrap().to_owned()
        }))
        .unwrap(),
    );
    let learned = run("coordinator", ["learn", &out, &again]).expect_success();
    assert!(learned.stdout.contains("added         1 cloud of 1 object, 0 of them new\n"), "{learned}");
    let told = learned.stdout.replace("\n              ", " ");
    assert!(told.contains("sequences (one is an addition without any)"), "{learned}");
    let (database, _) = artefact::read_database(format!("{out}/database.parquet")).unwrap();
    assert_eq!(database.clouds.last().unwrap().addition, Some(2));
}

#[test]
fn what_is_too_little_to_reject_by_is_said_and_every_answer_is_believed() {
    let experiment = Experiment::with(&format!("version = 1\n[dataset]\nroot = \"data\"\n{SEARCH}"));
    let data = experiment.path("data");
    for (objects, reason) in
        [("1", "at least 3 objects"), ("2", "at least 3 objects"), ("3", "at least 20 clouds")]
    {
        let _ = fs::remove_dir_all(&data);
        let made = if objects == "1" { "2" } else { objects };
        run("coordinator", ["synth", &data, "--objects", made, "--views", "6"]).expect_success();
        for list in LISTS.iter().filter(|_| objects == "1") {
            let file = format!("{data}/{list}");
            let all = fs::read_to_string(&file).unwrap();
            let half: Vec<&str> = all.lines().take(all.lines().count() / 2).collect();
            fs::write(&file, half.join("\n") + "\n").unwrap();
        }
        let (out, artefact) = (experiment.path(objects), experiment.path("artefact"));
        experiment.run(objects, &[]).expect_success();
        let exported = run("coordinator", ["export", &out, &artefact]).expect_success();
        assert!(exported.stdout.contains("\nreject        none: database: must "), "{exported}");
        assert!(exported.stdout.replace("\n              ", " ").contains(reason), "{reason}: {exported}");
        let settings = fs::read_to_string(format!("{artefact}/descriptor.toml")).unwrap();
        assert!(settings.starts_with("version = 1\n") && !settings.contains("[reject]"), "{settings}");
        let example = format!("{artefact}/example.pcd");
        let answer = run("coordinator", ["recognise", &artefact, &example, "--json"]).expect_success();
        assert!(
            !answer.stdout.contains("unknown") && answer.stdout.contains("predicted_instance"),
            "{answer}"
        );
        let assessed = run("coordinator", ["assess", &artefact, "--data", &data, "--query", "test.txt"]);
        assert!(assessed.expect_success().stdout.contains("rejected      none: "));
    }
    // More clouds make up for it.
    let new = experiment.path("new");
    run("coordinator", ["synth", &new, "--objects", "6", "--views", "8", "--seed", "9"]).expect_success();
    let artefact = experiment.path("artefact");
    for category in
        fs::read_dir(&new).unwrap().map(|entry| entry.unwrap().path()).filter(|path| path.is_dir())
    {
        for object in fs::read_dir(&category).unwrap().map(|entry| entry.unwrap().path()) {
            // Names of their own.
            let name = format!("{}0", object.file_name().unwrap().to_str().unwrap());
            fs::rename(&object, category.join(name)).unwrap();
        }
    }
    let learned = run("coordinator", ["learn", &artefact, &new]).expect_success();
    assert!(learned.stdout.contains("of 9 objects; before "), "{learned}");
    assert!(learned.stdout.contains("reject "), "{learned}");
}

/// Whoever is killed while it learns leaves an artefact that is whole: the former one, or already the new one.
#[test]
fn an_artefact_survives_who_is_killed_while_it_learns() {
    let missing = Missing::new();
    missing.export("kept", &[]).expect_success();
    let (artefact, new, below) = (missing.path("below/artefact"), missing.path("new"), missing.path("below"));
    let learned = missing.path("learned");
    missing.learn("kept", "new", &["--out", &learned]).expect_success();
    let [former, later] = [contents(missing.path("kept")), contents(&learned)];
    let names = || -> Vec<String> {
        let entries = fs::read_dir(&below).unwrap();
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
    };
    let begun = Instant::now();
    let mut killed_half_way = 0;
    while killed_half_way < 3 {
        assert!(begun.elapsed() < PATIENCE, "never killed while it was writing");
        let _ = fs::remove_dir_all(&artefact);
        copy_folder(Path::new(&missing.path("kept")), Path::new(&artefact));
        let args = ["learn", &artefact, &new];
        let mut learning = Running::start(missing.experiment.folder(), "learn", "coordinator", args);
        while learning.is_running() && !names().iter().any(|name| name.starts_with(".tmp-")) {
            std::hint::spin_loop();
        }
        if learning.is_running() {
            learning.signal("KILL");
        }
        let left_half_made = names().iter().any(|name| name.starts_with(".tmp-"));
        killed_half_way += u32::from(learning.wait().status.code().is_none() && left_half_made);
        let found = contents(&artefact);
        assert!(found == former || found == later, "neither the former artefact nor the new one");
    }
    let _ = fs::remove_dir_all(&artefact);
    copy_folder(Path::new(&missing.path("kept")), Path::new(&artefact));
    run("coordinator", ["learn", &artefact, &new]).expect_success();
    assert!(contents(&artefact) != former);
    assert_eq!(names(), ["artefact"], "what was left half made is gone");
}

#[test]
fn lists_that_name_no_cloud_are_refused() {
    let experiment = Experiment::new(SEARCH);
    experiment.run("out", &[]).expect_success();
    let (out, artefact) = (experiment.path("out"), experiment.path("artefact"));
    run("coordinator", ["export", &out, &artefact]).expect_success();
    let data = clouds().display().to_string();
    let refused = |list: &str, complaint: &str| {
        let file = experiment.path("list.txt");
        fs::write(&file, list).unwrap();
        let args = ["assess", &artefact, "--data", &data, "--query", &file];
        let refused = run("coordinator", args).expect_error();
        assert!(refused.stderr.contains(complaint), "{complaint}: {refused}");
    };
    refused("# nothing\n", "--query: must have a usable cloud, got none");
    refused("../elsewhere.pcd\n", "path below the data root expected");
    refused("no/such/cloud.pcd\n", "cloud file expected, got no/such/cloud.pcd");
}
