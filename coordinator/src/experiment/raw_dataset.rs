//! Section `[dataset]` of the experiment file as written. Its doc comments speak to the author of an experiment.

use descriptor::Unit;
use descriptor::synth::SynthSettings;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::forms::RawSplits;

/// The clouds, their labels and their splits.
///
/// In every path ${VAR} and ${VAR:-default} stand for environment variables. A relative root is relative to the folder
/// of the experiment file; manifest and lists, and the paths in them, are relative to root.
#[derive(Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, rename = "dataset")]
pub(super) struct RawDataset {
    /// Folder that holds the clouds; a relative path is relative to the folder of the experiment file.
    #[schemars(example = &"${UW_RGBD:-../../rgbd-dataset}")]
    pub root: String,
    /// How the labels of a cloud are found.
    #[serde(default)]
    pub layout: RawLayout,
    /// CSV or Parquet file with the columns path (relative to root), category, instance and, if wanted, sequence, split
    /// and set; a relative path is relative to root. Only for layout = "manifest".
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "String", example = &"clouds.csv")]
    pub manifest: Option<String>,
    /// Path of a cloud below root, with {category}, {instance}, {sequence} and {any} for parts of it. Names are read from
    /// their ends: each of these takes as few characters as it can, the first of a name what is left. An instance is named
    /// category_instance; without {category} each instance is a category of its own. Only for layout = "pattern".
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "String", example = &"{category}_{instance}_{sequence}_{any}.pcd")]
    pub pattern: Option<String>,
    /// Unit of length in the clouds.
    #[serde(default)]
    pub unit: RawUnit,
    /// Count and report unreadable clouds, instead of stopping at the first before the search.
    #[serde(default)]
    pub skip_unreadable: bool,
    /// Which cloud is in which split. Default: the lists train1.txt, train2.txt, validation.txt and test.txt in
    /// root; for layout = "manifest" the manifest's column.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "RawSplits")]
    pub splits: Option<RawSplits>,
    /// Make the clouds, with their lists, in root before the run. Only for layout = "uw".
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "RawSynthetic")]
    pub synthetic: Option<RawSynthetic>,
}

/// How the labels of a cloud are found.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "lowercase", rename = "layout")]
pub(super) enum RawLayout {
    /// UW RGB-D: category/instance/instance_video_frame.pcd, .ply or _crop.png, with depth and mask beside it.
    #[default]
    Uw,
    /// category/instance/any-name.pcd, .ply or _crop.png.
    Folders,
    /// Scenes of the BOP benchmark: scene/mask_visib/image_object.png, with rgb, depth and both JSON files.
    Bop,
    /// As a CSV or Parquet file says.
    Manifest,
    /// As the path says, which `pattern` describes.
    Pattern,
}

/// Unit of length in the clouds.
#[derive(Clone, Copy, Debug, Default, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "lowercase", rename = "unit")]
pub(super) enum RawUnit {
    /// Metres.
    #[default]
    M,
    /// Millimetres.
    Mm,
}

impl From<RawUnit> for Unit {
    fn from(unit: RawUnit) -> Self {
        match unit {
            RawUnit::M => Self::Metre,
            RawUnit::Mm => Self::Millimetre,
        }
    }
}

/// Synthetic clouds: views of made-up household objects by a virtual depth camera.
#[derive(Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields, default, rename = "synthetic")]
pub(super) struct RawSynthetic {
    /// Number of objects (instances).
    #[schemars(range(min = 2, max = 1000))]
    pub objects: u32,
    /// Views of each object.
    #[schemars(range(min = 4, max = 1000))]
    pub views: u32,
    /// Seed of shapes, colours and views.
    #[schemars(range(min = 0, max = 9_223_372_036_854_775_807_i64))]
    pub seed: u64,
}

impl Default for RawSynthetic {
    fn default() -> Self {
        let made = SynthSettings::default();
        Self { objects: made.objects(), views: made.views(), seed: made.seed() }
    }
}
