//! Prepared clouds as bytes, to be kept and handed on.

use crate::prepare::PreparedCloud;
use crate::quantise::Quantiser;

/// Why bytes are no prepared cloud.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DecodeError {
    /// Fewer or more bytes than their beginning says.
    #[error("prepared cloud: length must be {expected} bytes, got {got}\nprepare the cloud again")]
    Length { expected: u64, got: usize },
    /// The records are of other classes than the quantiser's.
    #[error("prepared cloud: made for another gene table\nprepare the cloud again")]
    OtherQuantiser,
    /// Numbers that contradict each other.
    #[error("prepared cloud: {what}\nprepare the cloud again")]
    Inconsistent { what: &'static str },
}

/// Digest of the quantiser, number of keypoints (u32), number of records (u64).
const HEADER_BYTES: usize = 32 + 4 + 8;

impl PreparedCloud {
    /// All numbers in little-endian order: digest of the quantiser (32 bytes), keypoints (u32), records (u64); for each
    /// keypoint and radius the records within (u32); the angle class of every record (u16); with colour, the colour
    /// class of every record (u16).
    pub fn encode(&self) -> Vec<u8> {
        let values = 4 * self.within.len() + 2 * (self.angles.len() + self.colours.len());
        let mut bytes = Vec::with_capacity(HEADER_BYTES + values);
        bytes.extend_from_slice(&self.digest);
        bytes.extend_from_slice(&(self.keypoints() as u32).to_le_bytes());
        bytes.extend_from_slice(&(self.records() as u64).to_le_bytes());
        bytes.extend(self.within.iter().flat_map(|count| count.to_le_bytes()));
        bytes.extend(self.angles.iter().chain(&self.colours).flat_map(|class| class.to_le_bytes()));
        bytes
    }

