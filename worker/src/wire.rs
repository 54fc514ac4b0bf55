//! From wire types to the worker's own and back: the only file here that knows both.

use descriptor::genes::Domain;
use descriptor::{GENES, GeneTable, Parameters, Preprocess, Unit};
use proto::{Digest, v1};

use crate::workshop::{Evaluation, EvaluationError, Outcome, Preparation};

/// A job that does not make sense.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("job: {what}\nuse a worker and a coordinator of the same release")]
pub struct InvalidJob {
    what: String,
}

fn invalid(what: impl Into<String>) -> InvalidJob {
    InvalidJob { what: what.into() }
}

/// What a job asks for, checked.
pub fn evaluation(job: v1::Job) -> Result<Evaluation, InvalidJob> {
    let evaluation = job.evaluation.ok_or_else(|| invalid("evaluation is missing"))?;
    let preparation = preparation(&evaluation.preparation.ok_or_else(|| invalid("preparation is missing"))?)?;
    let p = evaluation.parameters.ok_or_else(|| invalid("parameters are missing"))?;
    let parameters =
        Parameters::from_ticks([p.shape_bins, p.colour_bins, p.disk_um, p.ring_um, p.shape_weight_ppm]);
    if !preparation.genes.contains(&parameters) {
        return Err(invalid(format!("parameters must lie in the search space, got {parameters}")));
    }
    Ok(Evaluation {
        preparation,
        parameters,
        query: digests(&evaluation.query)?,
        database: digests(&evaluation.database)?,
        want_matches: evaluation.want_matches,
    })
}

fn preparation(wire: &v1::Preparation) -> Result<Preparation, InvalidJob> {
    let unit = match wire.unit() {
        v1::LengthUnit::Metre => Unit::Metre,
        v1::LengthUnit::Millimetre => Unit::Millimetre,
        v1::LengthUnit::Unspecified => return Err(invalid("unit is missing")),
    };
    let domains: Vec<Domain> =
        wire.domains.iter().map(|d| Domain { low: d.low, step: d.step, count: d.count }).collect();
    let domains = <[Domain; GENES.len()]>::try_from(domains)
        .map_err(|domains| invalid(format!("domains must be {}, got {}", GENES.len(), domains.len())))?;
    let preprocess = Preprocess {
        leaf_um: wire.leaf_um,
        normal_radius_um: wire.normal_radius_um,
        min_points: wire.min_points,
        colour: wire.colour,
        unit,
    };
    let genes = GeneTable::new(domains, wire.colour).map_err(|error| invalid(error.to_string()))?;
    Ok(Preparation { preprocess, genes })
}

fn digests(wire: &[Vec<u8>]) -> Result<Vec<Digest>, InvalidJob> {
    wire.iter()
        .map(|bytes| Digest::try_from(&bytes[..]).map_err(|error| invalid(error.to_string())))
        .collect()
}

/// A report of what came of a job.
pub fn report(lease: proto::Lease, run_seconds: f64, outcome: Result<Outcome, Failure>) -> v1::JobReport {
    use v1::job_report::Outcome as Wire;
    let outcome = match outcome {
        Ok(outcome) => Wire::Result(v1::EvaluationResult {
            queries: outcome.correct.queries as u32,
            object_correct: outcome.correct.object as u32,
            category_correct: outcome.correct.category as u32,
            matches: outcome
                .matches
                .iter()
                .map(|found| v1::Match {
                    nearest: found.nearest.index,
                    distance: found.nearest.distance,
                    runner_up: found.runner_up.map(|hit| hit.index),
                    runner_up_distance: found.runner_up.map(|hit| hit.distance),
                })
                .collect(),
        }),
        Err(failure) => Wire::Failure(v1::JobFailure {
            reason: failure.reason().into(),
            message: proto::truncate(&failure.to_string(), proto::MAX_TEXT_BYTES).to_owned(),
        }),
    };
    v1::JobReport { lease: Some(lease.into()), run_seconds, outcome: Some(outcome) }
}

/// Why there is no result.
#[derive(Debug, thiserror::Error)]
pub enum Failure {
    /// The job was malformed.
    #[error(transparent)]
    Invalid(#[from] InvalidJob),
    /// The evaluation met something it cannot handle.
    #[error(transparent)]
    Evaluation(#[from] EvaluationError),
    /// The evaluation panicked.
    #[error("evaluation panicked: {0}")]
    Panic(String),
}

impl Failure {
    fn reason(&self) -> v1::FailureReason {
        match self {
            Self::Invalid(_)
            | Self::Evaluation(
                EvaluationError::Manifest { .. }
                | EvaluationError::Quantise(_)
                | EvaluationError::Recognise(_),
            ) => v1::FailureReason::InvalidJob,
            Self::Evaluation(EvaluationError::Blob(_)) => v1::FailureReason::Data,
            Self::Evaluation(EvaluationError::Cloud { .. }) => v1::FailureReason::Cloud,
            Self::Panic(_) => v1::FailureReason::Panic,
        }
    }
}
