//! What liars have left in a cache: no later run rests on it, and it goes when one of them is found out.

use std::fs;
use std::path::PathBuf;

use results::TableName;
use serde_json::Value;

use crate::experiments::{Experiment, digest, summary};
use crate::hostile::answer_all;
use crate::impostors::lie;
use crate::peer::Peer;
use crate::process::{Finished, Running, run};
use crate::remembering::store;
use crate::strangers::Site;

/// With a share of everything that is audited and checked again.
fn search(audit: &str, generations: u32) -> Experiment {
    Experiment::new(&format!(
        "[ga]\npopulation = 8\n[stop]\ngenerations = {generations}\nstagnation = \"off\"\nperfect = false\n\
         validation_patience = \"off\"\n[results]\nbaselines = false\n[coordinator]\naudit = {audit}\n"
    ))
}

const LIARS: [&str; 2] = ["liar-a", "liar-b"];

/// A run that two liars have to themselves, who agree: it ends well, its digest is wrong, and the cache believes them.
async fn poisoned(site: &Site, cache: &str) -> Finished {
    let args = site.experiment.run_args("poisoned", &["--local-workers", "0", "--cache", cache]);
    let (mut coordinator, port) = site.start("coordinator", "127.0.0.1", args);
    // Both are there before one of them answers: each is to second the other.
    let mut peers = Vec::new();
    for name in LIARS {
        let folder = PathBuf::from(site.worker_folder(name, port));
        peers.push(Peer::join(&site.address(port), Some(&folder), name).await.unwrap());
    }
    let liars: Vec<_> = peers.into_iter().map(|peer| tokio::spawn(answer_all(peer, lie))).collect();
    let poisoned = tokio::task::block_in_place(|| coordinator.wait()).expect_success();
    for liar in liars {
        liar.await.unwrap();
    }
    poisoned
}

/// That a run went as it should although the cache had lies, and that it has said what it did about them.
#[track_caller]
fn assert_cured(site: &Site, cured: &Finished, cache: &str) {
    let experiment = &site.experiment;
    assert!(
        cured.stderr.contains("certificate ")
            && cured.stderr.contains(" was wrong: dropped from the cache: "),
        "{cured}"
    );
    assert!(!cured.stderr.contains("dropped from the cache: 0 counts"), "{cured}");
    let named =
        format!("{} rests on such answers, too; check it: coordinator verify ", experiment.path("poisoned"));
    assert!(cured.stderr.contains(&named), "{cured}");
    // Nothing of theirs is left: the next one has nothing to complain of, and need not compute what this one has.
    let alone = experiment.run("alone", &["--no-cache"]).expect_success();
    assert_eq!(digest(cured), digest(&alone), "{cured}");
    let next = experiment.run("next", &["--cache", cache]).expect_success();
    assert_eq!(digest(&next), digest(&alone));
    assert!(!next.stderr.contains("was wrong"), "{next}");
}

async fn two_liars_have_left_what_a_run_begins_with(audit: &str) {
    let site = Site::with(search(audit, 12), "127.0.0.1", &LIARS);
    let cache = site.experiment.path("cache");
    let poisoned = poisoned(&site, &cache).await;
    tokio::task::block_in_place(|| {
        let cured = site.experiment.run("cured", &["--cache", &cache]).expect_success();
        assert_ne!(digest(&poisoned), digest(&cured), "they told the truth");
        assert!(cured.stderr.contains("back to generation 1: remembered counts: "), "{cured}");
        assert_cured(&site, &cured, &cache);
        let next = site.experiment.path("next");
        let computed = &summary(&site.experiment.run("next", &["--cache", &cache]).expect_success())["evaluations_computed"];
        assert_eq!(computed, 0, "{next}");
    });
}

