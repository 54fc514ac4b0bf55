//! Signatures of splits on this machine's disk, a compressed file for each channel.
//!
//! Only those of structures: other families describe clouds again as fast as their signatures are read.

use std::sync::Arc;

use cache::Store;
use descriptor::{Channel, Descriptor, Signatures};
use proto::{Compressed, Digest};
use tokio::sync::Semaphore;

use crate::executor::manifest::Manifest;
use crate::executor::reuse::Key;
use crate::prepared_cloud::preprocess_key;

/// The kind of entry, and the version of its bytes.
pub const SIGNATURES: &str = "signatures 2";

/// Whether signatures in a channel can be kept.
pub fn are_of(channel: &Channel) -> bool {
    Descriptor::of_channel(channel).is_some()
}

/// The signatures of a split in a channel, if they are kept.
pub fn load(store: &Store, manifest: &Manifest, key: &Key) -> Option<Signatures> {
    let alone = Descriptor::of_channel(&key.1)?;
    let block = store.get_local(SIGNATURES, entry_key(manifest, key))?;
    let clouds = manifest.clouds.len() as u32;
    let length = u32::try_from(alone.signature_bytes(clouds)).ok()?;
    let bytes = Compressed::of_block(block, length).decompress().map_err(|error| error.to_string());
    let signatures =
        bytes.and_then(|bytes| alone.decode_signatures(&bytes, clouds).map_err(|error| error.to_string()));
    match signatures {
        Ok(signatures) => signatures.into_iter().next(),
        Err(error) => {
            tracing::warn!("split manifest {}: kept {error}", manifest.digest);
            None
        }
    }
}

/// Most files that are being written: their signatures stay in memory until they are.
const MOST: u32 = 8;

/// Writes files while others compute.
pub struct Writer {
    store: Arc<Store>,
    room: Arc<Semaphore>,
}

impl Writer {
    pub fn new(store: Arc<Store>) -> Self {
        Self { store, room: Arc::new(Semaphore::new(MOST as usize)) }
    }

    /// Keeps the signatures of a split in a channel, soon, if they can be kept.
    pub async fn keep(&self, manifest: &Arc<Manifest>, key: &Key, signatures: &Arc<Signatures>) {
        if !self.store.is_kept() || !are_of(&key.1) {
            return;
        }
        let Ok(place) = Arc::clone(&self.room).acquire_owned().await else { return }; // it is never closed
        let (store, manifest, key) = (Arc::clone(&self.store), Arc::clone(manifest), key.clone());
        let signatures = Arc::clone(signatures);
        tokio::task::spawn_blocking(move || {
            write(&store, &manifest, &key, &signatures);
            drop(place);
        });
    }

    /// Waits until everything is written.
    pub async fn settle(&self) {
        let _all = self.room.acquire_many(MOST).await;
    }
}

fn write(store: &Store, manifest: &Manifest, key: &Key, signatures: &Signatures) {
    if let Some(alone) = Descriptor::of_channel(&key.1) {
        let bytes = alone.encode_signatures(&[signatures]);
        if let Some(compressed) = Compressed::new(&bytes) {
            store.put_local(SIGNATURES, entry_key(manifest, key), compressed.block());
        }
    }
}

fn entry_key(manifest: &Manifest, (preprocess, channel): &Key) -> Digest {
    preprocess_key(SIGNATURES, preprocess).part(&channel.to_bytes()).part(&manifest.digest.0).finish()
}
