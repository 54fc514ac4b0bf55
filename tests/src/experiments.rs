//! Small experiments on synthetic clouds, each in a folder of its own.

use std::collections::BTreeMap;
use std::net::{Ipv4Addr, TcpListener};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU16, Ordering::Relaxed};
use std::{fs, iter};

use serde_json::Value;
use tempfile::TempDir;

use crate::process::{Finished, Running, program, run};

/// The root of this repository.
pub fn repository() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap()
}

/// The folder of benchmark data beside the repository, or `None` if it is not there and need not be.
pub fn shared() -> Option<PathBuf> {
    let folder =
        std::env::var_os("DESCRY_SHARED").map_or_else(|| repository().join("../shared"), PathBuf::from);
    if folder.is_dir() {
        return Some(folder);
    }
    let required = std::env::var_os("DESCRY_REQUIRE_SHARED").is_some_and(|value| value == "1");
    assert!(!required, "no benchmark data in {}", folder.display());
    eprintln!("SKIPPED: no benchmark data in {}", folder.display());
    None
}

/// A synthetic data set that all tests read: made once.
pub fn clouds() -> &'static Path {
    static DATA: OnceLock<TempDir> = OnceLock::new();
    let folder = DATA.get_or_init(|| {
        let folder = TempDir::new().unwrap();
        let data = folder.path().join("data").display().to_string();
        run("coordinator", ["synth", &data, "--objects", "6", "--views", "12", "--seed", "3"])
            .expect_success();
        folder
    });
    static ROOT: OnceLock<PathBuf> = OnceLock::new();
    ROOT.get_or_init(|| folder.path().join("data"))
}

/// A finished run of the demo in the folder `results/runs/demo`, and its clouds: made once, to be read or copied.
pub fn run_demo() -> &'static Experiment {
    static DEMO: OnceLock<Experiment> = OnceLock::new();
    DEMO.get_or_init(|| {
        let demo = Experiment::with("");
        copy_folder(&repository().join("experiments"), &demo.folder().join("experiments"));
        let toml = demo.path("experiments/demo.toml");
        let out = demo.path("results/runs/demo");
        run("coordinator", ["run", &toml, "--out", &out, "--listen", "127.0.0.1:0"]).expect_success();
        demo
    })
}

/// Copies a folder with everything in it.
pub fn copy_folder(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let target = to.join(entry.file_name());
        if entry.file_type().unwrap().is_dir() {
            copy_folder(&entry.path(), &target);
        } else {
            fs::copy(entry.path(), target).unwrap();
        }
    }
}

/// An experiment in a folder of its own.
pub struct Experiment {
    folder: TempDir,
}

impl Experiment {
    /// A short search on [`clouds`]; `more` is appended to the TOML.
    pub fn new(more: &str) -> Self {
        let root = clouds().display();
        Self::with(&format!("version = 1\nname = \"short\"\nseed = 5\n[dataset]\nroot = \"{root}\"\n{more}"))
    }

    /// Any TOML.
    pub fn with(toml: &str) -> Self {
        let folder = TempDir::new().unwrap();
        fs::write(folder.path().join("exp.toml"), toml).unwrap();
        Self { folder }
    }

    /// The folder.
    pub fn folder(&self) -> &Path {
        self.folder.path()
    }

    /// A path in the folder, as an argument.
    pub fn path(&self, name: &str) -> String {
        self.folder().join(name).display().to_string()
    }

    /// Arguments of `run` into the run folder `out` of this folder, on a free port.
    pub fn run_args(&self, out: &str, more: &[&str]) -> Vec<String> {
        let mut args = vec!["run".to_owned(), self.path("exp.toml"), "--out".to_owned(), self.path(out)];
        args.extend(["--listen", "127.0.0.1:0", "--json"].map(str::to_owned));
        args.extend(more.iter().map(|&arg| arg.to_owned()));
        args
    }

    /// Arguments of `run` at an address that stays the same for every start; nobody works but those who join.
    pub fn run_args_at(&self, out: &str, address: &str) -> Vec<String> {
        let (toml, out) = (self.path("exp.toml"), self.path(out));
        let args = ["run", &toml, "--out", &out, "--listen", address, "--local-workers", "0", "--json"];
        args.map(str::to_owned).to_vec()
    }

    /// Starts a worker of one thread that says which job it begins ([`begun`]).
    pub fn worker(&self, name: &str, address: &str) -> Running {
        let cache = self.path("cache");
        let mut command = program("worker");
        command.args(["--coordinator", address, "--name", name, "--threads", "1", "--cache", &cache]);
        command.env("DESCRY_LOG", "worker=debug");
        Running::spawn(self.folder(), name, command)
    }

    /// Runs it to its end.
    pub fn run(&self, out: &str, more: &[&str]) -> Finished {
        run("coordinator", self.run_args(out, more))
    }
}

/// The summary that `--json` printed.
#[track_caller]
pub fn summary(finished: &Finished) -> Value {
    serde_json::from_str(&finished.stdout).unwrap_or_else(|error| panic!("{error}: {finished}"))
}

/// The run digest in the summary that `--json` printed.
#[track_caller]
pub fn digest(finished: &Finished) -> Value {
    summary(finished)["run_digest"].clone()
}

/// How often a worker began each job, by its log.
pub fn begun(log: &str) -> BTreeMap<String, usize> {
    let mut begun = BTreeMap::new();
    for line in log.lines().filter(|line| line.ends_with(": begun")) {
        let (_, job) = line.split_once("job ").unwrap();
        *begun.entry(job.split(',').next().unwrap().to_owned()).or_default() += 1;
    }
    begun
}

/// An address that is free, for every start of a coordinator: the system gives ports of this range to nobody by itself.
pub fn free_address() -> String {
    static NEXT: AtomicU16 = AtomicU16::new(0);
    let is_free = |port: &u16| TcpListener::bind((Ipv4Addr::LOCALHOST, *port)).is_ok();
    let first = (std::process::id() % 10_000) as u16;
    let mut ports = iter::repeat_with(|| 20_000 + (first + NEXT.fetch_add(1, Relaxed)) % 10_000);
    let port = ports.find(is_free).expect("there is a free port");
    format!("127.0.0.1:{port}")
}
