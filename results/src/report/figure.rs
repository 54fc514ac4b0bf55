//! The content of a figure, independent of the renderer: panels with axes, and marks in them.

use std::borrow::Cow;

use artefact::text::is_printable;

pub(crate) use super::palette::Colour;
use super::palette::Rgb;

/// Width of a figure in CSS pixels: what fits on a sheet of A4 or Letter with narrow margins.
pub(crate) const WIDTH: u32 = 700;

/// One figure: one file, one anchor of the page.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Figure {
    /// Name of its file and anchor: lower case, digits and hyphens.
    pub id: String,
    /// Its heading.
    pub title: String,
    /// Caption as plain text; says what was left out.
    pub caption: String,
    /// Its panels, row by row.
    pub panels: Vec<Panel>,
    /// Number of panels side by side, at least 1.
    pub columns: usize,
    /// Where its numbers can be read.
    pub numbers: Numbers,
}

/// Where the numbers of a figure can be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Numbers {
    /// Under it, in a table that is made of its marks.
    Below,
    /// Elsewhere on the page, or it has none.
    Elsewhere,
}

impl Figure {
    /// A figure of one panel.
    pub fn single(id: &str, title: &str, caption: impl Into<String>, panel: Panel) -> Self {
        Self {
            id: id.to_owned(),
            title: title.to_owned(),
            caption: caption.into(),
            panels: vec![panel],
            columns: 1,
            numbers: Numbers::Below,
        }
    }

    /// The same without a table: its numbers are elsewhere on the page.
    pub fn told_elsewhere(self) -> Self {
        Self { numbers: Numbers::Elsewhere, ..self }
    }

    /// Whether there is nothing to draw.
    pub fn is_empty(&self) -> bool {
        self.panels.iter().flat_map(|panel| &panel.series).all(|series| series.marks.is_empty())
    }

    /// Width of each panel, pixels.
    pub fn panel_width(&self) -> u32 {
        WIDTH / u32::try_from(self.columns.max(1)).unwrap_or(WIDTH)
    }
}

/// One pair of axes with what is drawn between them.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Panel {
    /// Title above it; empty for none.
    pub title: String,
    /// The horizontal axis.
    pub x: Axis,
    /// The vertical axis.
    pub y: Axis,
    /// What is drawn, the first at the back.
    pub series: Vec<Series>,
    /// Height with everything around the axes, pixels.
    pub height: u32,
}

impl Panel {
    /// Values at the ends of its axes, the lower first: of x, of y.
    pub fn ranges(&self) -> [[f64; 2]; 2] {
        let extent = |axis: usize| {
            self.series.iter().flat_map(move |series| series.marks.extent().map(move |place| place[axis]))
        };
        [self.x.range(extent(0)), self.y.range(extent(1))]
    }
}

/// An axis: its label always says the quantity, and the unit where there is one.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Axis {
    /// The quantity.
    pub label: String,
    /// Its unit; empty for a pure number.
    pub unit: String,
    /// Its ticks.
    pub scale: Scale,
}

/// Ticks of an axis.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Scale {
    /// Numbers, so that all marks and these values can be seen.
    Numbers(Vec<f64>),
    /// Numbers between these; marks beyond are cut off.
    Within([f64; 2]),
    /// Names at 0, 1, …: from left to right, from top to bottom.
    Names(Vec<String>),
    /// Values at 0, 1, …: from left to right, from bottom to top.
    Values(Vec<f64>),
}

impl Axis {
    /// An axis of numbers.
    pub fn numbers(label: &str, unit: &str) -> Self {
        Self { label: label.to_owned(), unit: unit.to_owned(), scale: Scale::Numbers(Vec::new()) }
    }

    /// An axis of names.
    pub fn names(label: &str, names: Vec<String>) -> Self {
        Self { label: label.to_owned(), unit: String::new(), scale: Scale::Names(names) }
    }

    /// An axis of values that are as far apart whatever lies between them.
    pub fn values(label: &str, unit: &str, values: Vec<f64>) -> Self {
        Self { label: label.to_owned(), unit: unit.to_owned(), scale: Scale::Values(values) }
    }

    /// An axis that ends a little beyond these values, whatever marks there are.
    pub fn within(label: &str, unit: &str, ends: [f64; 2]) -> Self {
        let ends = padded(ends);
        Self { label: label.to_owned(), unit: unit.to_owned(), scale: Scale::Within(ends) }
    }

    /// Extends the axis so that it includes a value; has no effect on names.
    pub fn including(mut self, value: f64) -> Self {
        if let Scale::Numbers(seen) = &mut self.scale {
            seen.push(value);
        }
        self
    }

