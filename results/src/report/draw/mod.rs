//! Figures drawn: as SVG and PDF files, for papers, and panel by panel as SVG in a page.

mod backend;
mod canvas;
mod frame;
mod helvetica;
mod inline;
mod marks;
mod pdf;
mod shape;

use canvas::{Area, At, Canvas, Drawn};
use frame::Frame;
use plotters::prelude::{DrawingBackend, SVGBackend};

use super::escape::escaped;
use super::figure::{Colour, Figure, Panel, Series, WIDTH};
use crate::error::Error;

/// Height of a line of the legend, pixels.
const LEGEND_LINE: f64 = 18.0;

/// The figure as a whole SVG document.
///
/// # Errors
/// If it cannot be drawn.
pub(crate) fn svg(figure: &Figure) -> Result<String, Error> {
    let layout = Layout::new(figure);
    let mut text = String::new();
    layout.draw(&Area::new(SVGBackend::with_string(&mut text, canvas::size(layout.width, layout.height))))?;
    titled(&text, layout.width, layout.height, &figure.title)
        .ok_or_else(|| failed(figure, "no root element".to_owned()))
}

/// Whether a text begins as every document of [`svg`] does.
pub(crate) fn begins_svg(text: &str) -> bool {
    text.starts_with("<svg width=\"")
        && text.contains("xmlns=\"http://www.w3.org/2000/svg\" role=\"img\">\n<title>")
}

/// The figure as a PDF document.
///
/// # Errors
/// If it cannot be drawn.
pub(crate) fn pdf(figure: &Figure) -> Result<Vec<u8>, Error> {
    let layout = Layout::new(figure);
    let mut bytes = Vec::new();
    layout.draw(&pdf::area(&mut bytes, layout.width, layout.height, &figure.title))?;
    Ok(bytes)
}

/// Whether a text begins as every document of [`pdf`] does.
pub(crate) fn begins_pdf(text: &str) -> bool {
    text.starts_with(pdf::BEGINNING)
}

/// A panel of a figure as an element of a page, `width` pixels wide. `classes` are its own, `label` is its name for those
/// who do not see it.
///
/// # Errors
/// If it cannot be drawn.
pub(crate) fn panel(
    figure: &Figure,
    panel: &Panel,
    width: u32,
    classes: &str,
    label: &str,
) -> Result<String, Error> {
    let (width, height) = (f64::from(width), f64::from(panel.height));
    let mut text = String::new();
    let attributes = format!("class=\"{classes}\" role=\"img\" aria-label=\"{}\"", escaped(label));
    let area = inline::area(&mut text, width, height, &attributes);
    draw_panel(&area, panel, [0.0, 0.0], width)
        .and_then(|()| area.finish())
        .map_err(|error| failed(figure, error))?;
    drop(area);
    Ok(text)
}

/// A series' sample of the legend as a small picture, to stand in a line of HTML.
pub(crate) fn sample(series: &Series) -> String {
    let mut text = String::new();
    let area = inline::area(&mut text, 24.0, 14.0, "aria-hidden=\"true\"");
    // Drawing into a String cannot fail; without its sample a name still is a name.
    let _ = marks::draw_sample(&area, series, [1.0, 7.0]).and_then(|()| area.finish());
    drop(area);
    text
}

/// What the legend names: each name once.
pub(crate) fn legend(figure: &Figure) -> Vec<&Series> {
    let mut entries: Vec<&Series> = Vec::new();
    for series in figure.panels.iter().flat_map(|panel| &panel.series) {
        let met = entries.iter().any(|entry| entry.name == series.name);
        if !series.name.is_empty() && !met && !series.marks.is_empty() {
            entries.push(series);
        }
    }
    entries
}

fn failed(figure: &Figure, message: String) -> Error {
    Error::Drawing { figure: figure.id.clone(), message }
}

/// A figure with its legend, laid out on one sheet.
struct Layout<'a> {
    figure: &'a Figure,
    legend: Vec<Vec<&'a Series>>,
    /// Heights of the rows of panels.
    rows: Vec<u32>,
    width: f64,
    height: f64,
}

impl<'a> Layout<'a> {
    fn new(figure: &'a Figure) -> Self {
        let legend = legend_lines(&legend(figure));
        let rows = figure.panels.chunks(figure.columns.max(1));
        let rows: Vec<u32> =
            rows.map(|row| row.iter().map(|panel| panel.height).max().unwrap_or(0)).collect();
        let height = f64::from(rows.iter().sum::<u32>()) + LEGEND_LINE * legend.len() as f64 + 8.0;
        Self { figure, legend, rows, width: f64::from(WIDTH), height }
    }

    fn draw<B: DrawingBackend>(&self, area: &Area<B>) -> Result<(), Error> {
        let draw = || {
            area.background()?;
            for (line, entries) in self.legend.iter().enumerate() {
                draw_legend(area, entries, 8.0 + LEGEND_LINE * (line as f64 + 0.5))?;
            }
            let mut top = LEGEND_LINE * self.legend.len() as f64 + 4.0;
            let width = f64::from(self.figure.panel_width());
            for (row, panels) in self.rows.iter().zip(self.figure.panels.chunks(self.figure.columns.max(1))) {
                for (column, panel) in panels.iter().enumerate() {
                    draw_panel(area, panel, [column as f64 * width, top], width)?;
                }
                top += f64::from(*row);
            }
            area.finish()
        };
        draw().map_err(|error| failed(self.figure, error))
    }
}

fn draw_panel(canvas: &dyn Canvas, panel: &Panel, corner: [f64; 2], width: f64) -> Drawn {
    let frame = Frame::new(panel, corner, width);
    frame.draw_grid(canvas)?;
    panel.series.iter().try_for_each(|series| marks::draw(canvas, &frame, series))?;
    frame.draw_axes(canvas)
}

/// Width of an entry of the legend: its sample, its name and the space after it.
fn entry_width(series: &Series) -> f64 {
    28.0 + canvas::text_width(&series.name, 11.0) + 16.0
}

fn legend_lines<'a>(entries: &[&'a Series]) -> Vec<Vec<&'a Series>> {
    let room = f64::from(WIDTH) - 64.0;
    let mut lines: Vec<Vec<&Series>> = Vec::new();
    let mut used = f64::INFINITY;
    for &entry in entries {
        let width = entry_width(entry);
        if used + width > room {
            lines.push(Vec::new());
            used = 0.0;
        }
        used += width;
        if let Some(line) = lines.last_mut() {
            line.push(entry);
        }
    }
    lines
}

fn draw_legend(canvas: &dyn Canvas, entries: &[&Series], y: f64) -> Drawn {
    let mut x = 56.0;
    for series in entries {
        marks::draw_sample(canvas, series, [x, y])?;
        canvas.text(&series.name, [x + 28.0, y], 11.0, At::Left, Colour::Black.rgb())?;
        x += entry_width(series);
    }
    Ok(())
}

/// The document with its size in pixels and a title for those who do not see it; `None` if it has no root.
fn titled(document: &str, width: f64, height: f64, title: &str) -> Option<String> {
    let (root, content) = document.split_once('>')?;
    let view_box = root.find("viewBox=")?;
    let (width, height) = (width.round(), height.round());
    Some(format!(
        "<svg width=\"{width}\" height=\"{height}\" {} role=\"img\">\n<title>{}</title>{content}",
        &root[view_box..],
        escaped(title)
    ))
}

#[cfg(test)]
mod tests;
