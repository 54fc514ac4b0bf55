//! A bucket of an object store that speaks S3: URLs signed for workers, and what has to be done with the secret itself.

mod http;

use std::time::{Duration, SystemTime};

use base64::Engine as _;
use base64::prelude::BASE64_STANDARD;
use cache::{BucketUrl, Pruned};
use futures_util::{StreamExt as _, TryStreamExt as _};
use hyper::Method;
use hyper::header::{HeaderName, HeaderValue};
use object_store::aws::{AmazonS3, AmazonS3Builder};
use object_store::path::Path;
use object_store::signer::{SignedUrlOptions, Signer as _};
use object_store::{ObjectMeta, ObjectStore as _, ObjectStoreExt as _, RetryConfig};

use http::Connector;

/// For so long a URL is good: a worker asks for it when it needs it, and uploads wait for their turn.
const URL_LIFETIME: Duration = Duration::from_secs(900);
/// Requests with the secret are tried so often again, and for so long.
const RETRIES: (usize, Duration) = (2, Duration::from_secs(10));

/// Why a bucket cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum BucketError {
    /// What is said of it in the environment.
    #[error(
        "{url}: cannot be used, got {source}\nset AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, AWS_REGION and, where it is not Amazon's, AWS_ENDPOINT_URL"
    )]
    Settings {
        /// Which bucket.
        url: BucketUrl,
        /// What is wrong.
        source: object_store::Error,
    },
    /// The server does not do what is asked.
    #[error(
        "{url}: cannot {what}, got {got}\ncheck that the server runs, that the bucket exists and that the key may list, read, write and delete in it"
    )]
    Request {
        /// Which bucket.
        url: BucketUrl,
        /// What was asked.
        what: &'static str,
        /// The answer.
        got: String,
    },
}

/// A bucket with the key to it.
#[derive(Debug)]
pub struct Bucket {
    url: BucketUrl,
    store: AmazonS3,
}

impl Bucket {
    /// The bucket at `url`, with region, server and key from the environment as Amazon's own programs read them, or from the
    /// machine that it runs on where that has a role. Nothing is asked yet.
    ///
    /// # Errors
    /// If they are not enough, or wrong.
    pub fn open(url: &BucketUrl) -> Result<Self, BucketError> {
        Self::of(AmazonS3Builder::from_env(), url)
    }

    fn of(builder: AmazonS3Builder, url: &BucketUrl) -> Result<Self, BucketError> {
        let (max_retries, retry_timeout) = RETRIES;
        let store = builder
            .with_bucket_name(&url.bucket)
            .with_allow_http(true) // a server in the lab; entries are checked, and the key itself does not travel
            .with_retry(RetryConfig { max_retries, retry_timeout, ..RetryConfig::default() })
            .with_http_connector(Connector)
            .build();
        let store = store.map_err(|source| BucketError::Settings { url: url.clone(), source })?;
        Ok(Self { url: url.clone(), store })
    }

    /// Where it is.
    pub fn url(&self) -> &BucketUrl {
        &self.url
    }

    /// A URL that reads an entry of a kind, or a blob where `kind` is empty; `None` of a kind that is no word.
    ///
    /// # Errors
    /// If there is no key to sign with.
    pub async fn url_to_read(&self, kind: &str, key: proto::Digest) -> Result<Option<String>, BucketError> {
        self.signed(Method::GET, kind, key, &SignedUrlOptions::default()).await
    }

    /// A URL that stores bytes with this SHA-256 and no others: who has it must send the sum, which the server checks.
    ///
    /// # Errors
    /// If there is no key to sign with.
    pub async fn url_to_write(
        &self,
        kind: &str,
        key: proto::Digest,
        sha256: &[u8; 32],
    ) -> Result<Option<String>, BucketError> {
        let sum = HeaderValue::from_str(&BASE64_STANDARD.encode(sha256)).expect("base64 is printable");
        let options = SignedUrlOptions::default()
            .with_signed_header(HeaderName::from_static("x-amz-checksum-sha256"), sum);
        self.signed(Method::PUT, kind, key, &options).await
    }

    async fn signed(
        &self,
        method: Method,
        kind: &str,
        key: proto::Digest,
        options: &SignedUrlOptions,
    ) -> Result<Option<String>, BucketError> {
        let Some(name) = self.url.object(kind, key) else { return Ok(None) };
        let signed = self.store.signed_url_opts(method, &Path::from(name), URL_LIFETIME, options).await;
        let signed = signed.map_err(|error| self.failed("sign", error))?;
        Ok(Some(signed.to_string()))
    }

    /// The size of an entry of a kind, or of a blob, in bytes; `None` if there is none.
    ///
    /// # Errors
    /// If the server does not say so.
    pub async fn size(&self, kind: &str, key: proto::Digest) -> Result<Option<u64>, BucketError> {
        let Some(name) = self.url.object(kind, key) else { return Ok(None) };
        match self.store.head(&Path::from(name)).await {
            Ok(object) => Ok(Some(object.size)),
            Err(object_store::Error::NotFound { .. }) => Ok(None),
            Err(error) => Err(self.failed("read", error)),
        }
    }

