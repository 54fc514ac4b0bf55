//! From a finished run to an artefact: whole, read back, and answering as the run did.

use std::path::Path;

use artefact::sections::of_one;
use artefact::{
    Database, DatabaseCloud, DatabaseSettings, Example, Learned, Recogniser, RecognitionSettings, Settings,
    TestVectorSettings, Verdict, channels, found_scales, labels, names_objects_by, signatures,
};
use cache::{Storage, Store};
use descriptor::cloud_file::{self, CloudFileError};
use descriptor::pcd::{self, DataEncoding};
use descriptor::recogniser::{ChosenSettings, LabelledClouds, LearnError, Method};
use descriptor::weigh::Weighing;
use descriptor::{Descriptor, Family, Preprocess, SearchSpace, SetDistance, Signatures, ply, rgbd};
use proto::Message;
use results::{FinishedRun, PredictionRow, PredictionSplit};

use super::readme::{About, Origin};
use super::reject::Reject;
use super::write::{Draft, Written, refuse_occupied};
use super::{DescriptorChoice, ExportError, reject};
use crate::compare::EVOLVED;
use crate::dataset::Dataset;
use crate::experiment::{Experiment, Overrides};
use crate::front;
use crate::reference_clouds::{ReferenceError, describe, labelled, read, sequences};
use crate::reopen::{Reopened, reopen, searched, winner_of};
use crate::run::{Matching, choose_set, sets};
use crate::sweep;

/// What was exported.
#[derive(Clone, Debug)]
pub struct Exported {
    /// The descriptor.
    pub descriptor: Descriptor,
    /// Reference clouds.
    pub clouds: usize,
    /// The example's path below the data root.
    pub example: String,
    /// What it is recognised as.
    pub answer: String,
    /// What names objects and, of one that learns, its settings.
    pub recogniser: String,
    /// When answers are not believed.
    pub reject: Reject,
    /// All files together, bytes.
    pub bytes: u64,
    /// What may make the recogniser worse than it need be.
    pub note: Option<String>,
}

