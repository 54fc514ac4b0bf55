//! From a finished run to a structure file whose values have weights, learned from the run's training clouds.

use std::path::Path;

use cache::Storage;
use descriptor::Descriptor;
use descriptor::structure::Structure;
use descriptor::weigh::Weighing;

use super::of_run::{Chosen, choose};
use super::{DescriptorChoice, ExportError};
use crate::run::choose_set;
use crate::weighing::{TrainingClouds, file_text, teaching_sets};

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
/// validation nor test clouds are described. Of a winner that the run has weighed they are learned once more. `how`: if not as
/// the run's experiment has it, which is jointly where it does not say.
///
/// # Errors
/// [`ExportError`]
pub fn weigh(
    run: &Path,
    (which, how): (&DescriptorChoice, Option<Weighing>),
    (data, set): (Option<&Path>, Option<&str>),
    out: &Path,
    storage: &Storage,
) -> Result<Weighed, ExportError> {
    if out.exists() {
        return Err(ExportError::FileExists { file: out.to_owned() });
    }
    let Chosen { finished, experiment, dataset, preprocess, descriptor } =
        choose(run, which, data, ("weigh", storage))?;
    let Descriptor::Structure(structure) = &descriptor else {
        return Err(ExportError::NotStructure { run: run.to_owned(), got: descriptor.family() });
    };
    let how = how.or(experiment.weighs()).unwrap_or(Weighing::Jointly);
    let sets = match set {
        Some(_) => {
            let chosen = choose_set("weigh", set, dataset);
            vec![(chosen.map_err(|error| ExportError::Run(Box::new(error)))?, 1)]
        }
        None => teaching_sets(&dataset, &experiment.set_weights(&dataset)),
    };
    let before = TrainingClouds::describe(&sets, &preprocess, structure)
        .map_err(|error| ExportError::of_reference(run, error))?;
    let structure =
        before.weigh(structure, how).map_err(|source| ExportError::Weigh { run: run.to_owned(), source })?;
    let (clouds, (queries, without)) = (before.count(), before.wrong());
    let (_, with) = before.weighted(&structure).wrong();

    let body = file_text(&structure);
    let text = format!("# {}: values weighted by {clouds} training clouds.\n{body}", finished.row.name);
    atomic::write(out, text.as_bytes())
        .map_err(|source| ExportError::File { file: out.to_owned(), source })?;
    Ok(Weighed { structure, clouds, queries, wrong: [without, with] })
}
