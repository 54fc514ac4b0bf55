//! What users get wrong, and what they are told: where, what, got value, and on the next line what to do.

use std::fs;
use std::net::TcpListener;

use crate::experiments::{Experiment, clouds, run_demo, summary};
use crate::process::{Finished, finish, program, run};

/// The error's own lines.
fn message(finished: &Finished) -> &str {
    let start = finished.stderr.find("error: ").unwrap_or_else(|| panic!("{finished}"));
    finished.stderr[start..].trim_end()
}

/// An error that says `parts`, in two lines or more.
#[track_caller]
fn check(finished: Finished, parts: &[&str]) {
    let finished = finished.expect_error();
    let message = message(&finished);
    for part in parts {
        assert!(message.contains(part), "no `{part}` in: {finished}");
    }
    assert!(message.lines().count() >= 2, "no advice: {finished}");
}

#[track_caller]
fn check_toml(toml: &str, parts: &[&str]) {
    let root = clouds().display().to_string();
    let experiment = Experiment::with(&toml.replace("ROOT", &root));
    check(run("coordinator", ["check", &experiment.path("exp.toml")]), parts);
}

/// Every kind of mistake in an experiment; each message's whole text is pinned beside the code that makes it.
#[test]
fn experiments() {
    let dataset = "[dataset]\nroot = \"ROOT\"\n";
    for (toml, parts) in [
        ("version = 1\nsead = 1\n[dataset]\nroot = \"ROOT\"\n", &["sead", "seed"][..]),
        ("version = 1\n[dataset]\nroot = 5\n", &["dataset.root", "5"]),
        ("[dataset]\nroot = \"ROOT\"\n", &["version"]),
        ("version = 2\n[dataset]\nroot = \"ROOT\"\n", &["version", "2"]),
        ("version = 1\n[dataset\n", &["line 2"]),
        ("version = 1\n[dataset]\nroot = \"ROOT/nowhere\"\n", &["dataset.root", "nowhere"]),
        ("version = 1\n[dataset]\nroot = \"${DESCRY_NO_SUCH_VARIABLE}\"\n", &["DESCRY_NO_SUCH_VARIABLE"]),
    ] {
        check_toml(toml, parts);
    }
    for (section, parts) in [
        ("[ga]\npopulation = 0\n", &["ga.population", "got 0"][..]),
        ("[ga]\npopulation = 1\n", &["ga.population", "got 1"]),
        ("[ga]\nelite = 10\n", &["ga.elite", "got 10"]),
        ("[descriptor.genes]\nR1 = { min = 2.0, max = 0.5, step = 0.1 }\n", &["R1"]),
        ("[descriptor.genes]\nR1 = { min = 0.5, max = 2.5, step = 0.1 }\n", &["R2", "2.5"]),
        ("[descriptor.genes]\nshape_bins = { min = 8, max = 8, step = 0 }\n", &["shape_bins", "step"]),
        ("[descriptor.genes]\nR3 = 1\n", &["R3", "R1"]),
        ("[descriptor.genes]\nm = { min = 1, max = 32, step = 1 }\n", &["m:", "65536"]),
        ("[stop]\ngenerations = 0\n", &["stop.generations", "got 0"]),
    ] {
        check_toml(&format!("version = 1\n{dataset}{section}"), parts);
    }
}

/// A small data set of its own, in which a test spoils one thing.
struct Spoiled {
    experiment: Experiment,
}

impl Spoiled {
    fn new() -> Self {
        let experiment = Experiment::with("version = 1\n[dataset]\nroot = \"data\"\n");
        let data = experiment.path("data");
        run("coordinator", ["synth", &data, "--objects", "2", "--views", "6"]).expect_success();
        Self { experiment }
    }

    fn list(&self, name: &str) -> std::path::PathBuf {
        self.experiment.folder().join("data").join(name)
    }

    /// The first cloud of a list.
    fn cloud(&self, list: &str) -> std::path::PathBuf {
        let text = fs::read_to_string(self.list(list)).unwrap();
        self.experiment.folder().join("data").join(text.lines().next().unwrap())
    }

    #[track_caller]
    fn check(&self, parts: &[&str]) {
        check(run("coordinator", ["check", &self.experiment.path("exp.toml")]), parts);
        // A run says the same and spends no evaluation on it.
        let finished = self.experiment.run("out", &[]).expect_error();
        assert!(!finished.stderr.contains("generation 1"), "{finished}");
    }
}

