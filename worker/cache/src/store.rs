//! What is kept between runs and shared between processes: source clouds by content, and derived entries, which were
//! computed once and can be checked. Losing one costs time, never a result.

use std::path::Path;
use std::sync::{Mutex, OnceLock, PoisonError};

use proto::{Digest, MAX_BLOB_BYTES};

use crate::bucket_url::BucketUrl;
use crate::entry::{self, Damage, MAX_ENTRY_BYTES, Origin};
use crate::layout;
use crate::listing;
use crate::options::Storage;
use crate::single_flight::{Claim, SingleFlight};
use crate::tier::{Tier, TierReads};

/// The tiers of the cache. All workers of a process use one store. Calls read and write files: they are not for async
/// threads.
#[derive(Debug)]
pub struct Store {
    /// Nearest first; none if nothing is kept.
    tiers: Vec<Tier>,
    /// Entries of another evaluation version are of no use, and are left to releases of that version.
    version: u32,
    origin: Mutex<Origin>,
    /// What was wrong with an entry that others have made.
    distrusted: OnceLock<String>,
    making: SingleFlight,
    bucket: Option<BucketUrl>,
    shared_read_only: bool,
}

impl Store {
    /// The store with these settings, for entries of this evaluation version; touches no file yet. `label` (a host or a
    /// worker's name) is noted in the entries it makes.
    pub fn open(storage: &Storage, label: &str, version: u32) -> Self {
        let producer = format!("descry {} on {label}", env!("CARGO_PKG_VERSION"));
        let disk = storage.cache.clone().map(|root| Tier::disk(root, storage.cache_size.as_u64()));
        let shared = storage.shared.clone().map(|root| Tier::shared(root, storage.shared_read_only));
        Self {
            tiers: disk.into_iter().chain(shared).collect(),
            version,
            origin: Mutex::new(Origin { producer, run: String::new() }),
            distrusted: OnceLock::new(),
            making: SingleFlight::default(),
            bucket: storage.bucket.clone(),
            shared_read_only: storage.shared_read_only,
        }
    }

    /// The bucket that machines share, if there is one; who signs URLs looks there, not this store.
    pub fn bucket(&self) -> Option<&BucketUrl> {
        self.bucket.as_ref()
    }

    /// Whether what machines share is only read.
    pub fn is_shared_read_only(&self) -> bool {
        self.shared_read_only
    }

    /// Whether anything is kept at all.
    pub fn is_kept(&self) -> bool {
        !self.tiers.is_empty()
    }

    /// How reads of this machine's disk and of the shared folder have ended so far; `None` for a tier that there is not.
    pub fn reads(&self) -> (Option<TierReads>, Option<TierReads>) {
        let shared = self.tiers.iter().find(|tier| !tier.is_local());
        (self.local().map(Tier::reads), shared.map(Tier::reads))
    }

    /// From here on, entries are made for this run (a coordinator's session).
    pub fn name_run(&self, run: String) {
        self.origin().run = run;
    }

    /// The payload of an entry, if there is a sound one. `kind` is lower-case words; `key` comes from a
    /// [`KeyBuilder`].
    pub fn get(&self, kind: &str, key: Digest) -> Option<Vec<u8>> {
        self.get_with_place(kind, key).map(|(payload, _)| payload)
    }

    /// As [`Store::get`], and whether it was on this machine's disk: others write to the shared folder.
    pub fn get_with_place(&self, kind: &str, key: Digest) -> Option<(Vec<u8>, bool)> {
        let (mut bytes, header, is_local) = self.find(kind, key)?;
        bytes.drain(..header);
        Some((bytes, is_local))
    }

    /// As [`Store::get`], from this machine's disk only: for what changes under one key, and for results, which a folder
    /// that others write is not believed.
    pub fn get_local(&self, kind: &str, key: Digest) -> Option<Vec<u8>> {
        let (mut bytes, header) = self.sound(self.local()?, &layout::derived(kind, key)?, kind, key)?;
        bytes.drain(..header);
        Some(bytes)
    }

    /// A whole entry, as it travels to another machine, if there is a sound one.
    pub fn entry(&self, kind: &str, key: Digest) -> Option<Vec<u8>> {
        self.find(kind, key).map(|(bytes, ..)| bytes)
    }

    /// The whole entry that [`Store::put`] makes of a payload, as it travels to another machine.
    pub fn as_entry(&self, kind: &str, key: Digest, payload: &[u8]) -> Vec<u8> {
        let mut bytes = entry::header(kind, key, self.version, &self.origin(), payload);
        bytes.extend_from_slice(payload);
        bytes
    }

    /// Keeps an entry in every tier. What cannot be kept is computed again when it is needed; the first failure of each
    /// tier is a warning.
    pub fn put(&self, kind: &str, key: Digest, payload: &[u8]) {
        let header = entry::header(kind, key, self.version, &self.origin(), payload);
        put(&self.tiers, kind, key, &[&header, payload]);
    }

    /// As [`Store::put`], on this machine's disk only: for [`Store::get_local`].
    pub fn put_local(&self, kind: &str, key: Digest, payload: &[u8]) {
        let header = entry::header(kind, key, self.version, &self.origin(), payload);
        put(self.local(), kind, key, &[&header, payload]);
    }

