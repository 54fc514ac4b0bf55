//! A worker that keeps to the protocol and computes nothing: each evaluation takes some time and has an answer that
//! follows from its parameters.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::sync::Arc;
use std::time::{Duration, Instant};

use descriptor::Descriptor;
use prost::Message as _;
use proto::task::{
    Described, Description, Evaluation, EvaluationResult, Match, Report, SplitManifest, Task, TaskResult,
    Tile,
};
use proto::v2::coordinator_client::CoordinatorClient;
use proto::{Digest, WorkerSecret, v2};
use tokio::sync::{Mutex, mpsc};
use tonic::Status;
use tonic::transport::Channel;

use super::record::{Answered, Record, Span, Traffic};

/// What all workers have in common.
#[derive(Debug)]
pub struct Manner {
    /// The coordinator.
    pub address: String,
    /// What its jobs take.
    pub effort: Effort,
    /// Jobs taken ahead.
    pub ahead: usize,
    /// Clouds in split manifests, by digest.
    pub clouds: Mutex<BTreeMap<Digest, u32>>,
}

/// What jobs take.
#[derive(Clone, Copy, Debug)]
pub enum Effort {
    /// Between half and one and a half of this.
    About(Duration),
    /// In proportion to what there is to do, seconds.
    Each {
        /// Of describing one cloud.
        cloud: f64,
        /// Of matching a pair of clouds.
        pair: f64,
    },
}

impl Effort {
    /// Of a job that describes clouds and matches pairs of them.
    fn of(self, lease: v2::Lease, clouds: u32, pairs: u64) -> Duration {
        match self {
            // A job's name is a hash: its lower half is as good as random.
            Self::About(time) => time.mul_f64(0.5 + f64::from(lease.job as u32) / f64::from(u32::MAX)),
            Self::Each { cloud, pair } => {
                Duration::from_secs_f64(cloud * f64::from(clouds) + pair * pairs as f64)
            }
        }
    }
}

/// Recognised queries of a descriptor.
pub fn answer(shape_bins: u32, colour_bins: u32, queries: u32) -> u32 {
    (shape_bins * 7 + colour_bins) % (queries + 1)
}

/// One worker over a connection of its own.
pub struct Worker {
    client: CoordinatorClient<Channel>,
    manner: Arc<Manner>,
    secret: WorkerSecret,
    session: Vec<u8>,
    heartbeat: Duration,
    sequence: u64,
    queue: VecDeque<v2::Job>,
    hand: Option<v2::Lease>,
    /// Reports that are not acknowledged.
    finished: Vec<v2::JobReport>,
    done_sender: mpsc::UnboundedSender<(v2::JobReport, Span)>,
    done: mpsc::UnboundedReceiver<(v2::JobReport, Span)>,
    record: Record,
    /// Descriptions that it has made or fetched.
    described: Arc<Mutex<BTreeSet<Digest>>>,
    traffic: Arc<Traffic>,
}

impl Worker {
    /// Connects and registers.
    pub async fn join(manner: Arc<Manner>, name: String) -> Self {
        let mut client = CoordinatorClient::connect(manner.address.clone()).await.unwrap();
        let secret = WorkerSecret::new(rand::random());
        let introduction = v2::RegisterRequest {
            protocol_major: proto::PROTOCOL_MAJOR,
            protocol_minor: proto::PROTOCOL_MINOR,
            evaluation_version: descriptor::EVALUATION_VERSION,
            worker_id: secret.id().to_vec(),
            worker_secret: secret.reveal(),
            name,
            threads: 1,
            build: "load".to_owned(),
        };
        let reply = client.register(introduction).await.unwrap().into_inner();
        let Some(v2::register_reply::Outcome::Accepted(accepted)) = reply.outcome else {
            panic!("refused: {reply:?}")
        };
        let (done_sender, done) = mpsc::unbounded_channel();
        Self {
            client,
            manner,
            secret,
            session: accepted.session_id,
            heartbeat: Duration::from_millis(accepted.heartbeat_milliseconds.into()),
            sequence: 0,
            queue: VecDeque::new(),
            hand: None,
            finished: Vec::new(),
            done_sender,
            done,
            record: Record::default(),
            described: Arc::default(),
            traffic: Arc::default(),
        }
    }

