//! Points as far as they can be told apart: a figure of a hundred thousand individuals is as good with some thousands.

use std::collections::BTreeSet;

use super::figure::{Figure, Marks, Panel};

/// Series of fewer points are drawn as they are.
const FEW: usize = 1500;
/// Most points of a series.
const MOST: usize = 4000;

/// The figure without points that lie on others; its caption says so.
pub(crate) fn thinned(mut figure: Figure) -> Figure {
    let width = f64::from(figure.panel_width());
    let (mut met, mut drawn, mut apart) = (0, 0, 0.0_f64);
    for panel in &mut figure.panels {
        let scale = pixels(panel, width);
        for series in &mut panel.series {
            if let Marks::Points { points, .. } = &mut series.marks
                && points.len() > FEW
            {
                met += points.len();
                apart = apart.max(keep_apart(points, scale));
                drawn += points.len();
            }
        }
    }
    if drawn < met {
        figure.caption.push_str(&format!(
            " Of {met} points {drawn} are drawn, a point for those in a square of {apart} by {apart} pixels."
        ));
    }
    figure
}

/// Pixels per unit of both axes, at most: what is around them takes some of the panel.
fn pixels(panel: &Panel, width: f64) -> [f64; 2] {
    let [x, y] = panel.ranges();
    [width / (x[1] - x[0]), f64::from(panel.height) / (y[1] - y[0])]
}

/// Keeps the first point of each square that has any; gives the squares' side in pixels.
fn keep_apart(points: &mut Vec<[f64; 2]>, scale: [f64; 2]) -> f64 {
    let mut side = 1.0;
    loop {
        let mut taken = BTreeSet::new();
        let square = |point: &[f64; 2]| [0, 1].map(|axis| (point[axis] * scale[axis] / side).floor() as i64);
        let kept: Vec<[f64; 2]> =
            points.iter().copied().filter(|point| taken.insert(square(point))).collect();
        if kept.len() <= MOST {
            *points = kept;
            return side;
        }
        side *= 2.0;
    }
}

#[cfg(test)]
mod tests {
    use super::super::figure::{Axis, Colour, Series, Symbol};
    use super::*;

    fn figure(points: Vec<[f64; 2]>) -> Figure {
        let axis = || Axis::numbers("x", "").including(0.0).including(1.0);
        let series = vec![Series::points("", Colour::Grey, Symbol::Dot, points)];
        let panel = Panel { title: String::new(), x: axis(), y: axis(), series, height: 300 };
        Figure::single("f", "F", "Caption.", panel)
    }

    #[test]
    fn few_points_stay_and_of_many_there_is_one_wherever_there_were_any() {
        let few = figure(vec![[0.5, 0.5]; FEW]);
        assert_eq!(thinned(few.clone()), few);
        let many: Vec<[f64; 2]> =
            (0..200_000).map(|n| [f64::from(n % 1000) / 1000.0, f64::from(n / 1000) / 200.0]).collect();
        let thin = thinned(figure(many.clone()));
        let Marks::Points { points, .. } = &thin.panels[0].series[0].marks else { panic!("points") };
        assert!((1000..=MOST).contains(&points.len()), "{}", points.len());
        assert!(thin.caption.starts_with(&format!("Caption. Of 200000 points {} are drawn", points.len())));
        let near = |a: &[f64; 2], b: &[f64; 2]| (a[0] - b[0]).abs() < 0.04 && (a[1] - b[1]).abs() < 0.08;
        assert!(many.iter().step_by(997).all(|point| points.iter().any(|kept| near(point, kept))));
    }
}
