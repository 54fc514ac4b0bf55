//! A session: a cluster with the data set released to it, the port for remote workers and the workers of this process,
//! from bring-up to take-down, for every command that has something computed.

use std::collections::BTreeSet;
use std::convert::Infallible;
use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::Path;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use cache::{ByteSize, Store};
use descriptor::{Descriptor, Family, Preparer, QuantiseError, SearchSpace};
use proto::{Principal, SessionId};

use crate::compare::{Candidate, baselines};
use crate::console::Console;
use crate::dataset::Dataset;
use crate::experiment::{Experiment, LocalWorkers};
use crate::fitness::Fitness;
use crate::in_process::{self, InProcessWorkers};
use crate::lock::lock;
use crate::prepared::PreparedClouds;
use crate::result_cache::{SearchCounts, Wrong, finished_runs, forget};
use crate::run::fitness_batch::{Answer, FitnessBatch};
use crate::run::matching::Matching;
use crate::run::scales::Scales;
use crate::run::splits::SplitBlobs;
use crate::run::{DataError, RunError};
use crate::shared_bucket::{self, Bucket};
use crate::slurm::{Scaling, SlurmWorkers};
use crate::tasks;
use crate::trace::Trace;
use cluster::journal::{Journal, Recorded};
use cluster::scheduler::{Audit, Limits, RunSecret};
use cluster::{Client, Cluster, ClusterError};
use transport::{ListenError, Listener, Port, Presigner, Release, Servers, SharedEntries};

/// Where workers are awaited unless the experiment or the command line says otherwise.
pub const DEFAULT_LISTEN: SocketAddr = SocketAddr::new(IpAddr::V4(Ipv4Addr::LOCALHOST), 7700);

/// Workers beyond which registration is refused.
const MAX_WORKERS: usize = 10_000;

/// The first answers of a principal that are all audited.
const NEWCOMER_AUDITS: u32 = 10;

/// Workers that one job may take with it: many machines may go for reasons of their own, but a job that brings down
/// each worker it is given to must end some time.
const MAX_LOSSES: u32 = 50;

fn limits(experiment: &Experiment) -> Limits {
    let settings = experiment.coordinator();
    Limits {
        lease: settings.lease,
        job: settings.job,
        max_failures: settings.max_failures,
        max_losses: MAX_LOSSES,
        worker_grace: settings.worker_grace,
        max_workers: MAX_WORKERS,
        audit: Audit { share: settings.audit, first: NEWCOMER_AUDITS },
        check_description: tasks::CHECK_DESCRIPTION,
        channels_of: tasks::CHANNELS_OF,
    }
}

/// A cluster, its data and its workers.
pub struct Session<'a> {
    /// Workers and jobs.
    pub cluster: Arc<Cluster>,
    /// The data set as workers see it.
    pub splits: SplitBlobs<'a>,
    /// Where derived data is kept.
    pub store: Arc<Store>,
    /// What is exported of it.
    pub trace: Trace,
    servers: Servers,
    bucket: Option<Arc<Bucket>>,
    /// What signs URLs to it.
    pub presigner: Option<Arc<Presigner>>,
    memory: ByteSize,
    /// Quarantined principals whose contributions were dropped from the store.
    forgotten: Mutex<BTreeSet<Principal>>,
    /// Until [`Session::perform`] takes them.
    in_process: Mutex<Option<InProcessWorkers>>,
}

impl<'a> Session<'a> {
    /// A session without workers that keeps no journal. Workers of this process share the store, and `memory` in equal
    /// parts.
    ///
    /// # Errors
    /// If the search space is too fine.
    pub fn new(
        experiment: &Experiment,
        dataset: &'a Dataset,
        store: Arc<Store>,
        memory: ByteSize,
    ) -> Result<Self, DataError> {
        let cluster = Cluster::new(limits(experiment));
        Self::with(cluster, experiment, experiment.fitness().needs_sequences(), dataset, store, memory)
    }

    /// The session of a run with a journal, or of several runs: it goes on where earlier starts ended. `with_sequences`:
    /// whether any of them has a fitness that looks at sequences.
    ///
    /// # Errors
    /// If the search space is too fine.
    pub fn with_journal(
        (id, journal, recorded): ((SessionId, RunSecret), Journal, Recorded),
        experiment: &Experiment,
        with_sequences: bool,
        dataset: &'a Dataset,
        store: Arc<Store>,
        memory: ByteSize,
    ) -> Result<Self, DataError> {
        let cluster = Cluster::with_journal(limits(experiment), id, journal, recorded);
        Self::with(cluster, experiment, with_sequences, dataset, store, memory)
    }

