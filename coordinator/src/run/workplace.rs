//! Where a run's evaluations happen: a cluster with the data set released to it, and whoever works there.

use std::sync::Arc;

use descriptor::Parameters;
use results::Counts;
use tokio::net::TcpListener;

use crate::cluster::{Cluster, ClusterError};
use crate::dataset::Dataset;
use crate::experiment::{Experiment, LocalWorkers};
use crate::local::{self, Crew};
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
}

impl<'a> Workplace<'a> {
    /// A workplace that nobody has come to yet.
    pub fn new(experiment: &Experiment, dataset: &'a Dataset) -> Self {
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
        let servers = Servers::new(Arc::clone(&cluster), preparation);
        Self { cluster, splits, servers }
    }

    /// Starts in-process workers.
    pub fn staff(&mut self, workers: LocalWorkers) -> Crew {
        Crew::start(&mut self.servers, &local::threads(workers))
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
