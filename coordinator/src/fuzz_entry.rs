//! What reads bytes from outside, one function a reader, for the fuzz driver of `tests/`: each takes anything, returns
//! whether it was accepted, and must not panic, hang or reserve memory on the word of its input.

use std::path::Path;
use std::time::{Duration, SystemTime};

use proto::journal::{AcceptedResult, Assurance};
use proto::task::{EvaluationResult, TaskResult};
use proto::{JobId, Principal, SessionId, WorkerId};

use crate::experiment::{Experiment, Overrides};
use cluster::journal;
use cluster::scheduler::RunSecret;

/// An experiment as TOML.
pub fn experiment(text: &str) -> bool {
    Experiment::from_record(text, Path::new("experiment.toml"), None, Overrides::default()).is_ok()
}

/// The settings of an artefact.
pub fn artefact_settings(text: &str) -> bool {
    crate::export::reads_settings(text)
}

/// Sound settings of artefacts.
pub fn sample_artefact_settings() -> [String; 2] {
    crate::export::sample_settings()
}

/// What is known of the camera of images: a corner, or the cameras of a scene.
pub fn camera(bytes: &[u8]) -> bool {
    crate::dataset::reads_camera(bytes)
}

/// The objects of a scene.
pub fn scene_objects(bytes: &[u8]) -> bool {
    crate::dataset::reads_objects(bytes)
}

/// A table of another program that names clouds.
pub fn manifest_table(bytes: &[u8]) -> bool {
    crate::dataset::reads_texts(bytes)
}

/// An operator's request to a coordinator at work, or the answer to it.
pub fn control(bytes: &[u8]) -> bool {
    crate::control::reads(bytes)
}

/// A sound request, as a file has it.
pub fn sample_request() -> Vec<u8> {
    crate::control::sample()
}

/// A poll of a worker.
pub fn poll(bytes: &[u8]) -> bool {
    transport::reads_poll(bytes)
}

/// What a worker fetches by.
pub fn fetch(bytes: &[u8]) -> bool {
    transport::reads_fetch(bytes)
}

/// An answer as a journal keeps it; what is accepted is written again as it was read.
pub fn journal_answer(bytes: &[u8]) -> bool {
    AcceptedResult::decode(bytes).is_some()
}

/// The header of a journal.
pub fn journal_header(bytes: &[u8]) -> bool {
    journal::Header::decode(bytes, Path::new(journal::JOURNAL_FILE)).is_ok()
}

/// A journal with an answer, made at `path`: its bytes.
pub fn sample_journal(path: &Path) -> Option<Vec<u8>> {
    let header = journal::Header {
        search: "seed = 1\n".to_owned(),
        experiment: "version = 1\n".to_owned(),
        data_digest: "00".to_owned(),
        evaluation_version: descriptor::EVALUATION_VERSION,
        session: SessionId([7; 16]),
        secret: RunSecret::new([8; 32]),
        started_at: SystemTime::UNIX_EPOCH,
    };
    let (queries, object_correct, category_correct) = (9, 5, 6);
    let counts =
        EvaluationResult { queries, object_correct, category_correct, ..EvaluationResult::default() };
    let result = TaskResult::Evaluation(counts);
    let answer = AcceptedResult {
        result,
        worker_id: WorkerId([1; 16]),
        worker: "rack".to_owned(),
        principal: Principal::Coordinator,
        seconded: None,
        assurance: Assurance::Own,
        attempt: 1,
        queued: Duration::from_secs(1),
        run_seconds: 0.5,
    };
    journal::JournalFile::create(path, &header).ok()?;
    let (file, ..) = journal::JournalFile::open(path).ok()?;
    file.commit(&[journal::Entry::Accepted(JobId(1), Box::new(answer))]).ok()?;
    drop(file);
    std::fs::read(path).ok()
}

/// A journal's file, whole.
pub fn journal_file(path: &Path) -> bool {
    journal::JournalFile::open(path).is_ok()
}
