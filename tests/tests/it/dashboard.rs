//! The dashboard as a client sees it that is no browser: what it tells of runs, to whom, and that it changes none.

use std::fs;
use std::path::Path;

use descriptor::{Descriptor, Family};
use serde_json::{Value, json};

use crate::experiments::{Experiment, copy_folder, digest, run_demo};
use crate::http::{Events, Tls, get, request};
use crate::process::Running;
use crate::strangers::Site;

/// Long enough to be watched.
const SEARCH: &str = "[search]\nmethod = \"random\"\n[ga]\npopulation = 8\n[stop]\ngenerations = 60\n\
    stagnation = \"off\"\nvalidation_patience = \"off\"\n[coordinator]\naudit = 0\n";

/// Where a program serves its dashboard, which it says.
#[track_caller]
fn address(program: &mut Running) -> String {
    let line = program.wait_for("dashboard: http://");
    line.split("http://").nth(1).unwrap().trim_end_matches('/').to_owned()
}

/// A dashboard of a folder.
#[track_caller]
fn dashboard(experiment: &Experiment, folder: &str) -> (Running, String) {
    let args = ["dashboard", folder, "--listen", "127.0.0.1:0"];
    let mut program = Running::start(experiment.folder(), "dashboard", "coordinator", args);
    let address = address(&mut program);
    (program, address)
}

fn looks(run: &Path) -> usize {
    results::read_looks(run).unwrap().len()
}

#[test]
fn the_objectives_are_those_of_the_search() {
    let search = "[search]\nmethod = \"nsga2\"\nobjectives = [\"error\", \"size\"]\n[ga]\npopulation = 8\n\
                  [stop]\ngenerations = 1\n[coordinator]\naudit = 0\n";
    let experiment = Experiment::new(search);
    experiment.run("out", &["--local-workers", "1"]).expect_success();
    let (_program, at) = dashboard(&experiment, &experiment.path("out"));
    let list = get(&at, "/api/runs").json();
    let id = list["runs"][0]["id"].as_str().unwrap().replace('/', "%2F");
    let detail = get(&at, &format!("/api/run?id={id}")).json();
    assert_eq!(detail["objectives"], json!(["error", "size"]));
}

