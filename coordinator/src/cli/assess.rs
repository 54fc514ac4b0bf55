//! `coordinator assess`: how well an artefact answers, and rejects.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;
use proto::Message;
use serde_json::{Value, json};

use crate::export::{self, Assessment, Rejected};
use crate::lines::{labelled, percent, table, wrapped};
use crate::looks::Look;

use super::layout::{LayoutArgs, LayoutName};
use super::look::{LookArgs, noted};

/// Measure an artefact on labelled clouds: wrong names, known objects that are rejected, and unknown ones
///
/// Each cloud is asked twice: of the artefact as it is, and without the clouds of its object. Clouds that the artefact holds
/// are skipped.
///
/// Example: coordinator assess objects --data results/data/demo --query test.txt
#[derive(Debug, Args)]
pub struct Assess {
    /// The folder that coordinator export has made, for example objects
    #[arg(value_name = "ARTEFACT")]
    artefact: PathBuf,
    /// Folder of the clouds, for example data/rgbd
    #[arg(long, value_name = "ROOT")]
    data: PathBuf,
    /// List of clouds, a path below ROOT on each line, for example test.txt; repeatable
    #[arg(long, value_name = "LIST", required = true, num_args = 1..)]
    query: Vec<PathBuf>,
    #[command(flatten)]
    layout: LayoutArgs,
    #[command(flatten)]
    look: LookArgs,
    /// Print one JSON object on standard output, for example for jq
    #[arg(long)]
    json: bool,
}

impl Assess {
    pub(super) fn execute(self) -> anyhow::Result<ExitCode> {
        let lists: Vec<PathBuf> =
            self.query.iter().map(|list| super::evaluate::list_file(&self.data, list)).collect();
        let layout = self.layout.or(LayoutName::Folders);
        let look = self.look.look("assess");
        let assessed = export::assess(&self.artefact, &self.data, &layout, &lists, look.as_ref())?;
        let text = if self.json { format!("{}\n", json(&assessed)) } else { text(&assessed, look.as_ref()) };
        super::print(&text)?;
        Ok(ExitCode::SUCCESS)
    }
}

fn share(count: usize, all: usize) -> String {
    if all == 0 { "none".to_owned() } else { percent(count as f64 / all as f64) }
}

fn text(assessed: &Assessment, look: Option<&Look>) -> String {
    let Assessment { known, wrong, wrong_accepted, foreign, foreign_rejected, left_out, .. } = assessed;
    let mut told = format!("{known} clouds, wrong name {} ({wrong})", share(*wrong, *known));
    if let Some(rate) = assessed.false_rejections {
        told += &format!(", of which {wrong_accepted} are not rejected where {} may be", percent(rate));
    }
    let mut text = labelled("known", 14, &told);
    if *foreign > 0 {
        let told = format!(
            "{foreign} clouds of objects that it does not know, rejected {} ({foreign_rejected})",
            share(*foreign_rejected, *foreign)
        );
        text += &labelled("unknown", 14, &told);
    }
    text += &labelled("left out", 14, &format!("{left_out} clouds asked without their object"));
    text += &format!("skipped       {}\n", assessed.skipped.len());
    for (path, reason) in &assessed.skipped {
        text += &format!("              {path}: {reason}\n");
    }
    match &assessed.curve {
        Ok(curve) => {
            let head = ["allowed", "known", "left out", "known, margin", "left out, margin"];
            let row = |row: &Rejected| {
                let [by_probability, by_margin] =
                    [0, 1].map(|rule| [share(row.known[rule], *known), share(row.left_out[rule], *left_out)]);
                [vec![percent(row.false_rejections)], by_probability.to_vec(), by_margin.to_vec()].concat()
            };
            let rows: Vec<Vec<String>> =
                std::iter::once(head.map(str::to_owned).to_vec()).chain(curve.iter().map(row)).collect();
            text += &table(&rows);
        }
        Err(reason) => text += &labelled("rejected", 14, &format!("none: {}", Message::of(reason).what)),
    }
    if let Some([by_probability, by_margin]) = assessed.separation {
        let told = format!(
            "{by_probability:.3} by probability, {by_margin:.3} by the margin alone: how often a known cloud's answer is the \
             more credible of a known and a left-out one"
        );
        text += &wrapped(&format!("separation    {told}"), 14);
    }
    if let Some((look, test_clouds)) = look.zip(assessed.test_clouds) {
        text += &labelled("look", 14, &noted(look, test_clouds));
    }
    text
}

fn json(assessed: &Assessment) -> Value {
    let skipped: Vec<_> =
        assessed.skipped.iter().map(|(path, reason)| json!({ "path": path, "reason": reason })).collect();
    let row = |row: &Rejected| {
        json!({
            "false_rejections": row.false_rejections,
            "known_rejected": row.known[0],
            "left_out_rejected": row.left_out[0],
            "known_rejected_by_margin": row.known[1],
            "left_out_rejected_by_margin": row.left_out[1],
        })
    };
    let (curve, reason) = match &assessed.curve {
        Ok(curve) => (Some(curve.iter().map(row).collect::<Vec<_>>()), None),
        Err(reason) => (None, Some(Message::of(reason).what)),
    };
    json!({
        "known": assessed.known,
        "wrong": assessed.wrong,
        "wrong_accepted": assessed.wrong_accepted,
        "unknown": assessed.foreign,
        "unknown_rejected": assessed.foreign_rejected,
        "left_out": assessed.left_out,
        "skipped": skipped,
        "false_rejections": assessed.false_rejections,
        "curve": curve,
        "no_curve": reason,
        "separation": assessed.separation.map(|[by_probability, _]| by_probability),
        "separation_by_margin": assessed.separation.map(|[_, by_margin]| by_margin),
        "test_clouds": assessed.test_clouds,
    })
}
