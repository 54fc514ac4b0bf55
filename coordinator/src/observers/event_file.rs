//! Writes events into a file as they happen, one JSON object a line.

use std::io;
use std::path::{Path, PathBuf};

use cluster::Cluster;
use cluster::events::EventCursor;
use tokio::fs::{File, OpenOptions};
use tokio::io::AsyncWriteExt as _;
use tokio::sync::oneshot;
use tokio::task::JoinHandle;

use crate::console::say;

/// Why events cannot be written.
#[derive(Debug, thiserror::Error)]
#[error(
    "--events {path}: cannot be written, got {source}\nname a file in a folder that exists and may be written to"
)]
pub struct EventFileError {
    path: PathBuf,
    source: io::Error,
}

/// A file that follows a run.
pub struct EventFile {
    path: PathBuf,
    /// Ends the task once it has written what is there.
    stop: oneshot::Sender<()>,
    task: JoinHandle<io::Result<()>>,
}

impl EventFile {
    /// Follows a cluster, if there is a file to write to.
    ///
    /// # Errors
    /// If it cannot be opened.
    pub async fn open(path: Option<&Path>, cluster: &Cluster) -> Result<Option<Self>, EventFileError> {
        let Some(path) = path else { return Ok(None) };
        let failed = |source| EventFileError { path: path.to_owned(), source };
        Self::follow(path, cluster.events()).await.map(Some).map_err(failed)
    }

    /// Appends to the file at `path` from now on.
    ///
    /// # Errors
    /// If it cannot be opened.
    async fn follow(path: &Path, events: EventCursor) -> io::Result<Self> {
        let file = OpenOptions::new().create(true).append(true).open(path).await?;
        let (stop, stopped) = oneshot::channel();
        Ok(Self { path: path.to_owned(), stop, task: tokio::spawn(write(file, events, stopped)) })
    }

    /// Writes the events that are left. That some could not be written is no reason for a run to fail.
    pub async fn finish(file: Option<Self>) {
        let Some(Self { path, stop, task }) = file else { return };
        let _ = stop.send(()); // the task may have ended with an error
        let written = task.await.map_err(io::Error::other).and_then(|written| written);
        if let Err(error) = written {
            let path = path.display();
            say(format_args!(
                "warning: --events {path}: some events are missing, got {error}\ncheck the free space"
            ));
        }
    }
}

async fn write(
    mut file: File,
    mut events: EventCursor,
    mut stopped: oneshot::Receiver<()>,
) -> io::Result<()> {
    let mut last = false;
    while !last {
        tokio::select! {
            () = events.wait() => {}
            _ = &mut stopped => last = true,
        }
        for event in events.read_to_end() {
            let mut line = serde_json::to_vec(&*event)?;
            line.push(b'\n');
            file.write_all(&line).await?;
        }
        file.flush().await?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::time::SystemTime;

    use cluster::events::{Event, EventKind, EventLog};

    use super::*;

    #[tokio::test]
    async fn every_event_is_a_line_and_a_second_start_goes_on_with_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("events.jsonl");
        let rewind = |generation| EventKind::Rewind { generation, why: "why\n".to_owned() };
        let mut earlier: Vec<Event> = Vec::new();
        for start in 0..2 {
            let log = Arc::new(EventLog::new(earlier.clone()));
            let file = EventFile::follow(&path, log.follow()).await.unwrap();
            for generation in 0..2000 {
                log.append(SystemTime::UNIX_EPOCH, rewind(start * 2000 + generation));
            }
            EventFile::finish(Some(file)).await;
            earlier = log.follow_from_first().read_to_end().iter().map(|event| Event::clone(event)).collect();
        }
        let text = std::fs::read_to_string(&path).unwrap();
        let events: Vec<Event> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        assert_eq!(events, earlier);
    }

    #[tokio::test]
    async fn a_file_that_cannot_be_opened_is_an_error_before_anything_is_run() {
        let log = Arc::new(EventLog::new(Vec::new()));
        assert!(EventFile::follow(Path::new("/dev/null/events"), log.follow()).await.is_err());
    }
}
