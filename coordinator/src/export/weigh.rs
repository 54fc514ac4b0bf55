//! From a finished run to a structure file whose values have weights, learned from the run's training clouds.

use std::path::Path;

use artefact::{Database, channels, found_scales, labels, signatures};
use cache::Storage;
use descriptor::fitness::{Member, nearest_of_class};
use descriptor::recogniser::LabelledClouds;
use descriptor::structure::{Structure, StructureFile};
use descriptor::weigh::weighed;
use descriptor::{Descriptor, DistanceMatrix, Preprocess, SetDistance, Signatures};

use super::of_run::{choose, describe, sequences};
use super::{DescriptorChoice, ExportError};
use crate::dataset::Dataset;

/// What was found.
#[derive(Clone, Debug)]
pub struct Weighed {
    /// The structure with weights for its values.
    pub structure: Structure,
    /// Clouds that they were learned from.
    pub clouds: usize,
    /// How many of the clouds that are matched with other sequences are named wrongly without weights, and with them: the
    /// clouds that they were learned from.
    pub wrong: [usize; 2],
    /// Clouds whose object is seen in another sequence, too.
    pub queries: usize,
}

/// Learns weights for the values of a run's descriptor and writes the file of the structure, whole or not at all.
/// Learned from are the clouds of both training splits; neither validation nor test clouds are described.
///
/// # Errors
/// [`ExportError`]
pub fn weigh(
    run: &Path,
    which: &DescriptorChoice,
    place: (Option<&Path>, Option<&str>),
    out: &Path,
    storage: &Storage,
) -> Result<Weighed, ExportError> {
    if out.exists() {
        return Err(ExportError::FileExists { file: out.to_owned() });
    }
    let chosen = choose(run, which, place, ("weigh", storage))?;
    let Descriptor::Structure(structure) = &chosen.descriptor else {
        return Err(ExportError::NotStructure { run: run.to_owned(), got: chosen.descriptor.family() });
    };
    let failed = |what: String| ExportError::Winner { run: run.to_owned(), what };
    let before = Trained::new(&chosen.dataset, &chosen.preprocess, &chosen.descriptor, failed)?;
    let sequences = sequences(&chosen.dataset);
    let sequences = &sequences[..before.objects.len()];
    let clouds = LabelledClouds { channels: &before.channels(), objects: &before.objects };
    let structure = weighed(structure, &clouds, sequences)
        .map_err(|source| ExportError::Weigh { run: run.to_owned(), source })?;
    let descriptor = Descriptor::Structure(structure.clone());
    let after = Trained::new(&chosen.dataset, &chosen.preprocess, &descriptor, failed)?;
    let [(queries, without), (_, with)] = [&before, &after].map(|clouds| clouds.wrong(sequences));

    let body =
        toml::to_string(&StructureFile::from(&structure)).map_err(|error| failed(error.to_string()))?;
    let text = format!(
        "# {}: values weighted by {} training clouds.\n{body}",
        chosen.finished.row.name,
        before.objects.len()
    );
    atomic::write(out, text.as_bytes())
        .map_err(|source| ExportError::File { file: out.to_owned(), source })?;
    Ok(Weighed { structure, clouds: before.objects.len(), wrong: [without, with], queries })
}

/// The clouds of both training splits under a descriptor.
struct Trained {
    descriptor: Descriptor,
    signatures: Vec<Signatures>,
    scales: Option<Vec<f64>>,
    objects: Vec<u32>,
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
        Ok(Self { descriptor: descriptor.clone(), signatures, scales, objects })
    }

    fn channels(&self) -> Vec<(&Signatures, SetDistance, f64)> {
        channels(&self.descriptor, self.scales.as_deref(), &self.signatures)
    }

    /// Clouds whose object is seen in another sequence, and how many of them are nearest to another object there.
    fn wrong(&self, sequences: &[Option<u32>]) -> (usize, usize) {
        let channels = self.channels();
        let distances: Vec<(DistanceMatrix, f64)> = channels
            .iter()
            .map(|&(signatures, metric, factor)| (DistanceMatrix::among(metric, signatures), factor))
            .collect();
        let members: Vec<Member> =
            (self.objects.iter().zip(sequences)).map(|(&class, &group)| Member { class, group }).collect();
        // The clouds are those of a run, of which there is at least one.
        let nearest = nearest_of_class(&members, &distances, &members).unwrap_or_default();
        let asked = nearest.iter().filter_map(|found| Some((found.same?, found.other)));
        let asked = asked.map(|(same, other)| {
            other.is_some_and(|other| (other.distance, other.index) < (same.distance, same.index))
        });
        let wrong: Vec<bool> = asked.collect();
        (wrong.len(), wrong.iter().filter(|&&wrong| wrong).count())
    }
}
