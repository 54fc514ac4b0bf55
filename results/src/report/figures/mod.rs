//! Figures from tables.

pub(crate) mod channels;
pub(crate) mod comparison;
pub(crate) mod front;
pub(crate) mod genes;
pub(crate) mod grid;
pub(crate) mod lineage;
pub(crate) mod on_cloud;
pub(crate) mod perturbed;
pub(crate) mod recognition;
pub(crate) mod search;
pub(crate) mod seeds;
pub(crate) mod work;

use super::figure::{Axis, Panel, Series};

/// Height of a figure of one panel, pixels.
const HEIGHT: u32 = 330;

/// A panel of the usual height.
fn panel(x: Axis, y: Axis, series: Vec<Series>) -> Panel {
    Panel { title: String::new(), x, y, series, height: HEIGHT }
}

fn zip<'a>(x: &'a [f64], y: &'a [f64]) -> impl Iterator<Item = [f64; 2]> + 'a {
    x.iter().zip(y).map(|(&x, &y)| [x, y]).filter(|[_, y]| y.is_finite())
}

/// The axis of a run's generations.
fn generations_axis() -> Axis {
    Axis::numbers("generation", "")
}

/// The axis of errors of object recognition.
fn error_axis(of: &str) -> Axis {
    Axis::numbers(of, "% of clouds")
}

/// The value below which a share of sorted values lies, linear between neighbours; `None` if there are none.
pub(crate) fn quantile(sorted: &[f64], share: f64) -> Option<f64> {
    let place = share * (sorted.len().checked_sub(1)?) as f64;
    let (below, above) = (place.floor() as usize, place.ceil() as usize);
    let (low, high) = (*sorted.get(below)?, *sorted.get(above)?);
    Some(low + (high - low) * place.fract())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_of_textbooks() {
        // Hyndman and Fan (1996), definition 7.
        let values = [1.0, 2.0, 4.0, 8.0];
        let close = |share, expected: f64| (quantile(&values, share).unwrap() - expected).abs() < 1e-12;
        assert!(
            close(0.0, 1.0) && close(0.25, 1.75) && close(0.5, 3.0) && close(0.75, 5.0) && close(1.0, 8.0)
        );
        assert_eq!(quantile(&[7.0], 0.25), Some(7.0));
        assert_eq!(quantile(&[], 0.5), None);
    }
}
