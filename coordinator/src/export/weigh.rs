//! From a finished run to a structure file whose values have weights, learned from the run's training clouds.

use std::path::Path;

use artefact::{Database, channels, found_scales, labels, signatures};
use cache::Storage;
use descriptor::fitness::{Member, NearestOfClass, nearest};
use descriptor::recognise::Hit;
use descriptor::recogniser::LabelledClouds;
use descriptor::structure::{Structure, StructureFile};
use descriptor::weigh::{LabelledSet, weighed, weighted_by};
use descriptor::{Descriptor, Label, Preprocess, SetDistance, Signature, Signatures};
use proto::task::is_nearer;
use rayon::prelude::*;

use super::of_run::{Chosen, choose, describe, searched, sequences};
use super::{DescriptorChoice, ExportError};
use crate::dataset::Dataset;
use crate::experiment::Experiment;
use crate::run::choose_set;

/// What was found.
#[derive(Clone, Debug)]
pub struct Weighed {
    /// The structure with weights for its values.
    pub structure: Structure,
    /// Clouds that they were learned from.
    pub clouds: usize,
    /// Of these, clouds whose object is seen in another sequence of their set, too.
    pub queries: usize,
    /// How many of these are nearest to another object in other sequences, without weights and with them.
    pub wrong: [usize; 2],
}

/// Learns weights for the values of a run's descriptor and writes the file of the structure, whole or not at all.
/// Learned from are the clouds of both training splits, of a set or of all that the run's fitness gives a weight; neither
/// validation nor test clouds are described. Of a winner that the run has weighed they are learned once more.
///
/// # Errors
/// [`ExportError`]
pub fn weigh(
    run: &Path,
    which: &DescriptorChoice,
    (data, set): (Option<&Path>, Option<&str>),
    out: &Path,
    storage: &Storage,
) -> Result<Weighed, ExportError> {
    if out.exists() {
        return Err(ExportError::FileExists { file: out.to_owned() });
    }
    let Chosen { finished, experiment, dataset, preprocess, mut descriptor } =
        choose(run, which, data, ("weigh", storage))?;
    if *which == DescriptorChoice::Evolved {
        descriptor = searched(run, experiment.space(), &finished.row)?;
    }
    let Descriptor::Structure(structure) = &descriptor else {
        return Err(ExportError::NotStructure { run: run.to_owned(), got: descriptor.family() });
    };
    let sets = match set {
        Some(_) => vec![(chosen_set(set, dataset)?, 1)],
        None => all_sets(&experiment, dataset)?,
    };
    let (structure, before) = learned(run, structure, &preprocess, &sets)?;
    let after: Vec<Trained> = before.iter().map(|set| set.weighted(&structure)).collect();
    let clouds = before.iter().map(|set| set.objects.len()).sum();
    let counts = [&before, &after].map(|sets| {
        let counts = sets.iter().map(Trained::wrong);
        counts.fold((0, 0), |sum, of_set| (sum.0 + of_set.0, sum.1 + of_set.1))
    });
    let [(queries, without), (_, with)] = counts;

    let body = file_text(run, &structure)?;
    let text = format!("# {}: values weighted by {clouds} training clouds.\n{body}", finished.row.name);
    atomic::write(out, text.as_bytes())
        .map_err(|source| ExportError::File { file: out.to_owned(), source })?;
    Ok(Weighed { structure, clouds, queries, wrong: [without, with] })
}

/// The text of the file of a structure of a run.
///
/// # Errors
/// [`ExportError::Winner`] if TOML cannot hold it.
pub fn file_text(run: &Path, structure: &Structure) -> Result<String, ExportError> {
    let failed = |what: String| ExportError::Winner { run: run.to_owned(), what };
    toml::to_string(&StructureFile::from(structure)).map_err(|error| failed(error.to_string()))
}

