//! A cloud made ready for any descriptor of a gene table: keypoints, normals, and quantised neighbours (DESIGN 6).

use std::ops::Range;

use crate::keypoints::Keypoints;
use crate::neighbours::RadiusSearch;
use crate::normals::{MIN_NEIGHBOURS, Normal, normals};
use crate::quantise::Quantiser;
use crate::records::Records;
use crate::{Cloud, Preprocess};

/// Why a cloud takes no part in an evaluation, neither as query nor in the database (DESIGN 5.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, thiserror::Error)]
pub enum Skip {
    /// Not enough points.
    #[error("fewer than {least} usable points, got {points}")]
    TooFewPoints { least: u32, points: usize },
    /// No keypoint has enough neighbours for a normal.
    #[error("no keypoint with a normal, got {keypoints} keypoints")]
    NoKeypointWithNormal { keypoints: usize },
}

/// Why a cloud could not be prepared.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PrepareError {
    /// The cloud is sound but of no use.
    #[error(transparent)]
    Skip(#[from] Skip),
    /// Colour is wanted and the cloud has none.
    #[error(
        "cloud: no colours where colour is wanted\nuse clouds with an rgb field, or do without colour (descriptor.colour = false, --no-colour)"
    )]
    NoColours,
    /// There is not one colour for each point.
    #[error(
        "cloud: number of colours differs from the {points} points, got {colours}\ngive every point a colour"
    )]
    ColourCount { points: usize, colours: usize },
    /// A voxel's index does not fit 32 bits.
    #[error(
        "cloud: coordinate beyond 2147483648 voxels of {leaf} m, got {coordinate} m\ncheck the unit of the clouds or choose a larger leaf"
    )]
    CellRange { coordinate: f32, leaf: f32 },
    /// Points cannot be counted in 32 bits.
    #[error("cloud: more than 4294967295 points, got {points}\nsplit the cloud")]
    TooManyPoints { points: usize },
}

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

/// Whether [`PreparedCloud::new`] would skip or refuse this cloud, decided without most of its work.
///
/// # Errors
/// Exactly those of [`PreparedCloud::new`].
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

/// The keypoints of one cloud that have a normal, each with its neighbours that have one, quantised.
///
/// A neighbour's record is the class of its angle to the keypoint's normal and the class of its colour, kept apart, as
/// shape needs only the one and colour only the other. Records lie keypoint after keypoint, in each from the innermost
/// shell outwards; their order in a shell means nothing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PreparedCloud {
    pub(crate) angles: Records,
    /// Empty if the quantiser has no colour.
    pub(crate) colours: Records,
    /// Where each keypoint's records begin, and where the last one's end.
    pub(crate) starts: Vec<usize>,
    /// For every radius of the quantiser and every keypoint: how many of its records lie within.
    pub(crate) within: Vec<u32>,
    pub(crate) digest: [u8; 32],
}

impl PreparedCloud {
    /// All stages at once, from a cloud as stored.
    ///
    /// # Errors
    /// [`PrepareError::Skip`] if the cloud takes no part; otherwise it cannot be used as it is.
    pub fn new(cloud: &Cloud, preprocess: &Preprocess, quantiser: &Quantiser) -> Result<Self, PrepareError> {
        let cloud = preprocess.in_metres(cloud);
        let keypoints = keypoints(&cloud, preprocess)?;
        let normals = Normals::new(&cloud, &keypoints, preprocess)?;
        Self::describe(&cloud, &keypoints, &normals, quantiser)
    }

    /// Number of keypoints with a normal, at least 1.
    pub fn keypoints(&self) -> usize {
        self.starts.len() - 1
    }

    /// Number of records over all keypoints.
    pub fn records(&self) -> usize {
        self.angles.len()
    }

    /// Memory that the cloud takes, bytes.
    pub fn bytes(&self) -> usize {
        size_of::<Self>()
            + self.angles.bytes()
            + self.colours.bytes()
            + size_of_val(self.starts.as_slice())
            + size_of_val(self.within.as_slice())
    }

    /// Digest of the quantiser that the records were made with.
    pub(crate) fn digest(&self) -> &[u8; 32] {
        &self.digest
    }

    /// Where the records in each keypoint's disk and in its ring lie, given the positions of R1 and R2 among the radii.
    pub(crate) fn regions(&self, radii: [usize; 2]) -> Vec<[Range<usize>; 2]> {
        let keypoints = self.keypoints();
        let [disks, rings] = radii.map(|radius| &self.within[radius * keypoints..][..keypoints]);
        let counts = self.starts.iter().zip(disks).zip(rings);
        let regions = counts.map(|((&start, &disk), &ring)| {
            let [disk, ring] = [disk, ring].map(|within| start + within as usize);
            [start..disk, disk..ring]
        });
        regions.collect()
    }
}
