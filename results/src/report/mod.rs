//! The report of a run: one HTML page, and each of its figures as an SVG file.
//!
//! Tables are read in `data.rs`; `figures/` makes figures of them, `figure.rs` says what a figure is; `plotly.rs` and
//! `svg/` draw it, `html.rs` lays out the page.

mod data;
mod descriptor_tables;
mod figure;
mod figures;
mod html;
mod plotly;
mod run_tables;
mod runs;
mod summary;
mod svg;

use std::io::Read as _;
use std::path::{Path, PathBuf};
use std::{fs, io};

use data::{Rows, RunData};
use figures::channels;
pub use figures::channels::{ChannelPairs, WinnerChannel};
use figures::comparison as compared;
use figures::{front, genes, lineage, perturbed, recognition, search, seeds, work};
use html::{Item, Page, Section};
use runs::Runs;

use crate::error::Error;
use crate::file::write_whole;
use crate::table_name::TableName;

/// The script that shows point clouds: a module without imports, which pages have as a file or in their text.
pub const CLOUD_VIEWER: &str = include_str!("viewer.js");

/// What is known of a run that its tables do not say.
#[derive(Clone, Debug, Default)]
pub struct Told {
    /// The channels of its winner, if that is a structure, which tables have as codes.
    pub channels: Vec<WinnerChannel>,
    /// How its winner compares with other descriptors, in sentences.
    pub verdict: Vec<String>,
}

/// A report that is ready to be written. Equal tables give equal bytes.
#[derive(Clone, Debug)]
pub struct Report {
    page: Page,
}

impl Report {
    /// The report of one run, finished or not. `grid`: the folder of an exhaustive search, whose exact marginals are
    /// drawn beside those of the run. `told`: what tables do not say.
    ///
    /// # Errors
    /// If it is not a run folder, or if a file in it cannot be read or is damaged; the message names the file.
    pub fn of_run(folder: impl AsRef<Path>, grid: Option<&Path>, told: &Told) -> Result<Self, Error> {
        let folder = folder.as_ref();
        let label = fs::canonicalize(folder).unwrap_or_else(|_| folder.to_owned());
        let label = label.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let data = RunData::read(folder, &label)?;
        let grid = match grid {
            None => None,
            Some(grid) => {
                let folder = grid.join(TableName::Marginals.as_str());
                let missing = Error::NoFiles { folder, table: TableName::Marginals };
                Some(Rows::read(grid, TableName::Marginals)?.ok_or(missing)?)
            }
        };
        Ok(Self { page: run_page(&data, grid.as_ref(), told)? })
    }

    /// The report of several runs, each by its name and folder: what they reached, over seeds and compared with each other.
    /// A run that is named twice, or is the same as another, counts once. `verdict`: what seeds say together, in sentences.
    ///
    /// # Errors
    /// As [`Report::of_run`].
    pub fn of_runs(title: &str, folders: &[(String, PathBuf)], verdict: &[String]) -> Result<Self, Error> {
        Ok(Self { page: runs_page(title, &Runs::read(folders)?, verdict) })
    }

    /// The page.
    pub fn html(&self) -> String {
        self.page.html()
    }

    /// Name and content of each figure's SVG file.
    ///
    /// # Errors
    /// If a figure cannot be drawn.
    pub fn svgs(&self) -> Result<Vec<(String, String)>, Error> {
        let file = |figure: &figure::Figure| Ok((format!("{}.svg", figure.id), svg::document(figure)?));
        self.page.figures().map(file).collect()
    }

    /// Writes the page to `html` and the figures into the folder `svg`, which are made. Gives the figures' files.
    ///
    /// # Errors
    /// If a figure cannot be drawn or a file cannot be written, or if one of these names is taken by a file that no report
    /// has written: then nothing is.
    pub fn write(&self, html: &Path, svg: &Path) -> Result<Vec<PathBuf>, Error> {
        let svgs = self.svgs()?;
        refuse_foreign(html, html::begins_page)?;
        for (name, _) in &svgs {
            refuse_foreign(&svg.join(name), svg::begins_document)?;
        }
        let parent = html.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."));
        for folder in [parent, svg] {
            fs::create_dir_all(folder).map_err(|source| Error::io(folder, "make this folder", source))?;
        }
        let mut files = Vec::new();
        for (name, content) in svgs {
            let file = svg.join(name);
            write_whole(&file, content.as_bytes())?;
            files.push(file);
        }
        write_whole(html, self.html().as_bytes())?;
        Ok(files)
    }
}

