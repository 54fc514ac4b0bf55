//! The prepared clouds that a run gives to its workers, as entries of the coordinator's own store or of the bucket that its
//! machines share.

use std::collections::{HashMap, HashSet};
use std::sync::Arc;

use cache::{Damage, Store};
use descriptor::{Preparer, Preprocess, cloud_file};
use proto::Digest;
use worker::{PREPARED_CLOUD, prepared_cloud_key};

use crate::dataset::CloudEntry;
use cluster::blobs::BlobStore;

/// Which entries of the store are of this run's clouds. Keys from the wire are only looked up among these.
pub struct PreparedClouds {
    store: Arc<Store>,
    preprocess: Preprocess,
    preparers: Vec<Preparer>,
    /// Digest of the source file, and which preparer it is for, by key of the entry.
    sources: HashMap<Digest, (Digest, usize)>,
    files: HashSet<Digest>,
}

impl PreparedClouds {
    /// Those that the store has, or will have when a worker of this process has made them, of `clouds` made ready in any of
    /// some ways.
    pub fn new(
        store: Arc<Store>,
        preprocess: &Preprocess,
        preparers: &[Preparer],
        clouds: &[CloudEntry],
    ) -> Self {
        let digests = clouds.iter().map(|cloud| Digest(cloud.digest));
        let in_each_way = |digest: Digest| {
            let key = move |(index, preparer)| {
                Some((prepared_cloud_key(preprocess, preparer, digest)?, (digest, index)))
            };
            preparers.iter().enumerate().filter_map(key)
        };
        let files = digests.clone().collect();
        let sources = digests.flat_map(in_each_way).collect();
        Self { store, preprocess: *preprocess, preparers: preparers.to_vec(), sources, files }
    }

    /// Whether this is the digest of one of these clouds' files.
    pub fn is_source(&self, digest: Digest) -> bool {
        self.files.contains(&digest)
    }

    /// Whether workers may have an entry, wherever it is: it is of this run's clouds and its source is released.
    pub fn are_given(&self, kind: &str, key: Digest, blobs: &BlobStore) -> bool {
        let source = self.sources.get(&key).filter(|_| kind == PREPARED_CLOUD);
        source.is_some_and(|(source, _)| blobs.is_released(*source))
    }

    /// An entry, if there is one and its source cloud is released: no worker gets a test cloud in another form before
    /// the search is over.
    pub fn read(&self, kind: &str, key: Digest, blobs: &BlobStore) -> Option<Vec<u8>> {
        if self.are_given(kind, key, blobs) { self.store.entry(kind, key) } else { None }
    }

    /// The payload of an entry that came from elsewhere.
    ///
    /// # Errors
    /// What is wrong with its form.
    pub fn payload<'a>(&self, key: Digest, bytes: &'a [u8]) -> Result<&'a [u8], Damage> {
        self.store.payload(PREPARED_CLOUD, key, bytes)
    }

    /// The payload that the entry of a released cloud must have, made here and now from its source.
    ///
    /// # Errors
    /// If the source cannot be read any more.
    pub fn prepare(&self, key: Digest, blobs: &BlobStore) -> Result<Vec<u8>, String> {
        let none = || format!("derived entry {key}: is of no cloud of this run");
        let (source, index) = self.sources.get(&key).ok_or_else(none)?;
        let preparer = self.preparers.get(*index).ok_or_else(none)?;
        let bytes = blobs.read(*source).map_err(|error| error.to_string())?;
        let cloud = cloud_file::read(&bytes).map_err(|error| error.to_string())?;
        let prepared = preparer.prepare(&cloud, &self.preprocess).map_err(|error| error.to_string())?;
        preparer.encode(&prepared).ok_or_else(none)
    }
}

#[cfg(test)]
mod tests {
    use descriptor::{GeneTable, SearchSpace};

    use super::*;
    use crate::storage::store_in;

    #[test]
    fn only_prepared_clouds_whose_source_is_released_are_given() {
        let folder = tempfile::tempdir().unwrap();
        let store = Arc::new(store_in(folder.path()));
        let preparer = SearchSpace::DiskRing(GeneTable::paper()).preparer().unwrap();
        let preprocess = Preprocess::default();
        let cloud = |source: Digest| {
            let path = "a/a_1/a_1_1_1.pcd".to_owned();
            CloudEntry { path, category: 0, instance: 0, sequence: None, set: 0, digest: source.0, bytes: 5 }
        };
        let key = |source| prepared_cloud_key(&preprocess, &preparer, source).unwrap();
        let blobs = BlobStore::default();
        let train = blobs.publish_bytes(b"train".to_vec());
        let [test, foreign] = [Digest::of(b"test"), Digest::of(b"foreign")];
        blobs.publish_bytes(b"foreign".to_vec());
        for source in [train, test, foreign] {
            store.put(PREPARED_CLOUD, key(source), b"prepared");
        }
        store.put("remembered counts", key(train), b"counts");
        let clouds = [cloud(train), cloud(test)];
        let prepared =
            PreparedClouds::new(Arc::clone(&store), &preprocess, std::slice::from_ref(&preparer), &clouds);

        assert_eq!(
            prepared.read(PREPARED_CLOUD, key(train), &blobs),
            store.entry(PREPARED_CLOUD, key(train))
        );
        assert!(prepared.read(PREPARED_CLOUD, key(train), &blobs).is_some());
        assert_eq!(prepared.read("remembered counts", key(train), &blobs), None);
        assert_eq!(prepared.read(PREPARED_CLOUD, train, &blobs), None);
        assert_eq!(prepared.read(PREPARED_CLOUD, key(foreign), &blobs), None, "of another data set");
        assert_eq!(prepared.read(PREPARED_CLOUD, key(test), &blobs), None, "not released yet");
        blobs.publish_bytes(b"test".to_vec());
        assert!(prepared.read(PREPARED_CLOUD, key(test), &blobs).is_some());
    }
}
