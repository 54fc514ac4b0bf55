//! Looks at the test clouds of a finished run by commands that need no workers of it, noted in its folder.

use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant, SystemTime};

use rayon::prelude::*;
use results::{LookRow, RunFolder};

use crate::dataset::{SPLITS, cloud_bytes};
use crate::experiment::{Experiment, Overrides};
use crate::reopen::{ReopenError, finished};
use crate::run::{clouds, rows};

/// How long to wait for others that note a look in the same run, as several commands at once do.
const PATIENCE: Duration = Duration::from_secs(5);

/// Why a look cannot be noted.
#[derive(Debug, thiserror::Error)]
pub enum LookError {
    /// The run cannot be opened.
    #[error(transparent)]
    Run(#[from] ReopenError),
    /// It does not say which its clouds are, or another list than its own does.
    #[error(
        "{run}: clouds.tsv must be the list of the run's clouds, got another or none\nput back what the run has written: without it, nobody knows its test clouds"
    )]
    Clouds {
        /// The run.
        run: PathBuf,
    },
}

/// A look that may be about to be taken.
#[derive(Clone, Debug)]
pub struct Look {
    /// The folder of the run.
    pub run: PathBuf,
    /// By which command.
    pub command: &'static str,
    /// What for.
    pub reason: String,
}

impl Look {
    /// Notes it if there are test clouds of the run among these files, told by their bytes; how many files are. Those that
    /// cannot be read are none.
    ///
    /// # Errors
    /// [`LookError`] if the folder has no finished run, does not list its clouds, or cannot be written to.
    pub fn note(&self, files: &[&Path], descriptor: &str) -> Result<usize, LookError> {
        let row = finished(&self.run)?.row;
        let experiment = Experiment::from_record(&row.resolved_toml, &self.run, None, Overrides::default())
            .map_err(ReopenError::from)?;
        // By a list that somebody has changed, test clouds could be asked without a look.
        let clouds = clouds::kept(&self.run, &row.data_digest)
            .ok_or_else(|| LookError::Clouds { run: self.run.clone() })?;
        let tests = clouds.iter().filter(|cloud| SPLITS[cloud.split] == "test");
        let tests: HashSet<[u8; 32]> = tests.filter_map(|cloud| cloud.digest).collect();
        let is_test = |file: &&&Path| {
            cloud_bytes(file).is_ok_and(|bytes| tests.contains(blake3::hash(&bytes).as_bytes()))
        };
        let count = files.par_iter().filter(is_test).count();
        if count > 0 {
            note(&self.run, &experiment, [self.command, &self.reason, descriptor])
                .map_err(ReopenError::from)?;
        }
        Ok(count)
    }
}

/// Notes in the folder of a run by which command its test clouds are looked at, what for, and which descriptors are
/// measured.
pub fn note(
    folder: &Path,
    experiment: &Experiment,
    [command, reason, descriptors]: [&str; 3],
) -> Result<(), results::Error> {
    let columns = rows::gene_columns(experiment.space());
    let end = Instant::now() + PATIENCE;
    let run = in_turn(|| RunFolder::create(folder, &columns), || Instant::now() < end)?;
    run.record_look(&LookRow {
        at: SystemTime::now(),
        command: command.to_owned(),
        reason: reason.to_owned(),
        descriptors: descriptors.to_owned(),
    })
}

/// Opens a folder as soon as nobody else holds it, which takes a moment to find out, or as long as there is time.
fn in_turn<T>(
    mut open: impl FnMut() -> Result<T, results::Error>,
    mut is_time: impl FnMut() -> bool,
) -> Result<T, results::Error> {
    loop {
        match open() {
            Err(results::Error::InUse(_)) if is_time() => {}
            done => return done,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_waited_for_until_it_is_free_or_there_is_no_more_time() {
        let folder = tempfile::tempdir().unwrap();
        let open = || RunFolder::create(folder.path(), &[]);
        let mut held = Some(open().unwrap());
        let mut left = 2;
        let mut is_time = || {
            left -= 1;
            left >= 0
        };
        assert!(matches!(in_turn(open, &mut is_time), Err(results::Error::InUse(_))));
        assert_eq!(left, -1);
        let freed = in_turn(open, || held.take().is_some());
        assert!(freed.is_ok() && held.is_none());
    }
}