/// Refuses to replace a file that does not begin as this program's do; an empty one is nobody's loss.
fn refuse_foreign(file: &Path, is_ours: impl Fn(&str) -> bool) -> Result<(), Error> {
    let failed = |source| Error::io(file, "read this file", source);
    match fs::metadata(file) {
        Ok(metadata) if metadata.is_file() => {}
        Ok(_) => return Err(Error::Occupied(file.to_owned())), // a pipe would be waited for
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
        Err(source) => return Err(failed(source)),
    }
    let mut held = Vec::new();
    fs::File::open(file).and_then(|file| file.take(256).read_to_end(&mut held)).map_err(failed)?;
    let held = String::from_utf8_lossy(&held);
    if held.is_empty() || is_ours(&held) { Ok(()) } else { Err(Error::Occupied(file.to_owned())) }
}

fn run_page(data: &RunData, grid: Option<&Rows>, told: &Told) -> Result<Page, Error> {
    let (title, lead) = match &data.finished {
        Some(run) => {
            let lead = "Evolution of a 3D point-cloud descriptor: what the search found, how it got there, and what it \
                        recognises.";
            (format!("{}, seed {}", run.row.name, run.row.seed), lead)
        }
        None => (data.label.clone(), "This run is unfinished: the report shows what is there so far."),
    };
    let sections = vec![
        Section { id: "summary", title: "Summary", items: summary_items(data, told)? },
        Section { id: "search", title: "Search", items: search_items(data, grid)? },
        Section { id: "recognition", title: "Recognition", items: recognition_items(data)? },
        Section { id: "comparison", title: "Comparison of descriptors", items: comparison_items(data)? },
        Section { id: "work", title: "Work", items: work_items(data)? },
    ];
    Ok(Page { title, lead: lead.to_owned(), sections })
}

fn summary_items(data: &RunData, Told { channels, verdict }: &Told) -> Result<Vec<Item>, Error> {
    let mut items = vec![Item::Table(summary::overview(data, !channels.is_empty())?)];
    if let Some(run) = &data.finished {
        items.push(Item::Table(summary::errors(run)));
        items.extend(verdict.iter().cloned().map(Item::Text));
        if !channels.is_empty() {
            items.push(Item::Table(channels::table(channels)));
            add(&mut items, channels::pairs(channels));
            add(&mut items, channels::bins(channels));
        }
        items.push(summary::looks(data.looks.as_ref(), run.row.test.is_some())?);
        let summary = "The resolved experiment (TOML)".to_owned();
        items.push(Item::Details { summary, text: run.row.resolved_toml.clone() });
    }
    Ok(items)
}

fn runs_page(title: &str, runs: &Runs, verdict: &[String]) -> Page {
    let groups = runs.groups.as_slice();
    let mut items: Vec<Item> = runs.notes.iter().cloned().map(Item::Text).collect();
    if groups.is_empty() {
        items.push(Item::Missing("No run has finished.".to_owned()));
    } else {
        items.push(Item::Table(run_tables::groups(groups)));
        items.push(Item::Table(run_tables::members(runs)));
    }
    items.extend(verdict.iter().cloned().map(Item::Text));
    let mut comparison = Vec::new();
    add(&mut comparison, seeds::errors(groups));
    add(&mut comparison, seeds::convergence(groups));
    let regret = seeds::regret(groups);
    if regret.is_empty() {
        comparison.push(Item::Missing(
            "No regret: the optimum was not known. `coordinator exhaust EXPERIMENT.toml` finds it; runs that end after it \
             say how far they are from it."
                .to_owned(),
        ));
    } else {
        comparison.push(Item::Figure(regret));
    }
    match run_tables::tests(groups) {
        Some(table) => comparison.push(Item::Table(table)),
        None => comparison.push(Item::Missing(
            "No test of differences: it takes two kinds of search on the same clouds, for example `[sweep.variants]` with \
             search.method \"ga\" and \"random\", and two runs of each."
                .to_owned(),
        )),
    }
    let count: usize = groups.iter().map(|group| group.members.len()).sum();
    let lead = format!(
        "{count} runs of {} kinds. Each run has a report of its own: `coordinator report` with its folder.",
        groups.len()
    );
    let sections = vec![
        Section { id: "runs", title: "Runs", items },
        Section { id: "comparison", title: "Over seeds", items: comparison },
    ];
    Page { title: title.to_owned(), lead, sections }
}

