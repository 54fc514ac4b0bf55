//! The stage `describe`: each keypoint's neighbours within the largest radius, quantised and sorted by shell.

use pulp::NullaryFnOnce;

use crate::Cloud;
use crate::disk_ring::quantise::Quantiser;
use crate::disk_ring::quantised::QuantisedCloud;
use crate::disk_ring::records::Records;
use crate::disk_ring::step_table::Slicer;
use crate::keypoints::Keypoints;
use crate::prepare::Normals;
use crate::prepare_error::PrepareError;
use crate::surface::{BLOCK, SORTED_ABOVE, Surface};
use crate::wide::widest;

impl QuantisedCloud {
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

    /// As [`QuantisedCloud::describe`], with blocks of neighbouring points for clouds of more than `sorted_above` points.
    pub(crate) fn describe_sorted(
        cloud: &Cloud,
        keypoints: &Keypoints,
        normals: &Normals,
        quantiser: &Quantiser,
        sorted_above: usize,
    ) -> Result<Self, PrepareError> {
        let field = Field::new(cloud, normals, quantiser, sorted_above)?;
        let [angle_classes, _] = quantiser.classes();
        let mut prepared = Self {
            angles: Records::of_classes((0..angle_classes).map(|class| class as u16).collect()),
            colours: field.colour_records.clone(),
            starts: vec![0],
            within: Vec::new(),
            digest: quantiser.digest(),
        };
        let mut near = Near::new(quantiser);
        for (&keypoint, normal) in keypoints.points.iter().zip(&normals.keypoints) {
            let Some(axis) = *normal else { continue };
            field.find(keypoint, axis, quantiser, &mut near);
            near.append_to(&mut prepared, quantiser);
        }
        prepared.angles.shrink_to_fit();
        prepared.colours.shrink_to_fit();
        // Found keypoint after keypoint; a descriptor needs two radii of all keypoints.
        let within = |radius| prepared.within.iter().skip(radius).step_by(quantiser.radii());
        prepared.within = (0..quantiser.radii()).flat_map(within).copied().collect();
        Ok(prepared)
    }
}

/// The points that may be neighbours.
struct Field {
    surface: Surface,
    /// No records yet, for the colours that occur.
    colour_records: Records,
    /// Colour of every point, as a code of these records; empty without colour.
    colours: Vec<u16>,
}

impl Field {
    fn new(
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
        let colour = |&index: &u32| colours.get(index as usize).map(|&colour| quantiser.colour_class(colour));
        let mut colours: Vec<u16> = surface.indices.iter().filter_map(colour).collect();
        let mut classes = colours.clone();
        classes.sort_unstable();
        classes.dedup();
        let colour_records = Records::of_classes(classes);
        if let Some(listed) = colour_records.listed() {
            for colour in &mut colours {
                *colour = listed.partition_point(|class| class < colour) as u16;
            }
        }
        Ok(Self { surface, colour_records, colours })
    }

    /// Finds the points within reach of a keypoint with this normal.
    fn find(&self, keypoint: [f32; 3], axis: [f32; 3], quantiser: &Quantiser, near: &mut Near) {
        near.clear();
        let Surface { position, normal, .. } = &self.surface;
        for block in self.surface.blocks(keypoint, quantiser.reach2()) {
            let position = position.each_ref().map(|values| &values[block.clone()]);
            let normal = normal.each_ref().map(|values| &values[block.clone()]);
            let found = &mut near.found;
            widest(Block { position, normal, keypoint, axis, angles: quantiser.angle_slicer(), found });
            let colours = if quantiser.has_colour() { &self.colours[block.clone()] } else { &[] };
            let mut beyond = -1.0; // no d² is below 0
            for (list, &limit) in near.lists.iter_mut().zip(&near.limits) {
                list.take(found, block.len(), [beyond, limit], quantiser, colours);
                beyond = limit;
            }
        }
    }
}

/// Shells up to which each is given a list of its own: as many passes over a block cost less than a sort.
const FEW_SHELLS: usize = 4;

/// What is found around one keypoint; kept to be filled again.
struct Near {
    found: Found,
    /// One for every shell; or one for all of them, to be sorted.
    lists: Vec<List>,
    /// Largest d² in each list, ascending.
    limits: Vec<f32>,
    /// Where the next record of each shell goes.
    places: Vec<usize>,
    /// Angles and colours sorted by shell.
    sorted: [Vec<u16>; 2],
}

/// Neighbours in the order in which they were found.
#[derive(Clone, Default)]
struct List {
    angles: Vec<u16>,
    /// Empty without colour.
    colours: Vec<u16>,
    /// Whether it holds more than one shell.
    is_mixed: bool,
    /// Empty unless it is.
    shells: Vec<u16>,
}

/// What is computed for every point of one block, and which of them are taken.
struct Found {
    d2: [f32; BLOCK],
    cosine: [f32; BLOCK],
    angle_slice: [u16; BLOCK],
    selected: [u8; BLOCK],
}

