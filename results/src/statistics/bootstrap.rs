//! Intervals of shares that were measured on clouds that are not independent: the bootstrap over objects.

/// What was measured on the clouds of one object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cluster {
    /// Sum over its clouds: how many were wrong, or the difference of two such counts.
    pub sum: f64,
    /// Number of its clouds.
    pub clouds: u32,
}

/// The 95 % interval of Σ sum / Σ clouds by the percentile bootstrap over whole clusters (B. Efron, R. Tibshirani, An
/// introduction to the bootstrap, 1993, chapters 8 and 13): as many clusters as there are are drawn with replacement,
/// `resamples` times; the interval reaches from the 2.5th to the 97.5th percentile of what they give. Clouds of one
/// object stand or fall together, so that it is wider than one over clouds. `draw(n)` gives a random index below n.
/// `None` without clouds or resamples.
pub fn bootstrap(
    clusters: &[Cluster],
    resamples: usize,
    mut draw: impl FnMut(usize) -> usize,
) -> Option<[f64; 2]> {
    if resamples == 0 || clusters.iter().any(|cluster| cluster.clouds == 0) || clusters.is_empty() {
        return None;
    }
    let mut resample = || {
        let (mut sum, mut clouds) = (0.0, 0.0);
        for _ in clusters {
            let drawn = clusters[draw(clusters.len())];
            sum += drawn.sum;
            clouds += f64::from(drawn.clouds);
        }
        sum / clouds
    };
    let mut shares: Vec<f64> = (0..resamples).map(|_| resample()).collect();
    shares.sort_by(f64::total_cmp);
    // The smallest value that at least this share of the resamples does not exceed.
    let percentile =
        |share: f64| shares[((share * resamples as f64).ceil() as usize).clamp(1, resamples) - 1];
    Some([percentile(0.025), percentile(0.975)])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Draws every one of n^n resamples once.
    fn every(n: usize) -> impl FnMut(usize) -> usize {
        let mut drawn = 0usize;
        move |below| {
            assert_eq!(below, n);
            let (resample, place) = (drawn / n, drawn % n);
            drawn += 1;
            resample / n.pow(place as u32) % n
        }
    }

    #[test]
    fn with_every_resample_drawn_once_the_ends_are_the_exact_percentiles() {
        let clusters = [(0.0, 3), (1.0, 2), (4.0, 4), (2.0, 5)].map(|(sum, clouds)| Cluster { sum, clouds });
        let got = bootstrap(&clusters, 256, every(4)).unwrap();
        // The definition, written out: all 256 quotients, each as likely as the other.
        let mut all = Vec::new();
        for [a, b, c, d] in (0..256).map(|i: usize| [i % 4, i / 4 % 4, i / 16 % 4, i / 64]) {
            let drawn = [a, b, c, d].map(|index| clusters[index]);
            let clouds: u32 = drawn.iter().map(|cluster| cluster.clouds).sum();
            all.push(drawn.iter().map(|cluster| cluster.sum).sum::<f64>() / f64::from(clouds));
        }
        for (end, below, beyond) in [(got[0], 0.025, 0.975), (got[1], 0.975, 0.025)] {
            let at_most = all.iter().filter(|&&share| share <= end + 1e-12).count() as f64 / 256.0;
            let at_least = all.iter().filter(|&&share| share >= end - 1e-12).count() as f64 / 256.0;
            assert!(at_most >= below && at_least >= beyond, "{end}: {at_most} {at_least}");
        }
        assert!(got[0] < got[1]);
    }

    #[test]
    fn equal_clusters_leave_no_doubt_and_nothing_gives_nothing() {
        let equal = [Cluster { sum: 1.0, clouds: 4 }; 7];
        assert_eq!(bootstrap(&equal, 50, |n| n - 1), Some([0.25, 0.25]));
        assert_eq!(bootstrap(&[], 50, |_| 0), None);
        assert_eq!(bootstrap(&equal, 0, |_| 0), None);
        assert_eq!(bootstrap(&[Cluster { sum: 0.0, clouds: 0 }], 5, |_| 0), None);
    }
}
