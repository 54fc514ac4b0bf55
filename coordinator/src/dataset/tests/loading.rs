//! What a good data set loads as.

use std::fs;

use descriptor::Preprocess;
use descriptor::pcd::{self, DataEncoding};

use super::super::{
    Dataset, DatasetError, DatasetSettings, Instance, Layout, Listing, SPLITS, SequencesMissing, SplitRule,
    Splits, Wanted,
};
use super::{Fixture, lengths, patch, shared};

fn paths<'a>(dataset: &'a Dataset, split: &[u32]) -> Vec<&'a str> {
    split.iter().map(|&index| &*dataset.clouds.entries[index as usize].path).collect()
}

#[test]
fn clouds_get_the_labels_of_their_folders_and_the_order_of_their_lists() {
    let fixture = Fixture::new();
    // Lists in another order than folders, with comments, blank lines, CRLF and a byte order mark.
    let list = "\u{feff}# mine\r\n\r\ncup/cup_2/cup_2_1_1.pcd\r\n  ./ball//ball_1/ball_1_1_1.pcd  \r\n";
    fixture.write("train1.txt", list);
    let dataset = fixture.load().unwrap();
    assert_eq!(dataset.clouds.categories, ["ball", "cup"]);
    let instance = |name: &str, category| Instance { name: name.to_owned(), category };
    let instances =
        [instance("ball_1", 0), instance("ball_2", 0), instance("cup_1", 1), instance("cup_2", 1)];
    assert_eq!(dataset.clouds.instances, instances);
    assert_eq!(
        paths(&dataset, &dataset.splits.train1),
        ["cup/cup_2/cup_2_1_1.pcd", "ball/ball_1/ball_1_1_1.pcd"]
    );
    let expected = Splits {
        train1: vec![0, 1],
        train2: vec![2, 3, 4, 5],
        validation: vec![6, 7, 8, 9],
        test: vec![10, 11, 12, 13],
    };
    assert_eq!(dataset.splits, expected);
    for cloud in &dataset.clouds.entries {
        let bytes = fs::read(dataset.clouds.root.join(&cloud.path)).unwrap();
        assert_eq!(cloud.digest, *blake3::hash(&bytes).as_bytes());
        assert_eq!(cloud.bytes, bytes.len() as u64);
        let instance = &dataset.clouds.instances[cloud.instance as usize];
        assert_eq!(cloud.category, instance.category);
        let folder = format!("{}/{}/", dataset.clouds.categories[cloud.category as usize], instance.name);
        assert!(cloud.path.starts_with(&folder));
    }
    assert_eq!((dataset.clouds.skipped.len(), dataset.clouds.warnings.len()), (0, 0));
}

#[test]
fn a_manifest_gives_labels_and_splits() {
    let mut fixture = Fixture::empty();
    let mut rows = "split,path,note,category,instance\n".to_owned();
    for (split, name) in [("train1", "a"), ("train2", "b"), ("validation", "c"), ("test", "d"), ("", "e")] {
        fixture.cloud(&format!("{name}.pcd"));
        rows += &format!("{split}, {name}.pcd ,\"x, y\",fruit,pear\n");
    }
    fixture.write("clouds.csv", &rows);
    let dataset =
        Dataset::load(&fixture.manifest_settings(), &Preprocess::default(), Wanted::All, None).unwrap();
    assert_eq!(dataset.clouds.entries.len(), 4);
    assert_eq!(paths(&dataset, &dataset.splits.validation), ["c.pcd"]);
    assert_eq!(dataset.clouds.categories, ["fruit"]);
    assert_eq!(dataset.clouds.instances[0].name, "pear");

    // Lists may choose the splits, with the manifest's labels.
    let mut settings = fixture.manifest_settings();
    for (split, name) in [("train1", "e"), ("train2", "d"), ("validation", "c"), ("test", "b")] {
        fixture.write(&format!("{split}.txt"), format!("{name}.pcd\n"));
    }
    settings.splits = fixture.settings().splits;
    let dataset = Dataset::load(&settings, &Preprocess::default(), Wanted::All, None).unwrap();
    assert_eq!(paths(&dataset, &dataset.splits.train1), ["e.pcd"]);
    assert_eq!(dataset.clouds.entries[0].instance, 0);
}

