//! Vectors and distances that another program has computed: the same answers as by brute force, kept by later
//! comparisons, and what files are refused.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use descriptor::pcd;
use results::{
    ComparedRow, TableName, read_answers, read_comparison, read_table, write_distances, write_vectors,
};
use serde_json::Value;

use crate::experiments::{Experiment, clouds, copy_folder, repository, run_demo, summary};
use crate::process::{Finished, finish, run};

const SEARCH: &str = "[ga]\npopulation = 4\n[stop]\ngenerations = 2\nvalidation_patience = \"off\"\n\
    [results]\nbaselines = false\n";

fn compare(out: &str, more: &[&str]) -> Finished {
    let args = ["compare", out, "--listen", "127.0.0.1:0", "--no-times", "--json", "--descriptor", "evolved"];
    run("coordinator", args.into_iter().chain(more.iter().copied()))
}

fn lists(names: &[&str]) -> Vec<String> {
    let list = |name: &&str| fs::read_to_string(clouds().join(format!("{name}.txt"))).unwrap();
    names.iter().map(list).collect::<String>().lines().map(str::to_owned).collect()
}

/// Shares of the points in each of 64 boxes of the colour cube.
fn colours(path: &str) -> Vec<f32> {
    let cloud = pcd::read(&fs::read(clouds().join(path)).unwrap()).unwrap();
    let mut counts = vec![0.0f32; 64];
    for [red, green, blue] in cloud.colours.unwrap() {
        counts[usize::from(red / 64) * 16 + usize::from(green / 64) * 4 + usize::from(blue / 64)] += 1.0;
    }
    counts.iter().map(|count| count / cloud.points.len() as f32).collect()
}

/// The object that a path names.
fn object(path: &str) -> &str {
    path.split('/').nth(1).unwrap()
}

type Metric = fn(&[f32], &[f32]) -> f64;

fn sum(a: &[f32], b: &[f32], term: impl Fn(f64, f64) -> f64) -> f64 {
    let mut sum = 0.0;
    for (a, b) in a.iter().zip(b) {
        sum += term(f64::from(*a), f64::from(*b));
    }
    sum
}

/// The metrics by their definitions.
const METRICS: [(&str, Metric); 4] = [
    ("l2", |a, b| sum(a, b, |a, b| (a - b) * (a - b)).sqrt()),
    ("l1", |a, b| sum(a, b, |a, b| (a - b).abs())),
    ("cosine", |a, b| {
        let length = |of: &[f32]| sum(of, of, |a, b| a * b).sqrt();
        1.0 - sum(a, b, |a, b| a * b) / (length(a) * length(b))
    }),
    ("chi2", |a, b| sum(a, b, |a, b| if a + b == 0.0 { 0.0 } else { (a - b) * (a - b) / (2.0 * (a + b)) })),
];

/// A finished run, and what the program elsewhere makes of its clouds.
struct Elsewhere {
    experiment: Experiment,
    out: String,
    queries: Vec<String>,
    database: Vec<String>,
    vectors: BTreeMap<String, Vec<f32>>,
}

impl Elsewhere {
    fn new() -> Self {
        let experiment = Experiment::new(SEARCH);
        experiment.run("out", &[]).expect_success();
        let out = experiment.path("out");
        let (queries, database) = (lists(&["test"]), lists(&["train1", "train2", "validation"]));
        let all = queries.iter().chain(&database);
        let vectors = all.map(|path| (path.clone(), colours(path))).collect();
        Self { experiment, out, queries, database, vectors }
    }

    fn file(&self, name: &str) -> String {
        self.experiment.path(name)
    }

    /// Writes the vectors of all clouds, as `change` leaves them, in the order of their paths.
    fn write(&self, name: &str, change: impl Fn(&mut BTreeMap<String, Vec<f32>>)) -> String {
        let mut vectors = self.vectors.clone();
        change(&mut vectors);
        let rows: Vec<(&str, Vec<f32>)> =
            vectors.iter().map(|(path, values)| (path.as_str(), values.clone())).collect();
        write_vectors(Path::new(&self.file(name)), &rows).unwrap();
        self.file(name)
    }