    /// The label with the unit, as in `error (%)`.
    pub fn title(&self) -> String {
        match self.unit.as_str() {
            "" => self.label.clone(),
            unit => format!("{} ({unit})", self.label),
        }
    }

    /// Both ends, the lower first: beyond all marks of the panel by a little, or half a place beyond the names.
    pub fn range(&self, marks: impl Iterator<Item = f64>) -> [f64; 2] {
        let seen = match &self.scale {
            Scale::Names(names) => return places(names.len()),
            Scale::Values(values) => return places(values.len()),
            Scale::Within(ends) => return *ends,
            Scale::Numbers(seen) => seen,
        };
        let finite = marks.chain(seen.iter().copied()).filter(|value| value.is_finite());
        let ends = finite.fold(None, |ends: Option<[f64; 2]>, value| {
            Some(ends.map_or([value; 2], |[low, high]| [low.min(value), high.max(value)]))
        });
        padded(ends.unwrap_or([0.0, 1.0]))
    }
}

/// Ends of an axis of so many places.
fn places(count: usize) -> [f64; 2] {
    [-0.5, count.max(1) as f64 - 0.5]
}

/// Ends of an axis that shows all between two values.
fn padded([low, high]: [f64; 2]) -> [f64; 2] {
    let margin = if high > low { 0.04 * (high - low) } else { low.abs().max(1.0) / 2.0 };
    // Where zero is the end that was asked for, the axis begins there.
    let from = if low == 0.0 { 0.0 } else { low - margin };
    [from, high + margin]
}

/// Marks of one style.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Series {
    /// Name in the legend; empty: none.
    pub name: String,
    /// Its colour.
    pub colour: Colour,
    /// What is drawn.
    pub marks: Marks,
}

/// Marks, in the coordinates of the axes.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Marks {
    /// A line through all points.
    Line {
        /// The points.
        points: Vec<[f64; 2]>,
        /// Whether each value holds from its x to the next.
        stepped: bool,
        /// How it is drawn.
        dash: Dash,
    },
    /// Points.
    Points {
        /// Where.
        points: Vec<[f64; 2]>,
        /// How they are drawn.
        symbol: Symbol,
    },
    /// Points of a cloud, each in a colour of its own.
    Cloud {
        /// Where.
        points: Vec<[f64; 2]>,
        /// The colour of each.
        colours: Vec<Rgb>,
        /// How much is seen of what lies behind, from 0, nothing is drawn, to 1.
        opacity: f64,
    },
    /// The space between two lines: x, lower y, upper y.
    Band(Vec<[f64; 3]>),
    /// Straight pieces, such as bars, spans of time and intervals.
    Segments {
        /// Both ends of each.
        ends: Vec<[[f64; 2]; 2]>,
        /// Their width in pixels.
        width: u32,
    },
    /// A cell for each pair of names, rows from top to bottom; `None` is left empty.
    Matrix {
        /// Rows of cells, as many as the axes have names.
        cells: Vec<Vec<Option<f64>>>,
        /// What a cell counts or measures.
        unit: String,
        /// The values of the lightest and the darkest shade.
        ends: [f64; 2],
        /// Whether the cells show their numbers.
        written: bool,
    },
}

impl Marks {
    /// A matrix of counts: the more, the darker.
    pub fn counts(cells: Vec<Vec<Option<f64>>>, unit: &str, written: bool) -> Self {
        let most = cells.iter().flatten().flatten().fold(1.0, |most: f64, &value| most.max(value));
        Self::Matrix { cells, unit: unit.to_owned(), ends: [0.0, most], written }
    }

    /// Every coordinate pair that must be seen.
    pub fn extent(&self) -> Box<dyn Iterator<Item = [f64; 2]> + '_> {
        match self {
            Self::Line { points, .. } | Self::Points { points, .. } | Self::Cloud { points, .. } => {
                Box::new(points.iter().copied())
            }
            Self::Band(points) => Box::new(points.iter().flat_map(|&[x, low, high]| [[x, low], [x, high]])),
            Self::Segments { ends, .. } => Box::new(ends.iter().flatten().copied()),
            Self::Matrix { .. } => Box::new(std::iter::empty()),
        }
    }

    /// Whether there is anything to draw.
    pub fn is_empty(&self) -> bool {
        match self {
            Self::Matrix { cells, .. } => cells.iter().all(Vec::is_empty),
            other => other.extent().next().is_none(),
        }
    }
}

