//! What is counted of nearest clouds, case by case.

use super::*;

/// Objects 0 and 1 are of category 0, object 2 is of category 1.
const LABELS: [Label; 3] = [
    Label { category: 0, instance: 0 },
    Label { category: 0, instance: 1 },
    Label { category: 1, instance: 2 },
];

/// Counts of one query that shows object 0, with a cloud of each object as database.
fn count(rule: MatchingRule, same: Option<(u32, f64)>, other: Option<(u32, f64)>) -> ([u32; 3], Option<f64>) {
    let counts = rule.count(&[Nearest { same, other }], &LABELS[..1], &LABELS);
    assert!(counts.matches.is_empty() && counts.nearest.is_empty());
    ([counts.queries, counts.object_correct, counts.category_correct], counts.margin)
}

#[test]
fn a_query_counts_by_its_nearest_cloud_if_one_of_its_own_is_left() {
    let object = MatchingRule { margin: true, ..MatchingRule::default() };
    let category = MatchingRule { objective: Objective::Category, ..object };
    for (rule, same, other, counts, margin) in [
        (object, Some((0, 1.0)), Some((2, 3.0)), [1, 1, 1], 0.5),
        (object, Some((0, 3.0)), Some((2, 1.0)), [1, 0, 0], -0.5),
        (object, Some((0, 3.0)), Some((1, 1.0)), [1, 0, 1], -0.5),
        // Of equal distances the lowest index counts, whichever it is of.
        (object, Some((0, 1.0)), Some((2, 1.0)), [1, 1, 1], 0.0),
        (category, Some((1, 1.0)), Some((2, 1.0)), [1, 0, 1], 0.0),
        (category, Some((1, 2.0)), Some((2, 1.0)), [1, 0, 0], -1.0 / 3.0),
        // Nothing divided by nothing.
        (object, Some((0, 0.0)), Some((1, 0.0)), [1, 1, 1], 0.0),
        (object, Some((0, 0.0)), Some((1, 0.5)), [1, 1, 1], 1.0),
        // No other left.
        (object, Some((0, 0.0)), None, [1, 1, 1], 1.0),
        // None of its own left.
        (object, None, Some((1, 0.5)), [0, 0, 0], 0.0),
        (object, None, None, [0, 0, 0], 0.0),
    ] {
        assert_eq!(count(rule, same, other), (counts, Some(margin)), "{rule:?} {same:?} {other:?}");
        let without = MatchingRule { margin: false, exclude: Exclusion::SameCloud, ..rule };
        assert_eq!(count(without, same, other), (counts, None));
    }
    let tie = Nearest { same: Some((2, 1.0)), other: Some((1, 1.0)) };
    let counts = object.count(&[tie], &LABELS[2..], &LABELS);
    assert_eq!((counts.queries, counts.object_correct, counts.category_correct), (1, 0, 0));
}

#[test]
fn margins_add_up_in_the_order_of_the_queries() {
    let rule = MatchingRule { margin: true, ..MatchingRule::default() };
    let of = |same, other| Nearest { same: Some((0, same)), other: Some((1, other)) };
    let nearest = [of(1.0, 9.0), Nearest::default(), of(1.0, 1e-17), of(3.0, 1.0), of(0.3, 0.7)];
    let counts = rule.count(&nearest, &[LABELS[0]; 5], &LABELS);
    let margin = |same: f64, other: f64| (other - same) / (other + same);
    let sum = ((margin(1.0, 9.0) + margin(1.0, 1e-17)) + margin(3.0, 1.0)) + margin(0.3, 0.7);
    assert_eq!((counts.queries, counts.margin.map(f64::to_bits)), (4, Some(sum.to_bits())));
    assert_eq!(
        rule.count(&[], &[], &LABELS),
        EvaluationResult { margin: Some(0.0), ..EvaluationResult::default() }
    );
}

#[test]
fn parts_merge_to_the_nearest_of_the_lowest_index() {
    let first = Nearest { same: Some((1, 0.5)), other: None };
    let second = Nearest { same: Some((0, 0.5)), other: Some((1, 0.25)) };
    assert_eq!(first.merge(second, 4), Nearest { same: Some((1, 0.5)), other: Some((5, 0.25)) });
    // Parts come in any order: the later one may hold the lower indices.
    let merged = Nearest::default().merge(second, 4).merge(first, 0);
    assert_eq!(merged, Nearest { same: Some((1, 0.5)), other: Some((5, 0.25)) });
    let nearer = Nearest { same: Some((2, 0.25)), other: Some((3, 0.75)) };
    assert_eq!(merged.merge(nearer, 8), Nearest { same: Some((10, 0.25)), other: Some((5, 0.25)) });
}
