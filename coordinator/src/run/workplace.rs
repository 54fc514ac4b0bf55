//! Where a run's evaluations happen: a cluster with the data set released to it, and whoever works there.

use std::sync::Arc;

use descriptor::{GeneTable, Parameters, QuantiseError, Quantiser};
use proto::SessionId;
use results::Counts;
use worker::Size;
use worker::store::Store;

use crate::dataset::Dataset;
use crate::experiment::{Experiment, LocalWorkers};
use crate::local::{self, Crew};
use crate::prepared::PreparedClouds;
use crate::run::rows;
use crate::run::splits::{Matching, SplitBlobs};
use crate::tasks;
use cluster::journal::{Journal, Recorded};
use cluster::scheduler::{Audit, Limits};
use cluster::{Cluster, ClusterError};
use transport::Listener;
use transport::{Release, Servers};

/// Workers beyond which registration is refused.
const MAX_WORKERS: usize = 10_000;

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
        audit: Audit { share: settings.audit, seed: experiment.seed() },
        check_description: tasks::CHECK_DESCRIPTION,
    }
}

/// A cluster, its data and its doors.
pub struct Workplace<'a> {
    /// Workers and jobs.
    pub cluster: Arc<Cluster>,
    /// The data set as workers see it.
    pub splits: SplitBlobs<'a>,
    servers: Servers,
    /// Where derived data is kept.
    pub store: Arc<Store>,
    memory: Size,
}

impl<'a> Workplace<'a> {
    /// A workplace that nobody has come to yet and that keeps nothing. Workers of this process share the store, and
    /// `memory` in equal parts.
    ///
    /// # Errors
    /// If the search space is too fine.
    pub fn new(
        experiment: &Experiment,
        dataset: &'a Dataset,
        store: Arc<Store>,
        memory: Size,
    ) -> Result<Self, QuantiseError> {
        Self::for_genes(experiment.genes(), experiment, dataset, store, memory)
    }

    /// The same in another search space than the experiment's.
    ///
    /// # Errors
    /// If it is too fine.
    pub fn for_genes(
        genes: &GeneTable,
        experiment: &Experiment,
        dataset: &'a Dataset,
        store: Arc<Store>,
        memory: Size,
    ) -> Result<Self, QuantiseError> {
        Self::with(Cluster::new(limits(experiment)), genes, experiment, dataset, store, memory)
    }

    /// The workplace of a run with a journal: it goes on where earlier starts ended.
    ///
    /// # Errors
    /// If the search space is too fine.
    pub fn with_journal(
        (session, journal, recorded): (SessionId, Journal, Recorded),
        experiment: &Experiment,
        dataset: &'a Dataset,
        store: Arc<Store>,
        memory: Size,
    ) -> Result<Self, QuantiseError> {
        let cluster = Cluster::with_journal(limits(experiment), session, journal, recorded);
        Self::with(cluster, experiment.genes(), experiment, dataset, store, memory)
    }

    fn with(
        cluster: Arc<Cluster>,
        genes: &GeneTable,
        experiment: &Experiment,
        dataset: &'a Dataset,
        store: Arc<Store>,
        memory: Size,
    ) -> Result<Self, QuantiseError> {
        cluster.set_pieces(experiment.coordinator().pieces);
        let preparation = tasks::preparation(experiment.preprocess(), genes);
        let splits = SplitBlobs::publish(dataset, preparation, &cluster.blobs);
        let quantiser = Quantiser::new(genes)?;
        let entries = &dataset.clouds.entries;
        let prepared = PreparedClouds::new(Arc::clone(&store), experiment.preprocess(), &quantiser, entries);
        let release = Release { build: worker::BUILD, evaluation_version: descriptor::EVALUATION_VERSION };
        let released = Arc::clone(&cluster);
        let derived = Arc::new(move |kind: &str, key| prepared.read(kind, key, &released.blobs));
        let servers = Servers::new(Arc::clone(&cluster), release, derived);
        Ok(Self { cluster, splits, servers, store, memory })
    }

    /// Starts in-process workers.
    pub fn staff(&mut self, workers: LocalWorkers) -> Crew {
        Crew::start(&mut self.servers, &local::threads(workers), &self.store, self.memory)
    }

    /// Lets remote workers in.
    pub async fn open(&mut self, listener: Listener) {
        self.servers.serve(listener).await;
    }

    /// Training counts of some descriptors, in their order.
    pub async fn train_counts(&self, parameters: &[Parameters]) -> Result<Vec<Counts>, ClusterError> {
        let evaluation =
            |parameters: &Parameters| self.splits.evaluation(*parameters, Matching::Train, false);
        let finished =
            self.cluster.client().evaluate(parameters.iter().map(evaluation).collect(), |_| {}).await?;
        Ok(finished.iter().map(|finished| rows::counts(&finished.result)).collect())
    }
}
