//! One run that a dashboard shows: its feed, its clouds, and what is asked about them.

use std::sync::{Arc, Mutex};
use std::time::Instant;

use descriptor::Descriptor;
use serde_json::{Value, json};
use worker::names::Names;

use super::detail;
use super::error::DashboardError;
use super::feed::{Cursor, Feed};
use super::folders::Found;
use super::run_log::Message;
use crate::compare::descriptor_of;
use crate::dataset::SPLITS;
use crate::dataset::record::CloudRecord;
use crate::examine::{DecimatedCloud, Examiner};
use crate::experiment::Experiment;
use crate::lock::lock;
use crate::looks;
use crate::reopen::winner_of;
use crate::report::told;

/// Most points of a cloud that is sent.
const MOST_POINTS: usize = 60_000;

/// One run, sweep or grid.
pub struct Shown {
    found: Found,
    feed: Mutex<Feed>,
    /// Made when the first cloud is asked for.
    examiner: Mutex<Option<Arc<Examiner>>>,
    /// Whether this process has noted that it shows test clouds.
    has_looked: Mutex<bool>,
}

/// Which descriptor is asked about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Which<'a> {
    /// The winner, or the best so far.
    Best,
    /// An individual, by generation and index.
    Individual(u32, u32),
    /// One of the run's comparison, by name.
    Compared(&'a str),
}

impl Shown {
    /// Of a folder that was found.
    pub fn new(found: &Found) -> Self {
        Self {
            found: found.clone(),
            feed: Mutex::new(Feed::new(found)),
            examiner: Mutex::default(),
            has_looked: Mutex::default(),
        }
    }

    /// The folder.
    pub fn found(&self) -> &Found {
        &self.found
    }

    /// Whether it is time to read the folder again; `false` also while somebody does.
    pub fn is_due(&self) -> bool {
        self.feed.try_lock().is_ok_and(|feed| feed.is_due(Instant::now()))
    }

    /// Reads what is new in the folder, if it is time. Blocks.
    pub fn refresh(&self) {
        lock(&self.feed).refresh(true);
    }

    /// The run in short. Blocks.
    pub fn run(&self) -> Value {
        let mut feed = lock(&self.feed);
        feed.refresh(false);
        feed.run().clone()
    }

    /// What a viewer does not have yet.
    pub fn since(&self, cursor: &mut Cursor) -> Vec<Message> {
        lock(&self.feed).since(cursor)
    }

    /// The generations as a table.
    pub fn generations(&self) -> String {
        lock(&self.feed).generations()
    }

    /// The run in full, as JSON.
    ///
    /// # Errors
    /// If a table cannot be read.
    pub fn detail(&self) -> Result<String, DashboardError> {
        let feed = lock(&self.feed);
        Ok(detail::detail(&self.found.folder, feed.overview(), feed.run().clone())?)
    }

    /// Answers to queries, as JSON.
    ///
    /// # Errors
    /// If there are none of this name, or they cannot be read.
    pub fn answers(&self, of: &str) -> Result<String, DashboardError> {
        let missing = || DashboardError::NoAnswers { run: self.found.id.clone(), of: of.to_owned() };
        detail::answers_of(&self.found.folder, of)?.ok_or_else(missing)
    }

    /// The clouds that may be shown, as JSON.
    ///
    /// # Errors
    /// If the run has no list of clouds.
    pub fn clouds(&self) -> Result<String, DashboardError> {
        let examiner = self.examiner()?;
        let is_finished = self.is_finished();
        let clouds: Vec<Value> = examiner
            .clouds()
            .iter()
            .filter(|cloud| is_finished || !examiner.is_test(cloud))
            .map(|CloudRecord { path, split, instance, category, .. }| {
                json!({"path": path, "split": SPLITS[*split], "instance": instance, "category": category})
            })
            .collect();
        Ok(json!({"clouds": clouds}).to_string())
    }

    /// The points of a cloud, as [`DecimatedCloud::to_bytes`] has them.
    ///
    /// # Errors
    /// If it may not be shown yet, or cannot be read.
    pub fn cloud(&self, path: &str, most: usize) -> Result<Vec<u8>, DashboardError> {
        let examiner = self.examiner()?;
        self.allow(&examiner, &[path])?;
        Ok(DecimatedCloud::new(&examiner.cloud(path)?, most.min(MOST_POINTS)).to_bytes())
    }

