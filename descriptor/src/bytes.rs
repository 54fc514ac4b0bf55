//! Descriptors, grid cells and preparations as bytes: what others hand on without reading it. A byte for the kind, one
//! for the version, then numbers as little-endian u32.

use crate::genes::{Domain, GENES, GeneTable, Parameters};
use crate::{Descriptor, FixedDescriptor, FixedKind, Preprocess, Unit};

/// Of every kind so far.
const VERSION: u8 = 1;
const DISK_RING: u8 = 1;
const PFHRGB: u8 = 2;
const SHOTCOLOR: u8 = 3;
const DISK_RING_CELL: u8 = 4;
const PREPARATION: u8 = 5;

/// The largest radius of a descriptor without genes, micrometres.
pub const MAX_RADIUS_UM: u32 = 1_000_000;

/// Bytes that no release of this version has written.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "{what}: must be as this release writes it, got {got}\nuse a worker and a coordinator of the same release"
)]
pub struct BytesError {
    what: &'static str,
    got: String,
}

impl Descriptor {
    /// Canonical bytes: equal for equal descriptors, and for no others.
    pub fn to_bytes(&self) -> Vec<u8> {
        match self {
            Self::DiskRing(parameters) => {
                encode(DISK_RING, GENES.iter().map(|gene| parameters.ticks(gene.kind)))
            }
            Self::Fixed(FixedDescriptor { kind, radius_um }) => {
                let kind = match kind {
                    FixedKind::PfhRgb => PFHRGB,
                    FixedKind::ShotColor => SHOTCOLOR,
                };
                encode(kind, [*radius_um])
            }
        }
    }

    /// The inverse of [`Descriptor::to_bytes`].
    ///
    /// # Errors
    /// If these are no such bytes.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, BytesError> {
        let error = |got: String| BytesError { what: "descriptor", got };
        let fixed = |kind, radius_um: u32| {
            if !(1..=MAX_RADIUS_UM).contains(&radius_um) {
                return Err(error(format!("a radius of {radius_um} um")));
            }
            Ok(Self::Fixed(FixedDescriptor { kind, radius_um }))
        };
        match (bytes.first(), decode(bytes).as_deref()) {
            (Some(&DISK_RING), Some(&[n, m, disk, ring, w])) => {
                Ok(Self::DiskRing(Parameters::from_ticks([n, m, disk, ring, w])))
            }
            (Some(&PFHRGB), Some(&[radius_um])) => fixed(FixedKind::PfhRgb, radius_um),
            (Some(&SHOTCOLOR), Some(&[radius_um])) => fixed(FixedKind::ShotColor, radius_um),
            _ => Err(error(format!("{} other bytes", bytes.len()))),
        }
    }
}

/// The grid cell of one R1 and one R2, micrometres.
pub fn cell_to_bytes(radii_um: [u32; 2]) -> Vec<u8> {
    encode(DISK_RING_CELL, radii_um)
}

/// The inverse of [`cell_to_bytes`].
///
/// # Errors
/// If these are no such bytes.
pub fn cell_from_bytes(bytes: &[u8]) -> Result<[u32; 2], BytesError> {
    match (bytes.first(), decode(bytes).as_deref()) {
        (Some(&DISK_RING_CELL), Some(&[disk, ring])) => Ok([disk, ring]),
        _ => Err(BytesError { what: "grid cell", got: format!("{} other bytes", bytes.len()) }),
    }
}

/// What is computed once for all descriptors of a run: preprocessing and search space.
pub fn preparation_to_bytes(preprocess: &Preprocess, genes: &GeneTable) -> Vec<u8> {
    let Preprocess { leaf_um, normal_radius_um, min_points, colour, unit } = *preprocess;
    let settings = [leaf_um, normal_radius_um, min_points, u32::from(colour), unit as u32];
    let domains = GENES.iter().flat_map(|gene| {
        let Domain { low, step, count } = genes.domain(gene.kind).copied().unwrap_or(Domain::fixed(0));
        [low, step, count]
    });
    encode(PREPARATION, settings.into_iter().chain(domains))
}

