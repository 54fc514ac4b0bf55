//! The session of a run or a sweep: it keeps a journal in their folder, goes on where an earlier start ended, and is followed
//! and controlled while it works.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Instant, SystemTime};

use cache::Store;
use cluster::scheduler::{ClientId, Provenance};
use proto::Principal;
use proto::task::DescriptorBytes;
use transport::Listener;

use crate::console::Console;
use crate::control::{Operator, Requests, resuming};
use crate::dataset::Dataset;
use crate::experiment::Experiment;
use crate::metrics::{MetricsSource, SessionGuard};
use crate::observers::event_file::EventFile;
use crate::result_cache::{CountCache, SearchCounts};
use crate::run::progress::Progress;
use crate::run::{RunError, RunOptions, Start, open_journal};
use crate::session::{Session, scale};
use crate::slurm::Scaling;

/// A session with a journal.
pub struct RecordedSession<'a> {
    /// Its cluster and workers.
    pub session: Session<'a>,
    /// When it was started.
    pub start: Start,
    /// Whether nobody was found to be wrong in earlier starts.
    pub is_trusted: bool,
    /// Whether nothing of the journal was lost: then it tells of everybody who was wrong.
    is_whole: bool,
    requests: Requests,
    experiment: &'a Experiment,
    out: &'a Path,
    options: &'a RunOptions,
}

/// What a session with a journal is brought up for.
pub struct Setup<'a> {
    /// What determines the results, and what is recorded of it.
    pub texts: (String, String),
    /// The experiment, of a sweep that of which its members are variants.
    pub experiment: &'a Experiment,
    /// Whether any fitness looks at sequences.
    pub with_sequences: bool,
    /// The clouds.
    pub dataset: &'a Dataset,
    /// The folder of the journal.
    pub out: &'a Path,
    /// Those of the runs.
    pub runs: &'a [PathBuf],
}

/// What is attached to a session while it works: the file of its events, what measures it, and the workers that Slurm is
/// asked for.
pub struct Attached {
    events: Option<EventFile>,
    measured: Option<SessionGuard>,
    scaling: Option<Scaling>,
}

/// On whose word the results of a session rest.
pub struct SessionProvenance {
    answerers: BTreeSet<Principal>,
    /// By descriptor, if others may go on with what is known of any.
    descriptors: Option<BTreeMap<DescriptorBytes, Arc<Provenance>>>,
}

impl<'a> RecordedSession<'a> {
    /// Opens the journal and brings up a session without workers, which goes on where the journal ends. `started`: now.
    ///
    /// # Errors
    /// If the journal is of something else or cannot be used, or the search space is too fine.
    pub fn open(
        setup: Setup<'a>,
        store: &Arc<Store>,
        options: &'a RunOptions,
        started: (Instant, SystemTime),
        progress: &Progress,
    ) -> Result<Self, RunError> {
        let Setup { texts, experiment, with_sequences, dataset, out, runs } = setup;
        let (header, journal, recorded) = open_journal(texts, dataset, out, started.1, runs)?;
        let requests = Requests::begin(out);
        let (is_trusted, is_whole) = (recorded.is_trusted(), recorded.repairs == 0);
        let start = Start { now: started.0, first: header.started_at, before: recorded.at_work };
        let folder = out.display();
        if recorded.starts > 1 {
            let there = recorded.accepted.len();
            progress
                .say(&format!("{folder}: unfinished, goes on with the {there} evaluations that are there"));
        } else {
            progress.say(&format!("results are written to {folder}"));
        }
        let past = ((header.session, header.secret), journal, recorded);
        let memory = options.storage.memory;
        let session =
            Session::with_journal(past, experiment, with_sequences, dataset, Arc::clone(store), memory)?;
        Ok(Self { session, start, is_trusted, is_whole, requests, experiment, out, options })
    }

