//! Neighbourhood components analysis (Goldberger, Roweis, Hinton and Salakhutdinov, 2004) with a weight for each value: how
//! likely a cloud is recognised by its object rises with the weights that are found.

use pulp::NullaryFnOnce;
use rayon::prelude::*;

use super::LabelledSet;
use super::values::{Compared, Values};
use crate::recogniser::dot;
use crate::wide::widest;

/// Distance at which likelihoods fall to 1/e, in mean distances of a cloud to the nearest of its object.
const BANDWIDTH: f64 = 0.5;
/// Penalty of each root: this times (root − 1)².
const RIDGE: f64 = 0.25;
/// Steps of Adam (Kingma and Ba, 2015), with the decay rates and the ε that its authors name. More change little.
const STEPS: usize = 150;
/// About the longest step.
const LEARNING_RATE: f64 = 0.03;
const DECAY: [f64; 2] = [0.9, 0.999];
const EPSILON: f64 = 1e-8;
/// No root falls below it: a channel whose factors were all 0 would have no largest weight, and a root and its negative are
/// one factor.
const LEAST_ROOT: f64 = 0.01;
/// Clouds whose gradients are added up in one block. Its size is fixed, as another would change the rounding.
const BLOCK: usize = 16;

/// Clouds of a set with what they are compared with.
struct Neighbourhood {
    values: Values,
    compared: Vec<Compared>,
    /// Distance at which a likelihood falls to 1/e; above 0.
    bandwidth: f64,
    /// How much a cloud counts.
    cloud_weight: f64,
}

/// What weights are multiplied by, so that the sum over the clouds of −ln p becomes small: p is the share of a cloud's object
/// in the sum of exp(−d / t) over those that it is compared with, t half of the mean, over all clouds, of the distance to the
/// nearest cloud of the same object.
/// Of several sets, each has the share of its weight, as if all had as many clouds as they have on average.
/// A ridge keeps factors r² near 1: a quarter of Σ (r − 1)².
pub fn factors(sets: &[&LabelledSet<'_>], weights: &[f64]) -> Vec<f64> {
    let neighbourhoods = neighbourhoods(sets, weights);
    let mut roots = vec![1.0; weights.len()];
    let [mut first_moment, mut second_moment] = [vec![0.0; weights.len()], vec![0.0; weights.len()]];
    let mut decayed = [1.0, 1.0];
    for _ in 0..STEPS {
        let gradient = gradient(&neighbourhoods, &roots);
        decayed = [decayed[0] * DECAY[0], decayed[1] * DECAY[1]];
        for (value, gradient) in gradient.into_iter().enumerate() {
            let (first, second) = (&mut first_moment[value], &mut second_moment[value]);
            *first = DECAY[0] * *first + (1.0 - DECAY[0]) * gradient;
            *second = DECAY[1] * *second + (1.0 - DECAY[1]) * gradient * gradient;
            let size = (*second / (1.0 - decayed[1])).sqrt() + EPSILON;
            let step = LEARNING_RATE * (*first / (1.0 - decayed[0])) / size;
            roots[value] = (roots[value] - step).max(LEAST_ROOT);
        }
    }
    roots.into_iter().map(|root| root * root).collect()
}

fn neighbourhoods(sets: &[&LabelledSet<'_>], weights: &[f64]) -> Vec<Neighbourhood> {
    let neighbourhood = |set: &&LabelledSet<'_>| {
        let values = Values::new(set, weights);
        let compared = values.compared(set);
        let mut terms = vec![0.0; values.count()];
        let mut nearest = |one: &Compared| {
            values.terms(one.cloud, one.same[0], &mut terms);
            terms.iter().sum::<f64>()
        };
        let mean = compared.iter().map(&mut nearest).sum::<f64>() / compared.len() as f64;
        Neighbourhood { values, compared, bandwidth: BANDWIDTH * mean, cloud_weight: set.weight.into() }
    };
    let mut found: Vec<Neighbourhood> = sets.iter().map(neighbourhood).collect();
    // Where every cloud has a twin in another sequence, nothing is to be gained.
    found.retain(|one| one.bandwidth > 0.0);
    let mean = found.iter().map(|one| one.compared.len() as f64).sum::<f64>() / found.len() as f64;
    let all: f64 = found.iter().map(|one| one.cloud_weight).sum();
    for one in &mut found {
        one.cloud_weight = mean / one.compared.len() as f64 * (one.cloud_weight / all);
    }
    found
}

/// Of what is to be small, by the square roots of the factors.
fn gradient(neighbourhoods: &[Neighbourhood], roots: &[f64]) -> Vec<f64> {
    let factors: Vec<f64> = roots.iter().map(|root| root * root).collect();
    let mut all = vec![0.0; roots.len()];
    for one in neighbourhoods {
        let blocks = one.compared.par_chunks(BLOCK);
        let of_block = |compared| widest(Block { neighbourhood: one, compared, factors: &factors });
        let blocks: Vec<Vec<f64>> = blocks.map(of_block).collect();
        // In the order of the clouds.
        for of_block in blocks {
            all.iter_mut().zip(of_block).for_each(|(all, gradient)| *all += one.cloud_weight * gradient);
        }
    }
    let with_ridge = |(gradient, root): (&f64, &f64)| 2.0 * root * gradient + 2.0 * RIDGE * (root - 1.0);
    all.iter().zip(roots).map(with_ridge).collect()
}

/// The kernel of the gradient of −ln p by the factors, summed over some clouds.
struct Block<'a> {
    neighbourhood: &'a Neighbourhood,
    compared: &'a [Compared],
    factors: &'a [f64],
}

