//! Sections `[preprocess]` and `[descriptor]` as written: every key, its type and its default.
//!
//! The doc comments are the descriptions of the JSON Schema of experiments, so they speak to the author of one.

use descriptor::structure::ChannelFile;
use descriptor::{Family, Preprocess, SetDistance};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::forms::RawGene;

/// What is computed once for each cloud, whatever the descriptor.
#[derive(Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default, rename = "preprocess")]
pub struct RawPreprocess {
    /// Edge of the voxels whose centroids are the keypoints, centimetres. Not for family structure, whose channels have
    /// grids of their own. Default: 2.0.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "f64", range(min = 0.01, max = 100.0))]
    pub leaf_cm: Option<f64>,
    /// Radius of the neighbourhoods that normals are fitted to, centimetres.
    #[schemars(range(min = 0.01, max = 100.0))]
    pub normal_radius_cm: f64,
    /// A cloud with fewer usable points is skipped and reported.
    #[schemars(range(min = 1, max = 1_000_000))]
    pub min_points: u32,
}

impl Default for RawPreprocess {
    fn default() -> Self {
        let paper = Preprocess::default();
        Self {
            leaf_cm: None,
            normal_radius_cm: f64::from(paper.normal_radius_um) / 1e4,
            min_points: paper.min_points,
        }
    }
}

/// The descriptors that are searched.
#[derive(Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default, rename = "descriptor")]
pub struct RawDescriptor {
    /// The family of descriptors.
    #[serde(skip_serializing_if = "RawFamily::is_default")]
    pub family: RawFamily,
    /// Use colour. Set it to false for clouds without: gene m is then dropped and w fixed at 1.
    pub colour: bool,
    #[serde(skip_serializing_if = "RawGenes::is_empty")]
    pub genes: RawGenes,
    /// Of structure: most channels, 1 to 8. Default: 4; with three or four members two for each, with another number of
    /// several members one.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "u32", range(min = 1, max = 8))]
    pub slots: Option<u32>,
    /// Of structure: members that a structure consists of, each with an equal share of slots, max_bins and max_cost, and
    /// more of them than each has slots. The genetic algorithm evolves each in a population of its own, judged by itself;
    /// the first individual of every generation but the first joins the best of each. Default: 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "u32", range(min = 1, max = 8))]
    pub members: Option<u32>,
    /// Of structure: most bins of all channels together, at least 54 a slot. Default: 500.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "u32", range(min = 54))]
    pub max_bins: Option<u32>,
    /// Of structure: how rows of bins are compared. Default: "chi2".
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "RawMetric")]
    pub metric: Option<RawMetric>,
    /// Of structure: a structure whose counted cost of recognising a cloud is higher has fitness 0 and is not evaluated.
    /// `coordinator evaluate --structure` tells the cost of one: about nanoseconds. At least what the cheapest structure
    /// costs, 1506 without members. Default: no limit.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "u64", range(min = 1))]
    pub max_cost: Option<u64>,
    /// Of structure: the channels of one structure, which is then not searched for, as in the files of
    /// experiments/descriptors.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    #[schemars(skip)]
    pub channel: Vec<ChannelFile>,
}

impl Default for RawDescriptor {
    fn default() -> Self {
        Self {
            family: RawFamily::default(),
            colour: true,
            genes: RawGenes::default(),
            slots: None,
            members: None,
            max_bins: None,
            metric: None,
            max_cost: None,
            channel: Vec::new(),
        }
    }
}

/// How rows of bins are compared.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "lowercase", rename = "metric")]
pub enum RawMetric {
    /// Chi-squared (paper).
    Chi2,
    /// Sum of absolute differences.
    L1,
    /// Half the sum of squared differences of roots.
    Hellinger,
}

impl From<RawMetric> for SetDistance {
    fn from(metric: RawMetric) -> Self {
        match metric {
            RawMetric::Chi2 => Self::ChiSquared,
            RawMetric::L1 => Self::L1,
            RawMetric::Hellinger => Self::Hellinger,
        }
    }
}

/// A family of descriptors that can be searched.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "kebab-case", rename = "family")]
pub enum RawFamily {
    /// The paper's: shape and colour of a disk and a ring about each keypoint. Genes shape_bins, m, R1, R2 and w.
    #[default]
    DiskRing,
    /// One histogram of the hue of all points, a cheap baseline. Gene bins.
    GlobalHue,
    /// Lists of channels, each of which bins up to three features of pairs of points: the structure is searched as well
    /// as its parameters. It has keys of its own beside genes, none of which can be fixed.
    Structure,
}

impl RawFamily {
    /// The family as files name it, if it can be searched.
    pub fn of(family: Family) -> Option<Self> {
        [Self::DiskRing, Self::GlobalHue, Self::Structure]
            .into_iter()
            .find(|&raw| Family::from(raw) == family)
    }

    fn is_default(&self) -> bool {
        *self == Self::default()
    }
}

impl From<RawFamily> for Family {
    fn from(family: RawFamily) -> Self {
        match family {
            RawFamily::DiskRing => Self::DiskRing,
            RawFamily::GlobalHue => Self::GlobalHue,
            RawFamily::Structure => Self::Structure,
        }
    }
}

/// The genes of the family: each a fixed value or an interval with a step. What is not written has its default, which
/// for disk-ring is the paper's.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default, rename = "genes")]
pub struct RawGenes {
    /// Bins of a shape histogram over 360 degrees. Default: 8 to 64.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "RawGene")]
    pub shape_bins: Option<RawGene>,
    /// Bins a side of a hue x saturation histogram. Default: 3 to 8.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "RawGene")]
    pub m: Option<RawGene>,
    /// Radius of the disk, centimetres. Default: 0.5 to 2.0 in steps of 0.1.
    #[serde(rename = "R1", skip_serializing_if = "Option::is_none")]
    #[schemars(with = "RawGene")]
    pub disk: Option<RawGene>,
    /// Outer radius of the ring, centimetres; always larger than R1. Default: 2.1 to 5.0 in steps of 0.1.
    #[serde(rename = "R2", skip_serializing_if = "Option::is_none")]
    #[schemars(with = "RawGene")]
    pub ring: Option<RawGene>,
    /// Weight of shape against colour in the set distance. Default: 0 to 1 in steps of 0.01.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "RawGene")]
    pub w: Option<RawGene>,
    /// Of global-hue: bins of the histogram. Default: 2 to 64.
    #[serde(skip_serializing_if = "Option::is_none")]
    #[schemars(with = "RawGene")]
    pub bins: Option<RawGene>,
}

impl RawGenes {
    /// Whether none is written.
    fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// Every gene by its name.
    pub fn by_name(&mut self) -> [(&'static str, &mut Option<RawGene>); 6] {
        let Self { shape_bins, m, disk, ring, w, bins } = self;
        [("shape_bins", shape_bins), ("m", m), ("R1", disk), ("R2", ring), ("w", w), ("bins", bins)]
    }
}
