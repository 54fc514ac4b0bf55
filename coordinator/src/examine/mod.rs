//! Single clouds of a run under one descriptor: which clouds are near, and how much each channel adds to the distance.

mod error;
mod points;
mod reach;
#[cfg(test)]
mod tests;

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

use descriptor::{
    ChannelLayout, Cloud, Describer, Descriptor, Preprocess, SetDistance, Signature, Signatures, cloud_file,
};
use rayon::prelude::*;
use results::SeenCloud;
use serde::Serialize;

use crate::dataset::record::CloudRecord;
use crate::dataset::{SPLITS, cloud_bytes};
use crate::evaluate::{Seconds, stages};
use crate::experiment::Experiment;
use crate::lock::lock;
use crate::run::clouds::listed;
pub use error::ExamineError;
pub use points::DecimatedCloud;
use reach::reach;

/// Descriptors whose signatures are kept.
const KEPT: usize = 8;

/// The clouds of a run, read and described one by one as they are asked for.
pub struct Examiner {
    root: PathBuf,
    preprocess: Preprocess,
    clouds: Vec<CloudRecord>,
    by_path: HashMap<String, usize>,
    /// Last used last.
    described: Mutex<Vec<(Descriptor, Arc<DescribedBy>)>>,
}

/// What one descriptor says of clouds.
struct DescribedBy {
    describer: Describer,
    /// By place; `None`: the cloud takes no part.
    signatures: Mutex<HashMap<usize, Option<Arc<Vec<Signature>>>>>,
    /// What distances are divided by in each channel, by set.
    scales: Mutex<HashMap<Option<String>, Arc<Vec<f64>>>>,
}

/// How the distances of a query to two clouds come about.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Explanation {
    /// The descriptor.
    pub descriptor: String,
    /// Path of the query.
    pub query: String,
    /// Path of the cloud that it is compared with.
    pub answer: String,
    /// The nearest cloud of the query's own object in its database; `None` if that has none.
    pub right: Option<String>,
    /// Set distance to the answer.
    pub answer_distance: f64,
    /// Set distance to the right cloud.
    pub right_distance: Option<f64>,
    /// How much farther the right cloud is.
    pub margin: Option<f64>,
    /// The channel that speaks most for the answer and against the right cloud; where there is none, the one that adds
    /// most to the distance.
    pub decided_by: String,
    /// The channels of the descriptor.
    pub channels: Vec<ChannelShare>,
}

/// What one channel adds to both distances.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ChannelShare {
    /// Where it looks, and how its values are divided.
    #[serde(flatten)]
    pub layout: ChannelLayout,
    /// Its weight.
    pub weight: f64,
    /// What it adds to the distance to the answer: weight times distance over scale.
    pub answer_distance: f64,
    /// The same of the right cloud.
    pub right_distance: Option<f64>,
    /// Mean of the rows of the query.
    #[serde(rename = "query")]
    pub query_values: Vec<f32>,
    /// The same of the answer.
    #[serde(rename = "answer")]
    pub answer_values: Vec<f32>,
    /// The same of the right cloud.
    #[serde(rename = "right")]
    pub right_values: Option<Vec<f32>>,
}

impl Examiner {
    /// Of the run in a folder, whose list of clouds must be there.
    ///
    /// # Errors
    /// [`ExamineError::NotListed`] if the folder has no list of clouds.
    pub fn new(folder: &Path, experiment: &Experiment) -> Result<Self, ExamineError> {
        let clouds = listed(folder).ok_or_else(|| ExamineError::NotListed { folder: folder.to_owned() })?;
        let by_path = clouds.iter().enumerate().map(|(place, cloud)| (cloud.path.clone(), place)).collect();
        Ok(Self {
            root: experiment.dataset().root.clone(),
            preprocess: *experiment.preprocess(),
            clouds,
            by_path,
            described: Mutex::default(),
        })
    }

    /// All clouds that the run lists, in their order.
    pub fn clouds(&self) -> &[CloudRecord] {
        &self.clouds
    }

    /// What the run lists of a cloud.
    ///
    /// # Errors
    /// [`ExamineError::UnknownCloud`].
    pub fn record(&self, path: &str) -> Result<&CloudRecord, ExamineError> {
        self.place(path).map(|place| &self.clouds[place])
    }

