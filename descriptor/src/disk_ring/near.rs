//! The neighbours of one keypoint after the other: found block by block, and classified.

use pulp::{NullaryFnOnce, Simd, WithSimd};

use crate::Cloud;
use crate::disk_ring::quantise::Quantiser;
use crate::disk_ring::records::Records;
use crate::prepare::{NeighbourCount, Normals};
use crate::prepare_error::PrepareError;
use crate::select::{BELOW_ALL, select};
use crate::surface::{BLOCK, Surface, block, block_mut};
use crate::wide::widest;

/// Shells up to which each is given a list of its own: as many passes over a block cost less than a sort.
const FEW_SHELLS: usize = 4;

/// The points that may be neighbours.
pub(super) struct Field {
    surface: Surface,
    /// No records yet, for the colours that occur.
    pub(super) colour_records: Records,
    /// Colour of every point, as a code of these records, in whole blocks; empty without colour.
    colours: Vec<u16>,
}

impl Field {
    /// The points of a cloud in metres that have a normal; those of more than `sorted_above` points sorted.
    ///
    /// # Errors
    /// [`PrepareError::NoColours`] if the quantiser has colour and the cloud has not.
    pub(super) fn new(
        cloud: &Cloud,
        normals: &Normals,
        quantiser: &Quantiser,
        sorted_above: usize,
    ) -> Result<Self, PrepareError> {
        let colours = match &cloud.colours {
            Some(colours) if quantiser.has_colour() => colours.as_slice(),
            None if quantiser.has_colour() => return Err(PrepareError::NoColours),
            _ => &[],
        };
        let surface = Surface::new(cloud, normals, quantiser.reach(), sorted_above)?;
        let colour = |&index: &u32| colours.get(index as usize).copied();
        let colours: Vec<[u8; 3]> = surface.indices.iter().filter_map(colour).collect();
        let mut colours = quantiser.colour_classes(&colours);
        let [_, classes] = quantiser.classes();
        let mut occurs = vec![false; classes];
        colours.iter().for_each(|&class| occurs[usize::from(class)] = true);
        let occurring =
            (0u16..).zip(&occurs).filter_map(|(class, &occurs)| occurs.then_some(class)).collect();
        let colour_records = Records::of_classes(occurring);
        if let Some(listed) = colour_records.listed() {
            let mut codes = vec![0; classes];
            (0u16..).zip(listed).for_each(|(code, &class)| codes[usize::from(class)] = code);
            colours.iter_mut().for_each(|colour| *colour = codes[usize::from(*colour)]);
        }
        if quantiser.has_colour() {
            colours.resize(colours.len().next_multiple_of(BLOCK), 0);
        }
        Ok(Self { surface, colour_records, colours })
    }

    /// A count of what is found about so many keypoints.
    ///
    /// # Errors
    /// [`PrepareError::TooManyNeighbours`] if looking would take too long.
    pub(super) fn count(&self, keypoints: usize) -> Result<NeighbourCount, PrepareError> {
        NeighbourCount::new(self.surface.indices.len(), self.surface.blocks(), keypoints)
    }

    /// Finds the points within reach of a keypoint with this normal.
    pub(super) fn find(&self, keypoint: [f32; 3], axis: [f32; 3], quantiser: &Quantiser, near: &mut Near) {
        widest(Find { surface: &self.surface, keypoint, axis, quantiser, near });
    }

    /// Codes of the points of a list: the classes of their angles, and their colours, if there are any.
    pub(super) fn codes(&self, near: &Near, list: &List, quantiser: &Quantiser, codes: [&mut Vec<u16>; 2]) {
        widest(Codes { field: self, near, places: list.places(), quantiser, codes });
    }
}

/// The kernel of [`Field::find`].
struct Find<'a> {
    surface: &'a Surface,
    keypoint: [f32; 3],
    axis: [f32; 3],
    quantiser: &'a Quantiser,
    near: &'a mut Near,
}

