//! Protocols: everything is tested once, nothing trains and tests, and the same seed splits alike.

use std::collections::{BTreeMap, BTreeSet};

use super::super::{DatasetError, Fold, Folds, Layout, Protocol};
use super::Fixture;

/// Three categories of 3, 2 and 1 objects with 2 videos of 9 clouds each; every file has bytes of its own.
fn data() -> Fixture {
    let fixture = Fixture::empty();
    for (category, objects) in [("ball", 3), ("cup", 2), ("pen", 1)] {
        for (object, video, frame) in
            (0..objects).flat_map(|o| (1..=2).flat_map(move |v| (0..9).map(move |f| (o, v, f))))
        {
            let name = format!("{category}_{object}");
            let path = format!("{category}/{name}/{name}_{video}_{frame}.pcd");
            fixture.write(&path, &path);
        }
    }
    fixture
}

fn folds(fixture: &Fixture, protocol: Protocol, seed: u64) -> Result<Folds, DatasetError> {
    protocol.folds(fixture.root(), &Layout::Uw, seed)
}

/// Object and video in a path.
fn label(path: &str) -> (&str, &str) {
    let name = path.rsplit('/').next().unwrap();
    let mut parts = name.rsplitn(3, '_').skip(1);
    let video = parts.next().unwrap();
    (parts.next().unwrap(), video)
}

const ALL: [Protocol; 4] = [Protocol::Paper, Protocol::Sequences, Protocol::Instances, Protocol::Folds(4)];

#[test]
fn no_cloud_is_in_two_splits_and_none_is_left_out() {
    let fixture = data();
    for (protocol, seed) in ALL.into_iter().flat_map(|protocol| (0..10).map(move |seed| (protocol, seed))) {
        let folds = folds(&fixture, protocol, seed).unwrap();
        let names: BTreeSet<&str> = folds.folds.iter().map(|fold| &*fold.name).collect();
        assert_eq!(names.len(), folds.folds.len(), "{names:?}");
        for Fold { name, splits } in &folds.folds {
            let all: Vec<&String> = splits.iter().flatten().collect();
            let unique: BTreeSet<&String> = all.iter().copied().collect();
            assert_eq!((all.len(), unique.len()), (108, 108), "{name}");
            assert!(splits.iter().all(|paths| !paths.is_empty()), "{name}");
            // Of what is not tested, each object has its share in each split.
            let [train1, train2, validation] = [0, 1, 2].map(|split: usize| splits[split].len() as f64);
            let trained = train1 + train2 + validation;
            for (count, share) in [(train1, 352.0), (train2, 352.0), (validation, 239.0)] {
                assert!((count - trained * share / 943.0).abs() < 1.5, "{name}: {count} of {trained}");
            }
        }
        assert_eq!(folds, self::folds(&fixture, protocol, seed).unwrap());
    }
}

#[test]
fn every_cloud_is_tested_once_by_sequences_and_by_folds() {
    let fixture = data();
    for (protocol, count) in [(Protocol::Sequences, 2), (Protocol::Folds(4), 4), (Protocol::Folds(9), 9)] {
        let folds = folds(&fixture, protocol, 3).unwrap().folds;
        assert_eq!(folds.len(), count);
        let tested: Vec<&String> = folds.iter().flat_map(|fold| &fold.splits[3]).collect();
        let unique: BTreeSet<&String> = tested.iter().copied().collect();
        assert_eq!((tested.len(), unique.len()), (108, 108), "{protocol:?}");
        for fold in &folds {
            let mut of_object: BTreeMap<&str, usize> = BTreeMap::new();
            fold.splits[3].iter().for_each(|path| *of_object.entry(label(path).0).or_default() += 1);
            let most = of_object.values().max().unwrap() - of_object.values().min().unwrap();
            assert!(most <= 2, "{}: {of_object:?}", fold.name);
        }
    }
}

