//! Clouds as split manifests list them.

use std::ops::Range;

use descriptor::Label;
use prost::Message as _;
use proto::v1;

/// Clouds as split manifests list them, one manifest after the other.
#[derive(Default)]
pub struct Listing(Vec<v1::ManifestCloud>);

impl Listing {
    /// Adds the clouds of a manifest; `None` if it is none.
    pub fn append(&mut self, manifest: &[u8]) -> Option<()> {
        self.0.extend(v1::SplitManifest::decode(manifest).ok()?.clouds);
        Some(())
    }

    /// What the clouds show.
    pub fn labels(&self) -> Vec<Label> {
        let label = |cloud: &v1::ManifestCloud| Label { category: cloud.category, instance: cloud.instance };
        self.0.iter().map(label).collect()
    }

    /// The manifest of some of the clouds.
    pub fn manifest(&self, clouds: Range<usize>) -> Vec<u8> {
        v1::SplitManifest { split: String::new(), clouds: self.0[clouds].to_vec() }.encode_to_vec()
    }
}