#[test]
fn a_split_is_all_of_its_lists_in_their_order() {
    let mut fixture = Fixture::new();
    fixture.cloud("cup/cup_1/cup_1_9_1.pcd");
    fixture.write("more.txt", "cup/cup_1/cup_1_9_1.pcd\n");
    let mut settings = fixture.settings();
    let SplitRule::Lists(lists) = &mut settings.splits else { panic!("lists") };
    let validation = std::mem::take(&mut lists[2]);
    lists[1].insert(0, fixture.root().join("more.txt"));
    lists[1].extend(validation);
    let load =
        |settings: &DatasetSettings| Dataset::load(settings, &Preprocess::default(), Wanted::All, None);
    let (before, joined) = (fixture.load().unwrap(), load(&settings).unwrap());
    let of = |split: &[u32]| paths(&before, split).into_iter().map(str::to_owned).collect::<Vec<_>>();
    let expected = [
        vec!["cup/cup_1/cup_1_9_1.pcd".to_owned()],
        of(&before.splits.train2),
        of(&before.splits.validation),
    ];
    assert_eq!(paths(&joined, &joined.splits.train2), expected.concat());
    assert!(joined.splits.validation.is_empty());
    assert_eq!(paths(&joined, &joined.splits.test), paths(&before, &before.splits.test));

    // A list that is named is not to be empty, and no cloud is to be in two of a split.
    let SplitRule::Lists(lists) = &mut settings.splits else { panic!("lists") };
    lists[2].push(fixture.root().join("none.txt"));
    fixture.write("none.txt", "# nothing yet\n");
    assert_eq!(load(&settings).unwrap_err(), DatasetError::no_cloud("validation"));
    let SplitRule::Lists(lists) = &mut settings.splits else { panic!("lists") };
    lists[2].clear();
    lists[1].push(fixture.root().join("more.txt"));
    assert!(
        matches!(load(&settings).unwrap_err(), DatasetError::Twice { path, .. } if path == "cup/cup_1/cup_1_9_1.pcd")
    );
}

#[test]
fn a_manifest_may_be_without_validation_clouds() {
    let mut fixture = Fixture::empty();
    let mut rows = "split,path,category,instance\n".to_owned();
    for split in ["train1", "train2", "test"] {
        fixture.cloud(&format!("{split}.pcd"));
        rows += &format!("{split},{split}.pcd,fruit,pear\n");
    }
    fixture.write("clouds.csv", &rows);
    let settings = fixture.manifest_settings();
    let load = || Dataset::load(&settings, &Preprocess::default(), Wanted::All, None);
    let dataset = load().unwrap();
    assert_eq!(lengths(&dataset), [1, 1, 0, 1]);
    // Clouds that it has, but that cannot be used, are another thing.
    fixture.write("sparse.pcd", pcd::write(&patch(0.05, 1), DataEncoding::Binary));
    fixture.write("clouds.csv", rows + "validation,sparse.pcd,fruit,pear\n");
    let error = load().unwrap_err();
    assert!(matches!(error, DatasetError::EmptySplit { split: "validation", listed: 1, .. }), "{error}");
}

/// Rows of a manifest with the sequence of a cloud in each split.
fn with_sequences(sequences: [Option<&str>; 4]) -> Dataset {
    let mut fixture = Fixture::empty();
    let column = if sequences == [None; 4] { "" } else { ",sequence" };
    let mut rows = format!("path,category,instance,split{column}\n");
    for (split, sequence) in SPLITS.into_iter().zip(sequences) {
        fixture.cloud(&format!("{split}.pcd"));
        let field =
            if column.is_empty() { String::new() } else { format!(",{}", sequence.unwrap_or_default()) };
        rows += &format!("{split}.pcd,fruit,pear,{split}{field}\n");
    }
    fixture.write("clouds.csv", rows);
    Dataset::load(&fixture.manifest_settings(), &Preprocess::default(), Wanted::All, None).unwrap()
}

