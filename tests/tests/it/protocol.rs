//! The coordinator's port as a client sees it: health, reflection, refusals, nonsense.

use proto::task::{EvaluationResult, TaskResult};
use proto::v2::coordinator_client::CoordinatorClient;
use proto::{Digest, v1, v2};
use tokio_stream::StreamExt as _;
use tonic::transport::server::TcpIncoming;
use tonic::transport::{Channel, Server};
use tonic::{Code, Request, Response, Status};
use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_check_response::ServingStatus;
use tonic_health::pb::health_client::HealthClient;
use tonic_reflection::pb::v1::server_reflection_client::ServerReflectionClient;
use tonic_reflection::pb::v1::server_reflection_request::MessageRequest;
use tonic_reflection::pb::v1::server_reflection_response::MessageResponse;
use tonic_reflection::pb::v1::{ListServiceResponse, ServerReflectionRequest};

use crate::experiments::{Experiment, clouds};
use crate::peer;
use crate::process::{Running, program};

/// A coordinator that waits for workers, and a connection to it.
async fn coordinator(experiment: &Experiment) -> (Running, String, Channel) {
    let args = experiment.run_args("out", &["--local-workers", "0"]);
    let mut coordinator = Running::start(experiment.folder(), "coordinator", "coordinator", args);
    let address = coordinator.join_address();
    let channel = Channel::from_shared(address.clone()).unwrap().connect().await.unwrap();
    (coordinator, address, channel)
}

fn introduction() -> v2::RegisterRequest {
    peer::introduction([7; 32], "stranger")
}

async fn refusal(
    client: &mut CoordinatorClient<Channel>,
    spoil: impl FnOnce(&mut v2::RegisterRequest),
) -> v2::Refused {
    let mut request = introduction();
    spoil(&mut request);
    match client.register(request).await.unwrap().into_inner().outcome.unwrap() {
        v2::register_reply::Outcome::Refused(refused) => refused,
        v2::register_reply::Outcome::Accepted(accepted) => panic!("{accepted:?}"),
    }
}

#[tokio::test]
async fn health_probes_and_reflection_work() {
    let experiment = Experiment::new("");
    let (_coordinator, _, channel) = coordinator(&experiment).await;
    let mut health = HealthClient::new(channel.clone());
    for service in ["", "descry.v2.Coordinator"] {
        let request = HealthCheckRequest { service: service.to_owned() };
        let reply = health.check(request).await.unwrap().into_inner();
        assert_eq!(reply.status(), ServingStatus::Serving, "{service}");
    }
    let request = ServerReflectionRequest {
        host: String::new(),
        message_request: Some(MessageRequest::ListServices(String::new())),
    };
    let mut reflection = ServerReflectionClient::new(channel);
    let replies = reflection.server_reflection_info(tokio_stream::iter([request])).await.unwrap();
    let reply = replies.into_inner().next().await.unwrap().unwrap();
    let Some(MessageResponse::ListServicesResponse(ListServiceResponse { service })) = reply.message_response
    else {
        panic!("no list of services");
    };
    assert!(service.iter().any(|service| service.name == "descry.v2.Coordinator"));
}

#[tokio::test]
async fn other_versions_are_refused_and_told_what_to_do() {
    let experiment = Experiment::new("");
    let (_coordinator, _, channel) = coordinator(&experiment).await;
    // A worker of version 1 calls another service.
    let mut earlier = v1::coordinator_client::CoordinatorClient::new(channel.clone());
    let reply = earlier.register(v1::RegisterRequest {}).await.unwrap().into_inner();
    let Some(v1::register_reply::Outcome::Refused(refused)) = reply.outcome else { panic!("no refusal") };
    assert_eq!(refused.reason(), v1::RefusalReason::ProtocolVersion);
    assert!(refused.message.contains("must be 2, got 1\ninstall"), "{}", refused.message);

    let mut client = CoordinatorClient::new(channel);
    let refused = refusal(&mut client, |request| request.protocol_major += 1).await;
    assert_eq!(refused.reason(), v2::RefusalReason::ProtocolVersion);
    assert!(refused.message.contains("must be 2, got 3\ninstall"), "{}", refused.message);
    let refused = refusal(&mut client, |request| {
        request.protocol_minor = 0;
        request.worker_secret.clear(); // it knew of none
    })
    .await;
    assert_eq!(refused.reason(), v2::RefusalReason::ProtocolVersion);
    assert!(refused.message.contains("must be at least 2.2, got 2.0\ninstall"), "{}", refused.message);
    let refused = refusal(&mut client, |request| request.evaluation_version += 1).await;
    assert_eq!(refused.reason(), v2::RefusalReason::EvaluationVersion);
    assert!(refused.message.contains("evaluation version"), "{}", refused.message);
    for trick in [
        "a\nb",
        "a\u{1b}[2Jb",
        "a\u{202e}b",
        "a\u{2066}b",
        "a\u{200b}b",
        "a\u{2028}b",
        "a\u{e0041}b",
        "a\u{3164}",
    ] {
        let refused = refusal(&mut client, |request| request.name = trick.to_owned()).await;
        assert_eq!(refused.reason(), v2::RefusalReason::InvalidRequest, "{trick:?}");
        let refused = refusal(&mut client, |request| request.build = trick.to_owned()).await;
        assert_eq!(refused.reason(), v2::RefusalReason::InvalidRequest, "{trick:?}");
    }
}

