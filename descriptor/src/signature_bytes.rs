//! The signatures of some clouds under one descriptor as bytes, to be handed on.
//!
//! In families that tell it, first the number of described keypoints of each cloud (u32). Then, channel after channel,
//! the values (f32) of all clouds: each cloud's centroid, then its deviation. All little-endian, bit for bit.

use crate::signature::Signatures;

/// Why bytes or columns are no signatures of so many clouds.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum SignatureError {
    /// Fewer or more bytes than so many clouds take under the descriptor.
    #[error("signatures: length must be {expected} bytes, got {got}\ndescribe the clouds again")]
    Length {
        /// For the descriptor and the number of clouds.
        expected: u64,
        /// Of these bytes.
        got: usize,
    },
    /// A value that no mean or deviation of the descriptor's histograms can have.
    #[error("signatures: values must lie between 0 and {largest}, got {got}\ndescribe the clouds again")]
    Value {
        /// Largest value that the descriptor has.
        largest: u8,
        /// As text: a float has no equality.
        got: String,
    },
}

/// Centroids and deviations in one channel, each cloud after cloud.
pub type Columns<'a> = [&'a [f32]; 2];

/// Which values a cloud has under one descriptor.
#[derive(Clone, Debug)]
pub(crate) struct Layout {
    /// For each channel the lengths of a centroid and of a deviation.
    pub(crate) channels: Vec<[u64; 2]>,
    /// Whether the number of described keypoints of each cloud comes first.
    pub(crate) tells_keypoints: bool,
    /// Largest value.
    pub(crate) largest: u8,
    /// What rounding may add to it, as a share of it.
    pub(crate) tolerance: f32,
}

impl Layout {
    /// Values of one cloud.
    pub(crate) fn values(&self) -> u64 {
        self.channels.iter().flatten().fold(0, |sum: u64, &length| sum.saturating_add(length))
    }

    /// Length of so many clouds, bytes.
    pub(crate) fn length(&self, clouds: u32) -> u64 {
        let values = self.values().saturating_add(u64::from(self.tells_keypoints));
        values.saturating_mul(4 * u64::from(clouds))
    }

    /// The signatures of the same clouds in each channel.
    pub(crate) fn encode<'a>(channels: impl Iterator<Item = &'a Signatures> + Clone) -> Vec<u8> {
        let keypoints = channels.clone().flat_map(|channel| &channel.keypoints);
        let mut bytes: Vec<u8> = keypoints.flat_map(|count| count.to_le_bytes()).collect();
        bytes.extend(channels.flat_map(|channel| &channel.values).flat_map(|value| value.to_le_bytes()));
        bytes
    }

    /// Refuses bytes that cannot be the signatures of so many clouds.
    ///
    /// # Errors
    /// If they cannot.
    pub(crate) fn check(&self, bytes: &[u8], clouds: u32) -> Result<(), SignatureError> {
        let expected = self.length(clouds);
        if bytes.len() as u64 != expected {
            return Err(SignatureError::Length { expected, got: bytes.len() });
        }
        self.check_values(self.values_of(bytes, clouds))
    }

    /// Refuses values that no mean or deviation can have.
    fn check_values(&self, mut values: impl Iterator<Item = f32>) -> Result<(), SignatureError> {
        let bounds = 0.0..=f32::from(self.largest) * (1.0 + self.tolerance);
        match values.find(|value| !bounds.contains(value)) {
            Some(value) => Err(SignatureError::Value { largest: self.largest, got: value.to_string() }),
            None => Ok(()),
        }
    }

    fn values_of(&self, bytes: &[u8], clouds: u32) -> impl Iterator<Item = f32> {
        let counts = if self.tells_keypoints { clouds as usize } else { 0 };
        bytes.as_chunks::<4>().0.iter().skip(counts).map(|&value| f32::from_le_bytes(value))
    }

    /// Undoes [`Layout::encode`]. Whatever the bytes are, distances between the signatures are finite.
    ///
    /// # Errors
    /// If the bytes cannot be the signatures of so many clouds.
    pub(crate) fn decode(&self, bytes: &[u8], clouds: u32) -> Result<Vec<Signatures>, SignatureError> {
        self.check(bytes, clouds)?;
        let mut values = self.values_of(bytes, clouds);
        let keypoints = bytes.as_chunks::<4>().0.iter().map(|&count| u32::from_le_bytes(count));
        let told = if self.tells_keypoints { clouds as usize } else { 0 };
        let keypoints: Vec<u32> = keypoints.take(told).collect();
        let channels = self.channels.iter().map(|&lengths| {
            let [bins, width] = sizes(lengths, clouds);
            let values = values.by_ref().take(clouds as usize * width).collect();
            Signatures { bins, width, clouds: clouds as usize, values, keypoints: keypoints.clone() }
        });
        Ok(channels.collect())
    }

    /// Signatures of so many clouds from values that were kept as columns, channel by channel. Whatever they are,
    /// distances between the signatures are finite.
    ///
    /// # Errors
    /// If the columns cannot be those of so many clouds under the descriptor.
    pub(crate) fn of_columns(
        &self,
        channels: &[Columns<'_>],
        clouds: u32,
    ) -> Result<Vec<Signatures>, SignatureError> {
        let bytes = |values: u64| values.saturating_mul(4);
        let [expected, got] = [self.channels.len(), channels.len()];
        if expected != got {
            return Err(SignatureError::Length { expected: self.length(clouds), got: 0 });
        }
        let channel = |(columns, &lengths): (&Columns<'_>, &[u64; 2])| {
            for (column, length) in columns.iter().zip(lengths) {
                let expected = length.saturating_mul(u64::from(clouds));
                if column.len() as u64 != expected {
                    return Err(SignatureError::Length {
                        expected: bytes(expected),
                        got: size_of_val(*column),
                    });
                }
            }
            self.check_values(columns.iter().copied().flatten().copied())?;
            let mut values = Vec::with_capacity(columns.iter().map(|column| column.len()).sum());
            for cloud in 0..clouds as usize {
                for (column, length) in columns.iter().zip(lengths) {
                    values.extend_from_slice(&column[cloud * length as usize..][..length as usize]);
                }
            }
            let [bins, width] = sizes(lengths, clouds);
            Ok(Signatures { bins, width, clouds: clouds as usize, values, keypoints: Vec::new() })
        };
        channels.iter().zip(&self.channels).map(channel).collect()
    }
}

