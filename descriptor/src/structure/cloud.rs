//! What all structures need of one cloud: points and keypoints of the usual grids, with colours and normals.

use std::borrow::Cow;

use crate::keypoints::Keypoints;
use crate::normals::{Normal, normals, normals_at};
use crate::prepare::keypoints;
use crate::prepare_error::{PrepareError, Skip};
use crate::{Cloud, Preprocess};

/// Edges of the voxels of the grids that are kept, micrometres.
pub(super) const GRIDS_UM: [u32; 4] = [10_000, 15_000, 20_000, 30_000];

/// Some points of a cloud, or keypoints of one of its grids.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Points {
    /// Metres.
    pub(super) positions: Vec<[f32; 3]>,
    /// One for each point, if the cloud has colours.
    pub(super) colours: Option<Vec<[u8; 3]>>,
    /// One for each point.
    pub(super) normals: Vec<Normal>,
}

impl Points {
    fn of_keypoints(keypoints: Keypoints, normals: Vec<Normal>) -> Self {
        Self { positions: keypoints.points, colours: keypoints.colours, normals }
    }

    fn bytes(&self) -> usize {
        let colours = self.colours.as_deref().unwrap_or_default();
        size_of_val(self.positions.as_slice()) + size_of_val(colours) + size_of_val(self.normals.as_slice())
    }
}

/// A cloud made ready for the channels of any structure.
#[derive(Clone, Debug, PartialEq)]
pub struct StructureCloud {
    /// All points.
    pub(super) points: Points,
    /// Keypoints of each grid of [`GRIDS_UM`].
    pub(super) grids: [Points; GRIDS_UM.len()],
    /// What normals of further keypoints are fitted with.
    pub(super) viewpoint: [f32; 3],
    /// Radius that normals are fitted within, micrometres.
    pub(super) normal_radius_um: u32,
}

impl StructureCloud {
    /// From a cloud as stored.
    ///
    /// # Errors
    /// Exactly those of [`crate::prepare::usable`], which looks at the keypoints of `preprocess` whatever the grids of the
    /// channels; moreover [`PrepareError::CellRange`] if a cell of one of those grids cannot be counted.
    pub fn new(cloud: &Cloud, preprocess: &Preprocess) -> Result<Self, PrepareError> {
        let cloud = preprocess.in_metres(cloud).into_owned();
        let deciding = keypoints(&cloud, preprocess)?;
        let mut grids = Vec::with_capacity(GRIDS_UM.len());
        for edge_um in GRIDS_UM {
            grids.push(Keypoints::new(&cloud, edge(edge_um))?);
        }

        // One fit for all.
        let all = grids.iter().chain([&deciding]).flat_map(|grid| &grid.points).copied();
        let all: Vec<[f32; 3]> = all.collect();
        let [of_points, of_all] = normals(&cloud.points, &all, preprocess.normal_radius(), cloud.viewpoint)?;
        let (of_grids, of_deciding) = of_all.split_at(all.len() - deciding.len());
        if of_deciding.iter().all(Option::is_none) {
            return Err(Skip::NoKeypointWithNormal { keypoints: deciding.len() }.into());
        }

        let mut grids = grids.into_iter();
        let mut rest = of_grids;
        let grids = GRIDS_UM.map(|_| {
            let keypoints = grids.next().unwrap_or_default();
            let (normals, others) = rest.split_at(keypoints.len());
            rest = others;
            Points::of_keypoints(keypoints, normals.to_vec())
        });
        let Cloud { points: positions, colours, viewpoint } = cloud;
        let points = Points { positions, colours, normals: of_points };
        Ok(Self { points, grids, viewpoint, normal_radius_um: preprocess.normal_radius_um })
    }

    /// From a cloud in metres whose normals are known, with keypoints of these grids only: what one structure needs.
    ///
    /// # Errors
    /// As [`StructureCloud::new`], but that the cloud is known to take part.
    pub(crate) fn of_grids(
        cloud: &Cloud,
        of_points: &[Normal],
        preprocess: &Preprocess,
        grids_um: &[u32],
    ) -> Result<Self, PrepareError> {
        let mut grids: [Points; GRIDS_UM.len()] = Default::default();
        for (grid, edge_um) in grids.iter_mut().zip(GRIDS_UM) {
            if grids_um.contains(&edge_um) {
                let keypoints = Keypoints::new(cloud, edge(edge_um))?;
                let radius = preprocess.normal_radius();
                let of_keypoints = normals_at(&keypoints.points, &cloud.points, radius, cloud.viewpoint)?;
                *grid = Points::of_keypoints(keypoints, of_keypoints);
            }
        }
        let Cloud { points: positions, colours, viewpoint } = cloud.clone();
        let points = Points { positions, colours, normals: of_points.to_vec() };
        Ok(Self { points, grids, viewpoint, normal_radius_um: preprocess.normal_radius_um })
    }

