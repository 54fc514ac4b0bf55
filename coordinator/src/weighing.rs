//! Weights for the values of a structure, learned from the training clouds of a run, described by this process.

use artefact::{Database, channels, found_scales, labels, signatures};
use descriptor::fitness::{Member, NearestOfClass, nearest};
use descriptor::recognise::Hit;
use descriptor::recogniser::LabelledClouds;
use descriptor::structure::{Structure, StructureFile};
use descriptor::weigh::{LabelledSet, WeighError, Weighing, check_clouds, weighed, weighted_by};
use descriptor::{Descriptor, Label, Preprocess, SetDistance, Signature, Signatures};
use proto::task::is_nearer;
use rayon::prelude::*;

use crate::dataset::Dataset;
use crate::reference_clouds::{ReferenceError, describe};
use crate::run::matching::Matching;

/// The sets of clouds that teach, each with its weight: those with one above 0. Clouds that are of no set are one.
pub fn teaching_sets(dataset: &Dataset, weights: &[u32]) -> Vec<(Dataset, u32)> {
    if dataset.clouds.set_count() == 1 {
        return vec![(dataset.clone(), 1)];
    }
    let weighted = (0..).zip(weights).filter(|(_, weight)| **weight > 0);
    weighted.map(|(set, &weight)| (dataset.of_set(set), weight)).collect()
}

/// Refuses clouds of which none of these sets teaches how to weigh values.
///
/// # Errors
/// [`WeighError`], of the last set.
pub fn check_sets(sets: &[(Dataset, u32)]) -> Result<(), WeighError> {
    let mut checked = Err(WeighError::Sequences);
    for (dataset, _) in sets {
        let objects = Matching::Validation.database(dataset).map(|cloud| cloud.instance);
        checked = check_clouds(&objects.collect::<Vec<_>>(), &training_sequences(dataset));
        if checked.is_ok() {
            break;
        }
    }
    checked
}

/// Of each cloud of both training splits.
fn training_sequences(dataset: &Dataset) -> Vec<Option<u32>> {
    Matching::Validation.database(dataset).map(|cloud| cloud.sequence).collect()
}

/// The text of the file of a structure, by which it is kept.
pub fn file_text(structure: &Structure) -> String {
    toml::to_string(&StructureFile::from(structure)).expect("a structure file is plain values")
}

/// The clouds of both training splits of some sets under a structure.
pub struct TrainingClouds(Vec<OfSet>);

impl TrainingClouds {
    /// Describes those of these sets, each with its weight.
    ///
    /// # Errors
    /// [`ReferenceError`]
    pub fn describe(
        sets: &[(Dataset, u32)],
        preprocess: &Preprocess,
        structure: &Structure,
    ) -> Result<Self, ReferenceError> {
        let descriptor = Descriptor::Structure(structure.clone());
        let of_set =
            |(dataset, weight): &(Dataset, u32)| OfSet::new(dataset, *weight, preprocess, &descriptor);
        sets.iter().map(of_set).collect::<Result<_, _>>().map(Self)
    }

    /// Their structure with weights for its values, which are found like this.
    ///
    /// # Errors
    /// [`WeighError`]
    pub fn weigh(&self, structure: &Structure, how: Weighing) -> Result<Structure, WeighError> {
        let channels: Vec<_> = self.0.iter().map(OfSet::channels).collect();
        let labelled = self.0.iter().zip(&channels).map(|(set, channels)| {
            let clouds = LabelledClouds { channels, objects: &set.objects };
            LabelledSet { clouds, sequences: &set.sequences, weight: set.weight }
        });
        weighed(structure, &labelled.collect::<Vec<_>>(), how)
    }

    /// The same clouds under the same structure with weights.
    pub fn weighted(&self, structure: &Structure) -> Self {
        Self(self.0.iter().map(|set| set.weighted(structure)).collect())
    }

    /// How many they are.
    pub fn count(&self) -> usize {
        self.0.iter().map(|set| set.objects.len()).sum()
    }

    /// Clouds whose object is seen in another sequence of their set, and how many of them are nearest to another object
    /// there.
    pub fn wrong(&self) -> (usize, usize) {
        let counts = self.0.iter().map(OfSet::wrong);
        counts.fold((0, 0), |sum, of_set| (sum.0 + of_set.0, sum.1 + of_set.1))
    }
}

/// The clouds of one set.
struct OfSet {
    descriptor: Descriptor,
    signatures: Vec<Signatures>,
    scales: Option<Vec<f64>>,
    objects: Vec<u32>,
    sequences: Vec<Option<u32>>,
    weight: u32,
}

impl OfSet {
    fn new(
        dataset: &Dataset,
        weight: u32,
        preprocess: &Preprocess,
        descriptor: &Descriptor,
    ) -> Result<Self, ReferenceError> {
        let trained = dataset.splits.trained();
        let database: Database = describe(dataset, trained, preprocess, descriptor)?;
        let signatures = signatures(descriptor, &database).map_err(ReferenceError::Descriptor)?;
        let scales = found_scales(descriptor, &signatures, trained);
        let objects = labels(&database.clouds).iter().map(|label| label.instance).collect();
        let sequences = training_sequences(dataset);
        Ok(Self { descriptor: descriptor.clone(), signatures, scales, objects, sequences, weight })
    }

    fn weighted(&self, structure: &Structure) -> Self {
        let channels = structure.channels.iter().zip(&self.signatures);
        let signatures: Vec<Signatures> =
            channels.map(|(one, signatures)| weighted_by(&one.channel, signatures)).collect();
        let descriptor = Descriptor::Structure(structure.clone());
        let scales = found_scales(&descriptor, &signatures, self.objects.len());
        let (objects, sequences) = (self.objects.clone(), self.sequences.clone());
        Self { descriptor, signatures, scales, objects, sequences, weight: self.weight }
    }

    fn channels(&self) -> Vec<(&Signatures, SetDistance, f64)> {
        channels(&self.descriptor, self.scales.as_deref(), &self.signatures)
    }

    /// Clouds whose object is seen in another sequence, and how many of them are nearest to another object there.
    fn wrong(&self) -> (usize, usize) {
        let labels = self.objects.iter().map(|&instance| Label { category: 0, instance }).collect();
        // Clouds have been weighed, so that there are some.
        let Ok(database) = descriptor::Database::new(&self.channels(), labels) else { return (0, 0) };
        // A cloud of an unknown sequence is compared with none.
        let known = |cloud: usize| Some((cloud, self.sequences[cloud]?));
        let known: Vec<(usize, u32)> = (0..self.objects.len()).filter_map(known).collect();
        let member =
            |&(cloud, sequence): &(usize, u32)| Member { class: self.objects[cloud], group: Some(sequence) };
        let members: Vec<Member> = known.iter().map(member).collect();
        let nearest = known.par_iter().zip(&members).map(|(&(cloud, _), member)| {
            let query: Vec<Signature> =
                self.signatures.iter().map(|clouds| clouds.signature(cloud)).collect();
            let all = database.distances(&query);
            let distances: Vec<f64> = known.iter().map(|&(other, _)| all[other]).collect();
            nearest(member, &distances, &members)
        });
        let nearest: Vec<NearestOfClass> = nearest.collect();
        let asked = nearest.iter().filter_map(|found| Some((found.same?, found.other)));
        let asked = asked.map(|(same, other)| {
            let hit = |hit: Hit| (hit.index, hit.distance);
            other.is_some_and(|other| is_nearer(hit(other), hit(same)))
        });
        let wrong: Vec<bool> = asked.collect();
        (wrong.len(), wrong.iter().filter(|&&wrong| wrong).count())
    }
}