#[test]
fn buckets_where_there_can_be_none() {
    let experiment = Experiment::new("");
    let shared = |url| experiment.run("out", &["--shared", url]);
    check(shared("s3://lab/descry"), &["s3://lab/descry: cannot be used", "--features s3", "file://"]);
    assert!(!experiment.folder().join("out").exists(), "nothing is made for a run that cannot begin");
    check(shared("s3://Lab"), &["shared bucket: ", "got s3://Lab"]);
    check(
        run("coordinator", ["prune", "s3://lab", "--days", "30"]),
        &["s3://lab: cannot be used", "--features s3"],
    );
    let worker = ["--coordinator", "http://127.0.0.1:1", "--shared", "s3://lab/descry"];
    check(run("worker", worker), &["--shared: a worker needs no bucket", "got s3://lab/descry"]);
}

#[test]
fn split_lists() {
    for (line, parts) in [
        ("mug/mug_1/mug_1_1_99.pcd", &["mug_1_1_99.pcd", "train1.txt"][..]),
        ("../outside.pcd", &["../outside.pcd", "train1.txt"]),
        ("/etc/passwd", &["/etc/passwd", "train1.txt"]),
        ("lonely_1_1.pcd", &["lonely_1_1.pcd", "train1.txt"]),
    ] {
        let data = Spoiled::new();
        let list = data.list("train1.txt");
        let text = fs::read_to_string(&list).unwrap();
        fs::write(&list, format!("{text}{line}\n")).unwrap();
        data.check(parts);
    }

    let data = Spoiled::new();
    let query = fs::read_to_string(data.list("train1.txt")).unwrap();
    let database = fs::read_to_string(data.list("train2.txt")).unwrap();
    let both = query.lines().next().unwrap();
    fs::write(data.list("train2.txt"), format!("{database}{both}\n")).unwrap();
    data.check(&[both, "train1", "train2"]);

    let data = Spoiled::new();
    fs::write(data.list("test.txt"), "# nothing\n").unwrap();
    data.check(&["test"]);
}

fn pcd(header: &str, data: &[u8]) -> Vec<u8> {
    [header.as_bytes(), data].concat()
}

#[test]
fn clouds_that_cannot_be_read_name_themselves_before_anything_is_spent() {
    let header = |width: &str, fields: &str, encoding: &str| {
        let names = fields.split(' ').count();
        let (size, kind, count) = (" 4".repeat(names), " F".repeat(names), " 1".repeat(names));
        format!(
            "VERSION .7\nFIELDS {fields}\nSIZE{size}\nTYPE{kind}\nCOUNT{count}\nWIDTH {width}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {width}\nDATA {encoding}\n"
        )
    };
    let rgb = "x y z rgb";
    for (content, parts) in [
        (pcd(&header("4", rgb, "binary"), &[0; 40]), &["pcd"][..]),
        (pcd(&header("99999999999999999999", rgb, "binary"), &[]), &["WIDTH"]),
        (pcd(&header("4000000000", rgb, "binary"), &[0; 64]), &["pcd"]),
        (
            pcd(
                &header("4", rgb, "binary_compressed"),
                &[8, 0, 0, 0, 64, 0, 0, 0, 255, 255, 255, 255, 255, 255, 255, 255],
            ),
            &["pcd"],
        ),
        (pcd(&header("1", "x y z", "ascii"), b"0 0 1\n"), &["colour"]),
        (b"not a cloud".to_vec(), &["pcd"]),
        (Vec::new(), &["pcd"]),
    ] {
        let data = Spoiled::new();
        let cloud = data.cloud("validation.txt");
        fs::write(&cloud, content).unwrap();
        let name = cloud.file_name().unwrap().to_str().unwrap();
        data.check(&[&[name], parts].concat());
    }
}

#[test]
fn an_unreadable_cloud_is_a_counted_skip_if_the_experiment_says_so() {
    let data = Spoiled::new();
    let cloud = data.cloud("train1.txt");
    fs::write(&cloud, "not a cloud").unwrap();
    let toml = data.experiment.path("exp.toml");
    fs::write(&toml, "version = 1\n[dataset]\nroot = \"data\"\nskip_unreadable = true\n").unwrap();
    let finished = run("coordinator", ["check", &toml]).expect_success();
    assert!(finished.stdout.contains("skipped 1"), "{finished}");
    assert!(finished.stderr.contains(cloud.file_name().unwrap().to_str().unwrap()), "{finished}");
}