    fn with(
        cluster: Arc<Cluster>,
        experiment: &Experiment,
        with_sequences: bool,
        dataset: &'a Dataset,
        store: Arc<Store>,
        memory: ByteSize,
    ) -> Result<Self, DataError> {
        cluster.set_shard_count(experiment.coordinator().pieces);
        let preparation = tasks::preparation(experiment.preprocess(), experiment.space().clone());
        let splits = SplitBlobs::publish(dataset, preparation, with_sequences, &cluster.blobs);
        let entries = &dataset.clouds.entries;
        let preparers = preparers(experiment)?;
        let prepared = PreparedClouds::new(Arc::clone(&store), experiment.preprocess(), &preparers, entries);
        let prepared = Arc::new(prepared);
        let bucket = shared_bucket::open(&store)?;
        let presigner = bucket
            .as_ref()
            .map(|bucket| Arc::new(shared_bucket::presigner(bucket, &prepared, &cluster, &store)));
        let release = Release { build: worker::BUILD, evaluation_version: descriptor::EVALUATION_VERSION };
        let released = Arc::clone(&cluster);
        let derived = Arc::new(move |kind: &str, key| prepared.read(kind, key, &released.blobs));
        let shared = SharedEntries { derived, presigner: presigner.clone() };
        let servers = Servers::new(Arc::clone(&cluster), release, shared);
        Ok(Self {
            trace: Trace::new(&cluster),
            cluster,
            splits,
            store,
            servers,
            bucket,
            presigner,
            memory,
            forgotten: Mutex::default(),
            in_process: Mutex::new(None),
        })
    }

    /// Lets remote workers connect, if there is a port, and starts the workers of this process.
    pub async fn start(&mut self, listener: Option<Listener>, workers: LocalWorkers) {
        if let Some(listener) = listener {
            self.servers.serve(listener).await;
        }
        let threads = in_process::threads(workers);
        let workers = InProcessWorkers::start(&mut self.servers, &threads, &self.store, self.memory);
        *lock(&self.in_process) = Some(workers);
    }

    /// Does `work` with the session's workers: waits for the first one, ends at the deadline or with a worker of this
    /// process that fails. If `work` was done, it then stops the workers of this process and ends all leases; else they end
    /// with the process. To be called once, after [`Session::start`].
    pub async fn perform<T>(
        &self,
        console: &Console,
        deadline: Option<Duration>,
        work: impl Future<Output = Result<T, RunError>>,
    ) -> Result<T, RunError> {
        let workers = lock(&self.in_process).take();
        let mut workers = workers.unwrap_or_default();
        if workers.is_empty() {
            console.say(
                "waiting for a worker: none was started here (--local-workers 0); --local-workers auto starts one",
            );
        }
        self.look_at_bucket(console);
        let is_own_coming = !workers.is_empty();
        self.trace.follow();
        let waited = async {
            let waiting =
                |waited: Duration| console.say(&format!("no worker yet after {} min", waited.as_secs() / 60));
            self.cluster.wait_for_worker(is_own_coming, waiting).await;
            work.await
        };
        // At once: a coordinator that is killed must not leave to others what it knows to be wrong.
        let done = tokio::select! {
            done = in_time(deadline, workers.during(waited)) => done,
            never = self.watch_quarantine(console) => match never {},
        };
        self.forget_quarantined(console);
        let done = done.inspect_err(|error| self.trace.end(Some(error)))?;
        workers.stop().await;
        self.cluster.close();
        self.trace.end(None);
        Ok(done)
    }

    /// Says, soon, if the bucket cannot be used: workers that find out say so on their own machines only.
    fn look_at_bucket(&self, console: &Console) {
        if let Some(bucket) = self.bucket.clone() {
            let console = console.clone();
            tokio::spawn(async move {
                if let Err(error) = bucket.probe().await {
                    console.say(&format!("warning: {error}; workers go on without it"));
                }
            });
        }
    }

    /// Notes that the run in a folder is finished, and on whose word it rests, that of `answerers`: see
    /// [`finished_runs`].
    pub fn register(&self, folder: &Path, counts: &SearchCounts, answerers: &BTreeSet<Principal>) {
        let used = counts.used.iter().map(|source| (**source).clone());
        finished_runs::note(&self.store, (folder, false), self.cluster.session, answerers.clone(), used);
    }

