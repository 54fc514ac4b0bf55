//! The folder of requests in a run folder: which run it is of, and what lies in it.

use std::collections::BTreeSet;
use std::fs;
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};

use cluster::journal::{JOURNAL_FILE, JournalFile};

use results::TableName;

use super::message::{Answer, MAX_BYTES, Request};
use crate::run::directory::SEARCH_FILE;
use crate::sweep::SWEEP_FILE;

/// The folder in a run folder.
const FOLDER: &str = "control";
/// Before the number of a request, …
const REQUEST: &str = "request-";
/// … before that of its answer, …
const ANSWER: &str = "answer-";
/// … and after both.
const EXTENSION: &str = ".json";
/// Requests that are taken at one look, and names that are looked at.
const MAX_AT_ONCE: usize = 32;
const MAX_NAMES: usize = 1024;

/// Why a request is not carried out.
#[derive(Debug, thiserror::Error)]
pub enum ControlError {
    /// Nothing that could be controlled.
    #[error("{folder}: holds no run\nname the folder of a run, of a sweep, of a run of a sweep, or of a grid", folder = .0.display())]
    NoRun(PathBuf),
    /// There was nobody at work, or is nobody any more.
    #[error("{folder}: no coordinator is at work on it\nlet it go on: coordinator resume {folder}", folder = .0.display())]
    Nobody(PathBuf),
    /// The same of a grid.
    #[error("{folder}: no coordinator is at work on it\nlet it go on: the same coordinator exhaust again", folder = .0.display())]
    NobodyAtGrid(PathBuf),
    /// There is nothing left to do.
    #[error("{folder}: is finished\nonly a run that goes on can be controlled", folder = .0.display())]
    Finished(PathBuf),
    /// The request itself, or the coordinator's answer.
    #[error("{0}")]
    Refused(String),
    /// The file system.
    #[error("{path}: cannot be used, got {source}\ncheck permissions and free space", path = .path.display())]
    File {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// Nobody took it.
    #[error("{folder}: no coordinator took the request within {seconds} s\nit was taken back; over a network file system, wait longer: --wait 60", folder = .folder.display())]
    NotTaken {
        /// The run folder.
        folder: PathBuf,
        /// How long was waited.
        seconds: u64,
    },
    /// Somebody took it.
    #[error("{folder}: the coordinator took the request and has not said what became of it\nits terminal says whether it was done, and so does the table events", folder = .0.display())]
    NoAnswer(PathBuf),
    /// What was answered is no answer.
    #[error("{path}: must be an answer of this release, got {what}\nuse the coordinator's release", path = .path.display())]
    Answer {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        what: String,
    },
}

/// Where requests about a run go.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Place {
    /// The folder as it was named.
    named: PathBuf,
    /// The folder of its coordinator: of the run, or of the sweep that it is of.
    pub(super) folder: PathBuf,
    /// Which of the sweep's runs it is.
    pub(super) member: Option<String>,
    /// Whether it is a grid.
    pub(super) is_grid: bool,
}

impl Place {
    /// Of the run, the sweep or the run of a sweep in a folder.
    pub(super) fn of(run: &Path) -> Result<Self, ControlError> {
        let named = run.to_owned();
        // A folder may be named by `.`, which has no parent.
        let folder = fs::canonicalize(run).map_err(|_| ControlError::NoRun(named.clone()))?;
        if folder.join(SWEEP_FILE).is_file() {
            return Ok(Self { named, folder, member: None, is_grid: false });
        }
        if !folder.join(SEARCH_FILE).is_file() {
            return Err(ControlError::NoRun(named));
        }
        let sweep = folder.parent().filter(|parent| parent.join(SWEEP_FILE).is_file());
        Ok(match (sweep, folder.file_name().and_then(|name| name.to_str())) {
            (Some(sweep), Some(name)) => {
                Self { named, folder: sweep.to_owned(), member: Some(name.to_owned()), is_grid: false }
            }
            _ => {
                let is_grid = folder.join(TableName::Cells.as_str()).is_dir();
                Self { named, folder, member: None, is_grid }
            }
        })
    }

