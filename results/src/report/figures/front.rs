//! The front of a search of several objectives, and how it grew.

use super::{error_axis, generations_axis, panel, zip};
use crate::error::Error;
use crate::report::data::{Rows, percent};
use crate::report::figure::{Axis, Colour, Figure, Numbers, Series, Symbol};

/// The points of a front: errors against counted cost, and against size.
pub(crate) fn front(front: &Rows) -> Result<Figure, Error> {
    let error = |column: &str| -> Result<Vec<f64>, Error> {
        Ok(front.numbers(column)?.into_iter().map(percent).collect())
    };
    let counted = front.counted()?;
    let (train, validation) =
        (error(&format!("train_{counted}_error"))?, error(&format!("validation_{counted}_error"))?);
    let winner = front.numbers("winner")?;
    let cost = front.numbers("cost")?.into_iter().map(|cost| cost / 1000.0).collect();
    let axes = [
        (Axis::numbers("counted cost", "thousands"), cost),
        (Axis::numbers("size", "values a cloud"), front.numbers("size")?),
    ];
    let of = |(x, values): (Axis, Vec<f64>)| {
        let of_winner = zip(&values, &train).zip(&winner).filter(|(_, winner)| **winner > 0.0);
        let series = vec![
            Series::points("training", Colour::Blue, Symbol::Circle, zip(&values, &train).collect()),
            Series::points(
                "validation",
                Colour::Vermillion,
                Symbol::Dot,
                zip(&values, &validation).collect(),
            ),
            Series::points(
                "winner",
                Colour::Black,
                Symbol::Triangle,
                of_winner.map(|(point, _)| point).collect(),
            ),
        ];
        panel(x.including(0.0), error_axis(&format!("{counted} error")).including(0.0), series)
    };
    let caption = "The descriptors of which none is better than another in all objectives, by their errors on training and \
                   validation clouds, their counted cost and their size.";
    Ok(Figure {
        id: "front".to_owned(),
        title: "Front".to_owned(),
        caption: caption.to_owned(),
        panels: axes.into_iter().map(of).collect(),
        columns: 2,
        numbers: Numbers::Below,
    })
}

/// The hypervolume of the front from generation to generation; nothing to draw of searches of one objective.
pub(crate) fn hypervolume(generations: &Rows) -> Result<Figure, Error> {
    let x = generations.numbers("generation")?;
    let shares: Vec<f64> = generations.numbers("hypervolume")?.into_iter().map(percent).collect();
    let y = Axis::numbers("hypervolume", "%");
    let panel =
        panel(generations_axis(), y, vec![Series::line("", Colour::Blue, zip(&x, &shares).collect())]);
    let caption = "What the front of all generations so far dominates of the objectives between 0 and a reference point, \
                   which the schema of table generations names.";
    Ok(Figure::single("hypervolume", "Hypervolume", caption, panel))
}