#[test]
fn clouds_without_usable_points_are_skipped_and_named() {
    let header = |points: usize| {
        format!(
            "VERSION .7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\nWIDTH {points}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {points}\nDATA ascii\n"
        )
    };
    let lonely: String = (0..12).map(|i| format!("{i} 0 1 0\n")).collect();
    for (content, reason) in [
        (header(0), "fewer than 10 usable points, got 0"),
        (format!("{}{}", header(12), "nan nan nan 0\n".repeat(12)), "fewer than 10 usable points, got 0"),
        (format!("{}{lonely}", header(12)), "no keypoint with a normal"),
    ] {
        let data = Spoiled::new();
        fs::write(data.cloud("test.txt"), content).unwrap();
        let finished = run("coordinator", ["check", &data.experiment.path("exp.toml")]).expect_success();
        assert!(finished.stdout.contains("skipped 1"), "{finished}");
        assert!(finished.stderr.contains(reason), "{reason}: {finished}");

        let toml = data.experiment.path("exp.toml");
        let short = "[ga]\npopulation = 2\n[stop]\ngenerations = 1\nvalidation_patience = \"off\"\n";
        fs::write(&toml, fs::read_to_string(&toml).unwrap() + short).unwrap();
        let summary = summary(&data.experiment.run("out", &[]).expect_success());
        let listed = fs::read_to_string(data.list("test.txt")).unwrap().lines().count() as u64;
        assert_eq!(
            (summary["skipped"].as_u64(), summary["test_queries"].as_u64()),
            (Some(1), Some(listed - 1))
        );
        let table = results::read_table(data.experiment.path("out"), results::TableName::Skipped).unwrap();
        assert_eq!(table.shape().0, 1);
    }
}

#[test]
fn a_search_space_that_is_too_fine_leaves_no_folder() {
    let experiment = Experiment::new("[descriptor.genes]\nm = { min = 1, max = 32, step = 1 }\n");
    for command in ["run", "exhaust"] {
        let mut args = experiment.run_args(command, &[]);
        command.clone_into(&mut args[0]);
        check(run("coordinator", args), &["m:", "65536"]);
        assert!(!experiment.folder().join(command).exists(), "{command}");
    }
}

#[test]
fn ports_and_addresses() {
    let experiment = Experiment::new("");
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let run_with = |more: &[&str]| {
        let mut args =
            vec!["run".to_owned(), experiment.path("exp.toml"), "--out".to_owned(), experiment.path("out")];
        args.extend(more.iter().map(|&arg| arg.to_owned()));
        run("coordinator", args)
    };
    check(run_with(&["--listen", &address]), &["the port is in use", &address]);
    check(run_with(&["--listen", "0.0.0.0:0"]), &["--insecure"]);
    let finished = run_with(&["--listen", "nowhere"]).expect_error();
    assert!(finished.stderr.contains("nowhere") && finished.stderr.contains("--listen"), "{finished}");
}

