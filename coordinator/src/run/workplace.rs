//! Where a run's evaluations happen: a cluster with the data set released to it, and whoever works there.

use std::sync::Arc;

use descriptor::{Parameters, QuantiseError, Quantiser};
use results::Counts;
use tokio::net::TcpListener;
use worker::Size;
use worker::store::Store;

use crate::cluster::{Cluster, ClusterError};
use crate::dataset::Dataset;
use crate::experiment::{Experiment, LocalWorkers};
use crate::local::{self, Crew};
use crate::prepared::PreparedClouds;
use crate::run::rows;
use crate::run::splits::{Matching, SplitBlobs};
use crate::scheduler::Limits;
use crate::server::Servers;
use crate::wire;

/// Workers beyond which registration is refused.
const MAX_WORKERS: usize = 10_000;

/// Workers that one job may take with it: many machines may go for reasons of their own, but a job that brings down
/// each worker it is given to must end some time.
const MAX_LOSSES: u32 = 50;

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
    /// A workplace that nobody has come to yet. Workers of this process share the store, and `memory` in equal parts.
    ///
    /// # Errors
    /// If the search space is too fine.
    pub fn new(
        experiment: &Experiment,
        dataset: &'a Dataset,
        store: Arc<Store>,
        memory: Size,
    ) -> Result<Self, QuantiseError> {
        let settings = experiment.coordinator();
        let cluster = Cluster::new(Limits {
            lease: settings.lease,
            job: settings.job,
            max_failures: settings.max_failures,
            max_losses: MAX_LOSSES,
            worker_grace: settings.worker_grace,
            max_workers: MAX_WORKERS,
        });
        let splits = SplitBlobs::publish(dataset, &cluster.blobs);
        let preparation = wire::preparation(experiment.preprocess(), experiment.genes());
        let quantiser = Quantiser::new(experiment.genes())?;
        let entries = &dataset.clouds.entries;
        let prepared = PreparedClouds::new(Arc::clone(&store), experiment.preprocess(), &quantiser, entries);
        let servers = Servers::new(Arc::clone(&cluster), preparation, prepared);
        Ok(Self { cluster, splits, servers, store, memory })
    }

    /// Starts in-process workers.
    pub fn staff(&mut self, workers: LocalWorkers) -> Crew {
        Crew::start(&mut self.servers, &local::threads(workers), &self.store, self.memory)
    }

    /// Lets remote workers in.
    pub async fn open(&mut self, listener: TcpListener) {
        self.servers.serve_tcp(listener).await;
    }

    /// Training counts of some descriptors, in their order.
    pub async fn train_counts(&self, parameters: &[Parameters]) -> Result<Vec<Counts>, ClusterError> {
        let evaluation =
            |parameters: &Parameters| self.splits.evaluation(*parameters, Matching::Train, false);
        let finished = self.cluster.evaluate(parameters.iter().map(evaluation).collect(), |_| {}).await?;
        Ok(finished.iter().map(|finished| rows::counts(&finished.result)).collect())
    }
}
