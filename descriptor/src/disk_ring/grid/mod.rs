//! All descriptors of a gene table that share R1 and R2, counted at once: one cell of the exhaustive search.
//!
//! Shape depends on shape_bins alone within a cell, colour on m, and w on nothing (DESIGN 6): each cloud is described
//! once a value of shape_bins and once a value of m, and every pair of values shares their distances. What is counted
//! is bit for bit what the evaluator counts for each descriptor alone.

mod count;
mod distances;
mod signatures;

pub use distances::DiskDistances;
pub use signatures::{CellSignatures, Region, RegionSignatures};

use std::ops::Range;

use crate::bytes::{self, BytesError, Reader};
use crate::disk_ring::quantise::{Binning, QuantiseError, Quantiser};
use crate::family::Family;
use crate::{GeneKind, Parameters};

/// Canonical bytes of the cell of one R1 and one R2, micrometres: tag of the family, version, numbers.
pub fn cell_to_bytes(radii_um: [u32; 2]) -> Vec<u8> {
    bytes::write(Family::DiskRing, radii_um)
}

/// Undoes [`cell_to_bytes`].
///
/// # Errors
/// If the bytes are no cell.
pub fn cell_from_bytes(bytes: &[u8]) -> Result<[u32; 2], BytesError> {
    let reader = Reader::new("grid cell", bytes)?;
    match reader.family {
        Family::DiskRing => reader.numbers(),
        _ => Err(reader.refuse("a family without grid cells")),
    }
}

/// The descriptors of a table with one R1 and one R2: every shape_bins × m × w.
#[derive(Clone, Debug)]
pub struct Cell {
    /// One a value of shape_bins, with the lowest value of m.
    shape: Vec<Binning>,
    /// One a value of m (without colour one of 0), with the lowest value of shape_bins.
    colour: Vec<Binning>,
    /// For all of `shape`, and for all of `colour`, where each one's bins lie among those of all, in one region.
    bins: [Vec<Range<usize>>; 2],
    /// The first angle class of each bin, for all of `shape` one after the other.
    first_angle: Vec<u16>,
    /// All values of w, 0 to 1.
    weights: Vec<f64>,
    /// Numbers of angle classes and of colour classes.
    classes: [usize; 2],
}

impl Cell {
    /// The cell of one R1 and one R2, micrometres.
    ///
    /// # Errors
    /// [`QuantiseError::NotInTable`] if one of them is not a value of the quantiser's table.
    pub fn new(quantiser: &Quantiser, disk_um: u32, ring_um: u32) -> Result<Self, QuantiseError> {
        let [shape_bins, colour_bins] =
            [GeneKind::ShapeBins, GeneKind::ColourBins].map(|kind| values(quantiser, kind));
        Self::part(quantiser, [disk_um, ring_um], &shape_bins, &colour_bins)
    }

    /// Of the cell of R1 and R2, micrometres, the descriptors with these values of shape_bins and of m (0 without
    /// colour), in their order; with every w.
    ///
    /// # Errors
    /// [`QuantiseError::NotInTable`] if one of them is not a value of the quantiser's table.
    ///
    /// # Panics
    /// Without a value of shape_bins or of m: a programming error.
    pub fn part(
        quantiser: &Quantiser,
        [disk_um, ring_um]: [u32; 2],
        shape_bins: &[u32],
        colour_bins: &[u32],
    ) -> Result<Self, QuantiseError> {
        let parameters = |shape_bins, colour_bins, shape_weight_ppm| Parameters {
            shape_bins,
            colour_bins,
            disk_um,
            ring_um,
            shape_weight_ppm,
        };
        let binning = |n, m| quantiser.binning(&parameters(n, m, 0));
        let weight = |ppm| parameters(0, 0, ppm).shape_weight();
        let shape: Vec<Binning> =
            shape_bins.iter().map(|&n| binning(n, colour_bins[0])).collect::<Result<_, _>>()?;
        let colour: Vec<Binning> =
            colour_bins.iter().map(|&m| binning(shape_bins[0], m)).collect::<Result<_, _>>()?;
        Ok(Self {
            bins: [
                consecutive_ranges(shape.iter().map(Binning::shape_bins)),
                consecutive_ranges(colour.iter().map(Binning::colour_bins)),
            ],
            first_angle: shape.iter().flat_map(Binning::first_angles).collect(),
            shape,
            colour,
            weights: values(quantiser, GeneKind::ShapeWeight).into_iter().map(weight).collect(),
            classes: quantiser.classes(),
        })
    }

    /// R1, micrometres.
    pub fn disk_um(&self) -> u32 {
        self.shape[0].parameters.disk_um
    }

    /// Number of descriptors: the length of what [`Cell::object_correct`] gives.
    pub fn descriptors(&self) -> usize {
        self.shape.len() * self.colour.len() * self.weights.len()
    }
}

/// Consecutive ranges of these lengths, from 0 on.
fn consecutive_ranges(lengths: impl Iterator<Item = usize>) -> Vec<Range<usize>> {
    let mut end = 0;
    let range = |length| {
        let start = end;
        end += length;
        start..end
    };
    lengths.map(range).collect()
}

/// All values of a gene; 0 where the table is without it.
fn values(quantiser: &Quantiser, kind: GeneKind) -> Vec<u32> {
    quantiser.table().domain(kind).map_or_else(|| vec![0], |domain| domain.values().collect())
}

#[cfg(test)]
mod tests;