/// Each is refused at once: nothing is waited for, and no memory filled.
#[test]
fn what_is_no_file_is_refused_wherever_a_text_is_read_whole() {
    let place = Experiment::with("version = 1\n[dataset]\nroot = \"ROOT\"\n");
    let (pipe, folder, data) = (place.path("pipe"), place.path("folder"), clouds().display().to_string());
    assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
    fs::create_dir(&folder).unwrap();
    // The pipe has a writer of our own, so that opening it to read would not wait, and reading would.
    let writer = fs::File::options().read(true).write(true).open(&pipe).unwrap();
    for text in [&*pipe, &*folder, "/dev/zero"] {
        let is_named = &[text][..];
        check(run("coordinator", ["check", text]), &[text, "something that is no file"]);
        check(run("coordinator", ["run", text]), &[text, "something that is no file"]);
        let evaluate = |more: &[&str]| run("coordinator", [&["evaluate", "--data", &data], more].concat());
        check(evaluate(&["--query", text, "--database", "train1.txt"]), is_named);
        check(evaluate(&["--query", "test.txt", "--database", "train1.txt", "--manifest", text]), is_named);
        check(evaluate(&["--query", "test.txt", "--database", "train1.txt", "--structure", text]), is_named);
        check(
            run(
                "coordinator",
                ["split", &data, "--out", &place.path("l"), "--protocol", "paper", "--manifest", text],
            ),
            is_named,
        );
        for (key, value) in [
            (
                "dataset.splits",
                format!("train1 = {text:?}\ntrain2 = \"a\"\nvalidation = \"a\"\ntest = \"a\""),
            ),
            ("dataset", format!("layout = \"manifest\"\nmanifest = {text:?}")),
        ] {
            let toml = if key == "dataset" {
                format!("version = 1\n[dataset]\nroot = {data:?}\n{value}\n")
            } else {
                format!("version = 1\n[dataset]\nroot = {data:?}\n[{key}]\n{value}\n")
            };
            check(run("coordinator", ["check", &Experiment::with(&toml).path("exp.toml")]), is_named);
        }
        // The files of an artefact and of `coordinator certs`.
        for file in ["descriptor.toml", "database.parquet"] {
            let artefact = Experiment::with("");
            let out = artefact.path("objects");
            run("coordinator", ["export", &run_demo().path("results/runs/demo"), &out]).expect_success();
            let file = artefact.folder().join("objects").join(file);
            fs::remove_file(&file).unwrap();
            std::os::unix::fs::symlink(text, &file).unwrap();
            check(run("coordinator", ["recognise", &out, "x.pcd"]), &[file.to_str().unwrap(), "no file"]);
        }
        for name in ["ca.pem", "cert.pem", "key.pem", "token", "deny"] {
            let experiment = Experiment::new("");
            let tls = experiment.path("tls");
            run("coordinator", ["certs", &tls]).expect_success();
            let file = experiment.folder().join("tls").join(name);
            let _ = fs::remove_file(&file);
            std::os::unix::fs::symlink(text, &file).unwrap();
            check(experiment.run("out", &["--tls", &tls]), &[name, "no file"]);
        }
    }
    drop(writer);
}

/// Points that are all alike: each of them would be looked at for each other one.
#[test]
fn clouds_whose_neighbourhoods_would_take_minutes_are_refused_by_name_and_count() {
    const POINTS: usize = 300_000;
    let header = format!(
        "VERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\nWIDTH {POINTS}\nHEIGHT 1\nPOINTS {POINTS}\nDATA binary\n"
    );
    let point = [0.1f32.to_le_bytes(), 0.2f32.to_le_bytes(), 1f32.to_le_bytes(), 0x80_40_20u32.to_le_bytes()];
    let data = Spoiled::new();
    let cloud = data.cloud("test.txt");
    fs::write(&cloud, pcd(&header, &point.as_flattened().repeat(POINTS))).unwrap();
    let name = cloud.file_name().unwrap().to_str().unwrap();
    let count = "got 90000000000, and 300000 points in one cell";
    data.check(&["dataset: clouds whose neighbourhoods", name, count]);
    let evaluate = [
        "evaluate",
        "--data",
        &data.experiment.path("data"),
        "--query",
        "test.txt",
        "--database",
        "train1.txt",
    ];
    check(run("coordinator", evaluate), &[name, count]);
    let objects = data.experiment.path("objects");
    run("coordinator", ["export", &run_demo().path("results/runs/demo"), &objects]).expect_success();
    let cloud = cloud.to_str().unwrap();
    check(run("coordinator", ["recognise", &objects, cloud]), &[cloud, count]);
}

