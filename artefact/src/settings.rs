//! `descriptor.toml`: what an artefact says of its descriptor and of its other files.

use std::path::{Path, PathBuf};

use descriptor::recogniser::{self, RejectRule};
use descriptor::{Descriptor, Family, Preprocess, SetDistance, Unit};
use serde::{Deserialize, Serialize};

use crate::error::ArtefactError;
use crate::recognition::RecognitionSettings;
use crate::reject::RejectSettings;
use crate::sections::{RawDescriptor, RawPreprocess, of_one, one};
use crate::text::{read_bounded, shortened};
use crate::{SETTINGS, scales};

/// The newest version of the format. Section `[reject]` needs it; without the section the version is 1, which earlier
/// programs read as well.
const VERSION: u32 = 2;

/// The file. Lengths are centimetres, as in experiments.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    pub version: u32,
    /// BLAKE3 of everything else that the file says: [`Settings::digest`]. A parameter that was changed is none that the
    /// database was made with.
    pub digest: String,
    /// Of the experiment.
    pub name: String,
    pub evaluation_version: u32,
    pub run_digest: String,
    pub data_digest: String,
    /// How the centroids, and the deviations, of two clouds are compared; of a structure, where a channel has no metric.
    pub set_distance: String,
    /// Of the coordinates in clouds.
    pub unit: Unit,
    pub preprocess: RawPreprocess,
    pub descriptor: RawDescriptor,
    /// How objects are named; without it by the nearest cloud.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub recognition: Option<RecognitionSettings>,
    /// When an answer is not believed; without it every answer is.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reject: Option<RejectSettings>,
    pub database: DatabaseSettings,
    pub test_vector: TestVectorSettings,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DatabaseSettings {
    pub clouds: u32,
    /// BLAKE3 of the file.
    pub digest: String,
    /// Of a structure: what the distances of each channel are divided by.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scales: Option<Vec<f64>>,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TestVectorSettings {
    /// BLAKE3 of the file.
    pub digest: String,
}

impl Settings {
    /// Reads the file of an artefact; what it says is meant for this program.
    pub fn read(folder: &Path) -> Result<Self, ArtefactError> {
        let path = folder.join(SETTINGS);
        let text =
            read_bounded(&path).map_err(|source| ArtefactError::Read { path: path.clone(), source })?;
        Self::parse(&text, path)
    }

    /// Reads the text of the file at `path`, which need not be there.
    pub fn parse(text: &str, path: PathBuf) -> Result<Self, ArtefactError> {
        let wrong = |error: toml::de::Error| ArtefactError::Settings {
            path: path.clone(),
            what: shortened(error.message(), 400),
        };
        let table: toml::Table = toml::from_str(text).map_err(wrong)?;
        // Before all other keys: another version will have other keys.
        let version = table.get("version");
        let got = version.map_or_else(|| "none".to_owned(), |version| shortened(&version.to_string(), 40));
        let number = version.and_then(toml::Value::as_integer);
        if !number.is_some_and(|number| (1..=i64::from(VERSION)).contains(&number)) {
            return Err(ArtefactError::Version { path, expected: format!("1 or {VERSION}"), got });
        }
        let settings: Self = table.try_into().map_err(wrong)?;
        if settings.version != settings.least_version() {
            let expected = settings.least_version().to_string();
            return Err(ArtefactError::Version { path, expected, got });
        }
        let (expected, got) = (descriptor::EVALUATION_VERSION, settings.evaluation_version);
        if expected != got {
            return Err(ArtefactError::EvaluationVersion { path, expected, got });
        }
        let got = settings.digest().map_err(|error| ArtefactError::Settings {
            path: path.clone(),
            what: shortened(&error.to_string(), 400),
        })?;
        if settings.digest != got {
            let expected = shortened(&settings.digest, 64);
            return Err(ArtefactError::Digest { path, expected, got });
        }
        if settings.set_distance != SetDistance::ChiSquared.name() {
            let got = shortened(&settings.set_distance, 40);
            let what = format!("set_distance {got:?} instead of {:?}", SetDistance::ChiSquared.name());
            return Err(ArtefactError::Settings { path, what });
        }
        Ok(settings)
    }