    /// Of each query the nearest cloud, the first on ties.
    fn nearest(&self, metric: Metric) -> Vec<&str> {
        let of = |query: &String| {
            let mut best: Option<(f64, &str)> = None;
            for cloud in &self.database {
                let distance = metric(&self.vectors[query], &self.vectors[cloud]);
                if best.is_none_or(|(least, _)| distance < least) {
                    best = Some((distance, cloud));
                }
            }
            best.unwrap().1
        };
        self.queries.iter().map(of).collect()
    }

    fn row(&self, label: &str) -> ComparedRow {
        let rows = read_comparison(&self.out).unwrap();
        rows.into_iter().find(|row| row.descriptor == label).unwrap()
    }

    /// What the answers of a descriptor name as nearest.
    fn answered(&self, label: &str) -> Vec<String> {
        let answers = read_answers(&self.out, label).unwrap();
        assert!(answers.iter().map(|answer| &answer.cloud).eq(&self.queries));
        answers.into_iter().map(|answer| answer.nearest_cloud).collect()
    }

    fn looks(&self) -> usize {
        read_table(&self.out, TableName::Looks).unwrap().height()
    }
}

fn told<'a>(comparison: &'a Value, label: &str) -> &'a Value {
    let rows = comparison["descriptors"].as_array().unwrap();
    rows.iter().find(|row| row["descriptor"] == label).unwrap()
}

#[test]
fn vectors_are_recognised_as_by_brute_force_under_every_metric() {
    let elsewhere = Elsewhere::new();
    let file = elsewhere.write("colours.parquet", |_| ());
    let digest = blake3::hash(&fs::read(&file).unwrap()).to_hex().to_string();
    for (name, metric) in METRICS {
        let given = format!("colours={file}");
        let args = ["--foreign", &given, "--foreign-metric", name, "--replace"];
        let looked = elsewhere.looks();
        let comparison = summary(&compare(&elsewhere.out, &args).expect_success());
        let expected = elsewhere.nearest(metric);
        assert_eq!(elsewhere.answered("colours"), expected, "{name}");
        let wrong = elsewhere.queries.iter().zip(&expected).filter(|(a, b)| object(a) != object(b)).count();
        let row = elsewhere.row("colours");
        assert_eq!(row.counts.queries - row.counts.object_correct, wrong as u32);
        assert_eq!((row.kind.as_str(), row.distance.as_str()), ("foreign", name));
        assert_eq!(row.parameters, format!("64 values a cloud from the file {}", &digest[..12]));
        assert_eq!((row.file_digest.as_ref(), row.cloud_size), (Some(&digest), Some(64)));
        // What such a descriptor does not have is not there, instead of 0.
        assert_eq!((row.size, row.keypoints_per_cloud, row.times, row.bytes), (None, None, None, None));
        let told = told(&comparison, "colours");
        assert_eq!(told["object_wrong"], wrong);
        assert_eq!((&told["size"], &told["keypoints_per_cloud"]), (&Value::Null, &Value::Null));
        assert_eq!(comparison["pairs"].as_array().unwrap().len(), 2, "both levels");
        assert_eq!(elsewhere.looks(), looked + 1);
    }
    let frame = read_table(&elsewhere.out, TableName::Looks).unwrap();
    let last = frame.column("descriptors").unwrap().get(frame.height() - 1).unwrap();
    assert_eq!(last.get_str(), Some("evolved colours"));
    let pairs = 2 * elsewhere.queries.len() * elsewhere.database.len();
    assert_eq!(read_table(&elsewhere.out, TableName::Distances).unwrap().height(), pairs);
    let report = elsewhere.file("report.html");
    run("coordinator", ["report", &elsewhere.out, "--out", &report]).expect_success();
    assert!(fs::read_to_string(report).unwrap().contains("colours"));
}

