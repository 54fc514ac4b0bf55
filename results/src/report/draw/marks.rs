//! Marks of one series, drawn between the axes of a panel.

use super::canvas::{At, Canvas, Drawn};
use super::frame::{Frame, number};
use super::shape::{clipped_area, clipped_line, contains, seen_line, steps};
use crate::report::figure::{Colour, Dash, Marks, Series};
use crate::report::palette::{PAPER, Rgb, needs_light_ink, shade};

/// How far marks may lie beyond the axes, pixels: places of values are not exact.
const SLACK: f64 = 0.5;

/// Radius of a point of a cloud, and of the rim behind it, pixels.
const DOT: f64 = 1.7;
const RIM: f64 = 2.0;

/// Draws a series.
pub(super) fn draw(canvas: &dyn Canvas, frame: &Frame<'_>, series: &Series) -> Drawn {
    let rgb = series.colour.rgb();
    let [[left, right], [bottom, top]] = frame.pixels();
    let bounds = [[left - SLACK, right + SLACK], [top - SLACK, bottom + SLACK]];
    match &series.marks {
        Marks::Line { points, stepped, dash } => {
            let points: Vec<[f64; 2]> = points.iter().map(|&point| frame.point(point)).collect();
            let points = if *stepped { steps(&points) } else { points };
            let pieces = clipped_line(&seen_line(&points), bounds);
            pieces.iter().try_for_each(|piece| canvas.line(piece, rgb, 1.6, *dash))
        }
        Marks::Points { points, symbol } => {
            let places = points.iter().map(|&point| frame.point(point));
            places.filter(|&at| contains(bounds, at)).try_for_each(|at| canvas.symbol(at, *symbol, rgb))
        }
        Marks::Cloud { points, colours, opacity } => {
            let places: Vec<([f64; 2], Rgb)> =
                points.iter().map(|&point| frame.point(point)).zip(colours.iter().copied()).collect();
            let seen = || places.iter().filter(|(at, _)| contains(bounds, *at));
            // White points lie on white paper, black ones on dark pages: all have a rim.
            seen().try_for_each(|&(at, _)| canvas.dot(at, RIM, rgb, *opacity))?;
            seen().try_for_each(|&(at, own)| canvas.dot(at, DOT, own, *opacity))
        }
        Marks::Band(points) => {
            let side = |of: fn(&[f64; 3]) -> [f64; 2]| {
                seen_line(&points.iter().map(|point| frame.point(of(point))).collect::<Vec<_>>())
            };
            let there = side(|&[x, low, _]| [x, low]);
            let back = side(|&[x, _, high]| [x, high]);
            let corners = there.into_iter().chain(back.into_iter().rev()).collect();
            canvas.polygon(&clipped_area(corners, bounds), rgb, 0.2)
        }
        Marks::Segments { ends, width } => ends.iter().try_for_each(|ends| {
            let pieces = clipped_line(&ends.map(|end| frame.point(end)), bounds);
            pieces.iter().try_for_each(|piece| canvas.line(piece, rgb, f64::from(*width), Dash::Solid))
        }),
        Marks::Matrix { cells, unit, ends, written } => {
            draw_matrix(canvas, frame, cells, unit, *ends, *written)
        }
    }
}

fn draw_matrix(
    canvas: &dyn Canvas,
    frame: &Frame<'_>,
    cells: &[Vec<Option<f64>>],
    unit: &str,
    [lightest, darkest]: [f64; 2],
    written: bool,
) -> Drawn {
    let share =
        |value: f64| if darkest == lightest { 0.0 } else { (value - lightest) / (darkest - lightest) };
    let [[left, right], [bottom, top]] = frame.pixels();
    // Large matrices are mostly empty: what is empty is drawn at once, and the lines between.
    canvas.rectangle([left, top], [right, bottom], shade(0.0))?;
    // Between names there are lines; values follow each other.
    let gap = if frame.has_values() { -0.25 } else { 0.4 }; // overlapping: no seams
    for row in (1..cells.len()).filter(|_| gap > 0.0) {
        let at = frame.point([0.0, row as f64 - 0.5])[1];
        canvas.line(&[[left, at], [right, at]], PAPER, 0.8, Dash::Solid)?;
    }
    for column in (1..cells.first().map_or(0, Vec::len)).filter(|_| gap > 0.0) {
        let at = frame.point([column as f64 - 0.5, 0.0])[0];
        canvas.line(&[[at, bottom], [at, top]], PAPER, 0.8, Dash::Solid)?;
    }
    let cell = |row: usize, column: usize, value: Option<f64>| Some((row, column, value?));
    let mut filled: Vec<(usize, usize, f64)> = cells
        .iter()
        .enumerate()
        .flat_map(|(row, cells)| {
            cells.iter().enumerate().filter_map(move |(column, &value)| cell(row, column, value))
        })
        .filter(|&(_, _, value)| share(value) > 0.0)
        .collect();
    filled.sort_by(|a, b| a.2.total_cmp(&b.2)); // neighbours of one shade become one path
    for &(row, column, value) in &filled {
        let (x, y) = (column as f64, row as f64);
        let [from, to] = [[x - 0.5, y - 0.5], [x + 0.5, y + 0.5]].map(|corner| frame.point(corner));
        let [left, right] = [from[0].min(to[0]) + gap, from[0].max(to[0]) - gap];
        let [top, bottom] = [from[1].min(to[1]) + gap, from[1].max(to[1]) - gap];
        canvas.rectangle([left, top], [right, bottom], shade(share(value)))?;
    }
    for (row, column, value) in filled.into_iter().filter(|_| written) {
        let ink = if needs_light_ink(share(value)) { PAPER } else { Colour::Black.rgb() };
        canvas.text(&value.to_string(), frame.point([column as f64, row as f64]), 10.0, At::Centre, ink)?;
    }
    draw_scale(canvas, [right + 14.0, top], bottom.min(top + 160.0), [lightest, darkest], unit)
}

/// What the shades of a matrix mean, from `top` down to `bottom`.
fn draw_scale(canvas: &dyn Canvas, [x, top]: [f64; 2], bottom: f64, ends: [f64; 2], unit: &str) -> Drawn {
    const STEPS: u32 = 32;
    let height = (bottom - top) / f64::from(STEPS);
    for step in 0..STEPS {
        let from = bottom - height * f64::from(step);
        let rgb = shade((f64::from(step) + 0.5) / f64::from(STEPS));
        canvas.rectangle([x, from - height], [x + 10.0, from], rgb)?;
    }
    let decimals = if ends.iter().all(|end| end.fract() == 0.0) { 0 } else { 1 };
    for (end, y) in ends.into_iter().zip([bottom - 4.0, top + 4.0]) {
        canvas.text(&number(end, decimals), [x + 14.0, y], 10.0, At::Left, Colour::Black.rgb())?;
    }
    let middle = [x + 22.0, (top + bottom) / 2.0];
    canvas.text(unit, middle, 10.0, At::CentreUpwards, Colour::Black.rgb())
}

/// A sample for the legend, 22 pixels wide.
pub(super) fn draw_sample(canvas: &dyn Canvas, series: &Series, [x, y]: [f64; 2]) -> Drawn {
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
        Marks::Cloud { .. } | Marks::Matrix { .. } => Ok(()),
    }
}
