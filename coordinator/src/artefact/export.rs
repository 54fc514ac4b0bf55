//! From a finished run to an artefact: whole, read back, and answering as the run did.

use proto::Message;
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

use atomic::{Access, NewFolder};
use cache::{Storage, Store};
use descriptor::recogniser::{self, LabelledClouds, LearnError, Method};
use descriptor::structure::Structure;
use descriptor::{
    Describer, Descriptor, Family, Preprocess, SearchSpace, SetDistance, Signature, Signatures, pcd,
};
use rayon::prelude::*;
use results::{DatabaseCloud, DatabasePart, DatabaseParts, PredictionRow, PredictionSplit};

use super::readme::About;
use super::recogniser::{Recogniser, channels, labels, signatures};
use super::recognition::RecognitionSettings;
use super::settings::{DatabaseSettings, Settings, TestVectorSettings, VERSION};
use super::test_vector::{Example, Verdict, test_vector};
use super::{Chosen, DATABASE, EXAMPLE, ExportError, FILES, README, SETTINGS, TEST_VECTOR, scales};
use crate::dataset::{CloudEntry, Dataset, read_file};
use crate::evaluate::{Seconds, stages};
use crate::experiment::{Overrides, of_one};
use crate::front;
use crate::reopen::{Reopened, reopen};
use crate::run::{Matching, clouds, data_digest};
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
    /// All files together, bytes.
    pub bytes: u64,
}

/// Makes the artefact of a finished run in the folder `out`, whole or not at all; an artefact that is there is
/// replaced. `data` is another place of the run's data root. Settings of a recogniser that learns are chosen inside the
/// reference clouds.
///
/// # Errors
/// [`ExportError`]: also if the artefact, once written, does not answer as the run did.
pub fn export(
    run: &Path,
    chosen: Chosen,
    recogniser: Method,
    data: Option<&Path>,
    out: &Path,
    storage: &Storage,
) -> Result<Exported, ExportError> {
    refuse_occupied(out)?;
    refuse_sweep(run)?;
    let store = Store::open(storage, "export", descriptor::EVALUATION_VERSION);
    let Reopened { finished, experiment, dataset } = reopen(run, data, Overrides::default(), &store)?;
    refuse_unsound(run)?;
    let (expected, got) = (&finished.row.data_digest, data_digest(&dataset));
    if *expected != got {
        let (run, expected) = (run.to_owned(), expected.clone());
        let difference = clouds::difference(&run, &expected, &dataset);
        return Err(ExportError::OtherData { run, expected, got, difference });
    }
    let winner = |what: String| ExportError::Winner { run: run.to_owned(), what };
    let mut preprocess = *experiment.preprocess();
    let descriptor = match &chosen {
        Chosen::Evolved => evolved(run, experiment.space(), &finished.row.best_genes)?,
        &Chosen::Point(number) => {
            of_family(run, experiment.space())?;
            front::point(run, experiment.space(), number)?
        }
        Chosen::Paper => paper(preprocess.colour).map_err(winner)?,
        Chosen::Structure(structure) => Descriptor::Structure(structure.clone()),
    };
    let family = descriptor.family();
    if family == Family::Structure {
        // Its channels have grids of their own, and its settings no other.
        preprocess.leaf_um = Preprocess::default().leaf_um;
        if descriptor.needs_colour() && !preprocess.colour {
            return Err(ExportError::NeedsColour { run: run.to_owned() });
        }
    }

    let database = describe(&dataset, &preprocess, &descriptor, winner)?;
    let reference = signatures(&descriptor, &database).map_err(winner)?;
    let scales = scales::found(&descriptor, &reference, dataset.splits.trained());
    let learning =
        learning(recogniser, &dataset, &channels(&descriptor, scales.as_deref(), &reference), &database)
            .map_err(|source| ExportError::Learn { run: run.to_owned(), source })?;
    let settings_of_recogniser = learning.map(|chosen| chosen.settings);
    let example = example(&dataset)?;
    let held = (scales.as_deref(), settings_of_recogniser.as_ref());
    let recogniser = Recogniser::new(preprocess, &descriptor, held, database.clone()).map_err(winner)?;
    let vector = |recogniser: &Recogniser, example: &Example| {
        test_vector(recogniser, family, example).map_err(|error| ExportError::Cloud {
            path: dataset.clouds.root.join(&example.cloud),
            what: error.to_string(),
        })
    };
    let (vector_text, verdict) = vector(&recogniser, &example)?;
    // The run's own answers are those of the nearest cloud.
    if chosen == Chosen::Evolved
        && learning.is_none()
        && let Some(recorded) = results::read_predictions(run, PredictionSplit::Test)?.first()
    {
        compare(&example, recorded_verdict(recorded), &verdict)?;
    }

    let failed = |source| ExportError::Write { folder: out.to_owned(), source };
    let new = NewFolder::beside(out, Access::Umask).map_err(failed)?;
    let digest = results::write_database(new.path().join(DATABASE), &database)?;
    let sections = of_one(&preprocess, &descriptor).map_err(|error| winner(Message::of(&error).what))?;
    let (raw_preprocess, raw_descriptor) = sections;
    let settings = Settings {
        version: VERSION,
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
        database: DatabaseSettings {
            clouds: database.clouds.len() as u32,
            digest: digest.to_hex().to_string(),
            scales: scales.clone(),
        },
        test_vector: TestVectorSettings { digest: blake3::hash(vector_text.as_bytes()).to_hex().to_string() },
    };
    let settings = settings.seal().map_err(|error| winner(error.to_string()))?;
    let clouds = &database.clouds;
    let scales = scales.as_deref().unwrap_or_default();
    let about = About {
        finished: &finished,
        chosen: &chosen,
        descriptor: &descriptor,
        scales,
        preprocess,
        clouds,
        learning,
    };
    for (name, bytes) in [
        (SETTINGS, settings.as_bytes()),
        (TEST_VECTOR, vector_text.as_bytes()),
        (EXAMPLE, &example.bytes),
        (README, about.text().as_bytes()),
    ] {
        new.write(name, bytes).map_err(failed)?;
    }

    // Read back what is on the disk: it must say of its example what was said before.
    let written = Recogniser::open(new.path())?;
    let bytes = fs::read(new.path().join(EXAMPLE)).map_err(failed)?;
    let (again, got) = vector(&written, &Example { bytes, ..example.clone() })?;
    let on_disk = fs::read(new.path().join(TEST_VECTOR)).map_err(failed)?;
    if again.as_bytes() != on_disk {
        compare(&example, verdict.clone(), &got)?;
        let (expected, got) = ("that of its test vector".to_owned(), "another summary".to_owned());
        return Err(ExportError::Answer { example: example.cloud, expected, got });
    }
    let mut bytes = 0;
    for name in FILES {
        bytes += fs::metadata(new.path().join(name)).map_err(failed)?.len();
    }
    refuse_occupied(out)?;
    new.replace(out).map_err(failed)?;
    Ok(Exported {
        descriptor,
        clouds: clouds.len(),
        example: example.cloud,
        answer: verdict.to_string(),
        recogniser: described(learning),
        bytes,
    })
}

