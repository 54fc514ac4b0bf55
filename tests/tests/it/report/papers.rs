//! Figures for papers, great runs, grids, and clouds in 3D.

use std::fs;
use std::path::Path;
use std::process::Command;

use results::{
    BestRow, CountRow, GeneColumn, GridFolder, GridRow, GridTables, LandscapeRow, MarginalRow, ShownCloud,
    Told, WrongClouds,
};
use tempfile::TempDir;

use super::browsing::{LARGEST, expect_drawn, figures, on_a_telephone, report};
use super::written::{HOSTILE, at, write_comparison, write_hostile, write_named};
use crate::experiments::repository;

#[test]
fn every_figure_is_there_as_pdf_and_the_comparison_as_latex() {
    let folder = TempDir::new().unwrap();
    let (out, to) = (folder.path().join("run"), folder.path().join("figures"));
    write_hostile(&out, [3, 4], 5, 50);
    write_comparison(&out, 5);
    let arguments = [out.to_str().unwrap(), "--figures", to.to_str().unwrap()];
    let finished = report(&arguments).expect_success();
    let drawn = figures(&to);
    assert_eq!(drawn, figures(&out.join("report")));
    let told = format!("{} files for a paper in {}\n", 2 * drawn.len() + 1, to.display());
    assert!(finished.stdout.ends_with(&told), "{finished}");
    for name in &drawn {
        let pdf = fs::read(to.join(format!("{name}.pdf"))).unwrap();
        assert!(pdf.starts_with(b"%PDF-") && pdf.ends_with(b"%%EOF"), "{name}");
        let shows = |text: &[u8]| pdf.windows(text.len()).any(|part| part == text);
        assert!(shows(b"/Helvetica") && shows(b"Tj") && !shows(b"/Image"), "{name}");
    }
    let convergence = fs::read(to.join("convergence.pdf")).unwrap();
    assert!(String::from_utf8_lossy(&convergence).contains("(generation) Tj"));
    let table = fs::read_to_string(to.join("table1.tex")).unwrap();
    assert!(table.contains("\\begin{tabular}{lrrr}\n") && table.ends_with("\\end{tabular}\n"), "{table}");
    assert!(table.contains("\npaper & 60.00 & 0.00 & 1.60 \\\\\n"), "{table}");
    // Its own files are written again; nobody else's.
    report(&arguments).expect_success();
    fs::write(to.join("table1.tex"), "mine").unwrap();
    let refused = report(&arguments).expect_error();
    assert!(refused.stderr.contains("table1.tex") && refused.stderr.contains("--figures"), "{refused}");
    assert_eq!(fs::read_to_string(to.join("table1.tex")).unwrap(), "mine");
}

/// Names that LaTeX would take for something else.
const AWKWARD: [&str; 5] =
    ["a_b & c% #1 $x", "~^\\{x}", "[1]* a--b ` 'q' <x> |", "größe þ", "\\input{/etc/passwd}%"];

#[test]
fn latex_sets_the_comparison_whatever_names_are() {
    let there = |program: &str| Command::new(program).arg("-v").output().is_ok();
    if !there("pdflatex") || !there("pdftotext") {
        eprintln!("SKIPPED: no pdflatex or no pdftotext");
        return;
    }
    let folder = TempDir::new().unwrap();
    let (out, to) = (folder.path().join("run"), folder.path().join("figures"));
    write_hostile(&out, [3, 4], 5, 50);
    write_named(&out, &AWKWARD);
    report(&[out.to_str().unwrap(), "--figures", to.to_str().unwrap()]).expect_success();
    let script = repository().join("tests/python/table_tex.py");
    let names = AWKWARD.map(|name| name.replace('þ', "¿"));
    let set = Command::new("python3").arg(script).arg(to.join("table1.tex")).args(names).output().unwrap();
    assert!(set.status.success(), "{}", String::from_utf8_lossy(&set.stderr));
}

#[test]
fn a_page_of_two_thousand_individuals_stays_small() {
    let folder = TempDir::new().unwrap();
    let out = folder.path().join("run");
    write_hostile(&out, [60, 2000], 300, 100_000);
    write_comparison(&out, 300);
    report(&[out.to_str().unwrap()]).expect_success();
    let html = fs::read_to_string(out.join("report/report.html")).unwrap();
    assert!(html.len() <= LARGEST, "{}", html.len());
    assert!(html.contains("a point for those in a square of"));
}

