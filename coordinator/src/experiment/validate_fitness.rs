//! The meaning of `[search.fitness]`.

use proto::task::Objective;

use super::error::Fault;
use super::raw::{RawFitness, RawObjective};
use crate::fitness::{Fitness, FitnessProtocol, MAX_WEIGHT};

/// Checks `[search.fitness]`. Where no protocol has a weight, those of `default` are taken.
pub(super) fn fitness(raw: Option<&RawFitness>, default: Fitness) -> Result<Fitness, Fault> {
    let Some(raw) = raw else { return Ok(default) };
    let RawFitness { split, cross_sequence, leave_one_out, objective, margin } = raw;
    let written = [*split, *cross_sequence, *leave_one_out];
    for (protocol, weight) in FitnessProtocol::ALL.into_iter().zip(written) {
        if let Some(weight) = weight.filter(|&weight| weight > MAX_WEIGHT) {
            return Err(Fault::new(
                format!("search.fitness.{}", protocol.name()),
                format!("not between 0 and {MAX_WEIGHT}, got {weight}"),
                "write a whole weight such as 1",
            ));
        }
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
