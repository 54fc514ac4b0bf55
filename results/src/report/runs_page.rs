//! What stands on the page of several runs.

use super::figures::seeds;
use super::html::{Item, Page, Section, add};
use super::run_tables;
use super::runs::Runs;

/// The page of several runs.
pub(crate) fn page(title: &str, runs: &Runs, verdict: &[String]) -> Page {
    let groups = runs.groups.as_slice();
    let mut items: Vec<Item> = Vec::new();
    if !verdict.is_empty() {
        items.push(Item::Verdict(verdict.to_vec()));
    }
    items.extend(runs.notes.iter().cloned().map(Item::Text));
    if groups.is_empty() {
        items.push(Item::Missing("No run has finished.".to_owned()));
    } else {
        items.push(Item::Table(run_tables::groups(groups)));
        items.extend(run_tables::members(runs));
    }
    let mut comparison = Vec::new();
    add(&mut comparison, seeds::errors(groups));
    add(&mut comparison, seeds::convergence(groups));
    let regret = seeds::regret(groups);
    if regret.is_empty() {
        comparison.push(Item::Missing(
            "No regret: the optimum was not known. `coordinator exhaust EXPERIMENT.toml` finds it; runs that end after it \
             say how far they are from it."
                .to_owned(),
        ));
    } else {
        add(&mut comparison, regret);
    }
    match run_tables::tests(groups) {
        Some(table) => comparison.push(Item::Table(table)),
        None => comparison.push(Item::Missing(
            "No test of differences: it takes two kinds of search on the same clouds, for example `[sweep.variants]` with \
             search.method \"ga\" and \"random\", and two runs of each."
                .to_owned(),
        )),
    }
    let count: usize = groups.iter().map(|group| group.members.len()).sum();
    let lead = format!("{count} runs of {} kinds.", groups.len());
    let sections = vec![
        Section { id: "verdict", title: "Verdict", items },
        Section { id: "comparison", title: "Over seeds", items: comparison },
    ];
    Page { title: title.to_owned(), lead, sections }
}
