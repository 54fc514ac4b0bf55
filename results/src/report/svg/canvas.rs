//! A canvas with fractional pixels over plotters, which rounds to whole units.

use plotters::coord::Shift;
use plotters::drawing::DrawingAreaErrorKind;
use plotters::element::{Circle, DashedPathElement, PathElement, Polygon, Rectangle, Text, TriangleMarker};
use plotters::prelude::{DrawingArea, DrawingBackend, IntoDrawingArea as _, SVGBackend};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{FontFamily, FontStyle, FontTransform, RGBAColor, ShapeStyle, TextStyle};

use super::super::figure::{Dash, Symbol};
use super::printable;

/// Units per pixel: fine enough that rounding is invisible.
const UNITS: f64 = 10.0;

/// Size that plotters takes for text of one unit.
const TEXT_UNIT: f64 = 1.24;

pub(super) type Failure = DrawingAreaErrorKind<<SVGBackend<'static> as DrawingBackend>::ErrorType>;
pub(super) type Drawn = Result<(), Failure>;

/// Where a text's position is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum At {
    /// Its left end.
    Left,
    /// Its middle.
    Centre,
    /// Its right end.
    Right,
    /// Its middle, read from below.
    CentreUpwards,
    /// Its upper end, read from below.
    TopUpwards,
}

/// The canvas.
pub(super) struct Canvas<'a> {
    area: DrawingArea<SVGBackend<'a>, Shift>,
}

fn units([x, y]: [f64; 2]) -> (i32, i32) {
    ((x * UNITS).round() as i32, (y * UNITS).round() as i32)
}

fn style([r, g, b]: [u8; 3], opacity: f64, width: f64) -> ShapeStyle {
    ShapeStyle { color: RGBAColor(r, g, b, opacity), filled: false, stroke_width: (width * UNITS) as u32 }
}

impl<'a> Canvas<'a> {
    /// A white canvas of that size that is written to `text`.
    pub fn new(text: &'a mut String, width: f64, height: f64) -> Self {
        let size = ((width * UNITS) as u32, (height * UNITS) as u32);
        Self { area: SVGBackend::with_string(text, size).into_drawing_area() }
    }

    /// White.
    pub fn background(&self) -> Drawn {
        self.area.fill(&RGBAColor(255, 255, 255, 1.0))
    }

    /// A line through points.
    pub fn line(&self, points: &[[f64; 2]], rgb: [u8; 3], width: f64, dash: Dash) -> Drawn {
        let points: Vec<(i32, i32)> = points.iter().map(|&point| units(point)).collect();
        let style = style(rgb, 1.0, width);
        let (on, off) = match dash {
            _ if points.len() < 2 => return Ok(()),
            Dash::Solid => return self.area.draw(&PathElement::new(points, style)),
            Dash::Dashed => (60, 40),
            Dash::Dotted => (18, 30),
            Dash::Mixed => (90, 24),
        };
        self.area.draw(&DashedPathElement::new(points, on, off, style))
    }

    /// A filled polygon.
    pub fn polygon(&self, corners: &[[f64; 2]], rgb: [u8; 3], opacity: f64) -> Drawn {
        let corners: Vec<(i32, i32)> = corners.iter().map(|&corner| units(corner)).collect();
        self.area.draw(&Polygon::new(corners, style(rgb, opacity, 0.0).filled()))
    }

    /// A filled rectangle.
    pub fn rectangle(&self, corner: [f64; 2], opposite: [f64; 2], rgb: [u8; 3]) -> Drawn {
        self.area.draw(&Rectangle::new([units(corner), units(opposite)], style(rgb, 1.0, 0.0).filled()))
    }

    /// A point.
    pub fn symbol(&self, at: [f64; 2], symbol: Symbol, rgb: [u8; 3]) -> Drawn {
        let (at, filled) = (units(at), style(rgb, 0.85, 1.0).filled());
        match symbol {
            Symbol::Circle => self.area.draw(&Circle::new(at, 34, filled)),
            Symbol::Dot => self.area.draw(&Circle::new(at, 15, filled)),
            Symbol::Triangle => self.area.draw(&TriangleMarker::new(at, 45, filled)),
        }
    }

    /// A text whose middle is at the height of its position.
    pub fn text(&self, text: &str, position: [f64; 2], size: f64, at: At, rgb: [u8; 3]) -> Drawn {
        let (horizontal, transform) = match at {
            At::Left => (HPos::Left, FontTransform::None),
            At::Centre => (HPos::Center, FontTransform::None),
            At::Right => (HPos::Right, FontTransform::None),
            At::CentreUpwards => (HPos::Center, FontTransform::Rotate270),
            At::TopUpwards => (HPos::Right, FontTransform::Rotate270),
        };
        let font = (FontFamily::SansSerif, size * UNITS * TEXT_UNIT, FontStyle::Normal);
        let ink = RGBAColor(rgb[0], rgb[1], rgb[2], 1.0);
        let style =
            TextStyle::from(font).color(&ink).transform(transform).pos(Pos::new(horizontal, VPos::Center));
        self.area.draw(&Text::new(printable(text), units(position), style))
    }

    /// Writes it.
    pub fn finish(&self) -> Drawn {
        self.area.present()
    }
}

/// Width of a text in pixels, by what letters of a sans-serif typeface take: no font is at hand.
pub(super) fn text_width(text: &str, size: f64) -> f64 {
    let width = |c: char| match c {
        'i' | 'j' | 'l' | '.' | ',' | ':' | ';' | '\'' | '|' | '!' | ' ' => 0.32,
        'f' | 't' | 'r' | '(' | ')' | '-' | '/' => 0.4,
        'm' | 'w' | 'M' | 'W' | '%' | '@' => 0.88,
        c if c.is_ascii_uppercase() => 0.68,
        c if c.is_ascii() => 0.57,
        // Latin letters with accents are as wide as without; writing of East Asia fills a square.
        c if u32::from(c) < 0x1100 => 0.6,
        _ => 1.0,
    };
    text.chars().map(width).sum::<f64>() * size
}

/// The document with its size in pixels and a title for those who do not see it; `None` if it has no root.
pub(super) fn titled(document: &str, width: f64, height: f64, title: &str) -> Option<String> {
    let (root, content) = document.split_once('>')?;
    let view_box = root.find("viewBox=")?;
    let title: String = printable(title)
        .chars()
        .map(|c| match c {
            '<' => "&lt;".to_owned(),
            '>' => "&gt;".to_owned(),
            '&' => "&amp;".to_owned(),
            c => c.to_string(),
        })
        .collect();
    let (width, height) = (width.round(), height.round());
    Some(format!(
        "<svg width=\"{width}\" height=\"{height}\" {} role=\"img\">\n<title>{title}</title>{content}",
        &root[view_box..]
    ))
}
