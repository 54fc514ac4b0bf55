//! Where a run's evaluations happen: a cluster with the data set released to it, and whoever works there.

use std::net::SocketAddr;
use std::sync::Arc;

use descriptor::Parameters;
use results::Counts;

use crate::cluster::{Cluster, ClusterError};
use crate::dataset::Dataset;
use crate::experiment::{Experiment, LocalWorkers};
use crate::local::{self, Crew};
use crate::run::rows;
use crate::run::splits::{Matching, SplitBlobs};
use crate::scheduler::Limits;
use crate::server::{self, ServerError, Servers};
use crate::wire;

/// Workers beyond which registration is refused.
const MAX_WORKERS: usize = 10_000;

/// A cluster, its data and its doors.
pub struct Workplace<'a> {
    /// Workers and jobs.
    pub cluster: Arc<Cluster>,
    /// The data set as workers see it.
    pub splits: SplitBlobs<'a>,
    servers: Servers,
    crew: Option<Crew>,
}

impl<'a> Workplace<'a> {
    /// A workplace that nobody has come to yet.
    pub fn new(experiment: &Experiment, dataset: &'a Dataset) -> Self {
        let settings = experiment.coordinator();
        let cluster = Cluster::new(Limits {
            lease: settings.lease,
            max_failures: settings.max_attempts,
            worker_grace: settings.worker_grace,
            max_workers: MAX_WORKERS,
        });
        let splits = SplitBlobs::publish(dataset, &cluster.blobs);
        let preparation = wire::preparation(experiment.preprocess(), experiment.genes());
        let servers = Servers::new(Arc::clone(&cluster), preparation);
        Self { cluster, splits, servers, crew: None }
    }

    /// Starts in-process workers; returns how many.
    pub fn staff(&mut self, workers: LocalWorkers) -> usize {
        let threads = local::threads(workers);
        self.crew = Some(Crew::start(&mut self.servers, &threads));
        threads.len()
    }

    /// Lets remote workers in; returns the address they find.
    pub async fn listen(&mut self, address: SocketAddr, insecure: bool) -> Result<SocketAddr, ServerError> {
        let listener = server::bind(address, insecure).await?;
        let address = listener.local_addr().unwrap_or(address);
        self.servers.serve_tcp(listener).await;
        Ok(address)
    }

    /// Training counts of some descriptors, in their order.
    pub async fn train_counts(&self, parameters: &[Parameters]) -> Result<Vec<Counts>, ClusterError> {
        let evaluation =
            |parameters: &Parameters| self.splits.evaluation(*parameters, Matching::Train, false);
        let finished = self.cluster.evaluate(parameters.iter().map(evaluation).collect(), |_| {}).await?;
        Ok(finished.iter().map(|finished| rows::counts(&finished.result)).collect())
    }

    /// Lets the in-process workers say goodbye.
    pub async fn close(mut self) {
        if let Some(crew) = self.crew.take() {
            crew.stop().await;
        }
    }
}