    /// The keys of all entries of a kind on this machine's disk, sound or not.
    pub fn local_keys(&self, kind: &str) -> Vec<Digest> {
        self.local().map(|disk| listing::keys(disk.root(), kind)).unwrap_or_default()
    }

    /// Removes an entry of [`Store::put_local`].
    pub fn remove_local(&self, kind: &str, key: Digest) {
        if let (Some(disk), Some(name)) = (self.local(), layout::derived(kind, key)) {
            disk.remove(&name);
        }
    }

    /// Keeps an entry that came from another machine, if it is sound, and returns its payload.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn adopt(&self, kind: &str, key: Digest, bytes: &[u8]) -> Result<Vec<u8>, Damage> {
        let payload = self.payload(kind, key, bytes)?.to_vec();
        put(&self.tiers, kind, key, &[bytes]);
        Ok(payload)
    }

    /// The payload of an entry that came from another machine.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn payload<'a>(&self, kind: &str, key: Digest, bytes: &'a [u8]) -> Result<&'a [u8], Damage> {
        entry::payload(bytes, kind, key, self.version)
    }

    /// The bytes with this digest, if they are kept here.
    pub fn blob(&self, digest: Digest) -> Option<Vec<u8>> {
        let disk = self.local()?;
        let name = layout::blob(digest);
        let bytes = disk.get(&name, MAX_BLOB_BYTES)?;
        if Digest::of(&bytes) == digest {
            return Some(bytes);
        }
        disk.remove_damaged(&name, &"entry is damaged");
        None
    }

    /// Keeps bytes whose digest this is.
    pub fn put_blob(&self, digest: Digest, bytes: &[u8]) {
        if let Some(disk) = self.local() {
            disk.put(&layout::blob(digest), &[bytes]);
        }
    }

    /// The right to make an entry, unless another worker of this process is making it; [`Store::wait`] waits for that. A worker that holds claims must not wait.
    pub fn claim(&self, key: Digest) -> Option<Claim<'_>> {
        // Where nothing is kept, nothing can be handed over: everybody makes its own.
        if self.is_kept() { self.making.claim(key) } else { Some(Claim::unshared()) }
    }

    /// Ready when nobody in this process is making the entry.
    pub async fn wait(&self, key: Digest) {
        self.making.wait(key).await;
    }

    /// Notes that an entry which others have made is sound and wrong, removes it everywhere, and everything of these kinds
    /// from this machine's disk: it may follow from others like it.
    pub fn distrust(&self, kind: &str, key: Digest, what: String, kinds: &[&str]) {
        let _ = self.distrusted.set(what); // the first says enough
        if let Some(name) = layout::derived(kind, key) {
            self.tiers.iter().for_each(|tier| tier.remove(&name));
        }
        for kind in kinds {
            self.local_keys(kind).into_iter().for_each(|key| self.remove_local(kind, key));
        }
    }

    /// What was wrong with an entry that others have made, if one was: nothing is to be computed from others any more.
    pub fn distrusted(&self) -> Option<&str> {
        self.distrusted.get().map(String::as_str)
    }

    /// A sound entry, the length of its header and whether it was here, from the nearest tier that has it; nearer ones keep a
    /// copy.
    fn find(&self, kind: &str, key: Digest) -> Option<(Vec<u8>, usize, bool)> {
        let name = layout::derived(kind, key)?;
        self.tiers.iter().enumerate().find_map(|(nearer, tier)| {
            let (bytes, header) = self.sound(tier, &name, kind, key)?;
            self.tiers[..nearer].iter().for_each(|tier| tier.put(&name, &[&bytes]));
            Some((bytes, header, tier.is_local()))
        })
    }

    /// A tier's entry with the length of its header, if it is sound; a damaged one is removed. One of another evaluation
    /// version is not damaged: a release that computes those numbers may use the same folder.
    fn sound(&self, tier: &Tier, name: &Path, kind: &str, key: Digest) -> Option<(Vec<u8>, usize)> {
        let bytes = tier.get(name, MAX_ENTRY_BYTES)?;
        match entry::payload(&bytes, kind, key, self.version) {
            Ok(payload) => {
                let header = bytes.len() - payload.len();
                Some((bytes, header))
            }
            Err(Damage::EvaluationVersion(_)) => None,
            Err(damage) => {
                tier.remove_damaged(name, &damage);
                None
            }
        }
    }

    fn local(&self) -> Option<&Tier> {
        self.tiers.iter().find(|tier| tier.is_local())
    }

    fn origin(&self) -> std::sync::MutexGuard<'_, Origin> {
        // Two texts for people: no state of them is wrong.
        self.origin.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Keeps an entry that consists of `pieces` in `tiers`, unless it is too large.
fn put<'a>(tiers: impl IntoIterator<Item = &'a Tier>, kind: &str, key: Digest, pieces: &[&[u8]]) {
    let bytes: usize = pieces.iter().map(|piece| piece.len()).sum();
    let Some(name) = layout::derived(kind, key).filter(|_| bytes as u64 <= MAX_ENTRY_BYTES) else {
        return;
    };
    for tier in tiers {
        tier.put(&name, pieces);
    }
}
