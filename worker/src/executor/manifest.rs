//! Split manifests: which clouds a split has, in order, and what they show.

use std::sync::Arc;

use descriptor::Label;
use proto::Digest;
use proto::task::{CloudEntry, SplitManifest};

use crate::executor::error::EvaluationError;

/// One cloud of a split.
#[derive(Clone, Debug)]
pub struct Listed {
    /// Digest of the source file.
    pub digest: Digest,
    /// Size of the source file by the manifest's account, bytes.
    pub bytes: u64,
    /// What it shows.
    pub label: Label,
    /// Its path in the data set, as it may be shown.
    pub path: String,
    /// The sequence that it was taken in, if sequences are numbered.
    pub sequence: Option<u32>,
}

/// The clouds of one split.
#[derive(Debug)]
pub struct Manifest {
    /// Digest of the manifest itself.
    pub digest: Digest,
    /// In order.
    pub clouds: Vec<Listed>,
}

impl Manifest {
    /// Reads the blob with this digest.
    ///
    /// # Errors
    /// [`EvaluationError::Manifest`] if it is no manifest.
    pub fn decode(digest: Digest, bytes: &[u8]) -> Result<Self, EvaluationError> {
        let broken = |what: String| EvaluationError::Manifest { digest, what };
        let manifest = SplitManifest::decode(bytes).map_err(|error| broken(error.to_string()))?;
        let listed = |cloud: CloudEntry| Listed {
            digest: cloud.digest,
            bytes: cloud.bytes,
            label: Label { category: cloud.label.category, instance: cloud.label.instance },
            path: proto::printable(&cloud.path).into_owned(),
            sequence: cloud.sequence,
        };
        Ok(Self { digest, clouds: manifest.clouds.into_iter().map(listed).collect() })
    }

    /// Memory that the manifest takes, bytes.
    pub fn bytes(&self) -> usize {
        let paths: usize = self.clouds.iter().map(|cloud| cloud.path.len()).sum();
        size_of::<Self>() + size_of_val(self.clouds.as_slice()) + paths
    }
}

/// What the clouds of several splits show, one split after the other.
pub fn labels(manifests: &[Arc<Manifest>]) -> Vec<Label> {
    manifests.iter().flat_map(|manifest| &manifest.clouds).map(|cloud| cloud.label).collect()
}
