//! Programs against peers that are not what they seem: a worker that lies, a coordinator that refuses.

use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

use proto::task::{Described, Evaluation, EvaluationResult, Match, Nearest, Report, Task, TaskResult, Tile};
use proto::v2;
use proto::v2::coordinator_server::{Coordinator, CoordinatorServer};
use results::TableName;
use tokio::net::TcpListener;
use tokio_stream::wrappers::TcpListenerStream;
use tonic::transport::Server;
use tonic::{Code, Request, Response, Status};

use crate::experiments::{Experiment, summary};
use crate::peer::Peer;
use crate::process::{Running, run};
use crate::strangers::Site;

/// Valid in form, and wrong: nothing is ever recognised, or everything, in turn, and all clouds are alike.
pub fn lie(job: v2::Job) -> v2::JobReport {
    let lease = job.lease.unwrap().into();
    let result = match Task::try_from(job.task.unwrap()).unwrap() {
        Task::Description(shard) => {
            let length = u64::from(shard.clouds) * shard.subject.facts.description_bytes;
            TaskResult::Description(Described::made(vec![0; length as usize]))
        }
        Task::GridCell(cell) => TaskResult::GridCell(vec![1; cell.descriptors as usize]),
        Task::Scale(_) => TaskResult::Scale(1.0),
        Task::Evaluation(evaluation) | Task::Tile(Tile { evaluation, .. }) => {
            TaskResult::Evaluation(lie_about(&evaluation))
        }
    };
    Report { lease, run_seconds: 0.0, outcome: Ok(result) }.into()
}

fn lie_about(Evaluation { subject, queries, want_matches, rule, .. }: &Evaluation) -> EvaluationResult {
    let wanted = if *want_matches { *queries as usize } else { 0 };
    let (matches, nearest) = if rule.is_default() {
        (vec![Match { nearest: 0, distance: 1.0, runner_up: None }; wanted], Vec::new())
    } else {
        let one = Some((0, 1.0));
        (Vec::new(), vec![Nearest { same: one, other: one }; wanted])
    };
    // Always the same of the same descriptor: a winner that is measured twice must not give the liar away.
    let sum: u32 = subject.descriptor.bytes().iter().copied().map(u32::from).sum();
    let right = if sum.is_multiple_of(2) { *queries } else { 0 };
    EvaluationResult {
        queries: *queries,
        object_correct: right,
        category_correct: right,
        matches,
        nearest,
        margin: rule.margin.then_some(0.0),
    }
}

/// Works as a liar until the coordinator goes or wants no more of it, and returns the coordinator's last word. After
/// so many answers it only listens.
async fn liar(address: String, identity: Option<PathBuf>, most_answers: u32) -> Status {
    let mut peer = Peer::join(&address, identity.as_deref(), "liar").await.unwrap();
    let without = peer.client.presign_urls(v2::PresignUrlsRequest::default()).await.unwrap_err();
    assert_eq!(without.code(), Code::Unimplemented, "this coordinator has no bucket: {without}");
    let (mut finished, mut answers) = (Vec::new(), 0);
    loop {
        let wanted = u32::from(answers < most_answers);
        if wanted == 0 {
            tokio::time::sleep(Duration::from_millis(20)).await; // such a poll is answered at once
        }
        let reply = peer.poll(|poll| {
            poll.finished = std::mem::take(&mut finished);
            poll.wanted = wanted;
        });
        match reply.await {
            Ok(reply) => finished.extend(reply.jobs.into_iter().map(lie)),
            Err(status) => {
                if status.code() == Code::FailedPrecondition {
                    // It gets no URL by which it could leave to others what it has made, either.
                    let asked = peer.client.presign_urls(v2::PresignUrlsRequest::default()).await;
                    assert_eq!(asked.unwrap_err().code(), Code::FailedPrecondition);
                }
                return status;
            }
        }
        answers += finished.len() as u32;
    }
}

/// The liar with a certificate of its own.
fn certified_liar(site: &Site, port: u16, most_answers: u32) -> tokio::task::JoinHandle<Status> {
    let identity = PathBuf::from(site.worker_folder("liar", port));
    tokio::spawn(liar(site.address(port), Some(identity), most_answers))
}

