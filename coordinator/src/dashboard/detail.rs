//! Everything about one run that does not change while it is looked at: verdict, errors, comparison, channels.

use std::path::Path;

use descriptor::Descriptor;
use results::{Columnar, Counts, FinishedRun, TableName};
use serde_json::{Value, json};

use super::overview::Overview;
use super::run_log::milliseconds;
use crate::experiment::Experiment;
use crate::reopen::winner_of;

/// A run in full, as JSON. `run`: its summary.
pub fn detail(folder: &Path, overview: &Overview, run: Value) -> Result<String, results::Error> {
    let finished = overview.finished();
    let table = |table| -> Result<String, results::Error> {
        let rows = Columnar::read(folder, table)?;
        Ok(rows.map_or_else(|| "null".to_owned(), |rows| Columnar::json([&rows].into_iter())))
    };
    let winner = finished
        .zip(overview.experiment())
        .and_then(|(finished, experiment)| winner_of(experiment.space(), &finished.row).ok());
    let looks: Vec<Value> = results::read_looks(folder)?
        .into_iter()
        .map(|look| {
            json!({
                "at_ms": milliseconds(look.at), "command": look.command, "reason": look.reason,
                "descriptors": look.descriptors,
            })
        })
        .collect();
    let experiment = overview.experiment();
    let parts = json!({
        "run": run,
        "method": experiment.map(|experiment| experiment.method().as_str()),
        "family": experiment.map(|experiment| experiment.space().family().name()),
        "genes": experiment.map(genes).unwrap_or_default(),
        "objectives": experiment.map(objectives).unwrap_or_default(),
        "errors": finished.map(errors).unwrap_or_default(),
        "winner": finished.map(|finished| json!({
            "generation": finished.row.winner_generation, "individual": finished.row.winner_individual,
            "text": winner.as_ref().map(Descriptor::parameters), "values": finished.row.best_genes,
        })),
        "channels": winner.as_ref().map(channels).unwrap_or_default(),
        "answers": answers(folder)?,
        "test_clouds": test_clouds(finished, experiment),
        "looks": looks,
        "toml": match (finished, experiment) {
            (Some(finished), _) => Some(finished.row.resolved_toml.clone()),
            (None, experiment) => experiment.map(Experiment::resolved_toml),
        },
        "digests": finished.map_or(json!({}), |finished| json!({
            "run_digest": finished.run_digest, "data_digest": finished.row.data_digest,
            "evaluation_version": finished.row.evaluation_version, "build": finished.row.build,
        })),
    });
    let mut text = parts.to_string();
    text.pop();
    for (name, table) in [
        ("compared", table(TableName::Comparison)?),
        ("pairs", table(TableName::Pairs)?),
        ("front", table(TableName::Front)?),
        ("sets", table(TableName::Sets)?),
    ] {
        text += &format!(",\"{name}\":{table}");
    }
    text.push('}');
    Ok(text)
}

/// What its search minimises.
fn objectives(experiment: &Experiment) -> Vec<&'static str> {
    experiment.objectives().each().map(|objective| objective.name()).collect()
}

fn genes(experiment: &Experiment) -> Vec<Value> {
    let columns = experiment.space().columns();
    columns.into_iter().map(|column| json!({"name": column.name, "unit": column.unit})).collect()
}

fn errors(finished: &FinishedRun) -> Vec<Value> {
    let row = &finished.row;
    let splits = [
        ("train", Some(row.train), row.train_effective),
        ("validation", row.validation, row.validation_effective),
        ("train weighed", row.weighted_train, row.train_effective),
        ("test", row.test, None),
    ];
    let error = |(split, counts, effective): (&str, Option<Counts>, Option<f64>)| {
        let counts = counts?;
        let (object, category) = (counts.object_errors(), counts.category_errors());
        let [low, high] = object.interval_of(effective);
        Some(json!({
            "split": split, "object_error": object.share(), "object_wrong": object.wrong,
            "category_error": category.share(), "category_wrong": category.wrong,
            "queries": counts.queries, "low": low, "high": high,
        }))
    };
    splits.into_iter().filter_map(error).collect()
}

