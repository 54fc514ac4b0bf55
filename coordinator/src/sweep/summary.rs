//! The end of a sweep, for people and as JSON.

use std::fmt::Write as _;
use std::path::PathBuf;

use results::Counts;
use serde_json::{Value, json};

use super::verdict::{Seed, variant, verdicts};
use crate::lines::{labelled, percent, table};
use crate::run::summary::Summary;

/// Digits of a run digest that tell a sweep's runs apart at a glance; `verify` and the tables have all.
const DIGEST: usize = 8;

/// Place of the column of training errors with weights, where a member has weighed.
const WEIGHED: usize = 4;

/// What a finished sweep amounts to.
#[derive(Clone, Debug)]
pub struct SweepSummary {
    /// Of each member, by name, in the order of the sweep.
    pub summaries: Vec<(String, Summary)>,
    /// The sweep's folder: the run folders are in it, each under its member's name.
    pub out: PathBuf,
}

impl SweepSummary {
    /// The result table, a line a member, and what its seeds say together. Errors are those of objects.
    pub fn text(&self) -> String {
        let weighs = self.summaries.iter().any(|(_, one)| one.run.weighted_train.is_some());
        let mut title = vec!["run", "generations", "train", "validation", "test", "seconds", "digest"];
        if weighs {
            title.insert(WEIGHED, "train weighed");
        }
        let mut rows = vec![title.into_iter().map(str::to_owned).collect()];
        let error =
            |counts: Option<Counts>| counts.map_or("-".to_owned(), |counts| percent(counts.object_error()));
        rows.extend(self.summaries.iter().map(|(name, Summary { run, run_digest, .. })| {
            let mut row = vec![
                name.clone(),
                run.generations.to_string(),
                error(Some(run.train)),
                error(run.validation),
                error(run.test),
                format!("{:.1}", run.seconds),
                run_digest.get(..DIGEST).unwrap_or(run_digest).to_owned(),
            ];
            if weighs {
                row.insert(WEIGHED, error(run.weighted_train));
            }
            row
        }));
        let mut text = table(&rows);
        for (variant, sentences) in verdicts(&self.seeds()) {
            for (place, sentence) in sentences.iter().enumerate() {
                let label = if place > 0 {
                    ""
                } else if variant.is_empty() {
                    "verdict"
                } else {
                    &variant
                };
                text += &labelled(label, 14.max(label.len() + 1), sentence);
            }
        }
        // Writing to a String cannot fail.
        let _ = writeln!(text, "results in {}", self.out.display());
        text
    }

    fn seeds(&self) -> Vec<Seed<'_>> {
        let named = self.summaries.iter();
        named.map(|(name, one)| Seed::new(name, &one.run, &one.compared, &one.pairs)).collect()
    }

    /// The same as JSON, a line a member: its name as `member` and what all seeds of its variant say as `sweep_verdict`,
    /// beside what the summary of one run has.
    pub fn json(&self) -> String {
        let verdicts = verdicts(&self.seeds());
        let line = |(name, summary): &(String, Summary)| {
            let mut value = summary.json();
            let own = variant(name, summary.run.seed);
            let verdict = verdicts.iter().find(|(variant, _)| variant == own).map(|(_, sentences)| sentences);
            if let Value::Object(fields) = &mut value {
                fields.insert("member".to_owned(), json!(name));
                fields.insert("sweep_verdict".to_owned(), json!(verdict));
            }
            format!("{value}\n")
        };
        self.summaries.iter().map(line).collect()
    }
}
