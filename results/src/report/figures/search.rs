//! How the search went: errors, mutation rate and diversity from generation to generation.

use super::{error_axis, generations_axis, panel, zip};
use crate::error::Error;
use crate::read::FinishedRun;
use crate::report::data::{Rows, percent};
use crate::report::figure::{Axis, Colour, Dash, Figure, Series, Symbol};

/// Errors of each generation's best, mean and worst, of the best so far, and of validation.
pub(crate) fn convergence(generations: &Rows, finished: Option<&FinishedRun>) -> Result<Figure, Error> {
    let x = generations.numbers("generation")?;
    let error = |column: &str| -> Result<Vec<f64>, Error> {
        Ok(generations.numbers(column)?.into_iter().map(|fitness| percent(1.0 - fitness)).collect())
    };
    let [best, mean, worst] = [error("best_fitness")?, error("mean_fitness")?, error("worst_fitness")?];
    let so_far: Vec<[f64; 2]> = zip(&x, &error("best_so_far_fitness")?).collect();
    let validation: Vec<f64> =
        generations.numbers("validation_object_error")?.into_iter().map(percent).collect();
    let validation: Vec<[f64; 2]> = zip(&x, &validation).collect();
    let all = x.iter().zip(best.iter().zip(&worst)).map(|(&x, (&best, &worst))| [x, best, worst]);
    let mut series = vec![
        Series::band("training: best to worst individual", Colour::Sky, all.collect()),
        Series::dashed("training: mean", Colour::Blue, Dash::Dashed, zip(&x, &mean).collect()),
        Series::steps("training: best so far", Colour::Blue, Dash::Solid, &so_far),
        Series::dashed("validation", Colour::Vermillion, Dash::Dotted, validation.clone()),
        Series::points("", Colour::Vermillion, Symbol::Dot, validation.clone()),
    ];
    let mut caption = String::from(
        "Error of object recognition in each generation: of the training clouds for all individuals",
    );
    caption.push_str(if validation.is_empty() {
        "; validation was not measured."
    } else {
        ", of the validation clouds for each generation's best."
    });
    if let Some(run) = finished {
        let winner = f64::from(run.row.winner_generation);
        let error = percent(run.row.train.object_error());
        series.push(Series::points("winner", Colour::Black, Symbol::Triangle, vec![[winner, error]]));
        if let (Some(best), [first, .., last]) = (run.row.grid_best_object_correct, x.as_slice()) {
            let queries = f64::from(run.row.train.queries);
            let optimum = percent(1.0 - f64::from(best) / queries);
            let ends = vec![[*first, optimum], [*last, optimum]];
            series.push(Series::dashed("optimum of the search space", Colour::Green, Dash::Mixed, ends));
        }
    }
    let panel = panel(generations_axis(), error_axis("object error"), series);
    Ok(Figure::single("convergence", "Convergence", caption, panel))
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