impl Series {
    /// A solid line.
    pub fn line(name: &str, colour: Colour, points: Vec<[f64; 2]>) -> Self {
        Self::dashed(name, colour, Dash::Solid, points)
    }

    /// A line that differs from others without its colour.
    pub fn dashed(name: &str, colour: Colour, dash: Dash, points: Vec<[f64; 2]>) -> Self {
        Self { name: name.to_owned(), colour, marks: Marks::Line { points, stepped: false, dash } }
    }

    /// A line of steps: each value holds from its x to the next.
    pub fn steps(name: &str, colour: Colour, dash: Dash, points: Vec<[f64; 2]>) -> Self {
        Self { name: name.to_owned(), colour, marks: Marks::Line { points, stepped: true, dash } }
    }

    /// Points.
    pub fn points(name: &str, colour: Colour, symbol: Symbol, points: Vec<[f64; 2]>) -> Self {
        Self { name: name.to_owned(), colour, marks: Marks::Points { points, symbol } }
    }

    /// Points of a cloud, which have colours of their own.
    pub fn cloud(points: Vec<[f64; 2]>, colours: Vec<Rgb>, opacity: f64) -> Self {
        let marks = Marks::Cloud { points, colours, opacity };
        Self { name: String::new(), colour: Colour::Grey, marks }
    }

    /// The space between two lines.
    pub fn band(name: &str, colour: Colour, points: Vec<[f64; 3]>) -> Self {
        Self { name: name.to_owned(), colour, marks: Marks::Band(points) }
    }

    /// Straight pieces.
    pub fn segments(name: &str, colour: Colour, width: u32, ends: Vec<[[f64; 2]; 2]>) -> Self {
        Self { name: name.to_owned(), colour, marks: Marks::Segments { ends, width } }
    }
}

/// How a line is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Dash {
    Solid,
    Dashed,
    Dotted,
    /// Dashes and dots.
    Mixed,
}

impl Dash {
    /// The dash of the n-th of many lines: it changes with each, so that neighbours in the palette differ in both.
    pub fn nth(index: usize) -> Self {
        [Self::Solid, Self::Dashed, Self::Dotted, Self::Mixed][index % 4]
    }
}

/// The shape of a point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Symbol {
    Circle,
    Triangle,
    Dot,
}

/// Text without control and format characters: names come from outside, and XML cannot hold all of them.
pub(crate) fn printable(text: &str) -> Cow<'_, str> {
    let unfit = |c: char| !is_printable(c);
    if text.contains(unfit) { Cow::Owned(text.replace(unfit, "\u{fffd}")) } else { Cow::Borrowed(text) }
}

/// A name cut to fit beside an axis; its end, where objects differ, is kept.
pub(crate) fn shortened(name: &str, most: usize) -> String {
    let length = name.chars().count();
    if length <= most {
        return name.to_owned();
    }
    let kept: String = name.chars().skip(length - most + 1).collect();
    format!("…{kept}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_axis_shows_every_mark_and_never_has_no_length() {
        let axis = Axis::numbers("error", "%").including(30.0);
        for marks in [vec![], vec![5.0], vec![0.0, 10.0], vec![-3.0, f64::NAN, 40.0], vec![30.0]] {
            let [low, high] = axis.range(marks.iter().copied());
            assert!(low < high, "{marks:?}: {low} to {high}");
            let seen = marks.iter().chain(&[30.0]).filter(|value| value.is_finite());
            assert!(seen.into_iter().all(|value| (low..=high).contains(value)), "{marks:?}: {low} to {high}");
        }
        assert_eq!(axis.range([0.0, 10.0].into_iter())[0], 0.0);
        let [low, high] = Axis::within("error", "%", [10.0, 20.0]).range([0.0, 90.0].into_iter());
        assert!((9.0..10.0).contains(&low) && (20.0..21.0).contains(&high), "{low} to {high}");
        assert_eq!(Axis::names("object", vec!["a".into(), "b".into()]).range([9.0].into_iter()), [-0.5, 1.5]);
    }

    #[test]
    fn long_names_keep_their_ends_and_control_characters_go() {
        assert_eq!(shortened("food_can_12", 5), "…n_12");
        assert_eq!(shortened("mug_1", 5), "mug_1");
        assert_eq!(shortened("größe_10", 4), "…_10");
        assert_eq!(printable("a\u{0}b\nc"), "a\u{fffd}b\u{fffd}c");
        assert_eq!(printable("a\u{202e}b\u{2028}c\u{feff}"), "a\u{fffd}b\u{fffd}c\u{fffd}");
        assert_eq!(printable("Größe <b>"), "Größe <b>");
    }
}
