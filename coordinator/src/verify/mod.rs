//! Verification of a finished run: its files against their digests, and a sample of its fitness values against the
//! data and this program; of a search of several objectives the front against all evaluations, of clouds of several sets the
//! errors by set against the answers, and of a winner that was weighed its weights against the training clouds.

mod front;
mod recomputed;
mod sets;
mod weights;

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use cache::Storage;
use cache::Store;
use descriptor::random;
use rand::RngExt as _;
use results::{Counts, EvaluationRow};

use crate::console::say;
use crate::experiment::{LocalWorkers, Overrides};
use crate::reopen::{ReopenError, Reopened, reopen};
use crate::result_cache::{CountsByDescriptor, forget};
use crate::run::{Matching, RunError, clouds, counts_text, data_digest};
use crate::session::Session;
use crate::signing::PublicKey;
use recomputed::{recompute, wrong_sources};

/// Why a run cannot be verified.
#[derive(Debug, thiserror::Error)]
pub enum VerifyError {
    /// The files of the run folder.
    #[error(transparent)]
    Results(#[from] results::Error),
    /// The run, its experiment or its data.
    #[error(transparent)]
    Reopen(#[from] ReopenError),
    /// Evaluation.
    #[error(transparent)]
    Run(#[from] RunError),
}

/// What is said of runs without digests of how they went.
const NOT_RECORDED: &str = "workers, attempts, events, skipped, sets, looks and times: digests were not recorded by the release of this run";

/// What verification found.
#[derive(Debug)]
pub struct Verdict {
    run_digest: String,
    covers_log: bool,
    /// Who has signed it, if that was asked.
    signer: Option<PublicKey>,
    problems: Vec<String>,
    recomputed: usize,
    /// Descriptors whose errors by set were counted again from their answers.
    by_set: usize,
    /// Whether the weights of the winner's values were learned again.
    weighed: bool,
    /// Points of the front that was found again among the evaluations.
    front: usize,
    /// What could not be looked at.
    notes: Vec<String>,
}

impl Verdict {
    /// Whether everything that was looked at is as it should be.
    pub fn is_sound(&self) -> bool {
        self.problems.is_empty()
    }

    /// Adds whether the owner of a key has signed the run.
    pub fn add_signature(&mut self, key: PublicKey, verified: Result<(), String>) {
        match verified {
            Ok(()) => self.signer = Some(key),
            Err(problem) => self.problems.push(problem),
        }
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for problem in &self.problems {
            writeln!(f, "{problem}")?;
        }
        if !self.covers_log {
            writeln!(f, "{NOT_RECORDED}")?;
        }
        for note in &self.notes {
            writeln!(f, "{note}")?;
        }
        let verdict = if self.is_sound() { "sound" } else { "NOT sound" };
        write!(
            f,
            "{verdict}: run digest {}, {} fitness values recomputed",
            self.run_digest, self.recomputed
        )?;
        if self.front > 0 {
            write!(f, ", front of {} points found again", self.front)?;
        }
        if self.by_set > 0 {
            write!(f, ", errors by set of {} descriptors counted again", self.by_set)?;
        }
        if self.weighed {
            write!(f, ", weights of the winner's values learned again")?;
        }
        writeln!(f)?;
        self.signer.map_or(Ok(()), |signer| writeln!(f, "signed by {signer}"))
    }
}

/// Recomputes the digests of a finished run, and `sample` of its fitness values if the files are sound. Clouds may
/// come prepared from the cache, but no count does.
pub async fn verify(
    run: &Path,
    sample: u32,
    data: Option<PathBuf>,
    storage: &Storage,
) -> Result<Verdict, VerifyError> {
    if !run.is_dir() {
        return Err(ReopenError::NoFolder(run.to_owned()).into());
    }
    let verification = results::verify(run)?;
    let mut verdict = Verdict {
        run_digest: verification.recorded_run_digest.clone(),
        covers_log: verification.covers_log,
        signer: None,
        problems: verification.problems.iter().map(ToString::to_string).collect(),
        recomputed: 0,
        by_set: 0,
        weighed: false,
        front: 0,
        notes: Vec::new(),
    };
    if sample == 0 || !verdict.is_sound() {
        return Ok(verdict);
    }
    let store = Arc::new(Store::open(storage, "verify", descriptor::EVALUATION_VERSION));
    let Reopened { finished, experiment, dataset } =
        reopen(run, data.as_deref(), Overrides::default(), &store)?;
    let (expected, digest) = (finished.row.data_digest.clone(), data_digest(&dataset));
    if digest != expected {
        let difference = clouds::difference(run, &expected, &dataset);
        verdict.problems.push(format!("data: digest: expected {expected}, got {digest}\n{difference}"));
        return Ok(verdict);
    }

    let evaluations = results::read_evaluations(run)?;
    if experiment.objectives().are_several() {
        let found = front::check(run, &experiment, &evaluations)?;
        verdict.front = found.points;
        verdict.problems.extend(found.problems);
    }
    let found = sets::check(run, &experiment, &dataset)?;
    verdict.by_set = found.descriptors;
    verdict.problems.extend(found.problems);
    verdict.notes.extend(found.notes);

    let weights::Found { winner: weighted, problem } =
        weights::check(&experiment, &dataset, &finished.row).map_err(RunError::from)?;
    verdict.weighed = weighted.is_some();
    verdict.problems.extend(problem);

    let chosen = choose(evaluations, sample, &verdict.run_digest);
    let space = experiment.space();
    let descriptors = chosen.iter().map(|row| space.from_values(&row.genes));
    let Some(descriptors) = descriptors.collect::<Option<Vec<_>>>() else {
        verdict.problems.push("evaluations: gene values: must lie on the genes' grids".to_owned());
        return Ok(verdict);
    };
    say(format_args!("recomputing {} fitness values", descriptors.len()));
    let mut session = Session::new(&experiment, &dataset, store, storage.memory).map_err(RunError::from)?;
    session.start(None, LocalWorkers::Auto).await;
    let again = recompute(&session, (&experiment, &dataset), &descriptors, weighted.as_ref()).await?;
    if again.weighted != finished.row.weighted_train {
        let text = |counts: Option<Counts>| counts.as_ref().map_or_else(|| "none".to_owned(), counts_text);
        let (expected, got) = (text(again.weighted), text(finished.row.weighted_train));
        verdict.problems.push(format!("run: weighted_train: expected {expected}, got {got}"));
    }
    verdict.recomputed = again.evaluated;
    let mut wrong_rows = Vec::new();
    for ((row, descriptor), individual) in chosen.iter().zip(&descriptors).zip(&again.individuals) {
        let problems = individual.problems(row);
        if !problems.is_empty() {
            wrong_rows.push((row, descriptor));
        }
        verdict.problems.extend(problems);
    }
    if !wrong_rows.is_empty() {
        let cache = session.splits.count_cache(&session.store, experiment.preprocess(), Matching::Train);
        let remembered =
            if experiment.remembers_counts(&dataset) { cache.read() } else { CountsByDescriptor::new() };
        let wrong = wrong_sources(run, &wrong_rows, &remembered, &session.store)?;
        let mut forgotten = forget(&session.store, &wrong);
        let this = std::path::absolute(run).unwrap_or_else(|_| run.to_owned());
        forgotten.finished.retain(|other| other.folder != this);
        if !forgotten.is_empty() {
            say(format_args!("principal {wrong} was wrong: {forgotten}"));
        }
    }
    Ok(verdict)
}

/// A sample without repetition; which one depends on the run alone, so that two people see the same.
fn choose(mut rows: Vec<EvaluationRow>, sample: u32, run_digest: &str) -> Vec<EvaluationRow> {
    let mut rng = random::stream(0, &format!("verify {run_digest}"), &[]);
    let wanted = rows.len().min(sample as usize);
    for place in 0..wanted {
        let other = rng.random_range(place as u64..rows.len() as u64) as usize;
        rows.swap(place, other);
    }
    rows.truncate(wanted);
    rows
}
