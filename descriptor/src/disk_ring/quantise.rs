//! Exact classes of angle, colour and distance, fine enough for every descriptor of a gene table (DESIGN 6).
//!
//! Each bin of each descriptor is a union of classes, so a neighbour is classified once and every descriptor only
//! looks its bins up.

use pulp::NullaryFnOnce;

use crate::colour::{Component, HueSaturation};
use crate::disk_ring::angle::{self, Turn};
use crate::disk_ring::bins::BinOfClass;
use crate::disk_ring::step_table::StepTable;
use crate::neighbours::floor_f32;
use crate::wide::widest;
use crate::{GeneKind, GeneTable, Parameters};

/// Most radii in one table: each costs four bytes a keypoint.
pub const MAX_RADII: usize = 4096;

/// Why a gene table cannot be quantised, or a descriptor is none of the table.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum QuantiseError {
    /// Too many values of R1 and R2.
    #[error("R1, R2: more than {MAX_RADII} different values, got {got}\nchoose larger steps")]
    TooManyRadii { got: usize },
    /// Hue and saturation have more classes than a record can hold.
    #[error(
        "m: more than 65536 colour classes over all values, got {got}\nleave out the largest values of m or choose a larger step"
    )]
    TooManyColours { got: usize },
    /// Angles have more classes than a record can hold.
    #[error(
        "shape_bins: more than 65536 angle classes over all values, got {got}\nleave out the largest values or choose a larger step"
    )]
    TooManyAngles { got: usize },
    /// A parameter outside the table that the clouds were prepared for.
    #[error(
        "{gene}: not a value of the gene table the clouds were prepared for, got {got}\nprepare them with a table that holds it"
    )]
    NotInTable { gene: &'static str, got: String },
}

/// The classes of one gene table.
#[derive(Clone, Debug, PartialEq)]
pub struct Quantiser {
    table: GeneTable,
    angle_bounds: Vec<Turn>,
    angle_table: StepTable,
    /// Empty without colour, like those of saturation.
    hue_bounds: Vec<f32>,
    saturation_bounds: Vec<f32>,
    /// All values of R1 and R2, ascending, micrometres.
    radii_um: Vec<u32>,
    radius_table: StepTable,
    digest: [u8; 32],
}

impl Quantiser {
    /// The classes that serve every descriptor of the table.
    ///
    /// # Errors
    /// If the table has more values than the compact records have room for; the paper's table is far from it.
    pub fn new(table: &GeneTable) -> Result<Self, QuantiseError> {
        let values = |kind| table.domain(kind).into_iter().flat_map(|domain| domain.values());

        let angle_bounds = angle::bounds(values(GeneKind::ShapeBins));
        if angle_bounds.len() > usize::from(u16::MAX) {
            return Err(QuantiseError::TooManyAngles { got: angle_bounds.len() + 1 });
        }
        let hue_bounds = Component::Hue.bounds(values(GeneKind::ColourBins));
        let saturation_bounds = Component::Saturation.bounds(values(GeneKind::ColourBins));
        let colours = (hue_bounds.len() + 1) * (saturation_bounds.len() + 1);
        if colours > usize::from(u16::MAX) + 1 {
            return Err(QuantiseError::TooManyColours { got: colours });
        }
        let mut radii_um: Vec<u32> =
            values(GeneKind::DiskRadius).chain(values(GeneKind::RingRadius)).collect();
        radii_um.sort_unstable();
        radii_um.dedup();
        if radii_um.len() > MAX_RADII {
            return Err(QuantiseError::TooManyRadii { got: radii_um.len() });
        }

        // An angle reaches a bound when its cosine does not exceed the bound's: −cosine ≥ −bound, in other words
        // −cosine is above the largest f32 below −bound.
        let angle_thresholds =
            angle_bounds.iter().map(|&bound| floor_f32((-bound.cosine()).next_down())).collect();
        let radius_thresholds = radii_um.iter().map(|&um| floor_f32(squared_metres(um))).collect();
        let digest = digest(&angle_bounds, [&hue_bounds, &saturation_bounds], &radii_um);
        Ok(Self {
            table: table.clone(),
            angle_bounds,
            angle_table: StepTable::new(angle_thresholds),
            hue_bounds,
            saturation_bounds,
            radii_um,
            radius_table: StepTable::new(radius_thresholds),
            digest,
        })
    }