#[test]
fn a_finished_run_is_told_as_its_tables_have_it() {
    let demo = Experiment::with("");
    copy_folder(run_demo().folder(), demo.folder());
    let run = demo.folder().join("results/runs/demo");
    let finished = results::read_run(&run).unwrap();
    let (_program, at) = dashboard(&demo, &demo.path("results"));

    let list = get(&at, "/api/runs").json();
    let told = &list["runs"][0];
    let id = told["id"].as_str().unwrap().to_owned();
    assert_eq!(
        (id.as_str(), &told["state"], &list["may_control"]),
        ("runs/demo", &json!("finished"), &json!(true))
    );
    let row = &finished.row;
    assert_eq!(told["test_error"], json!(row.test.unwrap().object_error()));
    let detail = get(&at, "/api/run?id=runs%2Fdemo").json();
    assert_eq!(detail["digests"]["run_digest"], json!(finished.run_digest));
    assert_eq!(detail["objectives"], json!(["error"]));
    assert_eq!(
        detail["answers"],
        json!([
            "validation",
            "test",
            "compared:evolved",
            "compared:paper",
            "compared:global-chroma",
            "compared:global-hue-saturation"
        ])
    );
    let generations = get(&at, "/api/generations?id=runs/demo").json();
    assert_eq!(generations["rows"], json!(row.generations));

    // Everything once, and nothing more to who has it.
    let (mut individuals, mut costs) = (0, Vec::new());
    for (name, body) in Events::open(&at, "/api/stream?id=runs/demo") {
        if name == "individuals" {
            individuals += body["rows"].as_u64().unwrap();
            let [cost, size] = ["cost", "size"].map(|name| body["columns"][name].as_array().unwrap().clone());
            costs.extend(cost.into_iter().zip(size));
        }
        if name == "attempts" {
            break; // the last of the first messages
        }
    }
    let evaluations = results::read_evaluations(&run).unwrap();
    assert_eq!(individuals, evaluations.len() as u64);
    let counted: Vec<_> = evaluations
        .iter()
        .map(|row| Descriptor::from_values(Family::DiskRing, &row.genes).unwrap())
        .map(|one| (json!(one.recognition_cost()), json!(one.size_of_cloud())))
        .collect();
    assert_eq!(costs, counted, "counted cost and size of each individual");
    let again = format!("/api/stream?id=runs/demo&generation={}&event=0", row.generations);
    let names: Vec<String> =
        Events::open(&at, &again).map(|(name, _)| name).take_while(|name| name != "attempts").collect();
    assert!(
        !names.contains(&"generations".to_owned()) && !names.contains(&"individuals".to_owned()),
        "{names:?}"
    );

    // The answers, and how the distance of each wrong one comes about.
    let answers = get(&at, "/api/answers?id=runs/demo&of=test").json();
    let column = |name: &str| answers["columns"][name].as_array().unwrap();
    let predictions = results::read_predictions(&run, results::PredictionSplit::Test).unwrap();
    assert_eq!(column("cloud").len(), predictions.len());
    let before = looks(&run);
    let wrong = predictions.iter().filter(|answer| answer.instance != answer.predicted_instance);
    let mut explained = 0;
    for answer in wrong {
        let path =
            format!("/api/explain?id=runs/demo&query={}&answer={}", answer.cloud, answer.nearest_cloud);
        let told = get(&at, &path).json();
        // To the last place but one: the reader of JSON rounds.
        let distance = told["answer_distance"].as_f64().unwrap();
        assert!(
            (distance - answer.distance).abs() < 1e-15,
            "{}: {distance} for {}",
            answer.cloud,
            answer.distance
        );
        assert!(told["margin"].as_f64().unwrap() >= 0.0 && told["right"].is_string(), "{told}");
        explained += 1;
    }
    assert_eq!(explained, row.test.unwrap().queries - row.test.unwrap().object_correct);
    // Of a compared descriptor by its own channels, as far as it has some.
    for compared in ["paper", "global-hue-saturation"] {
        for answer in results::read_answers(&run, compared).unwrap().iter().take(5) {
            let (query, nearest) = (&answer.cloud, &answer.nearest_cloud);
            let path =
                format!("/api/explain?id=runs/demo&query={query}&answer={nearest}&compared={compared}");
            let told = get(&at, &path).json();
            let distance = told["answer_distance"].as_f64().unwrap();
            assert!((distance - answer.distance).abs() < 1e-9, "{compared}: {told} for {}", answer.distance);
        }
    }
    let path = format!("/api/explain?id=runs/demo&query={0}&answer={0}&compared=shot", predictions[0].cloud);
    assert_eq!(get(&at, &path).status, 404, "it is not in the comparison");
    let cloud = get(&at, &format!("/api/cloud?id=runs/demo&points=500&path={}", predictions[0].cloud));
    let points = u32::from_le_bytes(cloud.body[..4].try_into().unwrap()) as usize;
    assert!((100..=500).contains(&points) && cloud.body.len() == 24 + 9 * points, "{points}");
    assert_eq!(looks(&run), before + 1, "that test clouds are shown is noted once");
    let report = get(&at, "/api/report?id=runs/demo");
    assert!(report.body.len() < 2 << 20 && report.text().starts_with("<!DOCTYPE html>"));
    assert_eq!(report.header("content-disposition"), Some("attachment; filename=\"demo.html\""));
    assert_eq!(results::verify(&run).unwrap().problems.len(), 0);
}

/// Validation clouds are asked before values are weighed, test clouds after.
#[test]
fn answers_of_a_run_that_weighs_are_explained_by_the_descriptor_that_gave_them() {
    let experiment = Experiment::new(
        "[search]\nweigh = \"jointly\"\n[search.fitness]\nsplit = 1\nmargin = false\n[ga]\npopulation = 8\n\
         [stop]\ngenerations = 2\n[descriptor]\nfamily = \"structure\"\nmax_bins = 300\n",
    );
    experiment.run("results/run", &[]).expect_success();
    let run = experiment.folder().join("results/run");
    let row = results::read_run(&run).unwrap().row;
    let (_program, at) = dashboard(&experiment, &experiment.path("results"));
    let winner = format!("&generation={}&individual={}", row.winner_generation, row.winner_individual);
    for (split, by) in
        [(results::PredictionSplit::Validation, winner.as_str()), (results::PredictionSplit::Test, "")]
    {
        let answers = results::read_predictions(&run, split).unwrap();
        assert!(answers.len() > 10);
        for answer in answers {
            let (query, nearest) = (&answer.cloud, &answer.nearest_cloud);
            let told = get(&at, &format!("/api/explain?id=run&query={query}&answer={nearest}{by}")).json();
            let distance = told["answer_distance"].as_f64().unwrap();
            assert!((distance - answer.distance).abs() < 1e-9, "{split:?}: {told} for {}", answer.distance);
        }
    }
    let told = get(&at, "/api/runs").json();
    assert_eq!(told["runs"][0]["weighed_error"], json!(row.weighted_train.unwrap().object_error()));
}

