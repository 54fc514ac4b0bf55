//! What is kept on disk between runs and shared between processes: source clouds by content, and derived entries,
//! which were computed once and can be checked. Losing one costs time, never a result.

mod entry;
mod flights;
mod folder;
mod key;
mod layout;
mod upkeep;

use std::path::Path;
use std::sync::{Mutex, PoisonError};

use proto::{Digest, MAX_BLOB_BYTES};

pub use entry::{Damage, MAX_ENTRY_BYTES};
pub use flights::Claim;
pub use key::{KeyBuilder, PREPARED_CLOUD, prepared_cloud_key};

use crate::storage::Storage;
use entry::Origin;
use flights::Flights;
use folder::Folder;

/// This machine's cache folder and the folder it shares with others, either of which may be missing. All workers of
/// a process use one store. Calls read and write files: they are not for async threads.
#[derive(Debug)]
pub struct Store {
    own: Option<Folder>,
    shared: Option<Folder>,
    origin: Mutex<Origin>,
    flights: Flights,
}

impl Store {
    /// The store with these settings; touches no file yet. `label` (a host or a worker's name) is noted in the
    /// entries it makes.
    pub fn open(storage: &Storage, label: &str) -> Self {
        let origin = Origin { producer: format!("{} on {label}", crate::BUILD), run: String::new() };
        Self {
            own: storage.cache.clone().map(|root| Folder::own(root, storage.cache_size)),
            shared: storage.shared.clone().map(Folder::shared),
            origin: Mutex::new(origin),
            flights: Flights::default(),
        }
    }

    /// Whether anything is kept at all.
    pub fn is_kept(&self) -> bool {
        self.own.is_some() || self.shared.is_some()
    }

    /// From here on, entries are made for this run (a coordinator's session).
    pub fn name_run(&self, run: String) {
        self.origin().run = run;
    }

    /// The payload of an entry, if there is a sound one. `kind` is lower-case words; `key` comes from a
    /// [`KeyBuilder`].
    pub fn get(&self, kind: &str, key: Digest) -> Option<Vec<u8>> {
        let (mut bytes, header) = self.find(kind, key)?;
        bytes.drain(..header);
        Some(bytes)
    }

    /// As [`Store::get`], from this machine's own folder only: for what changes under one key, and for results, which
    /// a folder that others write is not believed.
    pub fn get_own(&self, kind: &str, key: Digest) -> Option<Vec<u8>> {
        let (mut bytes, header) = sound(self.own.as_ref()?, &layout::derived(kind, key)?, kind, key)?;
        bytes.drain(..header);
        Some(bytes)
    }

    /// A whole entry, as it travels to another machine, if there is a sound one.
    pub fn entry(&self, kind: &str, key: Digest) -> Option<Vec<u8>> {
        self.find(kind, key).map(|(bytes, _)| bytes)
    }

    /// Keeps an entry here and in the shared folder. What cannot be kept is computed again when it is needed; the
    /// first failure of each folder is a warning.
    pub fn put(&self, kind: &str, key: Digest, payload: &[u8]) {
        let header = entry::header(kind, key, &self.origin(), payload);
        write(self.folders(), kind, key, &[&header, payload]);
    }

    /// As [`Store::put`], in this machine's own folder only: for [`Store::get_own`].
    pub fn put_own(&self, kind: &str, key: Digest, payload: &[u8]) {
        let header = entry::header(kind, key, &self.origin(), payload);
        write(&self.own, kind, key, &[&header, payload]);
    }

    /// Keeps an entry that came from another machine, if it is sound, and returns its payload.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn adopt(&self, kind: &str, key: Digest, bytes: &[u8]) -> Result<Vec<u8>, Damage> {
        let payload = entry::payload(bytes, kind, key)?.to_vec();
        write(self.folders(), kind, key, &[bytes]);
        Ok(payload)
    }

    /// The bytes with this digest, if they are kept here.
    pub fn blob(&self, digest: Digest) -> Option<Vec<u8>> {
        let own = self.own.as_ref()?;
        let path = layout::blob(digest);
        let bytes = own.read(&path, MAX_BLOB_BYTES)?;
        if Digest::of(&bytes) == digest {
            return Some(bytes);
        }
        own.drop_damaged(&path, &"entry is damaged");
        None
    }

    /// Keeps bytes whose digest this is.
    pub fn put_blob(&self, digest: Digest, bytes: &[u8]) {
        if let Some(own) = &self.own {
            own.write(&layout::blob(digest), &[bytes]);
        }
    }

    /// The right to make an entry, unless another worker of this process is making it; [`Store::landed`] waits for
    /// that. A worker that holds claims must not wait.
    pub fn claim(&self, key: Digest) -> Option<Claim<'_>> {
        // Where nothing is kept, nothing can be handed over: everybody makes its own.
        if self.is_kept() { self.flights.claim(key) } else { Some(Claim::unshared()) }
    }

    /// Ready when nobody in this process is making the entry.
    pub async fn landed(&self, key: Digest) {
        self.flights.landed(key).await;
    }

    /// A sound entry and the length of its header, from the nearest folder that has it.
    fn find(&self, kind: &str, key: Digest) -> Option<(Vec<u8>, usize)> {
        let path = layout::derived(kind, key)?;
        let sound = |folder| sound(folder, &path, kind, key);
        if let Some(found) = self.own.as_ref().and_then(sound) {
            return Some(found);
        }
        let (bytes, header) = self.shared.as_ref().and_then(sound)?;
        if let Some(own) = &self.own {
            own.write(&path, &[&bytes]);
        }
        Some((bytes, header))
    }

    fn folders(&self) -> impl Iterator<Item = &Folder> {
        [&self.own, &self.shared].into_iter().flatten()
    }

    fn origin(&self) -> std::sync::MutexGuard<'_, Origin> {
        // Two texts for people: no state of them is wrong.
        self.origin.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A folder's entry with the length of its header, if it is sound; a damaged one is dropped.
fn sound(folder: &Folder, path: &Path, kind: &str, key: Digest) -> Option<(Vec<u8>, usize)> {
    let bytes = folder.read(path, MAX_ENTRY_BYTES)?;
    match entry::payload(&bytes, kind, key) {
        Ok(payload) => {
            let header = bytes.len() - payload.len();
            Some((bytes, header))
        }
        Err(damage) => {
            folder.drop_damaged(path, &damage);
            None
        }
    }
}

/// Writes an entry that consists of `pieces` to `folders`, unless it is too large.
fn write<'a>(folders: impl IntoIterator<Item = &'a Folder>, kind: &str, key: Digest, pieces: &[&[u8]]) {
    let bytes: usize = pieces.iter().map(|piece| piece.len()).sum();
    let Some(path) = layout::derived(kind, key).filter(|_| bytes as u64 <= MAX_ENTRY_BYTES) else {
        return;
    };
    for folder in folders {
        folder.write(&path, pieces);
    }
}

#[cfg(test)]
mod tests;
