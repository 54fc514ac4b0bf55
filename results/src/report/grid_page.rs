//! What stands on the page of an exhaustive search: the optimum, how rare it is, and what the space is like.

use std::path::Path;

use super::data::{Rows, percent};
use super::figures::grid as figures;
use super::html::{Item, Page, Section, add};
use super::table::TableBlock;
use crate::columns::GeneColumn;
use crate::error::Error;
use crate::grid::{FinishedGrid, read_grid};
use crate::table_name::TableName;

/// Best descriptors that are listed.
const MOST_BEST: usize = 20;
/// Points behind the best within which descriptors are counted.
const WITHIN: [f64; 4] = [1.0, 2.0, 5.0, 10.0];

/// The page of a grid folder.
pub(crate) fn page(folder: &Path) -> Result<Page, Error> {
    let grid = read_grid(folder)?;
    let table = |table: TableName| {
        let missing = || Error::NoFiles { folder: folder.join(table.as_str()), table };
        Rows::read(folder, table)?.ok_or_else(missing)
    };
    let (best, marginals, landscapes) =
        (table(TableName::Best)?, table(TableName::Marginals)?, table(TableName::Landscapes)?);
    let genes = best.genes();
    let mut verdict = vec![Item::Verdict(sentences(&grid)), Item::Table(rarity(&grid))];
    verdict.push(Item::Table(best_descriptors(&grid, &genes)));
    let wrong = |correct: u32| percent(f64::from(grid.row.queries - correct) / f64::from(grid.row.queries));
    let errors: Vec<f64> =
        grid.counts.iter().map(|count| wrong(count.object_correct.min(grid.row.queries))).collect();
    let descriptors: Vec<f64> = grid.counts.iter().map(|count| count.descriptors as f64).collect();
    add(&mut verdict, figures::counts(&errors, &descriptors));
    let mut space = Vec::new();
    add(&mut space, figures::marginals(&marginals, &genes)?);
    add(&mut space, figures::landscapes(&landscapes, &genes, true)?);
    add(&mut space, figures::landscapes(&landscapes, &genes, false)?);
    let sections = vec![
        Section { id: "verdict", title: "The optimum", items: verdict },
        Section { id: "space", title: "The search space", items: space },
        Section { id: "record", title: "Search space and digests", items: record(&grid) },
    ];
    let lead = format!(
        "Every descriptor of a search space on the training clouds: {} descriptors in {} cells.",
        grid.row.descriptors, grid.row.cells
    );
    Ok(Page { title: format!("{}, exhaustive search", grid.row.name), lead, sections })
}

fn share_text(count: u64, of: u64) -> String {
    match percent(count as f64 / of.max(1) as f64) {
        share if share >= 0.01 => format!("{share:.2} %"),
        _ => format!("1 in {:.0}", of as f64 / count.max(1) as f64),
    }
}

/// The error of so many right answers, percent.
fn error(grid: &FinishedGrid, correct: u32) -> f64 {
    percent(1.0 - f64::from(correct) / f64::from(grid.row.queries.max(1)))
}

/// How many descriptors have at most that error.
fn at_most(grid: &FinishedGrid, most: f64) -> u64 {
    // Counts of clouds are far further apart than what arithmetic rounds away.
    let counts = grid.counts.iter().filter(|count| error(grid, count.object_correct) <= most + 1e-9);
    counts.map(|count| count.descriptors).sum()
}

fn sentences(grid: &FinishedGrid) -> Vec<String> {
    let row = &grid.row;
    let best = error(grid, row.best_object_correct);
    let wrong = row.queries.saturating_sub(row.best_object_correct);
    let near = at_most(grid, best + 1.0);
    vec![
        format!(
            "{best:.2} % of clouds wrong ({wrong} of {}) is the least that a descriptor of this space has in training",
            row.queries
        ),
        format!(
            "{} of {} descriptors are as good ({}); {near} are within 1 point of it ({})",
            row.optimal_descriptors,
            row.descriptors,
            share_text(row.optimal_descriptors, row.descriptors),
            share_text(near, row.descriptors)
        ),
    ]
}

/// How many descriptors are how good.
fn rarity(grid: &FinishedGrid) -> TableBlock {
    let best = error(grid, grid.row.best_object_correct);
    let row = |(name, most): (String, f64)| {
        let count = at_most(grid, most);
        vec![name, format!("{most:.2}"), count.to_string(), share_text(count, grid.row.descriptors)]
    };
    let within = WITHIN.map(|points| (format!("within {points:.0} points"), best + points));
    TableBlock {
        caption: "How rare good descriptors are.".to_owned(),
        head: ["descriptors", "error of at most, %", "number", "share"].map(str::to_owned).to_vec(),
        rows: std::iter::once(("as good as the best".to_owned(), best)).chain(within).map(row).collect(),
        texts: 1,
    }
}

fn best_descriptors(grid: &FinishedGrid, genes: &[GeneColumn]) -> TableBlock {
    let head = std::iter::once("rank".to_owned());
    let gene = |gene: &GeneColumn| match gene.unit.as_str() {
        "" => gene.name.clone(),
        unit => format!("{} ({unit})", gene.name),
    };
    let last = ["error, %", "wrong clouds"].map(str::to_owned);
    let rows = grid.best.iter().take(MOST_BEST).map(|best| {
        let mut cells = vec![best.rank.to_string()];
        let value = |value: &Option<f64>| value.map_or_else(|| "–".to_owned(), |value| value.to_string());
        cells.extend(best.genes.iter().map(value));
        cells.push(format!("{:.2}", error(grid, best.object_correct)));
        cells.push(grid.row.queries.saturating_sub(best.object_correct).to_string());
        cells
    });
    TableBlock {
        caption: format!(
            "The best descriptors; those that are equally good in the order of their genes. Table best has {}.",
            grid.best.len()
        ),
        head: head.chain(genes.iter().map(gene)).chain(last).collect(),
        rows: rows.collect(),
        texts: 0,
    }
}

fn record(grid: &FinishedGrid) -> Vec<Item> {
    let row = &grid.row;
    let cells = [
        ("experiment", row.name.clone()),
        ("evaluation version", row.evaluation_version.to_string()),
        ("time since the last start", format!("{:.1} s", row.seconds)),
        ("clouds digest", row.train_digest.clone()),
        ("grid key", row.grid_key.clone()),
        ("grid digest", row.grid_digest.clone()),
    ];
    let table = TableBlock {
        caption: "The grid.".to_owned(),
        head: Vec::new(),
        rows: cells.map(|(name, value)| vec![name.to_owned(), value]).to_vec(),
        texts: 2,
    };
    let summary = "The search space (TOML)".to_owned();
    vec![Item::Table(table), Item::Details { summary, text: row.search_space.clone() }]
}