#[test]
fn distances_give_the_answers_of_whatever_they_are_distances_of() {
    let elsewhere = Elsewhere::new();
    let (_, l1) = METRICS[1];
    let pairs = |from: &[String]| {
        let to = |one: &String| {
            let distance = |cloud: &String| l1(&elsewhere.vectors[one], &elsewhere.vectors[cloud]);
            let one = one.clone();
            elsewhere
                .database
                .iter()
                .map(move |cloud| (one.clone(), cloud.clone(), distance(cloud)))
                .collect::<Vec<_>>()
        };
        from.iter().flat_map(to).collect::<Vec<_>>()
    };
    let write = |name: &str, rows: &[(String, String, f64)]| {
        let rows: Vec<(&str, &str, f64)> =
            rows.iter().map(|(query, cloud, distance)| (query.as_str(), cloud.as_str(), *distance)).collect();
        write_distances(Path::new(&elsewhere.file(name)), &rows).unwrap();
        format!("{}={}", name.split_once('.').unwrap().0, elsewhere.file(name))
    };
    let given = write("given.parquet", &pairs(&elsewhere.queries));
    let told_of = summary(&compare(&elsewhere.out, &["--foreign", &given]).expect_success());
    assert_eq!(elsewhere.answered("given"), elsewhere.nearest(l1));
    assert_eq!(told(&told_of, "given")["distance"], "given");
    assert_eq!(told(&told_of, "given")["cloud_size"], Value::Null);

    // The run's own distances: the run's own answers.
    let frame = read_table(&elsewhere.out, TableName::Distances).unwrap();
    let number =
        |column: &str, row: usize| frame.column(column).unwrap().get(row).unwrap().extract::<f64>().unwrap();
    let of_evolved =
        |row: &usize| frame.column("descriptor").unwrap().get(*row).unwrap().get_str() == Some("evolved");
    let own = (0..frame.height()).filter(of_evolved).map(|row| {
        let [query, cloud] = ["query", "database"].map(|column| number(column, row) as usize);
        (elsewhere.queries[query].clone(), elsewhere.database[cloud].clone(), number("distance", row))
    });
    let own = write("own.parquet", &own.collect::<Vec<_>>());
    let told_of = summary(&compare(&elsewhere.out, &["--foreign", &own]).expect_success());
    assert_eq!(told(&told_of, "own")["object_error"], told(&told_of, "evolved")["object_error"]);
    assert_eq!(elsewhere.answered("own"), elsewhere.answered("evolved"));
    // What was there before is there still, and compared with it.
    assert_eq!(elsewhere.answered("given"), elsewhere.nearest(l1));
    assert_eq!(told_of["pairs"].as_array().unwrap().len(), 2 * 3);
}

#[test]
fn what_a_file_gave_stays_without_it_and_under_its_name_only() {
    let elsewhere = Elsewhere::new();
    let file = elsewhere.write("colours.parquet", |_| ());
    let given = format!("colours={file}");
    compare(&elsewhere.out, &["--foreign", &given]).expect_success();
    let (row, answers) = (elsewhere.row("colours"), elsewhere.answered("colours"));
    // The file is gone.
    fs::rename(&file, elsewhere.file("moved.parquet")).unwrap();
    let added = summary(&compare(&elsewhere.out, &["--descriptor", "paper"]).expect_success());
    assert_eq!((elsewhere.row("colours"), elsewhere.answered("colours")), (row.clone(), answers.clone()));
    let labels: Vec<&str> = added["descriptors"]
        .as_array()
        .unwrap()
        .iter()
        .map(|row| row["descriptor"].as_str().unwrap())
        .collect();
    assert_eq!(labels, ["evolved", "paper", "colours"]);
    assert_eq!(added["pairs"].as_array().unwrap().len(), 2 * 3);

    let tables = || TableName::COMPARISON.map(|table| read_table(&elsewhere.out, table).unwrap());
    let (before, looked) = (tables(), elsewhere.looks());
    let refused = |more: &[&str], what: &str| {
        let finished = compare(&elsewhere.out, more).expect_error();
        assert!(finished.stderr.contains(what), "{what}\n{finished}");
        assert_eq!(elsewhere.looks(), looked, "{what}");
        assert!(tables().iter().zip(&before).all(|(now, then)| now.equals_missing(then)), "{what}");
    };
    let other =
        elsewhere.write("other.parquet", |vectors| vectors.first_entry().unwrap().get_mut()[0] += 0.5);
    let (moved, other) = (format!("colours={}", elsewhere.file("moved.parquet")), format!("colours={other}"));
    refused(&["--foreign", &other], "table comparison: colours must be of the file ");
    refused(&["--foreign", &moved, "--foreign-metric", "l1"], "by l2 as before, got the file ");
    refused(
        &["--foreign", &moved.replace("colours", "twice"), "--foreign", &other.replace("colours", "twice")],
        "twice must be of the file ",
    );
    let structure = repository().join("experiments/descriptors/chroma.toml").display().to_string();
    refused(
        &["--structure", &format!("colours={structure}")],
        "colours must be one descriptor, got one that is computed here",
    );
    refused(
        &["--structure", &structure, "--foreign", &moved.replace("colours", "chroma")],
        "chroma must be one descriptor",
    );
    // The same file again, from elsewhere.
    compare(&elsewhere.out, &["--foreign", &moved]).expect_success();
    assert_eq!((elsewhere.row("colours"), elsewhere.answered("colours")), (row, answers));
}

