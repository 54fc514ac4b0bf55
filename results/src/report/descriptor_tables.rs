//! Descriptors beside each other in tables: the paper's Table 1, and how sure their differences are.

use super::data::Rows;
use super::figures::comparison::STAGES;
use super::html::TableBlock;
use super::run_tables::p_text;
use super::summary::interval_text;
use crate::error::Error;

/// Rows of pairs that are shown.
const MOST_PAIRS: usize = 100;

fn seconds_text(seconds: Option<f64>) -> String {
    seconds.map_or_else(|| "–".to_owned(), |seconds| format!("{seconds:.2}"))
}

fn size_text(size: String) -> String {
    if size.is_empty() { "–".to_owned() } else { size }
}

/// The paper's Table 1: errors, times and sizes, one row per descriptor.
pub(crate) fn table(comparison: &Rows) -> Result<TableBlock, Error> {
    let names = comparison.texts("descriptor")?;
    let sizes = comparison.texts("size")?;
    let notes = comparison.texts("note")?;
    let queries = comparison.numbers("queries")?;
    let keypoints = comparison.optional("keypoints_per_cloud")?;
    let seconds = comparison.optional("seconds_total")?;
    let areas = [comparison.optional("area")?, comparison.optional("nearest_area")?];
    let mut rows: Vec<Vec<String>> =
        names.iter().zip(sizes).map(|(name, size)| vec![name.clone(), size_text(size)]).collect();
    for level in ["object", "category"] {
        let column = |name: &str| comparison.numbers(&format!("{level}_{name}"));
        let (errors, correct) = (column("error")?, column("correct")?);
        let (low, high) = (column("error_instances_low")?, column("error_instances_high")?);
        for (index, row) in rows.iter_mut().enumerate() {
            let wrong = queries[index] - correct[index];
            row.push(format!("{:.2} ({wrong})", 100.0 * errors[index]));
            row.push(interval_text([low[index], high[index]]));
        }
    }
    for (index, row) in rows.iter_mut().enumerate() {
        row.push(seconds_text(seconds[index]));
        row.push(keypoints[index].map_or_else(|| "–".to_owned(), |keypoints| format!("{keypoints:.1}")));
        for area in &areas {
            row.push(area[index].map_or_else(|| "–".to_owned(), |area| format!("{area:.3}")));
        }
    }
    let mut caption = String::from(
        "The paper’s Table 1 on this data set: object and category error on the test clouds in percent (wrong clouds), with \
         95 % intervals of the bootstrap over objects; size in real values; time to read, describe and match queries and \
         database on one thread; keypoints a cloud; area under the curves of recall over 1 − precision, all pairs and \
         nearest clouds.",
    );
    for (name, note) in names.iter().zip(notes).filter(|(_, note)| !note.is_empty()) {
        caption.push_str(&format!(" {name}: {note}."));
    }
    let head = [
        "descriptor",
        "size",
        "object error, %",
        "95 %",
        "category error, %",
        "95 %",
        "time, s",
        "keypoints",
        "area",
        "nearest",
    ];
    Ok(TableBlock { caption, head: head.map(str::to_owned).to_vec(), rows, texts: 1 })
}

/// Seconds of each stage, one row per descriptor.
pub(crate) fn times(comparison: &Rows) -> Result<TableBlock, Error> {
    let mut rows: Vec<Vec<String>> =
        comparison.texts("descriptor")?.into_iter().map(|name| vec![name]).collect();
    let mut head = vec!["descriptor".to_owned()];
    for (column, name) in
        STAGES.map(|(column, name, _)| (column, name)).into_iter().chain([("total", "in all")])
    {
        head.push(format!("{name}, s"));
        for (row, seconds) in rows.iter_mut().zip(comparison.optional(&format!("seconds_{column}"))?) {
            row.push(seconds_text(seconds));
        }
    }
    let caption = "The same in seconds; in all: wall time from the first read to the last match.".to_owned();
    Ok(TableBlock { caption, head, rows, texts: 1 })
}

/// Every pair of descriptors on the same clouds.
pub(crate) fn pairs(pairs: &Rows) -> Result<TableBlock, Error> {
    let text = |name: &str| pairs.texts(name);
    let (level, first, second) = (text("level")?, text("descriptor_a")?, text("descriptor_b")?);
    let (only_a, only_b) = (text("only_a")?, text("only_b")?);
    let number = |name: &str| pairs.numbers(name);
    let (difference, low, high) =
        (number("error_difference")?, number("difference_low")?, number("difference_high")?);
    let odds = pairs.optional("odds_ratio")?;
    let (p, adjusted) = (number("p_value")?, number("p_adjusted")?);
    let row = |row: usize| {
        vec![
            level[row].clone(),
            first[row].clone(),
            second[row].clone(),
            format!("{:+.2}", 100.0 * difference[row]).replace('-', "−"),
            format!("{:+.1} to {:+.1}", 100.0 * low[row], 100.0 * high[row]).replace('-', "−"),
            only_a[row].clone(),
            only_b[row].clone(),
            odds[row].map_or_else(|| "–".to_owned(), |odds| format!("{odds:.2}")),
            p_text(p[row]),
            p_text(adjusted[row]),
        ]
    };
    let shown = pairs.len().min(MOST_PAIRS);
    let more =
        if pairs.len() > shown { format!(" The first {shown} of {}.", pairs.len()) } else { String::new() };
    let head = [
        "level",
        "first",
        "second",
        "difference, %",
        "95 %",
        "only first",
        "only second",
        "odds",
        "p",
        "p (Holm)",
    ];
    Ok(TableBlock {
        caption: format!(
            "Every pair of descriptors on the same test clouds: error of the first minus error of the second with the 95 % \
             interval of the bootstrap over objects; clouds that only one of them recognises and their ratio; McNemar’s exact \
             test, and corrected for the number of pairs (Holm).{more}"
        ),
        head: head.map(str::to_owned).to_vec(),
        rows: (0..shown).map(row).collect(),
        texts: 3,
    })
}
