//! The operator's side: writes a request, and waits for what the coordinator at work makes of it.

use std::fs;
use std::io::ErrorKind;
use std::path::Path;
use std::thread;
use std::time::{Duration, Instant};

use cluster::events::ControlAction;

use super::folder::{ControlError, Place, read};
use super::message::{Answer, Request};

/// How long [`request`] waits for an answer: over a network file system it may take longer until it is seen.
pub const WAIT: Duration = Duration::from_secs(10);
/// How often it looks for one.
const LOOK: Duration = Duration::from_millis(50);
/// How often it looks whether there is still a coordinator.
const LOOK_AT_WORK: Duration = Duration::from_millis(500);
/// How long it waits for the answer to a request that was taken at the last moment.
const AFTER_TAKEN: Duration = Duration::from_secs(5);

/// Has the coordinator at work on `run` (the folder of a run, of a sweep, or of a run of a sweep) carry out a request. Gives
/// its answer, a line for people. Waits: not to be called where other work would have to wait as well.
///
/// # Errors
/// If it was not carried out.
pub fn request(run: &Path, request: &Request) -> Result<String, ControlError> {
    request_within(run, request, WAIT)
}

/// The same with another patience.
///
/// # Errors
/// As of [`request`].
pub fn request_within(run: &Path, request: &Request, wait: Duration) -> Result<String, ControlError> {
    let place = Place::of(run)?;
    if place.is_grid && matches!(request.action, ControlAction::Priority { .. }) {
        let refused =
            "priority: must be of one run of a sweep, got a grid\na grid has all workers of its coordinator";
        return Err(ControlError::Refused(refused.to_owned()));
    }
    request.check(place.member.is_some()).map_err(ControlError::Refused)?;
    place.check_at_work()?;
    let [file, answer] = place.files();
    write(&file, &request.encode(place.member.as_deref()))?;
    let mut deadline = Instant::now() + wait;
    let mut next_look = Instant::now() + LOOK_AT_WORK;
    let mut given_up = None;
    loop {
        match read(&answer) {
            Ok(bytes) => {
                let _ = fs::remove_file(&answer); // else the coordinator does, at its end
                let invalid = |what| ControlError::Answer { path: answer.clone(), what };
                return match Answer::decode(&bytes).map_err(invalid)? {
                    Answer::Done(done) => Ok(shown(&done)),
                    Answer::Error(error) => Err(ControlError::Refused(shown(&error))),
                };
            }
            Err(error) if error.kind() == ErrorKind::NotFound => {}
            Err(source) => return Err(ControlError::File { path: answer, source }),
        }
        let now = Instant::now();
        if let Some(error) = given_up.take_if(|_| now >= deadline) {
            return Err(error);
        }
        if given_up.is_none() {
            let mut gone = None;
            if now >= next_look {
                gone = place.check_at_work().err();
                next_look = now + LOOK_AT_WORK;
            }
            if gone.is_some() || now >= deadline {
                match fs::remove_file(&file) {
                    Ok(()) => {
                        let (folder, seconds) = (place.named(), wait.as_secs());
                        return Err(gone.unwrap_or(ControlError::NotTaken { folder, seconds }));
                    }
                    // It was taken a moment ago: the answer is on its way, unless the coordinator ended.
                    Err(error) if error.kind() == ErrorKind::NotFound => {
                        given_up = Some(gone.unwrap_or_else(|| ControlError::NoAnswer(place.named())));
                        deadline = now + AFTER_TAKEN;
                    }
                    Err(source) => return Err(ControlError::File { path: file, source }),
                }
            }
        }
        thread::sleep(LOOK);
    }
}

/// Writes a request into its folder, which is made for the first and removed after the last.
fn write(file: &Path, bytes: &[u8]) -> Result<(), ControlError> {
    let failed = |source| ControlError::File { path: file.to_owned(), source };
    let written = || {
        file.parent().map_or(Ok(()), fs::create_dir_all)?;
        atomic::write(file, bytes)
    };
    match written() {
        // The coordinator has just removed it, empty.
        Err(error) if error.kind() == ErrorKind::NotFound => written().map_err(failed),
        written => written.map_err(failed),
    }
}

/// A text of others, line by line.
fn shown(text: &str) -> String {
    text.lines().map(proto::printable).collect::<Vec<_>>().join("\n")
}