    /// The gene table that it was made for.
    pub fn table(&self) -> &GeneTable {
        &self.table
    }

    /// Whether records carry colours.
    pub fn has_colour(&self) -> bool {
        self.table.has_colour()
    }

    /// BLAKE3 over all bounds: clouds prepared under equal digests hold equal records.
    pub fn digest(&self) -> [u8; 32] {
        self.digest
    }

    /// The largest radius of any region, metres.
    pub fn reach(&self) -> f64 {
        self.radii_um.last().map_or(0.0, |&um| f64::from(um) / 1e6)
    }

    /// Largest d² of a neighbour in any region, square metres.
    pub(crate) fn reach2(&self) -> f32 {
        self.radius_table.last().unwrap_or(0.0)
    }

    /// Numbers of angle classes and of colour classes.
    pub(crate) fn classes(&self) -> [usize; 2] {
        let colours = (self.hue_bounds.len() + 1) * (self.saturation_bounds.len() + 1);
        [self.angle_bounds.len() + 1, if self.has_colour() { colours } else { 0 }]
    }

    /// Number of radii.
    pub(crate) fn radii(&self) -> usize {
        self.radius_table.len()
    }

    /// For every radius, ascending, the largest d² of a neighbour within it, square metres.
    pub(crate) fn squared_radii(&self) -> &[f32] {
        self.radius_table.thresholds()
    }

    /// Number of radii R with d² > R²: the shell that a neighbour lies in.
    #[inline(always)]
    pub(crate) fn shell(&self, d2: f32) -> usize {
        self.radius_table.below(d2)
    }

    /// Number of bounds that an angle between two unit normals has reached, its class, by its negative cosine.
    pub(crate) fn angle_table(&self) -> &StepTable {
        &self.angle_table
    }

    /// Class of the angle between two unit normals, from its cosine.
    #[cfg(test)]
    pub(crate) fn angle_class(&self, cosine: f32) -> u16 {
        self.angle_table.below(-cosine) as u16
    }

    /// Classes of colours: hue class · number of saturation classes + saturation class.
    pub(crate) fn colour_classes(&self, colours: &[[u8; 3]]) -> Vec<u16> {
        widest(ColourClasses { quantiser: self, colours })
    }

    /// How the classes fall into the bins of one descriptor.
    ///
    /// # Errors
    /// [`QuantiseError::NotInTable`] if a value is none of the table's.
    pub fn binning(&self, parameters: &Parameters) -> Result<Binning, QuantiseError> {
        for kind in GeneKind::ALL {
            let (spec, ticks) = (kind.spec(), parameters.ticks(kind));
            let Some(domain) = self.table.domain(kind) else { continue };
            let in_domain = ticks >= domain.low
                && ticks <= domain.high()
                && (domain.count == 1 || (ticks - domain.low).is_multiple_of(domain.step));
            // The weight takes part in no histogram, so any will do.
            if !in_domain && kind != GeneKind::ShapeWeight {
                return Err(QuantiseError::NotInTable {
                    gene: spec.name,
                    got: spec.value(ticks).to_string(),
                });
            }
        }
        if parameters.has_colour() && !self.has_colour() {
            return Err(QuantiseError::NotInTable { gene: "m", got: parameters.colour_bins.to_string() });
        }
        let position = |um: u32| self.radii_um.partition_point(|&radius| radius < um);
        let m = parameters.colour_bins;
        let hues = Component::Hue.bin_of_class(&self.hue_bounds, m);
        let saturations = Component::Saturation.bin_of_class(&self.saturation_bounds, m);
        let colour_bin = |hue: u16| saturations.iter().map(move |saturation| m as u16 * hue + saturation);
        Ok(Binning {
            parameters: *parameters,
            shape: BinOfClass::new(angle::bin_of_class(&self.angle_bounds, parameters.shape_bins)),
            colour: BinOfClass::new(hues.iter().flat_map(|&hue| colour_bin(hue))),
            disk: position(parameters.disk_um),
            ring: position(parameters.ring_um),
            digest: self.digest,
        })
    }
}

