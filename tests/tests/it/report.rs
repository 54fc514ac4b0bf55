//! Reports, as a browser shows them.

mod browsing;
mod papers;
mod written;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use tempfile::TempDir;

use self::browsing::{expect_drawn, figures, report};
use self::written::{write_comparison, write_hostile};
use crate::browser;
use crate::experiments::{Experiment, summary};

const SEARCH: &str = "[ga]\npopulation = 6\n[stop]\ngenerations = 6\nstagnation = \"off\"\nvalidation_patience = \"off\"\n\
    [coordinator]\naudit = 0\n";

const FIGURES: [&str; 10] = [
    "convergence",
    "mutation",
    "diversity",
    "genes",
    "marginals",
    "lineage",
    "confusion-objects",
    "confusion-categories",
    "generation-times",
    "timeline",
];

/// Content of every file of a folder of tables.
fn tables(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut content = BTreeMap::new();
    for table in results::TableName::RUN {
        let Ok(entries) = fs::read_dir(folder.join(table.as_str())) else { continue };
        for entry in entries {
            let path = entry.unwrap().path();
            content.insert(path.clone(), fs::read(path).unwrap());
        }
    }
    content
}

#[test]
fn the_report_of_a_run_draws_every_figure_and_loads_nothing() {
    let experiment = Experiment::new(SEARCH);
    experiment.run("out", &["--seed", "7"]).expect_success(); // whose winner is not of the first generation
    let out = experiment.folder().join("out");
    let before = tables(&out);
    let page = out.join("report/report.html");
    let finished = report(&[&experiment.path("out")]).expect_success();
    assert!(finished.stdout.starts_with(&format!("{}\n14 figures as SVG in ", page.display())), "{finished}");
    // That test clouds are shown is noted, once; nothing else changes.
    let after = tables(&out);
    let is_look = |file: &PathBuf| file.starts_with(out.join("looks"));
    assert!(
        after.iter().filter(|(file, _)| !is_look(file)).eq(before.iter().filter(|(file, _)| !is_look(file)))
    );
    let html = fs::read_to_string(&page).unwrap();
    for text in [
        "The times of the descriptors were not measured.",
        "looked at 2 times (UTC). ",
        "clouds that the winner gets wrong are shown",
        "class=\"triple\"",
        "short, seed 7",
        "Wilson",
        "method = &quot;ga&quot;",
    ] {
        assert!(html.contains(text), "{text}");
    }
    let again = experiment.run("out", &["--seed", "7"]).expect_success();
    let verdict = summary(&again)["verdict"].clone();
    assert_eq!(verdict.as_array().unwrap().len(), 2);
    for sentence in verdict.as_array().unwrap() {
        assert!(html.contains(&format!("<p>{}</p>", sentence.as_str().unwrap())), "{sentence}");
    }
    expect_drawn(&page, &[&FIGURES[..], &COMPARISON[..3], &["channels-on-cloud"]].concat());
    assert!(
        html.contains("on the training cloud") && html.contains("</svg> disk, 0 to "),
        "where the winner looks"
    );
    // Equal tables, equal bytes.
    let (again, svg) = (experiment.path("again.html"), experiment.path("svg"));
    report(&[&experiment.path("out"), "--out", &again, "--svg", &svg]).expect_success();
    assert!(tables(&out) == after, "a report that is made again shows nothing more");
    assert_eq!(fs::read_to_string(again).unwrap(), html);
    assert_eq!(figures(Path::new(&svg)), figures(page.parent().unwrap()));
    // Where clouds cannot be read, the page says so, and the rest is there.
    fs::remove_file(out.join("clouds.tsv")).unwrap();
    let without = experiment.path("without.html");
    report(&[&experiment.path("out"), "--out", &without, "--svg", &svg]).expect_success();
    let html = fs::read_to_string(without).unwrap();
    assert!(
        html.contains("Where the winner looks is not drawn on a cloud: ")
            && html.contains("no list of clouds")
    );
    assert!(!html.contains("channels-on-cloud") && html.contains("<figure id=\"convergence\">"));
}

#[test]
fn the_report_of_a_structure_shows_its_channels() {
    let search = "[descriptor]\nfamily = \"structure\"\n[ga]\npopulation = 6\n[stop]\nevaluations = 12\n";
    let experiment = Experiment::new(search);
    let ran = experiment.run("out", &[]).expect_success();
    let page = experiment.folder().join("report.html");
    report(&[&experiment.path("out"), "--out", &page.display().to_string()]).expect_success();
    let html = fs::read_to_string(&page).unwrap();
    // The winner has no codes in slots that are not active.
    let slots = summary(&ran)["best"].as_object().unwrap().clone();
    let active =
        (1..=4).filter(|slot| slots.get(&format!("s{slot}_pairs")).is_some_and(|pairs| pairs.is_u64()));
    let active = active.count();
    assert!(active > 0, "{slots:?}");
    let (_, channels) = html.split_once("<figure id=\"channels\">").unwrap();
    let (channels, _) = channels.split_once("</figure>").unwrap();
    let alone = if active == 1 { 2 } else { 1 }; // for telephones, too
    assert!([active, alone * active].contains(&channels.matches("class=\"plot").count()), "{active}");
    let drawn: Vec<String> = figures(experiment.folder());
    let (_, seen) = html.split_once("<figure id=\"channels-on-cloud\">").expect("its channels on a cloud");
    let (seen, after) = seen.split_once("</figure>").unwrap();
    assert!(seen.contains("class=\"plot\""), "{active}");
    let (table, _) = after.split_once("</table>").unwrap();
    assert!(table.matches("<tr>").count() > active, "a row for each at least: {table}");
    assert!(drawn.iter().any(|name| name == "channels") && drawn.iter().any(|name| name == "channel-bins"));
    let drawn: Vec<&str> = drawn.iter().map(String::as_str).collect();
    expect_drawn(&page, &drawn);
}

