//! The parts of some clouds under a descriptor without genes as bytes, to be handed on.

use crate::description::DescriptionError;
use crate::fixed::FixedKind;
use crate::summary::{Part, Parts};

/// Some clouds under one descriptor.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DescribedClouds {
    /// How many keypoints of each cloud are described; of a cloud with 0 the part means nothing.
    pub keypoints: Vec<u32>,
    /// Centroids and deviations.
    pub parts: Parts,
}

impl DescribedClouds {
    /// Adds a cloud: how many of its keypoints are described, and their summary; `None` if there are none.
    pub fn push(&mut self, kind: FixedKind, described: Option<(u32, Part)>) {
        let nothing = || (0, Part { centroid: vec![0.0; kind.size()], deviation: vec![0.0; kind.size()] });
        let (keypoints, part) = described.unwrap_or_else(nothing);
        self.keypoints.push(keypoints);
        self.parts.append(&std::iter::once(&part).collect());
    }

    /// Adds the clouds of `other` after these.
    ///
    /// # Panics
    /// If they are of another descriptor: a programming error.
    pub fn append(&mut self, other: &Self) {
        self.keypoints.extend_from_slice(&other.keypoints);
        self.parts.append(&other.parts);
    }
}

impl DescribedClouds {
    /// Those that are described: which they are, and their parts.
    pub fn into_described(self) -> (Vec<u32>, Parts) {
        if !self.keypoints.contains(&0) {
            return ((0..self.keypoints.len() as u32).collect(), self.parts);
        }
        let described = |index: &u32| self.keypoints[*index as usize] > 0;
        let clouds: Vec<u32> = (0..self.keypoints.len() as u32).filter(described).collect();
        let width = self.parts.width;
        let rows = clouds.iter().flat_map(|&index| &self.parts.values[index as usize * width..][..width]);
        let values = rows.copied().collect();
        let parts = Parts { width: if clouds.is_empty() { 0 } else { width }, clouds: clouds.len(), values };
        (clouds, parts)
    }
}

/// Values of one cloud.
fn width(kind: FixedKind) -> u64 {
    2 * kind.size() as u64
}

/// Largest value that the descriptor has: PFHRGB counts ordered pairs in per cent of unordered ones, SHOT has unit length.
fn largest(kind: FixedKind) -> u8 {
    match kind {
        FixedKind::PfhRgb => 200,
        FixedKind::ShotColor => 1,
    }
}

/// Length of the description of so many clouds, bytes.
pub fn length(kind: FixedKind, clouds: u32) -> u64 {
    4 * u64::from(clouds) * (1 + width(kind))
}

/// Of each cloud its number of keypoints, then of each cloud its values; little-endian u32 and f32.
pub fn encode(clouds: &DescribedClouds) -> Vec<u8> {
    let keypoints = clouds.keypoints.iter().flat_map(|keypoints| keypoints.to_le_bytes());
    keypoints.chain(clouds.parts.values.iter().flat_map(|value| value.to_le_bytes())).collect()
}

/// Whether these bytes can be the description of so many clouds.
///
/// # Errors
/// If they cannot.
pub fn check(bytes: &[u8], kind: FixedKind, clouds: u32) -> Result<(), DescriptionError> {
    let expected = length(kind, clouds);
    if bytes.len() as u64 != expected {
        return Err(DescriptionError::Length { expected, got: bytes.len() });
    }
    // What rounding adds to a mean or a spread.
    let bounds = 0.0..=f32::from(largest(kind)) * 1.001;
    match values(bytes, clouds).find(|value| !bounds.contains(value)) {
        Some(value) => Err(DescriptionError::Value { largest: largest(kind), got: value.to_string() }),
        None => Ok(()),
    }
}

fn values(bytes: &[u8], clouds: u32) -> impl Iterator<Item = f32> {
    bytes.as_chunks::<4>().0.iter().skip(clouds as usize).map(|&value| f32::from_le_bytes(value))
}

/// Undoes [`encode`] for a kind of descriptor and a number of clouds. Whatever the bytes are, distances between the
/// parts are finite.
///
/// # Errors
/// If the bytes cannot be the description of so many clouds.
pub fn decode(bytes: &[u8], kind: FixedKind, clouds: u32) -> Result<DescribedClouds, DescriptionError> {
    check(bytes, kind, clouds)?;
    let keypoints = bytes.as_chunks::<4>().0.iter().take(clouds as usize);
    let keypoints = keypoints.map(|&count| u32::from_le_bytes(count)).collect();
    let width = if clouds == 0 { 0 } else { width(kind) as usize };
    let parts = Parts { width, clouds: clouds as usize, values: values(bytes, clouds).collect() };
    Ok(DescribedClouds { keypoints, parts })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::sheet;
    use crate::{FixedDescriptor, Preprocess};

    /// Two clouds of which the second cannot be described.
    fn described(kind: FixedKind) -> DescribedClouds {
        let cloud = sheet(3, 200);
        let part =
            FixedDescriptor { kind, radius_um: 50_000 }.summary(&cloud, &Preprocess::default()).unwrap();
        let mut clouds = DescribedClouds::default();
        clouds.push(kind, Some((7, part)));
        clouds.push(kind, None);
        clouds
    }

    #[test]
    fn what_was_encoded_is_decoded() {
        for kind in FixedKind::ALL {
            let clouds = described(kind);
            let bytes = encode(&clouds);
            assert_eq!(bytes.len() as u64, length(kind, 2));
            assert_eq!(decode(&bytes, kind, 2).unwrap(), clouds);
            assert_eq!(decode(&[], kind, 0).unwrap(), DescribedClouds::default());
            let mut twice = clouds.clone();
            twice.append(&clouds);
            assert_eq!(twice.keypoints, [7, 0, 7, 0]);
            assert_eq!(decode(&encode(&twice), kind, 4).unwrap(), twice);
            let (indices, parts) = twice.into_described();
            assert_eq!((&indices[..], parts.get(0), parts.clouds()), (&[0, 2][..], parts.get(1), 2));
            assert_eq!(parts.get(0), clouds.parts.get(0));
        }
    }

    #[test]
    fn bytes_of_other_clouds_and_values_that_no_histograms_have_are_refused() {
        for kind in FixedKind::ALL {
            let bytes = encode(&described(kind));
            for clouds in [0, 1, 3, u32::MAX] {
                assert!(matches!(decode(&bytes, kind, clouds), Err(DescriptionError::Length { .. })));
            }
            for value in [f32::NAN, f32::INFINITY, -0.5, 201.0] {
                let mut bytes = bytes.clone();
                bytes[400..404].copy_from_slice(&value.to_le_bytes());
                assert!(matches!(decode(&bytes, kind, 2), Err(DescriptionError::Value { .. })), "{value}");
            }
        }
    }
}
