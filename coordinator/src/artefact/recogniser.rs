//! An artefact at work: from the bytes of a cloud to the name of an object, on the calling thread.

use proto::Message;
use std::collections::BTreeMap;
use std::path::Path;
use std::time::Instant;

use descriptor::recogniser::LearnedRecogniser;
use descriptor::{
    Database, DescribeError, Described, Describer, Descriptor, Family, Label, PrepareError, Preprocess,
    SetDistance, Signatures, Unit, pcd, recogniser,
};
use results::{DatabaseCloud, DatabasePart, DatabaseParts};

use super::error::CloudError;
use super::settings::Settings;
use super::{ArtefactError, DATABASE, SETTINGS, recognition, scales};
use crate::evaluate::{Seconds, stages};

/// A descriptor with its reference clouds. Answers start no thread; opening an artefact that learns from its clouds uses
/// the current rayon pool.
pub struct Recogniser {
    preprocess: Preprocess,
    describer: Describer,
    database: Database,
    /// `None` by the nearest cloud.
    learned: Option<LearnedRecogniser>,
    clouds: Vec<DatabaseCloud>,
}

/// An object by the reference cloud that is nearest, or most like the query.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Named<'a> {
    /// The object.
    pub instance: &'a str,
    /// Its category.
    pub category: &'a str,
    /// The reference cloud.
    pub cloud: &'a str,
    /// Set distance to it; of a recogniser that learns, 1 less the score of the object.
    pub distance: f64,
}

/// What one cloud was recognised as.
#[derive(Clone, Debug, PartialEq)]
pub struct Answer<'a> {
    /// The nearest objects, nearest first; at least one.
    pub ranking: Vec<Named<'a>>,
}

impl<'a> Answer<'a> {
    /// What it is.
    pub fn nearest(&self) -> Named<'a> {
        self.ranking[0]
    }

    /// What else it might be; `None` if the database shows one object only.
    pub fn runner_up(&self) -> Option<Named<'a>> {
        self.ranking.get(1).copied()
    }

    /// How much farther the runner-up is.
    pub fn margin(&self) -> Option<f64> {
        self.runner_up().map(|other| other.distance - self.nearest().distance)
    }
}

impl Recogniser {
    /// Opens an artefact and checks all of it that recognition needs.
    ///
    /// # Errors
    /// [`ArtefactError`] if files are missing, damaged, of another version or do not fit together.
    pub fn open(folder: &Path) -> Result<Self, ArtefactError> {
        let settings = Settings::read(folder)?;
        let (preprocess, descriptor) = settings.resolve(folder)?;
        let path = folder.join(DATABASE);
        let (database, digest) = results::read_database(&path)?;
        let (expected, got) = (&settings.database.digest, digest.to_hex());
        if expected.as_str() != got.as_str() {
            let (expected, got) = (crate::experiment::shortened(expected, 64), got.to_string());
            return Err(ArtefactError::Digest { path, expected, got });
        }
        let (expected, got) = (settings.database.clouds as usize, database.clouds.len());
        if expected != got {
            let what = format!("database.clouds {expected} where the database has {got}");
            return Err(ArtefactError::Settings { path: folder.join(SETTINGS), what });
        }
        let refused = |what: String| ArtefactError::Database { what: format!("{}: {what}", path.display()) };
        // They go to terminals.
        let texts = database.clouds.iter().flat_map(|row| [&row.cloud, &row.instance, &row.category]);
        if let Some(text) = texts.into_iter().find(|text| text.chars().any(char::is_control)) {
            return Err(refused(format!(
                "names must have no control characters, got {}",
                text.escape_debug()
            )));
        }
        let recognition = settings.recognition(folder)?;
        let scales = settings.database.scales.as_deref();
        Self::new(preprocess, &descriptor, (scales, recognition.as_ref()), database).map_err(refused)
    }

    /// From what an artefact holds; `Err` says why that does not fit together. The descriptor can have the scales; with
    /// settings it learns.
    pub(super) fn new(
        preprocess: Preprocess,
        descriptor: &Descriptor,
        (scales, recognition): (Option<&[f64]>, Option<&recogniser::Settings>),
        database: results::Database,
    ) -> Result<Self, String> {
        let describer = Describer::new(descriptor).map_err(|error| Message::of(&error).what)?;
        let signatures = signatures(descriptor, &database)?;
        let channels = channels(descriptor, scales, &signatures);
        let clouds = database.clouds;
        let labels = labels(&clouds);
        let learned =
            recognition.map(|settings| recognition::learn(settings, &channels, &labels)).transpose()?;
        let database = Database::new(&channels, labels).map_err(|error| Message::of(&error).what)?;
        Ok(Self { preprocess, describer, database, learned, clouds })
    }

