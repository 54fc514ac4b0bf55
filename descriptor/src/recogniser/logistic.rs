//! Logistic regression of few terms, by Newton's method with a small ridge, in a fixed order of sums.

use nalgebra::{Cholesky, DMatrix, DVector};

use super::matrix::dot;

/// Coefficients: a constant, and one for each feature.
pub const TERMS: usize = 4;
/// λ of the ridge on coefficients of standardised features, where the weights of all samples add up to 1: without it those
/// of classes that can be told apart without an error would grow for ever.
const RIDGE: f64 = 1e-3;
/// Newton's method needs some ten steps.
const MOST_STEPS: usize = 100;
/// A step that changes no coefficient by more is the last.
const SMALL_STEP: f64 = 1e-12;

/// 1 / (1 + exp(−z)).
pub fn logistic(z: f64) -> f64 {
    if z >= 0.0 { 1.0 / (1.0 + libm::exp(-z)) } else { libm::exp(z) / (1.0 + libm::exp(z)) }
}

/// Coefficients c of p = logistic(c₀ + Σ cᵢ·xᵢ), the probability that a sample is one of the first class and not of the
/// second; both have equal weight, however many samples they have. The order of the samples decides on no more than the
/// last bits. `None` of a class without samples, and of features that are not finite.
pub fn fit(classes: [&[[f64; TERMS - 1]]; 2]) -> Option<[f64; TERMS]> {
    if classes.iter().any(|class| class.is_empty()) {
        return None;
    }
    let standard = Standard::of(classes);
    let mut samples = Vec::new();
    for (class, target) in classes.into_iter().zip([1.0, 0.0]) {
        let weight = 0.5 / class.len() as f64;
        samples.extend(class.iter().map(|features| Sample { row: standard.row(features), target, weight }));
    }
    let mut coefficients = [0.0; TERMS];
    let mut loss = loss(&samples, &coefficients);
    for _ in 0..MOST_STEPS {
        let step = newton_step(&samples, &coefficients)?;
        let mut length = 1.0;
        // The loss is convex: along the step it falls at first.
        let next = loop {
            let next: [f64; TERMS] = std::array::from_fn(|at| coefficients[at] - length * step[at]);
            let of_next = self::loss(&samples, &next);
            if of_next <= loss {
                loss = of_next;
                break next;
            }
            length *= 0.5;
            if length < SMALL_STEP {
                break coefficients;
            }
        };
        let change = (0..TERMS).map(|at| (next[at] - coefficients[at]).abs()).fold(0.0, f64::max);
        coefficients = next;
        if change < SMALL_STEP {
            break;
        }
    }
    let raw = standard.raw(&coefficients);
    raw.iter().all(|coefficient| coefficient.is_finite()).then_some(raw)
}

struct Sample {
    /// 1, then the standardised features.
    row: [f64; TERMS],
    target: f64,
    weight: f64,
}

/// Mean and standard deviation of each feature.
struct Standard {
    mean: [f64; TERMS - 1],
    deviation: [f64; TERMS - 1],
}

impl Standard {
    fn of(classes: [&[[f64; TERMS - 1]]; 2]) -> Self {
        let all = || classes.into_iter().flatten();
        let count = all().count() as f64;
        let mean: [f64; TERMS - 1] =
            std::array::from_fn(|at| all().map(|features| features[at]).sum::<f64>() / count);
        let deviation = std::array::from_fn(|at| {
            let squares: f64 =
                all().map(|features| (features[at] - mean[at]) * (features[at] - mean[at])).sum();
            // A feature that does not vary says nothing: the ridge makes its coefficient 0.
            Some((squares / count).sqrt()).filter(|&deviation| deviation > 0.0).unwrap_or(1.0)
        });
        Self { mean, deviation }
    }

    fn row(&self, features: &[f64; TERMS - 1]) -> [f64; TERMS] {
        std::array::from_fn(|term| match term.checked_sub(1) {
            Some(at) => (features[at] - self.mean[at]) / self.deviation[at],
            None => 1.0,
        })
    }

    /// Coefficients of features as they are.
    fn raw(&self, coefficients: &[f64; TERMS]) -> [f64; TERMS] {
        let mut raw = *coefficients;
        for at in 0..TERMS - 1 {
            raw[at + 1] /= self.deviation[at];
            raw[0] -= raw[at + 1] * self.mean[at];
        }
        raw
    }
}

/// Mean of −ln p of the right class, and the ridge.
fn loss(samples: &[Sample], coefficients: &[f64; TERMS]) -> f64 {
    let mut sum = 0.0;
    for Sample { row, target, weight } in samples {
        let z = dot(row, coefficients);
        let wrong = if *target > 0.5 { -z } else { z };
        sum += weight * (wrong.max(0.0) + libm::log1p(libm::exp(-wrong.abs())));
    }
    sum + 0.5 * RIDGE * dot(&coefficients[1..], &coefficients[1..])
}

