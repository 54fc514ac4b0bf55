//! Values of labelled clouds, laid out so that a distance is a plain sum of their terms.

use rayon::prelude::*;

use super::LabelledSet;
use crate::database::Database;
use crate::distance::SetDistance;
use crate::recognise::Label;
use crate::signature::{Signature, Signatures};

/// Clouds that a cloud is compared with, of its object and of others each: the nearest of them.
pub const NEAREST: usize = 20;

/// The values of clouds: channel after channel, centroid before deviation, each times its channel's factor and a weight of
/// its own. Every set distance of values that are so many times as large is so many times as large.
pub struct Values {
    values: Vec<f64>,
    count: usize,
    /// Where each channel ends, and how it is compared.
    channels: Vec<(usize, SetDistance)>,
}

/// A cloud, and which it is compared with, all of other sequences.
pub struct Compared {
    /// The cloud.
    pub cloud: usize,
    /// Of its object, the nearest first.
    pub same: Vec<usize>,
    /// Of other objects, the nearest first.
    pub others: Vec<usize>,
}

impl Values {
    /// Of the clouds of a set. `weights`: of each value.
    pub fn new(set: &LabelledSet<'_>, weights: &[f64]) -> Self {
        let (mut values, mut channels) = (Vec::new(), Vec::new());
        for cloud in 0..set.clouds.objects.len() {
            let first = values.len();
            for &(signatures, _, factor) in set.clouds.channels {
                let of_channel = signatures.get(cloud).concat();
                let place = values.len() - first;
                let weighted = of_channel.iter().zip(&weights[place..]);
                values.extend(weighted.map(|(&value, weight)| f64::from(value) * factor * weight));
            }
        }
        let mut end = 0;
        for &(signatures, metric, _) in set.clouds.channels {
            end += signatures.width;
            channels.push((end, metric));
        }
        Self { values, count: end, channels }
    }

    /// How many values a cloud has.
    pub fn count(&self) -> usize {
        self.count
    }

    fn of(&self, cloud: usize) -> &[f64] {
        &self.values[cloud * self.count..][..self.count]
    }

    /// What each value adds to the distance of two clouds.
    #[inline(always)]
    pub fn terms(&self, a: usize, b: usize, terms: &mut [f64]) {
        let (a, b) = (self.of(a), self.of(b));
        let mut first = 0;
        for &(end, metric) in &self.channels {
            let (a, b, terms) = (&a[first..end], &b[first..end], &mut terms[first..end]);
            match metric {
                SetDistance::ChiSquared => each(a, b, terms, |a, b| {
                    let (difference, sum) = (a - b, a + b);
                    // A quotient is computed of either, so that lanes need not part.
                    let divisor = if sum == 0.0 { 1.0 } else { 2.0 * sum };
                    difference * difference / divisor
                }),
                SetDistance::L1 => each(a, b, terms, |a, b| (a - b).abs()),
                SetDistance::Hellinger => each(a, b, terms, |a, b| {
                    let difference = a.sqrt() - b.sqrt();
                    difference * difference / 2.0
                }),
            }
            first = end;
        }
    }

    /// Each cloud of the set whose object is seen in another sequence, if another object is seen in another one, too; in
    /// their order.
    pub fn compared(&self, set: &LabelledSet<'_>) -> Vec<Compared> {
        let LabelledSet { sequences, clouds, .. } = *set;
        let objects = clouds.objects;
        // Whatever the weights, values are to be numbers of 32 bits. Powers of two change nothing but the exponent.
        let largest = self.values.iter().copied().fold(0.0, f64::max);
        let unit = if largest > 0.0 { libm::ldexp(1.0, -libm::ilogb(largest)) } else { 1.0 };
        let channels: Vec<(Signatures, SetDistance)> =
            (0..self.channels.len()).map(|channel| self.channel(channel, unit)).collect();
        let channels: Vec<_> =
            channels.iter().map(|(signatures, metric)| (signatures, *metric, 1.0)).collect();
        let labels = objects.iter().map(|&instance| Label { category: 0, instance }).collect();
        // No clouds, nothing to compare.
        let Ok(database) = Database::new(&channels, labels) else { return Vec::new() };
        let compared = |cloud: usize| -> Option<Compared> {
            sequences[cloud]?;
            let elsewhere =
                |&other: &usize| sequences[other].is_some() && sequences[other] != sequences[cloud];
            let (mut same, mut others): (Vec<usize>, Vec<usize>) =
                (0..objects.len()).filter(elsewhere).partition(|&other| objects[other] == objects[cloud]);
            if same.is_empty() || others.is_empty() {
                return None;
            }
            let query: Vec<Signature> =
                channels.iter().map(|(signatures, ..)| signatures.signature(cloud)).collect();
            let distances = database.distances(&query);
            for side in [&mut same, &mut others] {
                side.sort_by(|&a, &b| distances[a].total_cmp(&distances[b]).then(a.cmp(&b)));
                side.truncate(NEAREST);
            }
            Some(Compared { cloud, same, others })
        };
        (0..objects.len()).into_par_iter().filter_map(compared).collect()
    }

    /// One channel as signatures, whose values are these times a unit.
    fn channel(&self, channel: usize, unit: f64) -> (Signatures, SetDistance) {
        let (end, metric) = self.channels[channel];
        let first = channel.checked_sub(1).map_or(0, |before| self.channels[before].0);
        let signature = |values: &[f64]| Signature {
            centroid: values[first..end].iter().map(|value| (value * unit) as f32).collect(),
            deviation: Vec::new(),
        };
        let signatures: Vec<Signature> = self.values.chunks_exact(self.count).map(signature).collect();
        (signatures.iter().collect(), metric)
    }
}

#[inline(always)]
fn each(a: &[f64], b: &[f64], terms: &mut [f64], term: impl Fn(f64, f64) -> f64) {
    for ((term_of, &a), &b) in terms.iter_mut().zip(a).zip(b) {
        *term_of = term(a, b);
    }
}
