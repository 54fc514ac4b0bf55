//! When an answer of an artefact is not believed: found by what its reference clouds make of each other.

use std::collections::BTreeMap;

use artefact::{DatabaseCloud, RejectSettings, labels};
use descriptor::recogniser::{Calibration, CrossAnswers, LabelledClouds, RejectError, Settings};
use descriptor::{SetDistance, Signatures};

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

impl Reject {
    /// The section of the artefact's settings; `None` if no rule was found.
    pub(super) fn settings(&self) -> Option<RejectSettings> {
        let rule = &self.calibration.as_ref().ok()?.rule;
        Some(RejectSettings::new(self.false_rejections, rule))
    }
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
}
