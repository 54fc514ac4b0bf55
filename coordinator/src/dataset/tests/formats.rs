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
            <root>: clouds at <category>/<instance>/<name>.pcd or .ply expected, got no files
            clouds are read from PCD and PLY files: put them there, for example as Open3D's io.write_point_cloud writes them"#]],
    );
    check(
        &["a.ply", "b.PLY", "notes.txt", ".hidden.ply"],
        expect![[r#"
            <root>: clouds at <category>/<instance>/<name>.pcd or .ply expected, got 2 .ply, 1 .txt
            clouds are read from PCD and PLY files: move them to <category>/<instance>/, or write a manifest that names them where they are"#]],
    );
    check(
        &["cup/cup_1/a.xyz", "cup/cup_1/b.xyz", "cup/cup_1/README", "cup/cup_1/v1.of the cup"],
        expect![[r#"
            <root>: clouds at <category>/<instance>/<name>.pcd or .ply expected, got 2 .xyz, 2 without ending
            clouds are read from PCD and PLY files: python3 -c 'import open3d as o, sys; o.io.write_point_cloud(sys.argv[2], o.io.read_point_cloud(sys.argv[1]))' IN.xyz OUT.ply"#]],
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
