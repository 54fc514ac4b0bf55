//! The file that says where the coordinator is: it may come after the worker, and name another place each time that a batch
//! system starts the coordinator.

use std::fs::File;
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};
use std::time::Duration;

use proto::JoinAddress;
use tokio::task::{JoinHandle, spawn_blocking};

use crate::link::Coordinator;

/// The longest address that is read from a file, bytes.
const MAX_ADDRESS_BYTES: u64 = 4096;
/// Reading that takes longer hangs, as on a network file system whose server is gone.
const READING: Duration = Duration::from_secs(10);

/// A file with a join address, and what was made of it last.
pub struct JoinFile {
    path: PathBuf,
    /// Folder of a certificate to show.
    identity: Option<PathBuf>,
    coordinator: Coordinator,
    /// The address that was read last; nothing of it is ever shown.
    text: Option<String>,
    /// On a thread of its own, and only one however long it hangs.
    reading: Option<JoinHandle<Result<String, String>>>,
}

impl JoinFile {
    /// The file at `path`, which need not be there yet.
    pub fn new(path: PathBuf, identity: Option<PathBuf>, coordinator: Coordinator) -> Self {
        Self { path, identity, coordinator, text: None, reading: None }
    }

    /// Reads the file again; the address if it is another one than before. May be dropped at any time.
    ///
    /// # Errors
    /// Why there is no address, for people: the file is not there yet, or not written yet, or reading it hangs.
    pub async fn refresh(&mut self) -> Result<Option<JoinAddress>, String> {
        self.refresh_within(READING).await
    }

    async fn refresh_within(&mut self, patience: Duration) -> Result<Option<JoinAddress>, String> {
        let text = self.read(patience).await?;
        if self.text.as_ref() == Some(&text) {
            return Ok(None);
        }
        let invalid = |what: &dyn std::fmt::Display| format!("{}: {what}", self.path.display());
        let address: JoinAddress = text.parse().map_err(|error| invalid(&error))?;
        encrypted_if_shown(&address, self.identity.as_deref()).map_err(|error| invalid(&error))?;
        self.coordinator.move_to(&address, self.identity.as_deref()).map_err(|error| invalid(&error))?;
        self.text = Some(text);
        Ok(Some(address))
    }

    /// What the file holds now, or held when a reading began that has hung since.
    async fn read(&mut self, patience: Duration) -> Result<String, String> {
        let path = self.path.clone();
        let reading = self.reading.get_or_insert_with(|| spawn_blocking(move || read_address(&path)));
        let Ok(read) = tokio::time::timeout(patience, reading).await else {
            return Err(format!(
                "{}: cannot be read, got no answer from its file system for {} s\nlook after that file system",
                self.path.display(),
                patience.as_secs()
            ));
        };
        self.reading = None;
        read.map_err(|error| format!("{}: cannot be read, got {error}", self.path.display()))?
    }
}

/// Refuses an address in plain text for a worker that has a certificate to show.
pub fn encrypted_if_shown(address: &JoinAddress, identity: Option<&Path>) -> Result<(), String> {
    if identity.is_some() && address.trust.is_none() {
        return Err(format!(
            "--tls: needs an encrypted connection, got {address}\nuse a join address that begins with https://"
        ));
    }
    Ok(())
}

/// The first line of a small file.
///
/// # Errors
/// Why there is none, for people.
pub fn read_address(path: &Path) -> Result<String, String> {
    let advice = "copy the join address that `coordinator certs` has made there";
    let mut text = String::new();
    let read = File::open(path).and_then(|file| file.take(MAX_ADDRESS_BYTES).read_to_string(&mut text));
    read.map_err(|error| match error.kind() {
        io::ErrorKind::NotFound => format!("{}: is not there\n{advice}", path.display()),
        _ => format!("{}: cannot be read, got {error}\n{advice}", path.display()),
    })?;
    Ok(text.lines().next().unwrap_or_default().trim().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_file_may_come_late_be_half_written_and_change() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("join");
        let coordinator = Coordinator::default();
        let mut file = JoinFile::new(path.clone(), None, coordinator.clone());
        assert!(file.refresh().await.unwrap_err().contains("join: is not there\n"));
        assert_eq!(coordinator.place(), None);

        for half in ["", "http://", "https://gpu-host:7700#ca="] {
            std::fs::write(&path, half).unwrap();
            let why = file.refresh().await.unwrap_err();
            assert!(why.contains("join: join address: "), "{why}");
        }
        let mut at = async |text: &str| {
            std::fs::write(&path, text).unwrap();
            let address = file.refresh().await.unwrap();
            (address.map(|address| address.host), coordinator.place())
        };
        let place = |host: &str, port| Some((host.to_owned(), port));
        assert_eq!(at("http://one:7700\n").await, (Some("one".to_owned()), place("one", 7700)));
        assert_eq!(at("http://one:7700\nanother line").await, (None, place("one", 7700)));
        assert_eq!(at("http://two:7701").await, (Some("two".to_owned()), place("two", 7701)));
    }

    #[tokio::test]
    async fn reading_that_hangs_is_given_up_for_now_and_begun_once() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("join");
        // Opening it waits until somebody writes.
        assert!(std::process::Command::new("mkfifo").arg(&path).status().unwrap().success());
        let coordinator = Coordinator::default();
        let mut file = JoinFile::new(path.clone(), None, coordinator.clone());
        for _ in 0..3 {
            let why = file.refresh_within(Duration::from_millis(10)).await.unwrap_err();
            assert!(why.contains("join: cannot be read, got no answer"), "{why}");
        }
        std::thread::spawn(move || std::fs::write(&path, "http://one:7700").unwrap());
        assert_eq!(file.refresh().await.unwrap().map(|address| address.port), Some(7700));
        assert_eq!(coordinator.place(), Some(("one".to_owned(), 7700)));
    }
}
