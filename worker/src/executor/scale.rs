//! The scale of a channel: what its distances are divided by, so that those of different channels can be added
//! (DESIGN 5b).

use descriptor::DistanceMatrix;

/// One distance in so many lies below the scale.
const ONE_IN: usize = 20;

/// The scale by the distances of some clouds to the same clouds: of those of all unordered pairs, sorted, the one below
/// which a twentieth lies; 1 if it is 0, or if there is no pair.
pub(super) fn scale(distances: &DistanceMatrix) -> f64 {
    let clouds = distances.columns();
    let mut pairs: Vec<f32> =
        (0..clouds).flat_map(|cloud| &distances.row(cloud)[cloud + 1..]).copied().collect();
    if pairs.is_empty() {
        return 1.0;
    }
    let place = pairs.len() / ONE_IN;
    let (_, &mut scale, _) = pairs.select_nth_unstable_by(place, f32::total_cmp);
    if scale > 0.0 { f64::from(scale) } else { 1.0 }
}