/// Adds a figure if there is something to draw.
fn add(items: &mut Vec<Item>, figure: figure::Figure) {
    if !figure.is_empty() {
        items.push(Item::Figure(figure));
    }
}

fn search_items(data: &RunData, grid: Option<&Rows>) -> Result<Vec<Item>, Error> {
    let (Some(generations), Some(evaluations)) = (&data.generations, &data.evaluations) else {
        return Ok(vec![Item::Missing("No generation is complete yet.".to_owned())]);
    };
    let mut items = Vec::new();
    add(&mut items, search::convergence(generations, data.finished.as_ref())?);
    if let Some(points) = &data.front {
        add(&mut items, front::front(points)?);
    }
    add(&mut items, front::hypervolume(generations)?);
    add(&mut items, search::mutation(generations)?);
    add(&mut items, search::diversity(generations)?);
    add(&mut items, genes::trajectories(evaluations, generations)?);
    add(&mut items, genes::marginals(evaluations, grid)?);
    if let Some(run) = &data.finished
        && let Some(figure) = lineage::lineage(evaluations, run)?
    {
        add(&mut items, figure);
    }
    Ok(items)
}

fn recognition_items(data: &RunData) -> Result<Vec<Item>, Error> {
    let answers = data.predictions.as_ref().map(recognition::test_answers).transpose()?.unwrap_or_default();
    if answers.is_empty() {
        let missing =
            "No predictions on test clouds: they are made when the run has finished, if it has a test split.";
        return Ok(vec![Item::Missing(missing.to_owned())]);
    }
    let mut items = Vec::new();
    add(&mut items, recognition::confusion_of_objects(&answers));
    items.push(Item::Table(recognition::frequent_confusions(&answers)));
    add(&mut items, recognition::confusion_of_categories(&answers));
    Ok(items)
}

fn comparison_items(data: &RunData) -> Result<Vec<Item>, Error> {
    let Some(comparison) = &data.comparison else {
        let missing = "No comparison with other descriptors: `coordinator compare RUN` makes it, and with it the paper’s \
                       Table 1 and Figure 3, the times of each stage and which objects each descriptor gets wrong.";
        return Ok(vec![Item::Missing(missing.to_owned())]);
    };
    let descriptors = &comparison.descriptors;
    let names = descriptors.texts("descriptor")?;
    let mut items = vec![Item::Table(descriptor_tables::table(descriptors)?)];
    add(&mut items, compared::errors(descriptors)?);
    if let Some(pairs) = &comparison.pairs {
        items.push(Item::Table(descriptor_tables::pairs(pairs)?));
    }
    if let Some(points) = &comparison.recall_precision {
        add(&mut items, compared::recall_precision(points, &names)?);
    }
    if let Some(answers) = &comparison.answers {
        add(&mut items, compared::objects(answers, &names)?);
    }
    if let Some(rows) = &comparison.perturbed {
        add(&mut items, perturbed::errors(rows, &names)?);
    }
    match compared::times(descriptors)? {
        Some(figure) => {
            add(&mut items, figure);
            items.push(Item::Table(descriptor_tables::times(descriptors)?));
        }
        None => items.push(Item::Missing("The times of the descriptors were not measured.".to_owned())),
    }
    Ok(items)
}

fn work_items(data: &RunData) -> Result<Vec<Item>, Error> {
    let mut items = Vec::new();
    if let (Some(evaluations), Some(generations)) = (&data.evaluations, &data.generations) {
        add(&mut items, work::generation_times(evaluations, generations)?);
    }
    match &data.attempts {
        Some(attempts) => add(&mut items, work::timeline(attempts)?),
        None => items.push(Item::Missing(
            "No attempts: everything was remembered, or the run has not ended in any way yet.".to_owned(),
        )),
    }
    items.extend(summary::happenings(data)?);
    Ok(items)
}
