//! Rows of the tables that compare descriptors on a run's test clouds, and their frames.

use std::time::SystemTime;

use polars::prelude::DataFrame;

use crate::error::Error;
use crate::frame::{Cell, assemble, cells, counts_cells, prediction_cells, text, time};
use crate::rows::{Counts, PredictionRow};

/// A release of test clouds to workers.
#[derive(Clone, Debug, PartialEq)]
pub struct LookRow {
    /// When.
    pub at: SystemTime,
    /// By which command.
    pub command: String,
    /// What for.
    pub reason: String,
    /// Labels of the descriptors that are measured.
    pub descriptors: Vec<String>,
}

/// Seconds of each stage on one thread, queries and database together.
#[derive(Clone, Debug, PartialEq)]
pub struct Times {
    /// Reading and decoding files.
    pub read: f64,
    /// Keypoints.
    pub keypoints: f64,
    /// Normals.
    pub normals: f64,
    /// Histograms and their summaries.
    pub describe: f64,
    /// Distances and nearest clouds.
    pub matching: f64,
    /// Wall time of everything.
    pub total: f64,
    /// The processor.
    pub hardware: String,
}

/// One descriptor on the test clouds.
#[derive(Clone, Debug, PartialEq)]
pub struct ComparedRow {
    /// Its label, unique in the comparison.
    pub descriptor: String,
    /// Which kind of descriptor.
    pub kind: String,
    /// How clouds are compared by it.
    pub distance: String,
    /// Its parameters, for people.
    pub parameters: String,
    /// Real values of one keypoint's descriptor.
    pub size: u32,
    /// What more there is to say.
    pub note: Option<String>,
    /// How many queries it recognises.
    pub counts: Counts,
    /// 95 % intervals of the object error: Wilson's, and by the bootstrap over objects.
    pub object_intervals: [[f64; 2]; 2],
    /// The same of the category error.
    pub category_intervals: [[f64; 2]; 2],
    /// Queries that it cannot describe.
    pub skipped: u32,
    /// Clouds in the database.
    pub database: u32,
    /// Mean number of keypoints of a cloud.
    pub keypoints_per_cloud: Option<f64>,
    /// How long it took, if that was measured.
    pub times: Option<Times>,
    /// Areas of the curve over all pairs and of that over nearest clouds.
    pub areas: [Option<f64>; 2],
}

/// Two descriptors on the same test clouds.
#[derive(Clone, Debug, PartialEq)]
pub struct PairRow {
    /// What is to be recognised: `object` or `category`.
    pub level: String,
    /// Labels of the two.
    pub descriptors: [String; 2],
    /// Queries recognised by both, by the first only, by the second only, by neither.
    pub outcomes: [u32; 4],
    /// 95 % interval of the difference of the errors.
    pub difference: [f64; 2],
    /// Of McNemar's test.
    pub p_value: f64,
    /// After correction for the number of pairs.
    pub p_adjusted: f64,
}

impl PairRow {
    /// Queries that both describe.
    pub fn queries(&self) -> u32 {
        self.outcomes.iter().sum()
    }

    /// Error of the first minus error of the second.
    pub fn error_difference(&self) -> f64 {
        let [_, only_a, only_b, _] = self.outcomes.map(f64::from);
        (only_b - only_a) / f64::from(self.queries())
    }

    /// Odds that a query which only one recognises is recognised by the first.
    pub fn odds_ratio(&self) -> Option<f64> {
        let [_, only_a, only_b, _] = self.outcomes.map(f64::from);
        (only_b > 0.0).then(|| only_a / only_b)
    }
}

/// A point of a curve.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CurvePoint {
    /// Pairs up to this set distance are accepted.
    pub distance: f64,
    /// How many they are.
    pub accepted: u64,
    /// How many of them show the same object.
    pub relevant: u64,
}

/// A descriptor's recall against 1 − precision.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    /// `all` or `nearest`.
    pub name: &'static str,
    /// What recall is a share of; at least 1.
    pub relevant: u64,
    /// One a distinct distance, ascending.
    pub points: Vec<CurvePoint>,
}

impl Curve {
    /// Area between the curve and 1 − precision = 1: precision times the step of recall, summed. `None` if nothing is
    /// relevant.
    pub fn area(&self) -> Option<f64> {
        let mut before = 0;
        let mut area = 0.0;
        for point in &self.points {
            let precision = point.relevant as f64 / point.accepted as f64;
            area += precision * (point.relevant - before) as f64;
            before = point.relevant;
        }
        (self.relevant > 0).then(|| area / self.relevant as f64)
    }
}

pub(crate) fn look(row: &LookRow) -> Result<DataFrame, Error> {
    let LookRow { at, command, reason, descriptors } = row;
    assemble(
        1,
        vec![
            time("at", *at),
            text("command", command),
            text("reason", reason),
            text("descriptors", &descriptors.join(" ")),
        ],
    )
}

fn interval_cells(name: &str, rows: &[ComparedRow], of: impl Fn(&ComparedRow) -> [f64; 2]) -> [Cell; 2] {
    ["low", "high"].map(|end| {
        let end_of = |row| of(row)[usize::from(end == "high")];
        cells(&format!("{name}_{end}"), rows.iter().map(end_of))
    })
}

