//! What stands on the page of one run: the verdict, why, and last how to find it again.

use super::data::{Rows, RunData, percent};
use super::figures::{
    channels, comparison as compared, front, genes, lineage, on_cloud, perturbed, recognition, search, work,
};
use super::html::{Item, Page, Section, add};
use super::told::Told;
use super::{descriptor_tables, summary};
use crate::error::Error;

/// The page of a run.
pub(crate) fn page(data: &RunData, grid: Option<&Rows>, told: &Told) -> Result<Page, Error> {
    let (title, lead) = match &data.finished {
        Some(run) => (format!("{}, seed {}", run.row.name, run.row.seed), summary::lead(run)),
        None => {
            (data.label.clone(), "This run is unfinished: the report shows what is there so far.".to_owned())
        }
    };
    let sections = [
        Section { id: "verdict", title: "Verdict", items: verdict_items(data, told)? },
        Section { id: "descriptor", title: "The descriptor", items: descriptor_items(data, told) },
        Section { id: "recognition", title: "Wrong answers", items: recognition_items(data, told)? },
        Section { id: "search", title: "Search", items: search_items(data, grid)? },
        Section { id: "comparison", title: "Comparison in full", items: comparison_items(data)? },
        Section { id: "work", title: "Work", items: work_items(data)? },
        Section { id: "record", title: "Experiment and digests", items: record_items(data)? },
    ];
    let sections = sections.into_iter().filter(|section| !section.items.is_empty()).collect();
    Ok(Page { title, lead, sections })
}

const NO_COMPARISON: &str = "No comparison with other descriptors: `coordinator compare RUN` makes it, and with it the \
                             paper’s Table 1 and Figure 3, the times of each stage and which objects each descriptor gets \
                             wrong.";

fn verdict_items(data: &RunData, told: &Told) -> Result<Vec<Item>, Error> {
    let mut items = Vec::new();
    let Some(run) = &data.finished else {
        let generations = data.generations.as_ref().map_or(0, Rows::len);
        items.push(Item::Missing(format!(
            "None before the run has finished; generations so far: {generations}. `coordinator run` goes on with it."
        )));
        return Ok(items);
    };
    let sentences: Vec<String> = told.verdict.iter().cloned().chain(summary::regret(run)).collect();
    if !sentences.is_empty() {
        items.push(Item::Verdict(sentences));
    }
    match &data.comparison {
        Some(comparison) => items.push(Item::Table(descriptor_tables::verdict(&comparison.descriptors)?)),
        None => items.push(Item::Missing(NO_COMPARISON.to_owned())),
    }
    if let Some(front) = &data.front {
        items.push(Item::Table(descriptor_tables::front(front)?));
    }
    items.push(Item::Table(summary::errors(run)));
    if let Some(sets) = &data.sets {
        items.push(Item::Table(descriptor_tables::sets(sets)?));
    }
    Ok(items)
}

fn descriptor_items(data: &RunData, Told { channels, seen, not_seen, .. }: &Told) -> Vec<Item> {
    let mut items = Vec::new();
    let Some(run) = &data.finished else { return items };
    if channels.is_empty() {
        items.push(Item::Table(summary::genes(run)));
    } else {
        items.push(Item::Table(channels::table(channels)));
        add(&mut items, channels::pairs(channels).told_elsewhere());
        add(&mut items, channels::bins(channels).told_elsewhere());
    }
    if let Some(seen) = seen {
        add(&mut items, on_cloud::regions(seen));
        items.push(Item::Table(on_cloud::table(seen)));
    }
    if let Some(reason) = not_seen {
        items.push(Item::Missing(format!("Where the winner looks is not drawn on a cloud: {reason}")));
    }
    items
}