/// The channels of a descriptor.
fn channels(descriptor: &Descriptor) -> Vec<Value> {
    let weights = descriptor.channels().into_iter().map(|(_, weight)| weight);
    let texts: Vec<String> = match descriptor {
        Descriptor::Structure(structure) => {
            structure.channels.iter().map(|weighted| weighted.channel.to_string()).collect()
        }
        other => other.layouts().into_iter().map(|layout| layout.name).collect(),
    };
    let channels = descriptor.layouts().into_iter().zip(texts).zip(weights);
    channels
        .map(|((layout, text), weight)| {
            let values: u32 = layout.parts.iter().map(|part| part.bins.iter().product::<u32>()).sum();
            json!({"name": layout.name, "text": text, "weight": weight, "values": values, "regions": layout.regions})
        })
        .collect()
}

/// What answers to queries there are: the names that [`answers_of`] takes.
fn answers(folder: &Path) -> Result<Vec<String>, results::Error> {
    let is_there = |table: TableName, file: String| folder.join(table.as_str()).join(file).is_file();
    let mut names: Vec<String> = ["validation", "test"]
        .into_iter()
        .filter(|split| is_there(TableName::Predictions, format!("{split}.parquet")))
        .map(str::to_owned)
        .collect();
    for row in results::read_comparison(folder)? {
        if is_there(TableName::Answers, format!("{}.parquet", row.descriptor)) {
            names.push(format!("compared:{}", row.descriptor));
        }
    }
    Ok(names)
}

/// Answers to queries as a table; `None` if there are none of this name.
///
/// # Errors
/// If a file cannot be read, or is damaged.
pub fn answers_of(folder: &Path, of: &str) -> Result<Option<String>, results::Error> {
    if !answers(folder)?.iter().any(|name| name == of) {
        return Ok(None);
    }
    let (table, file) = match of.strip_prefix("compared:") {
        Some(descriptor) => (TableName::Answers, descriptor),
        None => (TableName::Predictions, of),
    };
    let rows = Columnar::of_file(&folder.join(table.as_str()).join(format!("{file}.parquet")), table)?;
    Ok(rows.map(|rows| Columnar::json([&rows].into_iter())))
}

fn test_clouds(finished: Option<&FinishedRun>, experiment: Option<&Experiment>) -> &'static str {
    match (finished, experiment) {
        (Some(finished), _) if finished.row.test.is_some() => "shown",
        (Some(_), _) => "none",
        (None, _) => "hidden until the search ends",
    }
}

/// The errors of all descriptors by the values of two genes, from the grid in a folder; `None` if it does not have them.
pub fn landscape(grid: &Path, a: &str, b: &str) -> Result<Option<Value>, results::Error> {
    let rows = results::read_landscapes(grid)?;
    let is_asked = |row: &&results::LandscapeRow| row.gene_a == a && row.gene_b == b;
    let chosen: Vec<_> = rows.iter().filter(is_asked).collect();
    let queries = results::read_grid(grid)?.row.queries;
    let error = |correct: f64| 1.0 - correct / f64::from(queries.max(1));
    let table = json!({"rows": chosen.len(), "columns": {
        "value_a": chosen.iter().map(|row| row.value_a).collect::<Vec<_>>(),
        "value_b": chosen.iter().map(|row| row.value_b).collect::<Vec<_>>(),
        "best_object_error": chosen.iter().map(|row| error(f64::from(row.best))).collect::<Vec<_>>(),
        "mean_object_error": chosen.iter().map(|row| error(row.mean)).collect::<Vec<_>>(),
    }});
    Ok((!chosen.is_empty()).then(|| json!({"a": a, "b": b, "table": table})))
}