/// Hessian⁻¹ · gradient of the loss; `None` if there is none.
fn newton_step(samples: &[Sample], coefficients: &[f64; TERMS]) -> Option<DVector<f64>> {
    let (mut gradient, mut hessian) = (DVector::zeros(TERMS), DMatrix::zeros(TERMS, TERMS));
    for Sample { row, target, weight } in samples {
        let p = logistic(dot(row, coefficients));
        for at in 0..TERMS {
            gradient[at] += weight * (p - target) * row[at];
            for other in 0..TERMS {
                hessian[(at, other)] += weight * p * (1.0 - p) * row[at] * row[other];
            }
        }
    }
    for at in 1..TERMS {
        gradient[at] += RIDGE * coefficients[at];
        hessian[(at, at)] += RIDGE;
    }
    Some(Cholesky::new(hessian)?.solve(&gradient))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::random;

    fn classes(purpose: &str, known: usize, unknown: usize, apart: f64) -> [Vec<[f64; 3]>; 2] {
        let mut rng = random::stream(1, purpose, &[]);
        [(known, apart), (unknown, 0.0)].map(|(count, shift)| {
            let mut draw = || rng.random_range(0.0..1.0);
            let value = |_| [draw() + shift, 40.0 * draw() - 3.0 * shift, draw() * draw()];
            (0..count).map(value).collect()
        })
    }

    /// The loss by its definition, from features as they are.
    fn loss_of(classes: &[Vec<[f64; 3]>; 2], raw: &[f64; TERMS]) -> f64 {
        let all: Vec<&[f64; 3]> = classes.iter().flatten().collect();
        let deviation = |at: usize| {
            let mean = all.iter().map(|x| x[at]).sum::<f64>() / all.len() as f64;
            (all.iter().map(|x| (x[at] - mean) * (x[at] - mean)).sum::<f64>() / all.len() as f64).sqrt()
        };
        let mut sum = 0.0;
        for (class, is_first) in classes.iter().zip([true, false]) {
            let mut of_class = 0.0;
            for x in class {
                let p = 1.0 / (1.0 + libm::exp(-(raw[0] + raw[1] * x[0] + raw[2] * x[1] + raw[3] * x[2])));
                of_class -= libm::log(if is_first { p } else { 1.0 - p });
            }
            sum += 0.5 * of_class / class.len() as f64;
        }
        sum + 0.5
            * RIDGE
            * (0..3).map(|at| (raw[at + 1] * deviation(at)) * (raw[at + 1] * deviation(at))).sum::<f64>()
    }

    #[test]
    fn the_loss_is_least_there() {
        for (known, unknown, apart) in [(40, 40, 0.4), (90, 7, 0.2), (5, 60, 0.0)] {
            let classes = classes("logistic", known, unknown, apart);
            let found = fit([&classes[0], &classes[1]]).unwrap();
            let least = loss_of(&classes, &found);
            // Differences of the loss in either direction: its gradient is 0, and it is convex.
            for at in 0..TERMS {
                for scale in [1e-3, 1e-1, 1.0] {
                    let by = scale * found[at].abs().max(0.01);
                    for sign in [-1.0, 1.0] {
                        let mut other = found;
                        other[at] += sign * by;
                        assert!(loss_of(&classes, &other) > least, "{known} {unknown} {at} {scale}");
                    }
                }
                let by = 1e-5 * found[at].abs().max(0.01);
                let slope: f64 = [1.0, -1.0]
                    .map(|sign| {
                        let mut other = found;
                        other[at] += sign * by;
                        sign * loss_of(&classes, &other)
                    })
                    .iter()
                    .sum();
                assert!((slope / by).abs() < 1e-5, "gradient {}", slope / by);
            }
        }
    }

    #[test]
    fn plain_gradient_descent_comes_to_the_same() {
        let classes = classes("descent", 30, 50, 0.3);
        let found = fit([&classes[0], &classes[1]]).unwrap();
        let standard = Standard::of([&classes[0], &classes[1]]);
        let mut c = [0.0; TERMS];
        for _ in 0..200_000 {
            let mut gradient = [0.0, RIDGE * c[1], RIDGE * c[2], RIDGE * c[3]];
            for (class, target) in classes.iter().zip([1.0, 0.0]) {
                for x in class {
                    let row = standard.row(x);
                    let z: f64 = (0..TERMS).map(|at| row[at] * c[at]).sum();
                    let p = 1.0 / (1.0 + libm::exp(-z));
                    (0..TERMS)
                        .for_each(|at| gradient[at] += 0.5 / class.len() as f64 * (p - target) * row[at]);
                }
            }
            (0..TERMS).for_each(|at| c[at] -= gradient[at]);
        }
        let raw = standard.raw(&c);
        for at in 0..TERMS {
            assert!((raw[at] - found[at]).abs() < 1e-6 * raw[at].abs().max(1.0), "{raw:?} {found:?}");
        }
    }

    #[test]
    fn classes_that_lie_apart_have_finite_coefficients_and_none_has_none() {
        let apart = [vec![[0.0, 1.0, 0.0]; 3], vec![[1.0, 1.0, 0.0]; 5]];
        let found = fit([&apart[0], &apart[1]]).unwrap();
        let p = |x: f64| logistic(found[0] + found[1] * x);
        assert!(p(0.0) > 0.95 && p(1.0) < 0.05, "{found:?}");
        assert!((p(0.5) - 0.5).abs() < 1e-9, "classes count alike, however many there are");
        assert_eq!(found[2..], [0.0; 2], "features that do not vary");
        assert_eq!(fit([&apart[0], &[]]), None);
        assert_eq!(fit([&[], &apart[1]]), None);
        assert_eq!(fit([&[[f64::NAN, 0.0, 0.0]], &apart[1]]), None);
    }

    proptest! {
        #[test]
        fn the_logistic_function_is_its_definition(z in -700.0..700.0f64) {
            let plain = 1.0 / (1.0 + libm::exp(-z));
            prop_assert!((logistic(z) - plain).abs() <= 1e-15 * plain.max(1e-300));
            prop_assert!((logistic(z) + logistic(-z) - 1.0).abs() < 1e-15);
        }
    }
}
