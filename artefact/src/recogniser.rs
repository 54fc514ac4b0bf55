//! An artefact at work: from the bytes of a cloud to the name of an object, on the calling thread.

use std::path::Path;
use std::time::Instant;

use descriptor::recogniser::{Evidence, LearnedRecogniser, RejectRule};
use descriptor::spacing::check_unit;
use descriptor::{
    Cloud, DescribeError, Described, Describer, Descriptor, PrepareError, Preprocess, Signature, Signatures,
    cloud_file, recogniser,
};
use proto::Message;

use crate::database::{Database, DatabaseCloud};
use crate::database_file::decode_database;
use crate::error::{ArtefactError, CloudError};
use crate::reference::{channels, labels, signatures};
use crate::settings::Settings;
use crate::stages::{Seconds, stages};
use crate::{DATABASE, SETTINGS, database_file, recognition};

/// A descriptor with its reference clouds. Answers start no thread; opening an artefact that learns from its clouds uses
/// the current rayon pool.
pub struct Recogniser {
    preprocess: Preprocess,
    describer: Describer,
    database: descriptor::Database,
    /// `None` by the nearest cloud.
    learned: Option<LearnedRecogniser>,
    /// `None` where every answer is believed.
    reject: Option<RejectRule>,
    clouds: Vec<DatabaseCloud>,
}

/// What a recogniser takes from its settings beside the descriptor.
#[derive(Clone, Copy)]
pub struct Learned<'a> {
    /// Of a structure's channels.
    pub scales: Option<&'a [f64]>,
    /// Of a recogniser that learns.
    pub recognition: Option<&'a recogniser::Settings>,
    /// When an answer is not believed.
    pub reject: Option<RejectRule>,
}

/// What the files of an artefact say.
pub struct Contents {
    pub settings: Settings,
    pub preprocess: Preprocess,
    pub descriptor: Descriptor,
    /// `None` by the nearest cloud.
    pub recognition: Option<recogniser::Settings>,
    pub reject: Option<RejectRule>,
    pub database: Database,
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
    /// What the answer is judged by; `None` of databases of one object.
    pub evidence: Option<Evidence>,
    /// Whether the object is one of the database at all; `None` of artefacts without a rule, and of databases of one object.
    pub known: Option<Known>,
}

/// Whether an object is one that the database shows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Known {
    /// How probable that is, if it is so of half of what is asked.
    pub probability: f64,
    /// Whether that is enough.
    pub is_accepted: bool,
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

    /// Whether it is an object that the database does not show.
    pub fn is_unknown(&self) -> bool {
        self.known.is_some_and(|known| !known.is_accepted)
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
        Contents::read(folder)?.recogniser(folder)
    }

    /// From what an artefact holds; `Err` says why that does not fit together. The descriptor can have the scales.
    pub fn new(
        preprocess: Preprocess,
        descriptor: &Descriptor,
        Learned { scales, recognition, reject }: Learned<'_>,
        database: Database,
    ) -> Result<Self, String> {
        let describer = Describer::new(descriptor).map_err(|error| Message::of(&error).what)?;
        let signatures = signatures(descriptor, &database)?;
        let channels = channels(descriptor, scales, &signatures);
        let clouds = database.clouds;
        let labels = labels(&clouds);
        let learned =
            recognition.map(|settings| recognition::learn(settings, &channels, &labels)).transpose()?;
        let database =
            descriptor::Database::new(&channels, labels).map_err(|error| Message::of(&error).what)?;
        Ok(Self { preprocess, describer, database, learned, reject, clouds })
    }

    /// Values that are kept of a cloud, if they are others than its signature.
    pub fn size(&self) -> Option<usize> {
        self.learned.as_ref()?.size()
    }

    /// How many values a signature has: of centroid and deviation, channel by channel.
    pub fn lengths(&self) -> impl Iterator<Item = [usize; 2]> {
        self.database.lengths()
    }

    /// The artefact's description of a cloud, given as the bytes of its file; `seconds` takes the time of each stage.
    ///
    /// # Errors
    /// [`CloudError`] if the bytes are no cloud, or too little of one to be described.
    pub fn describe(&self, bytes: &[u8], seconds: &mut Seconds) -> Result<Described, CloudError> {
        let clock = Instant::now();
        let cloud = cloud_file::read(bytes)?;
        seconds.read += clock.elapsed();
        self.describe_cloud(&cloud, seconds)
    }

    /// The artefact's description of a cloud in the artefact's unit; `seconds` takes the time of each stage.
    ///
    /// # Errors
    /// [`CloudError`] if it is in another unit, or there is too little of it to be described.
    pub fn describe_cloud(&self, cloud: &Cloud, seconds: &mut Seconds) -> Result<Described, CloudError> {
        let clock = Instant::now();
        let cloud = self.preprocess.in_metres(cloud);
        check_unit(&cloud, &self.preprocess).map_err(|wrong| CloudError::Unit { wrong })?;
        seconds.read += clock.elapsed();
        stages(&cloud, &self.preprocess, &self.describer, seconds).map_err(|error| match error {
            DescribeError::Prepare(PrepareError::Skip(skip)) => CloudError::Skip(skip, self.preprocess.unit),
            other => CloudError::Describe(other),
        })
    }

    /// The nearest `most` objects, at least one, to a cloud that was described.
    pub fn answer(&self, described: &Described, most: usize) -> Answer<'_> {
        self.answer_to(&described.signatures, most)
    }

    /// As [`Recogniser::answer`], from the signatures of a cloud.
    pub fn answer_to(&self, query: &[Signature], most: usize) -> Answer<'_> {
        let (mut hits, nearest) = match &self.learned {
            Some(learned) => {
                let distances = self.database.distances(query);
                let nearest = distances.iter().copied().fold(f64::INFINITY, f64::min);
                (learned.ranking(query, || distances), nearest)
            }
            None => {
                let hits = self.database.ranking(query, most.max(2));
                let nearest = hits[0].distance;
                (hits, nearest)
            }
        };
        let evidence = hits.get(1).map(|&next| Evidence::of(hits[0], next, nearest));
        let known = self.reject.zip(evidence).map(|(rule, evidence)| Known {
            probability: rule.probability(evidence),
            is_accepted: rule.accepts(evidence),
        });
        hits.truncate(most.max(1));
        let named = |hit: descriptor::recognise::Hit| {
            let DatabaseCloud { cloud, instance, category, .. } = &self.clouds[hit.index as usize];
            Named { instance, category, cloud, distance: hit.distance }
        };
        Answer { ranking: hits.into_iter().map(named).collect(), evidence, known }
    }

    /// The nearest `most` objects, at least one, to a cloud, given as the bytes of its file; `seconds` takes the time
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

