//! Prepared clouds as bytes, to be kept and handed on.

use crate::disk_ring::quantise::Quantiser;
use crate::disk_ring::quantised::QuantisedCloud;
use crate::disk_ring::records::Records;

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

/// Digest of the quantiser, number of keypoints (u32), number of records (u64), lengths of the lists of angle classes
/// and of colour classes (u16).
const HEADER_BYTES: usize = 32 + 4 + 8 + 2 + 2;

impl QuantisedCloud {
    /// All numbers in little-endian order: digest of the quantiser (32 bytes), keypoints (u32), records (u64), lengths
    /// of the lists of angle classes and of colour classes (u16, 0 for no list); the lists (u16); for each radius and
    /// keypoint the records within (u32); the angle of every record; with colour, the colour of every record: its position
    /// in the list (u8), or its class if there is none (u16).
    pub fn encode(&self) -> Vec<u8> {
        let features = [&self.angles, &self.colours];
        let lists = features.map(|feature| feature.listed().unwrap_or_default());
        let numbers = size_of_val(self.within.as_slice()) + self.angles.bytes() + self.colours.bytes();
        let mut bytes = Vec::with_capacity(HEADER_BYTES + numbers);
        bytes.extend_from_slice(&self.digest);
        bytes.extend_from_slice(&(self.keypoints() as u32).to_le_bytes());
        bytes.extend_from_slice(&(self.records() as u64).to_le_bytes());
        bytes.extend(lists.iter().flat_map(|list| (list.len() as u16).to_le_bytes()));
        bytes.extend(lists.iter().flat_map(|list| list.iter()).flat_map(|class| class.to_le_bytes()));
        bytes.extend(self.within.iter().flat_map(|count| count.to_le_bytes()));
        for feature in features {
            feature.encode_to(&mut bytes);
        }
        bytes
    }

    /// Undoes [`QuantisedCloud::encode`]. Whatever the bytes are, the cloud can be used with the quantiser's binnings.
    ///
    /// # Errors
    /// If the bytes are not those of a cloud prepared with this quantiser.
    pub fn decode(bytes: &[u8], quantiser: &Quantiser) -> Result<Self, DecodeError> {
        let inconsistent = |what| DecodeError::Inconsistent { what };
        let short = DecodeError::Length { expected: HEADER_BYTES as u64, got: bytes.len() };
        let (header, rest) = bytes.split_first_chunk::<HEADER_BYTES>().ok_or(short)?;
        let (digest, header) = header.split_at(32);
        if *digest != quantiser.digest() {
            return Err(DecodeError::OtherQuantiser);
        }
        let number = |bytes: &[u8]| bytes.iter().rev().fold(0, |sum, &byte| sum << 8 | u64::from(byte));
        let keypoints = number(&header[..4]);
        let records = number(&header[4..12]);
        let lists = [&header[12..14], &header[14..]].map(number);
        let radii = quantiser.radii();
        // In 128 bits, where no number of any field can overflow.
        let counts = 4 * u128::from(keypoints) * radii as u128;
        let bytes_of = |list| u128::from(records) * if list > 0 { 1 } else { 2 };
        let angles = bytes_of(lists[0]);
        let colours = if quantiser.has_colour() { bytes_of(lists[1]) } else { 0 };
        let listed = 2 * u128::from(lists[0] + lists[1]);
        let expected = HEADER_BYTES as u128 + listed + counts + angles + colours;
        if expected != bytes.len() as u128 {
            let expected = u64::try_from(expected).unwrap_or(u64::MAX);
            return Err(DecodeError::Length { expected, got: bytes.len() });
        }
        if keypoints == 0 {
            return Err(inconsistent("a cloud without keypoints takes no part"));
        }

        // From here on no number is larger than that of the bytes.
        let (lists_of, rest) = rest.split_at(listed as usize);
        let (counts, rest) = rest.split_at(counts as usize);
        let (angles, colours) = rest.split_at(angles as usize);
        let within: Vec<u32> =
            counts.as_chunks::<4>().0.iter().map(|&count| u32::from_le_bytes(count)).collect();
        let starts = starts(&within, keypoints as usize)?;
        if starts.last().is_none_or(|&end| end as u64 != records) {
            return Err(inconsistent("the keypoints must have as many neighbours as there are records"));
        }
        let list: Vec<u16> =
            lists_of.as_chunks::<2>().0.iter().map(|&class| u16::from_le_bytes(class)).collect();
        let (of_angles, of_colours) = list.split_at(lists[0] as usize);
        let [angle_classes, colour_classes] = quantiser.classes();
        let feature = |list: &[u16], codes, classes| {
            Records::decode(list.to_vec(), codes, classes).map_err(inconsistent)
        };
        Ok(Self {
            angles: feature(of_angles, angles, angle_classes)?,
            colours: feature(of_colours, colours, colour_classes)?,
            starts,
            within,
            digest: quantiser.digest(),
        })
    }
}