/// Makes the artefact of a finished run in the folder `out`, whole or not at all; an artefact that is there is
/// replaced. Without a recogniser it is that of the run's experiment. `data` is another place of the run's data root. Settings of a recogniser that learns are chosen inside the
/// reference clouds, as is when an answer is rejected: of at most this share of the clouds that are known.
///
/// # Errors
/// [`ExportError`]: also if the artefact, once written, does not answer as the run did.
pub fn export(
    run: &Path,
    (which, recogniser): (DescriptorChoice, Option<Method>),
    false_rejections: f64,
    (data, set): (Option<&Path>, Option<&str>),
    out: &Path,
    storage: &Storage,
) -> Result<Exported, ExportError> {
    refuse_occupied(out)?;
    let Chosen { mut finished, experiment, dataset, preprocess, descriptor } =
        choose(run, &which, data, ("export", storage))?;
    if matches!(which, DescriptorChoice::Evolved | DescriptorChoice::Searched | DescriptorChoice::Point(_)) {
        of_family(run, experiment.space())?;
    }
    let dataset = choose_set("export", set, dataset).map_err(|error| ExportError::Run(Box::new(error)))?;
    if let Some(set) = set {
        finished.row.test = sets::counts(&results::read_sets(run)?, EVOLVED, set);
    }
    let family = descriptor.family();
    let winner = |what: String| ExportError::Winner { run: run.to_owned(), what };
    let all = Matching::Test.database_clouds(&dataset).len();
    let database = describe(&dataset, all, &preprocess, &descriptor)
        .map_err(|error| ExportError::of_reference(run, error))?;
    let reference = signatures(&descriptor, &database).map_err(winner)?;
    let scales = found_scales(&descriptor, &reference, dataset.splits.trained());
    let method = recogniser.unwrap_or(experiment.recognition());
    let learning =
        learning(method, &dataset, &channels(&descriptor, scales.as_deref(), &reference), &database)
            .map_err(|source| ExportError::Learn { run: run.to_owned(), source })?;
    let settings_of_recogniser = learning.map(|chosen| chosen.settings);
    let example = example(&dataset).map_err(|error| ExportError::of_reference(run, error))?;
    let reject = reject::calibrate(
        settings_of_recogniser.as_ref(),
        &channels(&descriptor, scales.as_deref(), &reference),
        &database.clouds,
        false_rejections,
    );
    let held = Learned {
        scales: scales.as_deref(),
        recognition: settings_of_recogniser.as_ref(),
        reject: reject.calibration.as_ref().ok().map(|found| found.rule),
    };
    let recogniser = Recogniser::new(preprocess, &descriptor, held, database.clone())
        .map_err(|what| ExportError::Recogniser { run: run.to_owned(), what })?;
    // The run's own answers are those of the nearest cloud.
    let recorded = match (&which, learning) {
        (DescriptorChoice::Evolved, None) => results::read_predictions(run, PredictionSplit::Test)?,
        _ => Vec::new(),
    };
    let sections = of_one(&preprocess, &descriptor).map_err(|error| winner(Message::of(&error).what))?;
    let (raw_preprocess, raw_descriptor) = sections;
    let about = About {
        name: &finished.row.name,
        run_digest: &finished.run_digest,
        origin: Origin::Run { row: &finished.row, which: &which, learning },
        descriptor: &descriptor,
        scales: scales.as_deref().unwrap_or_default(),
        preprocess,
        clouds: &database.clouds,
        recognition: settings_of_recogniser.as_ref(),
        reject: &reject,
    };
    let draft = Draft {
        readme: about.text(),
        settings: Settings {
            version: 0,
            digest: String::new(),
            name: finished.row.name.clone(),
            evaluation_version: descriptor::EVALUATION_VERSION,
            run_digest: finished.run_digest.clone(),
            data_digest: finished.row.data_digest.clone(),
            set_distance: SetDistance::ChiSquared.name().to_owned(),
            unit: preprocess.unit,
            preprocess: raw_preprocess,
            descriptor: raw_descriptor,
            recognition: settings_of_recogniser.map(RecognitionSettings::from),
            reject: reject.settings(),
            database: DatabaseSettings { clouds: 0, digest: String::new(), scales: scales.clone() },
            test_vector: TestVectorSettings { digest: String::new() },
        },
        family,
        database: &database,
        recogniser: &recogniser,
        example: &example,
    };
    let recorded = recorded.iter().find(|row| row.cloud == example.cloud).map(recorded_verdict);
    let Written { verdict, bytes } = draft.write(out, recorded)?;
    Ok(Exported {
        descriptor,
        clouds: database.clouds.len(),
        example: example.cloud,
        answer: verdict.to_string(),
        recogniser: names_objects_by(settings_of_recogniser.as_ref()),
        reject,
        bytes,
        note: weights_note(&which, experiment.weighs(), method),
    })
}

/// That the weights of a run's winner are likely to mislead a recogniser, if they are.
fn weights_note(which: &DescriptorChoice, weighs: Option<Weighing>, method: Method) -> Option<String> {
    let has_weights = matches!(which, DescriptorChoice::Evolved);
    (has_weights && weighs.is_some_and(|how| how.misleads(method))).then(|| {
        format!(
            "weights learned \"separately\" are likely to suit {} better than the run's, learned \"jointly\": it learns \
             from the same clouds, too",
            method.name()
        )
    })
}

/// A descriptor for the clouds of a finished run.
pub(super) struct Chosen {
    pub(super) finished: FinishedRun,
    pub(super) experiment: Experiment,
    /// Of all sets.
    pub(super) dataset: Dataset,
    /// How they are prepared for the descriptor.
    pub(super) preprocess: Preprocess,
    pub(super) descriptor: Descriptor,
}

