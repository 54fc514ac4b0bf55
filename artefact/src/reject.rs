//! Section `[reject]` of an artefact's settings: when an answer is not believed, because the object is unknown.

use descriptor::recogniser::RejectRule;
use serde::{Deserialize, Serialize};

/// Share of the answers about known objects that may be rejected where nothing else is said.
pub const FALSE_REJECTIONS: f64 = 0.05;
/// Most of that share.
pub const MOST_FALSE_REJECTIONS: f64 = 0.5;

/// The section; without it every answer is believed.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RejectSettings {
    /// Share of the reference clouds whose answer may be rejected.
    pub false_rejections: f64,
    /// What set distances to the nearest cloud are divided by.
    typical_distance: f64,
    /// Of 1, the distance, the margin and, of a recogniser that learns, the set distance to the nearest cloud.
    coefficients: [f64; 4],
    least_probability: f64,
    least_margin: f64,
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
    /// Of a rule that rejects this share of the reference clouds.
    pub fn new(false_rejections: f64, rule: &RejectRule) -> Self {
        let RejectRule { typical_distance, coefficients, least_probability, least_margin, .. } = *rule;
        Self { false_rejections, typical_distance, coefficients, least_probability, least_margin }
    }

    /// The rule of a recogniser that learns, or of the nearest cloud; `Err` says which value can be none.
    pub fn resolve(&self, is_learned: bool) -> Result<RejectRule, String> {
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

#[cfg(test)]
mod tests {
    use super::*;

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
