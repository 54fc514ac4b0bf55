//! A backend of plotters that hands on the few things that figures are made of to a pen.

use std::convert::Infallible;

use plotters::style::text_anchor::HPos;
use plotters_backend::{
    BackendColor, BackendCoord, BackendStyle, BackendTextStyle, DrawingBackend, DrawingErrorKind,
    FontTransform,
};

use super::canvas::TEXT_UNIT;
use crate::report::palette::Rgb;

/// A place on the canvas, in its units.
pub(super) type Place = (i32, i32);

/// A colour with its opacity from 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Ink {
    pub rgb: Rgb,
    pub opacity: f64,
}

/// A text whose middle is at the height of its place.
pub(super) struct Words<'a> {
    pub text: &'a str,
    pub at: Place,
    /// Height of the type, units.
    pub size: f64,
    /// Which part of it is at its place.
    pub anchor: HPos,
    /// Whether it is read from below.
    pub is_upwards: bool,
    pub ink: Ink,
}

/// What writes a figure down.
pub(super) trait Pen {
    /// A line through places.
    fn stroke(&mut self, line: &[Place], width: u32, ink: Ink);

    /// A filled polygon.
    fn fill(&mut self, corners: &[Place], ink: Ink);

    /// A filled circle.
    fn dot(&mut self, centre: Place, radius: u32, ink: Ink);

    /// A text.
    fn write(&mut self, words: Words<'_>);

    /// The end of the figure.
    fn end(&mut self);
}

/// The backend.
pub(super) struct Backend<P> {
    pub pen: P,
    pub size: (u32, u32),
}

type Done = Result<(), DrawingErrorKind<Infallible>>;

fn ink(color: BackendColor) -> Ink {
    Ink { rgb: color.rgb.into(), opacity: color.alpha }
}

impl<P: Pen> DrawingBackend for Backend<P> {
    type ErrorType = Infallible;

    fn get_size(&self) -> (u32, u32) {
        self.size
    }

    fn ensure_prepared(&mut self) -> Done {
        Ok(())
    }

    fn present(&mut self) -> Done {
        self.pen.end();
        Ok(())
    }

    fn draw_pixel(&mut self, (x, y): BackendCoord, color: BackendColor) -> Done {
        self.pen.fill(&[(x, y), (x + 1, y), (x + 1, y + 1), (x, y + 1)], ink(color));
        Ok(())
    }

    fn draw_line<S: BackendStyle>(&mut self, from: BackendCoord, to: BackendCoord, style: &S) -> Done {
        self.draw_path([from, to], style)
    }

    fn draw_rect<S: BackendStyle>(
        &mut self,
        (left, top): BackendCoord,
        (right, bottom): BackendCoord,
        style: &S,
        fill: bool,
    ) -> Done {
        let corners = [(left, top), (right, top), (right, bottom), (left, bottom)];
        if fill {
            self.pen.fill(&corners, ink(style.color()));
            return Ok(());
        }
        self.draw_path(corners.into_iter().chain([(left, top)]), style)
    }

    fn draw_path<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(
        &mut self,
        path: I,
        style: &S,
    ) -> Done {
        let line: Vec<Place> = path.into_iter().collect();
        self.pen.stroke(&line, style.stroke_width(), ink(style.color()));
        Ok(())
    }

    fn draw_circle<S: BackendStyle>(
        &mut self,
        center: BackendCoord,
        radius: u32,
        style: &S,
        _fill: bool, // figures have no other
    ) -> Done {
        self.pen.dot(center, radius, ink(style.color()));
        Ok(())
    }

    fn fill_polygon<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(
        &mut self,
        path: I,
        style: &S,
    ) -> Done {
        let corners: Vec<Place> = path.into_iter().collect();
        self.pen.fill(&corners, ink(style.color()));
        Ok(())
    }

    fn draw_text<S: BackendTextStyle>(&mut self, text: &str, style: &S, at: BackendCoord) -> Done {
        let is_upwards = matches!(style.transform(), FontTransform::Rotate270);
        let (anchor, size) = (style.anchor().h_pos, style.size() / TEXT_UNIT);
        self.pen.write(Words { text, at, size, anchor, is_upwards, ink: ink(style.color()) });
        Ok(())
    }
}
