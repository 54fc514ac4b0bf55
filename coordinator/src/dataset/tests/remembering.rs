//! What is remembered from one start to the next changes nothing but the time it takes.

use std::fs;
use std::path::PathBuf;

use cache::Store;
use descriptor::pcd::{self, DataEncoding};
use descriptor::{Cloud, Preprocess};
use tempfile::TempDir;

use super::super::{Dataset, DatasetError, DatasetSettings, Wanted};
use super::{Fixture, patch};
use crate::storage::store_in;

/// A store and the one entry that loading a data set leaves in it.
struct Kept {
    folder: TempDir,
    store: Store,
}

impl Kept {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let store = store_in(folder.path());
        Self { folder, store }
    }

    fn load(&self, settings: &DatasetSettings, preprocess: &Preprocess) -> Result<Dataset, DatasetError> {
        Dataset::load(settings, preprocess, Wanted::All, Some(&self.store))
    }

    fn files(&self) -> Vec<PathBuf> {
        let mut found = Vec::new();
        let mut folders = vec![self.folder.path().to_owned()];
        while let Some(folder) = folders.pop() {
            for entry in fs::read_dir(folder).unwrap() {
                let path = entry.unwrap().path();
                if path.is_dir() { folders.push(path) } else { found.push(path) }
            }
        }
        found
    }
}

/// Clouds of every sort: usable, too small, without normals, unreadable, copied, far too sparse for their unit.
fn mixed() -> (Fixture, DatasetSettings, Preprocess) {
    let fixture = Fixture::new();
    for (name, spacing) in (1..).zip([0.06, 0.07, 0.08]) {
        let cloud = pcd::write(&patch(spacing, 200 + name), DataEncoding::Binary);
        fixture.write(&format!("ball/ball_1/ball_1_1_{name}.pcd"), cloud);
    }
    let few = Cloud { points: vec![[0.0; 3]; 3], colours: Some(vec![[0; 3]; 3]), viewpoint: [0.0; 3] };
    fixture.write("ball/ball_2/ball_2_1_1.pcd", pcd::write(&few, DataEncoding::Ascii));
    fixture.write("ball/ball_2/ball_2_1_2.pcd", "no cloud\n");
    let copy = fs::read(fixture.root().join("cup/cup_1/cup_1_1_1.pcd")).unwrap();
    fixture.write("cup/cup_1/cup_1_1_4.pcd", copy);
    let settings = DatasetSettings { skip_unreadable: true, ..fixture.settings() };
    (fixture, settings, Preprocess::default())
}

#[test]
fn a_data_set_is_the_same_whether_its_inspection_is_remembered_or_not() {
    let (_fixture, settings, preprocess) = mixed();
    let plain = Dataset::load(&settings, &preprocess, Wanted::All, None).unwrap();
    assert!(plain.clouds.skipped.len() >= 4 && !plain.clouds.warnings.is_empty(), "{plain:?}");
    let kept = Kept::new();
    assert_eq!(kept.load(&settings, &preprocess).unwrap(), plain);
    assert_eq!(kept.files().len(), 1);
    assert_eq!(kept.load(&settings, &preprocess).unwrap(), plain);
}

#[test]
fn a_remembered_spacing_is_warned_of_again() {
    let fixture = Fixture::new();
    let preprocess = Preprocess::default();
    for (tone, split) in (1..).zip(["train1", "train2", "validation", "test"]) {
        for (number, path) in
            (0..).zip(fs::read_to_string(fixture.root().join(format!("{split}.txt"))).unwrap().lines())
        {
            fixture.write(path, pcd::write(&patch(0.000_015, 10 * tone + number), DataEncoding::Binary));
        }
    }
    let kept = Kept::new();
    let cold = kept.load(&fixture.settings(), &preprocess).unwrap();
    assert!(cold.clouds.warnings[0].contains("dataset.unit"), "{:?}", cold.clouds.warnings);
    assert_eq!(kept.load(&fixture.settings(), &preprocess).unwrap(), cold);
}

#[test]
fn a_file_that_has_changed_is_inspected_again() {
    let (fixture, settings, preprocess) = mixed();
    let kept = Kept::new();
    let before = kept.load(&settings, &preprocess).unwrap();
    fixture.write("cup/cup_2/cup_2_1_1.pcd", pcd::write(&patch(0.05, 1), DataEncoding::Binary));
    let after = kept.load(&settings, &preprocess).unwrap();
    assert_eq!(after, Dataset::load(&settings, &preprocess, Wanted::All, None).unwrap());
    assert_ne!(after.clouds.digest, before.clouds.digest);
    assert_eq!(after.clouds.skipped.len(), before.clouds.skipped.len() + 1);
}

#[test]
fn other_settings_are_other_findings() {
    let (_fixture, settings, preprocess) = mixed();
    let kept = Kept::new();
    kept.load(&settings, &preprocess).unwrap();
    let wide = Preprocess { normal_radius_um: 200_000, min_points: 1, ..preprocess };
    assert_eq!(
        kept.load(&settings, &wide).unwrap(),
        Dataset::load(&settings, &wide, Wanted::All, None).unwrap()
    );
    assert_eq!(kept.files().len(), 2);
}

#[test]
fn an_entry_that_makes_no_sense_is_replaced() {
    let (_fixture, settings, preprocess) = mixed();
    let kept = Kept::new();
    let cold = kept.load(&settings, &preprocess).unwrap();
    let [file] = &kept.files()[..] else { panic!("{:?}", kept.files()) };
    let sound = fs::read(file).unwrap();
    fs::write(file, &sound[..sound.len() - 1]).unwrap();
    assert_eq!(kept.load(&settings, &preprocess).unwrap(), cold);
    assert_eq!(fs::read(file).unwrap(), sound);
}