#[test]
fn what_comes_from_elsewhere_or_makes_no_sense_is_refused() {
    let demo = run_demo();
    let hostile = Experiment::with("");
    copy_folder(&demo.folder().join("results/runs/demo"), &hostile.folder().join("runs/<img src=x>"));
    fs::create_dir(hostile.folder().join("runs/empty")).unwrap();
    fs::create_dir_all(hostile.folder().join("runs/broken/run")).unwrap();
    fs::write(hostile.folder().join("runs/broken/search.toml"), "").unwrap();
    fs::write(hostile.folder().join("runs/broken/run/run.parquet"), "PAR1 nothing").unwrap();
    let (_program, at) = dashboard(&hostile, &hostile.path("runs"));

    let page = get(&at, "/");
    let policy = page.header("content-security-policy").unwrap();
    assert!(
        policy.starts_with("default-src 'none'; script-src 'self';") && !policy.contains("unsafe"),
        "{policy}"
    );
    assert_eq!(page.header("x-content-type-options"), Some("nosniff"));
    for script in ["/main.js", "/viewer.js", "/style.css", "/clouds.css"] {
        assert_eq!(get(&at, script).status, 200, "{script}");
    }
    let runs = get(&at, "/api/runs").json();
    let states: Vec<(&str, &str)> = runs["runs"]
        .as_array()
        .unwrap()
        .iter()
        .map(|run| (run["id"].as_str().unwrap(), run["state"].as_str().unwrap()))
        .collect();
    assert_eq!(states, [("<img src=x>", "finished"), ("broken", "unreadable")]);

    let id = "id=%3Cimg%20src%3Dx%3E";
    for (path, status) in [
        ("/api/run?id=..".to_owned(), 404),
        ("/api/run?id=/etc".to_owned(), 404),
        ("/api/run".to_owned(), 400),
        ("/api/stream?id=nothing".to_owned(), 404),
        (format!("/api/stream?{id}&generation=-1"), 400),
        ("/api/nothing".to_owned(), 404),
        ("/../Cargo.toml".to_owned(), 404),
        ("/nothing.js".to_owned(), 404),
        (format!("/api/cloud?{id}&path=../../exp.toml"), 404),
        (format!("/api/answers?{id}&of=compared:../../run/run"), 404),
        (format!("/api/answers?{id}&of=train"), 404),
        (format!("/api/explain?{id}&query=a&answer=b&generation=9&individual=9"), 404),
        (format!("/api/landscape?{id}&a=R1&b=R2"), 404),
    ] {
        let answer = get(&at, &path);
        assert_eq!(answer.status, status, "{path}: {}", answer.text());
        if path.starts_with("/api") {
            let error = answer.json()["error"].as_str().unwrap().to_owned();
            assert!(error.lines().count() == 2, "{path}: {error}");
        }
    }
    let ask = |method: &str, headers: &[(&str, &str)], body: &str| {
        let path = if method == "GET" { "/api/runs" } else { "/api/control" };
        request(&at, method, path, headers, body).status
    };
    let origin = format!("http://{at}");
    let order = r#"{"id":"<img src=x>","action":"pause","reason":"r"}"#;
    assert_eq!(ask("GET", &[("Host", "evil.example")], ""), 403);
    assert_eq!(ask("GET", &[("Origin", "http://evil.example")], ""), 403);
    assert_eq!(ask("POST", &[], order), 403);
    assert_eq!(ask("POST", &[("Origin", "http://evil.example")], order), 403);
    assert_eq!(ask("POST", &[("Origin", &origin)], "{}"), 400);
    assert_eq!(ask("POST", &[("Origin", &origin)], &" ".repeat(1 << 20)), 413);
    assert_eq!(ask("POST", &[("Origin", &origin)], order), 409, "nobody is at work on it");
}