    /// What is done to a cloud, and by which descriptor, which can have the scales.
    pub fn resolve(&self, folder: &Path) -> Result<(Preprocess, Descriptor), ArtefactError> {
        let path = folder.join(SETTINGS);
        let (preprocess, descriptor) = one(&self.preprocess, self.unit, &self.descriptor, &path)?;
        scales::check(&descriptor, self.database.scales.as_deref())
            .map_err(|what| ArtefactError::Settings { path, what })?;
        Ok((preprocess, descriptor))
    }

    /// The settings of a recogniser that learns; `None` where the nearest cloud names objects.
    pub fn recognition(&self, folder: &Path) -> Result<Option<recogniser::Settings>, ArtefactError> {
        let resolved = self.recognition.map(|settings| settings.resolve()).transpose();
        resolved.map_err(|what| ArtefactError::Settings { path: folder.join(SETTINGS), what })
    }

    /// The rule by which answers are rejected; `None` where each is believed.
    pub fn reject(&self, folder: &Path) -> Result<Option<RejectRule>, ArtefactError> {
        let is_learned = self.recognition.is_some();
        let resolved = self.reject.map(|settings| settings.resolve(is_learned)).transpose();
        resolved.map_err(|what| ArtefactError::Settings { path: folder.join(SETTINGS), what })
    }

    /// The oldest version of the format that has all sections.
    fn least_version(&self) -> u32 {
        if self.reject.is_some() { VERSION } else { 1 }
    }

    /// Settings of no artefact, for tests and fuzzing.
    pub fn sample(preprocess: &Preprocess, descriptor: &Descriptor) -> Self {
        let sections = of_one(preprocess, descriptor);
        let (raw, sections) = sections.expect("a descriptor that experiments can ask for");
        let scale = |scaled: Option<Descriptor>| scaled.map_or(1.0, |_| 0.125);
        let scales = descriptor.scaled_channels().into_iter().map(scale).collect();
        Self {
            version: 1,
            digest: String::new(),
            name: "sample".to_owned(),
            evaluation_version: descriptor::EVALUATION_VERSION,
            run_digest: "ab".repeat(32),
            data_digest: "cd".repeat(32),
            set_distance: SetDistance::ChiSquared.name().to_owned(),
            unit: preprocess.unit,
            preprocess: raw,
            descriptor: sections,
            recognition: None,
            reject: None,
            database: DatabaseSettings {
                clouds: 943,
                digest: "ef".repeat(32),
                scales: (descriptor.family() == Family::Structure).then_some(scales),
            },
            test_vector: TestVectorSettings { digest: "01".repeat(32) },
        }
    }

    /// BLAKE3 of the file's text without version and digest, hexadecimal.
    fn digest(&self) -> Result<String, toml::ser::Error> {
        let mut table = toml::Table::try_from(self)?;
        for key in ["version", "digest"] {
            table.remove(key);
        }
        Ok(blake3::hash(toml::to_string(&table)?.as_bytes()).to_hex().to_string())
    }

    /// The file's text, with its digest.
    pub fn seal(mut self) -> Result<String, toml::ser::Error> {
        self.version = self.least_version();
        self.digest = self.digest()?;
        toml::to_string(&self)
    }
}

#[cfg(test)]
mod tests {
    use descriptor::Parameters;
    use expect_test::expect;

    use super::*;

    fn paper() -> Descriptor {
        Descriptor::default_of(Family::DiskRing)
    }

    fn parse(text: &str) -> Result<Settings, ArtefactError> {
        Settings::parse(text, "folder/descriptor.toml".into())
    }

