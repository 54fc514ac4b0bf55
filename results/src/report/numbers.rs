//! The numbers of figures: as tables, and in a line for those who do not see them.

use std::collections::BTreeMap;

use super::draw::legend;
use super::figure::{Axis, Figure, Marks, Panel, Scale, Series};
use super::table::TableBlock;

/// Rows of a panel's table.
const MOST_ROWS: usize = 50;
/// Spans of a cell that are written one by one.
const MOST_SPANS: usize = 3;

/// What a panel shows, in a line.
pub(crate) fn spoken(figure: &Figure, panel: &Panel) -> String {
    let title = if panel.title.is_empty() { &figure.title } else { &panel.title };
    let axes = match (panel.x.title(), panel.y.title()) {
        (x, y) if y.is_empty() => x,
        (x, y) if x.is_empty() => y,
        (x, y) => format!("{y} over {x}"),
    };
    let parts: Vec<String> = panel.series.iter().filter_map(|series| spoken_series(panel, series)).collect();
    let parts = if parts.is_empty() { String::new() } else { format!(" {}.", parts.join("; ")) };
    format!("{title}: {axes}.{parts}")
}

fn spoken_series(panel: &Panel, series: &Series) -> Option<String> {
    let text = match &series.marks {
        Marks::Line { points, .. } => {
            let ([_, first], [_, last]) = (points.first()?, points.last()?);
            format!("{} to {}", number(*first), number(*last))
        }
        Marks::Points { points, .. } if matches!(panel.y.scale, Scale::Names(_)) => {
            range(points.iter().map(|point| point[0]))?
        }
        Marks::Points { points, .. } => {
            format!("{} points, {}", points.len(), range(points.iter().map(|point| point[1]))?)
        }
        Marks::Cloud { points, .. } => format!("{} points of the cloud", points.len()),
        Marks::Matrix { cells, unit, .. } => {
            format!("{} rows, {} columns, {unit}", cells.len(), cells.first().map_or(0, Vec::len))
        }
        Marks::Band(_) | Marks::Segments { .. } => return None,
    };
    Some(if series.name.is_empty() { text } else { format!("{} {text}", series.name) })
}

/// The tables of a figure, one a panel.
pub(crate) fn tables(figure: &Figure) -> Vec<TableBlock> {
    figure.panels.iter().filter_map(|panel| table(figure, panel)).collect()
}

fn table(figure: &Figure, panel: &Panel) -> Option<TableBlock> {
    let matrix = panel.series.iter().find_map(|series| match &series.marks {
        Marks::Matrix { cells, unit, .. } => Some((cells, unit)),
        _ => None,
    });
    let (head, rows, texts) = match (matrix, &panel.x.scale, &panel.y.scale) {
        (Some((cells, unit)), ..) => {
            let head = vec![panel.y.title(), panel.x.title(), unit.clone()];
            (head, cells_of(panel, cells), 2)
        }
        (None, _, Scale::Names(names)) => by_name(figure, panel, names),
        _ => by_value(figure, panel),
    };
    let (all, every) = (rows.len(), rows.len().div_ceil(MOST_ROWS).max(1));
    let is_matrix = matrix.is_some();
    let rows: Vec<Vec<String>> = match is_matrix {
        true => rows.into_iter().take(MOST_ROWS).collect(), // the highest
        false => rows.into_iter().step_by(every).collect(),
    };
    let left_out = match rows.len() {
        shown if shown == all => String::new(),
        shown if is_matrix => format!(" The {shown} highest of {all} numbers."),
        shown => format!(" {shown} of {all} rows, evenly chosen."),
    };
    let title = if panel.title.is_empty() { figure.title.clone() } else { panel.title.clone() };
    let of = if panel.title.is_empty() && figure.panels.len() > 1 { panel.y.title() } else { String::new() };
    let of = if of.is_empty() { panel.x.title() } else { of };
    let caption = if figure.panels.len() > 1 {
        format!("{title}: {of}.{left_out}")
    } else {
        format!("{title}.{left_out}")
    };
    (!rows.is_empty()).then_some(TableBlock { caption, head, rows, texts })
}

