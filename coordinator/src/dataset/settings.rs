//! What an experiment says about its data set, checked key by key and free of TOML.

use std::path::{Path, PathBuf};

use super::pattern::Pattern;

/// Where the clouds are, how their labels are found and how they are split.
///
/// The unit of length and whether colour is needed are part of [`descriptor::Preprocess`], because they change
/// what is computed from a cloud and not where it is found.
#[derive(Clone, Debug, PartialEq)]
pub struct DatasetSettings {
    /// Folder that holds the clouds; no cloud outside it is ever read.
    pub root: PathBuf,
    /// How category, instance and sequence of a cloud are found.
    pub layout: Layout,
    /// Which cloud is in which split.
    pub splits: SplitRule,
    /// Count and report unreadable clouds instead of stopping at them.
    pub skip_unreadable: bool,
    /// Set if `root` is made from the experiment itself. Whoever runs the experiment writes the clouds there
    /// before [`super::Dataset::load`], which only reads.
    pub synthetic: Option<SyntheticSettings>,
}

impl DatasetSettings {
    /// Changes every path: root, lists and manifest.
    pub fn map_paths(&mut self, change: impl Fn(&Path) -> PathBuf) {
        let mut paths = vec![&mut self.root];
        if let Layout::Manifest { file } = &mut self.layout {
            paths.push(file);
        }
        if let SplitRule::Lists(lists) = &mut self.splits {
            paths.extend(lists.iter_mut().flatten());
        }
        for path in paths {
            *path = change(path);
        }
    }
}

/// How the labels of a cloud are found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Layout {
    /// UW RGB-D: `<root>/<category>/<instance>/<instance>_<video>_<frame>.pcd`, `.ply` or `_crop.png` with the images beside
    /// it; a video is a sequence.
    Uw,
    /// `<root>/<category>/<instance>/<any name>.pcd`, `.ply` or `_crop.png`, without sequences.
    Folders,
    /// A CSV or Parquet file with the columns path, category, instance and, if wanted, sequence, split and set; paths are
    /// relative to the root.
    Manifest {
        /// Wherever it is.
        file: PathBuf,
    },
    /// Scenes of the BOP benchmark, in the root or one folder below: `<scene>/mask_visib/<image>_<object>.png` with
    /// `rgb`, `depth`, `scene_camera.json` and `scene_gt.json`. A scene is a sequence, an object a category of its own.
    Bop,
    /// Paths that say the labels as a pattern does; another cloud in the folders that it names is refused.
    Pattern(Pattern),
}

/// Which cloud is in which split.
#[derive(Clone, Debug, PartialEq)]
pub enum SplitRule {
    /// The lists of each of [`SPLITS`](super::SPLITS), of validation none where nothing asks for it: a path relative to
    /// the root on each line, `#` comments and blank lines allowed.
    Lists([Vec<PathBuf>; 4]),
    /// The column `split` of the manifest; an empty field leaves the cloud out.
    Manifest,
    /// Drawn from every cloud the layout finds.
    Seeded(SeededSplit),
}

/// A random split that depends on nothing but the seed and the clouds' paths.
#[derive(Clone, Debug, PartialEq)]
pub struct SeededSplit {
    /// Seed of the draw; the run's own seed has no part in it.
    pub seed: u64,
    /// Share of the clouds for train1, train2, validation and test: finite, not negative, at most 1 together.
    /// What is left over is not used.
    pub shares: [f64; 4],
    /// Draw within each instance, so that each has its share in each split; else from all clouds at once.
    pub stratified: bool,
    /// Sequences held out for the test, by name (in the `uw` layout the video's number). If any is given, test
    /// is exactly their clouds, the other clouds are drawn for the other splits, and the last share must be 0.
    pub test_sequences: Vec<String>,
}

/// A synthetic data set to be made before the run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SyntheticSettings {
    /// Number of instances.
    pub objects: u32,
    /// Views of each instance.
    pub views: u32,
    /// Seed of shapes, colours and views.
    pub seed: u64,
}
