//! A model of the fitness: Gaussian process regression over individuals that were evaluated (Rasmussen and Williams,
//! Gaussian Processes for Machine Learning, 2006, algorithm 2.1).
//!
//! Children are chosen by its bits, which must be those of every processor: nalgebra factorises and solves in plain loops
//! (its products of two matrices choose instructions by processor, and are not used), `libm` has one exp for all.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// Variance of what is measured around what the model expects, where that of the fitness is 1.
const NOISE: f64 = 0.1;
/// Fields in which two parts differ to be alike by 1/e only.
const DIFFERING_FIELDS: f64 = 4.0;

/// A part of what an individual stands for, such as a channel of a descriptor.
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// What counts of it beside other parts of the individual; not negative.
    pub weight: f64,
    /// Its fields in a fixed order, equal numbers for equal values. All parts have as many.
    pub fields: Vec<u64>,
}

/// What an individual stands for, part by part in an order that follows from the parts. Individuals with equal
/// compositions are one to the model.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Composition {
    parts: Vec<Part>,
    /// What makes its similarity to itself 1.
    norm: f64,
}

impl Composition {
    pub(crate) fn new(mut parts: Vec<Part>) -> Self {
        parts.sort_by(|a, b| a.fields.cmp(&b.fields).then(a.weight.total_cmp(&b.weight)));
        let mut composition = Self { parts, norm: 1.0 };
        let own = composition.similarity(&composition);
        composition.norm = if own > 0.0 { 1.0 / own.sqrt() } else { 0.0 };
        composition
    }

    /// The kernel, 0 to 1: over all pairs of parts the product of their weights times exp(−d/4), where d fields differ.
    /// Positive definite, as a sum of products of kernels of one field each, normalised.
    fn similarity(&self, other: &Self) -> f64 {
        let mut sum = 0.0;
        for own in &self.parts {
            for part in &other.parts {
                let differing = own.fields.iter().zip(&part.fields).filter(|(a, b)| a != b).count();
                sum += own.weight * part.weight * libm::exp(-(differing as f64) / DIFFERING_FIELDS);
            }
        }
        sum * self.norm * other.norm
    }
}

/// What the model expects of an individual, in standard deviations of the fitness it has learned from, above their mean.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Expected {
    pub(crate) mean: f64,
    pub(crate) deviation: f64,
}

impl Expected {
    /// The upper confidence bound: what it may well be. By the mean alone a search only repeats what it knows.
    pub(crate) fn upper(self) -> f64 {
        self.mean + self.deviation
    }
}

/// The model.
pub(crate) struct Surrogate {
    known: Vec<Composition>,
    factor: Cholesky<f64, Dyn>,
    weights: DVector<f64>,
}

impl Surrogate {
    /// Learns from individuals and their fitness; `None` of nothing.
    pub(crate) fn new(known: Vec<(Composition, f64)>) -> Option<Self> {
        let (known, fitness): (Vec<Composition>, Vec<f64>) = known.into_iter().unzip();
        let count = known.len();
        let mean = fitness.iter().sum::<f64>() / count as f64;
        let squares: f64 = fitness.iter().map(|fitness| (fitness - mean) * (fitness - mean)).sum();
        let deviation = (squares / count as f64).sqrt();
        let standardised = |fitness: f64| if deviation > 0.0 { (fitness - mean) / deviation } else { 0.0 };
        let mut kernel = DMatrix::zeros(count, count);
        for (row, one) in known.iter().enumerate() {
            for (column, other) in known.iter().enumerate().take(row) {
                // Only the lower triangle is read.
                kernel[(row, column)] = one.similarity(other);
            }
            kernel[(row, row)] = 1.0 + NOISE;
        }
        let factor = Cholesky::new(kernel).filter(|_| count > 0)?;
        let weights = factor.solve(&DVector::from_iterator(count, fitness.into_iter().map(standardised)));
        Some(Self { known, factor, weights })
    }

    /// Whether it has learned from such an individual.
    pub(crate) fn knows(&self, composition: &Composition) -> bool {
        self.known.contains(composition)
    }

