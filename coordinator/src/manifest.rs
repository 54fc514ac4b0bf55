//! What workers need to know of a data set and a search space: split manifests, and how clouds are prepared.

use descriptor::{GENES, Preprocess, Unit};
use proto::v1;

use crate::dataset::CloudEntry;

/// What every job of a run has in common.
pub fn preparation(preprocess: &Preprocess, genes: &descriptor::GeneTable) -> v1::Preparation {
    let unit = match preprocess.unit {
        Unit::Metre => v1::LengthUnit::Metre,
        Unit::Millimetre => v1::LengthUnit::Millimetre,
    };
    let domains = GENES.iter().map(|spec| {
        let domain = genes.domain(spec.kind).copied().unwrap_or(descriptor::genes::Domain::fixed(0));
        v1::Domain { low: domain.low, step: domain.step, count: domain.count }
    });
    v1::Preparation {
        leaf_um: preprocess.leaf_um,
        normal_radius_um: preprocess.normal_radius_um,
        min_points: preprocess.min_points,
        colour: preprocess.colour,
        unit: unit.into(),
        domains: domains.collect(),
    }
}

/// The blob that lists one split's clouds.
pub fn manifest<'a>(split: &str, clouds: impl Iterator<Item = &'a CloudEntry>) -> v1::SplitManifest {
    let listed = clouds.map(|cloud| v1::ManifestCloud {
        digest: cloud.digest.to_vec(),
        bytes: cloud.bytes,
        category: cloud.category,
        instance: cloud.instance,
        path: cloud.path.clone(),
    });
    v1::SplitManifest { split: split.to_owned(), clouds: listed.collect() }
}