    /// Refuses a run that nobody is at work on.
    pub(super) fn check_at_work(&self) -> Result<(), ControlError> {
        if self.is_grid {
            return self.check_at_work_on_grid();
        }
        let is_finished = |folder: &Path| folder.join("run").join("run.parquet").is_file();
        if let Some(member) = &self.member
            && is_finished(&self.folder.join(member))
        {
            return Err(ControlError::Finished(self.named.clone()));
        }
        let journal = self.folder.join(JOURNAL_FILE);
        match JournalFile::is_open(&journal) {
            // Where there are no locks, nobody knows before there is an answer.
            Ok(Some(true) | None) => Ok(()),
            _ if is_finished(&self.folder) => Err(ControlError::Finished(self.named.clone())),
            Ok(Some(false)) => Err(ControlError::Nobody(self.named.clone())),
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                Err(ControlError::Nobody(self.named.clone()))
            }
            Err(source) => Err(ControlError::File { path: journal, source }),
        }
    }

    /// The same of a grid, which has no journal: its folder is locked.
    fn check_at_work_on_grid(&self) -> Result<(), ControlError> {
        let named = || self.named.clone();
        if results::is_in_use(&self.folder) {
            return Ok(());
        }
        let is_finished = self.folder.join(TableName::Grid.as_str()).join(TableName::Grid.file()).is_file();
        Err(if is_finished { ControlError::Finished(named()) } else { ControlError::NobodyAtGrid(named()) })
    }

    /// The folder as it was named.
    pub(super) fn named(&self) -> PathBuf {
        self.named.clone()
    }

    /// Files of a new request and of its answer.
    pub(super) fn files(&self) -> [PathBuf; 2] {
        let number: u64 = rand::random();
        let folder = self.folder.join(FOLDER);
        [REQUEST, ANSWER].map(|kind| folder.join(format!("{kind}{number:016x}{EXTENSION}")))
    }
}

/// The requests to a coordinator at work.
#[derive(Clone, Debug)]
pub struct Requests {
    folder: PathBuf,
    /// Names that could not be removed: each is told once, and not carried out again and again.
    stuck: BTreeSet<String>,
}

/// A request that was taken out of the folder.
pub(super) struct Taken {
    /// What it says, and of which member; what is wrong with it.
    pub(super) request: Result<(Request, Option<String>), String>,
    /// Where the answer goes.
    pub(super) answer: AnswerFile,
}

/// The file that whoever waits for an answer looks for.
pub(super) struct AnswerFile(PathBuf);

impl Requests {
    /// The requests to the coordinator at work in this folder, which holds its journal: those that are there are of an
    /// earlier start, whose operators have been told so, and are removed.
    pub fn begin(run: &Path) -> Self {
        let requests = Self { folder: run.join(FOLDER), stuck: BTreeSet::new() };
        requests.clear(&[REQUEST, ANSWER]);
        requests
    }

    /// Removes the requests that nobody will carry out any more; answers are still to be read.
    pub(super) fn end(&self) {
        self.clear(&[REQUEST]);
    }

    /// Removes files of these kinds, and the folder if nothing else is in it.
    fn clear(&self, kinds: &[&str]) {
        if !self.is_there() {
            return;
        }
        for name in self.names() {
            if kinds.iter().any(|kind| number(&name, kind).is_some()) {
                remove(&self.folder.join(name)).unwrap_or_default(); // one that cannot be removed is not carried out
            }
        }
        atomic::remove_abandoned(&self.folder);
        let _ = fs::remove_dir(&self.folder); // something else is in it, or a request that has just come
    }

    /// Takes the requests that are there.
    pub(super) fn take(&mut self) -> Vec<Taken> {
        if !self.is_there() {
            return Vec::new();
        }
        let names: Vec<String> = self.names();
        self.stuck.retain(|name| names.contains(name));
        let mut taken = Vec::new();
        for name in names {
            let Some(number) = number(&name, REQUEST).filter(|_| !self.stuck.contains(&name)) else {
                continue;
            };
            let path = self.folder.join(&name);
            let read = read(&path);
            if read.as_ref().is_err_and(|error| error.kind() == io::ErrorKind::NotFound) {
                continue; // taken back
            }
            // First of all: what stays there would be carried out again.
            if let Err(error) = remove(&path) {
                if error.kind() != io::ErrorKind::NotFound {
                    let path = path.display();
                    tracing::warn!("{path}: cannot be removed, got {error}: this request is not carried out");
                    self.stuck.insert(name);
                }
                continue;
            }
            let unreadable = |error| format!("request: cannot be read, got {error}\nuse coordinator control");
            let request = read.map_err(unreadable).and_then(|bytes| Request::decode(&bytes));
            let answer = self.folder.join(format!("{ANSWER}{number}{EXTENSION}"));
            taken.push(Taken { request, answer: AnswerFile(answer) });
            if taken.len() == MAX_AT_ONCE {
                break;
            }
        }
        taken
    }

