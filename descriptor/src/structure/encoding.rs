//! Clouds that are ready for structures as bytes, to be kept and handed on.

use crate::disk_ring::encoding::DecodeError;
use crate::normals::Normal;
use crate::structure::cloud::{GRIDS_UM, Points, StructureCloud};

/// Lists of points: those of the cloud and those of its grids.
const LISTS: usize = 1 + GRIDS_UM.len();

/// Whether there are colours (0 or 1), viewpoint (f32), radius of the normals (u32), lengths of the lists (u32).
const HEADER_BYTES: usize = 1 + 12 + 4 + 4 * LISTS;

impl StructureCloud {
    /// All numbers in little-endian order: whether there are colours (u8, 0 or 1), the viewpoint (three f32), the radius
    /// that normals were fitted within (u32, micrometres), the number of points and of each grid's keypoints (u32). Then
    /// list after list: positions (three f32 each), with colour the colours (three u8 each), for each point whether it has
    /// a normal (u8, 0 or 1), and the normals (three f32 each) of those that do.
    pub fn encode(&self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(HEADER_BYTES + self.bytes());
        bytes.push(u8::from(self.points.colours.is_some()));
        put_floats(&mut bytes, &[self.viewpoint]);
        bytes.extend(self.normal_radius_um.to_le_bytes());
        let lists = || std::iter::once(&self.points).chain(&self.grids);
        bytes.extend(lists().flat_map(|list| (list.positions.len() as u32).to_le_bytes()));
        for Points { positions, colours, normals } in lists() {
            put_floats(&mut bytes, positions);
            bytes.extend_from_slice(colours.as_deref().unwrap_or_default().as_flattened());
            bytes.extend(normals.iter().map(|normal| u8::from(normal.is_some())));
            put_floats(&mut bytes, normals.iter().flatten());
        }
        bytes
    }

    /// Undoes [`StructureCloud::encode`]. Whatever the bytes are, the cloud has a signature in every channel, or an error.
    ///
    /// # Errors
    /// If the bytes are not those of a cloud.
    pub fn decode(bytes: &[u8]) -> Result<Self, DecodeError> {
        let mut rest = Reader { rest: bytes, length: bytes.len() };
        let has_colours = match rest.take(1)? {
            [0] => false,
            [1] => true,
            _ => return Err(DecodeError::Inconsistent { what: "a cloud must have colours or none" }),
        };
        let viewpoint = rest.floats(1)?.first().copied().unwrap_or_default();
        let normal_radius_um = rest.number()?;
        let mut lengths = [0; LISTS];
        for length in &mut lengths {
            *length = rest.number()? as usize;
        }
        let [points, grids @ ..] = lengths;
        let points = rest.points(points, has_colours)?;
        let mut lists = grids.into_iter();
        let mut grids: [Points; GRIDS_UM.len()] = Default::default();
        for (grid, length) in grids.iter_mut().zip(&mut lists) {
            *grid = rest.points(length, has_colours)?;
        }
        if !rest.rest.is_empty() {
            let expected = (bytes.len() - rest.rest.len()) as u64;
            return Err(DecodeError::Length { expected, got: bytes.len() });
        }
        Ok(Self { points, grids, viewpoint, normal_radius_um })
    }
}

fn put_floats<'a>(bytes: &mut Vec<u8>, vectors: impl IntoIterator<Item = &'a [f32; 3]>) {
    bytes.extend(vectors.into_iter().flatten().flat_map(|number| number.to_le_bytes()));
}

/// Bytes that have not been read yet.
struct Reader<'a> {
    rest: &'a [u8],
    /// Of all bytes.
    length: usize,
}

