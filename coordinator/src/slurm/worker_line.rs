//! How a worker is started as a job of Slurm, and paths as words of a shell.

use std::borrow::Cow;
use std::path::Path;

use super::SlurmError;

/// Minutes of an allocation, at most: a year.
pub const MOST_MINUTES: i64 = 366 * 24 * 60;
/// Seconds before the end of its allocation by which a worker has left, and the least that it is given.
const MARGIN_SECONDS: u32 = 60;
/// Seconds without a job after which a worker gives its allocation back.
pub const IDLE_SECONDS: u32 = 900;

/// The line that starts a worker in its allocation, with all of its processors, which newer versions of `srun` do not
/// take from the job. The worker leaves before its time is over, gives its allocation back when there is nothing to do,
/// and is queued again when it is preempted. `coordinator` is the option that says where that is.
///
/// # Errors
/// If the path of the program cannot stand in a command.
pub fn worker_line(
    worker: &Path,
    coordinator: &str,
    threads: u32,
    minutes: u32,
) -> Result<String, SlurmError> {
    let (worker, lifetime) = (quoted_path(worker)?, minutes * 60 - MARGIN_SECONDS);
    Ok(format!(
        "exec srun --cpus-per-task={threads} {worker} {coordinator} --threads {threads} --idle-timeout {IDLE_SECONDS} --lifetime {lifetime} --on-term requeue"
    ))
}

/// A path as one word of a shell.
///
/// # Errors
/// If it is not UTF-8, or cannot stand in a command.
pub fn quoted_path(path: &Path) -> Result<String, SlurmError> {
    quoted(path.to_str().ok_or_else(|| SlurmError::NoText(path.to_owned()))?)
}

/// A text as one word of a shell.
///
/// # Errors
/// If it cannot stand in a command.
pub fn quoted(text: &str) -> Result<String, SlurmError> {
    shlex::try_quote(text).map(Cow::into_owned).map_err(|_| SlurmError::NoWord(text.to_owned()))
}