#[tokio::test]
async fn what_a_worker_says_of_a_failure_forges_no_line_and_hides_nothing() {
    let experiment = Experiment::new("[ga]\npopulation = 4\n");
    let (mut coordinator, _, channel) = coordinator(&experiment).await;
    let mut client = CoordinatorClient::new(channel);
    let accepted = match client.register(introduction()).await.unwrap().into_inner().outcome.unwrap() {
        v2::register_reply::Outcome::Accepted(accepted) => accepted,
        v2::register_reply::Outcome::Refused(refused) => panic!("{refused:?}"),
    };
    let v2::RegisterRequest { worker_id, worker_secret, .. } = introduction();
    let mut poll = v2::PollRequest {
        worker_id,
        worker_secret,
        session_id: accepted.session_id,
        sequence: 1,
        wanted: 1,
        ..Default::default()
    };
    let job = client.poll(poll.clone()).await.unwrap().into_inner().jobs.remove(0);
    let forged = "worker honest: quarantined: gave an answer that two other workers contradict";
    let message = format!("disk full\n{forged}\r{forged}\u{2028}{forged}\u{1b}[1A\u{202e}\u{200b}\u{9b}");
    let failure = v2::Failure { message, ..Default::default() };
    let outcome = Some(v2::job_report::Outcome::Failure(failure));
    (poll.sequence, poll.wanted) = (2, 0);
    poll.finished = vec![v2::JobReport { lease: job.lease, run_seconds: 1.0, outcome }];
    client.poll(poll).await.unwrap();
    coordinator.wait_for("disk full");
    let log = coordinator.log();
    assert!(
        log.contains(&format!("\n  {forged}\\r{forged}\\u{{2028}}{forged}\\u{{1b}}[1A\\u{{202e}}")),
        "{log}"
    );
    assert!(!log.lines().any(|line| line.starts_with("worker honest")), "{log}");
    assert!(log.chars().all(|c| c == '\n' || proto::is_printable(c)), "{log:?}");
}

