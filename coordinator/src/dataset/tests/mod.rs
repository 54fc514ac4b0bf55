//! Data sets in temporary folders, the one of the benchmark, and everything that can be wrong with one.

mod errors;
mod formats;
mod images;
mod inspecting;
mod leaks;
mod loading;
mod manifests;
mod protocols;
mod remembering;
mod seeded;

use std::fs;
use std::path::{Path, PathBuf};

use descriptor::pcd::{self, DataEncoding};
use descriptor::{Cloud, Preprocess};
use tempfile::TempDir;

use super::{Dataset, DatasetError, DatasetSettings, Layout, SPLITS, SplitRule, Splits, Wanted};

/// A patch of 20 × 20 points, `spacing` apart, 0.5 m in front of the camera; `tone` tells clouds apart.
fn patch(spacing: f32, tone: u8) -> Cloud {
    let points = (0..400_u16)
        .map(|index| [f32::from(index % 20) * spacing, f32::from(index / 20) * spacing, 250.0 * spacing])
        .collect();
    Cloud { points, colours: Some(vec![[tone, 128, 255 - tone]; 400]), viewpoint: [0.0; 3] }
}

/// A data set in a folder that vanishes with it.
struct Fixture {
    folder: TempDir,
    clouds: u8,
}

impl Fixture {
    fn empty() -> Self {
        Self { folder: tempfile::tempdir().unwrap(), clouds: 0 }
    }

    /// Two categories of two instances, each with one cloud in each split.
    fn new() -> Self {
        let mut fixture = Self::empty();
        for instance in ["ball/ball_1", "ball/ball_2", "cup/cup_1", "cup/cup_2"] {
            for (frame, split) in (1..).zip(["train1", "train2", "validation", "test"]) {
                let path = format!("{instance}/{}_1_{frame}.pcd", instance.split('/').nth(1).unwrap());
                fixture.cloud(&path);
                fixture.append(&format!("{split}.txt"), &format!("{path}\n"));
            }
        }
        fixture
    }

    fn root(&self) -> &Path {
        self.folder.path()
    }

    fn write(&self, path: &str, bytes: impl AsRef<[u8]>) {
        let path = self.root().join(path);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
    }

    fn append(&self, path: &str, text: &str) {
        let before = fs::read_to_string(self.root().join(path)).unwrap_or_default();
        self.write(path, before + text);
    }

    /// A usable cloud with bytes of its own.
    fn cloud(&mut self, path: &str) {
        self.clouds += 1;
        self.write(path, pcd::write(&patch(0.002, self.clouds), DataEncoding::Binary));
    }

    fn settings(&self) -> DatasetSettings {
        let list = |split: &str| self.root().join(split).with_extension("txt");
        DatasetSettings {
            root: self.root().to_owned(),
            layout: Layout::Uw,
            splits: SplitRule::Lists(SPLITS.map(|split| vec![list(split)])),
            skip_unreadable: false,
            synthetic: None,
        }
    }

    /// The same with a manifest `clouds.csv` and its splits.
    fn manifest_settings(&self) -> DatasetSettings {
        let layout = Layout::Manifest { file: self.root().join("clouds.csv") };
        DatasetSettings { layout, splits: SplitRule::Manifest, ..self.settings() }
    }

    fn load(&self) -> Result<Dataset, DatasetError> {
        Dataset::load(&self.settings(), &Preprocess::default(), Wanted::All, None)
    }

    /// An error's text without the folder's own name.
    fn text(&self, error: &DatasetError) -> String {
        let root = fs::canonicalize(self.root()).unwrap();
        let text = error.to_string().replace(&format!("{}/", root.display()), "");
        text.replace(&format!("{}/", self.root().display()), "").replace(root.to_str().unwrap(), "<root>")
    }
}

/// Usable clouds of each split.
fn lengths(dataset: &Dataset) -> [usize; 4] {
    let Splits { train1, train2, validation, test } = &dataset.splits;
    [train1, train2, validation, test].map(Vec::len)
}

/// The shared data folder, or `None` with a word about it where it may be missing.
fn shared(folder: &str) -> Option<PathBuf> {
    let default = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared");
    let root = std::env::var("DESCRY_SHARED").unwrap_or_else(|_| default.to_owned());
    let folder = PathBuf::from(root).join(folder);
    if folder.is_dir() {
        return Some(folder);
    }
    let required = std::env::var("DESCRY_REQUIRE_SHARED").is_ok_and(|value| value == "1");
    assert!(!required, "{} is missing; set DESCRY_SHARED", folder.display());
    eprintln!("SKIPPED: {} is missing; set DESCRY_SHARED to run this test", folder.display());
    None
}