impl Default for Found {
    fn default() -> Self {
        Self { d2: [0.0; BLOCK], cosine: [0.0; BLOCK], angle_slice: [0; BLOCK], selected: [0; BLOCK] }
    }
}

impl List {
    /// Adds those of the first `points` points of a block whose d² is above `beyond` and not above `limit`.
    fn take(
        &mut self,
        found: &mut Found,
        points: usize,
        [beyond, limit]: [f32; 2],
        quantiser: &Quantiser,
        colours: &[u16],
    ) {
        let Found { d2, cosine, angle_slice, selected } = found;
        // Free of branches: about half of the points are neighbours, in no pattern a processor could predict.
        let mut count = 0;
        for (place, &d2) in (0u8..).zip(&d2[..points]) {
            selected[count % BLOCK] = place;
            count += usize::from((d2 > beyond) & (d2 <= limit));
        }
        let selected = selected[..count].iter().map(|&place| usize::from(place) % BLOCK);
        let angle = |place| quantiser.angle_class_in(angle_slice[place], cosine[place]);
        self.angles.extend(selected.clone().map(angle));
        if self.is_mixed {
            self.shells.extend(selected.clone().map(|place| quantiser.shell(d2[place]) as u16));
        }
        if !colours.is_empty() {
            self.colours.extend(selected.map(|place| colours[place]));
        }
    }
}

impl Near {
    fn new(quantiser: &Quantiser) -> Self {
        let is_mixed = quantiser.radii() > FEW_SHELLS;
        let limits = if is_mixed { vec![quantiser.reach2()] } else { quantiser.squared_radii().to_vec() };
        let lists = vec![List { is_mixed, ..List::default() }; limits.len()];
        Self { found: Found::default(), lists, limits, places: Vec::new(), sorted: Default::default() }
    }

    fn clear(&mut self) {
        for List { angles, colours, shells, .. } in &mut self.lists {
            angles.clear();
            colours.clear();
            shells.clear();
        }
    }

    /// Appends the records of one keypoint, shell by shell.
    fn append_to(&mut self, prepared: &mut QuantisedCloud, quantiser: &Quantiser) {
        let mut total = 0;
        for list in &self.lists {
            if list.is_mixed {
                let [angles, colours] = &mut self.sorted;
                list.sort_into(angles, colours, &mut self.places, quantiser.radii());
                prepared.angles.extend(angles.iter().copied());
                prepared.colours.extend(colours.iter().copied());
                // Each place has moved to the end of its shell.
                prepared.within.extend(self.places.iter().map(|&end| end as u32));
                continue;
            }
            prepared.angles.extend(list.angles.iter().copied());
            prepared.colours.extend(list.colours.iter().copied());
            total += list.angles.len();
            prepared.within.push(total as u32);
        }
        prepared.starts.push(prepared.angles.len());
    }
}

impl List {
    /// A counting sort by shell.
    fn sort_into(
        &self,
        angles: &mut Vec<u16>,
        colours: &mut Vec<u16>,
        places: &mut Vec<usize>,
        radii: usize,
    ) {
        places.clear();
        places.resize(radii, 0);
        for &shell in &self.shells {
            places[usize::from(shell)] += 1;
        }
        let mut total = 0;
        for place in places.iter_mut() {
            let count = *place;
            *place = total;
            total += count;
        }
        angles.resize(total, 0);
        colours.resize(self.colours.len(), 0);
        for (found, &shell) in self.shells.iter().enumerate() {
            let place = &mut places[usize::from(shell)];
            angles[*place] = self.angles[found];
            if let Some(&colour) = self.colours.get(found) {
                colours[*place] = colour;
            }
            *place += 1;
        }
    }
}

/// The kernel of [`Field::find`]: squared distances and cosines of one block, and where to look their classes up.
struct Block<'a> {
    position: [&'a [f32]; 3],
    normal: [&'a [f32]; 3],
    keypoint: [f32; 3],
    axis: [f32; 3],
    angles: Slicer,
    found: &'a mut Found,
}

impl NullaryFnOnce for Block<'_> {
    type Output = ();

    #[inline(always)]
    fn call(self) {
        let ([x, y, z], [nx, ny, nz]) = (self.position, self.normal);
        let ([kx, ky, kz], [ax, ay, az]) = (self.keypoint, self.axis);
        for (((d2, &x), &y), &z) in self.found.d2.iter_mut().zip(x).zip(y).zip(z) {
            let (x, y, z) = (x - kx, y - ky, z - kz);
            *d2 = x * x + y * y + z * z;
        }
        for (((cosine, &x), &y), &z) in self.found.cosine.iter_mut().zip(nx).zip(ny).zip(nz) {
            *cosine = ax * x + ay * y + az * z;
        }
        for (slice, &cosine) in self.found.angle_slice.iter_mut().zip(&self.found.cosine) {
            *slice = self.angles.slice(-cosine);
        }
    }
}