#[tokio::test]
async fn nonsense_gets_an_error_and_the_run_goes_on() {
    let experiment =
        Experiment::new("[ga]\npopulation = 4\n[stop]\ngenerations = 2\nvalidation_patience = \"off\"\n");
    let (mut coordinator, address, channel) = coordinator(&experiment).await;
    let mut client = CoordinatorClient::new(channel);

    let accepted = match client.register(introduction()).await.unwrap().into_inner().outcome.unwrap() {
        v2::register_reply::Outcome::Accepted(accepted) => accepted,
        v2::register_reply::Outcome::Refused(refused) => panic!("{refused:?}"),
    };
    assert_eq!(accepted.name, "stranger");
    let v2::RegisterRequest { worker_id, worker_secret, .. } = introduction();
    let poll = v2::PollRequest {
        worker_id,
        worker_secret,
        session_id: accepted.session_id.clone(),
        sequence: 1,
        ..Default::default()
    };
    type Spoil = fn(&mut v2::PollRequest);
    let nonsense: [(Code, Spoil); 9] = [
        (Code::InvalidArgument, |poll| poll.worker_id.clear()),
        (Code::InvalidArgument, |poll| poll.session_id.push(0)),
        (Code::InvalidArgument, |poll| poll.worker_secret.clear()),
        (Code::PermissionDenied, |poll| poll.worker_id = vec![8; 16]),
        (Code::NotFound, |poll| {
            let other = peer::introduction([8; 32], "other");
            (poll.worker_id, poll.worker_secret) = (other.worker_id, other.worker_secret);
        }),
        (Code::NotFound, |poll| poll.session_id = vec![0; 16]),
        (Code::InvalidArgument, |poll| poll.finished = vec![v2::JobReport::default()]),
        (Code::InvalidArgument, |poll| poll.held = vec![v2::Lease::default(); 1000]),
        (Code::InvalidArgument, |poll| {
            let swelling = v2::DescriptionResult { lz4: vec![0], lz4_length: 1 << 20, ..Default::default() };
            let result = Some(v2::task_result::Result::Description(swelling));
            let outcome = Some(v2::job_report::Outcome::Result(v2::TaskResult { result }));
            let report = v2::JobReport { lease: Some(v2::Lease::default()), run_seconds: 0.0, outcome };
            poll.finished = vec![report; 17];
        }),
    ];
    for (code, spoil) in nonsense {
        let mut spoiled = poll.clone();
        spoil(&mut spoiled);
        assert_eq!(client.poll(spoiled.clone()).await.unwrap_err().code(), code, "{spoiled:?}");
    }

    // Invented results are acknowledged, so that they stop coming, and not used.
    let result = EvaluationResult {
        queries: 1,
        object_correct: 1,
        category_correct: 1,
        ..EvaluationResult::default()
    };
    let report = v2::JobReport {
        lease: Some(v2::Lease { job: 1, attempt: 99, nonce: vec![0; 16] }),
        run_seconds: f64::NAN,
        outcome: Some(v2::job_report::Outcome::Result(TaskResult::Evaluation(result).into())),
    };
    let reply =
        client.poll(v2::PollRequest { finished: vec![report], ..poll.clone() }).await.unwrap().into_inner();
    assert_eq!(reply.acknowledged, [v2::Lease { job: 1, attempt: 99, nonce: vec![0; 16] }]);

    // Blobs: only by the digests of this run's data, and the test set not before the search is over.
    let mut fetch = async |digest: Vec<u8>| match client
        .fetch_blob(v2::FetchBlobRequest { digest, takes_lz4: true })
        .await
    {
        Ok(stream) => {
            let mut bytes = Vec::new();
            let mut stream = stream.into_inner();
            while let Some(chunk) = stream.next().await {
                bytes.extend(chunk.unwrap().data);
            }
            Ok(bytes)
        }
        Err(status) => Err(status.code()),
    };
    assert_eq!(fetch(b"../../etc/passwd".to_vec()).await, Err(Code::InvalidArgument));
    assert_eq!(fetch(vec![0; 32]).await, Err(Code::NotFound));
    let listed = |list: &str| {
        let list = std::fs::read_to_string(clouds().join(list)).unwrap();
        std::fs::read(clouds().join(list.lines().next().unwrap())).unwrap()
    };
    let (training, test) = (listed("train1.txt"), listed("test.txt"));
    assert_eq!(fetch(Digest::of(&training).to_vec()).await, Ok(training));
    assert_eq!(fetch(Digest::of(&test).to_vec()).await, Err(Code::NotFound));

    client.poll(v2::PollRequest { sequence: 2, leaving: true, ..poll }).await.unwrap();
    let worker = ["--coordinator", &address, "--cache", &experiment.path("cache")];
    let _worker = Running::start(experiment.folder(), "worker", "worker", worker);
    coordinator.wait().expect_success();
}

/// A coordinator that speaks version 1 only.
struct Earlier;

#[tonic::async_trait]
impl v1::coordinator_server::Coordinator for Earlier {
    async fn register(&self, _: Request<v1::RegisterRequest>) -> Result<Response<v1::RegisterReply>, Status> {
        unreachable!("a worker of version 2 calls another service")
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_worker_of_an_earlier_coordinator_ends_and_says_what_to_do() {
    let incoming = TcpIncoming::bind(([127, 0, 0, 1], 0).into()).unwrap();
    let address = format!("http://{}", incoming.local_addr().unwrap());
    let service = v1::coordinator_server::CoordinatorServer::new(Earlier);
    tokio::spawn(Server::builder().add_service(service).serve_with_incoming(incoming));
    let ended =
        tokio::task::spawn_blocking(move || crate::process::run("worker", ["--coordinator", &address]));
    let ended = ended.await.unwrap().expect_error();
    assert!(ended.stderr.contains("does not speak version 2 of the protocol\ninstall"), "{ended}");
}

#[test]
fn a_worker_says_what_is_wrong_with_its_address() {
    for (address, message) in [
        ("http://", "must name a host"),
        ("https://192.0.2.7:7700", "needs the fingerprint of its CA"),
        ("host:port", "port must be a number"),
    ] {
        let mut command = program("worker");
        let finished = crate::process::finish(command.args(["--coordinator", address])).expect_error();
        assert!(finished.stderr.contains(message), "{address}: {finished}");
    }
}