#[test]
fn bad_files_and_names_are_refused_before_anybody_looks() {
    let elsewhere = Elsewhere::new();
    let file = elsewhere.write("sound.parquet", |_| ());
    let refused = |more: &[&str], what: &str| {
        let finished = compare(&elsewhere.out, more).expect_error();
        assert!(finished.stderr.contains(what), "{what}\n{finished}");
        assert_eq!(elsewhere.looks(), 1, "{what}");
        assert!(read_table(&elsewhere.out, TableName::Comparison).is_err(), "{what}");
    };
    let first = &elsewhere.queries[0];
    let bad = |name: &str, change: &dyn Fn(&mut Vec<f32>)| {
        let path = elsewhere.write(name, |vectors| change(vectors.get_mut(first).unwrap()));
        format!("bad={path}")
    };
    refused(
        &["--foreign", &bad("nan.parquet", &|values| values[3] = f32::NAN)],
        &format!("value 3 of {first} must be a finite number, got NaN"),
    );
    let negative = bad("negative.parquet", &|values| values[3] = -0.5);
    refused(&["--foreign", &negative, "--foreign-metric", "chi2"], "chi2 needs values that are not negative");
    refused(
        &["--foreign", &bad("zero.parquet", &|values| values.fill(0.0)), "--foreign-metric", "cosine"],
        "cosine needs a value other than 0",
    );
    refused(&["--foreign", &bad("short.parquet", &|values| values.truncate(9))], "as in row 0, got ");
    let missing = elsewhere.write("missing.parquet", |vectors| vectors.retain(|path, _| path != first));
    refused(&["--foreign", &format!("bad={missing}")], &format!("got none for {first}, the first of 1"));
    let unknown = elsewhere
        .write("unknown.parquet", |vectors| drop(vectors.insert("../a.pcd".to_owned(), vec![0.0; 64])));
    refused(
        &["--foreign", &format!("bad={unknown}")],
        "cloud must be a cloud of the data set, got \"../a.pcd\"",
    );
    refused(&["--foreign", "bad=/nowhere/a.parquet"], "/nowhere/a.parquet: cannot be read");
    refused(&["--foreign", &format!("bad={}", elsewhere.file("exp.toml"))], "must be a Parquet file");
    for name in ["evolved", "Hue", "a/b", "", "hue-l1", "hue-projection"] {
        refused(&["--foreign", &format!("{name}={file}")], ": name must ");
    }
    assert_eq!(compare(&elsewhere.out, &["--foreign", &file]).expect_error().status.code(), Some(2));
    assert_eq!(compare(&elsewhere.out, &["--foreign-metric", "l3"]).expect_error().status.code(), Some(2));
}

/// What the page says of two descriptors together, by its own script.
#[test]
fn the_example_of_the_page_is_compared() {
    let python = |args: &[&str], folder: &Path| {
        finish(std::process::Command::new("python3").args(args).current_dir(folder).env_remove("RUN"))
    };
    if !python(&["-c", "import polars"], repository()).status.success() {
        let required = std::env::var_os("DESCRY_REQUIRE_NUMPY").is_some_and(|value| value == "1");
        assert!(!required, "python3 cannot import polars");
        eprintln!("SKIPPED: python3 cannot import polars");
        return;
    }
    let page = fs::read_to_string(repository().join("docs/src/how-to/foreign.md")).unwrap();
    let script = page.split("```python\n").nth(2).unwrap().split("```").next().unwrap();
    let demo = Experiment::with("");
    copy_folder(run_demo().folder(), demo.folder());
    let out = demo.path("results/runs/demo");
    compare(&out, &["--descriptor", "paper"]).expect_success();
    python(&["-c", script], demo.folder()).expect_success();
    let given = format!("both={}", demo.path("both.parquet"));
    let told_of = summary(&compare(&out, &["--foreign", &given]).expect_success());
    let told = told(&told_of, "both");
    let wrong = told["object_wrong"].as_u64().unwrap();
    let said =
        format!("`--foreign both=both.parquet` has {:.2} % ({wrong} of 144)", 100.0 * wrong as f64 / 144.0);
    assert!(page.contains(&said), "{said}");
}

