//! Figures as PDF files: lines, areas, and text that is text.

use std::collections::BTreeMap;

use pdf_writer::types::{LineCapStyle, LineJoinStyle};
use pdf_writer::{Content, Finish as _, Name, Pdf, Rect, Ref, Str, TextStr};
use plotters::style::text_anchor::HPos;

use super::backend::{Backend, Ink, Pen, Place, Words};
use super::canvas::{Area, UNITS, size};
use super::helvetica::{encoded, width};
use crate::report::palette::Rgb;

/// How every PDF file begins.
pub(super) const BEGINNING: &str = "%PDF-1.7";

/// Points of PDF per unit: a pixel of CSS is 3/4 of a point.
const SCALE: f64 = 0.75 / UNITS;

/// Where a Bézier curve has its inner ends to be a quarter of a circle.
const QUARTER: f64 = 0.552_284_75;

const FONT: Name<'static> = Name(b"F");
const CATALOG: Ref = Ref::new(1);
const PAGES: Ref = Ref::new(2);
const PAGE: Ref = Ref::new(3);
const HELVETICA: Ref = Ref::new(4);
const CONTENT: Ref = Ref::new(5);
const INFO: Ref = Ref::new(6);
/// The first of the opacities.
const OPACITIES: i32 = 7;

/// A canvas of that many pixels, written to `out` as a document of one page.
pub(super) fn area<'a>(
    out: &'a mut Vec<u8>,
    across: f64,
    down: f64,
    title: &str,
) -> Area<Backend<Paper<'a>>> {
    let size = size(across, down);
    let mut content = Content::new();
    content.transform([SCALE as f32, 0.0, 0.0, SCALE as f32, 0.0, 0.0]);
    content.set_line_join(LineJoinStyle::RoundJoin).set_line_cap(LineCapStyle::ButtCap);
    let pen = Paper {
        out,
        title: title.to_owned(),
        size,
        content,
        opacities: BTreeMap::new(),
        now: Now::default(),
    };
    Area::new(Backend { pen, size })
}

/// What the page draws with at the moment.
#[derive(Default)]
struct Now {
    stroke: Option<Rgb>,
    fill: Option<Rgb>,
    width: Option<u32>,
    opacity: Option<u32>,
}

/// Writes a page.
pub(super) struct Paper<'a> {
    out: &'a mut Vec<u8>,
    title: String,
    size: (u32, u32),
    content: Content,
    /// Opacities in percent by the number of their object.
    opacities: BTreeMap<u32, i32>,
    now: Now,
}

fn parts(rgb: Rgb) -> [f32; 3] {
    rgb.map(|part| (f32::from(part) / 255.0 * 1000.0).round() / 1000.0)
}

impl Paper<'_> {
    /// PDF counts from below.
    fn place(&self, (x, y): Place) -> [f32; 2] {
        [x as f32, self.size.1 as f32 - y as f32]
    }

    fn set_opacity(&mut self, opacity: f64) {
        let percent = (100.0 * opacity).round() as u32;
        if self.now.opacity.replace(percent) == Some(percent) {
            return;
        }
        let next = OPACITIES + i32::try_from(self.opacities.len()).unwrap_or(0);
        self.opacities.entry(percent).or_insert(next);
        self.content.set_parameters(Name(opacity_name(percent).as_bytes()));
    }

    fn fill_with(&mut self, ink: Ink) {
        self.set_opacity(ink.opacity);
        if self.now.fill.replace(ink.rgb) != Some(ink.rgb) {
            let [r, g, b] = parts(ink.rgb);
            self.content.set_fill_rgb(r, g, b);
        }
    }

    fn stroke_with(&mut self, ink: Ink, width: u32) {
        self.set_opacity(ink.opacity);
        if self.now.stroke.replace(ink.rgb) != Some(ink.rgb) {
            let [r, g, b] = parts(ink.rgb);
            self.content.set_stroke_rgb(r, g, b);
        }
        if self.now.width.replace(width) != Some(width) {
            self.content.set_line_width(width as f32);
        }
    }

    fn draw_line(&mut self, places: &[Place]) {
        for (index, &place) in places.iter().enumerate() {
            let [x, y] = self.place(place);
            if index == 0 {
                self.content.move_to(x, y)
            } else {
                self.content.line_to(x, y)
            };
        }
    }
}