/// A coordinator and certificates for a liar and two honest workers.
fn site(experiment: Experiment) -> Site {
    Site::with(experiment, "127.0.0.1", &["liar", "first", "second"])
}

#[tokio::test(flavor = "multi_thread")]
async fn verification_finds_the_fitness_values_of_a_worker_that_lied() {
    let experiment = Experiment::new(
        "[ga]\npopulation = 4\n[stop]\ngenerations = 2\nperfect = false\nvalidation_patience = \"off\"\n\
         [results]\nbaselines = false\n",
    );
    let args = experiment.run_args("out", &["--local-workers", "0"]);
    let mut coordinator = Running::start(experiment.folder(), "coordinator", "coordinator", args);
    let address = coordinator.join_address();
    let liar = tokio::spawn(liar(address, None, u32::MAX));
    tokio::task::block_in_place(|| coordinator.wait()).expect_success();
    liar.await.unwrap();

    // The files are as they were written: only computing again tells.
    let out = experiment.path("out");
    run("coordinator", ["verify", &out, "--sample", "0"]).expect_success();
    let verified = run("coordinator", ["verify", &out, "--sample", "8"]).expect_error();
    assert!(verified.stdout.contains("NOT sound"), "{verified}");
    assert!(verified.stdout.contains("evaluations, generation 1, individual"), "{verified}");
}

/// Cells of one column of text, with another's beside them.
pub fn pairs(out: &str, table: TableName, columns: [&str; 2]) -> Vec<(String, String)> {
    let frame = results::read_table(out, table).unwrap();
    let [left, right] = columns.map(|column| {
        let cells = frame.column(column).unwrap().str().unwrap().clone();
        cells.iter().map(|cell| cell.unwrap_or_default().to_owned()).collect::<Vec<_>>()
    });
    left.into_iter().zip(right).collect()
}

const LONGER: &str = "[ga]\npopulation = 6\n[stop]\ngenerations = 5\nperfect = false\n\
    validation_patience = \"off\"\n";

const AUDITED: &str = "[ga]\npopulation = 6\n[stop]\ngenerations = 5\nperfect = false\n\
    validation_patience = \"off\"\n[coordinator]\naudit = 1.0\n";

/// Two workers that know better.
fn honest_workers(site: &Site, coordinator: &mut Running, port: u16) -> [Running; 2] {
    ["first", "second"].map(|name| honest_worker(site, coordinator, port, name))
}

fn honest_worker(site: &Site, coordinator: &mut Running, port: u16, name: &str) -> Running {
    let worker = site.certified(name, port);
    coordinator.wait_for(&format!("worker {name}: joined"));
    worker
}

#[tokio::test(flavor = "multi_thread")]
async fn what_a_liar_left_before_a_restart_changes_nothing() {
    let site = site(Experiment::new(LONGER));
    let experiment = &site.experiment;
    let honest = experiment.run("honest", &[]).expect_success();
    let args = experiment.run_args("out", &["--local-workers", "0"]);
    let (mut coordinator, port) = site.start("coordinator", "127.0.0.1", args.clone());
    let liar = certified_liar(&site, port, 20);
    tokio::task::block_in_place(|| {
        coordinator.wait_for("generation 2/5");
        coordinator.signal("KILL");
        assert_eq!(coordinator.wait().status.code(), None, "the fault came too late");
    });
    liar.await.unwrap(); // its connection is gone

    let (mut again, port) = site.start("again", "127.0.0.1", args);
    let finished = tokio::task::block_in_place(|| {
        let _workers = honest_workers(&site, &mut again, port);
        again.wait()
    })
    .expect_success();
    assert!(finished.stderr.contains("worker liar: quarantined"), "{finished}");
    assert!(finished.stderr.contains("generation 1: is not what was written before"), "{finished}");
    assert_eq!(summary(&finished)["run_digest"], summary(&honest)["run_digest"], "{finished}");
    run("coordinator", ["verify", &experiment.path("out")]).expect_success();
}

