//! The bucket that the machines of a run share: URLs to it for workers, for what the run lets them have.

use std::sync::Arc;

use cache::Store;
use cluster::Cluster;
use transport::{ObjectRequest, Presign};
use worker::PREPARED_CLOUD;

use crate::prepared::PreparedClouds;

#[cfg(not(feature = "s3"))]
pub use crate::no_bucket::{Bucket, BucketError, Pruned};
#[cfg(feature = "s3")]
pub use bucket::{Bucket, BucketError, Pruned};

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
                let is_given = match kind.as_str() {
                    PREPARED_CLOUD => prepared.are_given(&kind, key, &cluster.blobs),
                    // A blob is checked by whoever reads it. A description is stored before the coordinator knows of it.
                    "" => sha256.is_some() || cluster.blobs.is_there(key),
                    _ => false,
                };
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
