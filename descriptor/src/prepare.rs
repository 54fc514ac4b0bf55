//! The stages that descriptors have in common: keypoints and normals, and whether a cloud takes part.

use crate::keypoints::Keypoints;
use crate::neighbours::RadiusSearch;
use crate::normals::{MIN_NEIGHBOURS, Normal, normals};
use crate::prepare_error::{PrepareError, Skip};
use crate::{Cloud, Preprocess};

/// The stage `keypoints`: checks the cloud (in metres) and places its keypoints.
///
/// # Errors
/// [`Skip::TooFewPoints`], missing colours, or coordinates out of range.
pub fn keypoints(cloud: &Cloud, preprocess: &Preprocess) -> Result<Keypoints, PrepareError> {
    match &cloud.colours {
        None if preprocess.colour => return Err(PrepareError::NoColours),
        Some(colours) if colours.len() != cloud.len() => {
            return Err(PrepareError::ColourCount { points: cloud.len(), colours: colours.len() });
        }
        _ => {}
    }
    if cloud.len() < preprocess.min_points as usize {
        return Err(Skip::TooFewPoints { least: preprocess.min_points, points: cloud.len() }.into());
    }
    Keypoints::new(cloud, preprocess.leaf())
}

/// Normals of a cloud and of its keypoints.
#[derive(Clone, Debug, PartialEq)]
pub struct Normals {
    /// One for each point of the cloud.
    pub cloud: Vec<Normal>,
    /// One for each keypoint; at least one is there.
    pub keypoints: Vec<Normal>,
}

impl Normals {
    /// The stage `normals`: fits normals to a cloud in metres and to its keypoints.
    ///
    /// # Errors
    /// [`Skip::NoKeypointWithNormal`], or too many points.
    pub fn new(cloud: &Cloud, keypoints: &Keypoints, preprocess: &Preprocess) -> Result<Self, PrepareError> {
        let [cloud, of_keypoints] =
            normals(&cloud.points, &keypoints.points, preprocess.normal_radius(), cloud.viewpoint)?;
        if of_keypoints.iter().all(Option::is_none) {
            return Err(Skip::NoKeypointWithNormal { keypoints: keypoints.len() }.into());
        }
        Ok(Self { cloud, keypoints: of_keypoints })
    }
}

/// Whether a cloud as stored takes part: the same for all descriptors, and decided without fitting normals.
///
/// # Errors
/// Exactly those of [`keypoints`] and [`Normals::new`].
pub fn usable(cloud: &Cloud, preprocess: &Preprocess) -> Result<(), PrepareError> {
    let cloud = preprocess.in_metres(cloud);
    let keypoints = keypoints(&cloud, preprocess)?;
    let search = RadiusSearch::new(&cloud.points)?;
    let has_normal = |&keypoint: &[f32; 3]| {
        search.count_within(keypoint, preprocess.normal_radius(), MIN_NEIGHBOURS) == MIN_NEIGHBOURS
    };
    if keypoints.points.iter().any(has_normal) {
        Ok(())
    } else {
        Err(Skip::NoKeypointWithNormal { keypoints: keypoints.len() }.into())
    }
}
