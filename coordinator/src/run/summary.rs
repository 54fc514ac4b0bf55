//! The end of a run, for people and as JSON.

use std::fmt::Write as _;
use std::iter;
use std::path::{Path, PathBuf};
use std::time::Duration;

use descriptor::{Column, Descriptor, Family};
use evolution::StopReason;
use results::{ComparedRow, Counts, ErrorRate, FrontRow, PairRow, RunRow, SetRow};
use serde_json::{Map, Value, json};

use crate::compare::{Level, verdict};
use crate::lines::{clock, labelled, percent, table};
use crate::run::{front, sets};

/// What a finished run amounts to; made from the row of table `run`, so that it can be shown again at any time.
#[derive(Clone, Debug)]
pub struct Summary {
    /// The row.
    pub run: RunRow,
    /// Digest over everything that determines and makes up the result.
    pub run_digest: String,
    /// The front of a search of several objectives; of others empty.
    pub front: Vec<FrontRow>,
    /// Of the descriptors that were searched.
    pub family: Family,
    /// The winner, with weights for its values where it was weighed; `None` if this program does not know it.
    pub winner: Option<Descriptor>,
    /// Clouds that took no part.
    pub skipped: usize,
    /// Size of the search space; `None` if 128 bits do not hold it.
    pub descriptors: Option<u128>,
    /// The winner beside other descriptors on the test clouds, as far as the run folder has them.
    pub compared: Vec<ComparedRow>,
    /// Every pair of these.
    pub pairs: Vec<PairRow>,
    /// Descriptors on the test clouds of each set; none if the clouds are of one.
    pub sets: Vec<SetRow>,
    /// What of the winner is at a bound of the search space.
    pub bounds: Vec<String>,
    /// The run folder.
    pub out: PathBuf,
}

impl Summary {
    /// The result table.
    pub fn text(&self) -> String {
        let run = &self.run;
        let mut text = String::new();
        let mut row = |label: &str, value: String| {
            text += &labelled(label, 14, &value);
        };
        row("experiment", format!("{}, seed {}", run.name, run.seed));
        let known = StopReason::ALL.into_iter().find(|reason| reason.as_str() == run.stop_reason);
        let reason = known.map_or_else(|| run.stop_reason.clone(), |reason| reason.to_string());
        row("stopped", format!("after generation {}: {reason}", run.generations));
        row("winner", format!("generation {}, individual {}", run.winner_generation, run.winner_individual));
        if let Some(Descriptor::Structure(structure)) = &self.winner {
            // The genes of a channel say little one by one.
            for channel in &structure.channels {
                row("", channel.to_string());
            }
        } else {
            for (column, value) in self.family.columns().into_iter().zip(&run.best_genes) {
                if let Some(value) = value {
                    let value = format!("{value} {}", column.unit);
                    row("", format!("{:<12}{value:<8}{}", column.name, column.meaning));
                }
            }
        }
        let title = [("object error", "95 % interval"), ("category error", "95 % interval")];
        let title = title.map(|(error, interval)| format!("{error:<14} {interval:<14} ")).concat();
        row("", format!("{title}clouds"));
        for (label, counts, effective) in self.errors() {
            let Some(counts) = counts else {
                row(label, "not measured".to_owned());
                continue;
            };
            let error = |rate: ErrorRate| {
                let [low, high] = rate.interval_of(effective).map(|end| 100.0 * end);
                let error = format!("{} ({})", percent(rate.share()), rate.wrong);
                let interval = format!("{low:.1} - {high:.1} %");
                format!("{error:<14} {interval:<14} ")
            };
            let object = error(counts.object_errors());
            let category = error(counts.category_errors());
            row(label, format!("{object}{category}{}", counts.queries));
        }
        let worth = self.errors().into_iter().filter_map(|(label, counts, effective)| {
            Some(format!("{label}: {} queries are worth {:.0} clouds", counts?.queries, effective?))
        });
        worth.for_each(|line| row("", line));
        for (label, line) in ["front"]
            .into_iter()
            .chain(iter::repeat(""))
            .zip(front::lines(&self.front, self.effective()).into_iter().flatten())
        {
            row(label, line);
        }
        text += &self.compared_text();
        text += &table(&sets::lines(&self.sets));
        let mut row = |label: &str, value: String| {
            text += &labelled(label, 14, &value);
        };
        for (place, sentence) in self.verdict().into_iter().enumerate() {
            row(if place == 0 { "verdict" } else { "" }, sentence);
        }
        for (place, bound) in self.bounds.iter().enumerate() {
            row(if place == 0 { "at a bound" } else { "" }, bound.clone());
        }
        if let Some((best, regret)) = run.grid_best_object_correct.zip(run.regret()) {
            let queries = run.train.queries;
            row(
                "regret",
                format!(
                    "{} ({} of {queries}): the best of all {}descriptors has {} ({})",
                    percent(regret),
                    best.saturating_sub(run.train.object_correct),
                    self.descriptors.map_or_else(String::new, |count| format!("{count} ")),
                    percent(f64::from(queries.saturating_sub(best)) / f64::from(queries)),
                    queries.saturating_sub(best),
                ),
            );
        }
        if self.skipped > 0 {
            row("skipped", format!("{} clouds, see table skipped", self.skipped));
        }
        row(
            "evaluations",
            format!("{} computed, {} remembered", run.evaluations_computed, run.evaluations_remembered),
        );
        row("time", clock(Duration::try_from_secs_f64(run.seconds).unwrap_or_default()));
        row("run digest", self.run_digest.clone());
        let _ = writeln!(text, "{:<14}{}", "results", self.out.display()); // writing to a String cannot fail
        text
    }

