//! Recall against 1 − precision, as the paper's figure 3 has it.

use rayon::prelude::*;
use results::{Curve, CurvePoint};

/// Pairs by distance: how many are relevant among those up to each distinct distance. `relevant` is what recall is a
/// share of.
pub fn curve(name: &'static str, mut pairs: Vec<(f64, bool)>, relevant: u64) -> Curve {
    // One point a distinct distance: the order of pairs at the same distance says nothing.
    pairs.par_sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let (mut accepted, mut found) = (0, 0);
    let point = |at_this_distance: &[(f64, bool)]| {
        accepted += at_this_distance.len() as u64;
        found += at_this_distance.iter().filter(|pair| pair.1).count() as u64;
        CurvePoint { distance: at_this_distance[0].0, accepted, relevant: found }
    };
    let points = pairs.chunk_by(|a, b| a.0.total_cmp(&b.0).is_eq()).map(point).collect();
    Curve { name, relevant, points }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By the definition, for each distance anew.
    fn by_counting(pairs: &[(f64, bool)]) -> Vec<CurvePoint> {
        let mut distances: Vec<f64> = pairs.iter().map(|pair| pair.0).collect();
        distances.sort_by(f64::total_cmp);
        distances.dedup();
        let point = |distance: f64| {
            let accepted: Vec<_> = pairs.iter().filter(|pair| pair.0 <= distance).collect();
            let relevant = accepted.iter().filter(|pair| pair.1).count() as u64;
            CurvePoint { distance, accepted: accepted.len() as u64, relevant }
        };
        distances.into_iter().map(point).collect()
    }

    #[test]
    fn a_point_counts_the_pairs_up_to_its_distance() {
        let pairs: Vec<(f64, bool)> =
            (0..200u32).map(|i| (f64::from(i * 37 % 50) / 7.0, i * 11 % 3 == 0)).collect();
        let relevant = pairs.iter().filter(|pair| pair.1).count() as u64;
        let got = curve("all", pairs.clone(), relevant);
        assert_eq!(got.points, by_counting(&pairs));
        assert_eq!(got.points.len(), 50);
        assert_eq!(got.points.last().unwrap().relevant, relevant);
        assert_eq!(curve("all", Vec::new(), 0).points, []);
    }
}
