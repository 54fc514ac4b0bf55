//! A run that was begun before: its journal, checked to be of the same search, clouds and numbers.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use proto::SessionId;
use results::RunFolder;

use crate::dataset::Dataset;
use crate::experiment::{Overrides, Plan};
use crate::run::directory::{refuse_other_search, refuse_other_version};
use crate::run::{RunError, clouds, data_digest, refuse_other_data};
use crate::sweep::SWEEP_FILE;
use crate::sweep::recorded_sweep;
use cluster::journal::{
    EARLIER_JOURNAL_FILE, Header, JOURNAL_FILE, Journal, JournalError, JournalFile, Recorded,
};
use cluster::scheduler::RunSecret;

/// The journal in `folder`, at work, of what `search` determines and `record` tells in full; a new one if the folder has
/// none, or none that says what it is of: then the generations that are there are compared with what is computed again.
/// `runs`: the folders of the runs that it is of, which must not have tables where there is no journal, unless they are
/// finished: nothing says which clouds and answers they rest on.
pub fn open_journal(
    (search, record): (String, String),
    dataset: &Dataset,
    folder: &Path,
    now: SystemTime,
    runs: &[PathBuf],
) -> Result<(Header, Journal, Recorded), RunError> {
    let path = folder.join(JOURNAL_FILE);
    let this = Header {
        search,
        experiment: record,
        data_digest: data_digest(dataset),
        evaluation_version: descriptor::EVALUATION_VERSION,
        session: SessionId(rand::random()),
        secret: RunSecret::new(rand::random()),
        started_at: now,
    };
    if !path.exists() {
        refuse_earlier(folder)?;
        if let Some(folder) = runs.iter().find(|run| lacks_journal(run)) {
            return Err(RunError::JournalGone { folder: folder.clone() });
        }
        JournalFile::create(&path, &this)?;
    }
    // To open a journal is to write to it: one that is another's is refused as it is. What is damaged, `open` repairs.
    if let Ok(header) = JournalFile::header(&path) {
        refuse_another(folder, &header, &this, dataset)?;
    }
    let (file, header, recorded) = match JournalFile::open(&path) {
        // That the folder is this search's, its search.toml has said.
        Err(JournalError::Damaged { .. }) => {
            JournalFile::replace(&path, &this)?;
            JournalFile::open(&path)
        }
        opened => opened,
    }?;
    refuse_another(folder, &header, &this, dataset)?;
    clouds::keep(folder, dataset)?;
    Ok((header, Journal::start(file)?, recorded))
}

/// Whether a folder without a journal has tables of a run that is not finished.
fn lacks_journal(run: &Path) -> bool {
    RunFolder::has_tables(run) && matches!(results::read_run(run), Err(results::Error::Unfinished(_)))
}

/// Refuses a folder whose journal an earlier build has written.
fn refuse_earlier(folder: &Path) -> Result<(), JournalError> {
    let earlier = folder.join(EARLIER_JOURNAL_FILE);
    if earlier.exists() { Err(JournalError::earlier(&earlier)) } else { Ok(()) }
}

fn refuse_another(folder: &Path, then: &Header, now: &Header, dataset: &Dataset) -> Result<(), RunError> {
    refuse_other_search(folder, &then.search, &now.search)?;
    refuse_other_version(folder, then.evaluation_version)?;
    refuse_other_data(folder, &then.data_digest, dataset)
}

/// Removes the journal of a finished run, if it is still there: the tables have everything.
pub fn remove_journal(folder: &Path) {
    let journal = folder.join(JOURNAL_FILE);
    match atomic::remove(&journal) {
        Err(error) if error.kind() != ErrorKind::NotFound => {
            tracing::warn!("{}: cannot be removed, got {error}", journal.display());
        }
        _ => {}
    }
}

/// What the run or sweep in a folder was started with, finished or not.
pub fn recorded_plan(folder: &Path, overrides: Overrides) -> Result<Plan, RunError> {
    if let Some(record) = recorded_sweep(folder)? {
        return Ok(Plan::from_record(&record, folder, overrides)?);
    }
    let record = match results::read_run(folder) {
        Ok(finished) => finished.row.resolved_toml,
        Err(results::Error::Unfinished(_)) => {
            let path = folder.join(JOURNAL_FILE);
            if !path.is_file() {
                refuse_earlier(folder)?;
                let folder = folder.to_owned();
                return Err(match folder.parent().filter(|parent| parent.join(SWEEP_FILE).is_file()) {
                    Some(sweep) => RunError::MemberOfSweep { sweep: sweep.to_owned(), folder },
                    None if lacks_journal(&folder) => RunError::JournalGone { folder },
                    None => RunError::NothingToResume { folder },
                });
            }
            JournalFile::header(&path)?.experiment
        }
        Err(error) => return Err(error.into()),
    };
    Ok(Plan::from_record(&record, folder, overrides)?)
}