/// The structure of a run's winner with weights for its values, learned from the clouds of both training splits of these sets, each
/// with its weight.
///
/// # Errors
/// [`ExportError`]
pub fn weigh_by(
    run: &Path,
    structure: &Structure,
    preprocess: &Preprocess,
    sets: &[(Dataset, u32)],
) -> Result<Structure, ExportError> {
    learned(run, structure, preprocess, sets).map(|(structure, _)| structure)
}

/// The same with the clouds of each set as they are without weights.
fn learned(
    run: &Path,
    structure: &Structure,
    preprocess: &Preprocess,
    sets: &[(Dataset, u32)],
) -> Result<(Structure, Vec<Trained>), ExportError> {
    let failed = |what: String| ExportError::Winner { run: run.to_owned(), what };
    let descriptor = Descriptor::Structure(structure.clone());
    let trained = |(dataset, _): &(Dataset, u32)| Trained::new(dataset, preprocess, &descriptor, failed);
    let before: Vec<Trained> = sets.iter().map(trained).collect::<Result<_, _>>()?;
    let channels: Vec<_> = before.iter().map(Trained::channels).collect();
    let labelled = before.iter().zip(&channels).zip(sets).map(|((set, channels), &(_, weight))| {
        let clouds = LabelledClouds { channels, objects: &set.objects };
        LabelledSet { clouds, sequences: &set.sequences, weight }
    });
    let structure = weighed(structure, &labelled.collect::<Vec<_>>())
        .map_err(|source| ExportError::Weigh { run: run.to_owned(), source })?;
    drop(channels);
    Ok((structure, before))
}

fn chosen_set(set: Option<&str>, dataset: Dataset) -> Result<Dataset, ExportError> {
    choose_set("weigh", set, dataset).map_err(|error| ExportError::Run(Box::new(error)))
}

/// The clouds of each set that the fitness of a run gives a weight.
///
/// # Errors
/// None of sets that the clouds have.
pub fn all_sets(experiment: &Experiment, dataset: Dataset) -> Result<Vec<(Dataset, u32)>, ExportError> {
    if dataset.clouds.sets.len() < 2 {
        return Ok(vec![(dataset, 1)]);
    }
    let weighted = dataset.clouds.sets.iter().zip(experiment.set_weights(&dataset));
    let weighted = weighted.filter(|&(_, weight)| weight > 0);
    weighted.map(|(set, weight)| Ok((chosen_set(Some(set), dataset.clone())?, weight))).collect()
}

/// The clouds of both training splits under a descriptor.
struct Trained {
    descriptor: Descriptor,
    signatures: Vec<Signatures>,
    scales: Option<Vec<f64>>,
    objects: Vec<u32>,
    sequences: Vec<Option<u32>>,
}

impl Trained {
    fn new(
        dataset: &Dataset,
        preprocess: &Preprocess,
        descriptor: &Descriptor,
        failed: impl Fn(String) -> ExportError,
    ) -> Result<Self, ExportError> {
        let database: Database =
            describe(dataset, dataset.splits.trained(), preprocess, descriptor, &failed)?;
        let signatures = signatures(descriptor, &database).map_err(&failed)?;
        let scales = found_scales(descriptor, &signatures, dataset.splits.trained());
        let objects = labels(&database.clouds).iter().map(|label| label.instance).collect();
        let mut sequences = sequences(dataset);
        sequences.truncate(dataset.splits.trained());
        Ok(Self { descriptor: descriptor.clone(), signatures, scales, objects, sequences })
    }

    /// The same clouds under the same structure with weights.
    fn weighted(&self, structure: &Structure) -> Self {
        let channels = structure.channels.iter().zip(&self.signatures);
        let signatures: Vec<Signatures> =
            channels.map(|(one, signatures)| weighted_by(&one.channel, signatures)).collect();
        let descriptor = Descriptor::Structure(structure.clone());
        let scales = found_scales(&descriptor, &signatures, self.objects.len());
        let (objects, sequences) = (self.objects.clone(), self.sequences.clone());
        Self { descriptor, signatures, scales, objects, sequences }
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
