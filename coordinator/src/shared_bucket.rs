//! The bucket that the machines of a run share: URLs to it for workers, for what the run lets them have.

use std::sync::Arc;

use cache::Store;
use cluster::Cluster;
use cluster::blobs::BlobStore;
use proto::{BLOB_KIND, Digest};
use transport::{ObjectRequest, Presign};
use worker::PREPARED_CLOUD;

use crate::prepared::PreparedClouds;

#[cfg(not(feature = "s3"))]
pub use crate::no_bucket::{Bucket, BucketError};
#[cfg(feature = "s3")]
pub use bucket::{Bucket, BucketError};

/// The bucket of a store, if it has one. Nothing is asked of it yet.
///
/// # Errors
/// If this program has no object stores, or what the environment says of the bucket is wrong.
pub fn open(store: &Store) -> Result<Option<Arc<Bucket>>, BucketError> {
    Ok(store.bucket().map(Bucket::open).transpose()?.map(Arc::new))
}

/// Signs URLs to `bucket`: to read what a run has released, and to write, unless it is read only, what workers make of that.
pub fn presign(
    bucket: &Arc<Bucket>,
    prepared: &Arc<PreparedClouds>,
    cluster: &Arc<Cluster>,
    read_only: bool,
) -> Presign {
    let (bucket, prepared, cluster) = (Arc::clone(bucket), Arc::clone(prepared), Arc::clone(cluster));
    Arc::new(move |kind: String, objects: Vec<ObjectRequest>| {
        let (bucket, prepared, cluster) = (Arc::clone(&bucket), Arc::clone(&prepared), Arc::clone(&cluster));
        Box::pin(async move {
            let mut urls = Vec::with_capacity(objects.len());
            for ObjectRequest { key, sha256 } in objects {
                let is_given = is_given(&kind, key, sha256.is_some(), (&prepared, &cluster.blobs));
                let url = match sha256 {
                    _ if !is_given => Ok(None),
                    None => bucket.url_to_read(&kind, key).await,
                    Some(_) if read_only => Ok(None),
                    Some(sum) => bucket.url_to_write(&kind, key, &sum).await,
                };
                urls.push(url.map_err(|error| error.to_string())?);
            }
            Ok(urls)
        })
    })
}

/// Whether workers may have an object now, to read or to write it.
fn is_given(
    kind: &str,
    key: Digest,
    is_write: bool,
    (prepared, blobs): (&PreparedClouds, &BlobStore),
) -> bool {
    match kind {
        PREPARED_CLOUD => prepared.are_given(kind, key, blobs),
        // A blob is checked by whoever reads it. A description is stored before the coordinator knows of it.
        BLOB_KIND => is_write || blobs.is_there(key),
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use descriptor::{GeneTable, Preprocess, SearchSpace};
    use worker::prepared_cloud_key;

    use super::*;
    use crate::dataset::CloudEntry;
    use crate::storage::store_in;

    #[test]
    fn test_clouds_are_given_in_no_form_before_they_are_released() {
        let folder = tempfile::tempdir().unwrap();
        let (preprocess, blobs) = (Preprocess::default(), BlobStore::default());
        let preparer = SearchSpace::DiskRing(GeneTable::paper()).preparer().unwrap();
        let (train, test) = (blobs.publish_bytes(b"train".to_vec()), Digest::of(b"test"));
        let cloud = |source: Digest| {
            let path = "a/a_1/a_1_1_1.pcd".to_owned();
            CloudEntry { path, category: 0, instance: 0, sequence: None, set: 0, digest: source.0, bytes: 5 }
        };
        let store = Arc::new(store_in(folder.path()));
        let clouds = [cloud(train), cloud(test)];
        let prepared = PreparedClouds::new(store, &preprocess, std::slice::from_ref(&preparer), &clouds);
        let key = |source| prepared_cloud_key(&preprocess, &preparer, source).unwrap();
        let given = |kind: &str, key| {
            [false, true].map(|is_write| is_given(kind, key, is_write, (&prepared, &blobs)))
        };
        assert_eq!(given(BLOB_KIND, train), [true, true]);
        assert_eq!(given(PREPARED_CLOUD, key(train)), [true, true]);
        assert_eq!(given(BLOB_KIND, test), [false, true], "who has it may store it, nobody gets it");
        assert_eq!(given(PREPARED_CLOUD, key(test)), [false, false]);
        assert_eq!(given(PREPARED_CLOUD, train), [false, false], "of no cloud of this run");
        assert_eq!(given("signatures 1", key(train)), [false, false]);
        blobs.publish_bytes(b"test".to_vec());
        assert_eq!(given(BLOB_KIND, test), [true, true]);
        assert_eq!(given(PREPARED_CLOUD, key(test)), [true, true]);
    }
}
