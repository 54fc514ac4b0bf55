//! What reading the clouds finds: skipped ones, copies, and units that cannot be right.

use descriptor::pcd::{self, DataEncoding};
use descriptor::{Cloud, Preprocess, Skip, Unit};
use expect_test::expect;

use super::super::{Dataset, SkipReason, SkippedCloud, Wanted};
use super::{Fixture, lengths, patch};

#[test]
fn clouds_without_enough_points_or_normals_are_skipped_by_name_and_reason() {
    let fixture = Fixture::new();
    let few =
        Cloud { points: vec![[f32::NAN; 3]; 400], colours: Some(vec![[0; 3]; 400]), viewpoint: [0.0; 3] };
    // 5 cm apart: no point has another within 1 cm.
    let sparse = patch(0.05, 1);
    fixture.write("ball/ball_1/ball_1_1_1.pcd", pcd::write(&few, DataEncoding::Ascii));
    fixture.write("cup/cup_1/cup_1_1_4.pcd", pcd::write(&sparse, DataEncoding::Ascii));
    let dataset = fixture.load().unwrap();
    let skipped = |path: &str, split, skip| SkippedCloud {
        path: path.to_owned(),
        split,
        reason: SkipReason::Unusable(skip),
    };
    let expected = [
        skipped("ball/ball_1/ball_1_1_1.pcd", "train1", Skip::TooFewPoints { least: 10, points: 0 }),
        skipped("cup/cup_1/cup_1_1_4.pcd", "test", Skip::NoKeypointWithNormal { keypoints: 400 }),
    ];
    assert_eq!(dataset.clouds.skipped, expected);
    assert_eq!(lengths(&dataset), [3, 4, 4, 3]);
    assert_eq!(dataset.clouds.entries.len(), 14);
    assert_ne!(dataset.clouds.digest, Fixture::new().load().unwrap().clouds.digest);
}

#[test]
fn unreadable_clouds_are_skipped_only_if_told_so() {
    let fixture = Fixture::new();
    fixture.write("cup/cup_1/cup_1_1_2.pcd", "no cloud\n");
    assert!(fixture.load().is_err());
    let settings = super::DatasetSettings { skip_unreadable: true, ..fixture.settings() };
    let dataset = Dataset::load(&settings, &Preprocess::default(), Wanted::All, None).unwrap();
    assert_eq!(dataset.clouds.skipped.len(), 1);
    assert_eq!(dataset.clouds.skipped[0].path, "cup/cup_1/cup_1_1_2.pcd");
    expect![
        "unreadable: pcd header: line 1: one of VERSION, FIELDS, SIZE, TYPE, COUNT, WIDTH, HEIGHT, VIEWPOINT, POINTS, DATA expected, got no"
    ]
    .assert_eq(&dataset.clouds.skipped[0].reason.to_string());
}