impl NullaryFnOnce for Block<'_> {
    type Output = Vec<f64>;

    #[inline(always)]
    fn call(self) -> Vec<f64> {
        let Self { neighbourhood: Neighbourhood { values, bandwidth, .. }, compared, factors } = self;
        let mut gradient = vec![0.0; values.count()];
        let (mut terms, mut distances) = (Vec::new(), Vec::new());
        for Compared { cloud, same, others } in compared {
            terms.resize((same.len() + others.len()) * values.count(), 0.0);
            distances.clear();
            for (&other, terms) in same.iter().chain(others).zip(terms.chunks_exact_mut(values.count())) {
                values.terms(*cloud, other, terms);
                distances.push(dot(terms, factors) / bandwidth);
            }
            let of_all = softmax(&distances);
            let of_same = softmax(&distances[..same.len()]);
            for (place, terms) in terms.chunks_exact(values.count()).enumerate() {
                // d(−ln p) by the distance.
                let of_same = of_same.get(place).copied().unwrap_or_default();
                let slope = (of_same - of_all[place]) / bandwidth;
                gradient.iter_mut().zip(terms).for_each(|(gradient, term)| *gradient += slope * term);
            }
        }
        gradient
    }
}

/// The share of each exp(−d) in the sum of all.
fn softmax(distances: &[f64]) -> Vec<f64> {
    let least = distances.iter().copied().fold(f64::INFINITY, f64::min);
    let mut shares: Vec<f64> = distances.iter().map(|distance| libm::exp(least - distance)).collect();
    let all: f64 = shares.iter().sum();
    shares.iter_mut().for_each(|share| *share /= all);
    shares
}

#[cfg(test)]
mod tests {
    use super::super::testing;
    use super::*;

    /// What is to be small, from its definition.
    fn loss(neighbourhoods: &[Neighbourhood], roots: &[f64]) -> f64 {
        let ridge: f64 = roots.iter().map(|root| RIDGE * (root - 1.0) * (root - 1.0)).sum();
        let of_set = |one: &Neighbourhood| {
            let likelihood = |cloud: usize, other: &usize| {
                let mut terms = vec![0.0; roots.len()];
                one.values.terms(cloud, *other, &mut terms);
                let distance: f64 = terms.iter().zip(roots).map(|(term, root)| term * root * root).sum();
                libm::exp(-distance / one.bandwidth)
            };
            let of_cloud = |compared: &Compared| {
                let sum = |of: &[usize]| of.iter().map(|it| likelihood(compared.cloud, it)).sum::<f64>();
                let same = sum(&compared.same);
                -libm::log(same / (same + sum(&compared.others)))
            };
            one.cloud_weight * one.compared.iter().map(of_cloud).sum::<f64>()
        };
        ridge + neighbourhoods.iter().map(of_set).sum::<f64>()
    }

