//! The stage `describe`: each keypoint's neighbours within the largest radius, quantised and sorted by shell.

use pulp::NullaryFnOnce;

use crate::Cloud;
use crate::cubes::Cubes;
use crate::keypoints::Keypoints;
use crate::prepare::{Normals, PrepareError, PreparedCloud};
use crate::quantise::Quantiser;
use crate::steps::Slicer;
use crate::wide::widest;

/// Points that are passed over together if none of them can be a neighbour.
const BLOCK: usize = 64;

/// Points above which blocks are made of neighbouring points; below it, looking at all of them costs less.
const SORTED_ABOVE: usize = 20_000;

impl PreparedCloud {
    /// The stage `describe`, for a cloud in metres.
    ///
    /// # Errors
    /// [`PrepareError::NoColours`] if the quantiser has colour and the cloud has not.
    pub fn describe(
        cloud: &Cloud,
        keypoints: &Keypoints,
        normals: &Normals,
        quantiser: &Quantiser,
    ) -> Result<Self, PrepareError> {
        Self::describe_sorted(cloud, keypoints, normals, quantiser, SORTED_ABOVE)
    }

    /// As [`PreparedCloud::describe`], with blocks of neighbouring points for clouds of more than `sorted_above` points.
    pub(crate) fn describe_sorted(
        cloud: &Cloud,
        keypoints: &Keypoints,
        normals: &Normals,
        quantiser: &Quantiser,
        sorted_above: usize,
    ) -> Result<Self, PrepareError> {
        let field = Field::new(cloud, normals, quantiser, sorted_above)?;
        let mut prepared = Self {
            angles: Vec::new(),
            colours: Vec::new(),
            starts: vec![0],
            within: Vec::new(),
            radii: quantiser.radii(),
            digest: quantiser.digest(),
        };
        let mut near = Near::default();
        for (&keypoint, normal) in keypoints.points.iter().zip(&normals.keypoints) {
            let Some(axis) = *normal else { continue };
            field.find(keypoint, axis, quantiser, &mut near);
            near.append_to(&mut prepared, quantiser);
        }
        prepared.angles.shrink_to_fit();
        prepared.colours.shrink_to_fit();
        Ok(prepared)
    }
}

/// The points of a cloud that have a normal, value by value.
#[derive(Default)]
struct Field {
    position: [Vec<f32>; 3],
    normal: [Vec<f32>; 3],
    /// Colour classes; empty without colour.
    colours: Vec<u16>,
    /// Lowest and highest corner of every [`BLOCK`] points.
    boxes: Vec<[[f32; 3]; 2]>,
}

impl Field {
    fn new(
        cloud: &Cloud,
        normals: &Normals,
        quantiser: &Quantiser,
        sorted_above: usize,
    ) -> Result<Self, PrepareError> {
        let colours = match &cloud.colours {
            Some(colours) if quantiser.has_colour() => Some(colours),
            None if quantiser.has_colour() => return Err(PrepareError::NoColours),
            _ => None,
        };
        let order: Vec<u32> = if cloud.len() > sorted_above {
            Cubes::new(&cloud.points, quantiser.reach() / 8.0, 0)?.order().to_vec()
        } else {
            (0u32..).take(cloud.len()).collect()
        };
        let mut field = Self::default();
        for index in order {
            let index = index as usize;
            let Some(normal) = normals.cloud[index] else { continue };
            field.position.iter_mut().zip(cloud.points[index]).for_each(|(values, value)| values.push(value));
            field.normal.iter_mut().zip(normal).for_each(|(values, value)| values.push(value));
            field.colours.extend(colours.map(|colours| quantiser.colour_class(colours[index])));
        }
        let [x, y, z] = field.position.each_ref().map(|values| values.chunks(BLOCK));
        field.boxes = x.zip(y).zip(z).map(|((x, y), z)| bounds([x, y, z])).collect();
        Ok(field)
    }

    /// Finds the points within reach of a keypoint with this normal.
    fn find(&self, keypoint: [f32; 3], axis: [f32; 3], quantiser: &Quantiser, near: &mut Near) {
        let reach2 = quantiser.reach2();
        near.angles.clear();
        near.colours.clear();
        near.shells.clear();
        for (block, bounds) in self.boxes.iter().enumerate() {
            if is_out_of_reach(bounds, keypoint, reach2) {
                continue;
            }
            let start = block * BLOCK;
            let end = self.position[0].len().min(start + BLOCK);
            let [position, normal] = [&self.position, &self.normal]
                .map(|values| values.each_ref().map(|values| &values[start..end]));
            let found = &mut near.block;
            let slices = [quantiser.shell_slicer(), quantiser.angle_slicer()];
            widest(Block { position, normal, keypoint, axis, slices, found });
            // Free of branches: about half of the points are neighbours, in no pattern a processor could predict.
            let mut count = 0;
            for (place, &d2) in found.d2[..end - start].iter().enumerate() {
                found.selected[count] = place as u8;
                count += usize::from(d2 <= reach2);
            }
            let selected = &found.selected[..count];
            let shell = |&place: &u8| {
                let place = usize::from(place) % BLOCK;
                quantiser.shell_in(found.shell_slice[place], found.d2[place]) as u16
            };
            let angle = |&place: &u8| {
                let place = usize::from(place) % BLOCK;
                quantiser.angle_class_in(found.angle_slice[place], found.cosine[place])
            };
            near.shells.extend(selected.iter().map(shell));
            near.angles.extend(selected.iter().map(angle));
            if quantiser.has_colour() {
                let colours = &self.colours[start..end];
                near.colours.extend(selected.iter().map(|&place| colours[usize::from(place)]));
            }
        }
    }
}

