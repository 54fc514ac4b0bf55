//! The journal at work: entries go in without waiting, a thread commits them in groups and says how far it has come.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, mpsc};
use std::thread;
use std::time::Instant;

use tokio::sync::watch;

use super::{Entry, JournalError, JournalFile};
use crate::counters::Histogram;
use crate::lock::lock;

/// Most entries of one commit. What comes while a commit waits for the disk is the next group.
const GROUP: usize = 4096;

/// A log sequence number: stands for everything that was recorded up to it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct LogSequence(u64);

/// How far the thread has come.
#[derive(Clone, Debug, Default)]
struct Progress {
    /// Entries that are on the disk.
    durable: u64,
    failure: Option<JournalError>,
}

struct Outbox {
    entries: mpsc::Sender<Entry>,
    recorded: u64,
}

/// A journal that is written to.
pub struct Journal {
    outbox: Mutex<Outbox>,
    progress: watch::Receiver<Progress>,
    /// How long commits took.
    commits: Arc<Mutex<Histogram>>,
    /// For messages.
    path: PathBuf,
}

impl Journal {
    /// Starts the thread that writes; it ends when this is dropped and all is written.
    pub fn start(file: JournalFile) -> Result<Self, JournalError> {
        let (sender, entries) = mpsc::channel();
        let (said, progress) = watch::channel(Progress::default());
        let path = file.path().to_owned();
        let thread = thread::Builder::new().name("journal".to_owned());
        let commits = Arc::<Mutex<Histogram>>::default();
        let timed = Arc::clone(&commits);
        let started = thread.spawn(move || write(&file, &entries, &said, &timed));
        started.map_err(|error| JournalError::unusable(&path, error))?;
        Ok(Self { outbox: Mutex::new(Outbox { entries: sender, recorded: 0 }), progress, commits, path })
    }

    /// Hands an entry to the thread. It is on the disk once its sequence is durable.
    pub fn record(&self, entry: Entry) -> LogSequence {
        let mut outbox = lock(&self.outbox);
        // Nobody takes it any more once a commit has failed: then no sequence is ever durable again.
        let _ = outbox.entries.send(entry);
        outbox.recorded += 1;
        LogSequence(outbox.recorded)
    }

    /// The place after everything recorded so far.
    pub fn end(&self) -> LogSequence {
        LogSequence(lock(&self.outbox).recorded)
    }

    /// Whether everything up to the sequence is on the disk.
    pub fn is_durable(&self, sequence: LogSequence) -> bool {
        self.progress.borrow().durable >= sequence.0
    }

    /// Waits until the journal is durable up to a sequence number.
    ///
    /// # Errors
    /// Why it never will be.
    pub async fn durable(&self, sequence: LogSequence) -> Result<(), JournalError> {
        let mut progress = self.progress.clone();
        let settled = |progress: &Progress| progress.durable >= sequence.0 || progress.failure.is_some();
        match progress.wait_for(settled).await.map(|progress| progress.failure.clone()) {
            Ok(None) => Ok(()),
            Ok(Some(failure)) => Err(failure),
            Err(_) => Err(JournalError::unusable(&self.path, "the end of the thread that writes it")),
        }
    }

    /// How long each commit took, since this start.
    pub fn commits(&self) -> Histogram {
        *lock(&self.commits)
    }

    /// Entries that are on the disk since this start.
    pub fn entries(&self) -> u64 {
        self.progress.borrow().durable
    }

    /// The folder that it is in.
    pub fn directory(&self) -> Option<&Path> {
        self.path.parent()
    }

    /// Why nothing is written any more, if so.
    pub fn failure(&self) -> Option<JournalError> {
        self.progress.borrow().failure.clone()
    }
}

fn write(
    file: &JournalFile,
    entries: &mpsc::Receiver<Entry>,
    said: &watch::Sender<Progress>,
    timed: &Mutex<Histogram>,
) {
    let (mut group, mut commits) = (Vec::new(), 0u64);
    while let Ok(first) = entries.recv() {
        group.push(first);
        group.extend(entries.try_iter().take(GROUP - 1));
        let begun = Instant::now();
        if let Err(failure) = file.commit(&group) {
            said.send_modify(|progress| progress.failure = Some(failure));
            return;
        }
        commits += 1;
        said.send_modify(|progress| progress.durable += group.len() as u64);
        let seconds = begun.elapsed().as_secs_f64();
        lock(timed).observe(seconds);
        let milliseconds = seconds * 1e3;
        tracing::debug!("journal: commit {commits}, {} entries, {milliseconds:.1} ms", group.len());
        group.clear();
    }
}

/// The other end of a journal whose commits a test makes.
#[cfg(test)]
pub struct Held {
    entries: mpsc::Receiver<Entry>,
    said: watch::Sender<Progress>,
}

#[cfg(test)]
impl Held {
    /// Lets everything recorded so far be on the disk; how many entries that were.
    pub fn commit(&self) -> u64 {
        let entries = self.entries.try_iter().count() as u64;
        self.said.send_modify(|progress| progress.durable += entries);
        entries
    }

    /// Lets nothing be on the disk any more.
    pub fn fail(&self) {
        let failure = JournalError::unusable(std::path::Path::new("journal"), "no space");
        self.said.send_modify(|progress| progress.failure = Some(failure));
    }
}

#[cfg(test)]
impl Journal {
    /// A journal without a file.
    pub fn held() -> (Self, Held) {
        let (sender, entries) = mpsc::channel();
        let (said, progress) = watch::channel(Progress::default());
        let outbox = Mutex::new(Outbox { entries: sender, recorded: 0 });
        (
            Self { outbox, progress, commits: Arc::default(), path: PathBuf::from("journal") },
            Held { entries, said },
        )
    }
}
