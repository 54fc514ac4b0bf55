//! From wire types to the worker's own and back: the only file here that knows both.

use descriptor::genes::Domain;
use descriptor::{
    Descriptor, FixedDescriptor, FixedKind, GENES, GeneKind, GeneTable, Parameters, Preprocess, SearchSpace,
    Unit,
};
use proto::{Digest, MAX_CELL, MAX_RADIUS_UM, v1};

use crate::executor::{
    Description, Evaluation, EvaluationError, GridCell, Outcome, Preparation, Splits, Task, Tile,
};

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
pub fn task(job: v1::Job) -> Result<Task, InvalidJob> {
    match (job.evaluation, job.grid_cell, job.description, job.tile) {
        (Some(wire), None, None, None) => evaluation(wire).map(Task::Evaluation),
        (None, Some(wire), None, None) => grid_cell(wire).map(Task::GridCell),
        (None, None, Some(wire), None) => description(wire).map(Task::Description),
        (None, None, None, Some(wire)) => tile(wire).map(Task::Tile),
        _ => Err(invalid("one of evaluation, grid_cell, description and tile must be set")),
    }
}

fn description(wire: v1::Description) -> Result<Description, InvalidJob> {
    let mut preparation = preparation(wire.preparation)?;
    let descriptor = match wire.fixed {
        Some(_) if wire.parameters.is_some() => {
            return Err(invalid("one of parameters and fixed must be set"));
        }
        Some(fixed) => {
            let fixed = self::fixed(fixed)?;
            preparation.space = SearchSpace::Fixed(fixed);
            Descriptor::Fixed(fixed)
        }
        None => descriptor(wire.parameters, &preparation)?,
    };
    Ok(Description { preparation, descriptor, manifest: digest(&wire.manifest)? })
}

fn fixed(wire: v1::FixedDescriptor) -> Result<FixedDescriptor, InvalidJob> {
    let kind = match wire.kind() {
        v1::FixedKind::Pfhrgb => FixedKind::PfhRgb,
        v1::FixedKind::Shotcolor => FixedKind::ShotColor,
        v1::FixedKind::Unspecified => return Err(invalid("kind of descriptor is missing")),
    };
    if !(1..=MAX_RADIUS_UM).contains(&wire.radius_um) {
        return Err(invalid(format!("radius must be 1 to {MAX_RADIUS_UM} um, got {}", wire.radius_um)));
    }
    Ok(FixedDescriptor { kind, radius_um: wire.radius_um })
}

fn tile(wire: v1::Tile) -> Result<Tile, InvalidJob> {
    let evaluation = evaluation(wire.evaluation.ok_or_else(|| invalid("evaluation is missing"))?)?;
    let descriptions = splits(&wire.query_parts, &wire.database_parts)?;
    let lengths = |splits: &Splits| [splits.query.len(), splits.database.len()];
    if lengths(&descriptions) != lengths(&evaluation.splits) {
        return Err(invalid("a tile must name a description for each of its shards"));
    }
    Ok(Tile { evaluation, descriptions })
}

fn evaluation(wire: v1::Evaluation) -> Result<Evaluation, InvalidJob> {
    let preparation = preparation(wire.preparation)?;
    let descriptor = descriptor(wire.parameters, &preparation)?;
    let splits = splits(&wire.query, &wire.database)?;
    Ok(Evaluation { preparation, descriptor, splits, want_matches: wire.want_matches })
}

fn descriptor(wire: Option<v1::Parameters>, preparation: &Preparation) -> Result<Descriptor, InvalidJob> {
    let p = wire.ok_or_else(|| invalid("parameters are missing"))?;
    let descriptor = Descriptor::DiskRing(Parameters::from_ticks([
        p.shape_bins,
        p.colour_bins,
        p.disk_um,
        p.ring_um,
        p.shape_weight_ppm,
    ]));
    if !preparation.space.contains(&descriptor) {
        return Err(invalid(format!("parameters must lie in the search space, got {descriptor}")));
    }
    Ok(descriptor)
}

