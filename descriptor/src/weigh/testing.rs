//! Clouds of seven values for tests.

use super::LabelledSet;
use crate::distance::SetDistance;
use crate::recogniser::LabelledClouds;
use crate::signature::{Signature, Signatures};

/// Seven values of each cloud in the two channels.
pub fn signatures(clouds: &[[f32; 7]]) -> [Signatures; 2] {
    let of = |part: fn(&[f32; 7]) -> Signature| -> Signatures {
        clouds.iter().map(part).collect::<Vec<_>>().iter().collect()
    };
    [
        of(|values| Signature { centroid: values[..3].to_vec(), deviation: Vec::new() }),
        of(|values| Signature { centroid: values[3..5].to_vec(), deviation: values[5..].to_vec() }),
    ]
}

/// Seven values that follow from a number.
pub fn noise(seed: usize) -> [f32; 7] {
    std::array::from_fn(|value| ((seed * 37 + value * 11 + seed * value * 5) % 23) as f32 / 23.0)
}

/// Clouds of three objects in two sequences.
pub struct Sample {
    signatures: [Signatures; 2],
    objects: Vec<u32>,
    sequences: Vec<Option<u32>>,
}

impl Sample {
    /// So many clouds.
    pub fn new(count: usize) -> Self {
        Self::of(&(0..count).map(noise).collect::<Vec<_>>())
    }

    /// These clouds.
    pub fn of(clouds: &[[f32; 7]]) -> Self {
        let count = clouds.len();
        let (objects, sequences) = (0..count as u32).map(|cloud| (cloud % 3, Some(cloud / 3 % 2))).unzip();
        Self { signatures: signatures(clouds), objects, sequences }
    }

    /// Both channels, compared by a metric.
    pub fn channels(&self, metric: SetDistance) -> [(&Signatures, SetDistance, f64); 2] {
        let [first, second] = &self.signatures;
        [(first, metric, 1.0), (second, metric, 0.25)]
    }

    /// The set of these channels.
    pub fn set<'a>(
        &'a self,
        channels: &'a [(&'a Signatures, SetDistance, f64)],
        weight: u32,
    ) -> LabelledSet<'a> {
        let clouds = LabelledClouds { channels, objects: &self.objects };
        LabelledSet { clouds, sequences: &self.sequences, weight }
    }
}
