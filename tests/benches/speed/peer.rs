//! The peer: the paper's pipeline as a PCL user would write it, one thread (`peers/pcl` in the shared folder).

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use tempfile::TempDir;

use tests::benches::household::Household;
use tests::benches::table::{Anchors, Samples};
use tests::experiments::repository;

/// How to get it, where it is not.
const ADVICE: &str =
    "no PCL harness: own figures only. Build it as the README of the shared folder's peers/pcl says
(Debian: libpcl-dev, cmake and g++, and libopenmpi-dev if cmake asks for MPI) and put it at target/pcl/pclref,
into PATH, or name it in DESCRY_PCLREF";

/// What one run of the harness takes, and what it finds.
#[derive(Clone, Copy, Debug)]
struct Stages {
    total: f64,
    /// Histograms and matching: what is left with the normals cached.
    cached: f64,
    /// From files to histograms.
    described: f64,
    /// Object error, per cent.
    object_error: f64,
}

/// Runs of the harness on one pair of splits.
#[derive(Debug)]
struct Matching {
    method: &'static str,
    database: PathBuf,
    queries: PathBuf,
    clouds: usize,
    runs: Vec<Stages>,
}

/// What the harness matches.
#[derive(Clone, Copy, Debug)]
pub enum Work {
    /// The 475 test clouds with the other 943.
    Test,
    /// Training set 1 with training set 2.
    Fitness,
    /// The same clouds as [`Work::Test`], with PCL's SHOTCOLOR.
    ShotColor,
    /// Twenty clouds, with PFHRGB as fast as the harness has it.
    PfhRgb,
}

impl Work {
    const ALL: [Self; 4] = [Self::Test, Self::Fitness, Self::ShotColor, Self::PfhRgb];

    /// The harness's name of the descriptor.
    fn method(self) -> &'static str {
        match self {
            Self::Test | Self::Fitness => "ours",
            Self::ShotColor => "shotcolor",
            Self::PfhRgb => "pfhfast",
        }
    }

    /// Lists of queries and database, below the clouds' folder.
    pub fn lists(self) -> [&'static [&'static str]; 2] {
        match self {
            Self::Test | Self::ShotColor => [&["test.txt"], &["train1.txt", "train2.txt", "validation.txt"]],
            Self::Fitness => [&["train1.txt"], &["train2.txt"]],
            Self::PfhRgb => {
                [&["../../peers/pcl/twenty-queries.txt"], &["../../peers/pcl/twenty-database.txt"]]
            }
        }
    }
}

/// The harness, if it is installed, with all it measured so far.
#[derive(Debug)]
pub struct Peer {
    program: Option<PathBuf>,
    root: PathBuf,
    matchings: [Matching; 4],
    /// Holds the lists.
    _folder: TempDir,
}

impl Peer {
    /// Looks for it, and says so if it is not there.
    pub fn find(household: &Household) -> Self {
        let program = program();
        match &program {
            Some(program) => println!("PCL harness: {}", program.display()),
            None => println!("{ADVICE}"),
        }
        let folder = TempDir::new().unwrap();
        let matching = |work: Work| {
            let list = |side: &str, lists: &[&str]| {
                let (path, paths) =
                    (folder.path().join(format!("{work:?}-{side}.txt")), household.listed(lists));
                fs::write(&path, paths.join("\n") + "\n").unwrap();
                (path, paths.len())
            };
            let [queries, database] = work.lists();
            let ((queries, queried), (database, entries)) =
                (list("queries", queries), list("database", database));
            Matching { method: work.method(), database, queries, clouds: entries + queried, runs: Vec::new() }
        };
        let matchings = Work::ALL.map(matching);
        Self { program, root: household.root.clone(), matchings, _folder: folder }
    }

    /// Runs the harness once more on this work, if it is there.
    pub fn run(&mut self, work: Work) {
        let Some(program) = &self.program else { return };
        let matching = &mut self.matchings[work as usize];
        let output = Command::new(program)
            .arg(&self.root)
            .args([&matching.database, &matching.queries])
            .arg(matching.method)
            .output()
            .unwrap_or_else(|error| panic!("{}: {error}", program.display()));
        let text = String::from_utf8_lossy(&output.stdout);
        let stages = stages(&text)
            .unwrap_or_else(|| panic!("{}: no seconds in its output, got {text}", program.display()));
        matching.runs.push(stages);
    }

    /// Medians over all runs on this work so far; makes the first one if there is none.
    pub fn anchors(&mut self, work: Work) -> Option<Anchors> {
        if self.matchings[work as usize].runs.is_empty() {
            self.run(work);
        }
        let runs = &self.matchings[work as usize].runs;
        let median = |value: fn(&Stages) -> f64| runs.iter().map(value).collect::<Samples>().median();
        (!runs.is_empty())
            .then(|| Anchors { scratch: median(|run| run.total), cached: median(|run| run.cached) })
    }

    /// What it takes to describe one cloud, from its file to its histograms, as far as it was run on this work.
    pub fn described(&self, work: Work) -> Option<f64> {
        let Matching { runs, clouds, .. } = &self.matchings[work as usize];
        let all = runs.iter().map(|run| run.described).collect::<Samples>();
        (!runs.is_empty()).then(|| all.median() / *clouds as f64)
    }

    /// What a whole run would take: the first preparation, fitness values, and validations, each as long as a fitness
    /// value in proportion to its clouds; all from scratch, or with the normals kept.
    pub fn search(
        &mut self,
        fitness_values: u32,
        validations: u32,
        validation_clouds: usize,
    ) -> Option<Anchors> {
        let (test, fitness) = (self.anchors(Work::Test)?, self.anchors(Work::Fitness)?);
        let share = validation_clouds as f64 / self.matchings[Work::Fitness as usize].clouds as f64;
        let times = f64::from(fitness_values) + share * f64::from(validations);
        Some(Anchors {
            scratch: test.scratch + times * fitness.scratch,
            cached: test.scratch + times * fitness.cached,
        })
    }

    /// Its object error on this work, for comparison.
    pub fn object_error(&self, work: Work) -> Option<String> {
        let run = self.matchings[work as usize].runs.first()?;
        Some(format!("PCL's object error {:.2} %", run.object_error))
    }
}

fn program() -> Option<PathBuf> {
    if let Some(named) = std::env::var_os("DESCRY_PCLREF") {
        let named = PathBuf::from(named);
        assert!(named.is_file(), "DESCRY_PCLREF: is no file, got {}\nname the harness", named.display());
        return Some(named);
    }
    let here = repository().join("target/pcl");
    let path = std::env::var_os("PATH").unwrap_or_default();
    let places = std::iter::once(here).chain(std::env::split_paths(&path));
    places.map(|folder: PathBuf| folder.join("pclref")).find(|program: &PathBuf| Path::is_file(program))
}

/// Reads its one line of output.
fn stages(text: &str) -> Option<Stages> {
    let value = |name: &str| -> Option<f64> {
        let word = text.split_whitespace().find_map(|word| word.strip_prefix(name)?.strip_prefix('='))?;
        word.trim_end_matches(['s', '%']).parse().ok()
    };
    let (describe, matching) = (value("desc")?, value("match")?);
    let total = value("total")?;
    let object_error = value("obj_err")?;
    Some(Stages { total, cached: describe + matching, described: total - matching, object_error })
}