    /// Lets workers in. From now on, progress follows the session, and, as long as what this returns is kept, its events are
    /// written, it is measured, and Slurm is asked for workers. Not before runs are discarded that an earlier start has
    /// finished and that cannot be trusted: those who are readmitted are quarantined no more.
    ///
    /// # Errors
    /// If a principal is to be readmitted that is not quarantined, the file of events cannot be written, or Slurm cannot be
    /// asked.
    pub async fn start(
        &mut self,
        listener: Option<Listener>,
        progress: &mut Progress,
    ) -> Result<Attached, RunError> {
        let Self { session, experiment, options, out, .. } = self;
        session.forget_quarantined(progress.console()); // of an earlier start, which may have been killed before it could
        readmit(session, &options.readmit)?;
        progress.follow(&session.cluster);
        progress.measure(options.metrics.as_ref(), out);
        let events = EventFile::open(options.events.as_deref(), &session.cluster).await?;
        let refusals = listener.as_ref().map(Listener::refusals);
        let console = progress.console();
        let scaling = scale(options.slurm.as_ref(), (experiment, out), &session.cluster, console)?;
        session.start(listener, experiment.coordinator().local_workers).await;
        let parts = (&session.cluster, &session.store);
        let attach =
            |metrics: &Arc<MetricsSource>| metrics.attach(parts, session.presigner.clone(), refusals);
        let measured = options.metrics.as_ref().map(attach);
        Ok(Attached { events, measured, scaling })
    }

    /// Does `work` for these clients, as [`Session::perform`], and meanwhile what operators order; `tell` is called when
    /// something was done of that. Then all events are written, and it is measured no more.
    ///
    /// # Errors
    /// Those of the work, and that an operator has stopped it.
    pub async fn perform<T>(
        &self,
        attached: &mut Attached,
        clients: Vec<(Option<String>, ClientId)>,
        (console, tell): (&Console, impl Fn()),
        work: impl Future<Output = Result<T, RunError>>,
    ) -> Result<T, RunError> {
        let operator = Operator {
            requests: self.requests.clone(),
            cluster: Arc::clone(&self.session.cluster),
            clients,
            go_on: resuming(self.out),
            keep: None,
            tls: self.options.port.protection.tls.clone(),
        };
        let work = self.session.perform(console, self.experiment.coordinator().deadline, work);
        let done = operator.during(tell, work).await;
        EventFile::finish(attached.events.take()).await;
        drop(attached.measured.take());
        done
    }

    /// On whose word its results rest. `for_others`: also by descriptor. Before the journal is removed: what cannot be looked
    /// up is a reason to go on by it.
    ///
    /// # Errors
    /// If what has outgrown memory cannot be looked up any more.
    pub async fn provenance(&self, for_others: bool) -> Result<SessionProvenance, RunError> {
        let cluster = &self.session.cluster;
        let answerers = cluster.answerers()?;
        // What one with a worker that was wrong computed where nobody has looked is in doubt; after damage to the journal
        // nobody knows whether there was one.
        let is_sound = || self.is_whole && cluster.quarantined().is_empty();
        let descriptors = match for_others && is_sound() {
            true => Some(cluster.provenances().await?).filter(|_| is_sound()),
            false => None,
        };
        Ok(SessionProvenance { answerers, descriptors })
    }

    /// Lets the workers go, unless they are needed for what follows.
    pub async fn end(&self, Attached { scaling, .. }: Attached, dataset: &Dataset) {
        drop(scaling); // those that wait for an allocation would find nobody
        let is_compared = !dataset.splits.test.is_empty() && dataset.clouds.set_count() == 1;
        if !(self.options.comparison_follows && is_compared) {
            self.session.cluster.dismiss_workers().await;
        }
    }
}

impl SessionProvenance {
    /// Notes of the finished run in a folder on whose word it rests.
    pub fn note(&self, session: &Session<'_>, run: &Path, counts: &SearchCounts) {
        session.register(run, counts, &self.answerers);
    }

    /// Keeps counts for later runs, of training and validation, as far as these may go on with them. Not before the run is
    /// finished: what a failed one computed is in doubt.
    pub fn keep(
        &self,
        session: &Session<'_>,
        counts: &SearchCounts,
        [train, validation]: [&CountCache<'_>; 2],
    ) {
        if let Some(descriptors) = &self.descriptors {
            counts.keep(train, validation, (session.cluster.session, descriptors));
        }
    }
}

/// Ends the quarantine of these principals; they are newcomers.
fn readmit(session: &Session<'_>, principals: &[Principal]) -> Result<(), RunError> {
    match principals.iter().find(|principal| !session.readmit(**principal)) {
        Some(&principal) => Err(RunError::NotQuarantined { principal }),
        None => Ok(()),
    }
}
