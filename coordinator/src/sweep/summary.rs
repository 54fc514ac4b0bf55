//! The end of a sweep, for people and as JSON.

use std::fmt::Write as _;
use std::path::PathBuf;

use results::Counts;
use serde_json::{Value, json};

use crate::run::progress::percent;
use crate::run::summary::Summary;

/// What a finished sweep amounts to.
#[derive(Clone, Debug)]
pub struct SweepSummary {
    /// Of each member, by name, in the order of the sweep.
    pub summaries: Vec<(String, Summary)>,
    /// The sweep's folder: the run folders are in it, each under its member's name.
    pub out: PathBuf,
}

impl SweepSummary {
    /// The result table, a line a member. Errors are those of objects.
    pub fn text(&self) -> String {
        let width = self.summaries.iter().map(|(name, _)| name.len()).max().unwrap_or(0).max("run".len());
        let mut text = String::new();
        let mut row = |[name, generations, train, validation, test, seconds, digest]: [&str; 7]| {
            // Writing to a String cannot fail.
            let _ = writeln!(
                text,
                "{name:<width$}  {generations:>11}  {train:>9}  {validation:>10}  {test:>9}  {seconds:>9}  {digest}"
            );
        };
        row(["run", "generations", "train", "validation", "test", "seconds", "run digest"]);
        let error =
            |counts: Option<Counts>| counts.map_or("-".to_owned(), |counts| percent(counts.object_error()));
        for (name, Summary { run, run_digest, .. }) in &self.summaries {
            row([
                name,
                &run.generations.to_string(),
                &error(Some(run.train)),
                &error(run.validation),
                &error(run.test),
                &format!("{:.1}", run.seconds),
                run_digest.get(..12).unwrap_or(run_digest),
            ]);
        }
        let _ = writeln!(text, "results in {}", self.out.display());
        text
    }

    /// The same as JSON, a line a member: its name as `member`, beside what the summary of one run has.
    pub fn json(&self) -> String {
        let line = |(name, summary): &(String, Summary)| {
            let mut value = summary.json();
            if let Value::Object(fields) = &mut value {
                fields.insert("member".to_owned(), json!(name));
            }
            format!("{value}\n")
        };
        self.summaries.iter().map(line).collect()
    }
}
