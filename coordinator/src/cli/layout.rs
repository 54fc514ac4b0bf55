//! How the names of clouds are found, for commands without an experiment file.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

use crate::dataset::{Layout, Pattern};

/// One of a layout's name, a manifest and a pattern.
#[derive(Debug, Args)]
pub(super) struct LayoutArgs {
    /// How folders and files name objects, for example uw (default: uw for split, folders for others)
    #[arg(long, value_name = "NAME", conflicts_with_all = ["manifest", "pattern"])]
    layout: Option<LayoutName>,
    /// CSV or Parquet file with the columns path, category, instance and, if wanted, sequence, for clouds in no such
    /// folders, for example labels.csv
    #[arg(long, value_name = "FILE", conflicts_with = "pattern")]
    manifest: Option<PathBuf>,
    /// Paths of clouds below the folder, with names for parts of them, for example {category}_{instance}_{sequence}_{any}.pcd
    #[arg(long, value_name = "PATTERN")]
    pattern: Option<Pattern>,
}

/// A layout that folders alone make.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub(super) enum LayoutName {
    /// <category>/<instance>/<any name>.pcd, .ply or _crop.png, without sequences
    Folders,
    /// <category>/<instance>/<instance>_<video>_<frame>.pcd, .ply or _crop.png, a video being a sequence
    Uw,
    /// <scene>/mask_visib/<image>_<object>.png of the BOP benchmark, a scene being a sequence
    Bop,
}

impl LayoutArgs {
    /// As data sets have it, and `default` if none is given.
    pub(super) fn or(self, default: LayoutName) -> Layout {
        match (self.manifest, self.pattern, self.layout.unwrap_or(default)) {
            (Some(file), ..) => Layout::Manifest { file },
            (None, Some(pattern), _) => Layout::Pattern(pattern),
            (None, None, LayoutName::Folders) => Layout::Folders,
            (None, None, LayoutName::Uw) => Layout::Uw,
            (None, None, LayoutName::Bop) => Layout::Bop,
        }
    }
}
