//! The end of a sweep, for people and as JSON.

use std::fmt::Write as _;
use std::path::PathBuf;

use results::Counts;
use serde_json::{Value, json};

use crate::lines::table;
use crate::run::progress::percent;
use crate::run::summary::Summary;

/// Digits of a run digest that tell a sweep's runs apart at a glance; `verify` and the tables have all.
const DIGEST: usize = 8;

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
        let title = ["run", "generations", "train", "validation", "test", "seconds", "digest"];
        let mut rows = vec![title.map(str::to_owned).to_vec()];
        let error =
            |counts: Option<Counts>| counts.map_or("-".to_owned(), |counts| percent(counts.object_error()));
        rows.extend(self.summaries.iter().map(|(name, Summary { run, run_digest, .. })| {
            vec![
                name.clone(),
                run.generations.to_string(),
                error(Some(run.train)),
                error(run.validation),
                error(run.test),
                format!("{:.1}", run.seconds),
                run_digest.get(..DIGEST).unwrap_or(run_digest).to_owned(),
            ]
        }));
        let mut text = table(&rows);
        // Writing to a String cannot fail.
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
