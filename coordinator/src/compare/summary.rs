//! A comparison for people and as JSON.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::PathBuf;

use descriptor::Perturbation;
use results::{ComparedRow, FrontRow, PairRow, PerturbedRow, Times};
use serde_json::{Value, json};

use super::candidate::PAPER;
use super::foreign::GIVEN;
use super::pairs::{Level, SIGNIFICANCE, probability};
use super::verdict::verdict;
use crate::lines::{percent, table, wrapped};

/// What a comparison amounts to.
#[derive(Clone, Debug)]
pub struct Comparison {
    /// Name of the experiment.
    pub name: String,
    /// What the run's fitness counts.
    pub level: Level,
    /// The descriptors.
    pub rows: Vec<ComparedRow>,
    /// Every pair of them, objects first.
    pub pairs: Vec<PairRow>,
    /// The front of the run; empty if it has none.
    pub front: Vec<FrontRow>,
    /// Errors on perturbed test clouds.
    pub perturbed: Vec<PerturbedRow>,
    /// How often the run's test clouds have been looked at.
    pub looks: usize,
    /// The run folder.
    pub folder: PathBuf,
}

fn texts<const N: usize>(cells: [&str; N]) -> Vec<String> {
    cells.map(str::to_owned).to_vec()
}

fn range([low, high]: [f64; 2]) -> String {
    format!("{:.1} - {:.1}", 100.0 * low, 100.0 * high)
}

fn whole(value: Option<u32>) -> String {
    value.map_or_else(|| "-".to_owned(), |value| value.to_string())
}

fn optional(value: Option<f64>, digits: usize) -> String {
    value.map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"))
}

impl Comparison {
    /// Tables for a terminal.
    pub fn text(&self) -> String {
        let Some(first) = self.rows.first() else { return String::new() };
        // Those that a descriptor cannot describe are named with it.
        let databases = self.rows.iter().map(|row| row.database);
        let [least, most] = [databases.clone().min(), databases.max()].map(Option::unwrap_or_default);
        let database = if least == most { most.to_string() } else { format!("{least} to {most}") };
        let mut text = wrapped(
            &format!(
                "{}: {} test clouds against {database}; 95 % intervals by Wilson (clouds) and bootstrap over objects",
                self.name,
                first.counts.queries + first.skipped
            ),
            2,
        );
        text += &self.errors_text("object error", |row| {
            let wrong = row.counts.object_errors().wrong;
            (row.counts.object_error(), wrong, row.object_wilson, row.object_bootstrap)
        });
        text += &self.errors_text("category error", |row| {
            let wrong = row.counts.category_errors().wrong;
            (row.counts.category_error(), wrong, row.category_wilson, row.category_bootstrap)
        });
        text.push('\n');
        let title = ["descriptor", "size", "cloud", "keypoints", "area", "nearest"];
        let mut lines = vec![texts(title)];
        lines.extend(self.rows.iter().map(|row| {
            vec![
                row.descriptor.clone(),
                whole(row.size),
                whole(row.cloud_size),
                optional(row.keypoints_per_cloud, 1),
                optional(row.area, 3),
                optional(row.nearest_area, 3),
            ]
        }));
        text += &table(&lines);
        text += &self.times_text();
        for row in &self.rows {
            let by = if row.distance == GIVEN { String::new() } else { format!(", by {}", row.distance) };
            text += &wrapped(&format!("{}: {}{by}", row.descriptor, row.parameters), 2);
            if let Some(settings) = &row.settings {
                let inside = match row.database_error {
                    Some(error) => format!("inside the database {} wrong", percent(error)),
                    None => "inside the database no cloud could be asked".to_owned(),
                };
                text += &wrapped(&format!("{}: {settings}; {inside}", row.descriptor), 2);
            }
            if let Some(note) = &row.note {
                text += &wrapped(&format!("{}: {note}", row.descriptor), 2);
            }
            if row.skipped > 0 {
                text += &wrapped(
                    &format!("{}: {} queries without a description", row.descriptor, row.skipped),
                    2,
                );
            }
        }
        text += &self.pairs_text();
        text += &self.perturbed_text();
        let times = if self.looks == 1 { "once".to_owned() } else { format!("{} times", self.looks) };
        text += "\n";
        for sentence in verdict(self.level, &self.rows, &self.pairs, &self.front) {
            text += &wrapped(&sentence, 2);
        }
        text +=
            &wrapped(&format!("the test clouds of this run have been looked at {times} (table looks)"), 2);
        let _ = writeln!(text, "tables in {}", self.folder.display());
        text
    }

    /// An error of all descriptors, with how many are wrong and both intervals.
    fn errors_text(
        &self,
        error: &str,
        of: impl Fn(&ComparedRow) -> (f64, u32, [f64; 2], [f64; 2]),
    ) -> String {
        let mut lines = vec![texts(["descriptor", error, "wrong", "interval, clouds", "interval, objects"])];
        lines.extend(self.rows.iter().map(|row| {
            let (error, wrong, wilson, bootstrap) = of(row);
            vec![row.descriptor.clone(), percent(error), wrong.to_string(), range(wilson), range(bootstrap)]
        }));
        format!("\n{}", table(&lines))
    }

