//! Metrics and probes as Prometheus and orchestrators see them, and that they say what the run's own tables say.

use std::collections::BTreeMap;
use std::path::Path;
use std::thread;
use std::time::{Duration, Instant};

use proto::{v1, v2};
use serde_json::Value;

use crate::experiments::{Experiment, repository};
use crate::http::{Answer, Tls, get, request};
use crate::peer;
use crate::process::{PATIENCE, Running, run};
use crate::strangers::Site;

/// Long enough to be paused while it goes on.
const SEARCH: &str = "[search]\nmethod = \"random\"\n[ga]\npopulation = 8\n[stop]\ngenerations = 400\n\
    stagnation = \"off\"\nvalidation_patience = \"off\"\n[coordinator]\naudit = 0\n";

/// Where a program serves its metrics, which it says.
#[track_caller]
fn address(program: &mut Running) -> String {
    let line = program.wait_for("metrics: http://");
    line.split("http://").nth(1).unwrap().split('/').next().unwrap().to_owned()
}

/// Samples by name and labels, as they are written.
fn samples(text: &str) -> BTreeMap<String, f64> {
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    lines
        .map(|line| {
            let (name, value) = line.rsplit_once(' ').unwrap_or_else(|| panic!("{line}"));
            (name.to_owned(), value.parse().unwrap_or_else(|_| panic!("{line}")))
        })
        .collect()
}

/// The samples at an address once they are in a state.
#[track_caller]
fn wait_for(at: &str, what: &str, state: impl Fn(&BTreeMap<String, f64>) -> bool) -> BTreeMap<String, f64> {
    let begun = Instant::now();
    loop {
        let answer = get(at, "/metrics");
        let samples = samples(&answer.text());
        if state(&samples) {
            return samples;
        }
        assert!(begun.elapsed() < PATIENCE, "not in time: {what}\n{}", answer.text());
        thread::sleep(Duration::from_millis(20));
    }
}

/// The sum of all samples of a metric.
fn sum(samples: &BTreeMap<String, f64>, name: &str) -> f64 {
    let of = |key: &str| key == name || key.strip_prefix(name).is_some_and(|rest| rest.starts_with('{'));
    samples.iter().filter(|(key, _)| of(key)).map(|(_, value)| value).sum()
}

#[track_caller]
fn ordered(run_folder: &str, order: &str) {
    run("coordinator", ["control", run_folder, order, "--reason", "for a test"]).expect_success();
}

/// How often each text stands in a column of a run's table.
fn counts(folder: &Path, table: results::TableName, column: &str) -> BTreeMap<String, f64> {
    let frame = results::read_table(folder, table).unwrap();
    let mut counts = BTreeMap::new();
    for cell in frame.column(column).unwrap().str().unwrap().iter().flatten() {
        *counts.entry(cell.to_owned()).or_default() += 1.0;
    }
    counts
}