/// Length of a centroid and of a whole signature; no clouds have no lengths.
fn sizes([centroid, deviation]: [u64; 2], clouds: u32) -> [usize; 2] {
    if clouds == 0 { [0, 0] } else { [centroid as usize, (centroid + deviation) as usize] }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::sheet;
    use crate::{
        Descriptor, FixedDescriptor, FixedKind, GeneTable, GlobalHue, Parameters, PreparedCloud, Preprocess,
        SearchSpace, Signature,
    };

    const COLOURLESS: Parameters =
        Parameters { colour_bins: 0, shape_weight_ppm: 1_000_000, ..Parameters::PAPER_BEST };
    const PAPER: Descriptor = Descriptor::DiskRing(Parameters::PAPER_BEST);

    fn descriptors() -> Vec<Descriptor> {
        let fixed = |kind| Descriptor::Fixed(FixedDescriptor { kind, radius_um: 50_000 });
        let mut all = vec![
            PAPER,
            Descriptor::DiskRing(Parameters { shape_bins: 9, ..COLOURLESS }),
            Descriptor::GlobalHue(GlobalHue::new(5).unwrap()),
        ];
        all.extend(FixedKind::ALL.map(fixed));
        all
    }

    /// The signatures of `clouds` clouds in each channel.
    fn signatures(descriptor: &Descriptor, clouds: u64) -> Vec<Signatures> {
        let preparer = SearchSpace::single(descriptor).unwrap().preparer().unwrap();
        let prepare = |seed| preparer.prepare(&sheet(seed, 200), &Preprocess::default()).unwrap();
        let clouds: Vec<PreparedCloud> = (0..clouds).map(prepare).collect();
        let channels = descriptor.channels().into_iter();
        channels
            .map(|(channel, _)| channel.extractor(&preparer).unwrap().signatures(&clouds).unwrap())
            .collect()
    }

    fn encoded(descriptor: &Descriptor, clouds: u64) -> Vec<u8> {
        descriptor.encode_signatures(&signatures(descriptor, clouds))
    }

    #[test]
    fn signatures_are_read_as_they_are_written() {
        for descriptor in descriptors() {
            for clouds in [0, 1, 3] {
                let bytes = encoded(&descriptor, clouds);
                assert_eq!(bytes.len() as u64, descriptor.signature_bytes(clouds as u32));
                let read = descriptor.decode_signatures(&bytes, clouds as u32).unwrap();
                assert_eq!(read, signatures(&descriptor, clouds), "{descriptor}");
            }
        }
    }

    #[test]
    fn disk_ring_is_the_values_of_all_clouds_in_shape_and_then_in_colour() {
        let quantiser = crate::Quantiser::new(&GeneTable::single(&Parameters::PAPER_BEST).unwrap()).unwrap();
        let binning = quantiser.binning(&Parameters::PAPER_BEST).unwrap();
        let cloud = |seed| crate::QuantisedCloud::new(&sheet(seed, 200), &Preprocess::default(), &quantiser);
        let clouds: Vec<[Signature; 2]> =
            (0..3).map(|seed| binning.signature(&cloud(seed).unwrap())).collect();
        let values = |channel: usize| {
            let both = |one: &[Signature; 2]| [one[channel].centroid.clone(), one[channel].deviation.clone()];
            clouds.iter().flat_map(both).flatten().collect::<Vec<f32>>()
        };
        let expected: Vec<u8> =
            values(0).into_iter().chain(values(1)).flat_map(|value| value.to_le_bytes()).collect();
        assert_eq!(expected.len(), 3 * 4 * (2 * 2 * 30 + 2 * 2 * 64));
        assert_eq!(encoded(&PAPER, 3), expected);
    }

    #[test]
    fn bytes_of_other_clouds_or_another_descriptor_are_refused() {
        let refused = |bytes: &[u8], descriptor: &Descriptor, clouds| {
            let decoded = descriptor.decode_signatures(bytes, clouds);
            assert!(matches!(decoded, Err(SignatureError::Length { .. })), "{clouds}: {decoded:?}");
        };
        for descriptor in descriptors() {
            let bytes = encoded(&descriptor, 2);
            for clouds in [0, 1, 3, u32::MAX] {
                refused(&bytes, &descriptor, clouds);
            }
            refused(&bytes[1..], &descriptor, 2);
        }
        refused(&encoded(&PAPER, 2), &Descriptor::DiskRing(COLOURLESS), 2);
        let huge = Parameters { shape_bins: u32::MAX, colour_bins: u32::MAX, ..Parameters::PAPER_BEST };
        refused(&[], &Descriptor::DiskRing(huge), 1);
    }

    #[test]
    fn values_that_no_histograms_have_are_refused() {
        for descriptor in descriptors() {
            for value in [f32::NAN, f32::INFINITY, -0.5, 201.0] {
                let mut bytes = encoded(&descriptor, 2);
                let last = bytes.len() - 4;
                bytes[last..].copy_from_slice(&value.to_le_bytes());
                let decoded = descriptor.decode_signatures(&bytes, 2);
                assert!(matches!(decoded, Err(SignatureError::Value { .. })), "{descriptor}, {value}");
            }
        }
        let mut bytes = encoded(&PAPER, 2);
        bytes[400..404].copy_from_slice(&1.5f32.to_le_bytes());
        assert!(matches!(PAPER.check_signatures(&bytes, 2), Err(SignatureError::Value { .. })));
    }

    #[test]
    fn clouds_without_described_keypoints_can_be_left_out() {
        for kind in FixedKind::ALL {
            let descriptor = Descriptor::Fixed(FixedDescriptor { kind, radius_um: 50_000 });
            let [mut described] = <[Signatures; 1]>::try_from(signatures(&descriptor, 2)).unwrap();
            assert!(described.keypoints().unwrap().iter().all(|&keypoints| keypoints > 0));
            described.keypoints[1] = 0;
            let clouds = described.clone();
            described.append(&clouds);
            let bytes = descriptor.encode_signatures(&[&described]);
            let [twice] =
                <[Signatures; 1]>::try_from(descriptor.decode_signatures(&bytes, 4).unwrap()).unwrap();
            assert_eq!(twice, described);
            let (indices, left) = twice.into_described();
            assert_eq!((&indices[..], left.clouds()), (&[0, 2][..], 2));
            assert_eq!([left.get(0), left.get(1)], [clouds.get(0); 2]);
        }
    }

    /// Centroids and deviations, each cloud after cloud.
    fn columns(signatures: &Signatures) -> [Vec<f32>; 2] {
        let column = |which: usize| {
            (0..signatures.clouds()).flat_map(|cloud| signatures.get(cloud)[which].to_vec()).collect()
        };
        [column(0), column(1)]
    }

    #[test]
    fn signatures_are_made_of_their_columns_again() {
        for descriptor in descriptors().into_iter().take(3) {
            for clouds in [0, 1, 3] {
                let expected = signatures(&descriptor, clouds);
                let columns: Vec<[Vec<f32>; 2]> = expected.iter().map(columns).collect();
                let columns: Vec<Columns> = columns.iter().map(|[a, b]| [a.as_slice(), b]).collect();
                assert_eq!(descriptor.signatures_of_columns(&columns, clouds as u32).unwrap(), expected);
            }
        }
    }

    #[test]
    fn columns_of_other_clouds_or_with_other_values_are_refused() {
        let of = signatures(&PAPER, 2);
        let [shape, colour] = [columns(&of[0]), columns(&of[1])];
        let refusal = |columns: &[Columns], descriptor: &Descriptor, clouds| {
            descriptor.signatures_of_columns(columns, clouds).unwrap_err()
        };
        let [a, b]: [Columns; 2] = [[&shape[0], &shape[1]], [&colour[0], &colour[1]]];
        let huge = Parameters { shape_bins: u32::MAX, colour_bins: u32::MAX, ..Parameters::PAPER_BEST };
        for error in [
            refusal(&[a, b], &PAPER, 1),
            refusal(&[a, b], &PAPER, u32::MAX),
            refusal(&[a, b], &Descriptor::DiskRing(COLOURLESS), 2),
            refusal(&[a, b], &Descriptor::DiskRing(huge), u32::MAX),
            refusal(&[[&a[0][1..], a[1]], b], &PAPER, 2),
            refusal(&[a, [b[0], &b[1][1..]]], &PAPER, 2),
            refusal(&[a], &PAPER, 2),
        ] {
            assert!(matches!(error, SignatureError::Length { .. }), "{error}");
        }
        for value in [f32::NAN, f32::INFINITY, -0.5, 1.5] {
            let mut deviations = colour[1].clone();
            deviations[40] = value;
            let error = refusal(&[a, [b[0], &deviations]], &PAPER, 2);
            assert!(matches!(error, SignatureError::Value { .. }), "{value}: {error}");
        }
    }
}