/// The inverse of [`preparation_to_bytes`].
///
/// # Errors
/// If these are no such bytes, or they hold what is no search space.
pub fn preparation_from_bytes(bytes: &[u8]) -> Result<(Preprocess, GeneTable), BytesError> {
    let error = |got: String| BytesError { what: "preparation", got };
    let numbers = decode(bytes).filter(|_| bytes.first() == Some(&PREPARATION)).unwrap_or_default();
    let [leaf_um, normal_radius_um, min_points, colour @ 0..=1, unit @ 0..=1, domains @ ..] = &numbers[..]
    else {
        return Err(error(format!("{} other bytes", bytes.len())));
    };
    let unit = if *unit == Unit::Metre as u32 { Unit::Metre } else { Unit::Millimetre };
    let (colour, triples) = (*colour == 1, domains.as_chunks::<3>());
    let domains = triples.0.iter().map(|&[low, step, count]| Domain { low, step, count });
    let domains = <[Domain; GENES.len()]>::try_from(domains.collect::<Vec<_>>());
    let (Ok(domains), []) = (domains, triples.1) else {
        return Err(error(format!("{} numbers", numbers.len())));
    };
    let genes = GeneTable::new(domains, colour).map_err(|invalid| error(invalid.to_string()))?;
    let preprocess = Preprocess {
        leaf_um: *leaf_um,
        normal_radius_um: *normal_radius_um,
        min_points: *min_points,
        colour,
        unit,
    };
    Ok((preprocess, genes))
}

fn encode(kind: u8, numbers: impl IntoIterator<Item = u32>) -> Vec<u8> {
    [kind, VERSION].into_iter().chain(numbers.into_iter().flat_map(u32::to_le_bytes)).collect()
}

/// The numbers after kind and version, if the version is this one.
fn decode(bytes: &[u8]) -> Option<Vec<u32>> {
    let (numbers, []) = bytes.strip_prefix(&[*bytes.first()?, VERSION])?.as_chunks::<4>() else {
        return None;
    };
    Some(numbers.iter().map(|number| u32::from_le_bytes(*number)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn everything_comes_back_and_altered_bytes_are_refused() {
        let disk_ring = Descriptor::DiskRing(Parameters::PAPER_BEST);
        let fixed = [FixedKind::PfhRgb, FixedKind::ShotColor]
            .map(|kind| Descriptor::Fixed(FixedDescriptor { kind, radius_um: 50_000 }));
        for descriptor in [disk_ring, fixed[0], fixed[1]] {
            let bytes = descriptor.to_bytes();
            assert_eq!(Descriptor::from_bytes(&bytes), Ok(descriptor));
            for end in 0..bytes.len() {
                Descriptor::from_bytes(&bytes[..end]).unwrap_err();
            }
            Descriptor::from_bytes(&[&bytes[..], &[0; 4]].concat()).unwrap_err();
            Descriptor::from_bytes(&[&[9], &bytes[1..]].concat()).unwrap_err();
            Descriptor::from_bytes(&[&bytes[..1], &[2], &bytes[2..]].concat()).unwrap_err();
        }
        for radius_um in [0, MAX_RADIUS_UM + 1] {
            let descriptor = Descriptor::Fixed(FixedDescriptor { kind: FixedKind::PfhRgb, radius_um });
            Descriptor::from_bytes(&descriptor.to_bytes()).unwrap_err();
        }
        assert_eq!(cell_from_bytes(&cell_to_bytes([13_000, 36_000])), Ok([13_000, 36_000]));
        cell_from_bytes(&disk_ring.to_bytes()).unwrap_err();
    }

    #[test]
    fn a_preparation_comes_back_with_and_without_colour() {
        let colourless = Parameters { colour_bins: 0, shape_weight_ppm: 1_000_000, ..Parameters::PAPER_BEST };
        for (unit, genes) in
            [(Unit::Metre, GeneTable::paper()), (Unit::Millimetre, GeneTable::single(&colourless).unwrap())]
        {
            let preprocess = Preprocess { unit, colour: genes.has_colour(), ..Preprocess::default() };
            let bytes = preparation_to_bytes(&preprocess, &genes);
            assert_eq!(preparation_from_bytes(&bytes), Ok((preprocess, genes)));
            for end in 0..bytes.len() {
                preparation_from_bytes(&bytes[..end]).unwrap_err();
            }
            preparation_from_bytes(&[&bytes[..], &[0; 12]].concat()).unwrap_err();
            let mut spoilt = bytes;
            spoilt[2 + 4 * 7] = 0; // the first count
            preparation_from_bytes(&spoilt).unwrap_err();
        }
    }
}