#[test]
fn a_scrape_says_what_the_tables_say() {
    let experiment = Experiment::new(SEARCH);
    let args = experiment
        .run_args("run", &["--local-workers", "0", "--metrics", "127.0.0.1:0", "--log-format", "json"]);
    let mut coordinator = Running::start(experiment.folder(), "coordinator", "coordinator", args);
    let line = coordinator.wait_for("metrics: http://");
    let line: Value = serde_json::from_str(&line).unwrap();
    let at = line["message"].as_str().unwrap().split('/').nth(2).unwrap().to_owned();
    let join = coordinator.wait_for("workers may join with");
    let join: Value = serde_json::from_str(&join).unwrap();
    let join = join["message"].as_str().unwrap().rsplit(' ').next().unwrap().to_owned();

    // Nobody works, and the first generation waits for somebody.
    let waiting = wait_for(&at, "readiness", |now| now["descry_ready"] == 1.0);
    assert_eq!(get(&at, "/healthz").status, 200);
    assert_eq!(get(&at, "/readyz").status, 200);
    assert_eq!((sum(&waiting, "descry_workers"), sum(&waiting, "descry_jobs")), (0.0, 0.0));
    assert_eq!((waiting["descry_wanted_workers"], waiting["descry_wanted_threads"]), (1.0, 1.0));
    assert_eq!(waiting["descry_generation{run=\"run\"}"], 0.0);
    assert!(!waiting.contains_key("descry_best_fitness_ratio{run=\"run\"}"));

    // Two work, until an operator pauses them.
    let _workers = ["one", "two"].map(|name| experiment.worker(name, &join));
    wait_for(&at, "jobs for more than two", |now| now["descry_wanted_threads"] > 2.0);
    wait_for(&at, "generations", |now| now["descry_generation{run=\"run\"}"] >= 3.0);
    ordered(&experiment.path("run"), "pause");
    let idle = "descry_workers{state=\"idle\"}";
    // Jobs are open before a generation is counted as well: those that have to be confirmed by somebody else.
    let answered = "descry_attempts_total{kind=\"evaluation\",outcome=\"answered\"}";
    let begun = |now: &BTreeMap<String, f64>| 8.0 * (now["descry_generation{run=\"run\"}"] + 1.0);
    let paused = wait_for(&at, "a pause", |now| {
        now[idle] == 2.0 && sum(now, "descry_jobs") > 0.0 && now[answered] < begun(now)
    });
    assert_eq!(sum(&paused, "descry_worker_threads"), 2.0);
    assert_eq!((paused["descry_wanted_workers"], paused["descry_wanted_threads"]), (0.0, 0.0));
    assert_eq!(paused["descry_jobs{kind=\"evaluation\",state=\"paused\"}"], sum(&paused, "descry_jobs"));

    // While nothing is in hand nothing ends: a stop leaves the tables at that.
    ordered(&experiment.path("run"), "stop");
    let ended = coordinator.wait();
    assert_eq!(ended.status.code(), Some(130), "{ended}");
    for line in ended.stderr.lines() {
        let line: Value = serde_json::from_str(line).unwrap_or_else(|error| panic!("{error}: {line}"));
        assert!(line["timestamp"].is_string() && line["level"].is_string() && line["message"].is_string());
    }
    let folder = experiment.folder().join("run");
    let attempts = counts(&folder, results::TableName::Attempts, "end");
    assert!(attempts["answered"] >= 3.0 * 8.0, "{attempts:?}");
    for (outcome, count) in &attempts {
        let name = format!("descry_attempts_total{{kind=\"evaluation\",outcome=\"{outcome}\"}}");
        assert_eq!(paused.get(&name), Some(count), "{outcome}");
    }
    let all: f64 = attempts.values().sum();
    assert_eq!(sum(&paused, "descry_attempts_total"), all);
    assert_eq!(sum(&paused, "descry_leases_total"), all, "every lease has ended");
    let rows = |table| results::read_table(&folder, table).unwrap().height() as f64;
    assert_eq!(paused["descry_workers_joined_total"], rows(results::TableName::Workers));
    let generations = results::read_table(&folder, results::TableName::Generations).unwrap();
    assert_eq!(paused["descry_generation{run=\"run\"}"], generations.height() as f64);
    let best = generations.column("best_so_far_fitness").unwrap().f64().unwrap().iter().flatten().last();
    assert_eq!(paused.get("descry_best_fitness_ratio{run=\"run\"}").copied(), best);
    let reported = paused["descry_attempt_duration_seconds_count{kind=\"evaluation\"}"];
    assert!(reported >= attempts["answered"] && reported <= all, "{reported} of {all}");
    assert!(paused["descry_journal_commit_duration_seconds_count"] > 0.0);
}

#[tokio::test]
async fn workers_of_other_releases_are_counted_by_what_they_were_refused_for() {
    let experiment = Experiment::new(SEARCH);
    let args = experiment.run_args("run", &["--local-workers", "0", "--metrics", "127.0.0.1:0"]);
    let mut coordinator = Running::start(experiment.folder(), "coordinator", "coordinator", args);
    let at = address(&mut coordinator);
    let join = coordinator.join_address();
    wait_for(&at, "readiness", |now| now["descry_ready"] == 1.0);
    let link = worker::link(&join.parse().unwrap(), None).unwrap();
    v1::coordinator_client::CoordinatorClient::new(link).register(v1::RegisterRequest {}).await.unwrap();

    let mut client = peer::connect(&join, None);
    let spoilt: [fn(&mut v2::RegisterRequest); 6] = [
        |request| request.protocol_major += 1,
        |request| request.protocol_minor = 0,
        |request| request.evaluation_version += 1,
        |request| request.name = "a\nb".to_owned(),
        |request| request.worker_id = vec![9; 16],
        |request| request.worker_secret.clear(),
    ];
    for spoil in spoilt {
        let mut request = peer::introduction([7; 32], "stranger");
        spoil(&mut request);
        let registered = peer::register(&mut client, request).await.map(|reply| reply.outcome.unwrap());
        assert!(!matches!(registered, Ok(v2::register_reply::Outcome::Accepted(_))), "{registered:?}");
    }
    coordinator.wait_for("transport: wrong evaluation version: 1 refused so far, the last from 127.0.0.1");
    let refusals = || {
        let mut now = samples(&get(&at, "/metrics").text());
        now.retain(|name, _| name.starts_with("descry_refusals_total"));
        now
    };
    let of = |(reason, count): (&str, f64)| (format!("descry_refusals_total{{reason=\"{reason}\"}}"), count);
    let expected = [
        ("invalid_name_or_build", 1.0),
        ("invalid_worker_id_or_secret", 2.0),
        ("wrong_evaluation_version", 1.0),
        ("wrong_protocol_version", 3.0),
    ];
    assert_eq!(refusals(), expected.map(of).into());
    // One that is as it has to be is let in, and not counted.
    peer::register(&mut client, peer::introduction([7; 32], "friend")).await.unwrap();
    assert_eq!(sum(&samples(&get(&at, "/metrics").text()), "descry_workers_joined_total"), 1.0);
    assert_eq!(refusals(), expected.map(of).into());
}

