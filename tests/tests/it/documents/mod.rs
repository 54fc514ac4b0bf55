//! The documents: every command on a page gives what the page shows, every link leads somewhere, and pages that are
//! made from the code are those that the code makes.
//!
//! A fence `console` holds commands (`$ `, continued by `> `) and their output; `console,background` holds a command
//! that goes on beside those that follow. `<!-- run: COMMAND -->` runs without being shown, and a page that asks for
//! the demo (`DEMO_FIRST`) begins with the folders of one. A `toml` block whose first line is `# NAME.toml` is written to
//! that file, and so is a `python` block by `# NAME.py`.
//! In output, a line `…` stands for any lines and `…` in a line for any text; what depends on the machine (seconds,
//! rates, threads) is not compared. `UPDATE_EXPECT=1` writes what the commands print into the pages.

mod cloud_files_page;
mod experiment_page;
mod output;
mod page;
mod protocol_page;
mod shell;

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

use expect_test::expect_file;

use crate::experiments::{Experiment, copy_folder, repository, run_demo};
use crate::process::run;
use page::Page;

/// Pages beside the book whose commands are run as well.
const OTHER_PAGES: [&str; 1] = ["README.md"];
/// Documents beside the book whose links are followed.
const OTHER_DOCUMENTS: [&str; 8] = [
    "README.md",
    "ARCHITECTURE.md",
    "CHANGELOG.md",
    "CONTRIBUTING.md",
    "SECURITY.md",
    "experiments/README.md",
    "results/README.md",
    "tests/benches/README.md",
];
const BOOK: &str = "docs/src";

