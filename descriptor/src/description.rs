//! The parts of some clouds under one descriptor as bytes, to be handed on: a description.

use crate::genes::Parameters;
use crate::summary::Parts;

/// Why bytes are no description.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DescriptionError {
    /// Fewer or more bytes than so many clouds take under the descriptor.
    #[error("description: length must be {expected} bytes, got {got}\ndescribe the clouds again")]
    Length {
        /// For the descriptor and the number of clouds.
        expected: u64,
        /// Of these bytes.
        got: usize,
    },
    /// A value that no mean or deviation of shares can have.
    #[error("description: values must lie between 0 and {largest}, got {got}\ndescribe the clouds again")]
    Value {
        /// Largest value that the descriptor has.
        largest: u8,
        /// As text: a float has no equality.
        got: String,
    },
}

/// Values that one cloud's shape and colour take: centroid and deviation of the bins of two regions.
fn widths(parameters: &Parameters) -> [u64; 2] {
    let Parameters { shape_bins, colour_bins, .. } = *parameters;
    let reachable = u64::from(shape_bins).saturating_sub(1) / 2 + 1;
    let m = u64::from(colour_bins);
    [4 * reachable, m.saturating_mul(m).saturating_mul(4)]
}

/// Length of the description of so many clouds, bytes.
pub fn length(parameters: &Parameters, clouds: u32) -> u64 {
    let [shape, colour] = widths(parameters);
    shape.saturating_add(colour).saturating_mul(4 * u64::from(clouds))
}

/// Shape and colour parts of the same clouds: the values of all clouds in shape, then in colour, as little-endian f32,
/// bit for bit.
pub fn encode([shape, colour]: [&Parts; 2]) -> Vec<u8> {
    let values = shape.values.iter().chain(&colour.values);
    values.flat_map(|value| value.to_le_bytes()).collect()
}

/// Whether these bytes can be the description of so many clouds.
///
/// # Errors
/// If they cannot.
pub fn check(bytes: &[u8], parameters: &Parameters, clouds: u32) -> Result<(), DescriptionError> {
    let expected = length(parameters, clouds);
    if bytes.len() as u64 != expected {
        return Err(DescriptionError::Length { expected, got: bytes.len() });
    }
    check_values(values(bytes))
}

/// Refuses values that no mean or deviation of shares can have.
fn check_values(mut values: impl Iterator<Item = f32>) -> Result<(), DescriptionError> {
    match values.find(|value| !(0.0..=1.0).contains(value)) {
        Some(value) => Err(DescriptionError::Value { largest: 1, got: value.to_string() }),
        None => Ok(()),
    }
}

fn values(bytes: &[u8]) -> impl Iterator<Item = f32> {
    bytes.as_chunks::<4>().0.iter().map(|&value| f32::from_le_bytes(value))
}

/// Undoes [`encode`] for a descriptor and a number of clouds. Whatever the bytes are, distances between the parts are
/// finite.
///
/// # Errors
/// If the bytes cannot be the description of so many clouds.
pub fn decode(bytes: &[u8], parameters: &Parameters, clouds: u32) -> Result<[Parts; 2], DescriptionError> {
    check(bytes, parameters, clouds)?;
    let mut values: Vec<f32> = values(bytes).collect();
    // As many as there are bytes, so that they fit.
    let [shape, colour] = widths(parameters).map(|width| width as usize);
    let clouds = clouds as usize;
    let colours = values.split_off(clouds * shape);
    Ok([
        Parts { width: if clouds == 0 { 0 } else { shape }, clouds, values },
        Parts { width: if clouds == 0 { 0 } else { colour }, clouds, values: colours },
    ])
}

/// Centroids and deviations of one part of the descriptor, each cloud after cloud.
pub type Columns<'a> = [&'a [f32]; 2];

