//! Several seeds: how results are distributed, and how fast searches get there.

use super::{error_axis, quantile};
use crate::report::figure::{Axis, Colour, Dash, Figure, Numbers, Panel, Series, Symbol};
use crate::report::runs::{Group, Member};

/// Share of its evaluations after which a search is past its beginning.
const SETTLED: f64 = 0.03;
/// Points of a convergence curve.
const STEPS: usize = 300;

/// Errors of the winners on the test clouds and in training, one row per group.
pub(crate) fn errors(groups: &[Group]) -> Figure {
    let panels = vec![
        spread(groups, "test error of the winner", Member::test_error),
        spread(groups, "training error of the winner", |member| Some(member.training_error())),
    ];
    Figure {
        id: "seeds-errors".to_owned(),
        title: "Errors over seeds".to_owned(),
        caption:
            "Each point is the winner of one run; the box holds the middle half of the runs, the line is the \
                  median."
                .to_owned(),
        panels,
        columns: 1,
        numbers: Numbers::Below,
    }
}

/// How far the winners are from the best descriptor there is.
pub(crate) fn regret(groups: &[Group]) -> Figure {
    let mut panel = spread(groups, "regret in training", Member::regret);
    panel.x = panel.x.including(0.0);
    let caption = "Training error of each run’s winner minus that of the best descriptor of the whole search space, where \
                   an exhaustive search has found it.";
    Figure::single("seeds-regret", "Regret over seeds", caption, panel)
}

/// Points, box and median of each group.
fn spread(groups: &[Group], label: &str, of: impl Fn(&Member) -> Option<f64>) -> Panel {
    let (mut points, mut boxes, mut medians) = (Vec::new(), Vec::new(), Vec::new());
    for (row, group) in groups.iter().enumerate() {
        let row = row as f64;
        let mut values: Vec<f64> = group.members.iter().filter_map(&of).collect();
        values.sort_by(f64::total_cmp);
        // Equal values lie one below the other instead of hiding each other.
        points.extend(
            values.iter().enumerate().map(|(index, &value)| [value, row + 0.14 * ((index % 5) as f64 - 2.0)]),
        );
        if let [Some(low), Some(middle), Some(high)] = [0.25, 0.5, 0.75].map(|share| quantile(&values, share))
        {
            boxes.push([[low, row], [high, row]]);
            medians.push([[middle, row - 0.3], [middle, row + 0.3]]);
        }
    }
    let series = vec![
        Series::segments("middle half of the runs", Colour::Sky, 26, boxes),
        Series::segments("median", Colour::Black, 2, medians),
        Series::points("a run", Colour::Vermillion, Symbol::Circle, points),
    ];
    let y = Axis::names("", groups.iter().map(|group| group.name.clone()).collect());
    let height = 90 + 52 * groups.len() as u32;
    Panel { title: String::new(), x: error_axis(label), y, series, height }
}

/// The best training error over the number of evaluations, one curve with a band per group.
pub(crate) fn convergence(groups: &[Group]) -> Figure {
    let mut series = Vec::new();
    let mut ends = [f64::INFINITY, f64::NEG_INFINITY];
    for (index, group) in groups.iter().enumerate() {
        let most = group.members.iter().map(|member| member.best.len()).max().unwrap_or(0);
        let curve: Vec<[f64; 4]> =
            places(most).into_iter().filter_map(|at| at_evaluations(group, at)).collect();
        // The first descriptors are drawn at random: how bad they are would make all else small.
        let settled = curve.iter().skip_while(|[at, ..]| *at < SETTLED * most as f64);
        ends =
            settled.fold(ends, |[lowest, highest], [_, low, _, high]| [lowest.min(*low), highest.max(*high)]);
        let (colour, dash) = (Colour::nth(index), Dash::nth(index));
        series.push(Series::band(
            "",
            colour,
            curve.iter().map(|&[x, low, _, high]| [x, low, high]).collect(),
        ));
        series.push(Series::dashed(
            &group.name,
            colour,
            dash,
            curve.iter().map(|&[x, _, middle, _]| [x, middle]).collect(),
        ));
    }
    let x = Axis::numbers("different descriptors evaluated", "").including(0.0);
    let caption = "The lowest training error so far over the number of different descriptors that a run has evaluated: \
                   median of the runs, and their middle half. A run that has ended keeps its result. What the first \
                   descriptors had is cut off.";
    let ends = if ends[0] <= ends[1] { ends } else { [0.0, 1.0] };
    let y = Axis::within("training error", "% of clouds", ends);
    let panel = Panel { title: String::new(), x, y, series, height: 360 };
    Figure::single("seeds-convergence", "Convergence over seeds", caption, panel)
}

/// Number of evaluations with the quartiles of what the runs of a group have reached by then.
fn at_evaluations(group: &Group, evaluations: usize) -> Option<[f64; 4]> {
    let mut reached: Vec<f64> =
        group.members.iter().filter_map(|member| member.best_after(evaluations)).collect();
    reached.sort_by(f64::total_cmp);
    let at = |share| quantile(&reached, share);
    Some([evaluations as f64, at(0.25)?, at(0.5)?, at(0.75)?])
}

/// Numbers of evaluations to look at: all, or evenly spread ones with the last.
fn places(most: usize) -> Vec<usize> {
    let step = most.div_ceil(STEPS).max(1);
    let mut places: Vec<usize> = (1..=most).step_by(step).collect();
    if places.last().is_some_and(|&last| last < most) {
        places.push(most);
    }
    places
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_begin_with_the_first_and_end_with_the_last_evaluation() {
        assert!(places(0).is_empty());
        assert_eq!(places(3), [1, 2, 3]);
        for most in [300, 301, 1999, 100_000] {
            let places = places(most);
            assert_eq!((places[0], *places.last().unwrap()), (1, most));
            assert!(places.len() <= STEPS + 1, "{most}: {}", places.len());
            assert!(places.is_sorted_by(|a, b| a < b));
        }
    }
}
