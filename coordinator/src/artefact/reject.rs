//! Section `[reject]` of an artefact's settings: when an answer is not believed, because the object is unknown.

use std::collections::BTreeMap;

use descriptor::recogniser::{Calibration, CrossAnswers, LabelledClouds, RejectError, RejectRule, Settings};
use descriptor::{SetDistance, Signatures};
use results::DatabaseCloud;
use serde::{Deserialize, Serialize};

use super::reference::labels;

/// Share of the answers about known objects that may be rejected where nothing else is said.
pub const FALSE_REJECTIONS: f64 = 0.05;
/// Most of that share.
pub const MOST_FALSE_REJECTIONS: f64 = 0.5;

/// The section; without it every answer is believed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RejectSettings {
    /// Share of the reference clouds whose answer may be rejected.
    pub false_rejections: f64,
    /// What set distances to the nearest cloud are divided by.
    typical_distance: f64,
    /// Of 1, the distance, the margin and, of a recogniser that learns, the set distance to the nearest cloud.
    coefficients: [f64; 4],
    least_probability: f64,
    least_margin: f64,
}

/// When answers are not believed, and what that is found by.
#[derive(Clone, Debug, PartialEq)]
pub struct Reject {
    /// Share of the reference clouds whose answer may be rejected.
    pub false_rejections: f64,
    /// The rule with what it makes of the reference clouds, or why there is none.
    pub calibration: Result<Calibration, RejectError>,
    /// What was left out together.
    pub folds: FoldsBy,
}

/// What is left out together where reference clouds ask each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FoldsBy {
    /// So many sequences, of which some are additions whose clouds have none of their own.
    Sequences {
        /// All of them.
        sequences: usize,
        /// Additions among them.
        additions: usize,
    },
    /// Every fifth cloud of an object.
    Positions,
}

/// Of no artefact, for tests and fuzzing.
impl Default for RejectSettings {
    fn default() -> Self {
        Self {
            false_rejections: FALSE_REJECTIONS,
            typical_distance: 1.0,
            coefficients: [0.0, -1.0, 1.0, -1.0],
            least_probability: 0.5,
            least_margin: 0.1,
        }
    }
}

impl RejectSettings {
    /// Of what was found; `None` if nothing was.
    pub(super) fn of(reject: &Reject) -> Option<Self> {
        let RejectRule { typical_distance, coefficients, least_probability, least_margin, .. } =
            reject.calibration.as_ref().ok()?.rule;
        let false_rejections = reject.false_rejections;
        Some(Self { false_rejections, typical_distance, coefficients, least_probability, least_margin })
    }

    /// The rule of a recogniser that learns, or of the nearest cloud; `Err` says which value can be none.
    pub(super) fn resolve(&self, is_learned: bool) -> Result<RejectRule, String> {
        let Self { false_rejections, typical_distance, coefficients, least_probability, least_margin } =
            *self;
        if !(0.0..=MOST_FALSE_REJECTIONS).contains(&false_rejections) {
            return Err(format!(
                "reject.false_rejections {false_rejections} instead of 0 to {MOST_FALSE_REJECTIONS}"
            ));
        }
        if !(typical_distance > 0.0 && typical_distance.is_finite()) {
            return Err(format!("reject.typical_distance {typical_distance} instead of more than 0"));
        }
        if !(0.0..=1.0).contains(&least_probability) {
            return Err(format!("reject.least_probability {least_probability} instead of 0 to 1"));
        }
        for (key, value) in coefficients
            .map(|value| ("coefficients", value))
            .into_iter()
            .chain([("least_margin", least_margin)])
        {
            if !value.is_finite() {
                return Err(format!("reject.{key} {value} instead of a finite number"));
            }
        }
        Ok(RejectRule { is_learned, typical_distance, coefficients, least_probability, least_margin })
    }
}

/// Finds when answers of a recogniser about reference clouds are not to be believed, by the current rayon pool; without
/// settings the nearest cloud answers.
pub(super) fn calibrate(
    settings: Option<&Settings>,
    channels: &[(&Signatures, SetDistance, f64)],
    clouds: &[DatabaseCloud],
    false_rejections: f64,
) -> Reject {
    let (sequences, folds) = sequences(clouds);
    let calibration =
        answers(settings, channels, clouds, &sequences).and_then(|found| found.calibrate(false_rejections));
    Reject { false_rejections, calibration, folds }
}

/// What reference clouds make of each other.
pub(super) fn answers(
    settings: Option<&Settings>,
    channels: &[(&Signatures, SetDistance, f64)],
    clouds: &[DatabaseCloud],
    sequences: &[Option<u32>],
) -> Result<CrossAnswers, RejectError> {
    let objects: Vec<u32> = labels(clouds).iter().map(|label| label.instance).collect();
    CrossAnswers::new(settings, &LabelledClouds { channels, objects: &objects }, sequences)
}