fn grid_cell(wire: v1::GridCell) -> Result<GridCell, InvalidJob> {
    let preparation = preparation(wire.preparation)?;
    let SearchSpace::DiskRing(genes) = &preparation.space else {
        return Err(invalid("a grid cell is of the disk-ring family"));
    };
    for (kind, um) in [(GeneKind::DiskRadius, wire.disk_um), (GeneKind::RingRadius, wire.ring_um)] {
        if !genes.domain(kind).is_some_and(|domain| domain.values().any(|value| value == um)) {
            let name = GENES[kind as usize].name;
            return Err(invalid(format!("{name} must lie in the search space, got {um} um")));
        }
    }
    let count = |kind| genes.domain(kind).map_or(1, |domain| u64::from(domain.count));
    // Three counts of at most 65536 each.
    let descriptors = count(GeneKind::ShapeBins) * count(GeneKind::ColourBins) * count(GeneKind::ShapeWeight);
    if descriptors > MAX_CELL {
        return Err(invalid(format!("a grid cell has at most {MAX_CELL} descriptors, got {descriptors}")));
    }
    let splits = splits(&wire.query, &wire.database)?;
    Ok(GridCell { preparation, disk_um: wire.disk_um, ring_um: wire.ring_um, splits })
}

fn splits(query: &[Vec<u8>], database: &[Vec<u8>]) -> Result<Splits, InvalidJob> {
    Ok(Splits { query: digests(query)?, database: digests(database)? })
}

fn preparation(wire: Option<v1::Preparation>) -> Result<Preparation, InvalidJob> {
    let wire = wire.ok_or_else(|| invalid("preparation is missing"))?;
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
    Ok(Preparation { preprocess, space: SearchSpace::DiskRing(genes) })
}

fn digests(wire: &[Vec<u8>]) -> Result<Vec<Digest>, InvalidJob> {
    wire.iter().map(|bytes| digest(bytes)).collect()
}

fn digest(wire: &[u8]) -> Result<Digest, InvalidJob> {
    Digest::try_from(wire).map_err(|error| invalid(error.to_string()))
}

