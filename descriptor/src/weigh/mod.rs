//! Weights for the values of a structure's signatures, learned from labelled clouds: a value counts for as much as it
//! tells objects apart.

mod differences;
mod neighbourhood;
#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;
mod values;

use std::collections::{BTreeMap, BTreeSet};

use crate::distance::SetDistance;
use crate::recogniser::{LabelledClouds, Method};
use crate::signature::{Signature, Signatures};
use crate::structure::{Scale, Structure, StructureChannel, Weighted, scale_among};
use differences::Differences;
use neighbourhood::factors;

/// How weights are found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Weighing {
    /// Each by how much its value differs: for recognisers that learn from the same clouds once more.
    Separately,
    /// All together, from there on, by neighbourhood components analysis: for the nearest cloud.
    Jointly,
}

impl Weighing {
    /// All of them.
    pub const ALL: [Self; 2] = [Self::Jointly, Self::Separately];

    /// The one of this name.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|how| how.name() == name)
    }

    /// As experiments have it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Separately => "separately",
            Self::Jointly => "jointly",
        }
    }

    /// Whether other weights are likely to suit a recogniser better: one that learns from the clouds that taught the
    /// weights, whose distances to each other they have made small.
    pub fn misleads(self, method: Method) -> bool {
        self == Self::Jointly && method != Method::Nearest
    }
}

/// Why values cannot be weighed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum WeighError {
    /// They have weights already.
    #[error(
        "structure: values without weights expected, got some with\nname the structure that they were found for"
    )]
    Weighted,
    /// More values than weights may be kept of.
    #[error(
        "structure: at most {} values expected, got {got}\nname a structure with fewer bins",
        Structure::MAX_VALUE_WEIGHTS
    )]
    Values {
        /// Values of all channels together.
        got: u64,
    },
    /// Nothing says what an object looks like in another sequence.
    #[error(
        "clouds: an object seen in two sequences expected, got none\nname sequences in the manifest, or lay clouds out as object_sequence_frame"
    )]
    Sequences,
    /// There is nothing to be told apart.
    #[error(
        "clouds: two objects expected that are seen in different sequences, got fewer\nadd clouds of others"
    )]
    Objects,
}

/// Labelled clouds of one set, which are compared with each other only.
#[derive(Clone, Copy, Debug)]
pub struct LabelledSet<'a> {
    /// The clouds under the structure, with what they show.
    pub clouds: LabelledClouds<'a>,
    /// Of which sequence each is; `None` where it is not known: such clouds teach nothing.
    pub sequences: &'a [Option<u32>],
    /// How much the set counts.
    pub weight: u32,
}

/// Refuses clouds of a set that teach nothing, by the objects that they show and the sequences that they are of.
///
/// # Errors
/// [`WeighError::Sequences`] or [`WeighError::Objects`]
pub fn check_clouds(objects: &[u32], sequences: &[Option<u32>]) -> Result<(), WeighError> {
    let mut seen: BTreeMap<u32, BTreeSet<u32>> = BTreeMap::new();
    for (&object, sequence) in objects.iter().zip(sequences) {
        if let Some(sequence) = sequence {
            seen.entry(object).or_default().insert(*sequence);
        }
    }
    if seen.values().all(|sequences| sequences.len() < 2) {
        return Err(WeighError::Sequences);
    }
    // Whatever sequence another object is in, the one that is seen twice is seen in a different one, too.
    if seen.len() < 2 { Err(WeighError::Objects) } else { Ok(()) }
}