    /// What is to be said of the winner, in sentences.
    fn verdict(&self) -> Vec<String> {
        let compared = verdict(Level::of(&self.run), &self.compared, &self.pairs, &self.front);
        compared.into_iter().chain(sets::worst(&self.sets)).collect()
    }

    /// The winner and what it is compared with, a line each; nothing where there is nothing to compare it with.
    fn compared_text(&self) -> String {
        if self.compared.len() < 2 {
            return String::new();
        }
        let or_none = |text: Option<String>| text.unwrap_or_else(|| "-".to_owned());
        let level = Level::of(&self.run);
        let title =
            ["on test clouds", &format!("{} error", level.name()), "over objects", "values", "a cloud"];
        let mut lines = vec![title.map(str::to_owned).to_vec()];
        lines.extend(self.compared.iter().map(|one| {
            let errors = level.errors(one.counts);
            let interval = match level {
                Level::Object => one.object_bootstrap,
                Level::Category => one.category_bootstrap,
            };
            let [low, high] = interval.map(|end| 100.0 * end);
            vec![
                one.descriptor.clone(),
                format!("{} ({})", percent(errors.share()), errors.wrong),
                format!("{low:.1} - {high:.1} %"),
                or_none(one.cloud_size.map(|size| size.to_string())),
                or_none(one.milliseconds_of_a_cloud().map(|ms| format!("{ms:.2} ms"))),
            ]
        }));
        table(&lines)
    }

    /// The same as one JSON object; errors are fractions, with their 95 % intervals.
    pub fn json(&self) -> Value {
        let run = &self.run;
        let object = |counts: Option<Counts>| counts.map(|counts| counts.object_error());
        let category = |counts: Option<Counts>| counts.map(|counts| counts.category_error());
        let interval = |counts: Option<Counts>, effective| {
            counts.map(|counts| counts.object_errors().interval_of(effective))
        };
        let mut json = json!({
            "name": run.name,
            "seed": run.seed,
            "best": genes_json(self.family, &run.best_genes),
            "train_error": object(Some(run.train)),
            "train_error_interval": interval(Some(run.train), run.train_effective),
            "train_category_error": category(Some(run.train)),
            "weighted_train_error": object(run.weighted_train),
            "weighted_train_error_interval": interval(run.weighted_train, run.train_effective),
            "weighted_train_category_error": category(run.weighted_train),
            "validation_error": object(run.validation),
            "validation_error_interval": interval(run.validation, run.validation_effective),
            "validation_category_error": category(run.validation),
            "test_object_error": object(run.test),
            "test_object_error_interval": interval(run.test, None),
            "test_category_error": category(run.test),
            "verdict": self.verdict(),
            "compared": self.compared.iter().map(compared_json).collect::<Vec<_>>(),
            "at_a_bound": self.bounds,
            "regret": run.regret(),
            "grid_best_object_correct": run.grid_best_object_correct,
            "train_queries": run.train.queries,
            "train_effective": run.train_effective,
            "validation_queries": run.validation.map(|counts| counts.queries),
            "validation_effective": run.validation_effective,
            "test_queries": run.test.map(|counts| counts.queries),
            "evaluations_computed": run.evaluations_computed,
            "evaluations_remembered": run.evaluations_remembered,
            "generations": run.generations,
            "winner_generation": run.winner_generation,
            "stop_reason": run.stop_reason,
            "seconds": run.seconds,
            "skipped": self.skipped,
            "data_digest": run.data_digest,
            "run_digest": self.run_digest,
            "out": path_text(&self.out),
        });
        if let Some(front) = front::json(&self.front, self.effective()) {
            json["front"] = front;
        }
        if let Some(sets) = sets::json(&self.sets) {
            json["sets"] = sets;
        }
        json
    }

    /// How many clouds the points of a front are judged by, where that is not the number of queries.
    fn effective(&self) -> Option<f64> {
        let run = &self.run;
        if run.validation.is_some() { run.validation_effective } else { run.train_effective }
    }

    /// Counts of each split, with how many clouds they are worth where that is not their number.
    fn errors(&self) -> Vec<(&'static str, Option<Counts>, Option<f64>)> {
        let run = &self.run;
        let mut errors = vec![
            ("train", Some(run.train), run.train_effective),
            ("validation", run.validation, run.validation_effective),
            ("test", run.test, None),
        ];
        if run.weighted_train.is_some() {
            // What follows is measured with weights.
            errors.insert(2, ("train weighed", run.weighted_train, run.train_effective));
        }
        errors
    }
}

fn compared_json(row: &ComparedRow) -> Value {
    json!({
        "descriptor": row.descriptor,
        "object_error": row.counts.object_error(),
        "object_error_interval_instances": row.object_bootstrap,
        "category_error": row.counts.category_error(),
        "category_error_interval_instances": row.category_bootstrap,
        "cloud_size": row.cloud_size,
        "milliseconds": row.milliseconds_of_a_cloud(),
    })
}

/// The values of a descriptor of a family by name; genes that it is without are left out.
pub fn genes_json(family: Family, values: &[Option<f64>]) -> Map<String, Value> {
    let number =
        |column: &Column, value: f64| if column.integer { json!(value as u32) } else { json!(value) };
    let columns = family.columns();
    let genes = columns.iter().zip(values);
    genes.filter_map(|(column, value)| Some((column.name.to_owned(), number(column, (*value)?)))).collect()
}

fn path_text(path: &Path) -> String {
    path.display().to_string()
}
