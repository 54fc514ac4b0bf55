//! A comparison for people and as JSON.

use std::fmt::Write as _;
use std::path::PathBuf;

use results::{ComparedRow, PairRow};
use serde_json::{Value, json};

use crate::run::progress::percent;

/// Significance level of the remarks beside pairs.
const LEVEL: f64 = 0.05;

/// What a comparison amounts to.
#[derive(Clone, Debug)]
pub struct Comparison {
    /// Name of the experiment.
    pub name: String,
    /// The descriptors.
    pub rows: Vec<ComparedRow>,
    /// Every pair of them, objects first.
    pub pairs: Vec<PairRow>,
    /// How often the run's test clouds have been looked at.
    pub looks: usize,
    /// The run folder.
    pub folder: PathBuf,
}

/// Columns padded to their widest cell; the first to the left, the others to the right.
fn columns(rows: &[Vec<String>]) -> String {
    let columns = rows.iter().map(Vec::len).max().unwrap_or(0);
    let width = |column: usize| {
        let cells = rows.iter().filter_map(|row| row.get(column));
        cells.map(|cell| cell.chars().count()).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..columns).map(width).collect();
    let line = |row: &Vec<String>| {
        let padded = row.iter().zip(&widths).enumerate().map(|(index, (cell, &width))| match index {
            0 => format!("{cell:<width$}"),
            _ => format!("{cell:>width$}"),
        });
        format!("{}\n", padded.collect::<Vec<_>>().join("  ").trim_end())
    };
    rows.iter().map(line).collect()
}

fn texts<const N: usize>(cells: [&str; N]) -> Vec<String> {
    cells.map(str::to_owned).to_vec()
}

fn range([low, high]: [f64; 2]) -> String {
    format!("{:.1} - {:.1}", 100.0 * low, 100.0 * high)
}

fn optional(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"))
}

/// A p-value as people write it.
fn probability(p: f64) -> String {
    if p < 0.0001 { "< 0.0001".to_owned() } else { format!("{p:.4}") }
}

impl Comparison {
    /// Tables for a terminal.
    pub fn text(&self) -> String {
        let Some(first) = self.rows.first() else { return String::new() };
        let mut text = format!(
            "{}: {} test clouds against {}; 95 % intervals by Wilson (clouds) and bootstrap over objects\n\n",
            self.name, first.counts.queries, first.database
        );
        let title = [
            "descriptor",
            "object error",
            "wrong",
            "95 %, clouds",
            "95 %, objects",
            "category error",
            "wrong",
            "95 %, clouds",
        ];
        let mut lines = vec![texts(title)];
        lines.extend(self.rows.iter().map(|row| {
            let counts = &row.counts;
            vec![
                row.descriptor.clone(),
                percent(counts.object_error()),
                (counts.queries - counts.object_correct).to_string(),
                range(row.object_wilson),
                range(row.object_bootstrap),
                percent(counts.category_error()),
                (counts.queries - counts.category_correct).to_string(),
                range(row.category_wilson),
            ]
        }));
        text += &columns(&lines);
        text.push('\n');
        let title =
            ["descriptor", "size", "keypoints", "area", "nearest", "seconds", "normals", "describe", "match"];
        let mut lines = vec![texts(title)];
        lines.extend(self.rows.iter().map(|row| {
            let times = row.times.as_ref();
            vec![
                row.descriptor.clone(),
                row.size.to_string(),
                optional(row.keypoints_per_cloud, 1),
                optional(row.area, 3),
                optional(row.nearest_area, 3),
                optional(times.map(|times| times.total), 2),
                optional(times.map(|times| times.normals), 2),
                optional(times.map(|times| times.describe), 2),
                optional(times.map(|times| times.matching), 2),
            ]
        }));
        text += &columns(&lines);
        if let Some(times) = self.rows.iter().find_map(|row| row.times.as_ref()) {
            let _ = writeln!(
                text,
                "seconds: read to match, queries and database, one thread of {}",
                times.hardware
            );
        }
        for row in &self.rows {
            let _ = writeln!(text, "{}: {}, by {}", row.descriptor, row.parameters, row.distance);
            if let Some(note) = &row.note {
                let _ = writeln!(text, "{}: {note}", row.descriptor);
            }
            if row.skipped > 0 {
                let _ = writeln!(text, "{}: {} queries without a description", row.descriptor, row.skipped);
            }
        }
        text += &self.pairs_text();
        let times = if self.looks == 1 { "once".to_owned() } else { format!("{} times", self.looks) };
        let _ = writeln!(text, "\nthe test clouds of this run have been looked at {times} (table looks)");
        let _ = writeln!(text, "tables in {}", self.folder.display());
        text
    }

