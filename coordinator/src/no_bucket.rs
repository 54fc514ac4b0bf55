//! What stands in for crate `bucket` in a program without object stores: there is no bucket that it can open.

use std::time::SystemTime;

use cache::{BucketUrl, Pruned};
use proto::Digest;

/// Why a bucket cannot be opened.
#[derive(Debug, thiserror::Error)]
#[error(
    "{0}: cannot be used, as this coordinator was built without object stores\nbuild it with --features s3, or share a folder, for example file:///mnt/descry"
)]
pub struct BucketError(BucketUrl);

/// There is none.
#[derive(Debug)]
pub enum Bucket {}

impl Bucket {
    /// Refuses.
    ///
    /// # Errors
    /// Always.
    pub fn open(url: &BucketUrl) -> Result<Self, BucketError> {
        Err(BucketError(url.clone()))
    }

    pub async fn url_to_read(&self, _: &str, _: Digest) -> Result<Option<String>, BucketError> {
        match *self {}
    }

    pub async fn url_to_write(
        &self,
        _: &str,
        _: Digest,
        _: &[u8; 32],
    ) -> Result<Option<String>, BucketError> {
        match *self {}
    }

    pub async fn size(&self, _: &str, _: Digest) -> Result<Option<u64>, BucketError> {
        match *self {}
    }

    pub async fn read(&self, _: &str, _: Digest, _: u64) -> Result<Option<Vec<u8>>, BucketError> {
        match *self {}
    }

    pub async fn probe(&self) -> Result<(), BucketError> {
        match *self {}
    }

    pub async fn prune(&self, _: SystemTime, _: bool) -> Result<Pruned, BucketError> {
        match *self {}
    }
}
