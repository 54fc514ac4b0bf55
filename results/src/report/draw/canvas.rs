//! A canvas with fractional pixels over plotters, which rounds to whole units.

use plotters::coord::Shift;
use plotters::element::{
    Circle, DashedPathElement, Drawable, PathElement, PointCollection, Polygon, Rectangle, Text,
    TriangleMarker,
};
use plotters::prelude::{DrawingArea, DrawingBackend, IntoDrawingArea as _};
use plotters::style::text_anchor::{HPos, Pos, VPos};
use plotters::style::{FontFamily, FontStyle, FontTransform, RGBAColor, ShapeStyle, TextStyle};

use super::super::figure::{Dash, Symbol, printable};
use super::super::palette::Rgb;

/// Units per pixel: fine enough that rounding is invisible.
pub(super) const UNITS: f64 = 10.0;

/// Size that plotters takes for text of one unit.
pub(super) const TEXT_UNIT: f64 = 1.24;

/// What drawing gives: why it failed, if it did.
pub(super) type Drawn = Result<(), String>;

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

/// What figures are drawn on. Positions are in pixels, y downwards.
pub(super) trait Canvas {
    /// A line through points.
    fn line(&self, points: &[[f64; 2]], rgb: Rgb, width: f64, dash: Dash) -> Drawn;

    /// A filled polygon.
    fn polygon(&self, corners: &[[f64; 2]], rgb: Rgb, opacity: f64) -> Drawn;

    /// A filled rectangle.
    fn rectangle(&self, corner: [f64; 2], opposite: [f64; 2], rgb: Rgb) -> Drawn;

    /// A point.
    fn symbol(&self, at: [f64; 2], symbol: Symbol, rgb: Rgb) -> Drawn;

    /// A filled circle.
    fn dot(&self, at: [f64; 2], radius: f64, rgb: Rgb, opacity: f64) -> Drawn;

    /// A text whose middle is at the height of its position.
    fn text(&self, text: &str, position: [f64; 2], size: f64, at: At, rgb: Rgb) -> Drawn;
}

/// The area of a backend as a canvas.
pub(super) struct Area<B: DrawingBackend>(DrawingArea<B, Shift>);

/// A size in pixels as backends have it.
pub(super) fn size(width: f64, height: f64) -> (u32, u32) {
    ((width * UNITS) as u32, (height * UNITS) as u32)
}

fn units([x, y]: [f64; 2]) -> (i32, i32) {
    ((x * UNITS).round() as i32, (y * UNITS).round() as i32)
}

fn style([r, g, b]: Rgb, opacity: f64, width: f64) -> ShapeStyle {
    ShapeStyle { color: RGBAColor(r, g, b, opacity), filled: false, stroke_width: (width * UNITS) as u32 }
}

impl<B: DrawingBackend> Area<B> {
    /// All of a backend.
    pub fn new(backend: B) -> Self {
        Self(backend.into_drawing_area())
    }

    /// White.
    pub fn background(&self) -> Drawn {
        self.0.fill(&RGBAColor(255, 255, 255, 1.0)).map_err(|error| error.to_string())
    }

    /// Writes it.
    pub fn finish(&self) -> Drawn {
        self.0.present().map_err(|error| error.to_string())
    }

    fn draw<'a, E>(&self, element: &'a E) -> Drawn
    where
        &'a E: PointCollection<'a, (i32, i32)>,
        E: Drawable<B>,
    {
        self.0.draw(element).map_err(|error| error.to_string())
    }
}

impl<B: DrawingBackend> Canvas for Area<B> {
    fn line(&self, points: &[[f64; 2]], rgb: Rgb, width: f64, dash: Dash) -> Drawn {
        let points: Vec<(i32, i32)> = points.iter().map(|&point| units(point)).collect();
        let style = style(rgb, 1.0, width);
        let (on, off) = match dash {
            _ if points.len() < 2 => return Ok(()),
            Dash::Solid => return self.draw(&PathElement::new(points, style)),
            Dash::Dashed => (60, 40),
            Dash::Dotted => (18, 30),
            Dash::Mixed => (90, 24),
        };
        self.draw(&DashedPathElement::new(points, on, off, style))
    }

    fn polygon(&self, corners: &[[f64; 2]], rgb: Rgb, opacity: f64) -> Drawn {
        if corners.len() < 3 {
            return Ok(());
        }
        let corners: Vec<(i32, i32)> = corners.iter().map(|&corner| units(corner)).collect();
        self.draw(&Polygon::new(corners, style(rgb, opacity, 0.0).filled()))
    }

    fn rectangle(&self, corner: [f64; 2], opposite: [f64; 2], rgb: Rgb) -> Drawn {
        self.draw(&Rectangle::new([units(corner), units(opposite)], style(rgb, 1.0, 0.0).filled()))
    }

    fn symbol(&self, at: [f64; 2], symbol: Symbol, rgb: Rgb) -> Drawn {
        let (at, filled) = (units(at), style(rgb, 0.85, 1.0).filled());
        match symbol {
            Symbol::Circle => self.draw(&Circle::new(at, 34, filled)),
            Symbol::Dot => self.draw(&Circle::new(at, 15, filled)),
            Symbol::Triangle => self.draw(&TriangleMarker::new(at, 45, filled)),
        }
    }

    fn dot(&self, at: [f64; 2], radius: f64, rgb: Rgb, opacity: f64) -> Drawn {
        let radius = (radius * UNITS).round() as i32;
        self.draw(&Circle::new(units(at), radius, style(rgb, opacity, 1.0).filled()))
    }

    fn text(&self, text: &str, position: [f64; 2], size: f64, at: At, rgb: Rgb) -> Drawn {
        if text.is_empty() {
            return Ok(());
        }
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
        self.draw(&Text::new(printable(text), units(position), style))
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