    /// Whether a cloud is one of the final test.
    pub fn is_test(&self, cloud: &CloudRecord) -> bool {
        SPLITS[cloud.split] == "test"
    }

    /// What the channels of a descriptor look at on a cloud.
    ///
    /// # Errors
    /// If the cloud cannot be read, or has no keypoints.
    pub fn reach(&self, descriptor: &Descriptor, path: &str) -> Result<SeenCloud, ExamineError> {
        let CloudRecord { path, instance, .. } = self.record(path)?;
        let seen = reach(descriptor, &self.preprocess, &self.cloud(path)?, [path, instance]);
        seen.map_err(|error| ExamineError::Cloud { path: path.clone(), what: error.to_string() })
    }

    /// The points of a cloud, metres.
    ///
    /// # Errors
    /// If it is not there any more, or not the one that the run has seen.
    pub fn cloud(&self, path: &str) -> Result<Cloud, ExamineError> {
        self.read(self.place(path)?)
    }

    /// How the distances of a query to `answer` and to the nearest cloud of its own object come about.
    ///
    /// # Errors
    /// If a cloud is not one of the run, cannot be read, or takes no part.
    pub fn explain(
        &self,
        descriptor: &Descriptor,
        query: &str,
        answer: &str,
    ) -> Result<Explanation, ExamineError> {
        let (query, answer) = (self.place(query)?, self.place(answer)?);
        let by = self.described_by(descriptor)?;
        let of = |place: usize| {
            let path = || self.clouds[place].path.clone();
            self.signature(&by, place)?.ok_or_else(|| ExamineError::NoPart { path: path() })
        };
        let (asked, answered) = (of(query)?, of(answer)?);
        let scales = self.scales(descriptor, &by, query)?;
        let channels = descriptor.channels();
        let parts = |other: &[Signature]| -> Vec<f64> {
            let each = channels.iter().zip(scales.iter()).zip(asked.iter().zip(other));
            each.map(|(((channel, weight), scale), (one, other))| {
                weight / scale * f64::from(one.distance_by(channel.metric(), other))
            })
            .collect()
        };
        let mut right: Option<(usize, Arc<Vec<Signature>>, Vec<f64>)> = None;
        let own: Vec<usize> = self.own_object(query).collect();
        let described: Vec<_> =
            own.par_iter().map(|&place| self.signature(&by, place)).collect::<Result<_, _>>()?;
        for (place, signature) in own.into_iter().zip(described) {
            let Some(signature) = signature else { continue };
            let distances = parts(&signature);
            let is_nearer = |(_, _, other): &(_, _, Vec<f64>)| sum(&distances) < sum(other);
            if right.as_ref().is_none_or(is_nearer) {
                right = Some((place, signature, distances));
            }
        }
        let answer_parts = parts(&answered);
        let right_parts = right.as_ref().map(|(_, _, parts)| parts);
        let layouts = descriptor.layouts();
        let in_favour = |channel: usize| match right_parts {
            Some(right) => right[channel] - answer_parts[channel],
            None => answer_parts[channel],
        };
        let decided_by = (0..layouts.len()).max_by(|&a, &b| in_favour(a).total_cmp(&in_favour(b)));
        let path = |place: usize| self.clouds[place].path.clone();
        let right_distance = right_parts.map(|parts| sum(parts));
        Ok(Explanation {
            descriptor: descriptor.parameters(),
            query: path(query),
            answer: path(answer),
            right: right.as_ref().map(|(place, ..)| path(*place)),
            answer_distance: sum(&answer_parts),
            right_distance,
            margin: right_distance.map(|right| right - sum(&answer_parts)),
            decided_by: decided_by.map_or_else(String::new, |channel| layouts[channel].name.clone()),
            channels: layouts
                .into_iter()
                .enumerate()
                .map(|(channel, layout)| ChannelShare {
                    layout,
                    weight: channels[channel].1,
                    answer_distance: answer_parts[channel],
                    right_distance: right_parts.map(|parts| parts[channel]),
                    query_values: asked[channel].centroid.clone(),
                    answer_values: answered[channel].centroid.clone(),
                    right_values: right.as_ref().map(|(_, signature, _)| signature[channel].centroid.clone()),
                })
                .collect(),
        })
    }