/// A report of what came of a job.
pub fn report(lease: proto::Lease, run_seconds: f64, outcome: Result<Outcome, Failure>) -> v1::JobReport {
    use v1::job_report::Outcome as Wire;
    let outcome = match outcome {
        Ok(Outcome::GridCell(object_correct)) => Wire::GridCell(v1::GridCellResult { object_correct }),
        Ok(Outcome::Description(parts)) => Wire::Description(v1::DescriptionResult { parts }),
        Ok(Outcome::Evaluation(outcome)) => Wire::Result(v1::EvaluationResult {
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
                | EvaluationError::Recognise(_)
                | EvaluationError::TooLarge { .. },
            ) => v1::FailureReason::InvalidJob,
            Self::Evaluation(EvaluationError::Blob(_)) => v1::FailureReason::Data,
            Self::Evaluation(EvaluationError::Cloud { .. }) => v1::FailureReason::Cloud,
            Self::Evaluation(EvaluationError::Description { .. } | EvaluationError::Undecodable(_)) => {
                v1::FailureReason::Description
            }
            Self::Panic(_) => v1::FailureReason::Panic,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn preparation() -> v1::Preparation {
        let domain = |gene: &descriptor::GeneSpec| {
            let (low, high, step) = gene.paper;
            v1::Domain { low, step, count: (high - low) / step + 1 }
        };
        v1::Preparation {
            leaf_um: 20_000,
            normal_radius_um: 10_000,
            min_points: 10,
            colour: true,
            unit: v1::LengthUnit::Metre.into(),
            domains: GENES.iter().map(domain).collect(),
        }
    }

    fn cell() -> v1::GridCell {
        let preparation = Some(preparation());
        let (query, database) = (vec![vec![1; 32]], vec![vec![2; 32]]);
        v1::GridCell { preparation, disk_um: 13_000, ring_um: 36_000, query, database }
    }

    fn evaluation() -> v1::Evaluation {
        let p = Parameters::PAPER_BEST;
        let parameters = v1::Parameters {
            shape_bins: p.shape_bins,
            colour_bins: p.colour_bins,
            disk_um: p.disk_um,
            ring_um: p.ring_um,
            shape_weight_ppm: p.shape_weight_ppm,
        };
        let (query, database) = (vec![vec![1; 32]], vec![vec![2; 32]]);
        let preparation = Some(preparation());
        v1::Evaluation { preparation, parameters: Some(parameters), query, database, want_matches: false }
    }

    fn job(evaluation: Option<v1::Evaluation>, grid_cell: Option<v1::GridCell>) -> v1::Job {
        v1::Job { evaluation, grid_cell, ..v1::Job::default() }
    }

    fn pieces(description: Option<v1::Description>, tile: Option<v1::Tile>) -> v1::Job {
        v1::Job { description, tile, ..v1::Job::default() }
    }

    #[test]
    fn a_tile_names_a_description_for_each_of_its_shards() {
        let v1::Evaluation { preparation, parameters, .. } = evaluation();
        let description = v1::Description { preparation, parameters, manifest: vec![3; 32], fixed: None };
        let described = task(pieces(Some(description.clone()), None)).unwrap();
        assert!(matches!(described, Task::Description(found) if found.manifest == Digest([3; 32])));
        let shot = v1::FixedDescriptor { kind: v1::FixedKind::Shotcolor.into(), radius_um: 50_000 };
        let fixed = |fixed| v1::Description { parameters: None, fixed: Some(fixed), ..description.clone() };
        let described = task(pieces(Some(fixed(shot)), None)).unwrap();
        let expected = Descriptor::Fixed(FixedDescriptor { kind: FixedKind::ShotColor, radius_um: 50_000 });
        assert!(matches!(described, Task::Description(found) if found.descriptor == expected));
        for (kind, radius_um) in [(0, 50_000), (9, 50_000), (1, 0), (1, 1_000_001)] {
            task(pieces(Some(fixed(v1::FixedDescriptor { kind, radius_um })), None)).unwrap_err();
        }
        task(pieces(Some(v1::Description { fixed: Some(shot), ..description.clone() }), None)).unwrap_err();
        let tile = v1::Tile {
            evaluation: Some(evaluation()),
            query_parts: vec![vec![4; 32]],
            database_parts: vec![vec![5; 32]],
        };
        let matched = task(pieces(None, Some(tile.clone()))).unwrap();
        assert!(matches!(matched, Task::Tile(found) if found.descriptions.database == [Digest([5; 32])]));
        task(pieces(Some(description.clone()), Some(tile.clone()))).unwrap_err();
        task(pieces(None, Some(v1::Tile { evaluation: None, ..tile.clone() }))).unwrap_err();
        task(pieces(None, Some(v1::Tile { query_parts: vec![], ..tile.clone() }))).unwrap_err();
        task(pieces(None, Some(v1::Tile { database_parts: vec![vec![5; 31]], ..tile }))).unwrap_err();
        task(pieces(Some(v1::Description { manifest: vec![], ..description }), None)).unwrap_err();
    }

    #[test]
    fn a_job_is_one_task() {
        let evaluated = task(job(Some(evaluation()), None)).unwrap();
        assert!(
            matches!(evaluated, Task::Evaluation(found) if found.descriptor == Descriptor::DiskRing(Parameters::PAPER_BEST))
        );
        let counted = task(job(None, Some(cell()))).unwrap();
        assert!(
            matches!(counted, Task::GridCell(found) if (found.disk_um, found.ring_um) == (13_000, 36_000))
        );
        task(job(None, None)).unwrap_err();
        task(job(Some(evaluation()), Some(cell()))).unwrap_err();
    }

    #[test]
    fn cells_outside_the_search_space_are_refused() {
        let refused = |change: fn(&mut v1::GridCell)| {
            let mut cell = cell();
            change(&mut cell);
            task(job(None, Some(cell))).unwrap_err().to_string()
        };
        assert!(refused(|cell| cell.preparation = None).contains("preparation is missing"));
        assert!(
            refused(|cell| cell.disk_um = 13_500).contains("R1 must lie in the search space, got 13500 um")
        );
        assert!(
            refused(|cell| cell.ring_um = 60_000).contains("R2 must lie in the search space, got 60000 um")
        );
        assert!(refused(|cell| cell.query[0].truncate(31)).contains("digest"));
        let too_many = refused(|cell| {
            let domains = &mut cell.preparation.as_mut().unwrap().domains;
            domains[0] = v1::Domain { low: 2, step: 1, count: 511 };
            domains[4] = v1::Domain { low: 0, step: 1, count: 65_536 };
        });
        assert!(too_many.contains("at most 1048576 descriptors, got 200933376"), "{too_many}");
    }
}
