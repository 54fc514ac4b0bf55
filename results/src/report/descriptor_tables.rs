//! Descriptors beside each other in tables: the paper's Table 1, and how sure their differences are.

use super::data::Rows;
use super::figures::comparison::STAGES;
use super::run_tables::p_text;
use super::summary::interval_text;
use super::table::TableBlock;
use crate::error::Error;

/// Points of the front that are shown.
const MOST_POINTS: usize = 20;
/// Rows of pairs that are shown.
const MOST_PAIRS: usize = 100;

fn seconds_text(seconds: Option<f64>) -> String {
    seconds.map_or_else(|| "–".to_owned(), |seconds| format!("{seconds:.2}"))
}

fn size_text(size: String) -> String {
    if size.is_empty() { "–".to_owned() } else { size }
}

/// Label of the run's own descriptor, with a recogniser's name after it where that is not the nearest cloud.
const WINNER: &str = "evolved";
/// Label of the descriptor that the paper ended with.
const DEFAULT: &str = "paper";
/// What labels of points of the run's front begin with.
const POINT: &str = "point-";

/// What a descriptor of a comparison is, in the order of the verdict.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Role {
    Winner,
    Default,
    Baseline,
    Front,
}

impl Role {
    fn of(label: &str) -> Self {
        let is = |name: &str| {
            label.strip_prefix(name).is_some_and(|rest| rest.is_empty() || rest.starts_with('-'))
        };
        if is(WINNER) {
            Self::Winner
        } else if is(DEFAULT) {
            Self::Default
        } else if label.strip_prefix(POINT).is_some_and(|rest| rest.starts_with(|c: char| c.is_ascii_digit()))
        {
            Self::Front
        } else {
            Self::Baseline
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Winner => "winner",
            Self::Default => "default",
            Self::Baseline => "baseline",
            Self::Front => "front",
        }
    }
}

/// The error of the descriptor that anybody has, of what was [counted](Rows::counted); `None` if it was not compared.
pub(crate) fn default_error(comparison: &Rows, counted: &str) -> Result<Option<f64>, Error> {
    let place = comparison.texts("descriptor")?.iter().position(|name| name == DEFAULT);
    let errors = comparison.numbers(&format!("{counted}_error"))?;
    Ok(place.map(|place| errors[place]))
}

/// The winner beside what it is to be better than.
pub(crate) fn verdict(comparison: &Rows) -> Result<TableBlock, Error> {
    let names = comparison.texts("descriptor")?;
    let distances = comparison.texts("distance")?;
    let sizes = comparison.texts("cloud_size")?;
    let milliseconds = milliseconds(comparison)?;
    let number = |name: &str| comparison.numbers(name);
    let levels = ["object", "category"].map(|level| -> Result<_, Error> {
        let column = |name: &str| number(&format!("{level}_error{name}"));
        Ok([column("")?, column("_instances_low")?, column("_instances_high")?])
    });
    let [object, category] = levels;
    let levels = [object?, category?];
    let row = |row: usize| {
        let mut cells = vec![names[row].clone(), Role::of(&names[row]).name().to_owned()];
        for [error, low, high] in &levels {
            cells.push(format!("{:.2}", 100.0 * error[row]));
            cells.push(interval_text([low[row], high[row]]));
        }
        cells.push(size_text(sizes[row].clone()));
        cells.push(milliseconds[row].map_or_else(|| "–".to_owned(), |time| format!("{time:.1}")));
        cells
    };
    let mut places: Vec<usize> = (0..names.len()).filter(|&row| distances[row] != "l1").collect();
    places.sort_by_key(|&row| Role::of(&names[row])); // stable: otherwise as compared
    let head = [
        "descriptor",
        "",
        "object error, %",
        "95 %",
        "category error, %",
        "95 %",
        "values a cloud",
        "time a cloud, ms",
    ];
    Ok(TableBlock {
        caption: "The winner beside the default, which is the paper’s descriptor, baselines and points of its front: errors \
                  on the test clouds with 95 % intervals of the bootstrap over objects, values kept of a cloud, and the \
                  time from its points to these on one thread."
            .to_owned(),
        head: head.map(str::to_owned).to_vec(),
        rows: places.into_iter().map(row).collect(),
        texts: 2,
    })
}