impl Contents {
    /// Reads an artefact and checks that its files are those that belong together.
    pub fn read(folder: &Path) -> Result<Self, ArtefactError> {
        let settings = Settings::read(folder)?;
        let (preprocess, descriptor) = settings.resolve(folder)?;
        let path = folder.join(DATABASE);
        let bytes = database_file::read(&path)?;
        // Before it is decoded: a few bytes can claim gigabytes.
        let (expected, got) = (&settings.database.digest, blake3::hash(&bytes).to_hex());
        if expected.as_str() != got.as_str() {
            let (expected, got) = (crate::text::shortened(expected, 64), got.to_string());
            return Err(ArtefactError::Digest { path, expected, got });
        }
        let database = decode_database(bytes, &path)?;
        let (expected, got) = (settings.database.clouds as usize, database.clouds.len());
        if expected != got {
            let what = format!("database.clouds {expected} where the database has {got}");
            return Err(ArtefactError::Settings { path: folder.join(SETTINGS), what });
        }
        // They go to terminals.
        let texts = database
            .clouds
            .iter()
            .flat_map(|row| [&row.cloud, &row.instance, &row.category].into_iter().chain(&row.sequence));
        if let Some(text) = texts.into_iter().find(|text| text.chars().any(char::is_control)) {
            let text = text.escape_debug();
            return Err(damaged(folder, format!("names must have no control characters, got {text}")));
        }
        let (recognition, reject) = (settings.recognition(folder)?, settings.reject(folder)?);
        Ok(Self { settings, preprocess, descriptor, recognition, reject, database })
    }

    /// What answers from it, read from this folder.
    pub fn recogniser(self, folder: &Path) -> Result<Recogniser, ArtefactError> {
        let Self { settings, preprocess, descriptor, recognition, reject, database } = self;
        let scales = settings.database.scales.as_deref();
        let learned = Learned { scales, recognition: recognition.as_ref(), reject };
        Recogniser::new(preprocess, &descriptor, learned, database).map_err(|what| damaged(folder, what))
    }

    /// The signatures of the reference clouds in each channel, read from this folder.
    pub fn signatures(&self, folder: &Path) -> Result<Vec<Signatures>, ArtefactError> {
        signatures(&self.descriptor, &self.database).map_err(|what| damaged(folder, what))
    }
}

fn damaged(folder: &Path, what: String) -> ArtefactError {
    ArtefactError::Database { what: format!("{}: {what}", folder.join(DATABASE).display()) }
}