/// The settings that recognise most reference clouds by those of other sequences or folds.
fn learning(
    method: Method,
    dataset: &Dataset,
    channels: &[(&Signatures, SetDistance, f64)],
    database: &results::Database,
) -> Result<Option<recogniser::Chosen>, LearnError> {
    let objects: Vec<u32> = labels(&database.clouds).iter().map(|label| label.instance).collect();
    let sequence = |&cloud: &u32| dataset.clouds.entries[cloud as usize].sequence;
    let sequences: Vec<Option<u32>> = Matching::Test.database_clouds(dataset).iter().map(sequence).collect();
    recogniser::Chosen::new(method, &LabelledClouds { channels, objects: &objects }, &sequences)
}

/// How objects are named, in a line.
fn described(learning: Option<recogniser::Chosen>) -> String {
    match learning {
        Some(chosen) => format!("{}: {}", chosen.settings.method().name(), chosen.settings),
        None => Method::Nearest.name().to_owned(),
    }
}

/// The run's winner.
fn evolved(run: &Path, space: &SearchSpace, genes: &[Option<f64>]) -> Result<Descriptor, ExportError> {
    of_family(run, space)?;
    let what = "gene values must lie on the genes' grids, got others";
    let other = || ExportError::Winner { run: run.to_owned(), what: what.to_owned() };
    space.from_values(genes).ok_or_else(other)
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

/// Refuses a place that holds something else than an artefact, so that nobody's files are lost.
fn refuse_occupied(out: &Path) -> Result<(), ExportError> {
    let occupied = |got: String| Err(ExportError::Occupied { folder: out.to_owned(), got });
    let entries = match fs::read_dir(out) {
        Ok(entries) => entries,
        Err(_) if !out.exists() => return Ok(()),
        Err(_) if !out.is_dir() => return occupied("a file".to_owned()),
        Err(source) => return Err(ExportError::Write { folder: out.to_owned(), source }),
    };
    let names: Vec<OsString> = entries.flatten().map(|entry| entry.file_name()).collect();
    match names.iter().find(|&name| FILES.iter().all(|file| name != file)) {
        Some(other) => occupied(format!("a folder with {}", Path::new(other).display())),
        None => Ok(()),
    }
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

/// The signatures of the final test's database, in its order.
fn describe(
    dataset: &Dataset,
    preprocess: &Preprocess,
    descriptor: &Descriptor,
    winner: impl Fn(String) -> ExportError,
) -> Result<results::Database, ExportError> {
    let describer = Describer::new(descriptor).map_err(|error| winner(error.to_string()))?;
    let entries: Vec<&CloudEntry> = Matching::Test
        .database_clouds(dataset)
        .iter()
        .map(|&index| &dataset.clouds.entries[index as usize])
        .collect();
    let signatures: Vec<Vec<Signature>> = entries
        .par_iter()
        .map(|&entry| {
            let failed = |what: String| ExportError::Cloud { path: dataset.clouds.file(entry), what };
            let cloud = pcd::read(&read(dataset, entry)?).map_err(|error| failed(error.to_string()))?;
            let cloud = preprocess.in_metres(&cloud);
            let described = stages(&cloud, preprocess, &describer, &mut Seconds::default());
            Ok(described.map_err(|error| failed(error.to_string()))?.signatures)
        })
        .collect::<Result<_, ExportError>>()?;
    let part = |channel: usize| DatabasePart {
        centroids: signatures.iter().flat_map(|cloud| &cloud[channel].centroid).copied().collect(),
        deviations: signatures.iter().flat_map(|cloud| &cloud[channel].deviation).copied().collect(),
    };
    let parts = match descriptor {
        Descriptor::Structure(Structure { channels }) => {
            DatabaseParts::Channels((0..channels.len()).map(part).collect())
        }
        _ => DatabaseParts::ShapeColour([part(0), part(1)]),
    };
    let clouds = entries.iter().map(|&entry| labelled(dataset, entry)).collect();
    Ok(results::Database { clouds, parts })
}

/// A cloud's path and names.
fn labelled(dataset: &Dataset, entry: &CloudEntry) -> DatabaseCloud {
    DatabaseCloud {
        cloud: entry.path.clone(),
        instance: dataset.clouds.instances[entry.instance as usize].name.clone(),
        category: dataset.clouds.categories[entry.category as usize].clone(),
    }
}

/// The bytes of a cloud, which are those that the data digest covers.
fn read(dataset: &Dataset, entry: &CloudEntry) -> Result<Vec<u8>, ExportError> {
    let path: PathBuf = dataset.clouds.file(entry);
    let bytes = match read_file(&path) {
        Ok(bytes) => bytes,
        Err(reason) => {
            let what = format!("cannot be read, got {reason}\nexport again when it is there");
            return Err(ExportError::Cloud { path, what });
        }
    };
    if *blake3::hash(&bytes).as_bytes() != entry.digest {
        let what = "content must stay the same during the export, got another\nexport again".to_owned();
        return Err(ExportError::Cloud { path, what });
    }
    Ok(bytes)
}

/// The first cloud of the final test, or of its database where nothing is tested.
fn example(dataset: &Dataset) -> Result<Example, ExportError> {
    let database = Matching::Test.database_clouds(dataset);
    let first = Matching::Test.query_clouds(dataset).first().or(database.first());
    // A data set without any training cloud is refused when it is loaded.
    let index = first.copied().unwrap_or_default();
    let entry = &dataset.clouds.entries[index as usize];
    let DatabaseCloud { cloud, instance, category } = labelled(dataset, entry);
    Ok(Example { cloud, instance, category, bytes: read(dataset, entry)? })
}

fn recorded_verdict(row: &PredictionRow) -> Verdict {
    let runner_up = row.runner_up.as_ref().map(|other| (other.cloud.clone(), other.distance));
    Verdict { nearest_cloud: row.nearest_cloud.clone(), distance: row.distance, runner_up }
}

/// Refuses an answer to the example that is not the expected one, bit for bit.
fn compare(example: &Example, expected: Verdict, got: &Verdict) -> Result<(), ExportError> {
    if expected == *got {
        return Ok(());
    }
    let (expected, got) = (expected.to_string(), got.to_string());
    Err(ExportError::Answer { example: example.cloud.clone(), expected, got })
}