    fn pairs_text(&self) -> String {
        if self.pairs.is_empty() {
            return String::new();
        }
        let mut lines = vec![texts([
            "difference of errors",
            "level",
            "points",
            "95 %",
            "only first",
            "only second",
            "p",
            "p (Holm)",
            "",
        ])];
        lines.extend(self.pairs.iter().map(|pair| {
            let [low, high] = [pair.difference_low, pair.difference_high];
            vec![
                format!("{} - {}", pair.descriptor_a, pair.descriptor_b),
                pair.level.clone(),
                format!("{:+.2}", 100.0 * pair.error_difference()),
                format!("{:+.1} - {:+.1}", 100.0 * low, 100.0 * high).replace(" - ", " .. "),
                pair.only_a.to_string(),
                pair.only_b.to_string(),
                probability(pair.p_value),
                probability(pair.p_adjusted),
                if pair.p_adjusted < LEVEL { "differ".to_owned() } else { "may be chance".to_owned() },
            ]
        }));
        format!("\n{}", columns(&lines))
    }

    /// The same as one JSON object; errors are fractions.
    pub fn json(&self) -> Value {
        let descriptor = |row: &ComparedRow| {
            let times = row.times.as_ref();
            json!({
                "descriptor": row.descriptor,
                "kind": row.kind,
                "distance": row.distance,
                "parameters": row.parameters,
                "size": row.size,
                "note": row.note,
                "queries": row.counts.queries,
                "skipped": row.skipped,
                "database": row.database,
                "object_error": row.counts.object_error(),
                "object_wrong": row.counts.queries - row.counts.object_correct,
                "object_error_interval": row.object_wilson,
                "object_error_interval_instances": row.object_bootstrap,
                "category_error": row.counts.category_error(),
                "category_wrong": row.counts.queries - row.counts.category_correct,
                "category_error_interval": row.category_wilson,
                "category_error_interval_instances": row.category_bootstrap,
                "keypoints_per_cloud": row.keypoints_per_cloud,
                "area": row.area,
                "nearest_area": row.nearest_area,
                "seconds": times.map(|times| json!({
                    "read": times.read,
                    "keypoints": times.keypoints,
                    "normals": times.normals,
                    "describe": times.describe,
                    "match": times.matching,
                    "total": times.total,
                })),
                "hardware": times.map(|times| &times.hardware),
            })
        };
        let pair = |pair: &PairRow| {
            json!({
                "level": pair.level,
                "descriptors": [&pair.descriptor_a, &pair.descriptor_b],
                "outcomes": { "both_right": pair.both_right, "only_a": pair.only_a, "only_b": pair.only_b, "both_wrong": pair.both_wrong },
                "error_difference": pair.error_difference(),
                "error_difference_interval": [pair.difference_low, pair.difference_high],
                "odds_ratio": pair.odds_ratio(),
                "p_value": pair.p_value,
                "p_adjusted": pair.p_adjusted,
            })
        };
        json!({
            "name": self.name,
            "run": self.folder.display().to_string(),
            "looks": self.looks,
            "descriptors": self.rows.iter().map(descriptor).collect::<Vec<_>>(),
            "pairs": self.pairs.iter().map(pair).collect::<Vec<_>>(),
        })
    }
}