    #[test]
    fn what_is_written_is_read_again() {
        let colourless = Descriptor::DiskRing(Parameters {
            colour_bins: 0,
            shape_weight_ppm: 1_000_000,
            ..Parameters::PAPER_BEST
        });
        let millimetres =
            Preprocess { leaf_um: 15_000, unit: Unit::Millimetre, colour: false, ..Preprocess::default() };
        let hue = Descriptor::default_of(Family::GlobalHue);
        let structure = Descriptor::default_of(Family::Structure);
        let plain = Preprocess::default();
        for (preprocess, descriptor) in
            [(plain, paper()), (millimetres, colourless), (plain, hue), (plain, structure)]
        {
            let text = Settings::sample(&preprocess, &descriptor).seal().unwrap();
            let read = parse(&text).unwrap();
            assert_eq!(read.resolve("folder".as_ref()).unwrap(), (preprocess, descriptor));
            assert_eq!(read.seal().unwrap(), text);
        }
        let text = Settings::sample(&Preprocess::default(), &paper()).seal().unwrap();
        expect![[r#"
            version = 1
            digest = "8b7ebed4b395d92c47c45ce4c09b9eb0619e1c84da97946c523a58de395e0236"
            name = "sample"
            evaluation_version = 2
            run_digest = "abababababababababababababababababababababababababababababababab"
            data_digest = "cdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcdcd"
            set_distance = "chi2"
            unit = "m"

            [preprocess]
            leaf_cm = 2.0
            normal_radius_cm = 1.0
            min_points = 10

            [descriptor]
            colour = true

            [descriptor.genes]
            shape_bins = 60
            m = 8
            R1 = 1.3
            R2 = 3.6
            w = 0.67

            [database]
            clouds = 943
            digest = "efefefefefefefefefefefefefefefefefefefefefefefefefefefefefefefef"

            [test_vector]
            digest = "0101010101010101010101010101010101010101010101010101010101010101"
        "#]]
        .assert_eq(&text);
    }

    #[test]
    fn scales_are_read_bit_for_bit() {
        let mut settings =
            Settings::sample(&Preprocess::default(), &Descriptor::default_of(Family::Structure));
        let scales: Vec<f64> = [0.1, 1.0, f32::MIN_POSITIVE, f32::from_bits(1), f32::MAX, 1.0 / 3.0]
            .map(f64::from)
            .into_iter()
            .chain([0.1, 1.0 / 3.0])
            .collect();
        settings.database.scales = Some(scales.clone());
        assert_eq!(parse(&settings.seal().unwrap()).unwrap().database.scales, Some(scales));
    }

    #[test]
    fn every_value_is_covered_by_the_digest() {
        let text = Settings::sample(&Preprocess::default(), &paper()).seal().unwrap();
        for (from, to) in [
            ("sample", "simple"),
            ("abab", "abac"),
            ("cdcd", "cdce"),
            ("unit = \"m\"", "unit = \"mm\""),
            ("leaf_cm = 2.0", "leaf_cm = 2.1"),
            ("normal_radius_cm = 1.0", "normal_radius_cm = 1.1"),
            ("min_points = 10", "min_points = 11"),
            ("colour = true", "colour = false"),
            ("shape_bins = 60", "shape_bins = 59"),
            ("m = 8", "m = 7"),
            ("R1 = 1.3", "R1 = 1.4"),
            ("R2 = 3.6", "R2 = 3.7"),
            ("w = 0.67", "w = 0.68"),
            ("clouds = 943", "clouds = 942"),
            ("efef", "efee"),
            ("0101", "0102"),
            ("\ndigest = \"", "\ndigest = \"0"),
        ] {
            is_covered(&text, from, to);
        }
        let structure = Descriptor::default_of(Family::Structure);
        let text = Settings::sample(&Preprocess::default(), &structure).seal().unwrap();
        for (from, to) in [
            ("\"o1 8\"", "\"o1 7\""),
            ("radius_cm = 3", "radius_cm = 4"),
            ("weight = 1", "weight = 2"),
            ("scales = [0.125", "scales = [0.25"),
        ] {
            is_covered(&text, from, to);
        }
    }

    #[track_caller]
    fn is_covered(text: &str, from: &str, to: &str) {
        assert!(text.contains(from), "{from}");
        let error = parse(&text.replacen(from, to, 1)).unwrap_err();
        assert!(matches!(error, ArtefactError::Digest { .. }), "{to}: {error}");
    }

    #[test]
    fn settings_that_are_not_ours_are_refused_with_their_place() {
        let text = Settings::sample(&Preprocess::default(), &paper()).seal().unwrap();
        for (from, to, complaint) in [
            ("version = 1", "version = 2", "version must be 1, got 2"),
            ("version = 1", "version = 3", "version must be 1 or 2, got 3"),
            ("version = 1", "version = \"1\"", "version must be 1 or 2, got \"1\""),
            ("version = 1\n", "", "version must be 1 or 2, got none"),
            ("evaluation_version = 2", "evaluation_version = 1", "evaluation_version must be 2, got 1"),
            ("unit = \"m\"", "unit = \"km\"", "unknown variant `km`"),
            ("unit = \"m\"", "units = \"m\"", "unknown field `units`"),
            ("clouds = 943", "clouds = -1", "must be the settings of an artefact"),
            ("[database]", "[database", "must be the settings of an artefact"),
        ] {
            assert!(text.contains(from), "{from}");
            let error = parse(&text.replacen(from, to, 1)).unwrap_err().to_string();
            assert!(error.starts_with("folder/descriptor.toml: "), "{error}");
            assert!(error.contains(complaint) && error.lines().count() == 2, "{to}: {error}");
        }
    }

    /// Whoever forges the digest, too, meets the checks of experiments.
    #[test]
    fn settings_that_mean_nothing_are_refused() {
        let text = Settings::sample(&Preprocess::default(), &paper()).seal().unwrap();
        let forged = |from: &str, to: &str| {
            assert!(text.contains(from), "{from}");
            let table: toml::Table = toml::from_str(&text.replacen(from, to, 1)).unwrap();
            parse(&table.try_into::<Settings>().unwrap().seal().unwrap())
        };
        for (from, to, complaint) in [
            ("shape_bins = 60\n", "", "descriptor.genes.shape_bins: must have one value, got 57"),
            ("R1 = 1.3", "R1 = 9.9", "R2: every value must be larger than every value of R1"),
            ("R1 = 1.3", "R1 = nan", "descriptor.genes.R1: "),
            ("m = 8", "m = 1000", "descriptor.genes.m: "),
            ("leaf_cm = 2.0", "leaf_cm = 0.0", "preprocess.leaf_cm: "),
        ] {
            let error = forged(from, to).unwrap().resolve("folder".as_ref()).unwrap_err().to_string();
            assert!(error.contains(complaint) && error.lines().count() == 2, "{to}: {error}");
        }
        let error = forged("\"chi2\"", "\"l1\"").unwrap_err().to_string();
        assert!(error.contains("set_distance \"l1\" instead of \"chi2\""), "{error}");
    }

    #[test]
    fn structures_that_mean_nothing_are_refused() {
        let structure = Descriptor::default_of(Family::Structure);
        let sound: toml::Table =
            toml::Table::try_from(Settings::sample(&Preprocess::default(), &structure)).unwrap();
        let refused = |section: &str, change: &dyn Fn(&mut toml::Table)| {
            let mut table = sound.clone();
            change(table[section].as_table_mut().unwrap());
            let settings = parse(&table.try_into::<Settings>().unwrap().seal().unwrap()).unwrap();
            let error = settings.resolve("folder".as_ref()).unwrap_err().to_string();
            assert!(error.starts_with("folder/descriptor.toml: "), "{error}");
            assert_eq!(error.lines().count(), 2, "{error}");
            error
        };
        let channels = |change: &dyn Fn(&mut Vec<toml::Value>)| {
            refused("descriptor", &|table| change(table["channel"].as_array_mut().unwrap()))
        };
        let first = |key: &'static str, value: toml::Value| {
            channels(&|channels| drop(channels[0].as_table_mut().unwrap().insert(key.into(), value.clone())))
        };
        for (said, complaint) in [
            (channels(&|channels| channels.clear()), "descriptor.channel: there must be 1 to 8, got 0"),
            (
                channels(&|channels| channels.resize(9, channels[0].clone())),
                "descriptor.channel: there must be 1 to 8, got 9",
            ),
            (first("pairs", "neighbour".into()), "descriptor.channel 1: pairs: one of "),
            (first("radius_cm", f64::NAN.into()), "radius_cm: must be 0.0001 to 100, got NaN"),
            (first("weight", 0.into()), "weight: must be 0.000001 to 1000, got 0"),
            (
                refused("descriptor", &|table| drop(table.insert("slots".into(), 4.into()))),
                "descriptor.slots: no use beside channels",
            ),
            (
                refused("preprocess", &|table| drop(table.insert("leaf_cm".into(), 2.0.into()))),
                "preprocess.leaf_cm: not for family structure",
            ),
        ] {
            assert!(said.contains(complaint), "{complaint}: {said}");
        }
    }
}
