//! What earlier releases have left is read, or refused with what to do: samples of each of them, in `tests/testdata`.

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use cluster::journal::{Header, JournalFile};
use serde_json::json;
use tempfile::TempDir;
use toml::Table;

use crate::experiments::{digest, repository, summary};
use crate::process::{Finished, Running, finish, program};
use crate::remembering::files;

/// What the programs of a release have left, as `tests/python/upgrades.py --samples` packs it.
struct Left {
    release: String,
    folder: TempDir,
}

/// Everything that is left of every release, each in a folder of its own, beside the clouds that it was made of.
fn left() -> Vec<Left> {
    releases().iter().map(|release| Left::unpack(release)).collect()
}

fn releases() -> Vec<String> {
    let list: Table = fs::read_to_string(repository().join("tests/releases.toml")).unwrap().parse().unwrap();
    let releases = list["release"].as_array().unwrap().iter();
    releases.map(|release| release["version"].as_str().unwrap().to_owned()).collect()
}

impl Left {
    fn unpack(release: &str) -> Self {
        let folder = TempDir::new().unwrap();
        let archive = repository().join(format!("tests/testdata/{release}.tar.gz"));
        let unpacked = Command::new("tar").arg("-xzf").arg(&archive).arg("-C").arg(folder.path()).status();
        assert!(unpacked.unwrap().success(), "{}", archive.display());
        let left = Self { release: release.to_owned(), folder };
        let made = ["synth", "clouds", "--objects", "4", "--views", "4", "--seed", "7"];
        left.coordinator(made).expect_success();
        left
    }

    fn home(&self) -> PathBuf {
        self.folder.path().join(&self.release)
    }

    fn text(&self, name: &str) -> String {
        fs::read_to_string(self.home().join(name)).unwrap_or_else(|error| panic!("{name}: {error}"))
    }

    /// Runs a command of today's coordinator in the folder.
    fn coordinator<A: AsRef<OsStr>>(&self, args: impl IntoIterator<Item = A>) -> Finished {
        finish(program("coordinator").current_dir(self.home()).args(args))
    }

    fn run(&self, experiment: &str, out: &str, more: &[&str]) -> Finished {
        let args = ["run", experiment, "--out", out, "--listen", "127.0.0.1:0", "--json"];
        self.coordinator(args.iter().chain(more))
    }

    /// The digest that the release gave its finished run.
    fn digest(&self) -> String {
        results::read_run(self.home().join("finished")).unwrap().run_digest
    }
}

#[test]
fn every_release_has_samples_and_its_section_of_the_changelog_and_this_one_its_versions() {
    let changelog = fs::read_to_string(repository().join("CHANGELOG.md")).unwrap();
    let headings = changelog.lines().filter_map(|line| line.strip_prefix("## ")?.split(" – ").next());
    let mut named: Vec<&str> = headings.filter(|heading| *heading != "Unreleased").collect();
    named.reverse();
    // The commit of a release cannot name itself: the next one does.
    named.retain(|release| *release != env!("CARGO_PKG_VERSION"));
    assert_eq!(releases(), named);
    assert!(!named.is_empty());
    let page = fs::read_to_string(repository().join("docs/src/how-to/upgrade.md")).unwrap();
    let today = format!(
        "\n| {} | {} | {}.{} | ",
        env!("CARGO_PKG_VERSION"),
        descriptor::EVALUATION_VERSION,
        proto::PROTOCOL_MAJOR,
        proto::PROTOCOL_MINOR
    );
    assert!(page.contains(&today), "docs/src/how-to/upgrade.md has no row {today}");
}

#[test]
fn a_finished_run_is_verified_queried_reported_and_shown_again() {
    for left in left() {
        let expected = left.digest();
        let verified = left.coordinator(["verify", "finished", "--data", "clouds"]).expect_success();
        assert!(verified.stdout.contains(&expected), "{verified}");
        let queried = left.coordinator(["query", "finished", &left.text("query.sql"), "--format", "csv"]);
        assert_eq!(queried.expect_success().stdout, left.text("query.csv"), "{}", left.release);
        let again = left.run("finished.toml", "finished", &[]).expect_success();
        assert!(again.stderr.contains("this run is finished"), "{again}");
        assert_eq!(digest(&again), json!(expected));
        left.coordinator(["report", "finished", "--out", "report.html"]).expect_success();
        assert!(left.text("report.html").contains(&expected), "{}", left.release);
        let same = left.run("finished.toml", "today", &["--no-cache"]).expect_success();
        assert_eq!(digest(&same), json!(expected), "today's release computes other numbers");
    }
}

#[test]
fn an_unfinished_run_goes_on_to_the_digest_of_an_undisturbed_one() {
    for left in left() {
        let before = fs::read(left.home().join("unfinished/evaluations/generation-00001.parquet")).unwrap();
        let finished = left.run("unfinished.toml", "unfinished", &["--no-cache"]).expect_success();
        assert!(finished.stderr.contains("unfinished, goes on with"), "{finished}");
        let undisturbed = left.run("unfinished.toml", "undisturbed", &["--no-cache"]).expect_success();
        assert_eq!(digest(&finished), digest(&undisturbed), "{}", left.release);
        let after = fs::read(left.home().join("unfinished/evaluations/generation-00001.parquet")).unwrap();
        assert!(before == after, "{}: a generation that was whole was written again", left.release);
        left.coordinator(["verify", "unfinished"]).expect_success();
    }
}

