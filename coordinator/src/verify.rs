//! Verification of a finished run: its files against their digests, and a sample of its fitness values against the
//! data and this program.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use descriptor::random;
use rand::RngExt as _;
use results::RecordedEvaluation;
use worker::Storage;
use worker::store::Store;

use crate::dataset::Wanted;
use crate::experiment::{Experiment, ExperimentError, LocalWorkers, Overrides};
use crate::run::{DataError, RunError, Workplace, open_data, rows};

/// Why a run cannot be verified.
#[derive(Debug, thiserror::Error)]
pub enum VerifyError {
    /// The run folder.
    #[error(transparent)]
    Results(#[from] results::Error),
    /// The recorded experiment.
    #[error(transparent)]
    Experiment(#[from] ExperimentError),
    /// Data or evaluation.
    #[error(transparent)]
    Run(#[from] RunError),
    /// There is no such folder.
    #[error("{0}: no such run folder\nname the folder that the run's summary calls results")]
    NoFolder(PathBuf),
    /// Other numbers are to be expected.
    #[error(
        "{run}: evaluation version must be {expected}, got {got}\nverify it with the release that made it, or look at the digest only with --sample 0"
    )]
    EvaluationVersion {
        /// The run.
        run: PathBuf,
        /// This program's.
        expected: u32,
        /// The run's.
        got: u32,
    },
}

/// What verification found.
#[derive(Debug)]
pub struct Verdict {
    run_digest: String,
    problems: Vec<String>,
    recomputed: usize,
}

impl Verdict {
    /// Whether everything that was looked at is as it should be.
    pub fn is_sound(&self) -> bool {
        self.problems.is_empty()
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for problem in &self.problems {
            writeln!(f, "{problem}")?;
        }
        let verdict = if self.is_sound() { "sound" } else { "NOT sound" };
        writeln!(
            f,
            "{verdict}: run digest {}, {} fitness values recomputed",
            self.run_digest, self.recomputed
        )
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
        return Err(VerifyError::NoFolder(run.to_owned()));
    }
    let verification = results::verify(run)?;
    let mut verdict = Verdict {
        run_digest: verification.recorded_run_digest.clone(),
        problems: verification.problems.iter().map(ToString::to_string).collect(),
        recomputed: 0,
    };
    if sample == 0 || !verdict.is_sound() {
        return Ok(verdict);
    }
    let recorded = results::read_run(run)?;
    if recorded.row.evaluation_version != descriptor::EVALUATION_VERSION {
        return Err(VerifyError::EvaluationVersion {
            run: run.to_owned(),
            expected: descriptor::EVALUATION_VERSION,
            got: recorded.row.evaluation_version,
        });
    }
    let store = Arc::new(Store::open(storage, "verify"));
    let record = &recorded.row.resolved_toml;
    let experiment = Experiment::from_record(record, run, data.as_deref(), Overrides::default())?;
    let dataset = open_data(&experiment, Wanted::All, Some(&store), |line| eprintln!("{line}"))
        .map_err(RunError::from)?;
    let digest = proto::Digest(dataset.clouds.digest).to_string();
    if digest != recorded.row.data_digest {
        verdict.problems.push(format!("data: digest: expected {}, got {digest}", recorded.row.data_digest));
        return Ok(verdict);
    }

    let chosen = choose(results::read_evaluations(run)?, sample, &verdict.run_digest);
    let Some(parameters) = chosen.iter().map(|row| rows::parameters(&row.genes)).collect::<Option<Vec<_>>>()
    else {
        verdict.problems.push("evaluations: gene values: must lie on the genes' grids".to_owned());
        return Ok(verdict);
    };
    eprintln!("recomputing {} fitness values", parameters.len());
    let mut workplace = Workplace::new(&experiment, &dataset, store, storage.memory)
        .map_err(|error| RunError::from(DataError::from(error)))?;
    let mut crew = workplace.staff(LocalWorkers::Auto);
    let counts = crew.during(async { Ok::<_, RunError>(workplace.train_counts(&parameters).await?) }).await?;
    crew.stop().await;
    verdict.recomputed = counts.len();
    for (row, counts) in chosen.iter().zip(&counts) {
        if row.counts != *counts {
            verdict.problems.push(format!(
                "evaluations, generation {}, individual {}: expected {} objects and {} categories of {}, got {} and {}",
                row.generation,
                row.individual,
                counts.object_correct,
                counts.category_correct,
                counts.queries,
                row.counts.object_correct,
                row.counts.category_correct
            ));
        }
    }
    Ok(verdict)
}

/// A sample without repetition; which one depends on the run alone, so that two people see the same.
fn choose(mut rows: Vec<RecordedEvaluation>, sample: u32, run_digest: &str) -> Vec<RecordedEvaluation> {
    let mut rng = random::stream(0, &format!("verify {run_digest}"), &[]);
    let wanted = rows.len().min(sample as usize);
    for place in 0..wanted {
        let other = rng.random_range(place as u64..rows.len() as u64) as usize;
        rows.swap(place, other);
    }
    rows.truncate(wanted);
    rows
}
