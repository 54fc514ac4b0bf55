//! `coordinator report`: what runs have to show, as one page and as single figures.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Args;
use results::{NamedRun, TableName};
use worker::names::Names;

use crate::console::say;
use crate::experiment::DEFAULT_RESULTS_DIR;
use crate::report::told;
use crate::run::directory::SEARCH_FILE;
use crate::sweep::{self, SWEEP_FILE, Seed};

/// Write a report: one HTML page that needs nothing else, and each of its figures as an SVG file
///
/// Of one run, finished or not, all there is to see; of a sweep or several runs, how results are distributed over
/// seeds and how kinds of search compare; of an exhaustive search, the best descriptors and what the search space
/// is like. Results are never changed; that test clouds are shown is noted in the run.
///
/// Example: coordinator report results/runs/demo-0123456789ab --out demo.html
#[derive(Debug, Args)]
pub struct Report {
    /// Folders of runs or sweeps, or that of an exhaustive search, for example results/runs/demo-0123456789ab; by default
    /// the newest in results/runs
    #[arg(value_name = "RUN")]
    runs: Vec<PathBuf>,
    /// The page, for example demo.html; by default RUN/report/report.html, needed with several RUN
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Folder of the SVG files, for example figures; by default that of the page
    #[arg(long, value_name = "DIR")]
    svg: Option<PathBuf>,
    /// Folder for each figure as SVG and PDF, and the paper's Table 1 as LaTeX, for example paper/figures
    #[arg(long, value_name = "DIR")]
    figures: Option<PathBuf>,
    /// The folder of an exhaustive search of the same space, for example results/runs/demo-grid-0123456789ab: draws its exact marginals
    /// beside those that the run has met
    #[arg(long, value_name = "GRID")]
    grid: Option<PathBuf>,
}

impl Report {
    pub(super) fn execute(self) -> anyhow::Result<ExitCode> {
        let runs =
            if self.runs.is_empty() { vec![newest_run(Path::new(DEFAULT_RESULTS_DIR))?] } else { self.runs };
        let page = match (self.out, runs.as_slice()) {
            (Some(out), _) => out,
            (None, [run]) => run.join("report").join("report.html"),
            (None, runs) => anyhow::bail!(
                "--out: no default for several runs, got {}\nname the page, for example --out report.html",
                runs.len()
            ),
        };
        let report = report(&runs, self.grid.as_deref(), &page)?;
        let report = report.with_names(|text| Names::of_this_process().in_text(text));
        let svg = self.svg.unwrap_or_else(|| page.parent().unwrap_or(Path::new("")).to_owned());
        let figures = report.write(&page, &svg)?.len();
        let svg = if svg.as_os_str().is_empty() { PathBuf::from(".") } else { svg };
        let mut lines = format!("{}\n{figures} figures as SVG in {}\n", page.display(), svg.display());
        if let Some(folder) = self.figures {
            let files = report.write_figures(&folder)?.len();
            lines.push_str(&format!("{files} files for a paper in {}\n", folder.display()));
        }
        super::print(&lines)?;
        Ok(ExitCode::SUCCESS)
    }
}

/// The report of these folders, whose page will be `page`.
fn report(runs: &[PathBuf], grid: Option<&Path>, page: &Path) -> anyhow::Result<results::Report> {
    if let [folder] = runs
        && folder.join(TableName::Grid.as_str()).is_dir()
    {
        if let Some(grid) = grid {
            anyhow::bail!(
                "--grid: goes with a run, got {} and the exhaustive search {}\nleave it out, or name a run",
                grid.display(),
                folder.display()
            );
        }
        return Ok(results::Report::of_grid(folder)?);
    }
    let folders = folders(runs)?;
    match (folders.as_slice(), grid) {
        ([run], grid) => Ok(results::Report::of_run(&run.folder, grid, &told(&run.folder))?),
        (_, Some(grid)) => anyhow::bail!(
            "--grid: goes with one run, got {} and {}\nleave it out, or name one run",
            folders.len(),
            grid.display()
        ),
        (folders, None) => {
            Ok(results::Report::of_runs(&title(runs), folders, &verdict_of_seeds(folders), page)?)
        }
    }
}

/// What the seeds of a sweep say together, those of each variant.
fn verdict_of_seeds(folders: &[NamedRun]) -> Vec<String> {
    let read = |NamedRun { name, folder, .. }: &NamedRun| {
        let run = results::read_run(folder).ok()?.row;
        Some((name.clone(), run, results::read_comparison(folder).ok()?, results::read_pairs(folder).ok()?))
    };
    let read: Vec<_> = folders.iter().filter_map(read).collect();
    let seeds: Vec<Seed<'_>> =
        read.iter().map(|(name, run, compared, pairs)| Seed::new(name, run, compared, pairs)).collect();
    let of_variant = |(variant, sentences): (String, Vec<String>)| {
        let text = sentences.join("; ");
        if variant.is_empty() { text } else { format!("{variant}: {text}") }
    };
    sweep::verdicts(&seeds).into_iter().map(of_variant).collect()
}

/// The folder in `parent` that was written to last, which is told.
fn newest_run(parent: &Path) -> anyhow::Result<PathBuf> {
    let time = |folder: &PathBuf| std::fs::metadata(folder).and_then(|folder| folder.modified()).ok();
    let folders = std::fs::read_dir(parent).into_iter().flatten().flatten().map(|entry| entry.path());
    let runs =
        folders.filter(|folder| folder.join(SEARCH_FILE).is_file() || folder.join(SWEEP_FILE).is_file());
    let Some(newest) = runs.max_by_key(|folder| (time(folder), folder.clone())) else {
        anyhow::bail!(
            "RUN: a run in {} expected, got none\nname the folder of a run, or start one: coordinator run EXP.toml",
            parent.display()
        )
    };
    say(format_args!("{}: the newest run", newest.display()));
    Ok(newest)
}

/// All runs with what to call them, each folder once. Runs of a sweep that have not begun are not there.
fn folders(runs: &[PathBuf]) -> anyhow::Result<Vec<NamedRun>> {
    let mut folders: Vec<NamedRun> = Vec::new();
    let mut met = std::collections::BTreeSet::new();
    for run in runs {
        for (member, folder) in sweep::run_folders(run)? {
            if !member.is_empty() && !folder.is_dir() {
                say(format_args!("{}: has not begun", folder.display()));
                continue;
            }
            if !met.insert(std::fs::canonicalize(&folder).unwrap_or_else(|_| folder.clone())) {
                say(format_args!("{}: named twice, counts once", folder.display()));
                continue;
            }
            // Its seed tells where the name of a member's variant ends.
            let seed = results::read_run(&folder).ok().map(|run| run.row.seed);
            let variant = seed.map(|seed| sweep::variant(&member, seed).to_owned());
            let variant = variant.filter(|variant| !variant.is_empty());
            let name = match (runs.len(), member.is_empty()) {
                (1, false) => member,
                _ => folder.display().to_string(),
            };
            folders.push(NamedRun { name, folder, variant });
        }
    }
    Ok(folders)
}

/// The name of a sweep's folder, or how many runs there are.
fn title(runs: &[PathBuf]) -> String {
    match runs {
        [sweep] => sweep.file_name().unwrap_or_default().to_string_lossy().into_owned(),
        runs => format!("{} runs and sweeps", runs.len()),
    }
}