impl WithSimd for Find<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Near { d2, opposite, slices, lists, limits, .. } = self.near;
        lists.iter_mut().for_each(|list| list.count = 0);
        let ([kx, ky, kz], [ax, ay, az]) = (self.keypoint, self.axis);
        let slicer = self.quantiser.angle_table().slicer();
        for number in 0..self.surface.blocks() {
            if self.surface.is_out_of_reach(number, self.keypoint, self.quantiser.reach2()) {
                continue;
            }
            let [x, y, z] = self.surface.position.each_ref().map(|values| block(values, number));
            let d2 = block_mut(d2, number);
            for (((d2, &x), &y), &z) in d2.iter_mut().zip(x).zip(y).zip(z) {
                let (x, y, z) = (x - kx, y - ky, z - kz);
                *d2 = x * x + y * y + z * z;
            }
            let [x, y, z] = self.surface.normal.each_ref().map(|values| block(values, number));
            let opposite = block_mut(opposite, number);
            for (((opposite, &x), &y), &z) in opposite.iter_mut().zip(x).zip(y).zip(z) {
                *opposite = -(ax * x + ay * y + az * z);
            }
            for (slice, &opposite) in block_mut(slices, number).iter_mut().zip(opposite.iter()) {
                *slice = slicer.slice(opposite);
            }
            let mut beyond = BELOW_ALL;
            for (list, &limit) in lists.iter_mut().zip(limits.iter()) {
                list.count =
                    select(simd, d2, [beyond, limit], (number * BLOCK) as u32, &mut list.places, list.count);
                beyond = limit;
            }
        }
    }
}

/// The kernel of [`Field::codes`].
struct Codes<'a> {
    field: &'a Field,
    near: &'a Near,
    places: &'a [u32],
    quantiser: &'a Quantiser,
    codes: [&'a mut Vec<u16>; 2],
}

impl NullaryFnOnce for Codes<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let Self { field, near, places, quantiser, codes: [angles, colours] } = self;
        quantiser.angle_table().fill(&near.opposite, &near.slices, places, angles);
        if quantiser.has_colour() {
            colours.resize(places.len(), 0);
            for (colour, &place) in colours.iter_mut().zip(places) {
                *colour = field.colours[place as usize];
            }
        }
    }
}

/// What is found around one keypoint; kept to be filled again.
pub(super) struct Near {
    /// Squared distance of every point of the blocks that were looked at.
    pub(super) d2: Vec<f32>,
    /// Their negative cosines, and the slices of the quantiser's table of angles that they are in.
    opposite: Vec<f32>,
    slices: Vec<u16>,
    /// One for every shell; or one for all of them.
    pub(super) lists: Vec<List>,
    /// Largest d² in each list, ascending.
    limits: Vec<f32>,
    /// Whether there is one list for all shells.
    pub(super) is_mixed: bool,
}

/// Points that were found, ascending.
#[derive(Clone)]
pub(super) struct List {
    places: Vec<u32>,
    count: usize,
}

impl List {
    pub(super) fn places(&self) -> &[u32] {
        &self.places[..self.count]
    }
}

impl Near {
    /// How many points were found.
    pub(super) fn found(&self) -> usize {
        self.lists.iter().map(|list| list.count).sum()
    }

    /// Room for the points of a field by the shells of a quantiser.
    pub(super) fn new(field: &Field, quantiser: &Quantiser) -> Self {
        let is_mixed = quantiser.radii() > FEW_SHELLS;
        let limits = if is_mixed { vec![quantiser.reach2()] } else { quantiser.squared_radii().to_vec() };
        let room = field.surface.room();
        let list = List { places: vec![0; room], count: 0 };
        Self {
            d2: vec![0.0; room],
            opposite: vec![0.0; room],
            slices: vec![0; room],
            lists: vec![list; limits.len()],
            limits,
            is_mixed,
        }
    }
}
