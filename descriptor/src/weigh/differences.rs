//! How much the values of signatures differ within objects and between them.

use rayon::prelude::*;

use super::values::{Compared, Values};
use super::{LabelledSet, WeighError, check_clouds};

/// Additive smoothing: the share of the mean difference within objects that is added to every difference, so that values
/// that hardly ever differ do not decide.
const SMOOTHING: f64 = 0.05;

/// Clouds whose means are held in memory at once.
const AT_ONCE: usize = 1024;

/// How much each value differs: sums over clouds of means.
pub struct Differences {
    /// From clouds of the same object.
    pub same: Vec<f64>,
    /// From those of other objects.
    pub others: Vec<f64>,
}

impl Differences {
    /// As if all sets had as many clouds as the first that teaches anything, each set times its weight; and those that do.
    ///
    /// # Errors
    /// [`WeighError`] of the last, if none does.
    pub fn of_all<'a>(sets: &'a [LabelledSet<'a>]) -> Result<(Self, Vec<&'a LabelledSet<'a>>), WeighError> {
        let (mut all, mut taught): (Option<(Self, usize)>, _) = (None, Vec::new());
        let mut refused = WeighError::Sequences;
        for set in sets {
            if let Err(why) = check_clouds(set.clouds.objects, set.sequences) {
                refused = why;
                continue;
            }
            taught.push(set);
            let (found, clouds) = Self::between(set);
            let width = found.same.len();
            let none = || (Self { same: vec![0.0; width], others: vec![0.0; width] }, clouds);
            let (sums, of_first) = all.get_or_insert_with(none);
            let share = f64::from(set.weight) * (*of_first as f64 / clouds as f64);
            for (sum, of_set) in [(&mut sums.same, &found.same), (&mut sums.others, &found.others)] {
                sum.iter_mut().zip(of_set).for_each(|(sum, difference)| *sum += share * difference);
            }
        }
        all.map(|(all, _)| (all, taught)).ok_or(refused)
    }

    /// The weight of each value that they make likely: the square of the ratio of both.
    pub fn weights(&self) -> Vec<f64> {
        let smoothing = SMOOTHING * self.same.iter().sum::<f64>() / self.same.len() as f64;
        let of_value = |(same, others): (&f64, &f64)| {
            // Where nothing at all differs within objects, no value is better than another.
            let ratio = if smoothing > 0.0 { (others + smoothing) / (same + smoothing) } else { 1.0 };
            ratio * ratio
        };
        self.same.iter().zip(&self.others).map(of_value).collect()
    }

    /// Of one set; and the number of its clouds that are compared with others.
    fn between(set: &LabelledSet<'_>) -> (Self, usize) {
        let width = set.clouds.channels.iter().map(|(signatures, ..)| signatures.width).sum();
        let values = Values::new(set, &vec![1.0; width]);
        let compared = values.compared(set);
        let means = |one: &Compared| [&one.same, &one.others].map(|of| mean_terms(&values, one.cloud, of));
        let mut sums = [vec![0.0; width], vec![0.0; width]];
        for some in compared.chunks(AT_ONCE) {
            let means: Vec<[Vec<f64>; 2]> = some.par_iter().map(means).collect();
            // In the order of the clouds.
            for of_cloud in &means {
                for (sum, terms) in sums.iter_mut().zip(of_cloud) {
                    sum.iter_mut().zip(terms).for_each(|(sum, term)| *sum += term);
                }
            }
        }
        let [same, others] = sums;
        (Self { same, others }, compared.len())
    }
}

/// The terms of each value, mean over the distances of a cloud to others.
fn mean_terms(values: &Values, cloud: usize, others: &[usize]) -> Vec<f64> {
    let (mut sums, mut terms) = (vec![0.0; values.count()], vec![0.0; values.count()]);
    for &other in others {
        values.terms(cloud, other, &mut terms);
        sums.iter_mut().zip(&terms).for_each(|(sum, term)| *sum += term);
    }
    sums.iter_mut().for_each(|sum| *sum /= others.len() as f64);
    sums
}
