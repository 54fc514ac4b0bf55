//! Weights of a winner's values, learned again from the training clouds.

use descriptor::Descriptor;
use descriptor::structure::{Structure, StructureChannel, Weighted};
use results::RunRow;

use crate::dataset::Dataset;
use crate::experiment::Experiment;
use crate::reference_clouds::ReferenceError;
use crate::reopen::{searched, weighted_structure};
use crate::weighing::{TrainingClouds, teaching_sets};

/// What was found.
#[derive(Debug, Default)]
pub(super) struct Found {
    /// The winner with the weights that were learned again; `None` of a run that has weighed none.
    pub winner: Option<Descriptor>,
    /// In what the run has other weights.
    pub problem: Option<String>,
}

impl Found {
    fn problem(expected: &str, got: &str) -> Self {
        let problem = Some(format!("run: weighted_winner: expected {expected}, got {got}"));
        Self { winner: None, problem }
    }
}

/// Compares the weighted winner of a run with one that is weighed again.
///
/// # Errors
/// If the training clouds cannot be described: then nothing is known.
pub(super) fn check(
    experiment: &Experiment,
    dataset: &Dataset,
    row: &RunRow,
) -> Result<Found, ReferenceError> {
    let recorded = row.weighted_winner.as_deref();
    let Some(how) = experiment.weighs() else {
        let unasked = || Found::problem("none, as the experiment does not weigh", "one");
        return Ok(recorded.map(|_| unasked()).unwrap_or_default());
    };
    let structure = match searched(experiment.space(), row) {
        Ok(Descriptor::Structure(structure)) => structure,
        Ok(other) => return Ok(Found::problem("the weights of a structure", &other.to_string())),
        Err(error) => return Ok(Found { winner: None, problem: Some(format!("run: winner: {error}")) }),
    };
    let sets = teaching_sets(dataset, &experiment.set_weights(dataset));
    let clouds = TrainingClouds::describe(&sets, experiment.preprocess(), &structure)?;
    let weighted = match clouds.weigh(&structure, how) {
        Ok(weighted) => weighted,
        Err(error) => return Ok(Found::problem("weights that can be learned", &error.to_string())),
    };
    let problem = match recorded.map(weighted_structure) {
        None => Some("expected one, got none".to_owned()),
        Some(None) => Some("expected a structure, got something else".to_owned()),
        Some(Some(recorded)) => difference(&weighted, &recorded),
    };
    let problem = problem.map(|problem| format!("run: weighted_winner: {problem}"));
    Ok(Found { winner: Some(Descriptor::Structure(weighted)), problem })
}

/// In what a structure is another one than expected: the first thing, if there are several.
fn difference(expected: &Structure, got: &Structure) -> Option<String> {
    let counts = [expected, got].map(|structure| structure.channels.len());
    if counts[0] != counts[1] {
        return Some(format!("channels: expected {}, got {}", counts[0], counts[1]));
    }
    let (number, (expected, got)) = (1..)
        .zip(expected.channels.iter().zip(&got.channels))
        .find(|(_, (expected, got))| expected != got)?;
    let plain = |one: &Weighted| Weighted {
        channel: StructureChannel { value_weights: Vec::new(), ..one.channel.clone() },
        ..one.clone()
    };
    let of_channel = [expected, got].map(plain);
    if of_channel[0] != of_channel[1] {
        let [expected, got] = of_channel;
        return Some(format!("channel {number}: expected {expected}, got {got}"));
    }
    let of_value = |value| [expected, got].map(|one| weight_of(&one.channel, value));
    let mut values = 0..expected.channel.values() as usize;
    let value = values.find(|&value| of_value(value)[0] != of_value(value)[1])?;
    let [expected, got] = of_value(value);
    Some(format!("channel {number}: weight of value {}: expected {expected}, got {got}", value + 1))
}

/// How much a value counts: in full where the channel says nothing.
fn weight_of(channel: &StructureChannel, value: usize) -> f64 {
    let weight = channel.value_weights.get(value).copied().unwrap_or(StructureChannel::FULL);
    f64::from(weight) / f64::from(StructureChannel::FULL)
}

#[cfg(test)]
mod tests {
    use descriptor::structure::{Structure, StructureFile};

    use super::*;

    fn structure(channel: &str) -> Structure {
        let text = format!(
            "version = 1\n[[channel]]\npairs = \"cloud\"\nfeatures = [\"d 2\"]\nradius_cm = 9\n{channel}"
        );
        toml::from_str::<StructureFile>(&text).unwrap().structure().unwrap()
    }

    #[test]
    fn the_first_difference_is_named() {
        let plain = "weight = 1.0\n";
        let weighted = "weight = 1.0\nvalue_weights = [1, 0.5]\n";
        let told = |expected, got| difference(&structure(expected), &structure(got)).unwrap_or_default();
        assert_eq!(told(weighted, weighted), "");
        assert_eq!(told(weighted, plain), "channel 1: weight of value 2: expected 0.5, got 1");
        let of_channel =
            "channel 1: expected cloud d 2, 9 cm, all pairs, weight 1.0, got cloud d 2, 9 cm, all pairs, ";
        assert_eq!(told(plain, "weight = 0.25\n"), format!("{of_channel}weight 0.25"));
        assert_eq!(
            told(weighted, "scale = \"none\"\nweight = 1.0\n"),
            format!("{of_channel}unscaled, weight 1.0")
        );
        let mut two = structure(plain);
        two.channels.extend(structure(plain).channels);
        assert_eq!(difference(&structure(plain), &two).as_deref(), Some("channels: expected 1, got 2"));
    }
}