/// Shape and colour parts of so many clouds from values that were kept as columns. Whatever they are, distances between
/// the parts are finite.
///
/// # Errors
/// If the columns cannot be those of so many clouds under the descriptor.
pub fn from_columns(
    [shape, colour]: [Columns<'_>; 2],
    parameters: &Parameters,
    clouds: u32,
) -> Result<[Parts; 2], DescriptionError> {
    let [shape_width, colour_width] = widths(parameters);
    let part = |columns: Columns<'_>, width: u64| {
        // Half of a cloud's values are its centroid.
        let expected = (width / 2).saturating_mul(u64::from(clouds));
        if let Some(other) = columns.iter().find(|column| column.len() as u64 != expected) {
            let bytes = |values: u64| values.saturating_mul(4);
            return Err(DescriptionError::Length { expected: bytes(expected), got: size_of_val(*other) });
        }
        check_values(columns.into_iter().flatten().copied())?;
        let bins = width as usize / 2;
        let mut values = Vec::with_capacity(2 * columns[0].len());
        for cloud in 0..clouds as usize {
            for column in columns {
                values.extend_from_slice(&column[cloud * bins..][..bins]);
            }
        }
        Ok(Parts { width: if clouds == 0 { 0 } else { width as usize }, clouds: clouds as usize, values })
    };
    Ok([part(shape, shape_width)?, part(colour, colour_width)?])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::sheet;
    use crate::{GeneTable, PreparedCloud, Preprocess, Quantiser};

    const COLOURLESS: Parameters =
        Parameters { colour_bins: 0, shape_weight_ppm: 1_000_000, ..Parameters::PAPER_BEST };

    /// The parts of `clouds` clouds.
    fn parts(parameters: &Parameters, clouds: u64) -> [Parts; 2] {
        let quantiser = Quantiser::new(&GeneTable::single(parameters).unwrap()).unwrap();
        let prepare =
            |seed| PreparedCloud::new(&sheet(seed, 200), &Preprocess::default(), &quantiser).unwrap();
        let clouds: Vec<PreparedCloud> = (0..clouds).map(prepare).collect();
        Parts::both(&clouds, &quantiser.binning(parameters).unwrap())
    }

    fn encoded(parameters: &Parameters, clouds: u64) -> Vec<u8> {
        encode(parts(parameters, clouds).each_ref())
    }

    #[test]
    fn what_was_encoded_is_decoded() {
        for parameters in [Parameters::PAPER_BEST, Parameters { shape_bins: 9, ..COLOURLESS }] {
            for clouds in [0, 1, 3] {
                let bytes = encoded(&parameters, clouds);
                assert_eq!(bytes.len() as u64, length(&parameters, clouds as u32));
                assert_eq!(decode(&bytes, &parameters, clouds as u32).unwrap(), parts(&parameters, clouds));
            }
        }
    }

    #[test]
    fn bytes_of_other_clouds_or_another_descriptor_are_refused() {
        let parameters = Parameters::PAPER_BEST;
        let bytes = encoded(&parameters, 2);
        let refused = |bytes: &[u8], parameters: &Parameters, clouds| {
            let decoded = decode(bytes, parameters, clouds);
            assert!(matches!(decoded, Err(DescriptionError::Length { .. })), "{clouds}: {decoded:?}");
        };
        for clouds in [0, 1, 3, u32::MAX] {
            refused(&bytes, &parameters, clouds);
        }
        refused(&bytes, &COLOURLESS, 2);
        refused(&bytes[1..], &parameters, 2);
        refused(&[], &Parameters { shape_bins: u32::MAX, colour_bins: u32::MAX, ..parameters }, 1);
    }

    #[test]
    fn values_that_no_histograms_have_are_refused() {
        let parameters = Parameters::PAPER_BEST;
        for value in [f32::NAN, f32::INFINITY, -0.5, 1.5] {
            let mut bytes = encoded(&parameters, 2);
            bytes[400..404].copy_from_slice(&value.to_le_bytes());
            assert!(matches!(decode(&bytes, &parameters, 2), Err(DescriptionError::Value { .. })), "{value}");
        }
    }

    /// Centroids and deviations of some parts, each cloud after cloud.
    fn columns(parts: &Parts) -> [Vec<f32>; 2] {
        let column =
            |which: usize| (0..parts.clouds()).flat_map(|cloud| parts.get(cloud)[which].to_vec()).collect();
        [column(0), column(1)]
    }

    #[test]
    fn parts_are_made_of_their_columns_again() {
        for parameters in [Parameters::PAPER_BEST, Parameters { shape_bins: 9, ..COLOURLESS }] {
            for clouds in [0, 1, 3] {
                let expected = parts(&parameters, clouds);
                let [shape, colour] = expected.each_ref().map(columns);
                let columns = [[&*shape[0], &shape[1]], [&*colour[0], &colour[1]]];
                assert_eq!(from_columns(columns, &parameters, clouds as u32).unwrap(), expected);
            }
        }
    }

    #[test]
    fn columns_of_other_clouds_or_with_other_values_are_refused() {
        let parameters = Parameters::PAPER_BEST;
        let [shape, colour] = parts(&parameters, 2).each_ref().map(columns);
        let refusal = |shape: [&[f32]; 2], colour: [&[f32]; 2], parameters: &Parameters, clouds| {
            from_columns([shape, colour], parameters, clouds).unwrap_err()
        };
        let [a, b] = [[&*shape[0], &shape[1]], [&*colour[0], &colour[1]]];
        let huge = Parameters { shape_bins: u32::MAX, colour_bins: u32::MAX, ..parameters };
        for error in [
            refusal(a, b, &parameters, 1),
            refusal(a, b, &parameters, u32::MAX),
            refusal(a, b, &COLOURLESS, 2),
            refusal(a, b, &huge, u32::MAX),
            refusal([&a[0][1..], a[1]], b, &parameters, 2),
            refusal(a, [b[0], &b[1][1..]], &parameters, 2),
        ] {
            assert!(matches!(error, DescriptionError::Length { .. }), "{error}");
        }
        for value in [f32::NAN, f32::INFINITY, -0.5, 1.5] {
            let mut deviations = colour[1].clone();
            deviations[40] = value;
            let error = refusal(a, [b[0], &deviations], &parameters, 2);
            assert!(matches!(error, DescriptionError::Value { .. }), "{value}: {error}");
        }
    }
}