/// Writes a grid of two genes with hostile names.
fn write_grid(folder: &Path) {
    let gene = |name: &str| GeneColumn {
        name: format!("{HOSTILE}{name}"),
        unit: "cm".to_owned(),
        integer: false,
        meaning: HOSTILE.to_owned(),
    };
    let genes = [gene("a"), gene("b")];
    let marginal = |(gene, value): (&GeneColumn, u32)| MarginalRow {
        gene: gene.name.clone(),
        value: f64::from(value),
        descriptors: 2,
        best: 9 - value,
        mean: 5.0,
        median: 5.0,
        worst: value,
    };
    let landscape = |place: u32| LandscapeRow {
        gene_a: genes[0].name.clone(),
        value_a: f64::from(place / 2),
        gene_b: genes[1].name.clone(),
        value_b: f64::from(place % 2),
        descriptors: 1,
        best: 9 - place,
        mean: f64::from(9 - place),
    };
    let text = || HOSTILE.to_owned();
    let grid = GridRow {
        name: text(),
        grid_key: text(),
        search_space: text(),
        train_digest: text(),
        evaluation_version: 1,
        cells: 1,
        descriptors: 4,
        queries: 10,
        optimal_descriptors: 1,
        best_genes: vec![Some(0.0); 2],
        best_object_correct: 9,
        grid_digest: text(),
        cells_computed: 1,
        cells_found: 0,
        run: None,
        principals: None,
        basis: None,
        seconds: 1.0,
        finished_at: at(0),
    };
    let tables = GridTables {
        grid,
        best: vec![BestRow { rank: 1, genes: vec![Some(0.0); 2], object_correct: 9 }],
        marginals: genes.iter().flat_map(|gene| [(gene, 0), (gene, 1)]).map(marginal).collect(),
        landscapes: (0..4).map(landscape).collect(),
        counts: (6..10).map(|object_correct| CountRow { object_correct, descriptors: 1 }).collect(),
    };
    GridFolder::create(folder, &genes).unwrap().write_tables(&tables).unwrap();
}

#[test]
fn the_report_of_a_grid_shows_the_optimum_and_the_space() {
    let folder = TempDir::new().unwrap();
    let out = folder.path().join("grid");
    write_grid(&out);
    report(&[out.to_str().unwrap()]).expect_success();
    let page = out.join("report/report.html");
    let html = fs::read_to_string(&page).unwrap();
    for text in [
        "10.00 % of clouds wrong (1 of 10) is the least",
        "1 of 4 descriptors are as good (25.00 %)",
        "within 10 points",
        "&lt;script&gt;",
    ] {
        assert!(html.contains(text), "{text}");
    }
    assert!(!html.contains("<script"));
    let wrong = report(&[out.to_str().unwrap(), "--grid", out.to_str().unwrap()]).expect_error();
    assert!(wrong.stderr.contains("--grid: goes with a run"), "{wrong}");
    expect_drawn(&page, &["grid-counts", "grid-marginals", "landscapes-best", "landscapes-mean"]);
    fs::remove_file(out.join("grid/grid.parquet")).unwrap();
    let unfinished = report(&[out.to_str().unwrap()]).expect_error();
    assert!(unfinished.stderr.contains("grid is not whole"), "{unfinished}");
}

#[test]
fn wrong_clouds_are_drawn_in_3d_and_the_page_stays_small() {
    let folder = TempDir::new().unwrap();
    let out = folder.path().join("run");
    write_hostile(&out, [3, 2], 30, 5);
    // A sheet of 5000 points that is bent.
    let place = |n: u32| {
        let [x, y] = [n % 100, n / 100].map(|part| part as f32 / 1000.0);
        [x, y, 0.5 + x * x + y * y]
    };
    let cloud = |role: &str, number: u32| ShownCloud {
        name: format!("{HOSTILE}{role}{number}"),
        object: HOSTILE.to_owned(),
        points: (0..5000).map(place).collect(),
        colours: (0..5000_u32).map(|n| [n as u8, (n >> 4) as u8, 90]).collect(),
        total: 40_000,
    };
    let triple = |number: u32| WrongClouds {
        query: cloud("query", number),
        answer: cloud("answer", number),
        right: (number != 7).then(|| cloud("right", number)),
        answer_distance: 1.0,
        right_distance: (number != 7).then_some(1.5),
        decided_by: Some(HOSTILE.to_owned()),
    };
    let told = Told { wrong: (0..30).map(triple).collect(), ..Told::default() };
    let html = results::Report::of_run(&out, None, &told).unwrap().html().unwrap();
    assert!((1_000_000..=LARGEST).contains(&html.len()), "{}", html.len());
    assert_eq!(html.matches("<script").count(), 2, "the clouds and what draws them");
    let Some(narrow) = on_a_telephone(folder.path(), &html) else { return };
    assert!(narrow.width <= 390, "{} pixels wide", narrow.width);
    assert_eq!(narrow.canvases, [89, 89]);
}