/// Name of a place on an axis.
fn place(axis: &Axis, place: usize) -> String {
    match &axis.scale {
        Scale::Names(names) => names.get(place).cloned().unwrap_or_default(),
        Scale::Values(values) => values.get(place).copied().map(number).unwrap_or_default(),
        _ => place.to_string(),
    }
}

/// What is not 0 of a matrix, the highest first.
fn cells_of(panel: &Panel, cells: &[Vec<Option<f64>>]) -> Vec<Vec<String>> {
    let mut filled: Vec<(usize, usize, f64)> = Vec::new();
    for (row, cells) in cells.iter().enumerate() {
        let values = cells.iter().enumerate();
        filled.extend(
            values.filter_map(|(column, value)| Some((row, column, value.filter(|&value| value != 0.0)?))),
        );
    }
    filled.sort_by(|a, b| b.2.total_cmp(&a.2));
    let row = |(row, column, value): (usize, usize, f64)| {
        vec![place(&panel.y, row), place(&panel.x, column), number(value)]
    };
    filled.into_iter().map(row).collect()
}

type Cells = (Vec<String>, Vec<Vec<String>>, usize);

/// A row for each name on the vertical axis.
fn by_name(figure: &Figure, panel: &Panel, names: &[String]) -> Cells {
    let series = named(figure, panel);
    let rows = names.iter().enumerate().map(|(row, name)| {
        let cell = |series: &&Series| match &series.marks {
            Marks::Segments { ends, .. } => {
                let here = ends
                    .iter()
                    .filter(|ends| ends[0][1].round() == row as f64 || ends[1][1].round() == row as f64);
                spans(&here.map(|ends| [ends[0][0], ends[1][0]]).collect::<Vec<_>>())
            }
            Marks::Points { points, .. } => {
                let here = points.iter().filter(|point| point[1].round() == row as f64);
                here.map(|point| number(point[0])).collect::<Vec<_>>().join(", ")
            }
            _ => String::new(),
        };
        std::iter::once(name.clone()).chain(series.iter().map(cell)).collect()
    });
    (head(panel.y.title(), &series, panel), rows.collect(), 1)
}

fn spans(spans: &[[f64; 2]]) -> String {
    if spans.len() > MOST_SPANS {
        let sum: f64 = spans.iter().map(|[from, to]| to - from).sum();
        return format!("{} in {} parts", number(sum), spans.len());
    }
    let span = |&[from, to]: &[f64; 2]| match from == to {
        true => number(from),
        false => format!("{} – {}", number(from), number(to)),
    };
    spans.iter().map(span).collect::<Vec<_>>().join(", ")
}

/// A row for each value on the horizontal axis.
fn by_value(figure: &Figure, panel: &Panel) -> Cells {
    let series = named(figure, panel);
    // By bits: what stands at one place has the same number.
    let mut rows: BTreeMap<u64, Vec<Vec<f64>>> = BTreeMap::new();
    let key = |value: f64| (value + 0.0).to_bits() ^ if value < 0.0 { u64::MAX } else { 1 << 63 };
    let mut values: BTreeMap<u64, f64> = BTreeMap::new();
    for (column, series) in series.iter().enumerate() {
        for [x, y] in series.marks.extent() {
            values.insert(key(x), x);
            rows.entry(key(x)).or_insert_with(|| vec![Vec::new(); series_count(panel)])[column].push(y);
        }
    }
    let rows = rows.iter().map(|(key, cells)| {
        let cells =
            cells.iter().take(series.len()).map(|cell| range(cell.iter().copied()).unwrap_or_default());
        std::iter::once(values.get(key).map_or_else(String::new, |&value| number(value)))
            .chain(cells)
            .collect()
    });
    (head(panel.x.title(), &series, panel), rows.collect(), 0)
}

fn series_count(panel: &Panel) -> usize {
    panel.series.len()
}

/// The series that have a name, or, if none has, all.
fn named<'a>(figure: &'a Figure, panel: &'a Panel) -> Vec<&'a Series> {
    let any = !legend(figure).is_empty();
    panel.series.iter().filter(|series| !any || !series.name.is_empty()).collect()
}

fn head(first: String, series: &[&Series], panel: &Panel) -> Vec<String> {
    let name = |series: &&Series| if series.name.is_empty() { panel.y.title() } else { series.name.clone() };
    std::iter::once(first).chain(series.iter().map(name)).collect()
}