/// Where each keypoint's records begin, and where the last one's end, given how many lie within each radius.
fn starts(within: &[u32], keypoints: usize) -> Result<Vec<usize>, DecodeError> {
    let radii = || within.chunks_exact(keypoints);
    if radii().zip(radii().skip(1)).any(|(smaller, larger)| smaller.iter().zip(larger).any(|(a, b)| a > b)) {
        let what = "a smaller radius must hold no more neighbours than a larger one";
        return Err(DecodeError::Inconsistent { what });
    }
    let mut end = 0;
    let counts = radii().next_back().unwrap_or_default();
    let ends = counts.iter().map(|&count| {
        end += count as usize;
        end
    });
    Ok([0].into_iter().chain(ends).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::sheet;
    use crate::{GeneTable, Parameters, Preprocess};

    fn quantiser(parameters: &Parameters) -> Quantiser {
        Quantiser::new(&GeneTable::single(parameters).unwrap()).unwrap()
    }

    fn prepared(quantiser: &Quantiser) -> QuantisedCloud {
        QuantisedCloud::new(&sheet(1, 200), &Preprocess::default(), quantiser).unwrap()
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
            assert_eq!(QuantisedCloud::decode(&bytes, quantiser).unwrap(), cloud);
            let other = &quantisers[(index + 1) % quantisers.len()];
            assert_eq!(QuantisedCloud::decode(&bytes, other), Err(DecodeError::OtherQuantiser));
        }
    }

    #[test]
    fn bytes_of_another_length_are_refused() {
        let quantiser = quantiser(&Parameters::PAPER_BEST);
        let bytes = prepared(&quantiser).encode();
        for length in (0..64).chain([bytes.len() - 1]) {
            let decoded = QuantisedCloud::decode(&bytes[..length], &quantiser);
            assert!(matches!(decoded, Err(DecodeError::Length { got, .. }) if got == length), "{length}");
        }
        let longer = [bytes.as_slice(), &[0]].concat();
        assert!(matches!(QuantisedCloud::decode(&longer, &quantiser), Err(DecodeError::Length { .. })));
        let mut huge = bytes;
        huge[36..44].fill(0xff);
        assert!(matches!(
            QuantisedCloud::decode(&huge, &quantiser),
            Err(DecodeError::Length { expected: u64::MAX, .. })
        ));
    }

    #[test]
    fn no_flipped_bit_makes_a_cloud_that_cannot_be_used() {
        let quantiser = quantiser(&Parameters::PAPER_BEST);
        let binning = quantiser.binning(&Parameters::PAPER_BEST).unwrap();
        let bytes = prepared(&quantiser).encode();
        let (mut refused, mut used) = (0, 0);
        for position in 0..bytes.len().min(4000) {
            for bit in [0, 3, 7] {
                let mut flipped = bytes.clone();
                flipped[position] ^= 1 << bit;
                match QuantisedCloud::decode(&flipped, &quantiser) {
                    Ok(cloud) => {
                        used += 1;
                        crate::disk_ring::histogram::shape_rows(&cloud, &binning);
                        crate::disk_ring::histogram::colour_rows(&cloud, &binning);
                    }
                    Err(_) => refused += 1,
                }
            }
        }
        assert!(refused > 0 && used > 0, "{refused} refused, {used} used");
    }

    #[test]
    fn records_of_other_classes_are_refused() {
        let quantiser = Quantiser::new(&GeneTable::paper()).unwrap();
        let cloud = prepared(&quantiser);
        let [angle_classes, colour_classes] = quantiser.classes();
        let what = "records must be of the quantiser's classes";
        let refused = |angles: Records, colours: Records| {
            let damaged = QuantisedCloud { angles, colours, ..cloud.clone() };
            QuantisedCloud::decode(&damaged.encode(), &quantiser) == Err(DecodeError::Inconsistent { what })
        };
        let (angles, colours) = (&cloud.angles, &cloud.colours);
        let Records::Plain(plain) = angles else { panic!("600 classes fit no byte") };
        let Records::Listed { classes, positions } = colours else { panic!("a sheet has few colours") };
        assert!(!refused(angles.clone(), colours.clone()));

        let mut beyond = plain.clone();
        beyond[7] = angle_classes as u16;
        assert!(refused(Records::Plain(beyond), colours.clone()));
        let listed = |classes: Vec<u16>, positions: Vec<u8>| {
            refused(angles.clone(), Records::Listed { classes, positions })
        };
        assert!(classes.len() > 1, "one colour has no order");
        assert!(listed(classes.iter().rev().copied().collect(), positions.clone()));
        assert!(listed(vec![classes[0]; classes.len()], positions.clone()));
        let beyond = [&classes[..classes.len() - 1], &[colour_classes as u16]].concat();
        assert!(listed(beyond, positions.clone()));
        assert!(listed(classes.clone(), vec![classes.len() as u8; positions.len()]));
        assert!(listed((0..257).collect(), positions.clone()));
    }
}
