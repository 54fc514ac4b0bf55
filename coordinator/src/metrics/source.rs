//! What is at work in this process, for whoever asks: nothing yet, a run or a sweep, or what the last one has left.

use std::collections::BTreeMap;
use std::fmt;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::SystemTime;

use cache::{Store, TierReads};
use cluster::Cluster;
use cluster::counters::Histogram;
use cluster::scheduler::SchedulerMetrics;
use transport::{Presigner, RefusalLog, UrlCounts};

use crate::lock::lock;

/// How far a run is.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RunState {
    /// Generations that are complete.
    pub generation: u32,
    /// The best training fitness so far, from 0 to 1; `None` before a generation is complete.
    pub best_fitness: Option<f64>,
}

/// The journal since this start.
#[derive(Clone, Copy, Debug, Default)]
pub struct JournalMetrics {
    /// How long commits took.
    pub commits: Histogram,
    /// Entries that are on the disk.
    pub entries: u64,
    /// It cannot be written any more.
    pub failed: bool,
}

/// All that is measured, at one moment.
#[derive(Clone, Debug, Default)]
pub struct Snapshot {
    /// Jobs and workers.
    pub scheduler: SchedulerMetrics,
    /// The journal.
    pub journal: JournalMetrics,
    /// Connections that were refused, by reason.
    pub refusals: BTreeMap<&'static str, u64>,
    /// Reads of this machine's disk and of the shared folder.
    pub reads: (Option<TierReads>, Option<TierReads>),
    /// URLs to the bucket that workers asked for; empty without one.
    pub urls: UrlCounts,
    /// Runs by name.
    pub runs: BTreeMap<String, RunState>,
    /// Workers are let in and given jobs.
    pub ready: bool,
}

/// Parts of a session that are measured.
struct Live {
    cluster: Arc<Cluster>,
    store: Arc<Store>,
    refusals: Option<Arc<RefusalLog>>,
    presigner: Option<Arc<Presigner>>,
}

impl Live {
    /// Why the run is about to end by a failure, in a line; `None` if it is not.
    fn unready(&self) -> Option<&'static str> {
        let journal = self.cluster.journal();
        if journal.is_some_and(|journal| journal.failure().is_some()) {
            Some("the journal cannot be written")
        } else if self.cluster.check_spilled().is_err() {
            Some("a temporary file of the run cannot be used")
        } else {
            None
        }
    }

    /// All that is measured but for runs.
    fn snapshot(&self) -> Snapshot {
        let journal = self.cluster.journal().map_or_else(JournalMetrics::default, |journal| JournalMetrics {
            commits: journal.commits(),
            entries: journal.entries(),
            failed: journal.failure().is_some(),
        });
        Snapshot {
            scheduler: self.cluster.metrics(),
            journal,
            ready: self.unready().is_none(),
            refusals: self.refusals.as_ref().map(|refusals| refusals.counts()).unwrap_or_default(),
            reads: self.store.reads(),
            urls: self.presigner.as_ref().map(|presigner| presigner.counts()).unwrap_or_default(),
            runs: BTreeMap::new(),
        }
    }
}

/// What there is to measure.
enum Subject {
    /// Nothing is at work yet.
    Preparing,
    Live(Live),
    /// As it was at its end: a scrape that comes late sees all of it.
    Ended(Box<Snapshot>),
}

struct State {
    subject: Subject,
    runs: BTreeMap<String, RunState>,
}

/// What a process has at work.
pub struct MetricsSource {
    state: Mutex<State>,
    /// When this was made: the start of the process, but for some milliseconds.
    pub started: SystemTime,
}

impl Default for MetricsSource {
    fn default() -> Self {
        let state = State { subject: Subject::Preparing, runs: BTreeMap::new() };
        Self { state: Mutex::new(state), started: SystemTime::now() }
    }
}

impl fmt::Debug for MetricsSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("MetricsSource")
    }
}

impl MetricsSource {
    /// Measures a session, which takes workers from now on, until what this returns is dropped.
    pub fn attach(
        self: &Arc<Self>,
        (cluster, store): (&Arc<Cluster>, &Arc<Store>),
        presigner: Option<Arc<Presigner>>,
        refusals: Option<Arc<RefusalLog>>,
    ) -> SessionGuard {
        let live = Live { cluster: Arc::clone(cluster), store: Arc::clone(store), refusals, presigner };
        self.state().subject = Subject::Live(live);
        SessionGuard(Arc::clone(self))
    }

    /// Where a run of this name tells how far it is.
    pub fn run(self: &Arc<Self>, name: &str) -> RunMetrics {
        self.state().runs.insert(name.to_owned(), RunState::default());
        RunMetrics { source: Arc::clone(self), name: name.to_owned() }
    }

    /// All that is measured.
    pub fn snapshot(&self) -> Snapshot {
        let state = self.state();
        let snapshot = match &state.subject {
            Subject::Preparing => Snapshot::default(),
            Subject::Live(live) => live.snapshot(),
            Subject::Ended(last) => (**last).clone(),
        };
        Snapshot { runs: state.runs.clone(), ..snapshot }
    }

    /// Takes and gives back the lock of the scheduler.
    pub fn probe(&self) {
        if let Subject::Live(live) = &self.state().subject {
            live.cluster.quarantined();
        }
    }

    /// Whether workers are let in and given jobs.
    ///
    /// # Errors
    /// Why not, in a line.
    pub fn ready(&self) -> Result<(), &'static str> {
        match &self.state().subject {
            Subject::Preparing => Err("the clouds are being read"),
            Subject::Ended(_) => Err("the run has ended"),
            Subject::Live(live) => live.unready().map_or(Ok(()), Err),
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        // Every change of it is a single assignment.
        lock(&self.state)
    }
}

/// Says that a session is measured; when it is dropped, the session has ended.
pub struct SessionGuard(Arc<MetricsSource>);

impl Drop for SessionGuard {
    fn drop(&mut self) {
        let mut state = self.0.state();
        if let Subject::Live(live) = &state.subject {
            let last = Snapshot { ready: false, ..live.snapshot() };
            state.subject = Subject::Ended(Box::new(last));
        }
    }
}

/// Where one run tells how far it is.
pub struct RunMetrics {
    source: Arc<MetricsSource>,
    name: String,
}

impl RunMetrics {
    /// The same for a member of the sweep that this is about.
    pub fn of_member(&self, name: &str) -> Self {
        self.source.state().runs.remove(&self.name); // it is no run itself
        self.source.run(name)
    }

    /// A generation is complete; the best training fitness so far is from 0 to 1.
    pub fn generation_done(&self, generation: u32, best_fitness: f64) {
        let state = RunState { generation, best_fitness: Some(best_fitness) };
        self.source.state().runs.insert(self.name.clone(), state);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn before_and_after_a_session_nobody_is_ready_and_runs_keep_what_they_told() {
        let source = Arc::new(MetricsSource::default());
        assert_eq!(source.ready(), Err("the clouds are being read"));
        let sweep = source.run("sweep");
        let members = ["seed-1", "seed-2"].map(|name| sweep.of_member(name));
        members[1].generation_done(3, 0.5);
        let runs = source.snapshot().runs;
        assert_eq!(runs["seed-1"], RunState::default());
        assert_eq!(runs["seed-2"], RunState { generation: 3, best_fitness: Some(0.5) });
        assert_eq!(runs.len(), 2, "the sweep is no run");
    }
}
