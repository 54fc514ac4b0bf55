//! Figures as SVG files, for papers.

mod canvas;
mod frame;
mod marks;

use canvas::Canvas;
use frame::Frame;

use super::figure::{Colour, Figure, Marks, Series, WIDTH, printable};
use crate::error::Error;

/// Height of a line of the legend, pixels.
const LEGEND_LINE: f64 = 18.0;

/// The figure as a whole SVG document.
pub(crate) fn document(figure: &Figure) -> Result<String, Error> {
    let entries = legend(figure);
    let lines = legend_lines(&entries);
    let columns = figure.columns.max(1);
    let rows: Vec<u32> = figure
        .panels
        .chunks(columns)
        .map(|row| row.iter().map(|panel| panel.height).max().unwrap_or(0))
        .collect();
    let legend_height = LEGEND_LINE * lines.len() as f64;
    let height = f64::from(rows.iter().sum::<u32>()) + legend_height + 8.0;
    let mut text = String::new();
    let failed = |error: &dyn std::fmt::Display| Error::Drawing {
        figure: figure.id.clone(),
        message: error.to_string(),
    };
    {
        let canvas = Canvas::new(&mut text, f64::from(WIDTH), height);
        let draw = || {
            canvas.background()?;
            for (line, entries) in lines.iter().enumerate() {
                draw_legend(&canvas, entries, 8.0 + LEGEND_LINE * (line as f64 + 0.5))?;
            }
            let mut top = legend_height + 4.0;
            for (row, panels) in rows.iter().zip(figure.panels.chunks(columns)) {
                for (column, panel) in panels.iter().enumerate() {
                    let width = f64::from(figure.panel_width());
                    let frame = Frame::new(panel, [column as f64 * width, top], width);
                    frame.draw_grid(&canvas)?;
                    for series in &panel.series {
                        marks::draw(&canvas, &frame, series)?;
                    }
                    frame.draw_axes(&canvas)?;
                }
                top += f64::from(*row);
            }
            canvas.finish()
        };
        draw().map_err(|error| failed(&error))?;
    }
    canvas::titled(&text, f64::from(WIDTH), height, &figure.title).ok_or_else(|| failed(&"no root element"))
}

/// Whether a text begins as every document of [`document`] does.
pub(crate) fn begins_document(text: &str) -> bool {
    text.starts_with("<svg width=\"")
        && text.contains("xmlns=\"http://www.w3.org/2000/svg\" role=\"img\">\n<title>")
}

/// A series' sample of the legend as a small picture, to stand in a line of HTML.
pub(crate) fn sample(series: &Series) -> String {
    let mut text = String::new();
    {
        let canvas = Canvas::new(&mut text, 24.0, 14.0);
        // Drawing into a String cannot fail; without its sample a name still is a name.
        let _ = marks::draw_sample(&canvas, series, [1.0, 7.0]).and_then(|()| canvas.finish());
    }
    canvas::titled(&text, 24.0, 14.0, &series.name).unwrap_or_default()
}

/// What the legend names: each name once.
fn legend(figure: &Figure) -> Vec<&Series> {
    let mut entries: Vec<&Series> = Vec::new();
    for series in figure.panels.iter().flat_map(|panel| &panel.series) {
        let met = entries.iter().any(|entry| entry.name == series.name);
        if !series.name.is_empty() && !met && !series.marks.is_empty() {
            entries.push(series);
        }
    }
    entries
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

fn draw_legend(canvas: &Canvas<'_>, entries: &[&Series], y: f64) -> canvas::Drawn {
    let mut x = 56.0;
    for series in entries {
        marks::draw_sample(canvas, series, [x, y])?;
        canvas.text(&series.name, [x + 28.0, y], 11.0, canvas::At::Left, Colour::Black.rgb())?;
        x += entry_width(series);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::figure::{Axis, Dash, Panel, Symbol};
    use super::*;

    fn figure(name: &str) -> Figure {
        let series = vec![
            Series::band(name, Colour::Blue, vec![[0.0, 1.0, 2.0], [1.0, 1.5, 3.0]]),
            Series::dashed(name, Colour::Blue, Dash::Dashed, vec![[0.0, 1.0], [1.0, 2.0]]),
            Series::points("b", Colour::Green, Symbol::Triangle, vec![[0.5, 0.5]]),
            Series::segments("", Colour::Black, 5, vec![[[0.0, 1.0], [1.0, 1.0]]]),
        ];
        let [x, y] = ["x", "y"].map(|label| Axis::numbers(label, "cm"));
        let numbers = Panel { title: name.to_owned(), x, y, series, height: 200 };
        let cells = vec![vec![Some(1.0), None], vec![Some(0.0), Some(3.0)]];
        let marks = Marks::Matrix { cells, unit: "clouds".to_owned(), written: true };
        let names = || Axis::names(name, vec![name.to_owned(), "other".to_owned()]);
        let series = vec![Series { name: String::new(), colour: Colour::Blue, marks }];
        let matrix = Panel { title: String::new(), x: names(), y: names(), series, height: 300 };
        let panels = vec![numbers, matrix];
        Figure { id: "test".to_owned(), title: name.to_owned(), caption: String::new(), panels, columns: 2 }
    }

    /// Every tag that is opened is closed in order, and nothing that came from outside is a tag.
    #[track_caller]
    fn expect_well_formed(document: &str) {
        let mut open: Vec<&str> = Vec::new();
        let mut rest = document;
        while let Some((before, after)) = rest.split_once('<') {
            assert!(!before.contains('>'), "{before:?}");
            let (tag, after) = after.split_once('>').expect("an end of the tag");
            assert_eq!(tag.matches('"').count() % 2, 0, "{tag}");
            match tag.strip_prefix('/') {
                Some(name) => assert_eq!(open.pop(), Some(name)),
                None if tag.ends_with('/') => {}
                None => open.push(tag.split(' ').next().expect("a name")),
            }
            rest = after;
        }
        assert!(open.is_empty() && rest.trim().is_empty(), "{open:?} {rest:?}");
        assert!(!document.chars().any(|c| c.is_control() && c != '\n'));
    }

    #[test]
    fn documents_are_well_formed_whatever_names_are() {
        for name in ["plain", "<script>alert(1)</script>", "a & \"b\" 'c'", "größe 物体", "\u{0}\u{1b}", ""]
        {
            let document = document(&figure(name)).unwrap();
            expect_well_formed(&document);
            assert!(document.starts_with("<svg ") && !document.contains("<script"), "{document}");
        }
    }

    #[test]
    fn figures_without_marks_or_panels_are_documents_too() {
        let mut figure = figure("empty");
        figure.panels.truncate(1);
        figure.panels[0].series.clear();
        expect_well_formed(&document(&figure).unwrap());
        figure.panels.clear();
        expect_well_formed(&document(&figure).unwrap());
    }

    #[test]
    fn the_legend_names_everything_once_and_wraps() {
        let figure = figure("a");
        assert_eq!(legend(&figure).iter().map(|entry| entry.name.as_str()).collect::<Vec<_>>(), ["a", "b"]);
        let entries: Vec<&Series> = legend(&figure).into_iter().cycle().take(40).collect();
        let lines = legend_lines(&entries);
        assert!(lines.len() > 1);
        assert_eq!(lines.iter().map(Vec::len).sum::<usize>(), 40);
    }
}