fn sequences(dataset: &Dataset) -> Vec<Option<&str>> {
    let name = |index: u32| &*dataset.clouds.sequences[index as usize];
    dataset.clouds.entries.iter().map(|cloud| cloud.sequence.map(name)).collect()
}

#[test]
fn sequences_are_numbered_by_name_over_all_objects() {
    let named = [Some("10"), Some("b"), Some("9"), Some("a b")];
    let dataset = with_sequences(named);
    assert_eq!(dataset.clouds.sequences, ["9", "10", "a b", "b"]);
    assert_eq!(sequences(&dataset), named);
    // Two spellings of a number are two names.
    assert_eq!(with_sequences([Some("1"), Some("01"), Some("1"), Some("")]).clouds.sequences, ["01", "1"]);

    // In the UW layout the video, whichever the object.
    let mut fixture = Fixture::new();
    fixture.cloud("cup/cup_2/cup_2_12_1.pcd");
    fixture.append("train1.txt", "cup/cup_2/cup_2_12_1.pcd\n");
    let dataset = fixture.load().unwrap();
    assert_eq!(dataset.clouds.sequences, ["1", "12"]);
    for (cloud, sequence) in dataset.clouds.entries.iter().zip(sequences(&dataset)) {
        let expected = if cloud.path.contains("_12_") { "12" } else { "1" };
        assert_eq!(sequence, Some(expected), "{}", cloud.path);
    }
}

#[test]
fn clouds_without_a_sequence_are_counted_by_split() {
    let dataset = with_sequences([Some("1"), None, Some("2"), None]);
    let missing = |count, first: &str| Some(SequencesMissing { count, first: first.to_owned() });
    assert_eq!(dataset.sequences_missing(&[0, 2]), None);
    assert_eq!(dataset.sequences_missing(&[0, 1]), missing(1, "train2.pcd"));
    assert_eq!(dataset.sequences_missing(&[3, 2, 1, 0]), missing(2, "test.pcd"));
    assert_eq!(dataset.sequences_missing(&[]), None);
    let without = with_sequences([None; 4]);
    assert_eq!(without.sequences_missing(&[0, 1, 2, 3]), missing(4, "train1.pcd"));
    assert_eq!(without.clouds.digest, dataset.clouds.digest, "sequences are no part of the data digest");
}