    #[test]
    fn the_gradient_is_that_of_the_definition_and_steps_lead_down_it() {
        for metric in crate::SetDistance::ALL {
            let sample = testing::Sample::new(48);
            let channels = sample.channels(metric);
            let sets = [sample.set(&channels, 1), sample.set(&channels, 3)];
            let weights: Vec<f64> = (0..7).map(|value| 0.5 + 0.25 * f64::from(value)).collect();
            let neighbourhoods = neighbourhoods(&sets.each_ref(), &weights);
            let roots: Vec<f64> = (0..7).map(|value| 1.2 - 0.1 * f64::from(value)).collect();
            let gradient = gradient(&neighbourhoods, &roots);
            for value in 0..7 {
                let at = |step: f64| {
                    let mut roots = roots.clone();
                    roots[value] += step;
                    loss(&neighbourhoods, &roots)
                };
                let numeric = (at(1e-5) - at(-1e-5)) / 2e-5;
                let difference = (numeric - gradient[value]).abs();
                assert!(
                    difference < 1e-6 * (1.0 + numeric.abs()),
                    "{metric:?} {value}: {numeric} {gradient:?}"
                );
            }
            let found: Vec<f64> = factors(&sets.each_ref(), &weights).into_iter().map(f64::sqrt).collect();
            let [before, after] = [&vec![1.0; 7], &found].map(|roots| loss(&neighbourhoods, roots));
            assert!(after < before, "{after} {before}");
            // No value moved a little further would be much better.
            for value in 0..7 {
                for step in [-0.05, 0.05] {
                    let mut roots = found.clone();
                    roots[value] = f64::max(roots[value] + step, LEAST_ROOT);
                    let moved = loss(&neighbourhoods, &roots);
                    assert!(moved > after - 0.01 * (before - after), "{value}: {moved} {after} {before}");
                }
            }
        }
    }

    #[test]
    fn a_set_whose_clouds_have_twins_everywhere_changes_no_factor() {
        let sample = testing::Sample::new(48);
        let channels = sample.channels(crate::SetDistance::ChiSquared);
        let twins = testing::Sample::of(&[[0.5; 7]; 12]);
        let of_twins = twins.channels(crate::SetDistance::ChiSquared);
        let (set, of_twins) = (sample.set(&channels, 1), twins.set(&of_twins, 5));
        assert_eq!(factors(&[&set, &of_twins], &[1.0; 7]), factors(&[&set], &[1.0; 7]));
        assert_eq!(factors(&[&of_twins], &[1.0; 7]), [1.0; 7]);
    }

    /// Weights may be as large as they like: only proportions matter.
    #[test]
    fn factors_do_not_change_with_the_unit_of_weights() {
        let sample = testing::Sample::new(48);
        for metric in crate::SetDistance::ALL {
            let channels = sample.channels(metric);
            let set = sample.set(&channels, 1);
            let of_unit = |unit: f64| factors(&[&set], &[unit; 7]);
            assert_eq!(of_unit(libm::exp2(400.0)), of_unit(1.0));
        }
    }

    #[test]
    fn shares_are_finite_however_far_clouds_are() {
        assert_eq!(softmax(&[1e6, 1e6]), [0.5, 0.5]);
        assert_eq!(softmax(&[0.0, 1e6]), [1.0, 0.0]);
        assert!((softmax(&[1.0, 2.0])[0] - 1.0 / (1.0 + libm::exp(-1.0))).abs() < 1e-12);
    }
}