#[test]
fn clouds_that_would_take_minutes_are_refused_by_name_and_count_even_where_unreadable_ones_may_be_skipped() {
    let fixture = Fixture::new();
    let alike = Cloud {
        points: vec![[0.1, 0.2, 1.0]; 70_000],
        colours: Some(vec![[90, 60, 30]; 70_000]),
        viewpoint: [0.0; 3],
    };
    fixture.write("cup/cup_1/cup_1_1_2.pcd", pcd::write(&alike, DataEncoding::Binary));
    let settings = super::DatasetSettings { skip_unreadable: true, ..fixture.settings() };
    let error = Dataset::load(&settings, &Preprocess::default(), Wanted::All, None).unwrap_err();
    expect![[r#"
        dataset: clouds whose neighbourhoods take seconds at most expected, got 1 that are too dense
        cup/cup_1/cup_1_1_2.pcd: cloud: at most 4294967296 pairs of points in the same cells of 0.01 m or more expected, got 4900000000, and 70000 points in one cell
        remove points that are all alike (invalid ones at the origin) and outliers far away, thin them out, remove them from their lists, or choose a smaller preprocess.normal_radius_cm"#]].assert_eq(&fixture.text(&error));
}

#[test]
fn a_query_whose_object_is_not_in_the_database_is_warned_of() {
    let mut fixture = Fixture::new();
    fixture.cloud("cup/cup_9/cup_9_1_1.pcd");
    fixture.append("train1.txt", "cup/cup_9/cup_9_1_1.pcd\n");
    fixture.cloud("cup/cup_8/cup_8_1_1.pcd");
    fixture.cloud("cup/cup_8/cup_8_1_2.pcd");
    fixture.append("validation.txt", "cup/cup_8/cup_8_1_1.pcd\ncup/cup_8/cup_8_1_2.pcd\n");
    // In the final test both are in the database.
    fixture.cloud("cup/cup_8/cup_8_1_3.pcd");
    fixture.append("test.txt", "cup/cup_8/cup_8_1_3.pcd\n");
    let dataset = fixture.load().unwrap();
    let warnings = [(0, &[1][..]), (2, &[0, 1]), (3, &[0, 1, 2])]
        .map(|(query, database)| dataset.unrecognisable(query, database));
    expect![[r#"
        split train1: clouds of objects in train2 expected, got 1 of 5 without (1 object: cup_9)
        they can never be recognised: the object error of train1 cannot be below 20.00 %; list clouds of these objects in the database, leave the queries out, or go by category errors
        split validation: clouds of objects in train1 + train2 expected, got 2 of 6 without (1 object: cup_8)
        they can never be recognised: the object error of validation cannot be below 33.33 %; list clouds of these objects in the database, leave the queries out, or go by category errors"#]]
    .assert_eq(&warnings.into_iter().flatten().collect::<Vec<_>>().join("\n"));
}

#[test]
fn copies_in_different_splits_are_warned_of() {
    let fixture = Fixture::new();
    let bytes = std::fs::read(fixture.root().join("ball/ball_1/ball_1_1_1.pcd")).unwrap();
    fixture.write("ball/ball_1/ball_1_1_4.pcd", &bytes);
    expect![[r#"
        splits: clouds that differ expected, got 1 with the bytes of a cloud of another split, such as ball/ball_1/ball_1_1_4.pcd of ball/ball_1/ball_1_1_1.pcd
        such a query is always recognised: remove the copies"#]]
    .assert_eq(&fixture.load().unwrap().clouds.warnings.join("\n"));
}

/// What is said of clouds whose points are `spacing` units apart: warnings, or the refusal.
fn said_of_spacing(spacing: f32, preprocess: &Preprocess) -> String {
    let fixture = Fixture::new();
    for (tone, split) in (0..).zip(["train1", "train2", "validation", "test"]) {
        let list = std::fs::read_to_string(fixture.root().join(format!("{split}.txt"))).unwrap();
        for (index, path) in (0..).zip(list.lines()) {
            fixture.write(path, pcd::write(&patch(spacing, 10 * tone + index), DataEncoding::Binary));
        }
    }
    match Dataset::load(&fixture.settings(), preprocess, Wanted::All, None) {
        Ok(dataset) => dataset.clouds.warnings.join("\n"),
        Err(error) => format!("refused: {error}"),
    }
}

#[test]
fn a_point_spacing_that_no_sensor_has_names_the_likely_unit() {
    let said = |spacing, unit| said_of_spacing(spacing, &Preprocess { unit, ..Preprocess::default() });
    assert_eq!(said(0.0015, Unit::Metre), "");
    assert_eq!(said(1.5, Unit::Millimetre), "");
    expect![[r#"
        refused: dataset.unit: points 0.02 to 50 mm apart expected, got 1500 mm, as if mm were read as m in cup/cup_2/cup_2_1_2.pcd, the median of 16 clouds
        set dataset.unit = "mm""#]]
    .assert_eq(&said(1.5, Unit::Metre));
    expect![[r#"
        refused: dataset.unit: points 0.02 to 50 mm apart expected, got 0.0015 mm, as if m were read as mm in cup/cup_2/cup_2_1_2.pcd, the median of 16 clouds
        set dataset.unit = "m""#]]
    .assert_eq(&said(0.0015, Unit::Millimetre));
    // A dense scanner's, or that of clouds that are sparse in metres.
    expect![[r#"
        dataset.unit: points 0.05 to 50 mm apart expected, got 0.03 mm with unit = "mm" in cup/cup_2/cup_2_1_2.pcd, the median of 16 clouds
        the clouds are probably in another unit: set dataset.unit = "m""#]]
    .assert_eq(&said(0.03, Unit::Millimetre));
    expect![[r#"
        dataset.unit: points 0.05 to 50 mm apart expected, got 0.015 mm with unit = "m" in cup/cup_2/cup_2_1_2.pcd, the median of 16 clouds
        convert the clouds to metres or millimetres and set dataset.unit"#]]
    .assert_eq(&said(0.000_015, Unit::Metre));
}

#[test]
fn sparse_clouds_are_accepted_where_normals_are_fitted_in_larger_neighbourhoods() {
    let wide = Preprocess { leaf_um: 1_000_000, normal_radius_um: 1_000_000, ..Preprocess::default() };
    assert!(said_of_spacing(0.2, &wide).starts_with("dataset.unit: points"));
    assert!(said_of_spacing(0.2, &Preprocess::default()).starts_with("refused: dataset.unit: points"));
}