impl<'a> Reader<'a> {
    fn take(&mut self, count: usize) -> Result<&'a [u8], DecodeError> {
        let Some((taken, rest)) = self.rest.split_at_checked(count) else {
            let read = (self.length - self.rest.len()) as u64;
            return Err(DecodeError::Length {
                expected: read.saturating_add(count as u64),
                got: self.length,
            });
        };
        self.rest = rest;
        Ok(taken)
    }

    fn number(&mut self) -> Result<u32, DecodeError> {
        Ok(self.take(4)?.iter().rev().fold(0, |sum, &byte| sum << 8 | u32::from(byte)))
    }

    fn floats(&mut self, count: usize) -> Result<Vec<[f32; 3]>, DecodeError> {
        let vectors = self.take(count.saturating_mul(12))?.as_chunks::<12>().0;
        let number = |bytes: &[u8; 12], axis: usize| {
            f32::from_le_bytes([0, 1, 2, 3].map(|byte| bytes[4 * axis + byte]))
        };
        let floats: Vec<[f32; 3]> =
            vectors.iter().map(|bytes| [0, 1, 2].map(|axis| number(bytes, axis))).collect();
        if floats.as_flattened().iter().all(|number| number.is_finite()) {
            Ok(floats)
        } else {
            Err(DecodeError::Inconsistent { what: "positions and normals must be finite" })
        }
    }

    fn points(&mut self, count: usize, has_colours: bool) -> Result<Points, DecodeError> {
        let positions = self.floats(count)?;
        let colours = if has_colours {
            Some(self.take(count.saturating_mul(3))?.as_chunks::<3>().0.to_vec())
        } else {
            None
        };
        let has_normal = self.take(count)?;
        if has_normal.iter().any(|&has| has > 1) {
            return Err(DecodeError::Inconsistent { what: "a point must have a normal or none" });
        }
        let oriented = has_normal.iter().filter(|&&has| has == 1).count();
        let mut normals = self.floats(oriented)?.into_iter();
        let normals: Vec<Normal> =
            has_normal.iter().map(|&has| if has == 1 { normals.next() } else { None }).collect();
        Ok(Points { positions, colours, normals })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::distance::SetDistance;
    use crate::structure::channel::{Axis, Pairs, StructureChannel};
    use crate::structure::feature::Feature;
    use crate::testing::sheet;
    use crate::{Cloud, Preprocess};

    fn ready(cloud: &Cloud) -> StructureCloud {
        let preprocess = Preprocess { colour: cloud.colours.is_some(), ..Preprocess::default() };
        StructureCloud::new(cloud, &preprocess).unwrap()
    }

    #[test]
    fn what_was_encoded_is_decoded() {
        let mut sparse = sheet(2, 100);
        sparse.points[7] = [1.0, 1.0, 1.0];
        for cloud in [sheet(1, 300), sparse, Cloud { colours: None, ..sheet(1, 300) }] {
            let cloud = ready(&cloud);
            let bytes = cloud.encode();
            assert_eq!(StructureCloud::decode(&bytes), Ok(cloud));
        }
    }

    #[test]
    fn bytes_of_another_length_are_refused() {
        let bytes = ready(&sheet(1, 60)).encode();
        let is_refused = |bytes: &[u8]| {
            let got = bytes.len();
            matches!(StructureCloud::decode(bytes), Err(DecodeError::Length { got: told, .. }) if told == got)
        };
        assert!((0..bytes.len()).all(|length| is_refused(&bytes[..length])));
        assert!(is_refused(&[bytes.as_slice(), &[0]].concat()));
        let mut huge = bytes;
        huge[17..21].fill(0xff);
        assert!(is_refused(&huge));
    }

    #[test]
    fn no_flipped_bit_makes_a_cloud_that_cannot_be_used() {
        let bytes = ready(&sheet(1, 40)).encode();
        let axes = [Feature::Distance, Feature::F1, Feature::W1];
        let channels = [(Pairs::KeypointNeighbour, 20_000), (Pairs::Neighbours, 70_000), (Pairs::Cloud, 0)];
        let channels = channels.map(|(pairs, grid_um)| StructureChannel {
            pairs,
            axes: axes.map(|feature| Axis { feature, bins: 4, full_turn: false }).to_vec(),
            is_joint: true,
            squash_milli: 300,
            radius_um: 40_000,
            shells_um: vec![20_000, 40_000],
            least_um: 0,
            grid_um,
            samples: 64,
            oriented: false,
            all_keypoints: false,
            metric: SetDistance::ChiSquared,
            value_weights: Vec::new(),
        });
        let (mut refused, mut used) = (0, 0);
        for position in 0..bytes.len() {
            for bit in [0, 5, 6, 7] {
                let mut flipped = bytes.clone();
                flipped[position] ^= 1 << bit;
                let Ok(cloud) = StructureCloud::decode(&flipped) else {
                    refused += 1;
                    continue;
                };
                used += 1;
                for channel in &channels {
                    // A point may have moved beyond the cells that can be counted.
                    if let Ok(signature) = channel.signature(&cloud) {
                        assert!(signature.centroid.iter().all(|share| (0.0..=1.0).contains(share)));
                    }
                }
            }
        }
        assert!(refused > 0 && used > 0, "{refused} refused, {used} used");
    }

    #[test]
    fn numbers_that_mean_nothing_are_refused() {
        let bytes = ready(&sheet(1, 60)).encode();
        let refused = |place: usize, values: &[u8]| {
            let mut spoilt = bytes.clone();
            spoilt[place..place + values.len()].copy_from_slice(values);
            StructureCloud::decode(&spoilt).unwrap_err()
        };
        let inconsistent = |what| DecodeError::Inconsistent { what };
        let infinite = f32::INFINITY.to_le_bytes();
        assert_eq!(refused(0, &[2]), inconsistent("a cloud must have colours or none"));
        assert_eq!(refused(HEADER_BYTES, &infinite), inconsistent("positions and normals must be finite"));
        let flag = HEADER_BYTES + 60 * (12 + 3);
        assert_eq!(refused(flag, &[2]), inconsistent("a point must have a normal or none"));
    }
}