#[test]
fn the_data_digest_changes_with_bytes_labels_and_lines_and_with_nothing_else() {
    let digest = |change: &dyn Fn(&mut Fixture)| {
        let mut fixture = Fixture::new();
        change(&mut fixture);
        let settings = super::DatasetSettings { layout: Layout::Folders, ..fixture.settings() };
        Dataset::load(&settings, &Preprocess::default(), Wanted::All, None).unwrap().clouds.digest
    };
    let base = digest(&|_| {});
    assert_eq!(base, digest(&|fixture| fixture.append("train1.txt", "# a comment\n")));
    assert_eq!(base, digest(&|fixture| fixture.cloud("ball/ball_1/unlisted.pcd")));
    assert_eq!(
        base,
        digest(&|fixture| {
            let folder = fixture.root().join("cup/cup_1");
            fs::rename(folder.join("cup_1_1_1.pcd"), folder.join("other name.pcd")).unwrap();
            let list = fs::read_to_string(fixture.root().join("train1.txt")).unwrap();
            fixture.write("train1.txt", list.replace("cup_1_1_1", "other name"));
        })
    );
    let relabel = |fixture: &mut Fixture, from: &str, to: &str| {
        fs::create_dir_all(fixture.root().join(to).parent().unwrap()).unwrap();
        fs::rename(fixture.root().join(from), fixture.root().join(to)).unwrap();
        for split in SPLITS {
            let name = format!("{split}.txt");
            let list = fs::read_to_string(fixture.root().join(&name)).unwrap();
            fixture.write(&name, list.replace(&format!("{from}/"), &format!("{to}/")));
        }
    };
    let changed = [
        digest(&|fixture| {
            let mut bytes = fs::read(fixture.root().join("ball/ball_1/ball_1_1_4.pcd")).unwrap();
            *bytes.last_mut().unwrap() ^= 1;
            fixture.write("ball/ball_1/ball_1_1_4.pcd", bytes);
        }),
        digest(&|fixture| {
            let list = fs::read_to_string(fixture.root().join("test.txt")).unwrap();
            fixture.write("test.txt", list.lines().rev().collect::<Vec<_>>().join("\n"));
        }),
        digest(&|fixture| {
            let list = fs::read_to_string(fixture.root().join("test.txt")).unwrap();
            fixture.write("test.txt", list.lines().skip(1).collect::<Vec<_>>().join("\n"));
        }),
        digest(&|fixture| {
            fs::rename(fixture.root().join("train1.txt"), fixture.root().join("kept.txt")).unwrap();
            fs::rename(fixture.root().join("train2.txt"), fixture.root().join("train1.txt")).unwrap();
            fs::rename(fixture.root().join("kept.txt"), fixture.root().join("train2.txt")).unwrap();
        }),
        digest(&|fixture| relabel(fixture, "ball", "sphere")),
        digest(&|fixture| relabel(fixture, "ball/ball_1", "ball/ball_3")),
        digest(&|fixture| relabel(fixture, "ball/ball_1", "cup/ball_1")),
    ];
    for (index, digest) in changed.iter().enumerate() {
        assert!(*digest != base && !changed[..index].contains(digest), "change {index}");
    }
}

#[test]
fn queries_and_a_database_are_listed_without_an_experiment() {
    let fixture = Fixture::new();
    let list = |name: &str| fixture.root().join(name);
    let load = |query: &[&str], database: &[&str]| {
        let lists = |names: &[&str]| names.iter().map(|name| list(name)).collect::<Vec<_>>();
        Listing::load(fixture.root(), &Layout::Uw, &lists(query), &lists(database))
    };
    let listing = load(&["test.txt", "train1.txt"], &["train2.txt"]).unwrap();
    assert_eq!((listing.clouds.len(), listing.queries), (12, 8));
    for (index, path, category, instance) in [
        (0, "ball/ball_1/ball_1_1_4.pcd", 0, 0),
        (5, "ball/ball_2/ball_2_1_1.pcd", 0, 1),
        (11, "cup/cup_2/cup_2_1_2.pcd", 1, 3),
    ] {
        let cloud = &listing.clouds[index];
        assert_eq!((&*cloud.path, cloud.category, cloud.instance), (path, category, instance));
        assert_eq!(cloud.file, fs::canonicalize(list(path)).unwrap());
    }
    assert_eq!(listing.categories, ["ball", "cup"]);
    assert_eq!(listing.instances[3].name, "cup_2");

    let error = load(&["test.txt"], &["train2.txt", "test.txt"]).unwrap_err();
    assert!(matches!(error, DatasetError::Overlap { first_split: "query", second_split: "database", .. }));
    let error = load(&["test.txt"], &[]).unwrap_err();
    assert_eq!(error, DatasetError::no_cloud("database"));
}

#[test]
fn the_benchmark_loads_whole() {
    let Some(root) = shared("data/household-rgbd") else { return };
    let list = |split: &str| root.join(split).with_extension("txt");
    let mut settings = Fixture::empty().settings();
    settings.splits = SplitRule::Lists(SPLITS.map(|split| vec![list(split)]));
    settings.root = root.clone();
    let dataset = Dataset::load(&settings, &Preprocess::default(), Wanted::All, None).unwrap();
    assert_eq!(lengths(&dataset), [352, 352, 239, 475]);
    assert_eq!((dataset.clouds.categories.len(), dataset.clouds.instances.len()), (10, 48));
    assert_eq!(dataset.clouds.skipped, []);
    assert_eq!(dataset.clouds.warnings, Vec::<String>::new());
}
