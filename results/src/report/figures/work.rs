//! Timeline of the workers, and time of each generation.

use std::collections::BTreeMap;

use super::{generations_axis, panel, zip};
use crate::error::Error;
use crate::report::data::Rows;
use crate::report::figure::{Axis, Colour, Dash, Figure, Panel, Series};

/// Most workers of a timeline.
const MOST_WORKERS: usize = 60;
/// Steps of the time axis: attempts that are closer become one bar, as nobody could tell them apart.
const STEPS: f64 = 560.0;

/// Time of each generation, by what it was spent on.
pub(crate) fn generation_times(evaluations: &Rows, generations: &Rows) -> Result<Figure, Error> {
    let x = generations.numbers("generation")?;
    let wall = generations.numbers("seconds")?;
    let of_row = evaluations.numbers("generation")?;
    // Sum and number of the values of each generation.
    let sums = |column: &str| -> Result<Vec<(f64, u32)>, Error> {
        let mut sums: BTreeMap<u64, (f64, u32)> = BTreeMap::new();
        for (&generation, value) in of_row.iter().zip(evaluations.optional(column)?) {
            if let Some(value) = value {
                let (sum, count) = sums.entry(generation as u64).or_default();
                *sum += value;
                *count += 1;
            }
        }
        Ok(x.iter().map(|&generation| sums.get(&(generation as u64)).copied().unwrap_or_default()).collect())
    };
    let run: Vec<f64> = sums("run_seconds")?.into_iter().map(|(sum, _)| sum).collect();
    let queued: Vec<f64> =
        sums("queued_seconds")?.into_iter().map(|(sum, count)| sum / f64::from(count.max(1))).collect();
    let series = vec![
        Series::line("wall time", Colour::Black, zip(&x, &wall).collect()),
        Series::dashed("evaluating, all workers", Colour::Blue, Dash::Dashed, zip(&x, &run).collect()),
        Series::dashed(
            "waiting for a worker, mean of the jobs",
            Colour::Orange,
            Dash::Dotted,
            zip(&x, &queued).collect(),
        ),
    ];
    let caption = "Wall time of each generation; the time that workers evaluated its individuals, in sum; and the \
                   time that an individual waited for a worker, in the mean. What was remembered takes none.";
    let panel = panel(generations_axis(), Axis::numbers("time", "s").including(0.0), series);
    Ok(Figure::single("generation-times", "Time of each generation", caption, panel))
}

/// A bar for each worker and span of time in which it had a job.
pub(crate) fn timeline(attempts: &Rows) -> Result<Figure, Error> {
    let (begun, ended) = (attempts.seconds("handed_out_at")?, attempts.seconds("ended_at")?);
    let (worker, end) = (attempts.texts("worker")?, attempts.texts("end")?);
    let first = begun.iter().flatten().copied().fold(f64::INFINITY, f64::min);
    let mut spans: BTreeMap<(&str, End), Vec<[f64; 2]>> = BTreeMap::new();
    let mut busy: BTreeMap<&str, f64> = BTreeMap::new();
    let mut length: f64 = 0.0;
    for row in 0..attempts.len() {
        let (Some(from), Some(to)) = (begun[row], ended[row]) else { continue };
        // A clock that was set back ends things before they begin.
        let span = [from - first, to.max(from) - first];
        length = length.max(span[1]);
        *busy.entry(&worker[row]).or_default() += span[1] - span[0];
        spans.entry((&worker[row], End::of(&end[row]))).or_default().push(span);
    }
    let mut shown: Vec<&str> = busy.keys().copied().collect();
    shown.sort_by(|a, b| busy[b].total_cmp(&busy[a]).then(a.cmp(b)));
    shown.truncate(MOST_WORKERS);
    shown.sort_unstable();
    let place: BTreeMap<&str, usize> = shown.iter().enumerate().map(|(place, &name)| (name, place)).collect();
    let mut bars: BTreeMap<End, Vec<[[f64; 2]; 2]>> = BTreeMap::new();
    let (mut drawn, mut met) = (0, 0);
    for ((worker, end), spans) in spans {
        let Some(&row) = place.get(worker) else { continue };
        met += spans.len();
        let merged = merge(spans, length / STEPS);
        drawn += merged.len();
        let bar = |[from, to]: [f64; 2]| [[from, row as f64], [to, row as f64]];
        bars.entry(end).or_default().extend(merged.into_iter().map(bar));
    }
    let mut caption = String::from("When each worker had jobs in hand, by how they ended.");
    if busy.len() > shown.len() {
        caption.push_str(&format!(
            " Of {} workers, the {MOST_WORKERS} that were busy longest are shown.",
            busy.len()
        ));
    }
    if drawn < met {
        caption.push_str(&format!(
            " Attempts that lie close together share a bar: {met} attempts, {drawn} bars."
        ));
    }
    let bar_width = if shown.len() > 20 { 5 } else { 9 };
    let series =
        bars.into_iter().map(|(end, bars)| Series::segments(end.name(), end.colour(), bar_width, bars));
    let height = 130 + 16 * shown.len() as u32;
    let y = Axis::names("worker", shown.iter().map(|&name| name.to_owned()).collect());
    let x = Axis::numbers("time since the first job", "s").including(0.0);
    let panel = Panel { title: String::new(), x, y, series: series.collect(), height };
    Ok(Figure::single("timeline", "Timeline of the workers", caption, panel))
}

