//! Figures as interactive plots of plotly.js.

use plotly::common::{
    ColorBar, ColorScale, ColorScaleElement, DashType, Fill, Font, HoverInfo, Line, Marker, MarkerSymbol,
    Mode, Orientation, TickMode,
};
use plotly::layout::{Axis as PlotlyAxis, AxisRange, HoverMode, Legend, Margin, TicksDirection};
use plotly::{HeatMap, Layout, Plot, Scatter, Trace};
use serde_json::{Value, json};

use super::figure::{Axis, Dash, Figure, Marks, Panel, Scale, Series, Symbol, printable, shade, shortened};

/// Longest name beside an axis, in characters; hovering shows all of it.
const NAME_LENGTH: usize = 24;

/// A panel as the object that `Plotly.newPlot` takes, safe inside a script of an HTML page.
pub(crate) fn panel_json(figure: &Figure, panel: &Panel) -> String {
    let mut plot = Plot::new();
    for series in panel.series.iter().filter(|series| !series.marks.is_empty()) {
        for trace in traces(panel, series) {
            plot.add_trace(trace);
        }
    }
    plot.set_layout(layout(figure, panel));
    in_script(&with_standoff(&plot.to_json()))
}

/// The plot with the distance that its axes' titles keep from the names along them: without it plotly writes one over
/// the other, and the crate has no setter for it.
fn with_standoff(json: &str) -> String {
    let Ok(mut plot) = serde_json::from_str::<Value>(json) else { return json.to_owned() };
    for axis in ["xaxis", "yaxis"] {
        if let Some(Value::Object(title)) = plot.pointer_mut(&format!("/layout/{axis}/title")) {
            title.insert("standoff".to_owned(), json!(10));
        }
    }
    plot.to_string()
}

/// JSON that cannot end the script it stands in.
fn in_script(json: &str) -> String {
    json.replace('<', "\\u003c").replace('\u{2028}', "\\u2028").replace('\u{2029}', "\\u2029")
}