fn read(path: &str) -> String {
    fs::read_to_string(repository().join(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// Paths of the files below a folder of the repository, relative to its root.
fn files(folder: &str, extension: &str) -> Vec<String> {
    let mut found = Vec::new();
    for entry in fs::read_dir(repository().join(folder)).unwrap() {
        let entry = entry.unwrap();
        let path = format!("{folder}/{}", entry.file_name().to_str().unwrap());
        if entry.file_type().unwrap().is_dir() {
            found.extend(files(&path, extension));
        } else if path.ends_with(extension) {
            found.push(path);
        }
    }
    found.sort();
    found
}

/// Every page whose commands are run.
fn pages() -> Vec<Page> {
    let paths = OTHER_PAGES.map(str::to_owned).into_iter().chain(files(BOOK, ".md"));
    paths.map(|path| Page::parse(&path, &read(&path))).collect()
}

#[test]
fn every_command_gives_what_the_page_shows() {
    let pages: Vec<Page> = pages().into_iter().filter(Page::has_commands).collect();
    assert!(pages.len() > 8, "only {} pages have commands", pages.len());
    let update = std::env::var_os("UPDATE_EXPECT").is_some();
    let (next, cores) = (AtomicUsize::new(0), std::thread::available_parallelism().map_or(2, usize::from));
    let follow = || {
        let mut faults = Vec::new();
        while let Some(page) = pages.get(next.fetch_add(1, Ordering::Relaxed)) {
            let transcript = shell::transcript(page);
            if update {
                fs::write(repository().join(&page.path), page.with_output(&transcript)).unwrap();
            }
            faults.extend(page.differences(&transcript));
        }
        faults
    };
    // A page waits as long as it computes.
    let faults: Vec<String> = std::thread::scope(|scope| {
        let threads: Vec<_> = (0..2 * cores).map(|_| scope.spawn(follow)).collect();
        threads.into_iter().flat_map(|thread| thread.join().unwrap()).collect()
    });
    assert!(update || faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn a_page_with_another_output_is_found() {
    let text = "# Page\n\n```console\n$ echo one; echo \"took 3 s\"\none\ntook 5 s\n$ echo two\nthree\n```\n";
    let page = Page::parse("page.md", text);
    let transcript = shell::transcript(&page);
    let faults = page.differences(&transcript);
    assert_eq!(faults.len(), 1, "{faults:?}");
    assert!(faults[0].starts_with("page.md:7: echo two\n") && faults[0].contains("three"), "{faults:?}");
    let mended = page.with_output(&transcript);
    assert_eq!(mended, text.replace("three", "two"));
    assert_eq!(Page::parse("page.md", &mended).differences(&transcript), Vec::<String>::new());
    let failing = Page::parse("page.md", "```console\n$ false\n```\n");
    assert!(failing.differences(&shell::transcript(&failing))[0].contains("exit code 1"));
}

/// Whoever copies an experiment of a page gets one that is read.
#[test]
fn every_experiment_on_a_page_is_valid() {
    let mut whole = 0;
    for page in pages() {
        for (line, toml) in page.blocks("toml") {
            let at = format!("{}:{line}", page.path);
            let parsed = toml.parse::<toml::Table>().unwrap_or_else(|error| panic!("{at}: {error}"));
            // A part of an experiment stands for the demo with it.
            let text = if parsed.contains_key("version") {
                whole += 1;
                toml
            } else {
                let dataset = if parsed.contains_key("dataset") { "" } else { "[dataset]\nroot = \"x\"\n" };
                format!("version = 1\n{toml}\n{dataset}")
            };
            let experiment = Experiment::with(&text);
            let path = experiment.path("exp.toml");
            let read = coordinator::experiment::Plan::read(path.as_ref(), Default::default());
            assert!(read.is_ok(), "{at}: {}", read.unwrap_err());
        }
    }
    assert!(whole > 3, "only {whole} experiments");
}

/// Whoever copies a shell line of a page gets one that CI runs or one of cargo's own.
#[test]
fn pages_have_no_commands_that_nobody_runs() {
    let ci = read(".ci/run");
    for page in pages() {
        for (line, text) in page.blocks("sh") {
            for command in text.lines() {
                let known = command.starts_with("cargo ") || ci.contains(command.trim());
                assert!(
                    known,
                    "{}:{line}: `{command}` is run by no test: make the block `console`",
                    page.path
                );
            }
        }
    }
}

#[test]
fn every_command_of_the_programs_is_in_the_reference() {
    let reference = read("docs/src/reference/commands.md");
    let help = run("coordinator", ["--help"]).expect_success().stdout;
    let (_, commands) = help.split_once("Commands:\n").unwrap();
    let (commands, _) = commands.split_once("\n\n").unwrap();
    let names = commands.lines().filter(|line| line.starts_with("  ") && !line.starts_with("   "));
    let names: Vec<&str> = names.filter_map(|line| line.split_whitespace().next()).collect();
    assert!(names.len() > 14, "{names:?}");
    for name in names.into_iter().filter(|&name| name != "help") {
        assert!(
            reference.contains(&format!("$ coordinator {name} --help\n")),
            "{name}: not in the reference"
        );
    }
    assert!(!reference.lines().any(|line| line == "…"), "help that nobody can read");
    assert!(reference.contains("$ worker --help\n"));
}

#[test]
fn exit_codes_are_those_that_the_help_names() {
    let help = run("coordinator", ["run", "--help"]).expect_success().stdout.replace('\n', " ");
    let (_, text) = help.split_once("Exit codes: ").unwrap();
    let (text, _) = text.split_once('.').unwrap();
    let named: BTreeSet<&str> = text
        .split([' ', ';', ','])
        .filter(|word| !word.is_empty() && word.bytes().all(|byte| byte.is_ascii_digit()))
        .collect();
    let page = read("docs/src/reference/exit-codes.md");
    let rows = page.lines().filter_map(|line| line.strip_prefix("| ")?.split_once(" |"));
    let listed: BTreeSet<&str> =
        rows.map(|(code, _)| code).filter(|code| code.bytes().all(|byte| byte.is_ascii_digit())).collect();
    assert_eq!(listed, named);
    assert!(listed.len() > 6);
}

#[test]
fn the_reference_of_experiments_is_made_from_the_schema() {
    let schema = run("coordinator", ["schema"]).expect_success().stdout;
    let schema = serde_json::from_str(&schema).unwrap();
    expect_file![repository().join("docs/src/reference/experiment.md")]
        .assert_eq(&experiment_page::markdown(&schema));
}

#[test]
fn the_reference_of_the_protocol_is_made_from_the_proto_files() {
    expect_file![repository().join("docs/src/reference/protocol.md")]
        .assert_eq(&protocol_page::markdown(proto::FILE_DESCRIPTOR_SET));
}

#[test]
fn every_key_of_a_channel_is_on_the_page_of_structures() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("one.toml").display().to_string();
    fs::write(&file, "version = 1\n[[channel]]\nunheard_of = 1\n").unwrap();
    let args = ["evaluate", "--data", ".", "--query", "a", "--database", "b", "--structure", &file];
    let refused = run("coordinator", args).expect_error();
    let known = refused.stderr.split_once("known keys here: ").unwrap().1;
    let known: Vec<&str> = known.trim_end().split(", ").collect();
    assert!(known.len() > 10, "{refused}");
    let page = read("docs/src/how-to/structures.md");
    let (_, section) = page.split_once("### Keys of a channel\n").unwrap();
    let rows = section
        .lines()
        .skip_while(|line| !line.starts_with("| `"))
        .take_while(|line| line.starts_with("| `"));
    let keys: Vec<&str> = rows.filter_map(|row| row.split('`').nth(1)).collect();
    assert_eq!(keys, known);
}

#[test]
fn the_reference_of_metrics_is_made_from_the_code() {
    expect_file![repository().join("docs/src/reference/metrics.md")]
        .assert_eq(&coordinator::metrics::reference());
}

/// The page's last section; what stands before it is written by hand.
#[test]
fn the_reference_of_cloud_files_has_every_message() {
    let page = "docs/src/reference/cloud-files.md";
    let last = "Each kind of error once:\n";
    let text = read(page);
    let (by_hand, _) = text.split_once(last).unwrap();
    let (tables, names) = cloud_files_page::refused();
    expect_file![repository().join(page)].assert_eq(&format!("{by_hand}{last}{tables}"));
    for (format, names) in ["ply", "pcd", "rgbd"].into_iter().zip(names) {
        let source = read(&format!("descriptor/src/{format}/error.rs"));
        let variants = source.lines().filter_map(|line| {
            let name = line.strip_prefix("    ")?.trim_end_matches([',', '{', ' ']);
            let is_variant = name.starts_with(|first: char| first.is_ascii_uppercase());
            (is_variant && name.bytes().all(|byte| byte.is_ascii_alphanumeric())).then(|| name.to_owned())
        });
        let variants: BTreeSet<String> = variants.collect();
        assert!(variants.len() > 5, "{variants:?}");
        assert_eq!(names.into_iter().collect::<BTreeSet<String>>(), variants, "{page}: errors of {format}");
    }
}

/// The README's figures are those of the run whose table it shows.
#[test]
fn the_figures_are_those_of_the_demo() {
    // A copy: the report of a run leaves a look in it, which pages would show.
    let demo = Experiment::with("");
    copy_folder(run_demo().folder(), demo.folder());
    let svg = demo.path("svg");
    let (run_folder, page) = (demo.path("results/runs/demo"), demo.path("demo.html"));
    run("coordinator", ["report", &run_folder, "--out", &page, "--svg", &svg]).expect_success();
    for (figure, image) in [("convergence", "demo"), ("confusion-objects", "demo-confusion")] {
        let drawn = fs::read_to_string(format!("{svg}/{figure}.svg")).unwrap();
        expect_file![repository().join(format!("{BOOK}/images/{image}.svg"))].assert_eq(&drawn);
    }
}

#[test]
fn every_link_leads_somewhere() {
    let documents = OTHER_DOCUMENTS.map(str::to_owned).into_iter().chain(files(BOOK, ".md"));
    let mut links = 0;
    for document in documents {
        let text = read(&document);
        let folder = Path::new(&document).parent().unwrap();
        for target in page::links(&text) {
            if target.contains("://") {
                assert!(target.starts_with("https://"), "{document}: {target}: no https");
                continue;
            }
            let (path, anchor) = target.split_once('#').unwrap_or((&target, ""));
            let file = if path.is_empty() { Path::new(&document).to_owned() } else { folder.join(path) };
            let there = repository().join(&file);
            assert!(there.exists(), "{document}: {target}: no such file");
            if !anchor.is_empty() {
                let found = page::anchors(&fs::read_to_string(there).unwrap()).any(|found| found == anchor);
                assert!(found, "{document}: {target}: no such heading");
            }
            links += 1;
        }
    }
    assert!(links > 50, "only {links} links");
}

#[test]
fn every_page_is_in_the_summary_of_the_book() {
    let summary = read("docs/src/SUMMARY.md");
    let listed: BTreeSet<String> = page::links(&summary).map(|path| format!("{BOOK}/{path}")).collect();
    let pages: BTreeSet<String> =
        files(BOOK, ".md").into_iter().filter(|path| !path.ends_with("SUMMARY.md")).collect();
    assert_eq!(listed, pages);
}

#[test]
fn the_first_documents_stay_short() {
    for document in ["README.md", "ARCHITECTURE.md"] {
        let words = read(document).split_whitespace().count();
        assert!(words <= 1500, "{document}: at most 1500 words, got {words}: move what is longer to docs/");
    }
}