/// Opens a run whose files and clouds are those that its digests name, for a command.
pub(super) fn choose(
    run: &Path,
    which: &DescriptorChoice,
    data: Option<&Path>,
    (command, storage): (&'static str, &Storage),
) -> Result<Chosen, ExportError> {
    refuse_sweep(run)?;
    let store = Store::open(storage, command, descriptor::EVALUATION_VERSION);
    let reopened = reopen(run, data, Overrides::default(), &store)?;
    refuse_unsound(run)?;
    reopened.refuse_other_data(run)?;
    let Reopened { finished, experiment, dataset } = reopened;
    let winner = |what: String| ExportError::Winner { run: run.to_owned(), what };
    let mut preprocess = *experiment.preprocess();
    let descriptor = match which {
        DescriptorChoice::Evolved => {
            winner_of(experiment.space(), &finished.row).map_err(|error| winner(error.to_string()))?
        }
        DescriptorChoice::Searched => {
            searched(experiment.space(), &finished.row).map_err(|error| winner(error.to_string()))?
        }
        &DescriptorChoice::Point(number) => front::point(run, experiment.space(), number)?,
        DescriptorChoice::Paper => paper(preprocess.colour).map_err(winner)?,
        DescriptorChoice::Structure(structure) => Descriptor::Structure(structure.clone()),
    };
    if descriptor.family() == Family::Structure {
        // Its channels have grids of their own, and its settings no other.
        preprocess.leaf_um = Preprocess::default().leaf_um;
        if descriptor.needs_colour() && !preprocess.colour {
            return Err(ExportError::NeedsColour { run: run.to_owned() });
        }
    }
    Ok(Chosen { finished, experiment, dataset, preprocess, descriptor })
}

/// The settings that recognise most reference clouds by those of other sequences or folds.
fn learning(
    method: Method,
    dataset: &Dataset,
    channels: &[(&Signatures, SetDistance, f64)],
    database: &Database,
) -> Result<Option<ChosenSettings>, LearnError> {
    let objects: Vec<u32> = labels(&database.clouds).iter().map(|label| label.instance).collect();
    let sequences = sequences(dataset);
    ChosenSettings::new(method, &LabelledClouds { channels, objects: &objects }, &sequences)
}

/// Refuses families that artefacts do not hold.
fn of_family(run: &Path, space: &SearchSpace) -> Result<(), ExportError> {
    match space.family() {
        Family::DiskRing | Family::Structure => Ok(()),
        got => Err(ExportError::Family { run: run.to_owned(), got }),
    }
}

/// The paper's descriptor, as clouds with or without colours have it.
fn paper(colour: bool) -> Result<Descriptor, String> {
    let paper = SearchSpace::single(&Descriptor::default_of(Family::DiskRing));
    let domains =
        |space: SearchSpace| space.genes().into_iter().map(|(_, domain)| domain).collect::<Vec<_>>();
    let space = paper.and_then(|paper| SearchSpace::new(Family::DiskRing, colour, &domains(paper)));
    let only = space.map_err(|error| Message::of(&error).what)?.only();
    only.ok_or_else(|| "the paper's descriptor must be one, got many".to_owned())
}

/// Refuses the folder of a sweep: it has many winners.
fn refuse_sweep(run: &Path) -> Result<(), ExportError> {
    if !run.is_dir() {
        return Ok(()); // opening it says so
    }
    let folders = sweep::run_folders(run).map_err(|error| ExportError::Run(Box::new(error)))?;
    match folders.first() {
        Some((name, first)) if !name.is_empty() => {
            let (folder, first) = (run.to_owned(), first.clone());
            Err(ExportError::Sweep { folder, runs: folders.len(), first })
        }
        _ => Ok(()),
    }
}

/// Refuses a run whose files do not fit its digests.
fn refuse_unsound(run: &Path) -> Result<(), ExportError> {
    match results::verify(run)?.problems.first() {
        Some(problem) => {
            let problem = Message::of(problem).what;
            Err(ExportError::NotSound { run: run.to_owned(), problem })
        }
        None => Ok(()),
    }
}

/// The first cloud of the final test, or of its database where nothing is tested.
fn example(dataset: &Dataset) -> Result<Example, ReferenceError> {
    let database = Matching::Test.database_clouds(dataset);
    let first = Matching::Test.query_clouds(dataset).first().or(database.first());
    // A data set without any training cloud is refused when it is loaded.
    let index = first.copied().unwrap_or_default();
    let entry = &dataset.clouds.entries[index as usize];
    let DatabaseCloud { cloud, instance, category, .. } = labelled(dataset, entry);
    let mut bytes = read(dataset, entry)?;
    // The example's file is PCD by its name: the same points, and so the same summary.
    if ply::is_ply(&bytes) || rgbd::is_rgbd(&bytes) {
        let failed = |error: CloudFileError| {
            let (path, what) = (dataset.clouds.file(entry), error.to_string());
            ReferenceError::Cloud { path, what }
        };
        bytes = pcd::write(&cloud_file::read(&bytes).map_err(failed)?, DataEncoding::Binary);
    }
    Ok(Example { cloud, instance, category, bytes })
}

fn recorded_verdict(row: &PredictionRow) -> Verdict {
    let runner_up = row.runner_up.as_ref().map(|other| (other.cloud.clone(), other.distance));
    Verdict { nearest_cloud: row.nearest_cloud.clone(), distance: row.distance, runner_up }
}