    /// Whether there is a folder, and no link to somewhere else.
    fn is_there(&self) -> bool {
        fs::symlink_metadata(&self.folder).is_ok_and(|folder| folder.is_dir())
    }

    fn names(&self) -> Vec<String> {
        let entries = fs::read_dir(&self.folder).into_iter().flatten().flatten();
        entries.take(MAX_NAMES).filter_map(|entry| entry.file_name().into_string().ok()).collect()
    }
}

impl AnswerFile {
    /// Tells whoever waits what became of the request. They may be gone. Blocks.
    pub(super) fn send(&self, answer: &Answer) {
        if let Err(error) = atomic::write(&self.0, &answer.encode()) {
            tracing::warn!("{}: cannot be written, got {error}", self.0.display());
        }
    }
}

/// The number in the name of a file of this kind.
fn number<'a>(name: &'a str, kind: &str) -> Option<&'a str> {
    let number = name.strip_prefix(kind)?.strip_suffix(EXTENSION)?;
    (number.len() == 16 && number.bytes().all(|byte| byte.is_ascii_hexdigit())).then_some(number)
}

/// The bytes of a file, if they are not too many.
pub(super) fn read(path: &Path) -> io::Result<Vec<u8>> {
    if !fs::symlink_metadata(path)?.is_file() {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, "something that is no file")); // a pipe would be waited for
    }
    let mut bytes = Vec::new();
    fs::File::open(path)?.take(MAX_BYTES + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > MAX_BYTES {
        return Err(io::Error::new(io::ErrorKind::FileTooLarge, format!("more than {MAX_BYTES} bytes")));
    }
    Ok(bytes)
}

/// Removes a file, or an empty folder that has its name.
fn remove(path: &Path) -> io::Result<()> {
    fs::remove_file(path).or_else(|error| fs::remove_dir(path).map_err(|_| error))
}

#[cfg(test)]
mod tests {
    use cluster::events::ControlAction;

    use super::*;

    fn request() -> Request {
        Request { action: ControlAction::Pause, reason: "lunch".to_owned(), by: "jo@lab".to_owned() }
    }

    /// A folder with a request folder, and what writes into it.
    fn folder() -> (tempfile::TempDir, impl Fn(&str, &[u8])) {
        let folder = tempfile::tempdir().unwrap();
        let control = folder.path().join(FOLDER);
        fs::create_dir(&control).unwrap();
        (folder, move |name: &str, bytes: &[u8]| fs::write(control.join(name), bytes).unwrap())
    }

    fn names(folder: &Path) -> BTreeSet<String> {
        let entries = fs::read_dir(folder.join(FOLDER)).unwrap();
        entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect()
    }

    #[test]
    fn what_an_earlier_start_has_left_is_removed_and_what_is_of_others_stays() {
        let (folder, write) = folder();
        write("request-0123456789abcdef.json", &request().encode(None));
        write("answer-0123456789abcdef.json", b"{}");
        assert!(Requests::begin(folder.path()).take().is_empty());
        assert!(!folder.path().join(FOLDER).exists());
        fs::create_dir(folder.path().join(FOLDER)).unwrap();
        write("request-0123456789abcdef.json", &request().encode(None));
        write("notes.txt", b"mine");
        Requests::begin(folder.path());
        assert_eq!(names(folder.path()), ["notes.txt".to_owned()].into());
    }