#[test]
fn recognisers_learn_from_vectors_and_from_distances_if_those_of_the_database_are_there() {
    let elsewhere = Elsewhere::new();
    let (_, l1) = METRICS[1];
    let vectors = format!("vectors={}", elsewhere.write("vectors.parquet", |_| ()));
    let all = ["--recogniser", "nearest", "--recogniser", "projection", "--recogniser", "kernel-ridge"];
    let given = ["--foreign", &vectors, "--foreign-metric", "l1"];
    let told_of = summary(&compare(&elsewhere.out, &[&given[..], &all].concat()).expect_success());
    let learned = ["vectors-projection", "vectors-kernel-ridge"];
    for label in learned {
        let row = told(&told_of, label);
        assert!(row["settings"].is_string() && row["database_error"].is_f64(), "{row}");
        let answers = read_answers(&elsewhere.out, label).unwrap();
        assert!(answers.iter().all(|answer| object(&answer.nearest_cloud) == answer.predicted_instance));
        let wrong = answers.iter().filter(|answer| answer.predicted_instance != answer.instance).count();
        assert_eq!(row["object_wrong"], wrong);
    }
    // Fewer values than objects are left of a projection.
    assert_eq!(told(&told_of, learned[0])["cloud_size"], 5);
    assert_eq!(told(&told_of, learned[1])["cloud_size"], 64);
    assert_eq!(elsewhere.answered("vectors"), elsewhere.nearest(l1));

    let write = |name: &str, from: &[&[String]]| {
        let mut rows: Vec<(&str, &str, f64)> = Vec::new();
        for one in from.iter().copied().flatten() {
            for cloud in &elsewhere.database {
                rows.push((one, cloud, l1(&elsewhere.vectors[one], &elsewhere.vectors[cloud])));
            }
        }
        write_distances(Path::new(&elsewhere.file(name)), &rows).unwrap();
        format!("{}={}", name.split_once('.').unwrap().0, elsewhere.file(name))
    };
    // Distances to the database are enough for the nearest cloud only, and that is said.
    let few = write("few.parquet", &[&elsewhere.queries]);
    let left_out = compare(&elsewhere.out, &[&["--foreign", &few][..], &all].concat()).expect_success();
    let line = "few-kernel-ridge: left out: kernel-ridge needs the distances among the clouds of the database, got none";
    assert!(left_out.stderr.contains(line), "{left_out}");
    let line = "few-projection: left out: projection needs vectors, got distances";
    assert!(left_out.stderr.contains(line), "{left_out}");
    let looked = elsewhere.looks();
    let refused =
        compare(&elsewhere.out, &["--foreign", &few.replace("few=", "other="), "--recogniser", "projection"]);
    assert!(
        refused.expect_error().stderr.contains("--foreign other: projection needs vectors, got distances\n")
    );
    assert_eq!(elsewhere.looks(), looked);
    // With those among the database they are as good as the vectors.
    let whole = write("whole.parquet", &[&elsewhere.queries, &elsewhere.database]);
    compare(&elsewhere.out, &["--foreign", &whole, "--recogniser", "kernel-ridge"]).expect_success();
    let [of_vectors, of_distances] = ["vectors", "whole"]
        .map(|name| read_answers(&elsewhere.out, &format!("{name}-kernel-ridge")).unwrap());
    assert_eq!(of_distances, of_vectors);
    let [of_vectors, of_distances] =
        ["vectors", "whole"].map(|name| elsewhere.row(&format!("{name}-kernel-ridge")));
    assert_eq!(of_distances.settings, of_vectors.settings);
    assert_eq!(of_distances.database_error, of_vectors.database_error);
    assert_eq!(of_distances.cloud_size, None);
}
