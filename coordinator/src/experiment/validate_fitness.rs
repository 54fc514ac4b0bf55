//! The meaning of `[search.fitness]` and `[search.sets]`.

use std::collections::BTreeMap;

use proto::task::Objective;

use super::checks::checked_name;
use super::raw::{RawFitness, RawObjective};
use crate::fitness::{Fitness, FitnessProtocol, MAX_WEIGHT};
use artefact::sections::Fault;

/// Checks `[search.fitness]`. Where no protocol has a weight, those of `default` are taken.
pub(super) fn fitness(raw: Option<&RawFitness>, default: Fitness) -> Result<Fitness, Fault> {
    let Some(raw) = raw else { return Ok(default) };
    let RawFitness { split, cross_sequence, leave_one_out, objective, margin } = raw;
    let written = [*split, *cross_sequence, *leave_one_out];
    for (protocol, weight) in FitnessProtocol::ALL.into_iter().zip(written) {
        check_weight(format!("search.fitness.{}", protocol.name()), weight.unwrap_or_default())?;
    }
    let weights = if written.iter().all(Option::is_none) {
        default.weights()
    } else {
        written.map(Option::unwrap_or_default)
    };
    let objective = match objective {
        RawObjective::Object => Objective::Object,
        RawObjective::Category => Objective::Category,
    };
    let plain = (weights, objective) == (Fitness::PAPER.weights(), Objective::Object);
    Fitness::new(weights, objective, margin.unwrap_or(!plain)).ok_or_else(|| {
        Fault::new(
            "search.fitness",
            "no protocol with a weight above 0, got only zeros",
            "write for example `cross-sequence = 1`",
        )
    })
}

/// Checks `[search.sets]`, but for the names: the manifest has them.
pub(super) fn set_weights(raw: BTreeMap<String, u32>) -> Result<BTreeMap<String, u32>, Fault> {
    for (name, weight) in &raw {
        checked_name("search.sets", name)?;
        check_weight(format!("search.sets.{name}"), *weight)?;
    }
    Ok(raw)
}

fn check_weight(place: String, weight: u32) -> Result<(), Fault> {
    if weight <= MAX_WEIGHT {
        return Ok(());
    }
    let what = format!("not between 0 and {MAX_WEIGHT}, got {weight}");
    Err(Fault::new(place, what, "write a whole weight such as 1"))
}