    #[test]
    fn each_request_is_taken_once_and_a_bad_one_is_answered_with_an_error() {
        let (folder, write) = folder();
        let mut requests = Requests { folder: folder.path().join(FOLDER), stuck: BTreeSet::new() };
        write("request-000000000000000a.json", &request().encode(Some("seed-1")));
        write("request-000000000000000b.json", b"{");
        write("request-000000000000000c.json", &vec![b' '; MAX_BYTES as usize + 1]);
        write("request-xyz.json", b"{}");
        write("notes.txt", b"mine");
        fs::create_dir(folder.path().join(FOLDER).join("request-000000000000000d.json")).unwrap();
        std::os::unix::fs::symlink(
            "/dev/zero",
            folder.path().join(FOLDER).join("request-000000000000000e.json"),
        )
        .unwrap();
        let taken = requests.take();
        let good = taken.iter().filter_map(|taken| taken.request.as_ref().ok());
        assert_eq!(good.collect::<Vec<_>>(), [&(request(), Some("seed-1".to_owned()))]);
        let bad: Vec<&String> = taken.iter().filter_map(|taken| taken.request.as_ref().err()).collect();
        assert_eq!(bad.len(), 4, "{bad:?}");
        assert!(bad.iter().any(|error| error.contains("got more than 8192 bytes")), "{bad:?}");
        taken.iter().for_each(|taken| taken.answer.send(&Answer::Error("no".to_owned())));
        assert!(requests.take().is_empty());
        let left = names(folder.path());
        assert_eq!(left.iter().filter(|name| name.starts_with(ANSWER)).count(), 5, "{left:?}");
        let answer = folder.path().join(FOLDER).join("answer-000000000000000a.json");
        assert_eq!(Answer::decode(&read(&answer).unwrap()), Ok(Answer::Error("no".to_owned())));
        write("request-000000000000000a.json", &request().encode(None));
        requests.end();
        assert_eq!(names(folder.path()), left);
    }

    #[test]
    fn a_request_that_cannot_be_removed_is_not_carried_out() {
        let (folder, _) = folder();
        let mut requests = Requests { folder: folder.path().join(FOLDER), stuck: BTreeSet::new() };
        // Not even root can remove it by unlink, nor as a folder that is not empty.
        let path = folder.path().join(FOLDER).join("request-000000000000000a.json");
        fs::create_dir_all(path.join("inside")).unwrap();
        for _ in 0..2 {
            assert!(requests.take().is_empty());
        }
        assert_eq!(requests.stuck.len(), 1);
        fs::remove_dir_all(path).unwrap();
        requests.take();
        assert!(requests.stuck.is_empty());
    }

    #[test]
    fn a_folder_that_is_a_link_is_none() {
        let (elsewhere, write) = folder();
        write("request-000000000000000a.json", &request().encode(None));
        let folder = tempfile::tempdir().unwrap();
        std::os::unix::fs::symlink(elsewhere.path().join(FOLDER), folder.path().join(FOLDER)).unwrap();
        assert!(Requests::begin(folder.path()).take().is_empty());
        assert_eq!(names(elsewhere.path()).len(), 1);
    }

    #[test]
    fn a_run_a_sweep_and_a_run_of_a_sweep_are_told_apart() {
        let folder = tempfile::tempdir().unwrap();
        let root = fs::canonicalize(folder.path()).unwrap();
        let [sweep, member, run] = ["sweep", "sweep/seed-1", "run"].map(|name| root.join(name));
        [&sweep, &member, &run].iter().for_each(|folder| fs::create_dir_all(folder).unwrap());
        fs::write(sweep.join(SWEEP_FILE), "").unwrap();
        assert!(matches!(Place::of(&run), Err(ControlError::NoRun(_))));
        assert!(matches!(Place::of(&root.join("none")), Err(ControlError::NoRun(_))));
        [&sweep, &member, &run].iter().for_each(|folder| fs::write(folder.join(SEARCH_FILE), "").unwrap());
        for (named, folder, of) in
            [(&sweep, &sweep, None), (&member, &sweep, Some("seed-1")), (&run, &run, None)]
        {
            let place = Place::of(named).unwrap();
            assert_eq!((&place.folder, place.member.as_deref()), (folder, of));
            assert!(matches!(place.check_at_work(), Err(ControlError::Nobody(_))));
        }
        fs::create_dir(run.join("run")).unwrap();
        fs::write(run.join("run/run.parquet"), "").unwrap();
        assert!(matches!(Place::of(&run).unwrap().check_at_work(), Err(ControlError::Finished(_))));
    }
}