    /// Drops from the store what is in doubt.
    pub fn forget(&self, wrong: &Wrong, console: &Console) {
        let forgotten = forget(&self.store, wrong);
        if !forgotten.is_empty() {
            console.say(&format!("principal {wrong} was wrong: {forgotten}"));
        }
    }

    /// Drops from the store what the principals have left that were quarantined, once.
    pub fn forget_quarantined(&self, console: &Console) {
        let mut wrong = self.cluster.quarantined();
        let mut forgotten = lock(&self.forgotten);
        wrong.retain(|principal| forgotten.insert(*principal));
        if !wrong.is_empty() {
            self.forget(&Wrong::principals(wrong), console);
        }
    }

    /// Ends the quarantine of a principal, whose contributions are dropped again if it is wrong again; `false` if it is not
    /// quarantined.
    pub fn readmit(&self, principal: Principal) -> bool {
        lock(&self.forgotten).remove(&principal);
        self.cluster.readmit(principal)
    }

    /// The same as often as something happens.
    async fn watch_quarantine(&self, console: &Console) -> Infallible {
        let mut events = self.cluster.events();
        loop {
            self.forget_quarantined(console);
            events.wait().await;
            events.read_to_end();
        }
    }

    /// What some descriptors have by a fitness, with a weight for each set, on the training clouds, in their order. `splits`:
    /// the session's, for descriptors of its search space, or those beside it.
    pub async fn measure(
        &self,
        client: &mut Client,
        splits: &SplitBlobs<'_>,
        (fitness, weights): (&Fitness, &[u32]),
        descriptors: &[&Descriptor],
    ) -> Result<Vec<Answer>, ClusterError> {
        let (scales, fitness) = (Scales::default(), (fitness, weights));
        let batch = FitnessBatch::new(fitness, splits, &scales, descriptors, Matching::Train);
        let (answers, _) = batch.evaluate(client, |_, _, _| {}).await?;
        Ok(answers)
    }
}

/// All ways in which clouds are made ready for the descriptors of an experiment, and for those that its winner is compared
/// with.
fn preparers(experiment: &Experiment) -> Result<Vec<Preparer>, QuantiseError> {
    let mut preparers = vec![experiment.space().preparer()?];
    let default = Descriptor::default_of(Family::DiskRing);
    for Candidate { descriptor, .. } in baselines::candidates(&default, experiment) {
        if let Ok(space) = SearchSpace::single(&descriptor)
            && !experiment.space().contains(&descriptor)
        {
            preparers.push(space.preparer()?);
        }
    }
    Ok(preparers)
}

/// Does `work` unless it takes too long.
async fn in_time<T>(
    deadline: Option<Duration>,
    work: impl Future<Output = Result<T, RunError>>,
) -> Result<T, RunError> {
    let Some(deadline) = deadline else { return work.await };
    let late = |_| RunError::Deadline { seconds: deadline.as_secs() };
    tokio::time::timeout(deadline, work).await.map_err(late)?
}

/// Asks Slurm for workers of a session in a folder, where they are wanted, until what this returns is dropped.
pub fn scale(
    workers: Option<&SlurmWorkers>,
    (experiment, out): (&Experiment, &Path),
    cluster: &Arc<Cluster>,
    console: &Console,
) -> Result<Option<Scaling>, RunError> {
    let listen = experiment.coordinator().listen.unwrap_or(DEFAULT_LISTEN);
    let start = |workers| Scaling::start(workers, (out, listen), cluster, console);
    Ok(workers.map(start).transpose()?)
}

/// Binds the port for remote workers. The default port is a convenience: if it is taken, a session with workers of its
/// own goes on without, unless a join file is asked for.
pub async fn listen(
    experiment: &Experiment,
    port: &Port,
    console: &Console,
) -> Result<Option<Listener>, RunError> {
    let settings = experiment.coordinator();
    let has_workers = settings.local_workers != LocalWorkers::Count(0);
    let listener = match Listener::bind(settings.listen.unwrap_or(DEFAULT_LISTEN), port).await {
        Ok(listener) => listener,
        Err(ListenError::PortInUse { address })
            if settings.listen.is_none() && has_workers && port.join_file.is_none() =>
        {
            console.say(&format!(
                "port {} is in use, so that no remote worker can join; --listen chooses another",
                address.port()
            ));
            return Ok(None);
        }
        Err(error) => return Err(error.into()),
    };
    for notice in listener.notices() {
        console.say(&notice);
    }
    Ok(Some(listener))
}
