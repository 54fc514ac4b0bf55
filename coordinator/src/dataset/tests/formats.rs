//! Clouds of other formats than PCD, and folders without any cloud.

use descriptor::Preprocess;
use expect_test::{Expect, expect};

use super::super::{Dataset, DatasetSettings, Layout, SeededSplit, SplitRule, Wanted};
use super::{Fixture, lengths};

/// A patch of 20 × 20 points as PLY, with bytes of its own.
fn ply(tone: u8) -> String {
    let header = "ply\nformat ascii 1.0\nelement vertex 400\nproperty float x\nproperty float y\nproperty float z\n\
                  property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n";
    let row = |index: u16| {
        let [x, y] = [index % 20, index / 20].map(|steps| f32::from(steps) * 0.002);
        format!("{x} {y} 0.5 {tone} 128 9\n")
    };
    let rows = (0..400).map(row);
    header.to_owned() + &rows.collect::<String>()
}

fn drawn(fixture: &Fixture, layout: Layout) -> DatasetSettings {
    let rule = SeededSplit { seed: 1, shares: [0.25; 4], stratified: true, test_sequences: Vec::new() };
    DatasetSettings { splits: SplitRule::Seeded(rule), layout, ..fixture.settings() }
}

fn message(fixture: &Fixture, settings: &DatasetSettings) -> String {
    let error = Dataset::load(settings, &Preprocess::default(), Wanted::All, None).unwrap_err();
    fixture.text(&error)
}

#[test]
fn layouts_find_ply_files_beside_pcd_files() {
    for (layout, name) in [(Layout::Uw, "cup_1_2_"), (Layout::Folders, "any ")] {
        let mut fixture = Fixture::empty();
        for frame in 1..=8 {
            let path = format!("cup/cup_1/{name}{frame}");
            if frame % 2 == 0 {
                fixture.cloud(&format!("{path}.pcd"));
            } else {
                fixture.write(&format!("{path}.ply"), ply(frame));
            }
        }
        let settings = drawn(&fixture, layout);
        let dataset = Dataset::load(&settings, &Preprocess::default(), Wanted::All, None).unwrap();
        assert_eq!(lengths(&dataset), [2; 4]);
        let found = dataset.clouds.entries.iter().filter(|cloud| cloud.path.ends_with(".ply")).count();
        assert_eq!(found, 4);
        let sequences: Vec<&str> = dataset.clouds.sequences.iter().map(String::as_str).collect();
        assert_eq!(sequences, if settings.layout == Layout::Uw { vec!["2"] } else { vec![] });
    }
}