/// A structure with weights for the values of its signatures, learned from sets of labelled clouds, by the current rayon
/// pool.
///
/// Each cloud is compared, value by value, with the 20 nearest clouds of its object in other sequences, and with the 20
/// nearest of other objects in other sequences. Let s and o be the sums over the clouds of the mean terms of a value, and f
/// a twentieth of the mean of s over all values, in the proportions in which channels are added up: then the weight of the
/// value begins at ((o + f) / (s + f))². Of several sets, the means over their clouds are added up, each times the set's
/// weight.
///
/// To weigh values [jointly](Weighing::Jointly), neighbourhood components analysis (Goldberger, Roweis, Hinton and
/// Salakhutdinov, 2004) finds a factor r² for each from there: the sum over the clouds of −ln p, p being the share of the
/// cloud's object in the sum of exp(−d / t) over the clouds that it is compared with, and of (r − 1)² / 4 over the values
/// becomes small. t is half of the mean, over all clouds, of the distance to the nearest cloud of the same object.
///
/// Weights of a channel are divided by the largest, and the weight of the channel is multiplied by as much and by what
/// changes of its scale, the mean over the sets by their weights. All channels' weights are divided by the mean of the
/// values' weights, s being their share, and by as much as the largest would be beyond [`Weighted::MAX_WEIGHT_PPM`].
/// A set that teaches nothing counts for nothing.
///
/// # Errors
/// [`WeighError`]
///
/// # Panics
/// If the clouds are not described by the structure's channels, or not all labelled, or if a set has no weight: a programming
/// error.
pub fn weighed(
    structure: &Structure,
    sets: &[LabelledSet<'_>],
    how: Weighing,
) -> Result<Structure, WeighError> {
    for LabelledSet { clouds, sequences, weight } in sets {
        assert!(*weight > 0, "a weight of each set");
        assert_eq!(clouds.channels.len(), structure.channels.len(), "signatures of each channel");
        assert_eq!(clouds.objects.len(), sequences.len(), "labels of each cloud");
    }
    if structure.has_value_weights() {
        return Err(WeighError::Weighted);
    }
    let got = structure.signature_values();
    if got > Structure::MAX_VALUE_WEIGHTS as u64 {
        return Err(WeighError::Values { got });
    }
    let (differences, taught) = Differences::of_all(sets)?;
    let mut weights = differences.weights();
    if how == Weighing::Jointly {
        let factors = factors(&taught, &weights);
        weights.iter_mut().zip(factors).for_each(|(weight, factor)| *weight *= factor);
    }
    // Distances stay about as large as they were.
    let all: f64 = differences.same.iter().sum();
    let after: f64 = differences.same.iter().zip(&weights).map(|(same, weight)| same * weight).sum();
    let mean = if all > 0.0 { after / all } else { 1.0 };

    let mut rest = weights.as_slice();
    let mut weighted: Vec<(StructureChannel, f64)> = Vec::new();
    for (number, one) in structure.channels.iter().enumerate() {
        let (of_channel, later) = rest.split_at(one.channel.values() as usize);
        rest = later;
        let sets: Vec<(Clouds<'_>, u32)> =
            taught.iter().map(|set| (Clouds::new(&set.clouds, number), set.weight)).collect();
        let (channel, times) = weigh(one, of_channel, &sets);
        weighted.push((channel, f64::from(one.weight_ppm) * times / mean));
    }
    // Only proportions matter.
    let most = f64::from(Weighted::MAX_WEIGHT_PPM);
    let beyond = weighted.iter().fold(1.0, |beyond: f64, (_, weight)| beyond.max(weight / most));
    let channels = structure.channels.iter().zip(weighted).map(|(one, (channel, weight))| {
        let weight_ppm = (weight / beyond).round().max(1.0) as u32;
        Weighted { channel, weight_ppm, scale: one.scale }
    });
    Ok(Structure { channels: channels.collect() })
}

/// Clouds of a set in one channel.
struct Clouds<'a> {
    signatures: &'a Signatures,
    metric: SetDistance,
}

/// The channel with these weights over the largest, and what its own weight is multiplied by, so that its distances are in
/// the same proportion to others as without the scale.
fn weigh(one: &Weighted, weights: &[f64], sets: &[(Clouds<'_>, u32)]) -> (StructureChannel, f64) {
    let largest = weights.iter().copied().fold(0.0, f64::max);
    let full = f64::from(StructureChannel::FULL);
    let share = |weight: &f64| (weight / largest * full).round() as u16;
    let mut channel =
        StructureChannel { value_weights: weights.iter().map(share).collect(), ..one.channel.clone() };
    let rescaled = match one.scale {
        Scale::None => 1.0,
        Scale::Quantile => {
            let (mut sum, mut all) = (0.0, 0.0);
            for (set, weight) in sets {
                sum += f64::from(*weight) * (set.scale(Some(&channel)) / set.scale(None));
                all += f64::from(*weight);
            }
            sum / all
        }
    };
    if channel.value_weights.iter().all(|&weight| weight == StructureChannel::FULL) {
        channel.value_weights.clear();
    }
    (channel, largest * rescaled)
}

impl<'a> Clouds<'a> {
    fn new(clouds: &LabelledClouds<'a>, channel: usize) -> Self {
        let (signatures, metric, _) = clouds.channels[channel];
        Self { signatures, metric }
    }

    /// What their distances are divided by, if values have the weights of a channel.
    fn scale(&self, weighted: Option<&StructureChannel>) -> f64 {
        let Some(channel) = weighted else { return scale_among(self.metric, self.signatures) };
        scale_among(self.metric, &weighted_by(channel, self.signatures))
    }
}

/// The signatures of clouds, each value times its weight in a channel.
pub fn weighted_by(channel: &StructureChannel, signatures: &Signatures) -> Signatures {
    let weighted = |cloud| channel.weighted(signatures.signature(cloud));
    (0..signatures.clouds()).map(weighted).collect::<Vec<Signature>>().iter().collect()
}