/// Numbers of any size are told from those that are allowed, in a sentence of a length for people.
#[test]
fn numbers_beyond_every_limit() {
    let dataset = "[dataset]\nroot = \"ROOT\"\n";
    for (section, parts) in [
        ("R1 = { min = 0.5, max = 2.0, step = 1e-300 }", &["R1.step: not at least 0.0001, got 1e-300"][..]),
        ("R1 = { min = 0.5, max = 2.0, step = 0 }", &["R1.step: not at least 0.0001, got 0"]),
        ("R1 = { min = 0.5, max = 2.0, step = -0.0 }", &["R1.step: not at least 0.0001, got -0"]),
        ("R1 = { min = 0.5, max = 2.0, step = nan }", &["R1.step", "got NaN"]),
        ("R1 = { min = 0.5, max = 2.0, step = inf }", &["R1.step", "got inf"]),
        ("R1 = { min = 0.5, max = 2.0, step = 1e300 }", &["R1.step", "got 1e300\n"]),
        ("R1 = { min = 1e-300, max = 2.0, step = 0.1 }", &["R1.min", "got 1e-300\n"]),
        ("R1 = { min = 1e18, max = 2e18, step = 1 }", &["R1.min", "got 1e18\n"]),
        ("m = { min = 3, max = 9223372036854775807, step = 1 }", &["m.max", "got 9.223372036854776e18\n"]),
        ("w = 1e308", &["genes.w", "got 1e308\n"]),
    ] {
        check_toml(&format!("version = 1\n{dataset}[descriptor.genes]\n{section}\n"), parts);
    }
    let preprocess = "[preprocess]\nleaf_cm = 1e-300\n";
    check_toml(&format!("version = 1\n{dataset}{preprocess}"), &["preprocess.leaf_cm", "got 1e-300\n"]);
}

#[test]
fn result_folders() {
    let experiment = Experiment::new("");
    // A file where the folder should be; for root, permissions forbid nothing.
    fs::write(experiment.folder().join("file"), "").unwrap();
    check(experiment.run("file", &[]), &["file"]);
    check(experiment.run("file/below", &[]), &["file"]);
    // Endless nonsense where the search should be.
    fs::create_dir(experiment.folder().join("full")).unwrap();
    std::os::unix::fs::symlink("/dev/zero", experiment.folder().join("full/search.toml")).unwrap();
    check(experiment.run("full", &[]), &["search.toml", "something that is no file"]);
    fs::create_dir(experiment.folder().join("huge")).unwrap();
    let huge = fs::File::create(experiment.folder().join("huge/search.toml")).unwrap();
    huge.set_len(1 << 40).unwrap(); // sparse: takes no room
    check(experiment.run("huge", &[]), &["holds another search"]);
}

/// A limit on the size of files stands in for a disk that is full.
#[test]
fn a_full_disk_stops_the_run_with_a_message_and_leaves_nothing_half_written() {
    let experiment =
        Experiment::new("[ga]\npopulation = 6\n[stop]\ngenerations = 4\nvalidation_patience = \"off\"\n");
    let mut limited = std::process::Command::new("sh");
    limited.args(["-c", "trap '' XFSZ; ulimit -f 4; exec \"$@\"", "sh"]);
    limited.arg(program("coordinator").get_program()).args(experiment.run_args("out", &[]));
    let finished = finish(&mut limited).expect_error();
    let message = message(&finished);
    assert!(message.contains("journal.log: ") && message.lines().count() >= 2, "{finished}");
    assert!(!experiment.folder().join("out/journal.log").exists(), "{finished}");
    // With space again, the same command ends as if nothing had happened.
    experiment.run("out", &[]).expect_success();
}

#[test]
fn unknown_options_and_genes_name_the_nearest() {
    let finished = run("coordinator", ["run", "exp.toml", "--sed", "1"]).expect_error();
    assert!(finished.stderr.contains("--seed"), "{finished}");
    let finished = run("coordinator", ["chek", "exp.toml"]).expect_error();
    assert!(finished.stderr.contains("check"), "{finished}");
    let finished = run("worker", ["--coordinator", "http://127.0.0.1:1", "--thread", "1"]).expect_error();
    assert!(finished.stderr.contains("--threads"), "{finished}");
    let data = clouds().display().to_string();
    let evaluate = |set: &str| {
        run(
            "coordinator",
            ["evaluate", "--data", &data, "--query", "test.txt", "--database", "train1.txt", "--set", set],
        )
    };
    check(evaluate("shape_bin=9"), &["shape_bin", "did you mean `shape_bins`"]);
    check(evaluate("R1=wide"), &["R1", "wide"]);
    check(evaluate("R1=9"), &["R2"]);
    check(evaluate("m=3.5"), &["m", "3.5"]);
    check(evaluate("m"), &["gene=value"]);
}

#[test]
fn verify_refuses_what_is_no_finished_run() {
    let experiment = Experiment::new("");
    check(run("coordinator", ["verify", &experiment.path("nowhere")]), &["nowhere"]);
}