/// The sequence of each cloud, numbers by value before names: as a data set has them. Clouds that were added and have
/// none of their own are of one sequence with the others of their addition.
pub(super) fn sequences(clouds: &[DatabaseCloud]) -> (Vec<Option<u32>>, FoldsBy) {
    let key = |cloud: &'_ DatabaseCloud| -> Option<(u8, u64, String)> {
        match (&cloud.sequence, cloud.addition) {
            (Some(name), _) => match name.parse() {
                Ok(number) => Some((0, number, name.clone())),
                Err(_) => Some((1, 0, name.clone())),
            },
            (None, Some(addition)) => Some((2, addition.into(), String::new())),
            (None, None) => None,
        }
    };
    let keys: Vec<_> = clouds.iter().map(key).collect();
    let mut numbers: BTreeMap<_, u32> = keys.iter().flatten().map(|key| (key, 0)).collect();
    numbers.values_mut().zip(0..).for_each(|(number, next)| *number = next);
    let by = if keys.iter().all(Option::is_some) && numbers.len() > 1 {
        let additions = numbers.keys().filter(|key| key.0 == 2).count();
        FoldsBy::Sequences { sequences: numbers.len(), additions }
    } else {
        FoldsBy::Positions
    };
    (keys.iter().map(|key| Some(numbers[key.as_ref()?])).collect(), by)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cloud(sequence: Option<&str>, addition: Option<u32>) -> DatabaseCloud {
        let [cloud, instance, category] = ["a.pcd", "mug_1", "mug"].map(str::to_owned);
        DatabaseCloud { cloud, instance, category, sequence: sequence.map(str::to_owned), addition }
    }

    #[test]
    fn sequences_are_numbered_by_value_and_additions_are_some_of_their_own() {
        let names = [Some("10"), Some("9"), Some("door"), Some("10")];
        let run: Vec<_> = names.map(|name| cloud(name, None)).to_vec();
        assert_eq!(
            sequences(&run),
            ([1, 0, 2, 1].map(Some).to_vec(), FoldsBy::Sequences { sequences: 3, additions: 0 })
        );
        let added = [cloud(None, Some(2)), cloud(None, Some(1)), cloud(Some("9"), Some(2))];
        let more: Vec<_> = run.iter().cloned().chain(added).collect();
        assert_eq!(
            sequences(&more),
            ([1, 0, 2, 1, 4, 3, 0].map(Some).to_vec(), FoldsBy::Sequences { sequences: 5, additions: 2 })
        );
        let unknown = [cloud(None, None), cloud(None, Some(1))];
        assert_eq!(sequences(&unknown), (vec![None, Some(0)], FoldsBy::Positions));
        let one = [cloud(Some("1"), None), cloud(Some("1"), None)];
        assert_eq!(sequences(&one).1, FoldsBy::Positions);
        assert_eq!(sequences(&[]), (Vec::new(), FoldsBy::Positions));
    }

    #[test]
    fn rules_are_read_as_they_were_written_and_others_are_refused() {
        let sound = RejectSettings {
            false_rejections: 0.05,
            typical_distance: 0.1,
            coefficients: [1.0 / 3.0, -2.5, 1e-7, 0.0],
            least_probability: 0.25,
            least_margin: 0.01,
        };
        let again: RejectSettings = toml::from_str(&toml::to_string(&sound).unwrap()).unwrap();
        assert_eq!(again, sound);
        let rule = sound.resolve(false).unwrap();
        assert_eq!((rule.coefficients, rule.least_margin), (sound.coefficients, 0.01));
        assert!(sound.resolve(true).unwrap().is_learned && !rule.is_learned);
        for (wrong, what) in [
            (RejectSettings { false_rejections: 0.7, ..sound }, "false_rejections 0.7"),
            (RejectSettings { false_rejections: f64::NAN, ..sound }, "false_rejections NaN"),
            (RejectSettings { typical_distance: 0.0, ..sound }, "typical_distance 0"),
            (RejectSettings { typical_distance: f64::INFINITY, ..sound }, "typical_distance inf"),
            (RejectSettings { least_probability: 1.5, ..sound }, "least_probability 1.5"),
            (RejectSettings { least_margin: f64::NAN, ..sound }, "least_margin NaN"),
            (RejectSettings { coefficients: [0.0, f64::INFINITY, 0.0, 0.0], ..sound }, "coefficients inf"),
        ] {
            let said = wrong.resolve(false).unwrap_err();
            assert!(said.contains(what), "{what}: {said}");
        }
    }
}