#[test]
fn a_browser_tells_of_errors_and_of_what_a_page_asks_for() {
    let folder = TempDir::new().unwrap();
    let page = folder.path().join("wrong.html");
    let policy =
        "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; script-src 'nonce-a'\">";
    let content = "<img src=\"http://127.0.0.1:9/x\"><script>console.log('unasked')</script>\
        <script nonce=\"a\">undefined.thing</script>";
    fs::write(&page, format!("<!DOCTYPE html><head>{policy}</head><body>{content}</body>")).unwrap();
    let Some(opened) = browser::open(folder.path(), &page) else { return };
    let told = |words: &str| opened.console.iter().any(|line| line.contains(words));
    assert!(told("TypeError") && told("127.0.0.1:9/x") && !told("unasked"), "{:?}", opened.console);
}

const COMPARISON: [&str; 4] =
    ["comparison-errors", "recall-precision", "comparison-objects", "comparison-times"];

#[test]
fn names_of_all_kinds_and_great_numbers_of_things_are_only_shown() {
    let folder = TempDir::new().unwrap();
    let out = folder.path().join("run");
    write_hostile(&out, [3, 2], 300, 100_000);
    write_comparison(&out, 300);
    report(&[out.to_str().unwrap()]).expect_success();
    let page = out.join("report/report.html");
    let Some(dom) = expect_drawn(&page, &[&FIGURES[..], &COMPARISON].concat()) else { return };
    let (_, title) = dom.split_once("<title>").unwrap();
    assert!(title.starts_with("&lt;script&gt;document.title='run'"), "{}", &title[..80]);
    assert!(dom.contains("looked at 2 times (UTC), and without a note at the end of the run."));
    assert!(!dom.contains("<img") && !dom.contains("<script"));
}

#[test]
fn what_is_there_of_a_run_is_shown() {
    let folder = TempDir::new().unwrap();
    for generations in [0, 1] {
        let out = folder.path().join(generations.to_string());
        write_hostile(&out, [generations, 2], 0, 0);
        report(&[out.to_str().unwrap()]).expect_success();
        let html = fs::read_to_string(out.join("report/report.html")).unwrap();
        assert!(html.contains("unfinished"));
        assert_eq!(html.contains("<figure id=\"convergence\">"), generations == 1);
        assert_eq!(html.contains("No generation is complete yet."), generations == 0);
    }
}

#[test]
fn what_is_no_run_or_damaged_is_named() {
    let folder = TempDir::new().unwrap();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let message = |args: &[&str], parts: &[&str]| {
        let finished = report(args).expect_error();
        for part in parts {
            assert!(finished.stderr.contains(part), "{part}: {finished}");
        }
    };
    message(&[&path("nothing")], &["nothing/evaluations", "check that this is a run folder"]);
    write_hostile(&folder.path().join("run"), [2, 2], 3, 5);
    message(&[&path("run"), "--grid", &path("nothing")], &["nothing/marginals"]);
    message(&[&path("run"), &path("run")], &["--out: no default for several runs, got 2"]);
    let file = folder.path().join("run/predictions/test.parquet");
    let mut bytes = fs::read(&file).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&file, bytes).unwrap();
    message(&[&path("run")], &["run/predictions/test.parquet", "damaged"]);
    assert!(!folder.path().join("run/report").exists());
}

#[test]
fn the_report_of_a_sweep_compares_kinds_of_search() {
    let variants = "[sweep]\nseeds = \"1..3\"\n[sweep.variants.ga]\nsearch.method = \"ga\"\n\
        [sweep.variants.blind]\nsearch.method = \"random\"\n";
    let experiment = Experiment::new(&format!("{SEARCH}{variants}"));
    experiment.run("out", &[]).expect_success();
    report(&[&experiment.path("out")]).expect_success();
    let page = experiment.folder().join("out/report/report.html");
    let html = fs::read_to_string(&page).unwrap();
    for text in
        ["6 runs of 2 kinds", "ga (3)", "blind (3)", "method random", "Mann and Whitney", "blind-seed-2"]
    {
        assert!(html.contains(text), "{text}");
    }
    expect_drawn(&page, &["seeds-errors", "seeds-convergence"]);
    // Each run of which there is a report is a way to it.
    assert!(html.contains("No report yet of 6 runs: <code>coordinator report "), "{html}");
    report(&[&experiment.path("out/ga-seed-2")]).expect_success();
    report(&[&experiment.path("out")]).expect_success();
    let html = fs::read_to_string(&page).unwrap();
    assert_eq!(html.matches("<a href=\"../").count(), 1);
    assert!(html.contains("<a href=\"../ga-seed-2/report/report.html\">ga-seed-2</a>"));
    // One run of it, named twice, is one run.
    let (member, twice) = (experiment.path("out/ga-seed-1"), experiment.path("twice.html"));
    let finished = report(&[&member, &member, "--out", &twice]).expect_success();
    assert!(finished.stderr.contains("named twice"), "{finished}");
    assert!(fs::read_to_string(twice).unwrap().contains("short, seed 1"));
}