/// Colours that are classified at once.
const COLOURS: usize = 64;

/// The kernel of [`Quantiser::colour_classes`].
struct ColourClasses<'a> {
    quantiser: &'a Quantiser,
    colours: &'a [[u8; 3]],
}

impl NullaryFnOnce for ColourClasses<'_> {
    type Output = Vec<u16>;

    #[inline(always)]
    fn call(self) -> Vec<u16> {
        let Quantiser { hue_bounds, saturation_bounds, .. } = self.quantiser;
        let columns = saturation_bounds.len() as u32 + 1;
        let mut classes = vec![0; self.colours.len()];
        for (classes, colours) in classes.chunks_mut(COLOURS).zip(self.colours.chunks(COLOURS)) {
            let [mut hues, mut saturations] = [[0.0f32; COLOURS]; 2];
            for ((hue, saturation), &colour) in hues.iter_mut().zip(&mut saturations).zip(colours) {
                let components = HueSaturation::new(colour);
                (*hue, *saturation) = (components.hue, components.saturation);
            }
            // There are few bounds: comparing with all of them in vectors costs less than a search.
            let [mut hue_classes, mut saturation_classes] = [[0u32; COLOURS]; 2];
            for (bounds, values, classes) in [
                (hue_bounds, &hues, &mut hue_classes),
                (saturation_bounds, &saturations, &mut saturation_classes),
            ] {
                for &bound in bounds {
                    for (class, &value) in classes.iter_mut().zip(values) {
                        *class += u32::from(bound <= value);
                    }
                }
            }
            for ((class, hue), saturation) in classes.iter_mut().zip(hue_classes).zip(saturation_classes) {
                *class = (hue * columns + saturation) as u16;
            }
        }
        classes
    }
}

/// The classes of a quantiser as bins of one descriptor.
#[derive(Clone, Debug)]
pub struct Binning {
    pub(crate) parameters: Parameters,
    /// Shape bin of every angle class.
    pub(crate) shape: BinOfClass,
    /// Colour bin of every colour class.
    pub(crate) colour: BinOfClass,
    /// Position of R1 and R2 among the quantiser's radii.
    pub(crate) disk: usize,
    pub(crate) ring: usize,
    pub(crate) digest: [u8; 32],
}

impl Binning {
    /// Bins of a shape histogram that an angle can fall into: angles end at 180 of the 360 degrees (paper, eq. 2).
    pub(crate) fn shape_bins(&self) -> usize {
        (self.parameters.shape_bins as usize - 1) / 2 + 1
    }

    /// The first angle class of each of the shape bins: those of a bin follow each other.
    pub(crate) fn first_angles(&self) -> impl Iterator<Item = u16> {
        (0..self.shape_bins()).map(|bin| self.shape.first(bin))
    }

    /// Bins of a colour histogram, m².
    pub(crate) fn colour_bins(&self) -> usize {
        let m = self.parameters.colour_bins as usize;
        m * m
    }

    /// The descriptor that is binned for.
    pub fn parameters(&self) -> &Parameters {
        &self.parameters
    }
}

/// Square of a radius, square metres, in f64.
pub(crate) fn squared_metres(um: u32) -> f64 {
    let metres = f64::from(um) / 1e6;
    metres * metres
}

fn digest(angles: &[Turn], colours: [&[f32]; 2], radii_um: &[u32]) -> [u8; 32] {
    let mut hasher = blake3::Hasher::new_derive_key("descry quantiser v1");
    hasher.update(&(angles.len() as u64).to_le_bytes());
    for bound in angles {
        hasher.update(&bound.over.to_le_bytes());
        hasher.update(&bound.under.to_le_bytes());
    }
    for bounds in colours {
        hasher.update(&(bounds.len() as u64).to_le_bytes());
        for bound in bounds {
            hasher.update(&bound.to_bits().to_le_bytes());
        }
    }
    hasher.update(&(radii_um.len() as u64).to_le_bytes());
    for radius in radii_um {
        hasher.update(&radius.to_le_bytes());
    }
    *hasher.finalize().as_bytes()
}