    /// Number of points.
    pub fn points(&self) -> usize {
        self.points.positions.len()
    }

    /// Memory that the cloud takes, bytes.
    pub fn bytes(&self) -> usize {
        size_of::<Self>() + self.points.bytes() + self.grids.iter().map(Points::bytes).sum::<usize>()
    }

    /// Keypoints of a grid: kept ones, or found now.
    ///
    /// # Errors
    /// [`PrepareError::CellRange`] of a grid that is not kept.
    pub(super) fn keypoints(&self, edge_um: u32) -> Result<Cow<'_, Points>, PrepareError> {
        if let Some(kept) = GRIDS_UM.iter().position(|&kept| kept == edge_um) {
            return Ok(Cow::Borrowed(&self.grids[kept]));
        }
        let Points { positions, colours, .. } = &self.points;
        let cloud = Cloud { points: positions.clone(), colours: colours.clone(), viewpoint: self.viewpoint };
        let keypoints = Keypoints::new(&cloud, edge(edge_um))?;
        let radius = f64::from(self.normal_radius_um) / 1e6;
        let normals = normals_at(&keypoints.points, positions, radius, self.viewpoint)?;
        Ok(Cow::Owned(Points::of_keypoints(keypoints, normals)))
    }
}

/// Edge of a voxel, metres, as [`Preprocess::leaf`] has it.
fn edge(edge_um: u32) -> f32 {
    Preprocess { leaf_um: edge_um, ..Preprocess::default() }.leaf()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prepare::{Normals, usable};
    use crate::testing::sheet;
    use crate::{Cloud, Unit};

    #[test]
    fn points_and_keypoints_are_those_of_all_descriptors() {
        let cloud = sheet(5, 700);
        let ready = StructureCloud::new(&cloud, &Preprocess::default()).unwrap();
        assert_eq!(ready.points(), 700);
        assert_eq!((&ready.points.positions, &ready.points.colours), (&cloud.points, &cloud.colours));
        for edge_um in GRIDS_UM.into_iter().chain([7_000, 25_000]) {
            let preprocess = Preprocess { leaf_um: edge_um, ..Preprocess::default() };
            let expected = keypoints(&cloud, &preprocess).unwrap();
            let normals = Normals::new(&cloud, &expected, &preprocess).unwrap();
            assert_eq!(ready.points.normals, normals.cloud, "{edge_um}");
            let found = ready.keypoints(edge_um).unwrap();
            assert_eq!(*found, Points::of_keypoints(expected, normals.keypoints), "{edge_um}");
            assert_eq!(matches!(found, Cow::Borrowed(_)), GRIDS_UM.contains(&edge_um));
        }
    }

    #[test]
    fn clouds_are_skipped_and_refused_as_for_all_descriptors() {
        let mut far = sheet(1, 30);
        far.points[3][2] = 1e12;
        let mut lone = sheet(1, 40);
        for (index, point) in lone.points.iter_mut().enumerate() {
            *point = [index as f32 * 0.05, 0.0, 0.5];
        }
        // A keypoint with a normal in large voxels and in small ones, but not in those of the preprocessing.
        let mut corners = sheet(1, 40);
        for (index, point) in corners.points.iter_mut().enumerate() {
            let corner = if index % 2 == 0 { 0.0 } else { 0.019 };
            *point = [corner, corner, corner];
        }
        let grey = Cloud { colours: None, ..sheet(1, 30) };
        let short = Cloud { colours: Some(vec![[0; 3]; 29]), ..sheet(1, 30) };
        let clouds = [sheet(1, 7), sheet(1, 0), sheet(1, 30), sheet(2, 300), far, lone, corners, grey, short];
        let default = Preprocess::default();
        let others = [
            default,
            Preprocess { min_points: 0, ..default },
            Preprocess { colour: false, ..default },
            Preprocess { leaf_um: 50_000, normal_radius_um: 3_000, ..default },
            Preprocess { unit: Unit::Millimetre, ..default },
        ];
        let mut used = 0;
        for (cloud, preprocess) in clouds.iter().flat_map(|cloud| others.map(|other| (cloud, other))) {
            let found = StructureCloud::new(cloud, &preprocess);
            used += usize::from(found.is_ok());
            assert_eq!(found.err(), usable(cloud, &preprocess).err(), "{preprocess:?}");
        }
        assert!((10..40).contains(&used), "{used} clouds are used");
    }

    #[test]
    fn a_point_takes_60_bytes_at_most() {
        // As dense as the clouds of a depth camera.
        let cloud = StructureCloud::new(&sheet(1, 2_000), &Preprocess::default()).unwrap();
        assert!((31 * 2_000..60 * 2_000).contains(&cloud.bytes()), "{} bytes", cloud.bytes());
    }
}