fn recognition_items(data: &RunData, told: &Told) -> Result<Vec<Item>, Error> {
    let answers = data.predictions.as_ref().map(recognition::test_answers).transpose()?.unwrap_or_default();
    if answers.is_empty() {
        let missing =
            "No predictions on test clouds: they are made when the run has finished, if it has a test split.";
        return Ok(vec![Item::Missing(missing.to_owned())]);
    }
    let mut items = vec![Item::Table(recognition::frequent_confusions(&answers))];
    add(&mut items, recognition::confusion_of_objects(&answers));
    add(&mut items, recognition::confusion_of_categories(&answers));
    if !told.wrong.is_empty() {
        items.push(Item::Wrong(told.wrong.clone()));
    }
    items.extend(told.no_clouds.iter().cloned().map(Item::Missing));
    Ok(items)
}

fn search_items(data: &RunData, grid: Option<&Rows>) -> Result<Vec<Item>, Error> {
    let (Some(generations), Some(evaluations)) = (&data.generations, &data.evaluations) else {
        return Ok(vec![Item::Missing("No generation is complete yet.".to_owned())]);
    };
    let mut items = Vec::new();
    let counted = evaluations.counted()?;
    let default = match &data.comparison {
        Some(comparison) => descriptor_tables::default_error(&comparison.descriptors, counted)?.map(percent),
        None => None,
    };
    add(&mut items, search::convergence(generations, counted, data.finished.as_ref(), default)?);
    if let Some(points) = &data.front {
        add(&mut items, front::front(points)?);
    }
    add(&mut items, front::hypervolume(generations)?);
    add(&mut items, search::mutation(generations)?);
    add(&mut items, search::diversity(generations)?);
    add(&mut items, genes::trajectories(evaluations, generations)?);
    add(&mut items, genes::marginals(evaluations, grid)?);
    if let Some(run) = &data.finished
        && let Some(figure) = lineage::lineage(evaluations, run)?
    {
        add(&mut items, figure);
    }
    Ok(items)
}

fn comparison_items(data: &RunData) -> Result<Vec<Item>, Error> {
    let mut items = Vec::new();
    if let Some(comparison) = &data.comparison {
        let descriptors = &comparison.descriptors;
        let names = descriptors.texts("descriptor")?;
        items.push(Item::Table(descriptor_tables::table(descriptors)?));
        add(&mut items, compared::errors(descriptors)?.told_elsewhere());
        if let Some(pairs) = &comparison.pairs {
            items.push(Item::Table(descriptor_tables::pairs(pairs)?));
        }
        if let Some(points) = &comparison.recall_precision {
            add(&mut items, compared::recall_precision(points, &names)?);
        }
        if let Some(answers) = &comparison.answers {
            add(&mut items, compared::objects(answers, &names)?);
        }
        if let Some(rows) = &comparison.perturbed {
            add(&mut items, perturbed::errors(rows, &names)?);
        }
        match compared::times(descriptors)? {
            Some(figure) => {
                add(&mut items, figure.told_elsewhere());
                items.push(Item::Table(descriptor_tables::times(descriptors)?));
            }
            None => items.push(Item::Missing("The times of the descriptors were not measured.".to_owned())),
        }
    }
    if let Some(run) = &data.finished {
        items.push(summary::looks(data.looks.as_ref(), run.row.test.is_some())?);
    }
    Ok(items)
}

fn work_items(data: &RunData) -> Result<Vec<Item>, Error> {
    let mut items = Vec::new();
    if let (Some(evaluations), Some(generations)) = (&data.evaluations, &data.generations) {
        add(&mut items, work::generation_times(evaluations, generations)?);
    }
    match &data.attempts {
        Some(attempts) => add(&mut items, work::timeline(attempts)?),
        None => items.push(Item::Missing(
            "No attempts: everything was remembered, or the run has not ended in any way yet.".to_owned(),
        )),
    }
    items.extend(summary::happenings(data)?);
    Ok(items)
}

fn record_items(data: &RunData) -> Result<Vec<Item>, Error> {
    let mut items = vec![Item::Table(summary::overview(data)?)];
    if let Some(run) = &data.finished {
        let summary = "The resolved experiment (TOML)".to_owned();
        items.push(Item::Details { summary, text: run.row.resolved_toml.clone() });
    }
    Ok(items)
}
