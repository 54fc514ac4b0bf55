//! How an artefact names objects where that is not by the nearest cloud: settings with which it learns again, bit for
//! bit, what its reference clouds teach.

use descriptor::recogniser::{
    KernelRidgeSettings, LabelledClouds, LearnedRecogniser, MAX_COMPONENTS, Method, ProjectionSettings,
    Reference, Settings,
};
use descriptor::{Label, SetDistance, Signatures};
use proto::Message;
use serde::{Deserialize, Serialize};

/// The largest width and ridge that mean anything.
const MOST: f64 = 1e6;

/// Section `[recognition]` of the settings; without it, the nearest cloud names objects.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "method", rename_all = "kebab-case", deny_unknown_fields)]
pub enum RecognitionSettings {
    Projection { components: u32, shrinkage: f64, reference: NearestTo },
    KernelRidge { width: f64, ridge: f64 },
}

/// What a projected cloud is compared with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum NearestTo {
    Cloud,
    Object,
}

impl RecognitionSettings {
    /// The settings; `Err` says which of them can be none.
    pub fn resolve(&self) -> Result<Settings, String> {
        let positive = |key: &str, value: f64| {
            let sound = Some(value).filter(|&value| value > 0.0 && value <= MOST);
            sound.ok_or_else(|| format!("recognition.{key} {value} instead of more than 0, at most {MOST}"))
        };
        match *self {
            Self::Projection { components, shrinkage, reference } => {
                let most = MAX_COMPONENTS as u32;
                if !(1..=most).contains(&components) {
                    return Err(format!("recognition.components {components} instead of 1 to {most}"));
                }
                if positive("shrinkage", shrinkage)? > 1.0 {
                    return Err(format!("recognition.shrinkage {shrinkage} instead of at most 1"));
                }
                let reference = match reference {
                    NearestTo::Cloud => Reference::Cloud,
                    NearestTo::Object => Reference::Object,
                };
                let components = components as usize;
                Ok(Settings::Projection(ProjectionSettings { components, shrinkage, reference }))
            }
            Self::KernelRidge { width, ridge } => {
                let [width, ridge] = [positive("width", width)?, positive("ridge", ridge)?];
                Ok(Settings::KernelRidge(KernelRidgeSettings { width, ridge }))
            }
        }
    }
}

impl From<Settings> for RecognitionSettings {
    fn from(settings: Settings) -> Self {
        match settings {
            Settings::Projection(ProjectionSettings { components, shrinkage, reference }) => {
                let reference = match reference {
                    Reference::Cloud => NearestTo::Cloud,
                    Reference::Object => NearestTo::Object,
                };
                Self::Projection { components: components as u32, shrinkage, reference }
            }
            Settings::KernelRidge(KernelRidgeSettings { width, ridge }) => Self::KernelRidge { width, ridge },
        }
    }
}

/// What is learned from reference clouds that show these labels, with their signatures in each channel, how these are
/// compared, and the weight of the channel; `Err` says why nothing is.
pub fn learn(
    settings: &Settings,
    channels: &[(&Signatures, SetDistance, f64)],
    labels: &[Label],
) -> Result<LearnedRecogniser, String> {
    let objects: Vec<u32> = labels.iter().map(|label| label.instance).collect();
    LearnedRecogniser::new(settings, &LabelledClouds { channels, objects: &objects })
        .map_err(|error| Message::of(&error).what)
}

/// How objects are named, in a line.
pub fn names_objects_by(settings: Option<&Settings>) -> String {
    match settings {
        Some(settings) => format!("{}: {settings}", settings.method().name()),
        None => Method::Nearest.name().to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_are_read_as_they_were_written_and_others_are_refused() {
        let all = ProjectionSettings::all().into_iter().map(Settings::Projection);
        for settings in all.chain(KernelRidgeSettings::ALL.map(Settings::KernelRidge)) {
            let written = toml::to_string(&RecognitionSettings::from(settings)).unwrap();
            assert!(written.contains(&format!("method = \"{}\"", settings.method().name())));
            let read: RecognitionSettings = toml::from_str(&written).unwrap();
            assert_eq!(read.resolve(), Ok(settings));
        }
        for (text, what) in [
            ("method = \"kernel-ridge\"\nwidth = 0.0\nridge = 0.1", "recognition.width 0"),
            ("method = \"kernel-ridge\"\nwidth = 1.0\nridge = nan", "recognition.ridge NaN"),
            ("method = \"kernel-ridge\"\nwidth = inf\nridge = 0.1", "recognition.width inf"),
            (
                "method = \"projection\"\ncomponents = 0\nshrinkage = 0.1\nreference = \"cloud\"",
                "components 0",
            ),
            (
                "method = \"projection\"\ncomponents = 301\nshrinkage = 0.1\nreference = \"cloud\"",
                "components 301",
            ),
            (
                "method = \"projection\"\ncomponents = 9\nshrinkage = 1.5\nreference = \"cloud\"",
                "shrinkage 1.5",
            ),
            (
                "method = \"projection\"\ncomponents = 9\nshrinkage = -1.0\nreference = \"cloud\"",
                "shrinkage -1",
            ),
        ] {
            let refused = toml::from_str::<RecognitionSettings>(text).unwrap().resolve().unwrap_err();
            assert!(refused.contains(what), "{refused}");
        }
        toml::from_str::<RecognitionSettings>("method = \"nearest\"").unwrap_err();
    }
}