    /// Works until the coordinator is gone; what it was told and when.
    pub async fn work(mut self) -> Record {
        loop {
            self.start_next();
            let request = self.request();
            self.traffic.sent(request.encoded_len());
            let (sent, wanted, reports) = (Instant::now(), request.wanted, request.finished.len());
            let mut client = self.client.clone();
            tokio::select! {
                biased;
                // A real worker drops its poll, too: jobs of a reply that was not read are handed out again.
                Some(done) = self.done.recv() => {
                    self.finish(done);
                    continue;
                }
                reply = client.poll(request) => match reply {
                    Ok(reply) => {
                        let reply = reply.into_inner();
                        self.traffic.received(reply.encoded_len());
                        let answered = Answered { sent, took: sent.elapsed() };
                        self.record.reports.extend((reports > 0).then_some(answered));
                        self.record.dispatches.extend((wanted > 0 && !reply.jobs.is_empty()).then_some(answered));
                        self.absorb(reply);
                    }
                    Err(status) => return self.end(status),
                },
            }
            self.start_next();
            if self.wanted() == 0 {
                tokio::select! {
                    Some(done) = self.done.recv() => self.finish(done),
                    () = tokio::time::sleep(self.heartbeat) => {}
                }
            }
        }
    }

    fn wanted(&self) -> usize {
        (1 + self.manner.ahead).saturating_sub(self.held().count())
    }

    fn held(&self) -> impl Iterator<Item = v2::Lease> {
        self.hand.clone().into_iter().chain(self.queue.iter().filter_map(|job| job.lease.clone()))
    }

    fn request(&mut self) -> v2::PollRequest {
        self.sequence += 1;
        v2::PollRequest {
            worker_id: self.secret.id().to_vec(),
            worker_secret: self.secret.reveal(),
            session_id: self.session.clone(),
            sequence: self.sequence,
            held: self.held().collect(),
            finished: self.finished.clone(),
            wanted: self.wanted() as u32,
            leaving: false,
        }
    }

    fn absorb(&mut self, reply: v2::PollReply) {
        self.finished
            .retain(|report| report.lease.as_ref().is_none_or(|lease| !reply.acknowledged.contains(lease)));
        self.queue.retain(|job| job.lease.as_ref().is_none_or(|lease| !reply.revoked.contains(lease)));
        self.queue.extend(reply.jobs);
    }

    fn finish(&mut self, (report, span): (v2::JobReport, Span)) {
        self.hand = None;
        self.finished.push(report);
        self.record.spans.push(span);
    }

    fn start_next(&mut self) {
        if self.hand.is_some() {
            return;
        }
        let Some(job) = self.queue.pop_front() else { return };
        self.hand.clone_from(&job.lease);
        let at_work = AtWork {
            client: self.client.clone(),
            manner: Arc::clone(&self.manner),
            described: Arc::clone(&self.described),
            traffic: Arc::clone(&self.traffic),
        };
        let done = self.done_sender.clone();
        tokio::spawn(async move {
            // Nobody listens any more once the coordinator has gone.
            if let Ok(report) = at_work.carry_out(job).await {
                let _ = done.send(report);
            }
        });
    }

    fn end(mut self, status: Status) -> Record {
        self.record.end = Some((Instant::now(), status));
        self.record.traffic = self.traffic.bytes();
        self.record
    }
}

/// One job under way.
struct AtWork {
    client: CoordinatorClient<Channel>,
    manner: Arc<Manner>,
    described: Arc<Mutex<BTreeSet<Digest>>>,
    traffic: Arc<Traffic>,
}