    fn place(&self, path: &str) -> Result<usize, ExamineError> {
        let place = self.by_path.get(path).copied();
        place.ok_or_else(|| ExamineError::UnknownCloud { path: path.to_owned() })
    }

    /// The clouds of a query's object that it is compared with: those of the splits before its own, or, of a training
    /// cloud, all others of both training sets; of its own set only.
    fn own_object(&self, query: usize) -> impl Iterator<Item = usize> + '_ {
        let CloudRecord { split, category, instance, set, .. } = &self.clouds[query];
        let database = (*split).max(2);
        self.clouds.iter().enumerate().filter_map(move |(place, other)| {
            let is_own = (&other.category, &other.instance, &other.set) == (category, instance, set);
            (is_own && other.split < database && place != query).then_some(place)
        })
    }

    fn described_by(&self, descriptor: &Descriptor) -> Result<Arc<DescribedBy>, ExamineError> {
        let mut kept = lock(&self.described);
        let found = match kept.iter().position(|(other, _)| other == descriptor) {
            Some(place) => kept.remove(place).1,
            None => Arc::new(DescribedBy {
                describer: Describer::new(descriptor)?,
                signatures: Mutex::default(),
                scales: Mutex::default(),
            }),
        };
        kept.push((descriptor.clone(), Arc::clone(&found)));
        if kept.len() > KEPT {
            kept.remove(0);
        }
        Ok(found)
    }

    /// The signatures of a cloud; `None` if it takes no part.
    fn signature(&self, by: &DescribedBy, place: usize) -> Result<Option<Arc<Vec<Signature>>>, ExamineError> {
        if let Some(found) = lock(&by.signatures).get(&place) {
            return Ok(found.clone());
        }
        let cloud = self.read(place)?;
        let described = stages(&cloud, &self.preprocess, &by.describer, &mut Seconds::default());
        let signatures = described.ok().map(|described| Arc::new(described.signatures));
        lock(&by.signatures).insert(place, signatures.clone());
        Ok(signatures)
    }

    /// What distances are divided by in each channel where the query is compared: found by all training clouds.
    fn scales(
        &self,
        descriptor: &Descriptor,
        by: &DescribedBy,
        query: usize,
    ) -> Result<Arc<Vec<f64>>, ExamineError> {
        let channels = descriptor.channels().len();
        if descriptor.scaled_channels().iter().all(Option::is_none) {
            return Ok(Arc::new(vec![1.0; channels]));
        }
        let set = &self.clouds[query].set;
        if let Some(found) = lock(&by.scales).get(set) {
            return Ok(Arc::clone(found));
        }
        let is_training = |cloud: &CloudRecord| cloud.split < 2 && cloud.set == *set;
        let training: Vec<usize> =
            (0..self.clouds.len()).filter(|&place| is_training(&self.clouds[place])).collect();
        let described: Vec<_> =
            training.into_par_iter().map(|place| self.signature(by, place)).collect::<Result<_, _>>()?;
        let described: Vec<Arc<Vec<Signature>>> = described.into_iter().flatten().collect();
        let of_channel =
            |channel: usize| described.iter().map(|cloud| &cloud[channel]).collect::<Signatures>();
        let database: Vec<Signatures> = (0..channels).map(of_channel).collect();
        let scales = Arc::new(descriptor.scales(SetDistance::ChiSquared, &database, described.len()));
        lock(&by.scales).insert(set.clone(), Arc::clone(&scales));
        Ok(scales)
    }

    fn read(&self, place: usize) -> Result<Cloud, ExamineError> {
        let CloudRecord { path, digest, .. } = &self.clouds[place];
        let failed = |what: String| ExamineError::Cloud { path: path.clone(), what };
        let bytes = cloud_bytes(&self.root.join(path))
            .map_err(|reason| failed(format!("cannot be read, got {reason}")))?;
        if digest.is_none_or(|digest| *blake3::hash(&bytes).as_bytes() != digest) {
            return Err(failed("is another one than when the run has seen it".to_owned()));
        }
        let cloud = cloud_file::read(&bytes).map_err(|error| failed(error.to_string()))?;
        Ok(cloud.in_metres(self.preprocess.unit.metres()))
    }
}

fn sum(parts: &[f64]) -> f64 {
    parts.iter().sum()
}