#[test]
fn over_tls_one_token_may_look_and_another_act_and_nobody_else_anything() {
    let site = Site::with(Experiment::with(""), "127.0.0.1", &[]);
    let demo = run_demo().folder().join("results/runs/demo");
    copy_folder(&demo, &site.experiment.folder().join("runs/demo"));
    let (runs, folder) = (site.experiment.path("runs"), site.experiment.path("tls"));
    let args = ["dashboard", &runs, "--tls", &folder, "--listen", "0.0.0.0:0"];
    let mut program = Running::start(site.experiment.folder(), "dashboard", "coordinator", args);
    let line = program.wait_for("dashboard: https://");
    let port = line.split("https://").nth(1).unwrap().split('/').next().unwrap().rsplit(':').next().unwrap();
    let at = format!("127.0.0.1:{port}");
    let tls = Tls::trusting(&Path::new(&folder).join("ca.pem"));
    let token = |name: &str| {
        let token = fs::read_to_string(Path::new(&folder).join(name)).unwrap().trim().to_owned();
        assert!(!line.contains(&token), "{line}");
        format!("Bearer {token}")
    };
    let (look, act) = (token("dashboard-view"), token("dashboard-control"));
    let ask = |path: &str, headers: &[(&str, &str)]| tls.request(&at, "GET", path, headers, "");

    // The page asks for a token, and all that it would show needs one.
    assert_eq!(ask("/", &[]).status, 200);
    // Another digit, not another case: tokens are numbers, and `A` is `a`.
    let (first, rest) = look.trim_start_matches("Bearer ").split_at(1);
    let wrong = format!("Bearer {}{rest}", if first == "0" { "1" } else { "0" });
    let worker = format!("Bearer {}", fs::read_to_string(Path::new(&folder).join("token")).unwrap().trim());
    for path in ["/api/runs", "/api/run?id=demo", "/api/stream", "/api/report?id=demo", "/api/nothing"] {
        for shown in
            [None, Some("Bearer "), Some(&wrong), Some(&look.replace("Bearer", "Basic")), Some(&worker)]
        {
            let headers: Vec<(&str, &str)> = shown.iter().map(|shown| ("Authorization", *shown)).collect();
            let answer = ask(path, &headers);
            assert_eq!(answer.status, 401, "{path} with {shown:?}");
            assert!(!answer.text().contains("demo"), "{path} with {shown:?}");
        }
    }
    for (shown, may_control) in [(&look, false), (&act, true)] {
        let answer = ask("/api/runs", &[("Authorization", shown)]);
        assert_eq!((answer.status, answer.json()["may_control"].clone()), (200, json!(may_control)));
        assert_eq!(answer.json()["runs"][0]["id"], "demo");
    }

    // From its own page only, whatever is shown.
    let own = format!("https://{at}");
    let order = json!({"id": "demo", "action": "pause", "reason": "for a test"}).to_string();
    let order = |headers: &[(&str, &str)]| tls.request(&at, "POST", "/api/control", headers, &order).status;
    assert_eq!(order(&[("Origin", &own)]), 401);
    assert_eq!(order(&[("Origin", &own), ("Authorization", &look)]), 401);
    let allowed = order(&[("Origin", &own), ("Authorization", &act)]);
    assert_eq!(allowed, 409, "it may, but nobody is at work on it");
    assert_eq!(order(&[("Authorization", &act)]), 403);
    assert_eq!(order(&[("Origin", "https://evil.example"), ("Authorization", &act)]), 403);
    assert_eq!(order(&[("Origin", &own), ("Host", "evil.example"), ("Authorization", &act)]), 403);
    for elsewhere in [("Origin", "https://evil.example"), ("Sec-Fetch-Site", "cross-site")] {
        assert_eq!(ask("/api/runs", &[elsewhere, ("Authorization", &look)]).status, 403, "{elsewhere:?}");
    }
    // A name of elsewhere that leads here has no cookie, and shows nothing.
    assert_eq!(ask("/api/runs", &[("Host", "evil.example")]).status, 401);

    // A token becomes a cookie that no script reads and no other site sends.
    let login = |token: &str| {
        let body = json!({"token": token.trim_start_matches("Bearer ")}).to_string();
        tls.request(&at, "POST", "/api/login", &[("Origin", &own)], &body)
    };
    assert_eq!(login(&wrong).status, 401);
    let answer = login(&look);
    let cookie = answer.header("set-cookie").unwrap();
    for part in ["HttpOnly", "Secure", "SameSite=Strict"] {
        assert!(cookie.contains(part), "{cookie}");
    }
    let cookie = cookie.split(';').next().unwrap();
    assert_eq!(ask("/api/runs", &[("Cookie", cookie)]).status, 200);
    assert_eq!(order(&[("Origin", &own), ("Cookie", cookie)]), 401);
}

