//! A run in tables: what it was, what it found, how certain that is.

use super::data::{Rows, RunData};
use super::html::Item;
use super::table::TableBlock;
use crate::columns::GeneColumn;
use crate::error::Error;
use crate::read::FinishedRun;
use crate::tables::run::Counts;

/// Rows of events and skipped clouds that are shown.
const MOST_ROWS: usize = 50;

/// A share of queries, as in `23.16 % (110)`.
fn error_text(wrong: u32, of: u32) -> String {
    format!("{:.2} % ({wrong})", 100.0 * f64::from(wrong) / f64::from(of))
}

/// Both ends of an interval of shares, percent.
pub(crate) fn interval_text([low, high]: [f64; 2]) -> String {
    format!("{:.1} – {:.1} %", 100.0 * low, 100.0 * high)
}

/// What the run did, in a line or two.
pub(crate) fn lead(FinishedRun { row, .. }: &FinishedRun) -> String {
    format!(
        "Evolution of a 3D point-cloud descriptor. The winner is individual {} of generation {}; the search ended after \
         generation {}, stopped by {}, with {} evaluations computed and {} remembered in {:.1} s.",
        row.winner_individual,
        row.winner_generation,
        row.generations,
        row.stop_reason,
        row.evaluations_computed,
        row.evaluations_remembered,
        row.seconds
    )
}

/// How far the winner is from the best descriptor of the search space, where that is known.
pub(crate) fn regret(FinishedRun { row, .. }: &FinishedRun) -> Option<String> {
    let (best, regret) = row.grid_best_object_correct.zip(row.regret())?;
    let behind = best.saturating_sub(row.train.object_correct);
    Some(match behind {
        0 => "no descriptor of the search space is better in training".to_owned(),
        _ => format!(
            "{:.2} % ({behind} of {} clouds) behind the best descriptor of the search space, in training",
            100.0 * regret,
            row.train.queries
        ),
    })
}

/// The winner's genes.
pub(crate) fn genes(run: &FinishedRun) -> TableBlock {
    let genes = run.genes.iter().zip(&run.row.best_genes);
    let row = |(gene, value): (&GeneColumn, &Option<f64>)| {
        let value = format!("{} {}", (*value)?, gene.unit);
        Some(vec![gene.name.clone(), value.trim_end().to_owned(), gene.meaning.clone()])
    };
    TableBlock {
        caption: "The winner’s genes.".to_owned(),
        head: ["gene", "value", "meaning"].map(str::to_owned).to_vec(),
        rows: genes.filter_map(row).collect(),
        texts: 3,
    }
}

/// What the run was: all that finds it again.
pub(crate) fn overview(data: &RunData) -> Result<TableBlock, Error> {
    let mut rows: Vec<Vec<String>> = Vec::new();
    let mut row = |name: &str, value: String| rows.push(vec![name.to_owned(), value]);
    match (&data.finished, &data.run) {
        (Some(FinishedRun { row: run, run_digest, .. }), Some(table)) => {
            let text = |column: &str| -> Result<String, Error> {
                Ok(table.texts(column)?.into_iter().next().unwrap_or_default())
            };
            row("experiment", run.name.clone());
            row("seed", run.seed.to_string());
            row("started", format!("{} UTC", text("started_at")?));
            row("finished", format!("{} UTC", text("finished_at")?));
            row("machine of the coordinator", run.host.clone());
            row(
                "program",
                format!(
                    "{} ({}), evaluation version {}",
                    run.program_version, run.build, run.evaluation_version
                ),
            );
            row("data digest", run.data_digest.clone());
            row("run digest", run_digest.clone());
        }
        _ => {
            let generations = data.generations.as_ref().map_or(0, Rows::len);
            row("state", format!("unfinished, {generations} generations so far"));
        }
    }
    if let Some(skipped) = &data.skipped {
        row("skipped", format!("{} clouds took no part", skipped.len()));
    }
    row("folder", data.label.clone());
    Ok(TableBlock { caption: "The run.".to_owned(), head: Vec::new(), rows, texts: 2 })
}