#[test]
fn what_is_held_out_is_held_out_whole() {
    let fixture = data();
    for Fold { name, splits } in folds(&fixture, Protocol::Sequences, 1).unwrap().folds {
        let video = name.strip_prefix("sequence-").unwrap();
        assert!(splits[3].iter().all(|path| label(path).1 == video), "{name}");
        assert!(splits[..3].iter().flatten().all(|path| label(path).1 != video), "{name}");
    }
    let held = folds(&fixture, Protocol::Instances, 1).unwrap();
    assert_eq!(held.lone_categories, ["pen"]);
    assert_eq!(held.folds.len(), 3, "as many as the largest category has objects");
    let mut tested = BTreeSet::new();
    for Fold { name, splits } in &held.folds {
        let objects: BTreeSet<&str> = splits[3].iter().map(|path| label(path).0).collect();
        let categories: BTreeSet<&str> = objects.iter().map(|object| &object[..object.len() - 2]).collect();
        assert_eq!((objects.len(), categories), (2, ["ball", "cup"].into()), "{name}");
        assert!(splits[..3].iter().flatten().all(|path| !objects.contains(label(path).0)), "{name}");
        tested.extend(objects.into_iter().map(str::to_owned));
    }
    assert_eq!(tested.len(), 5, "each object of the others is held out at least once");
}

#[test]
fn the_papers_shares_are_those_of_its_data_set() {
    let fold = folds(&data(), Protocol::Paper, 1).unwrap().folds.remove(0);
    for (paths, share) in fold.splits.iter().zip([352.0, 352.0, 239.0, 475.0]) {
        assert!((paths.len() as f64 - 108.0 * share / 1418.0).abs() < 2.0, "{}", paths.len());
    }
}

#[test]
fn a_frame_that_is_there_twice_is_in_one_split_only() {
    let fixture = data();
    fixture.write("ball/ball_0/ball_0_2_100.pcd", "ball/ball_0/ball_0_1_3.pcd");
    fixture.write("ball/ball_0/notes.pcd", "");
    let folds = folds(&fixture, Protocol::Sequences, 1).unwrap();
    assert_eq!(folds.copies, ["ball/ball_0/ball_0_2_100.pcd"]);
    assert_eq!(folds.ignored, ["ball/ball_0/notes.pcd"]);
    assert_eq!(folds.folds[0].splits.iter().flatten().count(), 108);
}

#[test]
fn sequences_of_any_name_have_a_folder_each_and_paths_that_no_list_can_hold_are_refused() {
    let fixture = Fixture::empty();
    let mut manifest = "path,category,instance,sequence\n".to_owned();
    let names = ["a b", "a_b", "../c", &"d".repeat(300)];
    for (index, name) in (0..20).zip(names.iter().cycle()) {
        fixture.write(&format!("{index}.pcd"), index.to_string());
        manifest.push_str(&format!("{index}.pcd,ball,ball_1,{name}\n"));
    }
    fixture.write("clouds.csv", &manifest);
    let layout = Layout::Manifest { file: fixture.root().join("clouds.csv") };
    let sequences = Protocol::Sequences.folds(fixture.root(), &layout, 1).unwrap().folds;
    let folders: BTreeSet<&str> = sequences.iter().map(|fold| &*fold.name).collect();
    assert_eq!(folders.len(), 4);
    assert!(folders.iter().all(|name| name.len() < 100 && !name.contains(['/', ' ', '.'])), "{folders:?}");

    for folder in ["#cup", " cup"] {
        let fixture = data();
        fixture.write(&format!("{folder}/x/x_1_1.pcd"), "y");
        let refused = folds(&fixture, Protocol::Paper, 1).unwrap_err().to_string();
        assert!(
            refused.contains(&format!("paths that a list can hold expected, got {folder}/x/")),
            "{refused}"
        );
    }
}

#[test]
fn a_data_set_that_cannot_be_split_so_is_refused() {
    let fixture = data();
    let refused = |protocol| {
        let error = folds(&fixture, protocol, 1).unwrap_err().to_string();
        assert!(error.lines().count() == 2, "{error}");
        error
    };
    assert!(refused(Protocol::Folds(1)).contains("2 folds to one a cloud expected, got 1 of 108 clouds"));
    assert!(refused(Protocol::Folds(109)).contains("got 109 of 108 clouds"));
    let one = Fixture::empty();
    one.write("ball/ball_1/ball_1_1_1.pcd", "x");
    for protocol in ALL {
        assert!(folds(&one, protocol, 1).is_err(), "{protocol:?}");
    }
    assert!(folds(&Fixture::empty(), Protocol::Paper, 1).is_err());
    assert!(Protocol::Paper.folds("/nowhere".as_ref(), &Layout::Uw, 1).is_err());
}