    /// An entry of a kind, or a blob, unchecked; `None` if there is none, or none of at most `most` bytes.
    ///
    /// # Errors
    /// If the server does not give it.
    pub async fn read(
        &self,
        kind: &str,
        key: proto::Digest,
        most: u64,
    ) -> Result<Option<Vec<u8>>, BucketError> {
        let Some(name) = self.url.object(kind, key) else { return Ok(None) };
        let failed = |error| self.failed("read", error);
        match self.store.get(&Path::from(name)).await {
            Ok(object) if object.meta.size > most => Ok(None),
            Ok(object) => Ok(Some(object.bytes().await.map_err(failed)?.into())),
            Err(object_store::Error::NotFound { .. }) => Ok(None),
            Err(error) => Err(failed(error)),
        }
    }

    /// Asks for the first object, to see whether server, bucket and key are as they should be.
    ///
    /// # Errors
    /// If they are not.
    pub async fn probe(&self) -> Result<(), BucketError> {
        let first = self.list().next().await.transpose();
        first.map(drop).map_err(|error| self.failed("list", error))
    }

    /// Removes the objects of ours that were stored before `before`, unless `is_dry`.
    ///
    /// # Errors
    /// If they cannot be listed, or one cannot be removed.
    pub async fn prune(&self, before: SystemTime, is_dry: bool) -> Result<Pruned, BucketError> {
        let mut pruned = Pruned::default();
        let mut objects = self.list();
        let mut old = Vec::new();
        while let Some(object) = objects.try_next().await.map_err(|error| self.failed("list", error))? {
            let count = |(objects, bytes): &mut (u64, u64)| {
                *objects += 1;
                *bytes += object.size;
            };
            match SystemTime::from(object.last_modified) < before {
                _ if !self.url.is_ours(object.location.as_ref()) => pruned.foreign += 1,
                true => {
                    count(&mut pruned.old);
                    old.push(object.location);
                }
                false => count(&mut pruned.kept),
            }
        }
        if !is_dry {
            let old = futures_util::stream::iter(old.into_iter().map(Ok)).boxed();
            let removed = self.store.delete_stream(old);
            removed.try_for_each(async |_| Ok(())).await.map_err(|error| self.failed("remove", error))?;
        }
        Ok(pruned)
    }

    fn list(&self) -> futures_util::stream::BoxStream<'static, object_store::Result<ObjectMeta>> {
        let prefix = (!self.url.prefix.is_empty()).then(|| Path::from(self.url.prefix.as_str()));
        self.store.list(prefix.as_ref())
    }

    fn failed(&self, what: &'static str, error: object_store::Error) -> BucketError {
        let got = proto::printable(&proto::root_cause(&error).to_string()).into_owned();
        BucketError::Request { url: self.url.clone(), what, got }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bucket(url: &str) -> Bucket {
        let builder = AmazonS3Builder::new()
            .with_access_key_id("AKIDEXAMPLE")
            .with_secret_access_key("secret")
            .with_region("eu-central-1")
            .with_endpoint("http://127.0.0.1:9");
        Bucket::of(builder, &url.parse().unwrap()).unwrap()
    }

    #[tokio::test]
    async fn urls_are_for_one_object_one_method_and_one_content() {
        let bucket = bucket("s3://lab/descry");
        let key = proto::Digest::of(b"cloud");
        let path = format!(
            "http://127.0.0.1:9/lab/descry/derived/prepared-cloud-2/{}/{key}?",
            &key.to_string()[..2]
        );
        let read = bucket.url_to_read("prepared cloud 2", key).await.unwrap().unwrap();
        assert!(read.starts_with(&path), "{read}");
        assert!(read.contains("X-Amz-Expires=900") && read.contains("X-Amz-SignedHeaders=host&"), "{read}");
        let write = bucket.url_to_write("prepared cloud 2", key, &[1; 32]).await.unwrap().unwrap();
        assert!(
            write.starts_with(&path) && write.contains("X-Amz-SignedHeaders=host%3Bx-amz-checksum-sha256"),
            "{write}"
        );
        let another = bucket.url_to_write("prepared cloud 2", key, &[2; 32]).await.unwrap().unwrap();
        let signature = |url: &str| url.split_once("X-Amz-Signature=").unwrap().1.to_owned();
        assert_ne!(signature(&write), signature(&another));
        for url in [&read, &write] {
            assert!(!url.contains("secret"), "{url}");
        }
        assert_eq!(bucket.url_to_read("../x", key).await.unwrap(), None);
    }

    #[tokio::test]
    async fn a_server_that_is_not_there_is_an_error_that_says_so() {
        let error = bucket("s3://lab").probe().await.unwrap_err().to_string();
        assert!(
            error.starts_with("s3://lab: cannot list, got ") && error.contains("\ncheck that"),
            "{error}"
        );
    }
}
