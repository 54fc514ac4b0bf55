//! What is known of one run, read from its folder as it grows; viewers get what is new to them.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

use descriptor::{Descriptor, SearchSpace};
use results::{Columnar, TableName, complete_generations};
use serde_json::Value;

use super::folders::Found;
use super::overview::Overview;
use super::run_log::{LogCursor, Message, RunLogReader};

/// A folder is not read again before this.
const EVERY: Duration = Duration::from_millis(900);
/// Share of a core that reading may take, as one over it.
const SPARING: u32 = 20;
/// Individuals that are kept; of longer runs those of the last generations.
const MOST_INDIVIDUALS: usize = 20_000;

/// One run as viewers see it.
pub struct Feed {
    folder: PathBuf,
    next_read: Option<Instant>,
    /// Of the files that say that the run has ended, as they were when it was read; `None` of others.
    ended: Option<Ended>,
    /// Whether tables and log are read, not only what the list of runs shows.
    is_whole: bool,
    /// Grows when what was sent is void.
    epoch: u64,
    /// Complete generations, from 1.
    generations: Vec<Columnar>,
    /// Of the last of them.
    individuals: Vec<Columnar>,
    log: RunLogReader,
    overview: Overview,
    /// In short, and how often that has changed.
    run: (Value, u64),
}

/// What a viewer has.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Cursor {
    /// `None` before the first message.
    epoch: Option<u64>,
    /// Generations it has.
    pub generation: u32,
    /// Entries of the log it has.
    pub log: u64,
    run: u64,
    fleet: u64,
}

impl Cursor {
    /// Of a viewer that comes back with what it had.
    pub fn new(generation: u32, log: u64) -> Self {
        Self { generation, log, ..Self::default() }
    }
}

/// When the files of a run that has ended were written.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Ended {
    run: SystemTime,
    /// Of a comparison, which may come later.
    comparison: Option<SystemTime>,
}

impl Ended {
    fn of(folder: &Path) -> Option<Self> {
        let written = |table: TableName| {
            let file = folder.join(table.as_str()).join(table.file());
            file.metadata().and_then(|file| file.modified()).ok()
        };
        Some(Self { run: written(TableName::Run)?, comparison: written(TableName::Comparison) })
    }
}

/// Adds what the descriptors of individuals cost and keep, which no table needs to say: their genes do.
fn count(individuals: &mut Columnar, space: &SearchSpace) {
    if individuals.has("cost") {
        return;
    }
    let columns = space.columns();
    let genes: Vec<_> = columns.iter().map(|column| individuals.numbers(column.name)).collect();
    let values = |row: usize| genes.iter().map(|gene| gene.get(row).copied().flatten()).collect::<Vec<_>>();
    let descriptors: Vec<_> = (0..individuals.rows()).map(|row| space.from_values(&values(row))).collect();
    let of = |measure: fn(&Descriptor) -> u64| descriptors.iter().map(move |one| one.as_ref().map(measure));
    individuals.add("cost", of(Descriptor::recognition_cost));
    individuals.add("size", of(Descriptor::size_of_cloud));
}

/// In which order viewers get what is new: first what is short and seen first.
const ORDER: [&str; 7] = ["reload", "run", "generations", "fleet", "events", "individuals", "attempts"];

impl Feed {
    /// Of a folder that was found.
    pub fn new(found: &Found) -> Self {
        Self {
            folder: found.folder.clone(),
            next_read: None,
            ended: None,
            is_whole: false,
            epoch: 0,
            generations: Vec::new(),
            individuals: Vec::new(),
            log: RunLogReader::new(found),
            overview: Overview::new(found),
            run: (Value::Null, 0),
        }
    }

    /// Whether it is time to read the folder again.
    pub fn is_due(&self, now: Instant) -> bool {
        self.next_read.is_none_or(|next| now >= next)
    }