impl AtWork {
    /// Takes the time of a job, and answers.
    async fn carry_out(&self, job: v2::Job) -> Result<(v2::JobReport, Span), Status> {
        let (start, lease) = (Instant::now(), job.lease.unwrap());
        let task = Task::try_from(job.task.unwrap()).unwrap();
        let (took, result) = match &task {
            Task::Description(shard) => {
                let clouds = self.clouds_in(std::slice::from_ref(&shard.manifest)).await?;
                let described = Described::new(description(shard, clouds));
                self.described.lock().await.insert(described.digest);
                (self.manner.effort.of(lease.clone(), clouds, 0), TaskResult::Description(described))
            }
            Task::Evaluation(evaluation) | Task::Tile(Tile { evaluation, .. }) => {
                if let Task::Tile(tile) = &task {
                    for digest in tile.query_descriptions.iter().chain(&tile.database_descriptions) {
                        if self.described.lock().await.insert(*digest) {
                            self.fetch(*digest).await?;
                        }
                    }
                }
                let queries = self.clouds_in(&evaluation.query).await?;
                let database = self.clouds_in(&evaluation.database).await?;
                let clouds = if matches!(task, Task::Evaluation(_)) { queries + database } else { 0 };
                let pairs = u64::from(queries) * u64::from(database);
                let took = self.manner.effort.of(lease.clone(), clouds, pairs);
                (took, TaskResult::Evaluation(result(evaluation, queries)))
            }
            Task::GridCell(_) | Task::Scale(_) => {
                return Err(Status::unimplemented("no grid is searched here, and nothing scaled"));
            }
        };
        tokio::time::sleep_until((start + took).into()).await;
        let run_seconds = start.elapsed().as_secs_f64();
        let report = Report { lease: lease.into(), run_seconds, outcome: Ok(result) }.into();
        Ok((report, Span { start, end: Instant::now(), took }))
    }

    /// Number of clouds in split manifests, each of which the first who asks fetches for all.
    async fn clouds_in(&self, manifests: &[Digest]) -> Result<u32, Status> {
        let mut known = self.manner.clouds.lock().await;
        let mut clouds = 0;
        for manifest in manifests {
            if !known.contains_key(manifest) {
                let split = SplitManifest::decode(&self.fetch(*manifest).await?).unwrap();
                known.insert(*manifest, split.clouds.len() as u32);
            }
            clouds += known[manifest];
        }
        Ok(clouds)
    }

    /// The bytes of a blob.
    async fn fetch(&self, digest: Digest) -> Result<Vec<u8>, Status> {
        let request = v2::FetchBlobRequest { digest: digest.to_vec(), takes_lz4: false };
        let mut stream = self.client.clone().fetch_blob(request).await?.into_inner();
        let mut bytes = Vec::new();
        while let Some(chunk) = stream.message().await? {
            bytes.extend(chunk.data);
        }
        self.traffic.received(bytes.len());
        Ok(bytes)
    }
}

/// Bytes that might describe so many clouds; those of each shard under each descriptor are others.
fn description(shard: &Description, clouds: u32) -> Vec<u8> {
    let noise = Digest::of(&[shard.subject.descriptor.bytes(), &shard.manifest.0].concat()).0;
    let values = noise.iter().cycle().flat_map(|byte| (f32::from(*byte) / 255.0).to_le_bytes());
    values.take((u64::from(clouds) * shard.subject.facts.description_bytes) as usize).collect()
}

fn result(evaluation: &Evaluation, queries: u32) -> EvaluationResult {
    let descriptor = Descriptor::from_bytes(evaluation.subject.descriptor.bytes());
    let Ok(Descriptor::DiskRing(parameters)) = descriptor else { panic!("{descriptor:?}") };
    let correct = answer(parameters.shape_bins, parameters.colour_bins, queries);
    let found = Match { nearest: 0, distance: 1.0, runner_up: Some((1, 1.0)) };
    EvaluationResult {
        queries,
        object_correct: correct,
        category_correct: correct,
        matches: if evaluation.want_matches { vec![found; queries as usize] } else { Vec::new() },
        ..EvaluationResult::default()
    }
}