fn bounds(values: [&[f32]; 3]) -> [[f32; 3]; 2] {
    let extreme =
        |pick: fn(f32, f32) -> f32| values.map(|values| values.iter().copied().reduce(pick).unwrap_or(0.0));
    [extreme(f32::min), extreme(f32::max)]
}

/// Whether no point of a box can be a neighbour. Rounds like the distances of points, so that it errs only towards
/// looking: differences and squares never decrease with the distance along an axis, however they round.
fn is_out_of_reach([low, high]: &[[f32; 3]; 2], keypoint: [f32; 3], reach2: f32) -> bool {
    let [x, y, z] = [0, 1, 2].map(|axis| {
        let outside = keypoint[axis].clamp(low[axis], high[axis]) - keypoint[axis];
        outside * outside
    });
    x + y + z > reach2
}

/// What is found around one keypoint; kept to be filled again.
#[derive(Default)]
struct Near {
    block: Found,
    shells: Vec<u16>,
    angles: Vec<u16>,
    colours: Vec<u16>,
    /// Where the next record of each shell goes.
    places: Vec<usize>,
}

/// What is computed for every point of one block, and which of them are neighbours.
struct Found {
    d2: [f32; BLOCK],
    cosine: [f32; BLOCK],
    shell_slice: [u16; BLOCK],
    angle_slice: [u16; BLOCK],
    selected: [u8; BLOCK],
}

impl Default for Found {
    fn default() -> Self {
        let (d2, cosine, selected) = ([0.0; BLOCK], [0.0; BLOCK], [0; BLOCK]);
        Self { d2, cosine, shell_slice: [0; BLOCK], angle_slice: [0; BLOCK], selected }
    }
}

impl Near {
    /// Appends the records of one keypoint: a counting sort by shell.
    fn append_to(&mut self, prepared: &mut PreparedCloud, quantiser: &Quantiser) {
        self.places.clear();
        self.places.resize(quantiser.radii(), 0);
        for &shell in &self.shells {
            self.places[usize::from(shell)] += 1;
        }
        let start = prepared.angles.len();
        let mut total = 0;
        for place in &mut self.places {
            let count = *place;
            *place = start + total;
            total += count;
            prepared.within.push(total as u32);
        }
        prepared.angles.resize(start + total, 0);
        if quantiser.has_colour() {
            prepared.colours.resize(start + total, 0);
        }
        for (found, &shell) in self.shells.iter().enumerate() {
            let place = &mut self.places[usize::from(shell)];
            prepared.angles[*place] = self.angles[found];
            if let Some(&colour) = self.colours.get(found) {
                prepared.colours[*place] = colour;
            }
            *place += 1;
        }
        prepared.starts.push(start + total);
    }
}

/// The kernel of [`Field::find`]: squared distances and cosines of one block, and where to look their classes up.
struct Block<'a> {
    position: [&'a [f32]; 3],
    normal: [&'a [f32]; 3],
    keypoint: [f32; 3],
    axis: [f32; 3],
    /// Of distances and of angles.
    slices: [Slicer; 2],
    found: &'a mut Found,
}

impl NullaryFnOnce for Block<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let ([x, y, z], [nx, ny, nz]) = (self.position, self.normal);
        let ([kx, ky, kz], [ax, ay, az]) = (self.keypoint, self.axis);
        let [shells, angles] = self.slices;
        for (((d2, &x), &y), &z) in self.found.d2.iter_mut().zip(x).zip(y).zip(z) {
            let (x, y, z) = (x - kx, y - ky, z - kz);
            *d2 = x * x + y * y + z * z;
        }
        for (((cosine, &x), &y), &z) in self.found.cosine.iter_mut().zip(nx).zip(ny).zip(nz) {
            *cosine = ax * x + ay * y + az * z;
        }
        for (slice, &d2) in self.found.shell_slice.iter_mut().zip(&self.found.d2) {
            *slice = shells.slice(d2);
        }
        for (slice, &cosine) in self.found.angle_slice.iter_mut().zip(&self.found.cosine) {
            *slice = angles.slice(-cosine);
        }
    }
}