    /// What is to be expected of an individual.
    pub(crate) fn expect(&self, composition: &Composition) -> Expected {
        let similarities = self.known.iter().map(|known| known.similarity(composition));
        let mut similar = DVector::from_iterator(self.known.len(), similarities);
        let mean = similar.dot(&self.weights);
        self.factor.l_dirty().solve_lower_triangular_mut(&mut similar);
        let variance = 1.0 - similar.norm_squared();
        Expected { mean, deviation: variance.max(0.0).sqrt() }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn part(weight: f64, fields: &[u64]) -> Part {
        Part { weight, fields: fields.to_vec() }
    }

    /// One part of full weight.
    fn one(fields: &[u64]) -> Composition {
        Composition::new(vec![part(1.0, fields)])
    }

    fn kernel(differing: f64) -> f64 {
        libm::exp(-differing / 4.0)
    }

    #[test]
    fn individuals_are_alike_by_what_their_parts_share_in_whatever_order() {
        let [a, b] = [&[1, 2, 3][..], &[1, 9, 9]];
        assert_eq!(one(a).similarity(&one(b)), kernel(2.0));
        let both = |first, second| Composition::new(vec![part(0.5, first), part(2.0, second)]);
        assert_eq!(both(a, b), Composition::new(vec![part(2.0, b), part(0.5, a)]));
        assert_ne!(both(a, b), both(b, a));
        // ⟨0.5a + 2b, a⟩ / (|0.5a + 2b|·|a|)
        let cosine = (0.5 + 2.0 * kernel(2.0)) / (0.25 + 4.0 + 2.0 * kernel(2.0)).sqrt();
        assert!((both(a, b).similarity(&one(a)) - cosine).abs() < 1e-15);
        assert!((both(a, b).similarity(&both(a, b)) - 1.0).abs() < 1e-15);
    }

    #[test]
    fn of_one_individual_it_expects_what_the_equations_of_two_say() {
        // Two individuals that are alike by k, fitness ±1 after standardising; the third is alike by k1 and k2 to them.
        let surrogate = Surrogate::new(vec![(one(&[0, 0, 0]), 7.0), (one(&[0, 0, 1]), 3.0)]).unwrap();
        let [k, k1, k2] = [kernel(1.0), kernel(1.0), kernel(2.0)];
        let (diagonal, determinant) = (1.1, 1.1 * 1.1 - k * k);
        let expected = surrogate.expect(&one(&[5, 0, 0]));
        let mean = (k1 * (diagonal + k) - k2 * (k + diagonal)) / determinant;
        assert!((expected.mean - mean).abs() < 1e-14, "{expected:?}");
        let explained = (k1 * (diagonal * k1 - k * k2) + k2 * (diagonal * k2 - k * k1)) / determinant;
        assert!((expected.deviation * expected.deviation - (1.0 - explained)).abs() < 1e-14, "{expected:?}");
        assert_eq!(expected.upper(), expected.mean + expected.deviation);
        assert!(surrogate.knows(&one(&[0, 0, 1])) && !surrogate.knows(&one(&[5, 0, 0])));
    }

    #[test]
    fn of_nothing_and_of_equal_fitness_it_expects_nothing() {
        assert!(Surrogate::new(Vec::new()).is_none());
        let surrogate = Surrogate::new(vec![(one(&[1]), 5.0), (one(&[2]), 5.0)]).unwrap();
        assert_eq!(surrogate.expect(&one(&[1])).mean, 0.0);
        let nothing = Surrogate::new(vec![(Composition::new(Vec::new()), 5.0)]).unwrap();
        assert_eq!(nothing.expect(&one(&[1])), Expected { mean: 0.0, deviation: 1.0 });
    }

    proptest! {
        #[test]
        fn what_was_evaluated_is_expected_with_less_uncertainty_than_anything_else(
            fields in prop::collection::hash_set(prop::array::uniform4(0u64..4), 2..24),
            other in prop::array::uniform4(4u64..8),
            fitness in prop::collection::vec(0u32..100, 24),
        ) {
            let fields: Vec<[u64; 4]> = fields.into_iter().collect();
            let known = fields.iter().zip(&fitness).map(|(fields, &fitness)| (one(fields), f64::from(fitness)));
            let surrogate = Surrogate::new(known.collect()).unwrap();
            let unknown = surrogate.expect(&one(&other));
            prop_assert!(unknown.deviation <= 1.0);
            for fields in &fields {
                let expected = surrogate.expect(&one(fields));
                prop_assert!(expected.mean.is_finite() && expected.deviation < unknown.deviation);
                // What is left of the variance where one individual was evaluated, and no other is like it.
                prop_assert!(expected.deviation * expected.deviation <= 1.0 - 1.0 / 1.1 + 1e-12);
            }
        }
    }
}