#[test]
fn a_run_is_watched_paused_and_killed_and_its_digest_stays() {
    let experiment = Experiment::new(SEARCH);
    let undisturbed = experiment.run("undisturbed", &[]).expect_success();
    let args = experiment.run_args("out", &["--dashboard", "127.0.0.1:0", "--no-cache"]);
    let mut coordinator = Running::start(experiment.folder(), "coordinator", "coordinator", args);
    let at = address(&mut coordinator);
    coordinator.wait_for("generation 2/60");
    let origin = format!("http://{at}");
    let control = |order: Value| {
        let headers = [("Origin", origin.as_str()), ("Content-Type", "application/json")];
        let answer = request(&at, "POST", "/api/control", &headers, &order.to_string());
        (answer.status, answer.json())
    };

    // Paused, whoever looks sees it, and nothing goes on.
    let mut events = Events::open(&at, "/api/stream?id=out");
    let run = |events: &mut Events, state: &str| loop {
        let (name, body) = events.next().unwrap();
        if name == "run" && body["state"] == state {
            break body;
        }
    };
    run(&mut events, "running");
    let order = |action: &str| json!({"id": "out", "action": action, "reason": "for a test"});
    let (status, done) = control(order("pause"));
    assert_eq!(status, 200, "{done}");
    let paused = run(&mut events, "paused");
    assert!(paused["workers"] == 1 && paused["best_error"].is_number(), "{paused}");
    assert_eq!(control(order("pause")).0, 409, "it is");
    let list = get(&at, "/api/clouds?id=out").json();
    let splits: Vec<&str> =
        list["clouds"].as_array().unwrap().iter().map(|cloud| cloud["split"].as_str().unwrap()).collect();
    assert!(splits.contains(&"train1") && !splits.contains(&"test"));
    let listed = fs::read_to_string(experiment.folder().join("out/clouds.tsv")).unwrap();
    let test = listed.lines().find(|line| line.split('\t').nth(1) == Some("test")).unwrap();
    let hidden = get(&at, &format!("/api/cloud?id=out&path={}", test.rsplit('\t').next().unwrap()));
    assert_eq!(hidden.status, 403, "{}", hidden.text());
    assert_eq!(looks(&experiment.folder().join("out")), 0);

    // Killed: who reads its folder sees that it is dead, and what it had.
    coordinator.signal("KILL");
    coordinator.wait();
    assert!(events.all(|(name, _)| name != "reload"), "the connection ends");
    let (_program, other) = dashboard(&experiment, &experiment.path("out"));
    let mut events = Events::open(&other, "/api/stream?id=out");
    let dead = run(&mut events, "unfinished");
    assert!(dead["generation"].as_u64().unwrap() >= 2, "{dead}");
    let told = events.find(|(name, _)| name == "events").unwrap().1;
    let paused = told.as_array().unwrap().iter().find(|event| event["event"] == "paused").unwrap();
    assert!(paused["message"].as_str().unwrap().ends_with("in a dashboard: for a test"), "{paused}");

    // Started again it goes on, and ends as if nobody had looked.
    let finished = experiment.run("out", &["--dashboard", "127.0.0.1:0", "--no-cache"]).expect_success();
    assert_eq!(digest(&finished), digest(&undisturbed));
    run(&mut events, "finished");
    let reloaded =
        Events::open(&other, "/api/stream?id=out").find(|(name, _)| name == "generations").unwrap().1;
    assert_eq!(reloaded["rows"], 60);
}