#[test]
fn formats_are_those_that_prometheus_asks_for_and_help_is_that_of_the_book() {
    let experiment = Experiment::new(SEARCH);
    let args = experiment.run_args("run", &["--local-workers", "0", "--metrics", "127.0.0.1:0"]);
    let mut coordinator = Running::start(experiment.folder(), "coordinator", "coordinator", args);
    let at = address(&mut coordinator);
    let accept = |accept: &str| request(&at, "GET", "/metrics", &[("Accept", accept)], "");
    let kind = |answer: &Answer| answer.header("content-type").unwrap().to_owned();
    let openmetrics =
        accept("application/openmetrics-text;version=1.0.0,text/plain;version=0.0.4;q=0.5,*/*;q=0.1");
    assert_eq!(kind(&openmetrics), "application/openmetrics-text; version=1.0.0; charset=utf-8");
    assert!(openmetrics.text().ends_with("# EOF\n"));
    let plain = get(&at, "/metrics");
    assert_eq!(kind(&plain), "text/plain; version=0.0.4; charset=utf-8");

    // The table of the book has a row for each metric, and no other.
    let table = coordinator::metrics::reference();
    let text = plain.text();
    let told: Vec<&str> = text.lines().filter_map(|line| line.strip_prefix("# HELP ")).collect();
    for help in &told {
        let (name, help) = help.split_once(' ').unwrap();
        assert!(
            table
                .lines()
                .any(|row| row.contains(&format!("`{name}`")) && row.ends_with(&format!("{help} |")))
        );
    }
    assert_eq!(table.lines().filter(|line| line.starts_with("| `")).count(), told.len());

    assert_eq!(get(&at, "/else").status, 404);
    assert_eq!(request(&at, "POST", "/metrics", &[], "").status, 403);
    let elsewhere = request(&at, "GET", "/metrics", &[("Host", "evil.example")], "");
    assert_eq!(elsewhere.status, 403, "{}", elsewhere.text());
}

#[test]
fn from_other_machines_a_token_is_needed_for_metrics_and_none_for_probes() {
    let site = Site::with(Experiment::new(SEARCH), "127.0.0.1", &[]);
    let (experiment, tls) = (&site.experiment, site.experiment.path("tls"));
    let args = ["--local-workers", "0", "--metrics", "0.0.0.0:0", "--tls", &tls];
    let args = experiment.run_args("run", &args);
    let mut coordinator = Running::start(experiment.folder(), "coordinator", "coordinator", args);
    let line = coordinator.wait_for("metrics: https://");
    let port = line.split("https://").nth(1).unwrap().split('/').next().unwrap().rsplit(':').next().unwrap();
    let at = format!("127.0.0.1:{port}");
    let client = Tls::trusting(&Path::new(&tls).join("ca.pem"));
    let ask = |path: &str, headers: &[(&str, &str)]| client.request(&at, "GET", path, headers, "");
    assert_eq!(ask("/metrics", &[]).status, 401);
    assert_eq!(ask("/healthz", &[]).status, 200);
    let token = std::fs::read_to_string(Path::new(&tls).join("dashboard-view")).unwrap();
    let shown = format!("Bearer {}", token.trim());
    let answer = ask("/metrics", &[("Authorization", &shown)]);
    assert_eq!(answer.status, 200, "{}", answer.text());
    assert!(answer.text().contains("descry_build_info{"), "{}", answer.text());
}

#[test]
fn rules_dashboard_and_pages_name_no_metric_that_there_is_not() {
    let table = coordinator::metrics::reference();
    let is_known = |name: &str| {
        let bare = ["_bucket", "_sum", "_count"].iter().find_map(|suffix| name.strip_suffix(suffix));
        [Some(name), bare].into_iter().flatten().any(|name| table.contains(&format!("`{name}`")))
    };
    for file in [
        "deploy/prometheus/alerts.yml",
        "deploy/prometheus/alerts_test.yml",
        "deploy/grafana/descry.json",
        "docs/src/how-to/monitoring.md",
    ] {
        let text = std::fs::read_to_string(repository().join(file)).unwrap();
        let words = text.split(|c: char| !c.is_ascii_alphanumeric() && c != '_');
        let named: Vec<&str> = words.filter(|word| word.starts_with("descry_")).collect();
        assert!(!named.is_empty(), "{file}");
        for name in named {
            assert!(is_known(name), "{file}: {name}");
        }
    }
}