/// Text for plotly, which reads a few tags and all entities.
fn text(plain: &str) -> String {
    printable(plain).replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

fn css([r, g, b]: [u8; 3], opacity: f64) -> String {
    format!("rgba({r},{g},{b},{opacity})")
}

/// A coordinate rounded to the digits that are visible.
fn number(value: f64) -> Value {
    if !value.is_finite() {
        return Value::Null;
    }
    // Seven digits; through text, because scaling would add new ones.
    let short: f64 = format!("{value:.6e}").parse().unwrap_or(value);
    if short.fract() == 0.0 && short.abs() < 1e15 { json!(short as i64) } else { json!(short) }
}

fn columns<const N: usize>(points: impl Iterator<Item = [f64; N]>) -> [Vec<Value>; N] {
    let mut columns = [const { Vec::new() }; N];
    for point in points {
        for (column, value) in columns.iter_mut().zip(point) {
            column.push(number(value));
        }
    }
    columns
}

fn traces(panel: &Panel, series: &Series) -> Vec<Box<dyn Trace>> {
    let rgb = series.colour.rgb();
    let (name, shown) = (text(&series.name), !series.name.is_empty());
    match &series.marks {
        Marks::Line { points, dash } => {
            let [x, y] = columns(points.iter().copied());
            let line = Line::new().color(css(rgb, 1.0)).width(1.8).dash(dash_type(*dash));
            vec![Scatter::new(x, y).mode(Mode::Lines).line(line).name(name).show_legend(shown)]
        }
        Marks::Points { points, symbol } => {
            let [x, y] = columns(points.iter().copied());
            let (shape, size) = marker(*symbol);
            let marker = Marker::new().color(css(rgb, 0.85)).symbol(shape).size(size);
            vec![Scatter::new(x, y).mode(Mode::Markers).marker(marker).name(name).show_legend(shown)]
        }
        Marks::Band(points) => {
            // There and back again.
            let there = points.iter().map(|&[x, low, _]| [x, low]);
            let back = points.iter().rev().map(|&[x, _, high]| [x, high]);
            let [x, y] = columns(there.chain(back));
            vec![
                Scatter::new(x, y)
                    .mode(Mode::Lines)
                    .fill(Fill::ToSelf)
                    .fill_color(css(rgb, 0.2))
                    .line(Line::new().width(0.0).color(css(rgb, 0.0)))
                    .hover_info(HoverInfo::Skip)
                    .name(name)
                    .show_legend(shown),
            ]
        }
        Marks::Segments { ends, width } => {
            // One line with gaps: a trace a segment would take plotly minutes.
            let gap = [f64::NAN; 2];
            let [x, y] = columns(ends.iter().flat_map(|&[from, to]| [from, to, gap]));
            let line = Line::new().color(css(rgb, 1.0)).width(f64::from(*width)).simplify(false);
            vec![
                Scatter::new(x, y)
                    .mode(Mode::Lines)
                    .connect_gaps(false)
                    .line(line)
                    .name(name)
                    .show_legend(shown),
            ]
        }
        Marks::Matrix { cells, unit, written } => matrix(panel, cells, unit, *written),
    }
}

fn matrix(panel: &Panel, cells: &[Vec<Option<f64>>], unit: &str, written: bool) -> Vec<Box<dyn Trace>> {
    let most = cells.iter().flatten().flatten().fold(0.0, |most: f64, &value| most.max(value));
    let scale = (0..=10).map(|tenth| {
        let share = f64::from(tenth) / 10.0;
        ColorScaleElement(share, css(shade(share, 1.0), 1.0))
    });
    let name = |axis: &Axis, index: usize| match &axis.scale {
        Scale::Names(names) => text(names.get(index).map_or("", String::as_str)),
        Scale::Numbers(_) => index.to_string(),
    };
    let (x_label, y_label) = (text(&panel.x.label), text(&panel.y.label));
    let hover = cells.iter().enumerate().map(|(row, cells)| {
        let cell = |(column, value): (usize, &Option<f64>)| {
            let value = value.map_or_else(|| "–".to_owned(), |value| value.to_string());
            let (row, column) = (name(&panel.y, row), name(&panel.x, column));
            format!("{y_label}: {row}<br>{x_label}: {column}<br>{value} {}", text(unit))
        };
        cells.iter().enumerate().map(cell).collect::<Vec<_>>()
    });
    let width = cells.first().map_or(0, Vec::len);
    let rows: Vec<Vec<Value>> =
        cells.iter().map(|row| row.iter().map(|cell| cell.map_or(Value::Null, number)).collect()).collect();
    let places = |count: usize| (0..count).map(|place| json!(place)).collect::<Vec<_>>();
    let bar = ColorBar::new().title(text(unit)).thickness(12).outline_width(0);
    let heat = HeatMap::new(places(width), places(cells.len()), rows)
        .color_scale(ColorScale::Vector(scale.collect()))
        .zauto(false)
        .zmin(0.0)
        .zmax(most.max(1.0))
        .hover_text_matrix(hover.collect())
        .hover_info(HoverInfo::Text)
        .hover_on_gaps(false)
        .x_gap(1)
        .y_gap(1)
        .color_bar(bar);
    let mut traces: Vec<Box<dyn Trace>> = vec![heat];
    if written {
        // In white on dark cells.
        for dark in [false, true] {
            let chosen = |value: f64| value > 0.0 && (value > most / 2.0) == dark;
            let (mut at, mut words) = (Vec::new(), Vec::new());
            for (y, row) in cells.iter().enumerate() {
                for (x, value) in row.iter().enumerate() {
                    if let Some(value) = value.filter(|&value| chosen(value)) {
                        at.push([x as f64, y as f64]);
                        words.push(value.to_string());
                    }
                }
            }
            let [x, y] = columns(at.into_iter());
            let font = Font::new().size(10).color(if dark { "#ffffff" } else { "#000000" });
            let written = Scatter::new(x, y).mode(Mode::Text).text_array(words).text_font(font);
            traces.push(written.hover_info(HoverInfo::Skip).show_legend(false));
        }
    }
    traces
}

fn dash_type(dash: Dash) -> DashType {
    match dash {
        Dash::Solid => DashType::Solid,
        Dash::Dashed => DashType::Dash,
        Dash::Dotted => DashType::Dot,
        Dash::Mixed => DashType::DashDot,
    }
}

fn marker(symbol: Symbol) -> (MarkerSymbol, usize) {
    match symbol {
        Symbol::Circle => (MarkerSymbol::Circle, 7),
        Symbol::Triangle => (MarkerSymbol::TriangleUp, 8),
        Symbol::Dot => (MarkerSymbol::Circle, 3),
    }
}

fn layout(figure: &Figure, panel: &Panel) -> Layout {
    let extent = |axis: usize| panel.series.iter().flat_map(move |s| s.marks.extent().map(move |p| p[axis]));
    let named = panel.series.iter().any(|series| !series.name.is_empty());
    let legend = Legend::new().orientation(Orientation::Horizontal).x(0.0).y(1.0);
    let legend = legend.x_anchor(plotly::common::Anchor::Left).y_anchor(plotly::common::Anchor::Bottom);
    let top = if panel.title.is_empty() && !named { 12 } else { 30 };
    let mut layout = Layout::new()
        .width(figure.panel_width() as usize)
        .height(panel.height as usize)
        .auto_size(false)
        .margin(Margin::new().left(56).right(16).top(top).bottom(46).auto_expand(true))
        .font(Font::new().family("system-ui, sans-serif").size(12).color("#1a1a1a"))
        .paper_background_color("#ffffff")
        .plot_background_color("#ffffff")
        .hover_mode(HoverMode::Closest)
        .show_legend(named && figure.panels.len() == 1)
        .legend(legend)
        .x_axis(axis(&panel.x, panel.x.range(extent(0)), true))
        .y_axis(axis(&panel.y, panel.y.range(extent(1)), false));
    if !panel.title.is_empty() {
        let title = plotly::common::Title::with_text(text(&panel.title)).font(Font::new().size(13));
        layout = layout.title(title.x(0.5));
    }
    layout
}

fn axis(axis: &Axis, [low, high]: [f64; 2], horizontal: bool) -> PlotlyAxis {
    let plotly = PlotlyAxis::new()
        .title(text(&axis.title()))
        .show_line(true)
        .line_color("#1a1a1a")
        .ticks(TicksDirection::Outside)
        .tick_length(4)
        .zero_line(false)
        .auto_margin(true);
    match &axis.scale {
        Scale::Numbers(_) => plotly.range(AxisRange::new(low, high)).grid_color("#e4e4e4"),
        Scale::Names(names) => {
            let shown: Vec<String> = names.iter().map(|name| text(&shortened(name, NAME_LENGTH))).collect();
            let plotly = plotly
                .tick_mode(TickMode::Array)
                .tick_values((0..names.len()).map(|place| place as f64).collect())
                .tick_text(shown)
                .tick_font(Font::new().size(if names.len() > 24 { 9 } else { 11 }))
                .show_grid(false);
            match horizontal {
                true if names.len() > 6 => plotly.range(AxisRange::new(low, high)).tick_angle(-90.0),
                true => plotly.range(AxisRange::new(low, high)),
                // The first name stands at the top.
                false => plotly.range(AxisRange::new(high, low)),
            }
        }
    }
}