    /// Undoes [`PreparedCloud::encode`]. Whatever the bytes are, the cloud can be used with the quantiser's binnings.
    ///
    /// # Errors
    /// If the bytes are not those of a cloud prepared with this quantiser.
    pub fn decode(bytes: &[u8], quantiser: &Quantiser) -> Result<Self, DecodeError> {
        let inconsistent = |what| Err(DecodeError::Inconsistent { what });
        let short = DecodeError::Length { expected: HEADER_BYTES as u64, got: bytes.len() };
        let (digest, rest) = bytes.split_first_chunk::<32>().ok_or_else(|| short.clone())?;
        let (keypoints, rest) = rest.split_first_chunk::<4>().ok_or_else(|| short.clone())?;
        let (records, rest) = rest.split_first_chunk::<8>().ok_or(short)?;
        if *digest != quantiser.digest() {
            return Err(DecodeError::OtherQuantiser);
        }
        let (keypoints, records) = (u32::from_le_bytes(*keypoints), u64::from_le_bytes(*records));
        let halves = if quantiser.has_colour() { 2 } else { 1 };
        let radii = quantiser.radii();
        // In 128 bits, where no number of either field can overflow.
        let expected = HEADER_BYTES as u128
            + 4 * u128::from(keypoints) * radii as u128
            + 2 * halves * u128::from(records);
        if expected != bytes.len() as u128 {
            let expected = u64::try_from(expected).unwrap_or(u64::MAX);
            return Err(DecodeError::Length { expected, got: bytes.len() });
        }
        let records = records as usize; // no more than there are bytes
        let (counts, classes) = rest.split_at(4 * keypoints as usize * radii);
        let within: Vec<u32> =
            counts.as_chunks::<4>().0.iter().map(|&count| u32::from_le_bytes(count)).collect();
        let (angles, colours) = classes.split_at(2 * records);
        let classes = |bytes: &[u8]| -> Vec<u16> {
            bytes.as_chunks::<2>().0.iter().map(|&class| u16::from_le_bytes(class)).collect()
        };
        let (angles, colours) = (classes(angles), classes(colours));

        if keypoints == 0 {
            return inconsistent("a cloud without keypoints takes no part");
        }
        let mut starts = vec![0usize];
        for counts in within.chunks_exact(radii) {
            if !counts.is_sorted() {
                return inconsistent("a smaller radius must hold no more neighbours than a larger one");
            }
            let last = counts.last().copied().unwrap_or(0) as usize;
            starts.push(starts[starts.len() - 1] + last);
        }
        if starts[keypoints as usize] != records {
            return inconsistent("the keypoints must have as many neighbours as there are records");
        }
        let [angle_classes, colour_classes] = quantiser.classes();
        let below = |classes: &[u16], limit: usize| {
            classes.iter().max().is_none_or(|&most| usize::from(most) < limit)
        };
        if !below(&angles, angle_classes) || !below(&colours, colour_classes) {
            return inconsistent("records must be of the quantiser's classes");
        }
        Ok(Self { angles, colours, starts, within, radii, digest: *digest })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::sheet;
    use crate::{GeneTable, Parameters, Preprocess};

    fn quantiser(parameters: &Parameters) -> Quantiser {
        Quantiser::new(&GeneTable::single(parameters).unwrap()).unwrap()
    }

    fn prepared(quantiser: &Quantiser) -> PreparedCloud {
        PreparedCloud::new(&sheet(1, 200), &Preprocess::default(), quantiser).unwrap()
    }

    #[test]
    fn what_was_encoded_is_decoded() {
        let colourless = Parameters { colour_bins: 0, shape_weight_ppm: 1_000_000, ..Parameters::PAPER_BEST };
        let quantisers = [
            quantiser(&Parameters::PAPER_BEST),
            quantiser(&colourless),
            Quantiser::new(&GeneTable::paper()).unwrap(),
        ];
        for (index, quantiser) in quantisers.iter().enumerate() {
            let cloud = prepared(quantiser);
            let bytes = cloud.encode();
            assert_eq!(PreparedCloud::decode(&bytes, quantiser).unwrap(), cloud);
            let other = &quantisers[(index + 1) % quantisers.len()];
            assert_eq!(PreparedCloud::decode(&bytes, other), Err(DecodeError::OtherQuantiser));
        }
    }

    #[test]
    fn bytes_of_another_length_are_refused() {
        let quantiser = quantiser(&Parameters::PAPER_BEST);
        let bytes = prepared(&quantiser).encode();
        for length in (0..64).chain([bytes.len() - 1]) {
            let decoded = PreparedCloud::decode(&bytes[..length], &quantiser);
            assert!(matches!(decoded, Err(DecodeError::Length { got, .. }) if got == length), "{length}");
        }
        let longer = [bytes.as_slice(), &[0]].concat();
        assert!(matches!(PreparedCloud::decode(&longer, &quantiser), Err(DecodeError::Length { .. })));
        let mut huge = bytes;
        huge[36..44].fill(0xff);
        assert!(matches!(
            PreparedCloud::decode(&huge, &quantiser),
            Err(DecodeError::Length { expected: u64::MAX, .. })
        ));
    }

    #[test]
    fn no_flipped_bit_makes_a_cloud_that_cannot_be_used() {
        let quantiser = quantiser(&Parameters::PAPER_BEST);
        let binning = quantiser.binning(&Parameters::PAPER_BEST).unwrap();
        let bytes = prepared(&quantiser).encode();
        let (mut refused, mut used) = (0, 0);
        for place in 0..bytes.len().min(4000) {
            for bit in [0, 3, 7] {
                let mut flipped = bytes.clone();
                flipped[place] ^= 1 << bit;
                match PreparedCloud::decode(&flipped, &quantiser) {
                    Ok(cloud) => {
                        used += 1;
                        crate::histogram::shape_rows(&cloud, &binning);
                        crate::histogram::colour_rows(&cloud, &binning);
                    }
                    Err(_) => refused += 1,
                }
            }
        }
        assert!(refused > 0 && used > 0, "{refused} refused, {used} used");
    }
}
