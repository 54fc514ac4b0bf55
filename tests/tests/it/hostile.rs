//! Workers that attack a run, written from the protocol: whatever they do, the digest is that of a run without them, and
//! nobody honest is quarantined.

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use proto::task::{Evaluation, EvaluationResult, Failure, FailureReason, Match, Report, Task, TaskResult};
use proto::v2;
use proto::v2::coordinator_client::CoordinatorClient;
use proto::v2::coordinator_server::{Coordinator, CoordinatorServer};
use results::TableName;
use tokio::task::JoinSet;
use tonic::transport::Server;
use tonic::transport::server::TcpIncoming;
use tonic::{Code, Request, Response, Status, Streaming};

use crate::experiments::{Experiment, digest, summary};
use crate::impostors::{lie, pairs};
use crate::peer::{Peer, connect, introduction, register};
use crate::process::{Finished, Running, run};
use crate::strangers::Site;

const SEARCH: &str = "[ga]\npopulation = 8\n[stop]\ngenerations = 12\nstagnation = \"off\"\nperfect = false\n\
    validation_patience = \"off\"\n[results]\nbaselines = false\n";

fn site(workers: &[&str]) -> Site {
    Site::with(Experiment::new(SEARCH), "127.0.0.1", workers)
}

/// That a run has ended as it would have alone, and who was quarantined.
fn check(site: &Site, finished: &Finished, quarantined: &[&str]) {
    let alone = tokio::task::block_in_place(|| site.experiment.run("alone", &[])).expect_success();
    assert_eq!(digest(finished), digest(&alone), "{finished}");
    let departures = pairs(&site.experiment.path("out"), TableName::Workers, ["worker", "departure"]);
    let mut found: Vec<&str> = departures
        .iter()
        .filter(|(_, departure)| departure == "quarantined")
        .map(|(worker, _)| worker.as_str())
        .collect();
    found.sort_unstable();
    found.dedup();
    assert_eq!(found, quarantined, "{departures:?}");
    run("coordinator", ["verify", &site.experiment.path("out"), "--sample", "20"]).expect_success();
}

