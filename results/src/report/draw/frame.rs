//! A panel on the canvas: its axes with ticks and names, and the mapping of values to pixels.

use std::ops::Range;

use plotters::coord::ranged1d::{BoldPoints, Ranged as _};
use plotters::coord::types::RangedCoordf64;

use super::canvas::{At, Canvas, Drawn, text_width};
use crate::report::figure::{Axis, Dash, Marks, Panel, Scale, shortened};
use crate::report::palette::{GRID, INK};

const LABEL: f64 = 12.0;
/// Characters of a name beside an axis.
const NAME_LENGTH: usize = 24;

/// A panel on the canvas.
pub(super) struct Frame<'a> {
    panel: &'a Panel,
    /// Values at the ends of both axes: left and right, bottom and top.
    values: [[f64; 2]; 2],
    /// Pixels of those ends.
    pixels: [[f64; 2]; 2],
    ticks: [Vec<Tick>; 2],
    upright_names: bool,
    tick_size: [f64; 2],
    /// Where the panel begins.
    corner: [f64; 2],
    width: f64,
}

struct Tick {
    at: f64,
    text: String,
}

impl<'a> Frame<'a> {
    /// Lays out a panel at `corner`, with room for ticks and names around its axes.
    pub fn new(panel: &'a Panel, corner: [f64; 2], width: f64) -> Self {
        let [x, mut y] = panel.ranges();
        let height = f64::from(panel.height);
        let tick_size = [tick_size(&panel.x), tick_size(&panel.y)];
        let ticks = [ticks(&panel.x, x, width / 80.0), ticks(&panel.y, y, height / 45.0)];
        let widest = |axis: usize| {
            ticks[axis].iter().map(|tick| text_width(&tick.text, tick_size[axis])).fold(0.0, f64::max)
        };
        let upright_names = matches!(&panel.x.scale, Scale::Names(names) if names.len() > 6);
        let below = if upright_names { widest(0) + 8.0 } else { 20.0 };
        let bar = panel.series.iter().any(|s| matches!(s.marks, Marks::Matrix { .. }));
        let left = corner[0] + widest(1) + 8.0 + if panel.y.label.is_empty() { 8.0 } else { 26.0 };
        let right = corner[0] + width - if bar { 64.0 } else { 14.0 };
        let top = corner[1] + if panel.title.is_empty() { 8.0 } else { 26.0 };
        let bottom = corner[1] + height - below - if panel.x.label.is_empty() { 6.0 } else { 26.0 };
        if matches!(panel.y.scale, Scale::Names(_)) {
            y.reverse(); // the first name stands at the top
        }
        let pixels = [[left, right.max(left + 10.0)], [bottom.max(top + 10.0), top]];
        Self { panel, values: [x, y], pixels, ticks, upright_names, tick_size, corner, width }
    }

    /// Pixel of a value on one of the axes.
    pub fn place(&self, axis: usize, value: f64) -> f64 {
        let ([from, to], [first, last]) = (self.values[axis], self.pixels[axis]);
        first + (value - from) / (to - from) * (last - first)
    }

    /// Pixels of a point.
    pub fn point(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [self.place(0, x), self.place(1, y)]
    }

    /// Pixels of the ends of both axes: left and right, bottom and top.
    pub fn pixels(&self) -> [[f64; 2]; 2] {
        self.pixels
    }

    /// Whether its places are those of values.
    pub fn has_values(&self) -> bool {
        matches!(self.panel.x.scale, Scale::Values(_))
    }

    /// Faint lines behind the marks.
    pub fn draw_grid(&self, canvas: &dyn Canvas) -> Drawn {
        let [[left, right], [bottom, top]] = self.pixels;
        for (axis, scale) in [&self.panel.x.scale, &self.panel.y.scale].into_iter().enumerate() {
            for tick in
                self.ticks[axis].iter().filter(|_| matches!(scale, Scale::Numbers(_) | Scale::Within(_)))
            {
                let at = self.place(axis, tick.at);
                let ends = if axis == 0 { [[at, bottom], [at, top]] } else { [[left, at], [right, at]] };
                canvas.line(&ends, GRID, 0.8, Dash::Solid)?;
            }
        }
        Ok(())
    }

