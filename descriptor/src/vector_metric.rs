//! Distances of vectors that were computed elsewhere: one vector a cloud, by a metric that whoever gives them names.

/// How two vectors of one length are compared: in f64, terms added in the order of the values.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum VectorMetric {
    /// √Σ(a − b)².
    #[default]
    L2,
    /// Σ|a − b|.
    L1,
    /// 1 − Σab / (√Σa²·√Σb²).
    Cosine,
    /// Σ(a − b)² / (2(a + b)), a term with a + b = 0 being 0.
    ChiSquared,
}

impl VectorMetric {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::L2, Self::L1, Self::Cosine, Self::ChiSquared];

    /// Its name on the command line and in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::L2 => "l2",
            Self::L1 => "l1",
            Self::Cosine => "cosine",
            Self::ChiSquared => "chi2",
        }
    }

    /// The one of this name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|metric| metric.name() == name)
    }

    /// What is wrong with a vector of finite values, if it has no distance to others.
    pub fn fault(self, values: &[f64]) -> Option<&'static str> {
        // Squares of such values, and sums of as many as there may be, stay finite and above 0.
        let is_extreme = |value: &f64| *value != 0.0 && !(1e-100..=1e100).contains(&value.abs());
        match self {
            _ if values.iter().any(is_extreme) => Some("values must be 0 or from 1e-100 to 1e100 in size"),
            Self::ChiSquared if values.iter().any(|value| *value < 0.0) => {
                Some("chi2 needs values that are not negative")
            }
            Self::Cosine if values.iter().all(|value| *value == 0.0) => {
                Some("cosine needs a value other than 0")
            }
            _ => None,
        }
    }

    /// The distance of two vectors without [faults](VectorMetric::fault).
    ///
    /// # Panics
    /// If they differ in length: a programming error.
    pub fn distance(self, a: &[f64], b: &[f64]) -> f64 {
        assert_eq!(a.len(), b.len(), "vectors of one descriptor");
        let sum = |term: fn(f64, f64) -> f64| {
            a.iter().zip(b).map(|(&a, &b)| term(a, b)).fold(0.0, |sum, term| sum + term)
        };
        match self {
            Self::L2 => sum(|a, b| (a - b) * (a - b)).sqrt(),
            Self::L1 => sum(|a, b| (a - b).abs()),
            Self::Cosine => {
                let lengths = [sum(|a, _| a * a), sum(|_, b| b * b)].map(f64::sqrt);
                1.0 - sum(|a, b| a * b) / (lengths[0] * lengths[1])
            }
            Self::ChiSquared => sum(|a, b| {
                let both = a + b;
                if both == 0.0 { 0.0 } else { (a - b) * (a - b) / (2.0 * both) }
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn distances_of_a_few_vectors_are_those_of_the_textbook() {
        let distances = |a: &[f64], b: &[f64]| VectorMetric::ALL.map(|metric| metric.distance(a, b));
        assert_eq!(distances(&[3.0, 0.0], &[0.0, 4.0]), [5.0, 7.0, 1.0, 3.5]);
        assert_eq!(distances(&[2.0, 0.0], &[2.0, 0.0]), [0.0; 4]);
        assert_eq!(VectorMetric::Cosine.distance(&[1.0, 0.0], &[-5.0, 0.0]), 2.0);
    }

    #[test]
    fn vectors_without_a_distance_are_faults() {
        let faults = |values: &[f64]| VectorMetric::ALL.map(|metric| metric.fault(values).is_some());
        assert_eq!(faults(&[0.0, 1.0]), [false; 4]);
        assert_eq!(faults(&[0.0, -1.0]), [false, false, false, true]);
        assert_eq!(faults(&[0.0, -0.0]), [false, false, true, false]);
        assert_eq!(faults(&[1e101]), [true; 4]);
        assert_eq!(faults(&[1e-101]), [true; 4]);
    }

    proptest! {
        #[test]
        fn a_distance_is_finite_not_negative_and_the_same_both_ways(
            pairs in prop::collection::vec((1e-100f64..1e100, 0.0f64..1.0), 1..20),
        ) {
            let (a, b): (Vec<f64>, Vec<f64>) = pairs.into_iter().map(|(a, share)| (a, a * (0.5 + share))).unzip();
            for metric in VectorMetric::ALL {
                let distance = metric.distance(&a, &b);
                prop_assert!(distance.is_finite() && distance >= -1e-12, "{metric:?} {distance}");
                prop_assert_eq!(distance, metric.distance(&b, &a));
                prop_assert_eq!(VectorMetric::named(metric.name()), Some(metric));
            }
        }
    }
}