/// Answers every job with what `answer` makes of it, until the coordinator wants no more or goes.
pub async fn answer_all(mut peer: Peer, answer: impl Fn(v2::Job) -> v2::JobReport) -> Status {
    let mut finished = Vec::new();
    loop {
        let reports = std::mem::take(&mut finished);
        let reply = peer.poll(|poll| (poll.finished, poll.wanted) = (reports, 1)).await;
        match reply {
            Ok(reply) => finished.extend(reply.jobs.into_iter().map(&answer)),
            Err(status) => return status,
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn whoever_has_read_an_id_cannot_speak_in_its_name() {
    let experiment = Experiment::new(SEARCH);
    let args = experiment.run_args("out", &["--local-workers", "0"]);
    let mut coordinator = Running::start(experiment.folder(), "coordinator", "coordinator", args);
    let address = coordinator.join_address();
    let mut victim = Peer::join(&address, None, "victim").await.unwrap();
    let mut thief = Peer::join(&address, None, "thief").await.unwrap();
    let job = victim.take().await;

    // Locked out by a sequence that cannot be topped, removed, robbed of its job.
    let id = victim.id().to_vec();
    let stolen = |poll: &mut v2::PollRequest| {
        (poll.worker_id, poll.sequence, poll.leaving) = (id.clone(), u64::MAX, true)
    };
    assert_eq!(thief.poll(stolen).await.unwrap_err().code(), Code::PermissionDenied);
    let claim = v2::RegisterRequest { worker_id: id.clone(), ..introduction([9; 32], "victim") };
    assert_eq!(thief.client.register(claim).await.unwrap_err().code(), Code::PermissionDenied);
    let (lease, report) = (job.lease.clone(), lie(job));
    let reply = thief.poll(|poll| poll.finished.push(report)).await.unwrap();
    assert_eq!(reply.acknowledged.len(), 1, "it need not come again");

    // The job is still the victim's.
    let held = lease.clone().into_iter().collect();
    let reply = victim.poll(|poll| poll.held = held).await.unwrap();
    assert!(reply.revoked.is_empty(), "{reply:?}");
    drop(coordinator);
}

#[tokio::test(flavor = "multi_thread")]
async fn what_was_said_over_one_certificate_is_of_no_use_over_another() {
    let site = site(&["victim", "thief"]);
    let args = site.experiment.run_args("out", &["--local-workers", "0"]);
    let (_coordinator, port) = site.start("coordinator", "127.0.0.1", args);
    let folder = |name: &str| PathBuf::from(site.worker_folder(name, port));
    let mut victim = Peer::join(&site.address(port), Some(&folder("victim")), "victim").await.unwrap();
    let mut thief = connect(&site.address(port), Some(&folder("thief")));
    let job = victim.take().await;

    // Every byte of the victim's next poll, secret and lease included.
    let mut captured = victim.request();
    captured.finished.push(lie(job));
    assert_eq!(thief.poll(captured.clone()).await.unwrap_err().code(), Code::NotFound);
    victim.client.poll(captured.clone()).await.unwrap();
    // The same once more is an older poll.
    assert_eq!(victim.client.poll(captured).await.unwrap_err().code(), Code::Aborted);
}

#[tokio::test(flavor = "multi_thread")]
async fn many_ids_and_connections_of_one_certificate_have_one_vote() {
    let site = site(&["liar", "first", "second"]);
    let args = site.experiment.run_args("out", &["--local-workers", "0"]);
    let (mut coordinator, port) = site.start("coordinator", "127.0.0.1", args);
    let (address, folder) = (site.address(port), PathBuf::from(site.worker_folder("liar", port)));
    let mut liars = Vec::new();
    for _ in 0..5 {
        let peer = Peer::join(&address, Some(&folder), "liar").await.unwrap();
        liars.push(tokio::spawn(answer_all(peer, lie)));
    }
    let finished = tokio::task::block_in_place(|| {
        coordinator.wait_for("generation 1/12");
        let _workers = ["first", "second"].map(|name| site.certified(name, port));
        coordinator.wait()
    })
    .expect_success();
    for liar in liars {
        assert_eq!(liar.await.unwrap().code(), Code::FailedPrecondition);
    }
    let refused = Peer::join(&address, Some(&folder), "liar").await;
    assert!(refused.is_err(), "a new id does not help it");
    check(&site, &finished, &["liar", "liar-2", "liar-3", "liar-4", "liar-5"]);
}

#[tokio::test(flavor = "multi_thread")]
async fn leases_cannot_be_guessed_after_a_restart() {
    let site = site(&["guesser", "victim", "first", "second"]);
    let args = site.experiment.run_args("out", &["--local-workers", "0"]);
    let (mut coordinator, port) = site.start("coordinator", "127.0.0.1", args.clone());
    let folder = PathBuf::from(site.worker_folder("victim", port));
    let mut victim = Peer::join(&site.address(port), Some(&folder), "victim").await.unwrap();
    let job = victim.take().await;
    coordinator.signal("KILL");
    tokio::task::block_in_place(|| coordinator.wait());

    let (mut again, port) = site.start("again", "127.0.0.1", args);
    let folder = PathBuf::from(site.worker_folder("guesser", port));
    let mut guesser = Peer::join(&site.address(port), Some(&folder), "guesser").await.unwrap();
    let own = guesser.take().await.lease.unwrap();
    let lease = job.lease.clone().unwrap();
    let nonces = [lease.nonce.clone(), own.nonce.clone(), vec![0; 16], Vec::new()];
    for attempt in 1..=64 {
        for nonce in &nonces {
            let guess = v2::Lease { attempt, nonce: nonce.clone(), ..lease.clone() };
            if guess == own {
                continue; // it may have been given the same job
            }
            let report = v2::JobReport { lease: Some(guess), ..lie(job.clone()) };
            guesser.poll(|poll| poll.finished.push(report)).await.unwrap();
        }
    }
    guesser.poll(|poll| poll.leaving = true).await.unwrap();
    let finished = tokio::task::block_in_place(|| {
        let _workers = ["first", "second"].map(|name| site.certified(name, port));
        again.wait()
    })
    .expect_success();
    check(&site, &finished, &[]);
    let attempts = pairs(&site.experiment.path("out"), TableName::Attempts, ["worker", "end"]);
    let counted =
        |(worker, end): &(String, String)| worker == "guesser" && end != "undelivered" && end != "left";
    assert!(!attempts.iter().any(counted), "{attempts:?}");
}

#[tokio::test(flavor = "multi_thread")]
async fn two_liars_who_agree_do_not_outvote_the_coordinator() {
    // Long enough for both to join.
    let longer = Experiment::new(&SEARCH.replace("generations = 12", "generations = 60"));
    let site = Site::with(longer, "127.0.0.1", &["liar-a", "liar-b"]);
    let args = site.experiment.run_args("out", &["--local-workers", "1"]);
    let (mut coordinator, port) = site.start("coordinator", "127.0.0.1", args);
    let mut liars = Vec::new();
    for name in ["liar-a", "liar-b"] {
        let folder = PathBuf::from(site.worker_folder(name, port));
        let peer = Peer::join(&site.address(port), Some(&folder), name).await.unwrap();
        liars.push(tokio::spawn(answer_all(peer, lie)));
    }
    let finished = tokio::task::block_in_place(|| coordinator.wait()).expect_success();
    for liar in liars {
        let last_word = liar.await.unwrap();
        assert!(last_word.message().contains("was wrong"), "{last_word}");
    }
    check(&site, &finished, &["liar-a", "liar-b"]);
}

/// Passes everything on between an honest worker and the coordinator, but for some results.
struct Corrupter {
    upstream: CoordinatorClient<worker::Link>,
    /// Evaluations that were answered so far.
    answers: Arc<AtomicUsize>,
    /// Whether the answer of this number is a lie.
    lies: fn(usize) -> bool,
}

type Passed = Streaming<v2::BlobChunk>;

#[tonic::async_trait]
impl Coordinator for Corrupter {
    async fn register(
        &self,
        request: Request<v2::RegisterRequest>,
    ) -> Result<Response<v2::RegisterReply>, Status> {
        let reply = self.upstream.clone().register(request.into_inner()).await?;
        Ok(Response::new(reply.into_inner()))
    }

    async fn poll(&self, request: Request<v2::PollRequest>) -> Result<Response<v2::PollReply>, Status> {
        let mut poll = request.into_inner();
        for report in &mut poll.finished {
            let Some(v2::job_report::Outcome::Result(result)) = &mut report.outcome else { continue };
            let Some(v2::task_result::Result::Evaluation(result)) = &mut result.result else { continue };
            // The same again until it is acknowledged.
            if result.matches.is_empty() && (self.lies)(self.answers.fetch_add(1, Ordering::Relaxed)) {
                (result.object_correct, result.category_correct) = (result.queries, result.queries);
            }
        }
        Ok(Response::new(self.upstream.clone().poll(poll).await?.into_inner()))
    }

    type FetchBlobStream = Passed;

    async fn fetch_blob(&self, request: Request<v2::FetchBlobRequest>) -> Result<Response<Passed>, Status> {
        Ok(Response::new(self.upstream.clone().fetch_blob(request.into_inner()).await?.into_inner()))
    }

    type FetchDerivedStream = Passed;

    async fn fetch_derived(
        &self,
        request: Request<v2::FetchDerivedRequest>,
    ) -> Result<Response<Passed>, Status> {
        Ok(Response::new(self.upstream.clone().fetch_derived(request.into_inner()).await?.into_inner()))
    }

    async fn presign_urls(
        &self,
        request: Request<v2::PresignUrlsRequest>,
    ) -> Result<Response<v2::PresignUrlsReply>, Status> {
        Ok(Response::new(self.upstream.clone().presign_urls(request.into_inner()).await?.into_inner()))
    }
}

/// One worker lies in some of its answers beside two who do not; how many answers it gave.
async fn with_some_lies(lies: fn(usize) -> bool) -> usize {
    let site = site(&["liar", "first", "second"]);
    let args = site.experiment.run_args("out", &["--local-workers", "0"]);
    let (mut coordinator, port) = site.start("coordinator", "127.0.0.1", args);
    let folder = PathBuf::from(site.worker_folder("liar", port));
    let upstream = connect(&site.address(port), Some(&folder)).max_decoding_message_size(usize::MAX);
    let answers = Arc::new(AtomicUsize::new(0));
    let incoming = TcpIncoming::bind(([127, 0, 0, 1], 0).into()).unwrap();
    let address = format!("http://{}", incoming.local_addr().unwrap());
    let corrupter = CoordinatorServer::new(Corrupter { upstream, answers: Arc::clone(&answers), lies });
    let corrupter = corrupter.max_decoding_message_size(usize::MAX);
    tokio::spawn(Server::builder().add_service(corrupter).serve_with_incoming(incoming));
    let finished = tokio::task::block_in_place(|| {
        let args = ["--coordinator", &address, "--name", "liar", "--threads", "1", "--no-cache"];
        let _liar = Running::start(site.experiment.folder(), "liar", "worker", args);
        coordinator.wait_for("generation 4/12"); // it has given more than twenty answers
        let _workers = ["first", "second"].map(|name| site.certified(name, port));
        coordinator.wait()
    })
    .expect_success();
    check(&site, &finished, &["liar"]);
    answers.load(Ordering::Relaxed)
}

#[tokio::test(flavor = "multi_thread")]
async fn a_worker_that_lies_now_and_then_is_found() {
    assert!(with_some_lies(|answer| answer % 2 == 1).await > 1);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_lie_about_the_winner_is_found() {
    // It is honest for longer than all of its answers are audited.
    assert!(with_some_lies(|answer| answer >= 14).await > 14);
}

#[tokio::test(flavor = "multi_thread")]
async fn three_workers_that_always_fail_do_not_end_a_run() {
    let experiment = Experiment::new(SEARCH);
    let args = experiment.run_args("out", &["--local-workers", "0"]);
    let mut coordinator = Running::start(experiment.folder(), "coordinator", "coordinator", args);
    let address = coordinator.join_address();
    let fail = |job: v2::Job| {
        let outcome = Err(Failure::new(FailureReason::Panic, "out of memory"));
        Report { lease: job.lease.unwrap().into(), run_seconds: 0.0, outcome }.into()
    };
    let mut sick = Vec::new();
    for name in ["sick-1", "sick-2", "sick-3"] {
        sick.push(Peer::join(&address, None, name).await.unwrap());
    }
    let args = ["--coordinator", &address, "--name", "well", "--threads", "1", "--no-cache"];
    let _well = Running::start(experiment.folder(), "well", "worker", args);
    tokio::task::block_in_place(|| coordinator.wait_for("worker well: joined"));
    for peer in sick {
        tokio::spawn(answer_all(peer, fail));
    }
    let finished = tokio::task::block_in_place(|| coordinator.wait()).expect_success();
    assert!(finished.stderr.contains("fails too often and gets no jobs for"), "{finished}");
    let alone = tokio::task::block_in_place(|| experiment.run("alone", &[])).expect_success();
    assert_eq!(digest(&finished), digest(&alone));
}

/// Registers twenty ids over a connection of its own; how many were let in.
async fn flood(address: String, connection: u32) -> (CoordinatorClient<worker::Link>, u32) {
    let mut client = connect(&address, None);
    let mut registered = 0;
    for number in 0..20u32 {
        let mut secret = [0; 32];
        secret[..4].copy_from_slice(&connection.to_le_bytes());
        secret[4..8].copy_from_slice(&number.to_le_bytes());
        let reply = register(&mut client, introduction(secret, "flood")).await;
        registered += u32::from(reply.is_ok());
    }
    (client, registered)
}

#[tokio::test(flavor = "multi_thread")]
async fn ten_thousand_ids_and_sixty_greedy_connections_lock_nobody_out() {
    let experiment = Experiment::new(SEARCH);
    let args = experiment.run_args("out", &["--local-workers", "0"]);
    let mut coordinator = Running::start(experiment.folder(), "coordinator", "coordinator", args);
    let address = coordinator.join_address();
    let mut connections = Vec::new();
    for several in (0..505).collect::<Vec<u32>>().chunks(20) {
        let flood = several.iter().map(|&connection| flood(address.clone(), connection));
        connections.extend(flood.collect::<JoinSet<_>>().join_all().await);
    }
    assert_eq!(connections.iter().map(|(_, registered)| registered).sum::<u32>(), 10_100);
    coordinator.wait_for("displaced");

    // Each sends four messages of nearly the largest size at the same time.
    let before = coordinator.resident().unwrap();
    let greedy =
        connections.into_iter().take(60).flat_map(|(client, _)| vec![client; 4]).map(|mut client| {
            tokio::spawn(async move {
                let worker_secret = vec![0; proto::MAX_MESSAGE_BYTES - 1000];
                client.poll(v2::PollRequest { worker_secret, ..Default::default() }).await.map(drop)
            })
        });
    let greedy: Vec<_> = greedy.collect();
    let mut most = before;
    while !greedy.iter().all(tokio::task::JoinHandle::is_finished) {
        most = most.max(coordinator.resident().unwrap());
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
    let mut refused = 0;
    for one in greedy {
        let status = one.await.unwrap().unwrap_err();
        refused += usize::from(status.code() != Code::InvalidArgument);
    }
    assert!(refused > 0, "the budget was never used up");
    assert!(most - before < 512 << 10, "{} KiB more", most - before);

    let args = ["--coordinator", &address, "--name", "honest", "--threads", "1", "--no-cache"];
    let _honest = Running::start(experiment.folder(), "honest", "worker", args);
    let finished = tokio::task::block_in_place(|| {
        coordinator.wait_for("worker honest: joined");
        coordinator.wait()
    })
    .expect_success();
    let alone = tokio::task::block_in_place(|| experiment.run("alone", &[])).expect_success();
    assert_eq!(digest(&finished), digest(&alone));
}

#[tokio::test(flavor = "multi_thread")]
async fn what_a_liar_alone_has_said_is_remembered_by_no_later_run() {
    let experiment = Experiment::new(SEARCH);
    let (cache, other) = (experiment.path("cache"), experiment.path("other-cache"));
    let args = experiment.run_args("out", &["--local-workers", "0", "--cache", &cache]);
    let mut coordinator = Running::start(experiment.folder(), "coordinator", "coordinator", args);
    let liar = Peer::join(&coordinator.join_address(), None, "liar").await.unwrap();
    let liar = tokio::spawn(answer_all(liar, lie));
    let poisoned = tokio::task::block_in_place(|| coordinator.wait()).expect_success();
    liar.await.unwrap();
    assert!(poisoned.stderr.contains("answers go unaudited"), "{poisoned}");

    let [warm, alone] = tokio::task::block_in_place(|| {
        [("warm", ["--cache", &cache]), ("alone", ["--cache", &other])]
            .map(|(out, more)| experiment.run(out, &more).expect_success())
    });
    assert_ne!(digest(&poisoned), digest(&alone), "it told the truth");
    assert_eq!(digest(&warm), digest(&alone));
    // What the coordinator itself has computed is remembered.
    let again =
        tokio::task::block_in_place(|| experiment.run("again", &["--cache", &cache])).expect_success();
    assert_eq!(digest(&again), digest(&alone));
    assert_eq!(summary(&warm)["evaluations_computed"], summary(&alone)["evaluations_computed"]);
    assert_eq!(summary(&again)["evaluations_computed"], 0, "{again}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_machine_that_was_repaired_is_let_in_again() {
    let longer = Experiment::new(&SEARCH.replace("generations = 12", "generations = 200"));
    let site = Site::with(longer, "127.0.0.1", &["machine"]);
    let args = site.experiment.run_args("out", &["--local-workers", "1"]);
    let (mut coordinator, port) = site.start("coordinator", "127.0.0.1", args.clone());
    let folder = PathBuf::from(site.worker_folder("machine", port));
    let broken = Peer::join(&site.address(port), Some(&folder), "machine").await.unwrap();
    let last_word = answer_all(broken, lie).await.message().to_owned();
    tokio::task::block_in_place(|| {
        coordinator.wait_for("generation 20/200"); // what came before is on the disk
        coordinator.signal("KILL");
        assert_eq!(coordinator.wait().status.code(), None, "the fault came too late")
    });
    let (_, principal) = last_word.split_once("--readmit '").unwrap();
    let principal = principal.trim_end_matches('\'').to_owned();

    let with = |principal: &str| [args.clone(), vec!["--readmit".to_owned(), principal.to_owned()]].concat();
    let finished = tokio::task::block_in_place(|| {
        let wrong = run("coordinator", with("token 192.0.2.7")).expect_error();
        let expected = "must name a principal that is quarantined in this run, got token 192.0.2.7";
        assert!(wrong.stderr.contains(expected), "{wrong}");
        let (mut again, port) = site.start("again", "127.0.0.1", with(&principal));
        again.wait_for(&format!("{principal}: is no longer quarantined"));
        let _repaired = site.certified("machine", port);
        again.wait_for("worker machine: joined");
        again.wait()
    })
    .expect_success();
    let stays = pairs(&site.experiment.path("out"), TableName::Workers, ["worker", "departure"]);
    assert!(stays.contains(&("machine".to_owned(), String::new())), "it was there to the end: {stays:?}");
    check(&site, &finished, &["machine"]);
}

/// All is recognised, but where somebody wants to see by what: then nothing is.
fn contradict_oneself(job: v2::Job) -> v2::JobReport {
    let lease = job.lease.unwrap().into();
    let Task::Evaluation(Evaluation { queries, want_matches, .. }) = job.task.unwrap().try_into().unwrap()
    else {
        panic!("no evaluation")
    };
    let found = Match { nearest: 0, distance: 1.0, runner_up: None };
    let right = if want_matches { 0 } else { queries };
    let matches = if want_matches { vec![found; queries as usize] } else { Vec::new() };
    let counts =
        EvaluationResult { queries, object_correct: right, category_correct: right, ..Default::default() };
    let outcome = Ok(TaskResult::Evaluation(EvaluationResult { matches, ..counts }));
    Report { lease, run_seconds: 0.0, outcome }.into()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_run_whose_own_answers_differ_goes_on_once_somebody_is_there_to_decide() {
    let experiment = Experiment::new(
        "[ga]\npopulation = 8\n[stop]\ngenerations = 4\nvalidation_patience = 10\n[results]\nbaselines = false\n",
    );
    let args = experiment.run_args("out", &["--local-workers", "0"]);
    let mut coordinator = Running::start(experiment.folder(), "coordinator", "coordinator", args);
    let liar = Peer::join(&coordinator.join_address(), None, "liar").await.unwrap();
    let liar = tokio::spawn(answer_all(liar, contradict_oneself));
    tokio::task::block_in_place(|| {
        let ended = coordinator.wait().expect_error();
        assert!(ended.stderr.contains("two of this run's own answers differ"), "{ended}");
        assert!(ended.stderr.contains("or --local-workers 1, then run the same command again"), "{ended}");
        let finished = experiment.run("out", &["--local-workers", "1"]).expect_success();
        assert!(finished.stderr.contains("worker liar: quarantined"), "{finished}");
        let alone = experiment.run("alone", &[]).expect_success();
        assert_eq!(digest(&finished), digest(&alone), "{finished}");
    });
    liar.await.unwrap();
}
