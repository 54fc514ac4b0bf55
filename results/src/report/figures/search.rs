//! How the search went: errors, mutation rate and diversity from generation to generation.

use super::{generations_axis, panel, zip};
use crate::error::Error;
use crate::read::FinishedRun;
use crate::report::data::{Rows, percent};
use crate::report::figure::{Axis, Colour, Dash, Figure, Series, Symbol};

/// Errors of each generation's best, mean and worst, of the best so far, and of validation, of what was
/// [counted](Rows::counted). `default`: the error that the descriptor which anybody has makes on the test clouds, percent.
pub(crate) fn convergence(
    generations: &Rows,
    counted: &str,
    finished: Option<&FinishedRun>,
    default: Option<f64>,
) -> Result<Figure, Error> {
    let x = generations.numbers("generation")?;
    let error = |column: &str| -> Result<Vec<f64>, Error> {
        Ok(generations.numbers(column)?.into_iter().map(|fitness| percent(1.0 - fitness)).collect())
    };
    let [best, mean, worst] = [error("best_fitness")?, error("mean_fitness")?, error("worst_fitness")?];
    let so_far: Vec<[f64; 2]> = zip(&x, &error("best_so_far_fitness")?).collect();
    let validation: Vec<f64> =
        generations.numbers(&format!("validation_{counted}_error"))?.into_iter().map(percent).collect();
    let validation: Vec<[f64; 2]> = zip(&x, &validation).collect();
    let all = x.iter().zip(best.iter().zip(&worst)).map(|(&x, (&best, &worst))| [x, best, worst]);
    // What matters lies between what was reached and what was there before; what individuals are like in the beginning
    // would only make that small.
    let mut seen: Vec<f64> = so_far.iter().chain(&validation).map(|point| point[1]).collect();
    seen.extend(&mean[mean.len() / 2..]);
    let mut series = vec![
        Series::band("training: best to worst individual", Colour::Sky, all.collect()),
        Series::dashed("training: mean", Colour::Blue, Dash::Dashed, zip(&x, &mean).collect()),
        Series::steps("training: best so far", Colour::Blue, Dash::Solid, so_far),
        Series::dashed("validation", Colour::Vermillion, Dash::Dotted, validation.clone()),
        Series::points("", Colour::Vermillion, Symbol::Dot, validation.clone()),
    ];
    let mut caption = format!(
        "Error of {counted} recognition in each generation: of the training clouds for all individuals"
    );
    caption.push_str(if validation.is_empty() {
        "; validation was not measured."
    } else {
        ", of the validation clouds for each generation's best."
    });
    let across = |y: f64| match x.as_slice() {
        [first, .., last] => vec![[*first, y], [*last, y]],
        _ => Vec::new(),
    };
    if let Some(run) = finished {
        let winner = f64::from(run.row.winner_generation);
        let error = percent(run.row.errors(run.row.train).share());
        series.push(Series::points("winner", Colour::Black, Symbol::Triangle, vec![[winner, error]]));
        seen.push(error);
        if let Some(best) = run.row.grid_best_object_correct {
            let optimum = percent(1.0 - f64::from(best) / f64::from(run.row.train.queries));
            seen.push(optimum);
            series.push(Series::dashed(
                "optimum of the search space, training",
                Colour::Green,
                Dash::Mixed,
                across(optimum),
            ));
        }
        if let Some(test) = run.row.test {
            let error = percent(run.row.errors(test).share());
            seen.push(error);
            let asked = match run.row.weighted_train {
                Some(_) => "winner on the test clouds, weighed",
                None => "winner on the test clouds",
            };
            series.push(Series::dashed(asked, Colour::Black, Dash::Solid, across(error)));
        }
    }
    if let Some(default) = default {
        seen.push(default);
        series.push(Series::dashed(
            "default (the paper’s) on the test clouds",
            Colour::Orange,
            Dash::Dashed,
            across(default),
        ));
    }
    let ends =
        seen.into_iter().filter(|value| value.is_finite()).fold(None, |ends: Option<[f64; 2]>, value| {
            Some(ends.map_or([value; 2], |[low, high]| [low.min(value), high.max(value)]))
        });
    let ends = ends.unwrap_or([0.0, 1.0]);
    let highest = worst.iter().copied().filter(|error| error.is_finite()).fold(0.0, f64::max);
    if highest > ends[1] {
        caption.push_str(&format!(" Individuals beyond the axis, up to {highest:.1} %, are cut off."));
    }
    let y = Axis::within(&format!("{counted} error"), "% of clouds", ends);
    Ok(Figure::single("convergence", "Convergence", caption, panel(generations_axis(), y, series)))
}

/// The probability of a mutation from generation to generation.
pub(crate) fn mutation(generations: &Rows) -> Result<Figure, Error> {
    let x = generations.numbers("generation")?;
    let rates: Vec<[f64; 2]> = zip(&x, &generations.numbers("mutation_rate")?).collect();
    let y = Axis::numbers("mutation rate", "probability").including(0.0);
    let panel = panel(generations_axis(), y, vec![Series::line("", Colour::Blue, rates)]);
    let caption = "Probability that a bit between the two mutation points of a child flips; with mutation by field, that a \
                   gene changes.";
    Ok(Figure::single("mutation", "Mutation schedule", caption, panel))
}

/// How much the individuals of each generation differ.
pub(crate) fn diversity(generations: &Rows) -> Result<Figure, Error> {
    let x = generations.numbers("generation")?;
    let diversity: Vec<f64> = generations.numbers("diversity")?.into_iter().map(percent).collect();
    let y = Axis::numbers("mean Hamming distance", "% of bits").including(0.0);
    let panel =
        panel(generations_axis(), y, vec![Series::line("", Colour::Blue, zip(&x, &diversity).collect())]);
    let caption = "Mean Hamming distance of all pairs of chromosomes of a generation; 50 % is what independent \
                   random bits have, 0 % is a population of copies.";
    Ok(Figure::single("diversity", "Diversity", caption, panel))
}
