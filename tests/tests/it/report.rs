//! Reports, as a browser shows them.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use results::{
    AttemptRow, ComparedRow, Counts, Curve, CurvePoint, DistanceRow, EvaluationRow, EventRow, GeneColumn,
    GenerationRow, LookRow, PairRow, PredictionRow, PredictionSplit, RunFolder, RunLog, RunRow, SkippedRow,
    Times,
};
use tempfile::TempDir;

use crate::browser;
use crate::experiments::{Experiment, summary};
use crate::process::{Finished, run};

const SEARCH: &str = "[ga]\npopulation = 6\n[stop]\ngenerations = 6\nstagnation = \"off\"\nvalidation_patience = \"off\"\n\
    [coordinator]\naudit = 0\n";

/// A name that is a script, an image of elsewhere and a mess.
const HOSTILE: &str =
    "<script>document.title='run'</script><img src=http://127.0.0.1:9/x onerror=alert(1)>\"'&\u{1b}größe";

fn report(args: &[&str]) -> Finished {
    run("coordinator", [&["report"], args].concat())
}

/// The SVG files in a folder, by figure.
fn figures(folder: &Path) -> Vec<String> {
    let names = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut figures: Vec<String> =
        names.filter_map(|name| name.strip_suffix(".svg").map(str::to_owned)).collect();
    figures.sort();
    figures
}