fn opacity_name(percent: u32) -> String {
    format!("O{percent}")
}

impl Pen for Paper<'_> {
    fn stroke(&mut self, line: &[Place], width: u32, ink: Ink) {
        self.stroke_with(ink, width);
        self.draw_line(line);
        self.content.stroke();
    }

    fn fill(&mut self, corners: &[Place], ink: Ink) {
        self.fill_with(ink);
        self.draw_line(corners);
        self.content.close_path().fill_nonzero();
    }

    fn dot(&mut self, centre: Place, radius: u32, ink: Ink) {
        self.fill_with(ink);
        let ([x, y], r) = (self.place(centre), radius as f32);
        let inner = (QUARTER * f64::from(radius)).round() as f32;
        self.content.move_to(x + r, y);
        let mut along = [[r, 0.0], [0.0, r]];
        for _ in 0..4 {
            let [[fx, fy], [tx, ty]] = along;
            let share = inner / r;
            self.content.cubic_to(
                x + fx + share * tx,
                y + fy + share * ty,
                x + tx + share * fx,
                y + ty + share * fy,
                x + tx,
                y + ty,
            );
            along = [[tx, ty], [-ty, tx]];
        }
        self.content.fill_nonzero();
    }

    fn write(&mut self, words: Words<'_>) {
        self.fill_with(words.ink);
        let bytes = encoded(words.text);
        let size = words.size.round();
        let back = match words.anchor {
            HPos::Left => 0.0,
            HPos::Center => 0.5,
            HPos::Right => 1.0,
        } * width(&bytes)
            * size;
        // Capitals are about 0.7 of the type's height.
        let (back, lower) = (back.round() as f32, (0.35 * size).round() as f32);
        let [x, y] = self.place(words.at);
        let matrix = match words.is_upwards {
            true => [0.0, 1.0, -1.0, 0.0, x + lower, y - back],
            false => [1.0, 0.0, 0.0, 1.0, x - back, y - lower],
        };
        self.content.begin_text().set_font(FONT, size as f32).set_text_matrix(matrix);
        self.content.show(Str(&bytes)).end_text();
    }

    fn end(&mut self) {
        let mut pdf = Pdf::new();
        pdf.catalog(CATALOG).pages(PAGES).viewer_preferences().display_doc_title(true);
        pdf.pages(PAGES).kids([PAGE]).count(1);
        let mut page = pdf.page(PAGE);
        let [across, down] = [self.size.0, self.size.1].map(|units| (f64::from(units) * SCALE) as f32);
        page.parent(PAGES).media_box(Rect::new(0.0, 0.0, across, down)).contents(CONTENT);
        let mut resources = page.resources();
        resources.fonts().pair(FONT, HELVETICA);
        let mut states = resources.ext_g_states();
        for (&percent, &number) in &self.opacities {
            states.pair(Name(opacity_name(percent).as_bytes()), Ref::new(number));
        }
        states.finish();
        resources.finish();
        page.finish();
        pdf.type1_font(HELVETICA).base_font(Name(b"Helvetica")).encoding_predefined(Name(b"WinAnsiEncoding"));
        for (&percent, &number) in &self.opacities {
            let opacity = percent as f32 / 100.0;
            pdf.ext_graphics(Ref::new(number)).stroking_alpha(opacity).non_stroking_alpha(opacity);
        }
        pdf.document_info(INFO).title(TextStr(&self.title)).producer(TextStr("descry"));
        pdf.stream(CONTENT, &std::mem::replace(&mut self.content, Content::new()).finish());
        *self.out = pdf.finish();
    }
}