#[tokio::test(flavor = "multi_thread")]
async fn two_workers_that_differ_end_the_run_with_a_code_of_its_own_where_no_third_comes() {
    let site = site(Experiment::new(&format!("{AUDITED}worker_grace_seconds = 1\n")));
    let experiment = &site.experiment;
    let honest = experiment.run("honest", &["--local-workers", "2"]).expect_success();
    let args = experiment.run_args("out", &["--local-workers", "0"]);
    let (mut coordinator, port) = site.start("coordinator", "127.0.0.1", args);
    // Then it waits: the run must not end before the other comes.
    let liar = certified_liar(&site, port, 12);
    let ended = tokio::task::block_in_place(|| {
        coordinator.wait_for("generation 1/5");
        let _worker = honest_worker(&site, &mut coordinator, port, "first");
        coordinator.wait()
    })
    .expect_error();
    liar.await.unwrap(); // its connection is gone
    assert_eq!(ended.status.code(), Some(6), "{ended}");
    assert!(ended.stderr.contains("workers differ and no other is there to decide"), "{ended}");
    assert!(ended.stderr.contains("start a worker with another certificate"), "{ended}");
    let events = pairs(&experiment.path("out"), TableName::Events, ["event", "worker"]);
    assert!(events.iter().any(|(event, _)| event == "undecided"), "{events:?}");

    let finished = experiment.run("out", &["--local-workers", "2"]).expect_success();
    assert!(finished.stderr.contains("unfinished, goes on with"), "{finished}");
    assert_eq!(summary(&finished)["run_digest"], summary(&honest)["run_digest"], "{finished}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_lying_worker_changes_nothing_whether_everything_is_audited() {
    a_liar_is_found_out("", AUDITED, 8).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn nor_where_newcomers_are_and_it_describes_wrongly_what_others_match() {
    // Eight pieces each, of six individuals, and more.
    a_liar_is_found_out("", &format!("{LONGER}[coordinator]\npieces = 4\n"), 60).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn nor_where_scales_and_evaluations_rest_on_what_it_describes() {
    let structures = "[descriptor]\nfamily = \"structure\"\nmax_bins = 300\n";
    // Four shards of each channel of six individuals, their scales, eight shards and four tiles of each, and more.
    a_liar_is_found_out(structures, &format!("{LONGER}[coordinator]\npieces = 4\n"), 300).await;
}

/// One worker lies so many times before those come who know better.
async fn a_liar_is_found_out(family: &str, settings: &str, lies: u32) {
    let site = site(Experiment::new(&format!("{family}{settings}")));
    let experiment = &site.experiment;
    let whole = Experiment::new(&format!("{family}{AUDITED}"));
    let honest = whole.run("honest", &[]).expect_success();
    let args = experiment.run_args("out", &["--local-workers", "0"]);
    let (mut coordinator, port) = site.start("coordinator", "127.0.0.1", args);
    // The liar has the first generation and more to itself, before those come who know better.
    let liar = certified_liar(&site, port, lies);
    let workers = tokio::task::block_in_place(|| {
        coordinator.wait_for("answers go unaudited");
        coordinator.wait_for("generation 1/5");
        honest_workers(&site, &mut coordinator, port)
    });
    let last_word = liar.await.unwrap();
    assert_eq!(last_word.code(), Code::FailedPrecondition, "{last_word}");
    assert!(last_word.message().contains("was wrong"), "{last_word}");
    let finished = tokio::task::block_in_place(|| coordinator.wait()).expect_success();
    assert_eq!(summary(&finished)["run_digest"], summary(&honest)["run_digest"], "{finished}");
    assert!(finished.stderr.contains("worker liar: quarantined"), "{finished}");
    assert!(finished.stderr.contains("back to generation 1"), "{finished}");
    drop(workers);

    let out = experiment.path("out");
    let departures = pairs(&out, TableName::Workers, ["worker", "departure"]);
    let is = |worker: &str, what: &str| (worker.to_owned(), what.to_owned());
    assert!(departures.contains(&is("liar", "quarantined")), "{departures:?}");
    assert_eq!(departures.len(), 3, "{departures:?}");
    let attempts = pairs(&out, TableName::Attempts, ["worker", "end"]);
    assert!(attempts.contains(&is("liar", "answered")), "{attempts:?}");
    // Which of the two comes first, and which agrees with it, is theirs.
    assert!(attempts.iter().any(|(worker, end)| worker != "liar" && end == "agreed"), "{attempts:?}");
    assert!(attempts.iter().any(|(worker, end)| worker != "liar" && end == "disagreed"), "{attempts:?}");
    let events = pairs(&out, TableName::Events, ["event", "worker"]);
    for expected in [is("unaudited", ""), is("disagreement", ""), is("quarantined", "liar"), is("rewind", "")]
    {
        assert!(events.contains(&expected), "{expected:?} in {events:?}");
    }
    let evaluations = pairs(&out, TableName::Evaluations, ["worker", "chromosome"]);
    assert!(evaluations.iter().all(|(worker, _)| worker != "liar"), "{evaluations:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_lying_worker_changes_no_grid_where_everything_is_audited_before_a_restart_and_after() {
    // 480 cells, so that there are some left for everybody.
    let site = site(Experiment::new(
        "[descriptor.genes]\nshape_bins = { min = 8, max = 64, step = 56 }\nm = { min = 3, max = 3, step = 1 }\n\
         w = { min = 0.0, max = 1.0, step = 1.0 }\n[coordinator]\naudit = 1.0\n",
    ));
    let experiment = &site.experiment;
    let args = |out: &str, workers: &str| -> Vec<String> {
        ["exhaust", &experiment.path("exp.toml"), "--out", &experiment.path(out), "--listen", "127.0.0.1:0"]
            .into_iter()
            .chain(["--json", "--local-workers", workers])
            .map(str::to_owned)
            .collect()
    };
    let honest = summary(&run("coordinator", args("honest", "2")).expect_success());

    let (mut coordinator, port) = site.start("coordinator", "127.0.0.1", args("out", "0"));
    let first_liar = certified_liar(&site, port, 20);
    tokio::task::block_in_place(|| {
        coordinator.wait_for("cell 20/480");
        coordinator.signal("KILL");
        assert_eq!(coordinator.wait().status.code(), None, "the fault came too late");
    });
    first_liar.await.unwrap(); // its connection is gone

    let (mut again, port) = site.start("again", "127.0.0.1", args("out", "0"));
    let second_liar = certified_liar(&site, port, 20);
    let finished = tokio::task::block_in_place(|| {
        again.wait_for("cell 20/480");
        let _workers = honest_workers(&site, &mut again, port);
        again.wait()
    })
    .expect_success();
    second_liar.await.unwrap();
    assert!(finished.stderr.contains("worker liar: quarantined"), "{finished}");
    assert!(finished.stderr.contains("20 cells that were in doubt are computed again"), "{finished}");
    let before = finished.stderr.split("in doubt").next().unwrap();
    assert!(!before.contains("are there already"), "what the first has left is kept: {finished}");
    assert_eq!(summary(&finished)["grid_digest"], honest["grid_digest"], "{finished}");
}

/// A coordinator that takes nobody.
struct Refuser;

type Blobs = tokio_stream::Empty<Result<v2::BlobChunk, Status>>;

#[tonic::async_trait]
impl Coordinator for Refuser {
    async fn register(
        &self,
        request: Request<v2::RegisterRequest>,
    ) -> Result<Response<v2::RegisterReply>, Status> {
        assert_eq!(request.into_inner().name, "unlucky");
        let refused = v2::Refused {
            reason: v2::RefusalReason::EvaluationVersion.into(),
            message: "evaluation version: must be 7, got 1\ninstall release 7 on this worker".to_owned(),
        };
        Ok(Response::new(v2::RegisterReply { outcome: Some(v2::register_reply::Outcome::Refused(refused)) }))
    }

    async fn poll(&self, _: Request<v2::PollRequest>) -> Result<Response<v2::PollReply>, Status> {
        Err(Status::new(Code::NotFound, "nobody is registered here"))
    }

    type FetchBlobStream = Blobs;

    async fn fetch_blob(&self, _: Request<v2::FetchBlobRequest>) -> Result<Response<Blobs>, Status> {
        Err(Status::new(Code::NotFound, "nothing here"))
    }

    type FetchDerivedStream = Blobs;

    async fn fetch_derived(&self, _: Request<v2::FetchDerivedRequest>) -> Result<Response<Blobs>, Status> {
        Err(Status::new(Code::NotFound, "nothing here"))
    }

    async fn presign_urls(
        &self,
        _: Request<v2::PresignUrlsRequest>,
    ) -> Result<Response<v2::PresignUrlsReply>, Status> {
        Err(Status::new(Code::Unimplemented, "nothing here"))
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