/// Opens a report and sees to it that all its figures are drawn, that nothing is wrong and that nothing is asked of
/// another machine; gives the document.
#[track_caller]
fn expect_drawn(page: &Path, expected: &[&str]) -> Option<String> {
    let folder = TempDir::new().unwrap();
    let opened = browser::open(folder.path(), page)?;
    assert_eq!(opened.console, Vec::<String>::new());
    let mut drawn: BTreeMap<&str, usize> = BTreeMap::new();
    // Plotly marks the elements that it has filled.
    let plots = opened.dom.split("<div class=\"plot js-plotly-plot\" id=\"").skip(1);
    assert!(!opened.dom.contains("<div class=\"plot\""), "a plot was not drawn");
    for part in plots {
        let (id, _) = part.split_once('"').unwrap();
        let (figure, _) = id.rsplit_once('-').unwrap();
        assert!(part.contains("class=\"main-svg\""), "{id}: not drawn");
        let marks = ["class=\"js-line\"", "class=\"js-fill\"", "class=\"point\"", "<image "];
        let marks: usize = marks.iter().map(|mark| part.matches(mark).count()).sum();
        assert!(marks > 0, "{id}: no marks");
        *drawn.entry(figure).or_default() += marks;
    }
    let mut names: Vec<&str> = drawn.keys().copied().collect();
    names.sort_unstable();
    let mut expected = expected.to_vec();
    expected.sort_unstable();
    assert_eq!(names, expected);

    // Each figure as a file, too: a browser shows none that is not well-formed.
    let folder_of = page.parent().unwrap();
    assert_eq!(figures(folder_of), expected);
    let images: String = expected
        .iter()
        .map(|name| {
            let file = folder_of.join(format!("{name}.svg"));
            format!("<img src=\"file://{}\" onerror=\"console.error('broken: {name}')\">\n", file.display())
        })
        .collect();
    let gallery = folder.path().join("gallery.html");
    fs::write(&gallery, images).unwrap();
    assert_eq!(browser::open(folder.path(), &gallery)?.console, Vec::<String>::new());
    Some(opened.dom)
}

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
    assert!(finished.stdout.starts_with(&format!("{}\n13 figures as SVG in ", page.display())), "{finished}");
    assert_eq!(tables(&out), before);
    let html = fs::read_to_string(&page).unwrap();
    for text in [
        "The times of the descriptors were not measured.",
        "looked at once (UTC). ",
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
    expect_drawn(&page, &[&FIGURES[..], &COMPARISON[..3]].concat());
    // Equal tables, equal bytes.
    let (again, svg) = (experiment.path("again.html"), experiment.path("svg"));
    report(&[&experiment.path("out"), "--out", &again, "--svg", &svg]).expect_success();
    assert_eq!(fs::read_to_string(again).unwrap(), html);
    assert_eq!(figures(Path::new(&svg)), figures(page.parent().unwrap()));
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
    assert_eq!(html.matches("id=\"channels-").count(), active);
    assert_eq!(html.matches("id=\"channel-bins-").count(), 1);
    let drawn: Vec<String> = figures(experiment.folder());
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

fn at(milliseconds: u64) -> SystemTime {
    SystemTime::UNIX_EPOCH + Duration::from_millis(1_700_000_000_000 + milliseconds)
}

/// Writes a run of `generations` generations with hostile names everywhere; finished if it has predictions.
fn write_hostile(folder: &Path, generations: u32, objects: u32, attempts: u64) {
    let gene = GeneColumn {
        name: HOSTILE.to_owned(),
        unit: "cm".to_owned(),
        integer: false,
        meaning: HOSTILE.to_owned(),
    };
    let mut out = RunFolder::create(folder, &[gene]).unwrap();
    let counts = Counts { object_correct: 3, category_correct: 4, queries: 5 };
    let individual = |generation, individual: u32| EvaluationRow {
        generation,
        individual,
        chromosome: format!("{individual:02b}"),
        genes: vec![Some(f64::from(individual))],
        counts,
        objective_correct: None,
        margin: None,
        parent_a: (generation > 1).then_some(0),
        parent_b: (generation > 1).then_some(1),
        elite: false,
        computed: None,
    };
    for generation in 1..=generations {
        let row = GenerationRow {
            generation,
            best_so_far_fitness: counts.fitness(),
            validation: None,
            validation_margin: None,
            hypervolume: None,
            mutation_rate: 0.4,
            seconds: 1.0,
        };
        out.write_generation(&[individual(generation, 0), individual(generation, 1)], &row).unwrap();
    }
    let name = |index: u32| format!("{HOSTILE}{index:03}");
    let prediction = |query: u32| PredictionRow {
        query,
        cloud: name(query),
        instance: name(query),
        category: HOSTILE.to_owned(),
        nearest_cloud: name(query + 1),
        predicted_instance: name((query + query % 2) % objects.max(1)),
        predicted_category: HOSTILE.to_owned(),
        distance: 1.0,
        runner_up: None,
    };
    let attempt = |job: u64| AttemptRow {
        job,
        attempt: 1,
        worker: format!("{HOSTILE}{}", job % 80),
        task: HOSTILE.to_owned(),
        handed_out_at: at(10 * job),
        ended_at: at(10 * job + 500),
        end: if job.is_multiple_of(7) { "lost" } else { "answered" }.to_owned(),
        reason: None,
        run_seconds: None,
    };
    let event = EventRow {
        at: at(1),
        event: HOSTILE.to_owned(),
        worker: None,
        generation: None,
        message: HOSTILE.to_owned(),
    };
    if objects == 0 {
        return;
    }
    out.write_predictions(PredictionSplit::Test, &(0..objects).map(prediction).collect::<Vec<_>>()).unwrap();
    let skipped =
        SkippedRow { split: HOSTILE.to_owned(), cloud: HOSTILE.to_owned(), reason: HOSTILE.to_owned() };
    out.write_skipped(&[skipped]).unwrap();
    let attempts = (0..attempts).map(attempt).collect();
    out.write_log(&RunLog { workers: Vec::new(), attempts, events: vec![event] }).unwrap();
    let run = RunRow {
        name: HOSTILE.to_owned(),
        search_config: "seed = 1\n".to_owned(),
        resolved_toml: HOSTILE.to_owned(),
        seed: 1,
        data_digest: "5f".repeat(32),
        evaluation_version: 1,
        program_version: HOSTILE.to_owned(),
        build: HOSTILE.to_owned(),
        host: HOSTILE.to_owned(),
        started_at: at(0),
        finished_at: at(9),
        seconds: 1.0,
        stop_reason: HOSTILE.to_owned(),
        generations,
        evaluations_computed: 0,
        evaluations_remembered: 2,
        winner_generation: generations,
        winner_individual: 0,
        best_chromosome: "00".to_owned(),
        best_genes: vec![Some(0.0)],
        train: counts,
        train_margin: None,
        validation: None,
        test: Some(Counts { object_correct: objects / 2, category_correct: objects, queries: objects }),
        grid_best_object_correct: Some(4),
    };
    out.write_run(&run).unwrap();
}

const DESCRIPTORS: [&str; 3] = ["evolved", "paper", "pfhrgb"];
const COMPARISON: [&str; 4] =
    ["comparison-errors", "recall-precision", "comparison-objects", "comparison-times"];

/// Adds a comparison with hostile names to a finished run, and two looks.
fn write_comparison(folder: &Path, objects: u32) {
    let out = RunFolder::create(folder, &[]).unwrap();
    for reason in [HOSTILE, "again"] {
        let descriptors = DESCRIPTORS.join(" ");
        let (command, reason) = ("compare".to_owned(), reason.to_owned());
        out.record_look(&LookRow { at: at(0), command, reason, descriptors }).unwrap();
    }
    out.begin_comparison().unwrap();
    let answer = |query: u32| PredictionRow {
        query,
        cloud: HOSTILE.to_owned(),
        instance: format!("{HOSTILE}{query:03}"),
        category: HOSTILE.to_owned(),
        nearest_cloud: HOSTILE.to_owned(),
        predicted_instance: format!("{HOSTILE}{:03}", query / 2 * 2),
        predicted_category: HOSTILE.to_owned(),
        distance: 1.0,
        runner_up: None,
    };
    let answers: Vec<PredictionRow> = (0..objects).map(answer).collect();
    let point = |n: u64| CurvePoint { distance: n as f64, accepted: 3 * n + n % 7 + 1, relevant: n };
    let curve = |name| Curve { name, relevant: 20_000, points: (0..=20_000).map(point).collect() };
    let counts = Counts { object_correct: objects / 2, category_correct: objects, queries: objects };
    let row = |descriptor: &str| ComparedRow {
        descriptor: descriptor.to_owned(),
        kind: "disk-ring".to_owned(),
        distance: "chi2".to_owned(),
        parameters: HOSTILE.to_owned(),
        size: Some(248),
        recogniser: Some("nearest".to_owned()),
        cloud_size: Some(496),
        settings: None,
        database_error: None,
        note: Some(HOSTILE.to_owned()),
        counts,
        object_wilson: [0.4, 0.6],
        category_wilson: [0.0, 0.1],
        object_bootstrap: [0.3, 0.7],
        category_bootstrap: [0.0, 0.2],
        skipped: 0,
        database: 9,
        keypoints_per_cloud: None,
        cloud_seconds: None,
        times: (descriptor == "paper").then(|| Times {
            read: 0.1,
            keypoints: 0.2,
            normals: 0.3,
            describe: 0.4,
            matching: 0.5,
            total: 1.6,
            hardware: HOSTILE.to_owned(),
        }),
        area: Some(0.5),
        nearest_area: None,
        bytes: None,
        file_digest: None,
    };
    for descriptor in DESCRIPTORS {
        out.write_compared(
            descriptor,
            &answers,
            &[curve("all"), curve("nearest")],
            &[DistanceRow { query: 0, database: 0, distance: 1.0 }],
        )
        .unwrap();
    }
    let pair = PairRow {
        level: "object".to_owned(),
        descriptor_a: "evolved".to_owned(),
        descriptor_b: "paper".to_owned(),
        both_right: 1,
        only_a: 2,
        only_b: 0,
        both_wrong: 3,
        difference_low: -0.5,
        difference_high: 0.1,
        p_value: 0.5,
        p_adjusted: 1.0,
    };
    out.write_comparison(&DESCRIPTORS.map(row), &[pair]).unwrap();
}

#[test]
fn names_of_all_kinds_and_great_numbers_of_things_are_only_shown() {
    let folder = TempDir::new().unwrap();
    let out = folder.path().join("run");
    write_hostile(&out, 3, 300, 100_000);
    write_comparison(&out, 300);
    report(&[out.to_str().unwrap()]).expect_success();
    let page = out.join("report/report.html");
    assert!(fs::metadata(&page).unwrap().len() < 8_000_000, "{}", fs::metadata(&page).unwrap().len());
    let Some(dom) = expect_drawn(&page, &[&FIGURES[..], &COMPARISON].concat()) else { return };
    let (_, title) = dom.split_once("<title>").unwrap();
    assert!(title.starts_with("&lt;script&gt;document.title='run'"), "{}", &title[..80]);
    assert!(dom.contains("looked at 2 times (UTC), and without a note at the end of the run."));
    let (markup, _) = dom.split_once("<script nonce").unwrap(); // plotly.js writes images, too
    assert!(!markup.contains("src=\"http") && !markup.contains("<img"));
}

#[test]
fn what_is_there_of_a_run_is_shown() {
    let folder = TempDir::new().unwrap();
    for generations in [0, 1] {
        let out = folder.path().join(generations.to_string());
        write_hostile(&out, generations, 0, 0);
        report(&[out.to_str().unwrap()]).expect_success();
        let html = fs::read_to_string(out.join("report/report.html")).unwrap();
        assert!(html.contains("unfinished"));
        assert_eq!(html.contains("id=\"convergence-0\""), generations == 1);
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
    write_hostile(&folder.path().join("run"), 2, 3, 5);
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
        ["6 runs of 2 kinds", "method ga (3)", "method random (3)", "Mann and Whitney", "blind-seed-2"]
    {
        assert!(html.contains(text), "{text}");
    }
    expect_drawn(&page, &["seeds-errors", "seeds-convergence"]);
    // One run of it, named twice, is one run.
    let (member, twice) = (experiment.path("out/ga-seed-1"), experiment.path("twice.html"));
    let finished = report(&[&member, &member, "--out", &twice]).expect_success();
    assert!(finished.stderr.contains("named twice"), "{finished}");
    assert!(fs::read_to_string(twice).unwrap().contains("short, seed 1"));
}
