//! Columns of the tables that compare descriptors on a run's test clouds, and of the looks at them.

use crate::columns::Column;
use crate::columns::ColumnKind::{F32, F64, Text, Timestamp, U32, U64};
use crate::tables::counts;
use crate::tables::run::predictions;

pub(super) fn looks() -> Vec<Column> {
    vec![
        Column::new("at", Timestamp, "UTC", "when test clouds were released to workers"),
        Column::new("command", Text, "", "by which command: run or compare"),
        Column::new("reason", Text, "", "what for"),
        Column::new("descriptors", Text, "", "which descriptors were measured, separated by spaces"),
    ]
}

fn descriptor() -> Column {
    Column::new(
        "descriptor",
        Text,
        "",
        "label of the descriptor, such as evolved, paper, pfhrgb, shotcolor-l1",
    )
}

/// Ends of a 95 % interval.
fn interval(name: &str, of: &str) -> [Column; 2] {
    [("low", "lower"), ("high", "upper")].map(|(end, which)| {
        let meaning = format!("{which} end of the 95 % interval of {of}");
        Column::new(&format!("{name}_{end}"), F64, "share", &meaning)
    })
}

pub(super) fn comparison() -> Vec<Column> {
    let mut columns = vec![
        descriptor(),
        Column::new("kind", Text, "", "disk-ring, pfhrgb or shotcolor"),
        Column::new("distance", Text, "", "set distance: chi2 or l1"),
        Column::new("parameters", Text, "", "values of its genes, or its radius"),
        Column::new("size", U32, "values", "real values of one keypoint's descriptor"),
        Column::new("note", Text, "", "what more there is to say").nullable(),
    ];
    columns.extend(counts("", "test clouds"));
    columns.extend(interval("object_error", "object_error, by Wilson, as if clouds were independent"));
    columns.extend(interval("category_error", "category_error, by Wilson"));
    columns.extend(interval("object_error_instances", "object_error, by the bootstrap over objects"));
    columns.extend(interval("category_error_instances", "category_error, by the bootstrap over objects"));
    let seconds = |stage: &str, of: &str| {
        let meaning = format!("{of}, one thread, queries and database; null if not measured");
        Column::new(&format!("seconds_{stage}"), F64, "s", &meaning).nullable()
    };
    columns.extend([
        Column::new("skipped", U32, "clouds", "queries that this descriptor cannot describe"),
        Column::new("database", U32, "clouds", "clouds that queries are matched with"),
        Column::new("keypoints_per_cloud", F64, "", "mean over queries and database; null if not measured")
            .nullable(),
        seconds("read", "reading and decoding"),
        seconds("keypoints", "keypoints"),
        seconds("normals", "normals"),
        seconds("describe", "histograms and their summaries"),
        seconds("match", "distances and nearest clouds"),
        seconds("total", "wall time from the first read to the last match"),
        Column::new("hardware", Text, "", "processor on which the times were measured; null as they")
            .nullable(),
        Column::new(
            "area",
            F64,
            "",
            "mean precision over recall, all pairs: area between the curve and 1 - precision = 1; null if they are too many",
        )
        .nullable(),
        Column::new("nearest_area", F64, "", "the same of the curve of nearest clouds only").nullable(),
    ]);
    columns
}

pub(super) fn pairs() -> Vec<Column> {
    let both = "test clouds that both descriptors describe";
    vec![
        Column::new("level", Text, "", "object or category"),
        Column::new("descriptor_a", Text, "", "label of one descriptor"),
        Column::new("descriptor_b", Text, "", "label of a later one"),
        Column::new("queries", U32, "clouds", both),
        Column::new("both_right", U32, "clouds", "recognised by both"),
        Column::new("only_a", U32, "clouds", "recognised by the first only"),
        Column::new("only_b", U32, "clouds", "recognised by the second only"),
        Column::new("both_wrong", U32, "clouds", "recognised by neither"),
        Column::new("error_difference", F64, "share", "error of the first minus error of the second"),
        Column::new("difference_low", F64, "share", "lower end of its 95 % interval, bootstrap over objects"),
        Column::new("difference_high", F64, "share", "upper end of it"),
        Column::new("odds_ratio", F64, "", "only_a / only_b; null if only_b is 0").nullable(),
        Column::new("p_value", F64, "", "McNemar's exact test, two-sided"),
        Column::new("p_adjusted", F64, "", "the same after Holm, over all pairs of the level"),
    ]
}

pub(super) fn recall_precision() -> Vec<Column> {
    vec![
        descriptor(),
        Column::new(
            "curve",
            Text,
            "",
            "all: every query with every database cloud; nearest: with its nearest",
        ),
        Column::new("distance", F64, "", "pairs up to this set distance are accepted"),
        Column::new("accepted", U64, "pairs", "how many these are"),
        Column::new("relevant_accepted", U64, "pairs", "how many of them show the same object"),
        Column::new("recall", F64, "share", "relevant_accepted / all relevant (nearest: all queries)"),
        Column::new("one_minus_precision", F64, "share", "1 - relevant_accepted / accepted"),
    ]
}

pub(super) fn distances() -> Vec<Column> {
    vec![
        descriptor(),
        Column::new("query", U32, "", "index of the query in the test split, from 0"),
        Column::new("database", U32, "", "index of the database cloud: train1, train2, validation in order"),
        Column::new("distance", F32, "", "set distance"),
    ]
}

/// As the predictions of a run, which are those of one descriptor.
pub(super) fn answers() -> Vec<Column> {
    let of_run = predictions().into_iter().filter(|column| column.name != "split");
    std::iter::once(descriptor()).chain(of_run.map(|column| Column { in_digest: false, ..column })).collect()
}