    /// The artefact's description of a cloud, given as the bytes of a PCD file; `seconds` takes the time of each stage.
    pub(super) fn describe(&self, bytes: &[u8], seconds: &mut Seconds) -> Result<Described, CloudError> {
        let clock = Instant::now();
        let cloud = pcd::read(bytes)?;
        let cloud = self.preprocess.in_metres(&cloud);
        seconds.read += clock.elapsed();
        stages(&cloud, &self.preprocess, &self.describer, seconds).map_err(|error| match error {
            DescribeError::Prepare(PrepareError::Skip(skip)) => {
                CloudError::Skip(skip, unit_name(self.preprocess.unit))
            }
            other => CloudError::Describe(other),
        })
    }

    /// The nearest `most` objects, at least one, to a cloud that was described.
    pub(super) fn answer(&self, described: &Described, most: usize) -> Answer<'_> {
        let (query, most) = (&described.signatures, most.max(1));
        let hits = match &self.learned {
            Some(learned) => {
                let mut ranking = learned.ranking(query, || self.database.distances(query));
                ranking.truncate(most);
                ranking
            }
            None => self.database.ranking(query, most),
        };
        let named = |hit: descriptor::recognise::Hit| {
            let DatabaseCloud { cloud, instance, category } = &self.clouds[hit.index as usize];
            Named { instance, category, cloud, distance: hit.distance }
        };
        Answer { ranking: hits.into_iter().map(named).collect() }
    }

    /// The nearest `most` objects, at least one, to a cloud, given as the bytes of a PCD file; `seconds` takes the time
    /// of each stage.
    ///
    /// # Errors
    /// [`CloudError`] if the bytes are no cloud, or too little of one to be described.
    pub fn recognise(
        &self,
        bytes: &[u8],
        most: usize,
        seconds: &mut Seconds,
    ) -> Result<Answer<'_>, CloudError> {
        let described = self.describe(bytes, seconds)?;
        let clock = Instant::now();
        let answer = self.answer(&described, most);
        seconds.matching += clock.elapsed();
        Ok(answer)
    }
}

/// The signatures of the reference clouds in each channel, how they are compared, and the channel's weight over its
/// scale.
pub(super) fn channels<'a>(
    descriptor: &Descriptor,
    scales: Option<&[f64]>,
    signatures: &'a [Signatures],
) -> Vec<(&'a Signatures, SetDistance, f64)> {
    let metrics = descriptor.channels().into_iter().map(|(channel, _)| channel.metric());
    let channels = signatures.iter().zip(metrics).zip(scales::weights(descriptor, scales));
    channels.map(|((signatures, metric), weight)| (signatures, metric, weight)).collect()
}

/// The signatures of the reference clouds in each channel; `Err` says why they are not the descriptor's.
pub(super) fn signatures(
    descriptor: &Descriptor,
    database: &results::Database,
) -> Result<Vec<Signatures>, String> {
    let results::Database { clouds, parts } = database;
    let parts: &[DatabasePart] = match (descriptor.family(), parts) {
        (Family::DiskRing, DatabaseParts::ShapeColour(parts)) => parts,
        (Family::Structure, DatabaseParts::Channels(channels)) => channels,
        (family, _) => return Err(format!("columns must be those of family {family}, got others")),
    };
    let columns: Vec<_> =
        parts.iter().map(|part| [part.centroids.as_slice(), part.deviations.as_slice()]).collect();
    let count = u32::try_from(clouds.len()).map_err(|_| format!("too many clouds, got {}", clouds.len()))?;
    descriptor.signatures_of_columns(&columns, count).map_err(|error| Message::of(&error).what)
}

/// A unit's name, as in settings.
fn unit_name(unit: Unit) -> &'static str {
    match unit {
        Unit::Metre => "m",
        Unit::Millimetre => "mm",
    }
}

/// What the clouds show, by numbers.
pub(super) fn labels(clouds: &[DatabaseCloud]) -> Vec<Label> {
    let mut categories: BTreeMap<&str, u32> = BTreeMap::new();
    let mut instances: BTreeMap<(&str, &str), u32> = BTreeMap::new();
    let mut labels = Vec::with_capacity(clouds.len());
    for DatabaseCloud { instance, category, .. } in clouds {
        let (next_category, next_instance) = (categories.len() as u32, instances.len() as u32);
        let category_number = *categories.entry(category).or_insert(next_category);
        let instance = *instances.entry((category, instance)).or_insert(next_instance);
        labels.push(Label { category: category_number, instance });
    }
    labels
}