#[test]
fn a_cloud_in_two_formats_is_refused() {
    let mut fixture = Fixture::empty();
    fixture.cloud("cup/cup_1/a.pcd");
    fixture.write("cup/cup_1/a.ply", ply(1));
    expect![[r#"
        cup/cup_1/a.pcd: each cloud in one file expected, got cup/cup_1/a.ply beside it
        move one of the two out of the data root"#]]
    .assert_eq(&message(&fixture, &drawn(&fixture, Layout::Folders)));
}

#[test]
fn folders_without_clouds_are_told_what_is_there() {
    let check = |files: &[&str], expected: Expect| {
        let fixture = Fixture::empty();
        for file in files {
            fixture.write(file, "");
        }
        let text = message(&fixture, &drawn(&fixture, Layout::Folders));
        expected.assert_eq(&text);
    };
    check(
        &[],
        expect![[r#"
            <root>: clouds at <category>/<instance>/<name>.pcd, .ply or _crop.png expected, got no files
            clouds are read from PCD, PLY and RGB-D images: put them there, for example as Open3D's io.write_point_cloud writes them"#]],
    );
    check(
        &["a.ply", "b.PLY", "notes.txt", ".hidden.ply"],
        expect![[r#"
            <root>: clouds at <category>/<instance>/<name>.pcd, .ply or _crop.png expected, got 2 .ply, 1 .txt
            clouds are read from PCD, PLY and RGB-D images: move them there, or describe where they are by layout "pattern" or a manifest"#]],
    );
    check(
        &["cup/cup_1/a.xyz", "cup/cup_1/b.xyz", "cup/cup_1/README", "cup/cup_1/v1.of the cup"],
        expect![[r#"
            <root>: clouds at <category>/<instance>/<name>.pcd, .ply or _crop.png expected, got 2 .xyz, 2 without ending
            clouds are read from PCD, PLY and RGB-D images: python3 -c 'import open3d as o, sys; o.io.write_point_cloud(sys.argv[2], o.io.read_point_cloud(sys.argv[1]))' IN.xyz OUT.ply"#]],
    );
    for (file, advice) in [
        ("a/b/c.obj", "IN.obj OUT.ply"),
        ("a/b/c.stl", "IN.obj OUT.ply"),
        ("a/b/c.npy", "IN.npy OUT.ply"),
        ("a/b/c.las", "IN.las OUT.ply"),
        ("a/b/c.bag", "bag_to_pcd"),
        ("a/b/c/d/e.png", "create_from_rgbd_image"),
    ] {
        let fixture = Fixture::empty();
        fixture.write(file, "");
        let text = message(&fixture, &drawn(&fixture, Layout::Uw));
        assert!(text.contains(advice) && text.lines().count() == 2, "{text}");
    }
}

fn pattern(text: &str) -> Layout {
    Layout::Pattern(text.parse().unwrap())
}

#[test]
fn a_pattern_labels_the_files_of_one_folder() {
    let mut fixture = Fixture::empty();
    for category in ["coffee_mug", "cup"] {
        for (number, sequence, frame) in [(1, 1, 10), (1, 2, 20), (2, 1, 30), (2, 2, 40)] {
            fixture.cloud(&format!("scans/{category}_{number}_{sequence}_{frame}.pcd"));
        }
    }
    fixture.write("scans/notes.txt", "not a cloud");
    fixture.write("other/of another pattern.pcd", "not looked at");
    let settings = drawn(&fixture, pattern("scans/{category}_{instance}_{sequence}_{any}.pcd"));
    let settings = DatasetSettings {
        splits: SplitRule::Seeded(SeededSplit {
            seed: 1,
            shares: [0.34, 0.33, 0.33, 0.0],
            stratified: false,
            test_sequences: vec!["2".to_owned()],
        }),
        ..settings
    };
    let dataset = Dataset::load(&settings, &Preprocess::default(), Wanted::All, None).unwrap();
    let clouds = &dataset.clouds;
    assert_eq!(clouds.categories, ["coffee_mug", "cup"]);
    let instances: Vec<&str> = clouds.instances.iter().map(|instance| &*instance.name).collect();
    assert_eq!(instances, ["coffee_mug_1", "coffee_mug_2", "cup_1", "cup_2"]);
    assert_eq!(clouds.sequences, ["1", "2"]);
    assert_eq!(lengths(&dataset)[3], 4);
}

#[test]
fn what_a_pattern_does_not_read_is_named() {
    let mut fixture = Fixture::empty();
    fixture.cloud("cup_1_1.pcd");
    fixture.cloud("background.pcd");
    let settings = drawn(&fixture, pattern("{instance}_{sequence}_{any}.pcd"));
    expect![[r#"
        background.pcd: path of the form {instance}_{sequence}_{any}.pcd expected, got background.pcd
        rename or move the cloud, or correct the pattern (a manifest can describe any path)"#]]
    .assert_eq(&message(&fixture, &settings));
    let listed = DatasetSettings { layout: settings.layout.clone(), ..fixture.settings() };
    for (split, path) in
        [("train1", "cup_1_1.pcd"), ("train2", "background.pcd"), ("validation", ""), ("test", "")]
    {
        fixture.append(&format!("{split}.txt"), &format!("{path}\n"));
    }
    expect![[r#"
        train2.txt, line 1: path of the form {instance}_{sequence}_{any}.pcd expected, got background.pcd
        rename or move the cloud, or correct the pattern (a manifest can describe any path)"#]]
    .assert_eq(&message(&fixture, &listed));
    let mut fixture = Fixture::empty();
    fixture.cloud("others/cup_1_1.pcd");
    let elsewhere = drawn(&fixture, pattern("scans/{instance}.pcd"));
    expect![[r#"
        <root>: clouds at scans/{instance}.pcd expected, got 1 .pcd
        clouds are read from PCD, PLY and RGB-D images: move them there, or describe where they are by layout "pattern" or a manifest"#]]
    .assert_eq(&message(&fixture, &elsewhere));
}