    /// Reads what is new in the folder, if it is time; of a run that has ended nothing but its row as long as no `whole`
    /// is wanted: a list may have thousands.
    pub fn refresh(&mut self, whole: bool) {
        let begun = Instant::now();
        let is_missing = whole && !self.is_whole;
        if !self.is_due(begun) && !is_missing {
            return;
        }
        let ended = Ended::of(&self.folder);
        if ended.is_some() && ended == self.ended && !is_missing {
            self.next_read = Some(begun + EVERY);
            return;
        }
        let mut problem = None;
        if whole || self.is_whole || ended.is_none() {
            self.is_whole = true;
            problem = self.read_tables().err().map(|error| error.to_string());
            let read = self.log.read();
            if read.is_anew {
                self.epoch += 1;
            }
            problem = problem.or(read.problem);
        }
        self.ended = ended;
        self.overview.read(&self.generations, &self.log, problem);
        if let Some(experiment) = self.overview.experiment() {
            self.individuals.iter_mut().for_each(|individuals| count(individuals, experiment.space()));
        }
        let run = self.overview.json();
        if run != self.run.0 {
            self.run = (run, self.run.1 + 1);
        }
        // A folder that takes long to read is read less often.
        self.next_read = Some(begun + EVERY.max(SPARING * begun.elapsed()));
    }

    fn read_tables(&mut self) -> Result<(), results::Error> {
        let known = self.generations.len() as u32;
        let there = complete_generations(&self.folder, known)?;
        if there < known {
            (self.generations, self.individuals) = (Vec::new(), Vec::new());
            self.epoch += 1;
        }
        for generation in self.generations.len() as u32 + 1..=there {
            let read = |table| Columnar::of_generation(&self.folder, table, generation);
            let (Some(row), Some(individuals)) =
                (read(TableName::Generations)?, read(TableName::Evaluations)?)
            else {
                break; // removed since
            };
            self.generations.push(row);
            self.individuals.push(individuals);
        }
        let mut kept = 0;
        let is_over = |individuals: &Columnar| {
            kept += individuals.rows();
            kept > MOST_INDIVIDUALS
        };
        let over = self.individuals.iter().rev().position(is_over);
        if let Some(over) = over {
            self.individuals.drain(..self.individuals.len() - over.max(1));
        }
        Ok(())
    }

    /// The run in short.
    pub fn run(&self) -> &Value {
        &self.run.0
    }

    /// The same, with what it was started with.
    pub fn overview(&self) -> &Overview {
        &self.overview
    }

    /// Training clouds that the fitness asks for; `None` before the first generation.
    pub fn train_queries(&self) -> Option<u32> {
        let queries = self.generations.last()?.numbers("queries");
        queries.first().copied().flatten().map(|queries| queries as u32)
    }

    /// Generation and index of the best individual so far; the earliest of equal ones.
    pub fn best(&self) -> Option<(u32, u32)> {
        let first = |row: &Columnar, name: &str| row.numbers(name).first().copied().flatten();
        let mut best: Option<(f64, u32, u32)> = None;
        for (generation, row) in (1..).zip(&self.generations) {
            let (fitness, individual) = (first(row, "best_fitness")?, first(row, "best_individual")?);
            if best.is_none_or(|(most, ..)| fitness > most) {
                best = Some((fitness, generation, individual as u32));
            }
        }
        best.map(|(_, generation, individual)| (generation, individual))
    }

    /// The generations as a table.
    pub fn generations(&self) -> String {
        Columnar::json(self.generations.iter())
    }

    /// What a viewer does not have yet.
    pub fn since(&self, cursor: &mut Cursor) -> Vec<Message> {
        let mut messages = Vec::new();
        let generations = self.generations.len() as u32;
        let is_void = cursor.epoch.is_some_and(|epoch| epoch != self.epoch);
        if is_void || cursor.generation > generations || cursor.log > self.log.end() {
            *cursor = Cursor::default();
            messages.push(("reload", "{}".to_owned()));
        }
        cursor.epoch = Some(self.epoch);
        if cursor.run != self.run.1 {
            cursor.run = self.run.1;
            messages.push(("run", self.run.0.to_string()));
        }
        if cursor.generation < generations {
            let from = cursor.generation as usize;
            messages.push(("generations", Columnar::json(self.generations[from..].iter())));
            let first = self.generations.len() - self.individuals.len();
            let individuals = &self.individuals[from.saturating_sub(first)..];
            let mut json = Columnar::json(individuals.iter());
            if from < first {
                let omitted = format!(",\"omitted_generations\":{}}}", first - from);
                json.pop();
                json += &omitted;
            }
            messages.push(("individuals", json));
            cursor.generation = generations;
        }
        let mut place = LogCursor { log: cursor.log, fleet: cursor.fleet };
        messages.extend(self.log.since(&mut place));
        (cursor.log, cursor.fleet) = (place.log, place.fleet);
        messages.sort_by_key(|(name, _)| ORDER.iter().position(|other| other == name));
        messages
    }
}