#[test]
fn an_artefact_answers_as_it_did() {
    for left in left() {
        let recognise = ["recognise", "artefact", "artefact/example.pcd", "--json", "--top", "3"];
        let answers = left.coordinator(recognise).expect_success();
        assert_eq!(answers.stdout, left.text("answers.json"), "{}", left.release);
        assert!(!answers.stdout.is_empty());
    }
}

#[test]
fn a_cache_saves_all_that_it_saved_and_stays_as_it_is() {
    for left in left() {
        let cached = json!(left.text("cached.digest"));
        let before: Vec<_> = contents(&left.home().join("cache"));
        let run = left.run("cached.toml", "remembered", &["--cache", "cache"]).expect_success();
        assert!(!run.stderr.contains("WARN"), "{run}");
        let told = summary(&run);
        assert_eq!((&told["run_digest"], &told["evaluations_computed"]), (&cached, &json!(0)));

        // Where the coordinator remembers nothing, a worker still has all clouds prepared.
        let mut command = program("coordinator");
        command.current_dir(left.home());
        command.args(["run", "cached.toml", "--out", "prepared", "--json", "--no-cache"]);
        command.args(["--listen", "127.0.0.1:0", "--local-workers", "0"]);
        let mut coordinator = Running::spawn(&left.home(), "coordinator", command);
        let address = coordinator.join_address();
        let mut command = program("worker");
        command.current_dir(left.home());
        command.args(["--coordinator", &address, "--threads", "1", "--cache", "cache"]);
        let mut worker = Running::spawn(&left.home(), "worker", command);
        assert_eq!(digest(&coordinator.wait().expect_success()), cached);
        let worker = worker.wait().expect_success();
        let [told, nothing] = ["prepared ", "prepared 0 "].map(|text| worker.stderr.matches(text).count());
        assert!(told > 0 && told == nothing, "{worker}");
        for (path, bytes) in before {
            assert!(fs::read(&path).is_ok_and(|after| after == bytes), "{}: is changed", path.display());
        }
    }
}

/// Every file below a folder, with its bytes.
fn contents(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    files(folder).into_iter().map(|path| (path.clone(), fs::read(path).unwrap())).collect()
}

#[test]
fn entries_of_another_evaluation_version_are_neither_used_nor_removed() {
    for left in left() {
        let cache = left.home().join("cache");
        for (path, bytes) in contents(&cache) {
            fs::remove_file(&path).unwrap();
            let (path, bytes) = of_another_version(&path, &bytes);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, bytes).unwrap();
        }
        let before = contents(&cache);
        let cold = left.run("cached.toml", "cold", &["--cache", "cache"]).expect_success();
        assert!(!cold.stderr.contains("WARN"), "{cold}");
        assert_eq!(digest(&cold), json!(left.text("cached.digest")));
        assert!(summary(&cold)["evaluations_computed"].as_u64().unwrap() > 0, "{cold}");
        left.coordinator(["verify", "cold", "--cache", "cache"]).expect_success();
        for (path, bytes) in before {
            assert!(fs::read(&path).is_ok_and(|after| after == bytes), "{}: is changed", path.display());
        }
    }
}

/// Place and bytes of a sound entry as a release with the next evaluation version would have kept it: the version is part
/// of its key.
fn of_another_version(path: &Path, entry: &[u8]) -> (PathBuf, Vec<u8>) {
    const TEXTS: usize = 8 + 4 + 4 + 32 + 8 + 32; // where kind, producer and run begin
    let mut end = TEXTS;
    for _ in 0..3 {
        end += 1 + usize::from(entry[end]);
    }
    assert_eq!(blake3::hash(&entry[..end]).as_bytes(), &entry[end..end + 32], "{}", path.display());
    let mut entry = entry.to_vec();
    let version = descriptor::EVALUATION_VERSION + 1;
    entry[12..16].copy_from_slice(&version.to_le_bytes());
    let key = blake3::hash(&entry[12..48]);
    entry[16..48].copy_from_slice(key.as_bytes());
    let checksum = blake3::hash(&entry[..end]);
    entry[end..end + 32].copy_from_slice(checksum.as_bytes());
    let key = key.to_hex();
    let kind = path.ancestors().nth(2).unwrap();
    (kind.join(&key[..2]).join(key.as_str()), entry)
}

#[test]
fn an_unfinished_run_of_another_evaluation_version_is_refused_with_who_can_finish_it() {
    for left in left() {
        let journal = left.home().join("unfinished/journal.log");
        let header = JournalFile::header(&journal).unwrap();
        let next = header.evaluation_version + 1;
        fs::remove_file(&journal).unwrap();
        JournalFile::create(&journal, &Header { evaluation_version: next, ..header }).unwrap();
        let before = contents(&left.home().join("unfinished"));
        let refused = left.run("unfinished.toml", "unfinished", &[]).expect_error();
        let told = format!("is a run of evaluation version {next}, got a program of version");
        assert!(refused.stderr.contains(&told), "{refused}");
        assert!(refused.stderr.contains("\ngo on with the release that began it, "), "{refused}");
        assert!(before == contents(&left.home().join("unfinished")), "what was refused is changed");
    }
}
