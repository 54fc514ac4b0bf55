//! The end of an exhaustive search, for people and as JSON.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::time::Duration;

use descriptor::{Family, GENES};
use results::{CountRow, ErrorRate, FinishedGrid};
use serde_json::{Value, json};

use super::Recheck;
use crate::lines::{clock, labelled, percent};
use crate::run::summary::genes_json;

/// Best descriptors that are shown.
const SHOWN: usize = 5;
/// Ranges of the histogram that is shown.
const RANGES: u32 = 8;

/// What a finished grid amounts to.
#[derive(Clone, Debug)]
pub struct GridSummary {
    /// The grid.
    pub grid: FinishedGrid,
    /// Its folder.
    pub out: PathBuf,
    /// What the evaluator says to some of its counts, if it was asked.
    pub recheck: Option<Recheck>,
}

impl GridSummary {
    /// The result table.
    pub fn text(&self) -> String {
        let grid = &self.grid.row;
        let mut text = String::new();
        let mut row = |label: &str, value: String| {
            text += &labelled(label, 14, &value);
        };
        row("experiment", grid.name.clone());
        row("grid", format!("{} descriptors in {} cells", grid.descriptors, grid.cells));
        row("queries", format!("{} training clouds", grid.queries));
        row("best", self.error(grid.best_object_correct));
        for (spec, value) in GENES.iter().zip(&grid.best_genes) {
            if let Some(value) = value {
                row("", format!("{:<12}{:<8}{}", spec.name, format!("{value} {}", spec.unit), spec.meaning));
            }
        }
        row("optimal set", format!("{} descriptors are as good", grid.optimal_descriptors));
        for (rank, best) in self.grid.best.iter().take(SHOWN).enumerate() {
            let named = GENES.iter().zip(&best.genes).filter_map(|(spec, value)| Some((spec, (*value)?)));
            let genes: Vec<String> = named.map(|(spec, value)| format!("{}={value}", spec.name)).collect();
            row(
                if rank == 0 { "top" } else { "" },
                format!("{:<16}{}", self.error(best.object_correct), genes.join(" ")),
            );
        }
        for (index, (low, high, descriptors)) in ranges(&self.grid.counts).into_iter().rev().enumerate() {
            let share = percent(descriptors as f64 / grid.descriptors as f64);
            row(
                if index == 0 { "errors" } else { "" },
                format!("{:<16}to {:<16}{descriptors} ({share})", self.error(high), self.error(low)),
            );
        }
        let (computed, found) = (grid.cells_computed, grid.cells_found);
        row("cells", format!("{computed} computed, {found} there already"));
        row("time", clock(Duration::try_from_secs_f64(grid.seconds).unwrap_or_default()));
        row("grid digest", grid.grid_digest.clone());
        if let Some(recheck) = &self.recheck {
            row("recomputed", recheck.to_string());
        }
        let _ = writeln!(text, "{:<14}{}", "results", self.out.display()); // writing to a String cannot fail
        text
    }

    /// Whether no count that was looked at is wrong.
    pub fn is_sound(&self) -> bool {
        self.recheck.as_ref().is_none_or(|recheck| recheck.problems.is_empty())
    }

    /// The same as one JSON object; errors are fractions.
    pub fn json(&self) -> Value {
        let grid = &self.grid.row;
        let missed = |correct: u32| grid.queries.saturating_sub(correct);
        json!({
            "name": grid.name,
            "grid_key": grid.grid_key,
            "descriptors": grid.descriptors,
            "cells": grid.cells,
            "queries": grid.queries,
            "best": genes_json(Family::DiskRing, &grid.best_genes),
            "best_object_correct": grid.best_object_correct,
            "best_object_error": f64::from(missed(grid.best_object_correct)) / f64::from(grid.queries),
            "optimal_descriptors": grid.optimal_descriptors,
            "cells_computed": grid.cells_computed,
            "cells_found": grid.cells_found,
            "seconds": grid.seconds,
            "train_digest": grid.train_digest,
            "grid_digest": grid.grid_digest,
            "recomputed": self.recheck.as_ref().map(|recheck| recheck.recomputed),
            "problems": self.recheck.as_ref().map(|recheck| &recheck.problems),
            "out": self.out.display().to_string(),
        })
    }

    /// An error with its number of queries.
    fn error(&self, object_correct: u32) -> String {
        let rate = ErrorRate::new(object_correct, self.grid.row.queries);
        format!("{} ({})", percent(rate.share()), rate.wrong)
    }
}

/// At most [`RANGES`] ranges of ascending counts with their descriptors, ascending: lowest and highest count,
/// descriptors.
fn ranges(counts: &[CountRow]) -> Vec<(u32, u32, u64)> {
    let (Some(first), Some(last)) = (counts.first(), counts.last()) else { return Vec::new() };
    let low = first.object_correct;
    let width = (last.object_correct - low) / RANGES + 1;
    let mut ranges: Vec<(u32, u32, u64)> = Vec::new();
    for row in counts {
        let start = low + (row.object_correct - low) / width * width;
        match ranges.last_mut().filter(|range| range.0 == start) {
            Some(range) => range.2 = range.2.saturating_add(row.descriptors),
            None => {
                let end = start.saturating_add(width - 1).min(last.object_correct);
                ranges.push((start, end, row.descriptors));
            }
        }
    }
    ranges
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_histogram_is_cut_into_few_ranges_that_cover_it() {
        for highest in [3u32, 10, 11, 100, 352] {
            let row =
                |object_correct| CountRow { object_correct, descriptors: 1 + u64::from(object_correct % 3) };
            let counts: Vec<CountRow> = (3..=highest).filter(|count| count % 7 != 0).map(row).collect();
            let ranges = ranges(&counts);
            assert!(ranges.len() <= RANGES as usize && !ranges.is_empty());
            let total: u64 = counts.iter().map(|row| row.descriptors).sum();
            assert_eq!(ranges.iter().map(|range| range.2).sum::<u64>(), total);
            assert!(ranges.is_sorted() && ranges.windows(2).all(|pair| pair[0].1 < pair[1].0));
        }
        assert!(ranges(&[]).is_empty());
        let extreme = [0, u32::MAX].map(|object_correct| CountRow { object_correct, descriptors: u64::MAX });
        assert_eq!(ranges(&extreme).last().map(|range| range.1), Some(u32::MAX));
    }
}