    /// How the distances of a query come about, as JSON.
    ///
    /// # Errors
    /// If a cloud may not be shown yet or cannot be read, or if there is no such descriptor.
    pub fn explain(&self, which: Which<'_>, query: &str, answer: &str) -> Result<String, DashboardError> {
        let examiner = self.examiner()?;
        self.allow(&examiner, &[query, answer])?;
        let descriptor = self.descriptor(which)?;
        Ok(json!(examiner.explain(&descriptor, query, answer)?).to_string())
    }

    /// The report, as a page of its own.
    ///
    /// # Errors
    /// If a table cannot be read.
    pub fn report(&self) -> Result<String, DashboardError> {
        let report = results::Report::of_run(&self.found.folder, None, &told(&self.found.folder))?;
        Ok(report.with_names(|text| Names::of_this_process().in_text(text)).html()?)
    }

    /// Training clouds that the fitness asks for; `None` before the first generation.
    pub fn train_queries(&self) -> Option<u32> {
        lock(&self.feed).train_queries()
    }

    /// By the folder as it is now: what was read before may be of a run that somebody has removed.
    fn is_finished(&self) -> bool {
        results::read_run(&self.found.folder).is_ok()
    }

    /// What the run was started with.
    ///
    /// # Errors
    /// If that cannot be read.
    pub fn experiment(&self) -> Result<Experiment, DashboardError> {
        let missing = || DashboardError::NoExperiment { run: self.found.id.clone() };
        lock(&self.feed).overview().experiment().cloned().ok_or_else(missing)
    }

    fn examiner(&self) -> Result<Arc<Examiner>, DashboardError> {
        let mut examiner = lock(&self.examiner);
        if let Some(examiner) = &*examiner {
            return Ok(Arc::clone(examiner));
        }
        let made = Arc::new(Examiner::new(&self.found.folder, &self.experiment()?)?);
        *examiner = Some(Arc::clone(&made));
        Ok(made)
    }

    fn descriptor(&self, which: Which<'_>) -> Result<Descriptor, DashboardError> {
        let folder = &self.found.folder;
        let experiment = self.experiment()?;
        let missing = || DashboardError::NoIndividual { run: self.found.id.clone() };
        let values = match (which, results::read_run(folder)) {
            (Which::Best, Ok(finished)) => {
                return winner_of(experiment.space(), &finished.row)
                    .map_err(|source| DashboardError::Winner { run: self.found.id.clone(), source });
            }
            (Which::Best, Err(_)) => {
                let (generation, individual) = lock(&self.feed).best().ok_or_else(missing)?;
                results::read_individual(folder, generation, individual)?.ok_or_else(missing)?.genes
            }
            (Which::Individual(generation, individual), _) => {
                results::read_individual(folder, generation, individual)?.ok_or_else(missing)?.genes
            }
            (Which::Compared(name), _) => return self.compared(name),
        };
        experiment.space().from_values(&values).ok_or_else(missing)
    }

    /// A descriptor of the comparison that has channels.
    fn compared(&self, name: &str) -> Result<Descriptor, DashboardError> {
        let run = || self.found.id.clone();
        let rows = results::read_comparison(&self.found.folder)?;
        let row = rows.iter().find(|row| row.descriptor == name);
        let row = row.ok_or_else(|| DashboardError::NoAnswers { run: run(), of: name.to_owned() })?;
        let unknown = |reason| DashboardError::NoChannels { descriptor: name.to_owned(), reason };
        if row.file_digest.is_some() {
            return Err(unknown("it comes from a file that has a cloud's values, not how they came about"));
        }
        match descriptor_of(row) {
            Some(Descriptor::Fixed(_)) => {
                Err(unknown("it is one histogram for each keypoint, not divided into channels"))
            }
            Some(descriptor) => Ok(descriptor),
            None => Err(unknown("its comparison is of a release that did not keep its parameters exactly")),
        }
    }

    /// Refuses test clouds of a run that is not finished. That they are shown is noted first, once in this process: who
    /// has seen them knows more of the test than its number.
    fn allow(&self, examiner: &Examiner, paths: &[&str]) -> Result<(), DashboardError> {
        let mut tests = paths.iter().map(|path| examiner.record(path).map(|cloud| examiner.is_test(cloud)));
        if !tests.try_fold(false, |any, is_test| is_test.map(|is_test| any || is_test))? {
            return Ok(());
        }
        if !self.is_finished() {
            return Err(DashboardError::Hidden { path: paths[0].to_owned() });
        }
        let mut has_looked = lock(&self.has_looked);
        if !*has_looked {
            let look = ["dashboard", "test clouds are shown", ""];
            looks::note(&self.found.folder, &self.experiment()?, look)?;
            *has_looked = true;
        }
        Ok(())
    }
}