    /// Lines, ticks, names and labels.
    pub fn draw_axes(&self, canvas: &dyn Canvas) -> Drawn {
        let [[left, right], [bottom, top]] = self.pixels;
        canvas.line(&[[left, top], [left, bottom], [right, bottom]], INK, 1.0, Dash::Solid)?;
        for tick in &self.ticks[0] {
            let at = self.place(0, tick.at);
            canvas.line(&[[at, bottom], [at, bottom + 4.0]], INK, 1.0, Dash::Solid)?;
            let (below, how) = if self.upright_names { (8.0, At::TopUpwards) } else { (13.0, At::Centre) };
            canvas.text(&tick.text, [at, bottom + below], self.tick_size[0], how, INK)?;
        }
        for tick in &self.ticks[1] {
            let at = self.place(1, tick.at);
            canvas.line(&[[left, at], [left - 4.0, at]], INK, 1.0, Dash::Solid)?;
            canvas.text(&tick.text, [left - 7.0, at], self.tick_size[1], At::Right, INK)?;
        }
        let middle = [(left + right) / 2.0, (bottom + top) / 2.0];
        let lowest = self.corner[1] + f64::from(self.panel.height) - 10.0;
        canvas.text(&self.panel.x.title(), [middle[0], lowest], LABEL, At::Centre, INK)?;
        let outermost = [self.corner[0] + 12.0, middle[1]];
        canvas.text(&self.panel.y.title(), outermost, LABEL, At::CentreUpwards, INK)?;
        let title = [self.corner[0] + self.width / 2.0, self.corner[1] + 12.0];
        canvas.text(&self.panel.title, title, 13.0, At::Centre, INK)
    }
}

fn tick_size(axis: &Axis) -> f64 {
    match &axis.scale {
        Scale::Names(names) if names.len() > 24 => 8.5,
        _ => 10.5,
    }
}

/// Ticks at round numbers, about `wanted` of them, or at each name.
fn ticks(axis: &Axis, [low, high]: [f64; 2], wanted: f64) -> Vec<Tick> {
    if let Scale::Names(names) = &axis.scale {
        let tick =
            |(place, name): (usize, &String)| Tick { at: place as f64, text: shortened(name, NAME_LENGTH) };
        return names.iter().enumerate().map(tick).collect();
    }
    if let Scale::Values(values) = &axis.scale {
        let every = (values.len() as f64 / wanted.max(2.0)).ceil().max(1.0) as usize;
        let text = |value: f64| {
            number(
                value,
                usize::from(value.fract() != 0.0) + usize::from((10.0 * value).fract().abs() > 1e-6),
            )
        };
        let tick = |(place, &value): (usize, &f64)| Tick { at: place as f64, text: text(value) };
        return values.iter().enumerate().step_by(every).map(tick).collect();
    }
    let at = round_numbers(low..high, wanted.max(2.0) as usize);
    let step = at.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min);
    // As many decimals as the step needs.
    let (mut scaled, mut decimals) = (step, 0);
    while scaled.is_finite() && decimals < 9 && (scaled - scaled.round()).abs() > 1e-6 * scaled {
        scaled *= 10.0;
        decimals += 1;
    }
    at.into_iter().map(|at| Tick { at, text: number(at, decimals) }).collect()
}

/// A number as axes have it.
pub(super) fn number(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    // A typographic minus, and none before zero.
    match text.strip_prefix('-') {
        Some(digits) if digits.chars().all(|c| matches!(c, '0' | '.')) => digits.to_owned(),
        Some(digits) => format!("−{digits}"),
        None => text,
    }
}

fn round_numbers(range: Range<f64>, most: usize) -> Vec<f64> {
    let Range { start, end } = range;
    RangedCoordf64::from(start..end).key_points(BoldPoints(most))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_lie_within_the_axis_and_are_told_apart() {
        let axis = Axis::numbers("error", "%");
        for range in [[0.0, 1.0], [11.5, 31.2], [0.2499, 0.2501], [-3.0, 1e6], [0.0, 3.0], [99.5, 100.5]] {
            let ticks = ticks(&axis, range, 6.0);
            assert!((2..=9).contains(&ticks.len()), "{range:?}: {}", ticks.len());
            assert!(ticks.iter().all(|tick| (range[0]..=range[1]).contains(&tick.at)), "{range:?}");
            let mut texts: Vec<&str> = ticks.iter().map(|tick| tick.text.as_str()).collect();
            texts.dedup();
            assert_eq!(texts.len(), ticks.len(), "{texts:?}");
        }
    }

    #[test]
    fn names_go_from_left_to_right_and_from_top_to_bottom() {
        let names = || Axis::names("object", vec!["a".to_owned(), "b".to_owned()]);
        let panel = Panel { title: String::new(), x: names(), y: names(), series: Vec::new(), height: 300 };
        let frame = Frame::new(&panel, [0.0, 0.0], 400.0);
        let [first, second] = [[0.0, 0.0], [1.0, 1.0]].map(|point| frame.point(point));
        assert!(first[0] < second[0] && first[1] < second[1], "{first:?} {second:?}");
    }

    #[test]
    fn higher_numbers_stand_higher() {
        let axis = || Axis::numbers("error", "%").including(0.0).including(5.0);
        let panel = Panel { title: String::new(), x: axis(), y: axis(), series: Vec::new(), height: 300 };
        let frame = Frame::new(&panel, [10.0, 20.0], 400.0);
        let [low, high] = [[0.0, 0.0], [5.0, 5.0]].map(|point| frame.point(point));
        assert!(low[0] < high[0] && low[1] > high[1]);
        assert!(high[0] <= 410.0 && high[1] >= 20.0 && low[1] <= 320.0);
    }
}