#[tokio::test(flavor = "multi_thread")]
async fn what_two_liars_have_left_is_found_by_computing_it_again() {
    two_liars_have_left_what_a_run_begins_with("1.0").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn what_two_liars_have_left_is_found_by_the_winner_where_nothing_else_is_checked() {
    two_liars_have_left_what_a_run_begins_with("0.0").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_liar_that_is_found_out_later_takes_with_it_what_it_has_left_before() {
    // Long enough for it to join.
    let site = Site::with(search("0.0", 60), "127.0.0.1", &LIARS);
    let cache = site.experiment.path("cache");
    poisoned(&site, &cache).await;

    // Another search, so that the winner is not what gives it away: a newcomer is audited, by the coordinator itself.
    let args = site.experiment.run_args("cured", &["--local-workers", "1", "--seed", "9", "--cache", &cache]);
    let (mut coordinator, port) = site.start("coordinator", "127.0.0.1", args);
    let folder = PathBuf::from(site.worker_folder("liar-b", port));
    let peer = Peer::join(&site.address(port), Some(&folder), "liar-b").await.unwrap();
    let liar = tokio::spawn(answer_all(peer, lie));
    let cured = tokio::task::block_in_place(|| coordinator.wait()).expect_success();
    let last_word = liar.await.unwrap();
    assert!(last_word.message().contains("was wrong"), "{last_word}");
    tokio::task::block_in_place(|| {
        let alone = site.experiment.run("alone", &["--no-cache", "--seed", "9"]).expect_success();
        assert_eq!(digest(&cured), digest(&alone), "{cured}");
        // It has agreed to all that the other has left: nothing of that is there, either.
        let honest = site.experiment.run("honest", &["--cache", &cache]).expect_success();
        assert!(!honest.stderr.contains("was wrong"), "{honest}");
        let named = format!("{} rests on such answers, too", site.experiment.path("poisoned"));
        assert!(cured.stderr.contains(&named), "{cured}");
    });
}

#[tokio::test(flavor = "multi_thread")]
async fn verification_drops_what_whoever_was_wrong_has_left() {
    let site = Site::with(search("0.0", 12), "127.0.0.1", &LIARS);
    let cache = site.experiment.path("cache");
    poisoned(&site, &cache).await;
    tokio::task::block_in_place(|| {
        let out = site.experiment.path("poisoned");
        let verified =
            run("coordinator", ["verify", &out, "--sample", "20", "--cache", &cache]).expect_error();
        assert!(verified.stdout.contains("NOT sound"), "{verified}");
        assert!(verified.stderr.contains(" was wrong: dropped from the cache: "), "{verified}");
        assert!(!verified.stderr.contains("rests on such answers"), "no other run does: {verified}");
        let honest = site.experiment.run("honest", &["--cache", &cache]).expect_success();
        assert!(!honest.stderr.contains("back to generation"), "{honest}");
        let alone = site.experiment.run("alone", &["--no-cache"]).expect_success();
        assert_eq!(digest(&honest), digest(&alone), "{honest}");
    });
}

#[test]
fn a_wrong_description_is_found_and_dropped_and_the_comparison_is_right() {
    let experiment = Experiment::new(
        "[ga]\npopulation = 4\n[stop]\ngenerations = 2\nvalidation_patience = \"off\"\n[results]\nbaselines = false\n\
         [coordinator]\naudit = 1.0\n",
    );
    experiment.run("out", &[]).expect_success();
    let (out, cache) = (experiment.path("out"), experiment.path("kept"));
    let compare = || {
        let named = ["--no-times", "--replace", "--descriptor", "paper", "--cache", &cache];
        run("coordinator", ["compare", &out, "--listen", "127.0.0.1:0"].into_iter().chain(named))
            .expect_success()
    };
    compare();
    let right = results::read_comparison(&out).unwrap();

    // All clouds alike, under the source of the right ones.
    let store = store(&cache);
    let keys = store.local_keys("descriptions");
    for &key in &keys {
        let mut entry = store.get_local("descriptions", key).unwrap();
        let source = 4 + u32::from_le_bytes(entry[..4].try_into().unwrap()) as usize;
        entry[source..].fill(0);
        store.put_local("descriptions", key, &entry);
    }
    let cured = compare();
    assert!(cured.stderr.contains("principal coordinator was wrong: dropped from the cache: "), "{cured}");
    assert!(cured.stderr.contains(&format!("{out} rests on such answers, too")), "{cured}");
    assert_eq!(results::read_comparison(&out).unwrap(), right);
    let after = compare();
    assert!(!after.stderr.contains("was wrong"), "{after}");
    assert_eq!(store.local_keys("descriptions").len(), keys.len(), "they are kept again");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_grid_that_a_stranger_alone_has_counted_is_no_optimum_of_later_runs() {
    let experiment = Experiment::new(
        "[ga]\npopulation = 4\n[stop]\ngenerations = 2\nvalidation_patience = \"off\"\n[results]\nbaselines = false\n\
         [descriptor.genes]\nshape_bins = { min = 8, max = 24, step = 16 }\nm = { min = 3, max = 4, step = 1 }\n\
         R1 = { min = 0.5, max = 1.0, step = 0.5 }\nR2 = { min = 2.1, max = 3.1, step = 1.0 }\n\
         w = { min = 0.0, max = 1.0, step = 0.5 }\n",
    );
    let cache = experiment.path("cache");
    let args = |out: &str, workers: &str| {
        let (toml, out) = (experiment.path("exp.toml"), experiment.path(out));
        [
            "exhaust",
            &toml,
            "--out",
            &out,
            "--listen",
            "127.0.0.1:0",
            "--cache",
            &cache,
            "--local-workers",
            workers,
        ]
        .map(str::to_owned)
    };
    let mut coordinator =
        Running::start(experiment.folder(), "stranger", "coordinator", args("stranger", "0"));
    let liar = Peer::join(&coordinator.join_address(), None, "liar").await.unwrap();
    let liar = tokio::spawn(answer_all(liar, lie));
    tokio::task::block_in_place(|| {
        coordinator.wait().expect_success();
        let best = |out: &str| {
            summary(&experiment.run(out, &["--cache", &cache]).expect_success())["grid_best_object_correct"]
                .clone()
        };
        assert_eq!(best("before"), Value::Null);
        run("coordinator", args("own", "1")).expect_success();
        assert!(best("after").is_number());
        let [stranger, own] = ["stranger", "own"].map(|out| {
            let cells = results::read_table(experiment.path(out), TableName::Cells).unwrap();
            let basis = cells.column("basis").unwrap().str().unwrap().clone();
            basis.iter().map(|basis| basis.map(str::to_owned)).collect::<std::collections::BTreeSet<_>>()
        });
        assert_eq!((stranger, own), ([None].into(), [Some("own".to_owned())].into()));
    });
    liar.await.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn each_run_of_a_sweep_begins_again_without_what_two_liars_have_left() {
    let site = Site::with(search("0.0", 12), "127.0.0.1", &LIARS);
    let experiment = &site.experiment;
    let cache = experiment.path("cache");
    poisoned(&site, &cache).await;
    tokio::task::block_in_place(|| {
        let toml = fs::read_to_string(experiment.path("exp.toml")).unwrap();
        let sweep = experiment.path("sweep.toml");
        fs::write(&sweep, format!("{toml}[sweep]\nseeds = \"5..6\"\n")).unwrap();
        let run = |out: &str, more: &[&str]| {
            let out = experiment.path(out);
            let args = ["run", &sweep, "--out", &out, "--listen", "127.0.0.1:0", "--json"];
            let finished = run("coordinator", args.into_iter().chain(more.iter().copied())).expect_success();
            let digest = |line: &str| serde_json::from_str::<Value>(line).unwrap()["run_digest"].clone();
            (finished.stdout.lines().map(digest).collect::<Vec<_>>(), finished)
        };
        let (cured, finished) = run("cured", &["--cache", &cache]);
        assert_eq!(cured.len(), 2, "{finished}");
        assert_eq!(cured, run("alone", &["--no-cache"]).0, "{finished}");
        assert!(finished.stderr.contains("back to generation 1: remembered counts: "), "{finished}");
        assert!(finished.stderr.contains(" was wrong: dropped from the cache: "), "{finished}");
    });
}