/// How an attempt ended, in the groups that the timeline tells apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum End {
    /// With an answer.
    Answered,
    /// With a second opinion.
    Compared,
    /// Because the job or the worker was taken back.
    Withdrawn,
    /// With a failure.
    Failed,
}

impl End {
    fn of(end: &str) -> Self {
        match end {
            "answered" => Self::Answered,
            "agreed" | "late" => Self::Compared,
            "revoked" | "left" | "dropped" | "undelivered" => Self::Withdrawn,
            _ => Self::Failed,
        }
    }

    fn name(self) -> &'static str {
        match self {
            Self::Answered => "answered",
            Self::Compared => "agreed with an earlier answer, or came late",
            Self::Withdrawn => "handed back or dropped",
            Self::Failed => "failed, overdue, lost or wrong",
        }
    }

    fn colour(self) -> Colour {
        match self {
            Self::Answered => Colour::Blue,
            Self::Compared => Colour::Sky,
            Self::Withdrawn => Colour::Orange,
            Self::Failed => Colour::Vermillion,
        }
    }
}

/// Spans in order, those less than `gap` apart as one, each at least `gap` long so that it is seen.
fn merge(mut spans: Vec<[f64; 2]>, gap: f64) -> Vec<[f64; 2]> {
    spans.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let mut merged: Vec<[f64; 2]> = Vec::new();
    for [from, to] in spans {
        let to = to.max(from + gap);
        match merged.last_mut() {
            Some(last) if from - last[1] < gap => last[1] = last[1].max(to),
            _ => merged.push([from, to]),
        }
    }
    merged
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn merged_spans_cover_the_same_time_with_few_bars() {
        assert_eq!(merge(vec![[5.0, 6.0], [0.0, 1.0], [0.5, 3.0]], 0.5), [[0.0, 3.0], [5.0, 6.0]]);
        // A span that would not be seen is as long as what can be.
        assert_eq!(merge(vec![[1.0, 1.0]], 0.5), [[1.0, 1.5]]);
        let many: Vec<[f64; 2]> = (0..100_000).map(|n| [f64::from(n), f64::from(n) + 0.3]).collect();
        let merged = merge(many.clone(), 100_000.0 / STEPS);
        assert!(merged.len() <= STEPS as usize, "{}", merged.len());
        assert!(many.iter().all(|span| merged.iter().any(|bar| bar[0] <= span[0] && span[1] <= bar[1])));
        assert!(merge(Vec::new(), 1.0).is_empty());
    }
}
