//! What all structures need of one cloud: points and keypoints of the usual grids, with colours and normals.

use std::borrow::Cow;

use crate::keypoints::Keypoints;
use crate::normals::{Normal, normals, normals_at};
use crate::prepare::{Normals, keypoints};
use crate::prepare_error::{PrepareError, Skip};
use crate::structure::plan::StructurePlan;
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
    /// One for each point; all `None` where no channel needs them.
    pub(super) normals: Vec<Normal>,
}

impl Points {
    /// The keypoints of a cloud's grid, with normals within `radius` metres if there is one.
    fn at_keypoints(cloud: &Cloud, edge_um: u32, radius: Option<f64>) -> Result<Self, PrepareError> {
        let keypoints = Keypoints::new(cloud, edge(edge_um))?;
        let normals = match radius {
            Some(radius) => normals_at(&keypoints.points, &cloud.points, radius, cloud.viewpoint)?,
            None => vec![None; keypoints.len()],
        };
        Ok(Self::of_keypoints(keypoints, normals))
    }

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
            let is_deciding = edge_um == preprocess.leaf_um;
            grids.push(if is_deciding { deciding.clone() } else { Keypoints::new(&cloud, edge(edge_um))? });
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

    /// From a cloud in metres with keypoints and normals of `preprocess`, the latter fitted if a plan needs any: with the
    /// keypoints, and the normals of these, that the plans of one structure need.
    ///
    /// # Errors
    /// As [`StructureCloud::new`], but that the cloud is known to take part.
    pub(crate) fn for_plans(
        cloud: &Cloud,
        keypoints: &Keypoints,
        normals: &Normals,
        preprocess: &Preprocess,
        plans: &[StructurePlan],
    ) -> Result<Self, PrepareError> {
        let mut grids: [Points; GRIDS_UM.len()] = Default::default();
        for (grid, edge_um) in grids.iter_mut().zip(GRIDS_UM) {
            let mut on_grid = plans.iter().filter(|plan| plan.channel.grid_um == edge_um).peekable();
            if on_grid.peek().is_none() {
                continue;
            }
            *grid = if edge_um == preprocess.leaf_um {
                Points::of_keypoints(keypoints.clone(), normals.keypoints.clone())
            } else {
                let needs_normals = on_grid.any(|plan| plan.channel.needs_normals_of_keypoints());
                let radius = needs_normals.then(|| preprocess.normal_radius());
                Points::at_keypoints(cloud, edge_um, radius)?
            };
        }
        let Cloud { points: positions, colours, viewpoint } = cloud.clone();
        let points = Points { positions, colours, normals: normals.cloud.clone() };
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

    /// Keypoints of a plan's grid: kept ones, or found now, with their normals if the plan needs any.
    ///
    /// # Errors
    /// [`PrepareError::CellRange`] of a grid that is not kept.
    pub(super) fn keypoints(&self, plan: &StructurePlan) -> Result<Cow<'_, Points>, PrepareError> {
        let edge_um = plan.channel.grid_um;
        if let Some(kept) = GRIDS_UM.iter().position(|&kept| kept == edge_um) {
            return Ok(Cow::Borrowed(&self.grids[kept]));
        }
        let Points { positions, colours, .. } = &self.points;
        let cloud = Cloud { points: positions.clone(), colours: colours.clone(), viewpoint: self.viewpoint };
        let needs_normals = plan.channel.needs_normals_of_keypoints();
        let radius = needs_normals.then(|| f64::from(self.normal_radius_um) / 1e6);
        Points::at_keypoints(&cloud, edge_um, radius).map(Cow::Owned)
    }
}

/// Edge of a voxel, metres, as [`Preprocess::leaf`] has it.
fn edge(edge_um: u32) -> f32 {
    Preprocess { leaf_um: edge_um, ..Preprocess::default() }.leaf()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::prepare::usable;
    use crate::structure::{Axis, Feature, Structure, StructureChannel};
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
            let [found, bare] = [Feature::Angle, Feature::Distance].map(|feature| {
                let channel = StructureChannel {
                    axes: vec![Axis { feature, bins: 5, full_turn: false }],
                    grid_um: edge_um,
                    ..Structure::default().channels[0].channel.clone()
                };
                ready.keypoints(&StructurePlan::new(&channel)).unwrap()
            });
            let expected = Points::of_keypoints(expected, normals.keypoints);
            assert_eq!(*found, expected, "{edge_um}");
            let is_kept = GRIDS_UM.contains(&edge_um);
            assert_eq!(matches!(found, Cow::Borrowed(_)), is_kept);
            // Found anew, it has normals only if they are needed.
            let none = vec![None; expected.normals.len()];
            let normals = if is_kept { expected.normals.clone() } else { none };
            assert_eq!(*bare, Points { normals, ..expected }, "{edge_um}");
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
