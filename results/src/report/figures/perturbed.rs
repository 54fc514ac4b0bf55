//! Errors on perturbed test clouds by strength: a panel a kind, a line a descriptor.

use super::error_axis;
use crate::error::Error;
use crate::report::data::{Rows, percent};
use crate::report::figure::{Axis, Colour, Dash, Figure, Numbers, Panel, Series, Symbol};

/// Errors by strength of every descriptor, by name.
pub(crate) fn errors(rows: &Rows, descriptors: &[String]) -> Result<Figure, Error> {
    let (strength, error) = (rows.numbers("strength")?, rows.numbers("object_error")?);
    let unit = rows.texts("unit")?;
    let mut panels: Vec<(String, Panel)> = Vec::new();
    for ([kind, descriptor], places) in rows.parts(["kind", "descriptor"])? {
        let Some(place) = descriptors.iter().position(|name| *name == descriptor) else { continue };
        let places: Vec<usize> = places.into_iter().flatten().collect();
        let points: Vec<[f64; 2]> = places.iter().map(|&row| [strength[row], percent(error[row])]).collect();
        let found = panels.iter().position(|(of, _)| *of == kind).unwrap_or_else(|| {
            let unit = places.first().map_or("", |&row| unit[row].as_str());
            let x = Axis::numbers("strength", unit).including(0.0);
            let y = error_axis("object error").including(0.0);
            let panel = Panel { title: kind.clone(), x, y, series: Vec::new(), height: 300 };
            panels.push((kind, panel));
            panels.len() - 1
        });
        let series = &mut panels[found].1.series;
        let colour = Colour::nth(place);
        series.push(Series::dashed(&descriptor, colour, Dash::nth(place), points.clone()));
        series.push(Series::points("", colour, Symbol::Dot, points));
    }
    Ok(Figure {
        id: "comparison-perturbed".to_owned(),
        title: "Errors on perturbed test clouds".to_owned(),
        caption: "Object error by the strength of a perturbation of the test clouds; the database is as it was. Noise: normal, \
                  along each axis, by its deviation. Density: points drawn at random are removed. Occlusion: the points beyond \
                  a plane are removed. Light: each channel of the colours has a gain of its own. Clouds that become unusable \
                  count as wrong. Table perturbed has the intervals."
            .to_owned(),
        panels: panels.into_iter().map(|(_, panel)| panel).collect(),
        columns: 2,
        numbers: Numbers::Below,
    })
}
