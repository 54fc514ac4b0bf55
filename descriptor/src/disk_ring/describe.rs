//! The stage `describe`: each keypoint's neighbours within the largest radius, quantised and sorted by shell.

use crate::Cloud;
use crate::disk_ring::near::{Field, Near};
use crate::disk_ring::quantise::Quantiser;
use crate::disk_ring::quantised::QuantisedCloud;
use crate::disk_ring::records::Records;
use crate::keypoints::Keypoints;
use crate::prepare::Normals;
use crate::prepare_error::PrepareError;
use crate::surface::SORTED_ABOVE;

impl QuantisedCloud {
    /// The stage `describe`, for a cloud in metres.
    ///
    /// # Errors
    /// [`PrepareError::NoColours`] if the quantiser has colour and the cloud has not,
    /// [`PrepareError::TooManyNeighbours`] if it would take too long.
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
        let mut count = field.count(keypoints.len())?;
        let (mut near, mut list) = (Near::new(&field, quantiser), Neighbours::default());
        for (&keypoint, normal) in keypoints.points.iter().zip(&normals.keypoints) {
            let Some(axis) = *normal else { continue };
            field.find(keypoint, axis, quantiser, &mut near);
            count.add(near.found())?;
            list.append(&field, &near, &mut prepared, quantiser);
        }
        prepared.angles.shrink_to_fit();
        prepared.colours.shrink_to_fit();
        // Found keypoint after keypoint; a descriptor needs two radii of all keypoints.
        let within = |radius| prepared.within.iter().skip(radius).step_by(quantiser.radii());
        prepared.within = (0..quantiser.radii()).flat_map(within).copied().collect();
        Ok(prepared)
    }
}

/// The neighbours of one list; kept to be filled again.
#[derive(Default)]
struct Neighbours {
    angles: Vec<u16>,
    /// Empty without colour.
    colours: Vec<u16>,
    shells: Vec<u16>,
    /// Where the next record of each shell goes.
    places: Vec<usize>,
    sorted: [Vec<u16>; 2],
}

impl Neighbours {
    /// Appends the records of one keypoint, shell by shell.
    fn append(&mut self, field: &Field, near: &Near, prepared: &mut QuantisedCloud, quantiser: &Quantiser) {
        let mut total = 0;
        for list in &near.lists {
            field.codes(near, list, quantiser, [&mut self.angles, &mut self.colours]);
            total += self.angles.len();
            if near.is_mixed {
                let shell = |&place: &u32| quantiser.shell(near.d2[place as usize]) as u16;
                self.shells.clear();
                self.shells.extend(list.places().iter().map(shell));
                self.sort(quantiser.radii());
                // Each place has moved to the end of its shell.
                prepared.within.extend(self.places.iter().map(|&end| end as u32));
            } else {
                prepared.within.push(total as u32);
            }
            prepared.angles.extend(&self.angles);
            prepared.colours.extend(&self.colours);
        }
        prepared.starts.push(prepared.angles.len());
    }

    /// A counting sort by shell.
    fn sort(&mut self, radii: usize) {
        let Self { angles, colours, shells, places, sorted } = self;
        places.clear();
        places.resize(radii, 0);
        for &shell in shells.iter() {
            places[usize::from(shell)] += 1;
        }
        let mut total = 0;
        for place in places.iter_mut() {
            let count = *place;
            *place = total;
            total += count;
        }
        let [sorted_angles, sorted_colours] = sorted;
        sorted_angles.resize(angles.len(), 0);
        sorted_colours.resize(colours.len(), 0);
        for (found, &shell) in shells.iter().enumerate() {
            let place = &mut places[usize::from(shell)];
            sorted_angles[*place] = angles[found];
            if let Some(&colour) = colours.get(found) {
                sorted_colours[*place] = colour;
            }
            *place += 1;
        }
        std::mem::swap(angles, sorted_angles);
        std::mem::swap(colours, sorted_colours);
    }
}
