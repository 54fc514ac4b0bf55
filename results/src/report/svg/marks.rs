//! Marks of one series, drawn between the axes of a panel.

use super::canvas::{At, Canvas, Drawn};
use super::frame::Frame;
use super::{Colour, Marks, Series};
use crate::report::figure::{Dash, shade};

/// Draws a series.
pub(super) fn draw(canvas: &Canvas<'_>, frame: &Frame<'_>, series: &Series) -> Drawn {
    let rgb = series.colour.rgb();
    match &series.marks {
        Marks::Line { points, dash } => {
            let points: Vec<[f64; 2]> = points.iter().map(|&point| frame.point(point)).collect();
            canvas.line(&points, rgb, 1.6, *dash)
        }
        Marks::Points { points, symbol } => {
            points.iter().try_for_each(|&point| canvas.symbol(frame.point(point), *symbol, rgb))
        }
        Marks::Band(points) => {
            let there = points.iter().map(|&[x, low, _]| frame.point([x, low]));
            let back = points.iter().rev().map(|&[x, _, high]| frame.point([x, high]));
            canvas.polygon(&there.chain(back).collect::<Vec<_>>(), rgb, 0.2)
        }
        Marks::Segments { ends, width } => ends.iter().try_for_each(|ends| {
            let ends = ends.map(|end| frame.point(end));
            canvas.line(&ends, rgb, f64::from(*width), Dash::Solid)
        }),
        Marks::Matrix { cells, unit, written } => draw_matrix(canvas, frame, cells, unit, *written),
    }
}

fn draw_matrix(
    canvas: &Canvas<'_>,
    frame: &Frame<'_>,
    cells: &[Vec<Option<f64>>],
    unit: &str,
    written: bool,
) -> Drawn {
    let most = cells.iter().flatten().flatten().fold(1.0, |most: f64, &value| most.max(value));
    let [[left, right], [bottom, top]] = frame.pixels();
    // Large matrices are mostly empty: what is empty is drawn at once, and the lines between.
    canvas.rectangle([left, top], [right, bottom], shade(0.0, most))?;
    for row in 1..cells.len() {
        let at = frame.point([0.0, row as f64 - 0.5])[1];
        canvas.line(&[[left, at], [right, at]], [255; 3], 0.8, Dash::Solid)?;
    }
    for column in 1..cells.first().map_or(0, Vec::len) {
        let at = frame.point([column as f64 - 0.5, 0.0])[0];
        canvas.line(&[[at, bottom], [at, top]], [255; 3], 0.8, Dash::Solid)?;
    }
    for (row, cells) in cells.iter().enumerate() {
        for (column, value) in cells.iter().enumerate() {
            let Some(value) = value.filter(|&value| value > 0.0) else { continue };
            let (x, y) = (column as f64, row as f64);
            let [from, to] = [[x - 0.5, y - 0.5], [x + 0.5, y + 0.5]].map(|corner| frame.point(corner));
            canvas.rectangle(
                [from[0] + 0.4, from[1] + 0.4],
                [to[0] - 0.4, to[1] - 0.4],
                shade(value, most),
            )?;
            if written {
                let ink = if value > most / 2.0 { [255; 3] } else { [0; 3] };
                canvas.text(&value.to_string(), frame.point([x, y]), 10.0, At::Centre, ink)?;
            }
        }
    }
    draw_scale(canvas, [right + 14.0, top], bottom.min(top + 160.0), most, unit)
}

/// What the shades of a matrix mean, from `top` down to `bottom`.
fn draw_scale(canvas: &Canvas<'_>, [x, top]: [f64; 2], bottom: f64, most: f64, unit: &str) -> Drawn {
    const STEPS: u32 = 32;
    let height = (bottom - top) / f64::from(STEPS);
    for step in 0..STEPS {
        let from = bottom - height * f64::from(step);
        let rgb = shade(f64::from(step) + 0.5, f64::from(STEPS));
        canvas.rectangle([x, from - height], [x + 10.0, from], rgb)?;
    }
    canvas.text("0", [x + 14.0, bottom - 4.0], 10.0, At::Left, Colour::Black.rgb())?;
    canvas.text(&most.to_string(), [x + 14.0, top + 4.0], 10.0, At::Left, Colour::Black.rgb())?;
    let middle = [x + 22.0, (top + bottom) / 2.0];
    canvas.text(unit, middle, 10.0, At::CentreUpwards, Colour::Black.rgb())
}

/// A sample for the legend, 22 pixels wide.
pub(super) fn draw_sample(canvas: &Canvas<'_>, series: &Series, [x, y]: [f64; 2]) -> Drawn {
    let rgb = series.colour.rgb();
    match &series.marks {
        Marks::Line { dash, .. } => canvas.line(&[[x, y], [x + 22.0, y]], rgb, 1.6, *dash),
        Marks::Points { symbol, .. } => canvas.symbol([x + 11.0, y], *symbol, rgb),
        Marks::Band(_) => {
            let corners = [[x, y - 5.0], [x + 22.0, y - 5.0], [x + 22.0, y + 5.0], [x, y + 5.0]];
            canvas.polygon(&corners, rgb, 0.2)
        }
        Marks::Segments { width, .. } => {
            canvas.line(&[[x, y], [x + 22.0, y]], rgb, f64::from(*width).min(10.0), Dash::Solid)
        }
        Marks::Matrix { .. } => Ok(()),
    }
}