/// Errors of the winner and its baselines on the test clouds of each set.
pub(crate) fn sets(sets: &Rows) -> Result<TableBlock, Error> {
    let [names, labels, weights, queries] =
        ["set", "descriptor", "weight", "queries"].map(|column| sets.texts(column));
    let (names, labels, weights, queries) = (names?, labels?, weights?, queries?);
    let levels = ["object", "category"].map(|level| -> Result<_, Error> {
        let column = |end: &str| sets.numbers(&format!("{level}_error{end}"));
        Ok([column("")?, column("_low")?, column("_high")?])
    });
    let [object, category] = levels;
    let levels = [object?, category?];
    let row = |row: usize| {
        let weight = if weights[row] == "0" { "not seen".to_owned() } else { weights[row].clone() };
        let mut cells = vec![names[row].clone(), labels[row].clone(), weight];
        for [error, low, high] in &levels {
            cells.push(format!("{:.2}", 100.0 * error[row]));
            cells.push(interval_text([low[row], high[row]]));
        }
        cells.push(queries[row].clone());
        cells
    };
    // Set by set: descriptors are compared where clouds are.
    let first = |row: usize| names.iter().position(|name| *name == names[row]);
    let mut places: Vec<usize> = (0..sets.len()).collect();
    places.sort_by_key(|&row| first(row)); // stable: otherwise as written
    let head =
        ["set", "descriptor", "weight", "object error, %", "95 %", "category error, %", "95 %", "clouds"];
    Ok(TableBlock {
        caption: "Errors on the test clouds of each set, which are compared with clouds of their own set only, with 95 % \
                  intervals (Wilson’s score, as if clouds were independent), and the set’s weight in the fitness."
            .to_owned(),
        head: head.map(str::to_owned).to_vec(),
        rows: places.into_iter().map(row).collect(),
        texts: 2,
    })
}

/// The points of a run's front, whose errors are those of the clouds that the search has seen.
pub(crate) fn front(front: &Rows) -> Result<TableBlock, Error> {
    let (points, sizes) = (front.texts("point")?, front.texts("size")?);
    let counted = front.counted()?;
    let train = front.numbers(&format!("train_{counted}_error"))?;
    let validation = front.optional(&format!("validation_{counted}_error"))?;
    let (cost, winner) = (front.numbers("cost")?, front.numbers("winner")?);
    let error = |error: f64| format!("{:.2}", 100.0 * error);
    let row = |row: usize| {
        vec![
            format!("{POINT}{}", points[row]),
            if winner[row] > 0.0 { "winner" } else { "" }.to_owned(),
            error(train[row]),
            validation[row].map_or_else(|| "–".to_owned(), error),
            sizes[row].clone(),
            format!("{:.0}", cost[row] / 1000.0),
        ]
    };
    let every = front.len().div_ceil(MOST_POINTS).max(1);
    let rows: Vec<Vec<String>> =
        (0..front.len()).filter(|&row| row % every == 0 || winner[row] > 0.0).map(row).collect();
    let more = match rows.len() {
        shown if shown < front.len() => format!(" {shown} of {} points, evenly chosen.", front.len()),
        _ => String::new(),
    };
    let head = [
        "front",
        "",
        "training error, %",
        "validation error, %",
        "values a cloud",
        "counted cost, thousands",
    ];
    Ok(TableBlock {
        caption: format!(
            "The front: descriptors of which none is better than another in all objectives. `coordinator compare` with \
             --point measures them on the test clouds.{more}"
        ),
        head: head.map(str::to_owned).to_vec(),
        rows,
        texts: 2,
    })
}

/// Time to describe a cloud, where it was measured: the median of some, as at the end of a run, or else the mean of all.
fn milliseconds(comparison: &Rows) -> Result<Vec<Option<f64>>, Error> {
    let stages =
        ["keypoints", "normals", "describe"].map(|stage| comparison.optional(&format!("seconds_{stage}")));
    let [keypoints, normals, describe] = stages;
    let (keypoints, normals, describe) = (keypoints?, normals?, describe?);
    let (queries, database) = (comparison.numbers("queries")?, comparison.numbers("database")?);
    let some = comparison.optional("seconds_cloud")?;
    let of = |row: usize| {
        let all = Some((keypoints[row]? + normals[row]? + describe[row]?) / (queries[row] + database[row]));
        all.filter(|seconds| seconds.is_finite())
    };
    Ok((0..some.len()).map(|row| Some(1000.0 * some[row].or_else(|| of(row))?)).collect())
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