pub(crate) fn comparison(rows: &[ComparedRow]) -> Result<DataFrame, Error> {
    let counts: Vec<Option<Counts>> = rows.iter().map(|row| Some(row.counts)).collect();
    let mut columns = vec![
        cells("descriptor", rows.iter().map(|row| row.descriptor.as_str())),
        cells("kind", rows.iter().map(|row| row.kind.as_str())),
        cells("distance", rows.iter().map(|row| row.distance.as_str())),
        cells("parameters", rows.iter().map(|row| row.parameters.as_str())),
        cells("size", rows.iter().map(|row| row.size)),
        cells("note", rows.iter().map(|row| row.note.as_deref())),
    ];
    columns.extend(counts_cells("", &counts));
    columns.extend(interval_cells("object_error", rows, |row| row.object_intervals[0]));
    columns.extend(interval_cells("category_error", rows, |row| row.category_intervals[0]));
    columns.extend(interval_cells("object_error_instances", rows, |row| row.object_intervals[1]));
    columns.extend(interval_cells("category_error_instances", rows, |row| row.category_intervals[1]));
    let times = || rows.iter().map(|row| row.times.as_ref());
    let seconds = |stage: &str, of: fn(&Times) -> f64| {
        cells(&format!("seconds_{stage}"), times().map(|times| times.map(of)))
    };
    columns.extend([
        cells("skipped", rows.iter().map(|row| row.skipped)),
        cells("database", rows.iter().map(|row| row.database)),
        cells("keypoints_per_cloud", rows.iter().map(|row| row.keypoints_per_cloud)),
        seconds("read", |times| times.read),
        seconds("keypoints", |times| times.keypoints),
        seconds("normals", |times| times.normals),
        seconds("describe", |times| times.describe),
        seconds("match", |times| times.matching),
        seconds("total", |times| times.total),
        cells("hardware", times().map(|times| times.map(|times| times.hardware.as_str()))),
        cells("area", rows.iter().map(|row| row.areas[0])),
        cells("nearest_area", rows.iter().map(|row| row.areas[1])),
    ]);
    assemble(rows.len(), columns)
}

pub(crate) fn pairs(rows: &[PairRow]) -> Result<DataFrame, Error> {
    let outcome = |place: usize| rows.iter().map(move |row| row.outcomes[place]);
    assemble(
        rows.len(),
        vec![
            cells("level", rows.iter().map(|row| row.level.as_str())),
            cells("descriptor_a", rows.iter().map(|row| row.descriptors[0].as_str())),
            cells("descriptor_b", rows.iter().map(|row| row.descriptors[1].as_str())),
            cells("queries", rows.iter().map(PairRow::queries)),
            cells("both_right", outcome(0)),
            cells("only_a", outcome(1)),
            cells("only_b", outcome(2)),
            cells("both_wrong", outcome(3)),
            cells("error_difference", rows.iter().map(PairRow::error_difference)),
            cells("difference_low", rows.iter().map(|row| row.difference[0])),
            cells("difference_high", rows.iter().map(|row| row.difference[1])),
            cells("odds_ratio", rows.iter().map(PairRow::odds_ratio)),
            cells("p_value", rows.iter().map(|row| row.p_value)),
            cells("p_adjusted", rows.iter().map(|row| row.p_adjusted)),
        ],
    )
}

pub(crate) fn recall_precision(descriptor: &str, curves: &[Curve]) -> Result<DataFrame, Error> {
    let points = || curves.iter().flat_map(|curve| curve.points.iter().map(move |point| (curve, point)));
    let height = points().count();
    assemble(
        height,
        vec![
            cells("descriptor", std::iter::repeat_n(descriptor, height)),
            cells("curve", points().map(|(curve, _)| curve.name)),
            cells("distance", points().map(|(_, point)| point.distance)),
            cells("accepted", points().map(|(_, point)| point.accepted)),
            cells("relevant_accepted", points().map(|(_, point)| point.relevant)),
            cells("recall", points().map(|(curve, point)| point.relevant as f64 / curve.relevant as f64)),
            cells(
                "one_minus_precision",
                points().map(|(_, point)| (point.accepted - point.relevant) as f64 / point.accepted as f64),
            ),
        ],
    )
}

/// Query, database cloud and distance.
pub(crate) fn distances(descriptor: &str, rows: &[(u32, u32, f32)]) -> Result<DataFrame, Error> {
    assemble(
        rows.len(),
        vec![
            cells("descriptor", rows.iter().map(|_| descriptor)),
            cells("query", rows.iter().map(|row| row.0)),
            cells("database", rows.iter().map(|row| row.1)),
            cells("distance", rows.iter().map(|row| row.2)),
        ],
    )
}

pub(crate) fn answers(descriptor: &str, rows: &[PredictionRow]) -> Result<DataFrame, Error> {
    let mut columns = vec![cells("descriptor", rows.iter().map(|_| descriptor))];
    columns.extend(prediction_cells(rows));
    assemble(rows.len(), columns)
}