/// One number, or the lowest and the highest.
fn range(values: impl Iterator<Item = f64>) -> Option<String> {
    let ends = values.filter(|value| value.is_finite()).fold(None, |ends: Option<[f64; 2]>, value| {
        Some(ends.map_or([value; 2], |[low, high]| [low.min(value), high.max(value)]))
    });
    ends.map(
        |[low, high]| if low == high { number(low) } else { format!("{} – {}", number(low), number(high)) },
    )
}

/// A number with four digits, or all before the point.
fn number(value: f64) -> String {
    // The power of ten before which its first digit stands.
    let scientific = format!("{value:e}");
    let power = scientific.split_once('e').and_then(|(_, power)| power.parse().ok()).unwrap_or(0);
    let decimals = usize::try_from(3_i32.saturating_sub(power)).unwrap_or(0).min(9);
    let text = format!("{value:.decimals$}");
    let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    text.replacen('-', "−", 1)
}

#[cfg(test)]
mod tests {
    use super::super::figure::{Colour, Dash, Symbol};
    use super::*;

    fn figure(x: Axis, y: Axis, series: Vec<Series>) -> Figure {
        let panel = Panel { title: String::new(), x, y, series, height: 300 };
        Figure::single("f", "Growth", "Caption.", panel)
    }

    #[test]
    fn numbers_have_four_digits_and_no_more() {
        let texts = [0.0, 12.0, -0.5, 0.123_456, 1234.56, 99.996, 1e-4].map(number);
        assert_eq!(texts, ["0", "12", "−0.5", "0.1235", "1235", "100", "0.0001"]);
    }

    #[test]
    fn lines_and_bands_share_rows_by_their_places() {
        let of = figure(
            Axis::numbers("generation", ""),
            Axis::numbers("error", "%"),
            vec![
                Series::band("all", Colour::Sky, vec![[1.0, 5.0, 9.0], [2.0, 4.0, 4.0]]),
                Series::steps("best", Colour::Blue, Dash::Solid, vec![[1.0, 5.0], [2.0, 4.0]]),
                Series::points("", Colour::Blue, Symbol::Dot, vec![[1.0, 5.0]]),
            ],
        );
        let [table] = &tables(&of)[..] else { panic!("a panel has a table") };
        assert_eq!(table.head, ["generation", "all", "best"]);
        assert_eq!(table.rows, [["1", "5 – 9", "5"], ["2", "4", "4"]]);
        assert_eq!(
            spoken(&of, &of.panels[0]),
            "Growth: error (%) over generation. best 5 to 4; 1 points, 5."
        );
    }

    #[test]
    fn long_tables_are_shortened_and_say_so() {
        let points = (0..1000).map(|n| [f64::from(n) - 500.0, 1.0]).collect();
        let of = figure(
            Axis::numbers("x", ""),
            Axis::numbers("y", ""),
            vec![Series::line("", Colour::Blue, points)],
        );
        let table = &tables(&of)[0];
        assert_eq!(table.rows.len(), MOST_ROWS);
        assert_eq!((table.rows[0][0].as_str(), table.rows[49][0].as_str()), ("−500", "480"));
        assert_eq!(table.caption, "Growth. 50 of 1000 rows, evenly chosen.");
        assert_eq!(table.head, ["x", "y"]);
    }

    #[test]
    fn names_and_matrices_have_their_names() {
        let names = || Axis::names("object", vec!["cup".to_owned(), "mug".to_owned()]);
        let bars = vec![[[0.0, 0.0], [2.0, 0.0]], [[1.0, 1.0], [3.0, 1.0]]];
        let of = figure(
            Axis::numbers("time", "s"),
            names(),
            vec![Series::segments("busy", Colour::Blue, 5, bars)],
        );
        assert_eq!(tables(&of)[0].rows, [["cup", "0 – 2"], ["mug", "1 – 3"]]);
        let marks = Marks::counts(vec![vec![Some(1.0), Some(7.0)], vec![None, Some(0.0)]], "clouds", true);
        let of = figure(names(), names(), vec![Series { name: String::new(), colour: Colour::Blue, marks }]);
        assert_eq!(tables(&of)[0].rows, [["cup", "mug", "7"], ["cup", "cup", "1"]]);
    }
}
