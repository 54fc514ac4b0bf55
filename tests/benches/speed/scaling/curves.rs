//! Curves of growth as an SVG: each quantity over that at the smallest size, both axes logarithmic.

use std::fmt::Write as _;

use super::series::{Growth, exponent};

/// Size of the picture, and of the field with the curves in it, pixels.
const WIDTH: f64 = 800.0;
const HEIGHT: f64 = 360.0;
const LEFT: f64 = 60.0;
const RIGHT: f64 = 420.0;
const TOP: f64 = 20.0;
const BOTTOM: f64 = 320.0;
/// Values that a line is drawn at.
const DECADES: [f64; 8] = [0.01, 0.1, 1.0, 10.0, 100.0, 1e3, 1e4, 1e5];
/// Of the curves, told apart by people who see no red or no green (Okabe, Ito).
const COLOURS: [&str; 7] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000"];

/// Where something is in the picture.
struct Scale {
    low: f64,
    high: f64,
    from: f64,
    to: f64,
}

impl Scale {
    #[expect(clippy::disallowed_methods, reason = "places a point in a picture")]
    fn place(&self, value: f64) -> f64 {
        self.from + (self.to - self.from) * (value / self.low).ln() / (self.high / self.low).ln()
    }
}

/// Draws the curves.
pub fn draw(growth: &Growth) -> String {
    let count = growth.quantities.len();
    let relative: Vec<Vec<(f64, f64)>> = (0..count)
        .map(|number| {
            let series = growth.series(number);
            series.iter().map(|&(size, value)| (size, value / series[0].1)).collect()
        })
        .collect();
    let sizes: Vec<f64> = growth.measured.iter().map(|(size, _)| *size).collect();
    let values = || relative.iter().flatten().map(|point| point.1);
    let (least, most) = (values().fold(1.0, f64::min), values().fold(2.0, f64::max));
    let x = Scale { low: sizes[0], high: sizes[sizes.len() - 1], from: LEFT, to: RIGHT };
    let y = Scale { low: least, high: most, from: BOTTOM, to: TOP };

    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" \
         font-family=\"sans-serif\" font-size=\"12\">\n<rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n"
    );
    for &size in &sizes {
        let (at, under) = (x.place(size), BOTTOM + 16.0);
        line(&mut svg, [at, TOP, at, BOTTOM]);
        text(&mut svg, [at, under], "middle", &format!("{size:.0}"));
    }
    text(&mut svg, [(LEFT + RIGHT) / 2.0, BOTTOM + 34.0], "middle", growth.unit);
    for value in DECADES.into_iter().filter(|value| (least..=most).contains(value)) {
        let at = y.place(value);
        line(&mut svg, [LEFT, at, RIGHT, at]);
        text(
            &mut svg,
            [LEFT - 6.0, at + 4.0],
            "end",
            &if value < 1e4 { format!("×{value}") } else { format!("×{value:e}") },
        );
    }
    // What lies highest at the end comes first in the legend.
    let mut order: Vec<usize> = (0..count).collect();
    let last = |number: usize| relative[number].last().map_or(0.0, |point| point.1);
    order.sort_by(|&a, &b| last(b).total_cmp(&last(a)));
    for (place, &number) in order.iter().enumerate() {
        let colour = COLOURS[number % COLOURS.len()];
        let points = relative[number]
            .iter()
            .map(|&(size, value)| format!("{:.1},{:.1}", x.place(size), y.place(value)));
        let points = points.collect::<Vec<String>>().join(" ");
        let _ = writeln!(
            svg,
            "<polyline points=\"{points}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"2\"/>"
        );
        let (left, top) = (RIGHT + 20.0, TOP + 12.0 + 24.0 * place as f64);
        let _ = writeln!(
            svg,
            "<rect x=\"{left}\" y=\"{}\" width=\"14\" height=\"4\" fill=\"{colour}\"/>",
            top - 6.0
        );
        let what = growth.quantities[number].what;
        let label = format!("{:.2}  {what}", exponent(&growth.series(number)));
        text(&mut svg, [left + 20.0, top], "start", &label);
    }
    svg.push_str("</svg>\n");
    svg
}

fn line(svg: &mut String, [x1, y1, x2, y2]: [f64; 4]) {
    let _ =
        writeln!(svg, "<line x1=\"{x1:.1}\" y1=\"{y1:.1}\" x2=\"{x2:.1}\" y2=\"{y2:.1}\" stroke=\"#ddd\"/>");
}

fn text(svg: &mut String, [x, y]: [f64; 2], anchor: &str, text: &str) {
    let _ = writeln!(svg, "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\">{text}</text>");
}
