//! Sets of clouds that are each compared within themselves: which have a part in a fitness, one result of the results
//! of all, and what descriptors have on each.

use std::collections::HashMap;

use proto::task::{EvaluationResult, Match};
use results::{Counts, PredictionRow, SetRow};
use serde_json::{Value, json};

use crate::compare::{EVOLVED, PAPER};
use crate::dataset::{Clouds, Dataset};
use crate::lines::percent;
use crate::run::matching::Matching;

/// The sets with a weight above 0, by number.
pub fn with_weight(weights: &[u32]) -> Vec<u32> {
    (0..).zip(weights).filter(|&(_, weight)| *weight > 0).map(|(set, _)| set).collect()
}

/// The result on all clouds of a matching, of plain results with matches on each of these sets: the sum of their counts,
/// and their matches in the order of all queries, with the nearest clouds as indices into the whole database.
pub fn merge(
    dataset: &Dataset,
    matching: Matching,
    results: impl IntoIterator<Item = (u32, EvaluationResult)>,
) -> EvaluationResult {
    let (queries, database) = (matching.query_clouds(dataset), matching.database_clouds(dataset));
    let places = |indices: &[u32], set: u32| -> Vec<u32> {
        let is_of_set = |index: u32| dataset.clouds.entries[index as usize].set == set;
        (0..).zip(indices).filter(|&(_, &index)| is_of_set(index)).map(|(place, _)| place).collect()
    };
    let mut merged = EvaluationResult::default();
    let mut matches: Vec<(u32, Match)> = Vec::with_capacity(queries.len());
    for (set, result) in results {
        let [asked, known] = [queries, &database[..]].map(|indices| places(indices, set));
        let in_all = |found: Match| Match {
            nearest: known[found.nearest as usize],
            runner_up: found.runner_up.map(|(index, distance)| (known[index as usize], distance)),
            ..found
        };
        matches.extend(asked.into_iter().zip(result.matches.into_iter().map(in_all)));
        merged.queries += result.queries;
        merged.object_correct += result.object_correct;
        merged.category_correct += result.category_correct;
    }
    matches.sort_unstable_by_key(|(query, _)| *query);
    merged.matches = matches.into_iter().map(|(_, found)| found).collect();
    merged
}

/// What a descriptor has on the test clouds of each set that has any, from its matches on all of them; nothing of clouds
/// that are of one set. `weights`: of each set in the fitness.
pub fn rows(dataset: &Dataset, weights: &[u32], descriptor: &str, result: &EvaluationResult) -> Vec<SetRow> {
    if dataset.clouds.set_count() == 1 {
        return Vec::new();
    }
    let (queries, database) = (Matching::Test.query_clouds(dataset), Matching::Test.database_clouds(dataset));
    let entry = |index: u32| &dataset.clouds.entries[index as usize];
    let mut of_sets = vec![Counts::NONE; weights.len()];
    for (&query, found) in queries.iter().zip(&result.matches) {
        let (query, nearest) = (entry(query), entry(database[found.nearest as usize]));
        let counts = &mut of_sets[query.set as usize];
        counts.add(nearest.instance == query.instance, nearest.category == query.category);
    }
    of_counts(&dataset.clouds.sets, weights, descriptor, of_sets)
}

/// The same from its answers to all test queries; `None` if one is of a cloud that the data set does not list.
pub fn of_answers(
    clouds: &Clouds,
    weights: &[u32],
    descriptor: &str,
    answers: &[PredictionRow],
) -> Option<Vec<SetRow>> {
    let numbers: HashMap<&str, usize> =
        clouds.sets.iter().enumerate().map(|(number, set)| (set.as_str(), number)).collect();
    let of_path: HashMap<&str, usize> = clouds
        .listed
        .iter()
        .filter_map(|cloud| Some((cloud.path.as_str(), *numbers.get(cloud.set.as_deref()?)?)))
        .collect();
    let mut of_sets = vec![Counts::NONE; weights.len()];
    for answer in answers {
        let counts = of_sets.get_mut(*of_path.get(answer.cloud.as_str())?)?;
        counts
            .add(answer.predicted_instance == answer.instance, answer.predicted_category == answer.category);
    }
    Some(of_counts(&clouds.sets, weights, descriptor, of_sets))
}

