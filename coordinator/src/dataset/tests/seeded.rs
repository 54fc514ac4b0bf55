//! Splits drawn at random: nothing twice, shares kept, the same again for the same seed.

use std::collections::BTreeSet;

use descriptor::Preprocess;
use expect_test::{Expect, expect};

use super::super::labelled::Labelled;
use super::super::layout::Labels;
use super::super::root::Root;
use super::super::split::{draw, split};
use super::super::{Dataset, DatasetError, DatasetSettings, Layout, SeededSplit, SplitRule, Wanted};
use super::{Fixture, lengths};

/// Instance number `i` has 2 videos of 3 + i clouds.
fn many() -> Fixture {
    let fixture = Fixture::empty();
    for (category, instances) in [("ball", 0..4), ("cup", 4..9)] {
        for instance in instances {
            for (video, frame) in (1..=2).flat_map(|video| (0..3 + instance).map(move |frame| (video, frame)))
            {
                fixture.write(&format!("{category}/o{instance}/o{instance}_{video}_{frame}.pcd"), "");
            }
        }
    }
    fixture
}

fn rule(seed: u64, shares: [f64; 4]) -> SeededSplit {
    SeededSplit { seed, shares, stratified: true, test_sequences: vec![] }
}

/// What the layout finds, to be drawn from many times.
fn found(fixture: &Fixture) -> Vec<Labelled> {
    let root = Root::open(fixture.root()).unwrap();
    Labels::read(&Layout::Uw, &root).unwrap().all(&root, &mut Vec::new()).unwrap()
}

fn drawn(fixture: &Fixture, rule: SeededSplit) -> Result<[Vec<Labelled>; 4], DatasetError> {
    let settings = DatasetSettings { splits: SplitRule::Seeded(rule), ..fixture.settings() };
    split(&settings, &Root::open(fixture.root()).unwrap(), Wanted::All, &mut Vec::new())
}

fn paths(splits: &[Vec<Labelled>; 4]) -> [Vec<&str>; 4] {
    splits.each_ref().map(|clouds| clouds.iter().map(|cloud| &*cloud.located.path).collect())
}

#[test]
fn every_cloud_is_in_one_split_and_shares_are_kept_over_all_and_in_each_instance() {
    let clouds = found(&many());
    let total = 2 * (3..12).sum::<usize>();
    for shares in [[0.25; 4], [0.3, 0.3, 0.2, 0.2], [0.45, 0.35, 0.0, 0.2], [0.1, 0.2, 0.1, 0.1]] {
        for (seed, stratified) in (0..20).flat_map(|seed| [(seed, true), (seed, false)]) {
            let splits = draw(&SeededSplit { stratified, ..rule(seed, shares) }, clouds.clone()).unwrap();
            let mut seen = BTreeSet::new();
            for (clouds, share) in paths(&splits).iter().zip(shares) {
                assert!(clouds.is_sorted(), "the order of the layout");
                assert!(
                    (clouds.len() as f64 - share * total as f64).abs() < 1.5,
                    "{shares:?} {}",
                    clouds.len()
                );
                assert!(clouds.iter().all(|&path| seen.insert(path)), "a cloud twice");
            }
            let used: f64 = shares.iter().sum();
            assert!((seen.len() as f64 - used * total as f64).abs() < 1.5);
            for instance in (0..9).filter(|_| stratified) {
                for (clouds, share) in splits.iter().zip(shares) {
                    let name = format!("o{instance}");
                    let count = clouds.iter().filter(|cloud| cloud.instance == name).count();
                    let expected = share * f64::from(2 * (3 + instance));
                    assert!((count as f64 - expected).abs() < 2.5, "{name}: {count} for {expected}");
                }
            }
        }
    }
}

#[test]
fn a_draw_repeats_with_its_seed_and_ignores_the_order_of_a_manifest() {
    let fixture = many();
    let draw = |seed| drawn(&fixture, rule(seed, [0.25; 4])).unwrap();
    let base = draw(1);
    assert_eq!(base, draw(1));
    assert_ne!(base, draw(2));

    let rows: Vec<String> = base
        .iter()
        .flatten()
        .map(|cloud| format!("{},{},{}", cloud.located.path, cloud.category, cloud.instance))
        .collect();
    fixture.write("clouds.csv", format!("path,category,instance\n{}\n", rows.join("\n")));
    let splits = SplitRule::Seeded(rule(1, [0.25; 4]));
    let settings = DatasetSettings { splits, ..fixture.manifest_settings() };
    let by_manifest =
        split(&settings, &Root::open(fixture.root()).unwrap(), Wanted::All, &mut Vec::new()).unwrap();
    let sorted = |splits: &[Vec<Labelled>; 4]| {
        paths(splits).map(|paths| paths.into_iter().map(str::to_owned).collect::<BTreeSet<_>>())
    };
    assert_eq!(sorted(&by_manifest), sorted(&base));
}