/// The winner's errors with their intervals.
pub(crate) fn errors(run: &FinishedRun) -> TableBlock {
    let row = &run.row;
    let mut splits = vec![
        ("training", Some(row.train), row.train_effective),
        ("validation", row.validation, row.validation_effective),
        ("test", row.test, None),
    ];
    if row.weighted_train.is_some() {
        splits.insert(2, ("training, weighed", row.weighted_train, row.train_effective));
    }
    let weighted = splits.iter().any(|(_, _, effective)| effective.is_some());
    let row = |(split, counts, effective): (&str, Option<Counts>, Option<f64>)| {
        let Some(counts) = counts else {
            let mut row = vec![split.to_owned(), "not measured".to_owned()];
            row.resize(6, String::new());
            return row;
        };
        let mut row = vec![split.to_owned()];
        for rate in [counts.object_errors(), counts.category_errors()] {
            row.push(error_text(rate.wrong, rate.queries));
            row.push(interval_text(rate.interval_of(effective)));
        }
        let worth = effective.map_or_else(String::new, |clouds| format!(" worth {clouds:.0}"));
        row.push(format!("{}{worth}", counts.queries));
        row
    };
    let worth = if weighted {
        " Where clouds count more than once, counts are sums of weights, and the interval is that of as many clouds as they \
         are worth (effective sample size, Kish)."
    } else {
        ""
    };
    let head = ["clouds of", "object error", "95 %", "category error", "95 %", "clouds"];
    TableBlock {
        caption: format!(
            "Errors of the winner, with the number of wrong clouds and the 95 % interval (Wilson’s score, which takes \
             clouds for independent; those of one object are not, so that the truth is less certain still).{worth}"
        ),
        head: head.map(str::to_owned).to_vec(),
        rows: splits.into_iter().map(row).collect(),
        texts: 1,
    }
}

/// How often the test clouds were looked at, and what for. `tested`: the run ended with a test of its winner.
pub(crate) fn looks(looks: Option<&Rows>, tested: bool) -> Result<Item, Error> {
    let Some(looks) = looks else {
        let text = "Looks at the test clouds were not recorded when this run was made, or there was none.";
        return Ok(Item::Missing(text.to_owned()));
    };
    let times = if looks.len() == 1 { "once".to_owned() } else { format!("{} times", looks.len()) };
    // Runs of earlier versions were tested without a note of it.
    let unnoted = tested && !looks.texts("command")?.iter().any(|command| command == "run");
    let unnoted = if unnoted { ", and without a note at the end of the run" } else { "" };
    let caption = format!(
        "The test clouds were looked at {times} (UTC){unnoted}. Whoever chooses by test errors has used them up: only a result that \
         was fixed before the first look is as good as it seems."
    );
    listing(looks, &caption, &["at", "command", "reason", "descriptors"])
}

/// What happened beside the results, and clouds that took no part.
pub(crate) fn happenings(data: &RunData) -> Result<Vec<Item>, Error> {
    let mut items = Vec::new();
    if let Some(events) = &data.events {
        let columns = ["at", "event", "worker", "message"];
        items.push(listing(events, "What happened beside the evaluations (times in UTC).", &columns)?);
    }
    if let Some(workers) = &data.workers {
        let columns = ["worker", "threads", "joined_at", "gone_at", "departure", "answers"];
        items.push(listing(
            workers,
            "Workers (times in UTC); who was there to the end did not go.",
            &columns,
        )?);
    }
    if let Some(skipped) = &data.skipped {
        items.push(listing(skipped, "Clouds that took no part.", &["split", "cloud", "reason"])?);
    }
    Ok(items)
}

/// The first rows of a table.
pub(crate) fn listing(rows: &Rows, caption: &str, columns: &[&str]) -> Result<Item, Error> {
    let texts: Vec<Vec<String>> =
        columns.iter().map(|column| rows.texts(column)).collect::<Result<_, _>>()?;
    let shown = rows.len().min(MOST_ROWS);
    let row = |row: usize| texts.iter().map(|column| column[row].clone()).collect();
    let more =
        if rows.len() > shown { format!(" The first {shown} of {}.", rows.len()) } else { String::new() };
    Ok(Item::Table(TableBlock {
        caption: format!("{caption}{more}"),
        head: columns.iter().map(|&column| column.to_owned()).collect(),
        rows: (0..shown).map(row).collect(),
        texts: columns.len(),
    }))
}