/// A row for each set that has queries.
fn of_counts(sets: &[String], weights: &[u32], descriptor: &str, of_sets: Vec<Counts>) -> Vec<SetRow> {
    let named = sets.iter().zip(weights).zip(of_sets);
    let row = |((set, weight), counts): ((&String, &u32), Counts)| SetRow {
        descriptor: descriptor.to_owned(),
        set: set.clone(),
        weight: *weight,
        counts,
        object_wilson: counts.object_errors().interval(),
        category_wilson: counts.category_errors().interval(),
    };
    named.filter(|(_, counts)| counts.queries > 0).map(row).collect()
}

/// What a descriptor has on the test clouds of a set.
pub fn counts(rows: &[SetRow], descriptor: &str, set: &str) -> Option<Counts> {
    let row = rows.iter().find(|row| row.descriptor == descriptor && row.set == set);
    row.map(|row| row.counts)
}

/// The errors of the winner and of the paper's descriptor on each set, a line each below a title; nothing of clouds that
/// are of one set.
pub fn lines(rows: &[SetRow]) -> Vec<Vec<String>> {
    let winner: Vec<&SetRow> = rows.iter().filter(|row| row.descriptor == EVOLVED).collect();
    if winner.is_empty() {
        return Vec::new();
    }
    let error =
        |counts: Counts| format!("{} ({})", percent(counts.object_error()), counts.object_errors().wrong);
    let line = |row: &&SetRow| {
        let weight = if row.weight == 0 { "not seen".to_owned() } else { row.weight.to_string() };
        let paper = beside(rows, row).map_or_else(|| "-".to_owned(), |paper| error(paper.counts));
        vec![row.set.clone(), weight, error(row.counts), paper, row.counts.queries.to_string()]
    };
    let title = ["test clouds of", "weight", EVOLVED, PAPER, "clouds"].map(str::to_owned).to_vec();
    std::iter::once(title).chain(winner.iter().map(line)).collect()
}

/// Which set the winner has the highest error on, in a sentence; the first of equals.
pub fn worst(rows: &[SetRow]) -> Option<String> {
    let winner = rows.iter().filter(|row| row.descriptor == EVOLVED);
    // The last of equals wins a maximum.
    let error = |row: &SetRow| row.counts.object_error();
    let worst = winner.rev().max_by(|a, b| error(a).total_cmp(&error(b)))?;
    let unseen = if worst.weight == 0 { ", which the search has not seen" } else { "" };
    let paper = beside(rows, worst).map_or_else(String::new, |paper| {
        format!(" instead of {} by the paper's descriptor", percent(error(paper)))
    });
    Some(format!("highest error on {}{unseen}: {} of clouds wrong{paper}", worst.set, percent(error(worst))))
}

/// The paper's descriptor on the same set.
fn beside<'a>(rows: &'a [SetRow], row: &SetRow) -> Option<&'a SetRow> {
    rows.iter().find(|other| other.descriptor == PAPER && other.set == row.set)
}

/// Each descriptor on each set as JSON; `None` of clouds that are of one set.
pub fn json(rows: &[SetRow]) -> Option<Value> {
    let row = |row: &SetRow| {
        json!({
            "descriptor": row.descriptor,
            "set": row.set,
            "weight": row.weight,
            "object_error": row.counts.object_error(),
            "object_error_interval": row.object_wilson,
            "category_error": row.counts.category_error(),
            "queries": row.counts.queries,
        })
    };
    (!rows.is_empty()).then(|| rows.iter().map(row).collect())
}