/// χ² of which clouds are drawn for train1 against equal chances.
#[test]
fn every_cloud_is_equally_likely_to_be_drawn() {
    let clouds = found(&many());
    let draws = 400;
    let mut counts = std::collections::BTreeMap::new();
    for seed in 0..draws {
        let splits =
            draw(&SeededSplit { stratified: false, ..rule(seed, [0.5, 0.5, 0.0, 0.0]) }, clouds.clone());
        for path in &paths(&splits.unwrap())[0] {
            *counts.entry((*path).to_owned()).or_insert(0_u32) += 1;
        }
    }
    let (cells, expected) = (126, draws as f64 / 2.0);
    let squares = counts.values().map(|&count| (f64::from(count) - expected) * (f64::from(count) - expected));
    let chi2 = squares.sum::<f64>() / expected;
    assert_eq!(counts.len(), cells);
    // Each count is binomial with variance expected / 2, so that 2 χ² has a mean of `cells` and a standard
    // deviation of √(2 · cells) ≈ 16; six of them on either side.
    assert!((2.0 * chi2 - cells as f64).abs() < 6.0 * 16.0, "{chi2}");
}

#[test]
fn whole_sequences_are_held_out_for_the_test() {
    let fixture = many();
    let held_out = SeededSplit { test_sequences: vec!["2".to_owned()], ..rule(3, [0.4, 0.4, 0.2, 0.0]) };
    let splits = drawn(&fixture, held_out).unwrap();
    let is_second = |cloud: &&Labelled| cloud.sequence.as_deref() == Some("2");
    assert_eq!(splits[3].iter().filter(is_second).count(), 63);
    assert_eq!(splits[3].len(), 63);
    assert_eq!(splits[..3].iter().flatten().filter(is_second).count(), 0);
    assert_eq!(splits.each_ref().map(Vec::len), [25, 25, 13, 63]);
}

#[test]
fn a_split_may_be_empty_only_if_it_was_given_no_share() {
    let mut fixture = Fixture::empty();
    for frame in 0..6 {
        fixture.cloud(&format!("cup/cup_1/cup_1_1_{frame}.pcd"));
    }
    let splits = SplitRule::Seeded(rule(0, [0.5, 0.5, 0.0, 0.0]));
    let settings = DatasetSettings { splits, layout: Layout::Folders, ..fixture.settings() };
    let dataset = Dataset::load(&settings, &Preprocess::default(), Wanted::All, None).unwrap();
    assert_eq!(lengths(&dataset), [3, 3, 0, 0]);
    let error = drawn(&fixture, rule(0, [0.495, 0.495, 0.0, 0.01])).unwrap_err();
    assert_eq!(error, DatasetError::no_cloud("test"));
}

#[test]
fn clouds_with_other_names_are_left_out_of_a_uw_draw_with_a_warning() {
    let mut fixture = Fixture::new();
    fixture.cloud("formats/ascii/cup_1_1_1.pcd");
    fixture.write("cup/cup_1/cup_1_1_1_depth.png", "");
    let splits = SplitRule::Seeded(rule(0, [0.25; 4]));
    let dataset = Dataset::load(
        &DatasetSettings { splits, ..fixture.settings() },
        &Preprocess::default(),
        Wanted::All,
        None,
    )
    .unwrap();
    assert_eq!(dataset.clouds.entries.len(), 16);
    expect![[r#"
        dataset.layout: only clouds named <instance>_<video>_<frame>.pcd, .ply or _crop.png expected, got 1 others, such as formats/ascii/cup_1_1_1.pcd
        they are not used: rename them or set dataset.layout = "folders""#]]
    .assert_eq(&dataset.clouds.warnings.join("\n"));
}

#[test]
fn rules_that_cannot_split() {
    let check = |rule, expected: Expect| expected.assert_eq(&drawn(&many(), rule).unwrap_err().to_string());
    let shares = expect![[r#"
        dataset.splits: shares from 0 that add up to at most 1 expected, got 0.5 + 0.5 + 0.5 + 0
        give train1, train2, validation and test a share each; what is left is not used"#]];
    check(rule(0, [0.5, 0.5, 0.5, 0.0]), shares);
    for shares in [[-0.1, 0.5, 0.3, 0.3], [f64::NAN, 0.0, 0.0, 0.0], [f64::INFINITY, 0.0, 0.0, 0.0]] {
        let error = drawn(&many(), rule(0, shares)).unwrap_err();
        assert!(matches!(error, DatasetError::Rule { .. }), "{error}");
    }
    let held_out = |sequence: &str, test| SeededSplit {
        test_sequences: vec![sequence.to_owned()],
        ..rule(0, [0.3, 0.3, 0.2, test])
    };
    check(
        held_out("7", 0.0),
        expect![[r#"
            dataset.splits: test_sequences with clouds expected, got none of 126 in sequence 7
            name sequences as the layout does: in `uw` the video's number, in a manifest the column"#]],
    );
    check(
        held_out("2", 0.2),
        expect![[r#"
            dataset.splits: share 0 for test beside test_sequences expected, got 0.2
            test is exactly the clouds of those sequences: remove its share"#]],
    );
}