    /// Nothing if no times were measured.
    fn times_text(&self) -> String {
        let measured = self.rows.iter().filter_map(|row| row.times.as_ref());
        let hardware: BTreeSet<&str> = measured.map(|times| times.hardware.as_str()).collect();
        if hardware.is_empty() {
            return String::new();
        }
        let title = ["descriptor", "seconds", "signatures", "/ paper", "normals", "describe", "match"];
        let mut lines = vec![texts(title)];
        let paper = self.rows.iter().find(|row| row.descriptor == PAPER);
        lines.extend(self.rows.iter().map(|row| {
            let times = row.times.as_ref();
            let signatures = times.map(Times::signatures);
            let ratio = paper.and_then(|paper| row.mean_time_beside(paper));
            vec![
                row.descriptor.clone(),
                optional(times.map(|times| times.total), 2),
                optional(signatures, 2),
                optional(ratio, 2),
                optional(times.map(|times| times.normals), 2),
                optional(times.map(|times| times.describe), 2),
                optional(times.map(|times| times.matching), 2),
            ]
        }));
        let seconds = format!(
            "seconds: read to match, queries and database, one thread of {}; signatures: keypoints, normals and describe, and how \
             many times the paper's on the same processor",
            hardware.into_iter().collect::<Vec<_>>().join(" or ")
        );
        format!("\n{}{}", table(&lines), wrapped(&seconds, 2))
    }

    fn pairs_text(&self) -> String {
        let levels: BTreeSet<&str> = self.pairs.iter().map(|pair| pair.level.as_str()).collect();
        // Objects first.
        levels.into_iter().rev().map(|level| self.level_text(level)).collect()
    }

    /// Every pair at one level. Right alone: clouds that only the first, and only the second recognises.
    fn level_text(&self, level: &str) -> String {
        let mut lines = vec![texts([
            &format!("{level} errors"),
            "points",
            "95 % interval",
            "right alone",
            "p (Holm)",
            "differ",
        ])];
        lines.extend(self.pairs.iter().filter(|pair| pair.level == level).map(|pair| {
            let [low, high] = [pair.difference_low, pair.difference_high];
            vec![
                format!("{} - {}", pair.descriptor_a, pair.descriptor_b),
                format!("{:+.2}", 100.0 * pair.error_difference()),
                format!("{:+.1} .. {:+.1}", 100.0 * low, 100.0 * high),
                format!("{} : {}", pair.only_a, pair.only_b),
                probability(pair.p_adjusted),
                if pair.p_adjusted < SIGNIFICANCE { "yes".to_owned() } else { "perhaps".to_owned() },
            ]
        }));
        format!("\n{}", table(&lines))
    }

    /// A table a kind of perturbation, with the error at each strength; which clouds were unusable.
    fn perturbed_text(&self) -> String {
        let mut text = String::new();
        for kind in Perturbation::ALL {
            let of_kind = || self.perturbed.iter().filter(|row| row.kind == kind.name());
            let mut title = vec![format!("{}, {}", kind.name(), kind.unit())];
            title.extend(std::iter::once(0.0).chain(kind.strengths()).map(|strength| strength.to_string()));
            let mut lines = vec![title];
            for row in of_kind() {
                if lines.last().is_none_or(|line| line[0] != row.descriptor) {
                    lines.push(vec![row.descriptor.clone()]);
                }
                lines.last_mut().into_iter().for_each(|line| line.push(percent(row.counts.object_error())));
            }
            if lines.len() == 1 {
                continue;
            }
            let _ = write!(text, "\n{}", table(&lines));
            for row in of_kind().filter(|row| row.unusable > 0) {
                let PerturbedRow { descriptor, strength, unusable, .. } = row;
                let unit = kind.unit();
                text += &wrapped(
                    &format!("{descriptor}: {unusable} clouds unusable at {strength} {unit}: wrong"),
                    2,
                );
            }
        }
        text
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
                "recogniser": row.recogniser,
                "cloud_size": row.cloud_size,
                "settings": row.settings,
                "database_error": row.database_error,
                "note": row.note,
                "file_digest": row.file_digest,
                "queries": row.counts.queries,
                "skipped": row.skipped,
                "database": row.database,
                "object_error": row.counts.object_error(),
                "object_wrong": row.counts.object_errors().wrong,
                "object_error_interval": row.object_wilson,
                "object_error_interval_instances": row.object_bootstrap,
                "category_error": row.counts.category_error(),
                "category_wrong": row.counts.category_errors().wrong,
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
                    "signatures": times.signatures(),
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
        let perturbed = |row: &PerturbedRow| {
            json!({
                "descriptor": row.descriptor,
                "kind": row.kind,
                "strength": row.strength,
                "unit": row.unit,
                "queries": row.counts.queries,
                "unusable": row.unusable,
                "object_error": row.counts.object_error(),
                "object_wrong": row.counts.object_errors().wrong,
                "object_error_interval": row.object_wilson,
                "object_error_interval_instances": row.object_bootstrap,
                "category_error": row.counts.category_error(),
                "category_wrong": row.counts.category_errors().wrong,
                "category_error_interval": row.category_wilson,
                "category_error_interval_instances": row.category_bootstrap,
            })
        };
        json!({
            "name": self.name,
            "run": self.folder.display().to_string(),
            "looks": self.looks,
            "verdict": verdict(self.level, &self.rows, &self.pairs, &self.front),
            "descriptors": self.rows.iter().map(descriptor).collect::<Vec<_>>(),
            "pairs": self.pairs.iter().map(pair).collect::<Vec<_>>(),
            "perturbed": self.perturbed.iter().map(perturbed).collect::<Vec<_>>(),
        })
    }
}
