//! SVG that stands in a page: its colours are classes, so that they follow the page, and marks of one kind are one path.

use std::fmt::Write as _;

use plotters::style::text_anchor::HPos;

use super::backend::{Backend, Ink, Pen, Place, Words};
use super::canvas::{Area, size};
use crate::report::escape::escaped;
use crate::report::palette::{Rgb, class, css};

/// A canvas of that many pixels, written to `out` as one element; `attributes` are its own.
pub(super) fn area<'a>(
    out: &'a mut String,
    width: f64,
    height: f64,
    attributes: &str,
) -> Area<Backend<Inline<'a>>> {
    let (across, down) = size(width, height);
    // Writing to a String cannot fail.
    let _ = write!(
        out,
        "<svg viewBox=\"0 0 {across} {down}\" width=\"{width}\" height=\"{height}\" {attributes}>"
    );
    Area::new(Backend { pen: Inline { out, path: None }, size: (across, down) })
}

/// How the marks of a path are drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Mark {
    Line {
        width: u32,
        ink: Ink,
    },
    Area {
        ink: Ink,
    },
    /// Circles, as lines without length that have round ends.
    Dots {
        width: u32,
        ink: Ink,
    },
}

/// Writes SVG.
pub(super) struct Inline<'a> {
    out: &'a mut String,
    /// The path that is being written.
    path: Option<(Mark, String)>,
}

impl Inline<'_> {
    /// The path of such marks: that of the mark before, if it is of the same kind.
    fn path(&mut self, mark: Mark) -> &mut String {
        if self.path.as_ref().is_some_and(|(of, _)| *of != mark) {
            self.close();
        }
        let (_, path) = self.path.get_or_insert_with(|| (mark, String::new()));
        path
    }

    fn close(&mut self) {
        let Some((mark, path)) = self.path.take() else { return };
        let (paint, ink, more) = match mark {
            Mark::Line { width, ink } => ("stroke", ink, format!(" fill=\"none\" stroke-width=\"{width}\"")),
            Mark::Area { ink } => ("fill", ink, String::new()),
            Mark::Dots { width, ink } => {
                ("stroke", ink, format!(" fill=\"none\" stroke-width=\"{width}\" stroke-linecap=\"round\""))
            }
        };
        let opacity = match ink.opacity {
            1.0 => String::new(),
            opacity => format!(" {paint}-opacity=\"{opacity}\""),
        };
        let _ = write!(self.out, "<path {}{opacity}{more} d=\"{path}\"/>", painted(paint, ink.rgb));
    }
}

/// The attribute that gives a mark its colour.
fn painted(paint: &str, rgb: Rgb) -> String {
    match class(rgb) {
        Some(name) => format!("class=\"{}-{name}\"", if paint == "fill" { "f" } else { "l" }),
        None => format!("{paint}=\"{}\"", css(rgb)),
    }
}

/// A line through places, each by its distance from the one before.
fn write_line(path: &mut String, places: &[Place]) {
    let mut before = (0, 0);
    for (index, &(x, y)) in places.iter().enumerate() {
        let (dx, dy) = (x - before.0, y - before.1);
        let _ = match index {
            0 => write!(path, "M{x} {y}"),
            _ if dy == 0 => write!(path, "h{dx}"),
            _ if dx == 0 => write!(path, "v{dy}"),
            _ if dy < 0 => write!(path, "l{dx}{dy}"),
            _ => write!(path, "l{dx} {dy}"),
        };
        before = (x, y);
    }
}

impl Pen for Inline<'_> {
    fn stroke(&mut self, line: &[Place], width: u32, ink: Ink) {
        write_line(self.path(Mark::Line { width, ink }), line);
    }

    fn fill(&mut self, corners: &[Place], ink: Ink) {
        let path = self.path(Mark::Area { ink });
        write_line(path, corners);
        path.push('z');
    }

    fn dot(&mut self, (x, y): Place, radius: u32, ink: Ink) {
        let _ = write!(self.path(Mark::Dots { width: 2 * radius, ink }), "M{x} {y}h0");
    }

    fn write(&mut self, words: Words<'_>) {
        self.close();
        let Words { text, at: (x, y), size, anchor, is_upwards, ink } = words;
        let anchor = match anchor {
            HPos::Left => "",
            HPos::Center => " text-anchor=\"middle\"",
            HPos::Right => " text-anchor=\"end\"",
        };
        // Capitals are about 0.7 of the type's height.
        let lower = (0.35 * size).round() as i32;
        let place = match is_upwards {
            true => format!("transform=\"translate({} {y}) rotate(-90)\"", x + lower),
            false => format!("x=\"{x}\" y=\"{}\"", y + lower),
        };
        let (paint, size, text) = (painted("fill", ink.rgb), size.round(), escaped(text));
        let _ = write!(self.out, "<text {place} font-size=\"{size}\"{anchor} {paint}>{text}</text>");
    }

    fn end(&mut self) {
        self.close();
        self.out.push_str("</svg>");
    }
}
