//! The data set of an experiment: made first if it is synthetic, then loaded and checked.

use std::path::{Path, PathBuf};
use std::{fs, io};

use atomic::{Access, NewFolder};
use cache::Store;
use descriptor::QuantiseError;
use descriptor::pcd::{self, DataEncoding};
use descriptor::synth::{self, SynthError, SynthSettings};
use rayon::prelude::*;

use crate::dataset::{Dataset, DatasetError, SyntheticSettings, Wanted, read_file};
use crate::experiment::Experiment;
use crate::run::matching::Matching;
use crate::shared_bucket::BucketError;

/// File that says how a synthetic data set was made.
const STAMP: &str = "synthetic.toml";

/// Why a data set is not there.
#[derive(Debug, thiserror::Error)]
pub enum DataError {
    /// It cannot be loaded.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// The bucket that machines share.
    #[error(transparent)]
    Bucket(#[from] BucketError),
    /// The search space is too fine.
    #[error("descriptor.genes: {0}")]
    Genes(#[from] QuantiseError),
    /// The settings of a synthetic data set.
    #[error(transparent)]
    Settings(#[from] SynthError),
    /// A file of a synthetic data set.
    #[error(
        "{path}: cannot be written, got {source}\ncheck permissions and free space, or choose another folder"
    )]
    Write {
        /// Which file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// The folder holds something else.
    #[error(
        "{folder}: must be a new folder or a data set made with the same settings, got another one\nchoose another folder, or remove this one"
    )]
    Occupied {
        /// Which folder.
        folder: PathBuf,
    },
}

/// Makes the data set if it is synthetic and not there yet, and loads what is wanted of it ([`Dataset::load`]).
pub fn open_data(
    experiment: &Experiment,
    wanted: Wanted,
    store: Option<&Store>,
    say: impl Fn(&str),
) -> Result<Dataset, DataError> {
    // A search space that cannot be quantised would fail in every evaluation: say so before anything is read.
    experiment.space().preparer()?;
    let settings = experiment.dataset();
    if let Some(synthetic) = &settings.synthetic
        && write_synthetic(&settings.root, synthetic)?
    {
        say(&format!(
            "made {} synthetic clouds in {}",
            synthetic.objects * synthetic.views,
            shown(&settings.root)
        ));
    }
    let dataset = Dataset::load(settings, experiment.preprocess(), wanted, store)?;
    let of_splits = Matching::ALL.into_iter().filter_map(|matching| {
        let counts_all = experiment.fitness().parts(matching).iter().all(|part| part.rule.is_default());
        let (&[query], database) = matching.splits();
        dataset.unrecognisable(query, database).filter(|_| counts_all)
    });
    for warning in dataset.clouds.warnings.iter().cloned().chain(of_splits) {
        say(&format!("warning: {warning}"));
    }
    for skipped in &dataset.clouds.skipped {
        say(&format!("skipped {} ({}): {}", skipped.path, skipped.split, skipped.reason));
    }
    Ok(dataset)
}

/// A path as people read it: without detours, from the current folder if it lies below it.
fn shown(path: &Path) -> String {
    let real = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    let here = Path::new(".").canonicalize().unwrap_or_default();
    real.strip_prefix(&here).unwrap_or(&real).display().to_string()
}

/// Writes a synthetic data set, whole or not at all; `false` if it was there already.
pub fn write_synthetic(folder: &Path, settings: &SyntheticSettings) -> Result<bool, DataError> {
    let SyntheticSettings { objects, views, seed } = *settings;
    let settings = SynthSettings::new(objects, views, seed)?;
    let version = synth::GENERATOR_VERSION;
    let stamp = format!("version = {version}\nobjects = {objects}\nviews = {views}\nseed = {seed}\n");
    let is_there = || read_file(&folder.join(STAMP)).is_ok_and(|held| held == stamp.as_bytes());
    if is_there() {
        return Ok(false);
    }
    let failed = |path: &Path, source| DataError::Write { path: path.to_owned(), source };
    let occupied = fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_some());
    if occupied || folder.is_file() {
        return Err(DataError::Occupied { folder: folder.to_owned() });
    }

    // So that an interrupted start leaves nothing half-made behind.
    let new = NewFolder::beside(folder, Access::Umask).map_err(|source| failed(folder, source))?;
    let write = |name: &str, bytes: &[u8]| {
        new.write(name, bytes).map_err(|source| failed(&new.path().join(name), source))
    };
    synth::catalogue(&settings).par_iter().try_for_each(|object| {
        (0..views).try_for_each(|view| {
            let cloud = synth::render(&settings, object, view);
            write(&object.path(view), &pcd::write(&cloud, DataEncoding::BinaryCompressed))
        })
    })?;
    let splits = synth::splits(&settings);
    let lists = [
        ("train1", &splits.train1),
        ("train2", &splits.train2),
        ("validation", &splits.validation),
        ("test", &splits.test),
    ];
    for (name, paths) in lists {
        write(&format!("{name}.txt"), format!("{}\n", paths.join("\n")).as_bytes())?;
    }
    write(STAMP, stamp.as_bytes())?;
    match new.commit(folder) {
        Ok(()) => Ok(true),
        // Another run has made the same data set in the meantime.
        Err(_) if is_there() => Ok(false),
        Err(source) => Err(failed(folder, source)),
    }
}
