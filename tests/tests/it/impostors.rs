//! Programs against peers that are not what they seem: a worker that lies, a coordinator that refuses.

use std::net::SocketAddr;

use proto::v1;
use proto::v1::coordinator_client::CoordinatorClient;
use proto::v1::coordinator_server::{Coordinator, CoordinatorServer};
use tokio::net::TcpListener;
use tokio_stream::wrappers::TcpListenerStream;
use tonic::transport::Server;
use tonic::{Code, Request, Response, Status};

use crate::experiments::Experiment;
use crate::process::{Running, run};

/// Valid in form, and wrong: nothing is ever recognised, or everything, in turn.
fn lie(job: &v1::Job, queries: u32) -> v1::JobReport {
    let evaluation = job.evaluation.as_ref().unwrap();
    let found = v1::Match { nearest: 0, distance: 1.0, runner_up: None, runner_up_distance: None };
    let matches = if evaluation.want_matches { vec![found; queries as usize] } else { Vec::new() };
    let right = if job.lease.unwrap().job.is_multiple_of(2) { queries } else { 0 };
    let result = v1::EvaluationResult { queries, object_correct: right, category_correct: right, matches };
    v1::JobReport {
        lease: job.lease,
        run_seconds: 0.0,
        outcome: Some(v1::job_report::Outcome::Result(result)),
    }
}

/// Works as a liar until the coordinator goes.
async fn liar(address: String) {
    let mut client = CoordinatorClient::connect(address).await.unwrap();
    let worker_id = vec![9; 16];
    let introduction = v1::RegisterRequest {
        protocol_major: proto::PROTOCOL_MAJOR,
        protocol_minor: proto::PROTOCOL_MINOR,
        evaluation_version: descriptor::EVALUATION_VERSION,
        worker_id: worker_id.clone(),
        name: "liar".to_owned(),
        threads: 1,
        build: "liar".to_owned(),
    };
    let reply = client.register(introduction).await.unwrap().into_inner();
    let Some(v1::register_reply::Outcome::Accepted(accepted)) = reply.outcome else { panic!("refused") };
    let mut sequence = 0;
    let mut finished = Vec::new();
    loop {
        sequence += 1;
        let poll = v1::PollRequest {
            worker_id: worker_id.clone(),
            session_id: accepted.session_id.clone(),
            sequence,
            held: Vec::new(),
            finished: std::mem::take(&mut finished),
            wanted: 1,
            leaving: false,
        };
        let Ok(reply) = client.poll(poll).await else { return };
        for job in reply.into_inner().jobs {
            let manifest = job.evaluation.as_ref().unwrap().query[0].clone();
            let queries = clouds_in(&mut client, manifest).await;
            finished.push(lie(&job, queries));
        }
    }
}

/// Number of clouds in a split manifest.
async fn clouds_in(client: &mut CoordinatorClient<tonic::transport::Channel>, digest: Vec<u8>) -> u32 {
    let mut stream = client.fetch_blob(v1::FetchBlobRequest { digest }).await.unwrap().into_inner();
    let mut bytes = Vec::new();
    while let Some(chunk) = stream.message().await.unwrap() {
        bytes.extend(chunk.data);
    }
    let manifest: v1::SplitManifest = prost::Message::decode(&bytes[..]).unwrap();
    manifest.clouds.len() as u32
}

#[tokio::test(flavor = "multi_thread")]
async fn verification_finds_the_fitness_values_of_a_worker_that_lied() {
    let experiment = Experiment::new(
        "[ga]\npopulation = 4\n[stop]\ngenerations = 2\nperfect = false\nvalidation_patience = \"off\"\n",
    );
    let args = experiment.run_args("out", &["--local-workers", "0"]);
    let mut coordinator = Running::start(experiment.folder(), "coordinator", "coordinator", args);
    let line = coordinator.wait_for("workers may join with");
    let liar = tokio::spawn(liar(line.rsplit(' ').next().unwrap().to_owned()));
    tokio::task::block_in_place(|| coordinator.wait()).expect_success();
    liar.await.unwrap();

    // The files are as they were written: only computing again tells.
    let out = experiment.path("out");
    run("coordinator", ["verify", &out, "--sample", "0"]).expect_success();
    let verified = run("coordinator", ["verify", &out, "--sample", "8"]).expect_error();
    assert!(verified.stdout.contains("NOT sound"), "{verified}");
    assert!(verified.stdout.contains("evaluations, generation 1, individual"), "{verified}");
}

/// A coordinator that takes nobody.
struct Refuser;

type Blobs = tokio_stream::Empty<Result<v1::BlobChunk, Status>>;

#[tonic::async_trait]
impl Coordinator for Refuser {
    async fn register(
        &self,
        request: Request<v1::RegisterRequest>,
    ) -> Result<Response<v1::RegisterReply>, Status> {
        assert_eq!(request.into_inner().name, "unlucky");
        let refused = v1::Refused {
            reason: v1::RefusalReason::EvaluationVersion.into(),
            message: "evaluation version: must be 7, got 1\ninstall release 7 on this worker".to_owned(),
        };
        Ok(Response::new(v1::RegisterReply { outcome: Some(v1::register_reply::Outcome::Refused(refused)) }))
    }

    async fn poll(&self, _: Request<v1::PollRequest>) -> Result<Response<v1::PollReply>, Status> {
        Err(Status::new(Code::NotFound, "nobody is registered here"))
    }

    type FetchBlobStream = Blobs;

    async fn fetch_blob(&self, _: Request<v1::FetchBlobRequest>) -> Result<Response<Blobs>, Status> {
        Err(Status::new(Code::NotFound, "nothing here"))
    }

    type FetchDerivedStream = Blobs;

    async fn fetch_derived(&self, _: Request<v1::FetchDerivedRequest>) -> Result<Response<Blobs>, Status> {
        Err(Status::new(Code::NotFound, "nothing here"))
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_refused_worker_says_why_and_ends() {
    let listener = TcpListener::bind(SocketAddr::from(([127, 0, 0, 1], 0))).await.unwrap();
    let address = format!("http://{}", listener.local_addr().unwrap());
    let server = Server::builder().add_service(CoordinatorServer::new(Refuser));
    tokio::spawn(server.serve_with_incoming(TcpListenerStream::new(listener)));
    let ended =
        tokio::task::spawn_blocking(move || run("worker", ["--coordinator", &address, "--name", "unlucky"]));
    let ended = ended.await.unwrap().expect_error();
    assert!(
        ended.stderr.contains("error: coordinator: this worker is refused, got evaluation version"),
        "{ended}"
    );
    assert!(ended.stderr.contains("\ninstall release 7"), "{ended}");
}
