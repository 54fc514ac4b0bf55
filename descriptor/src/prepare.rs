//! A cloud made ready for any descriptor of a gene table: keypoints, normals, and quantised neighbours (DESIGN 6).

use crate::keypoints::Keypoints;
use crate::neighbours::{Candidates, RadiusSearch, squared_distance};
use crate::normals::{MIN_NEIGHBOURS, Normal, normals};
use crate::quantise::Quantiser;
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

/// Normals of a cloud and of its keypoints, with the index they were found by.
pub struct Normals<'a> {
    /// One for each point of the cloud.
    pub cloud: Vec<Normal>,
    /// One for each keypoint; at least one is there.
    pub keypoints: Vec<Normal>,
    search: RadiusSearch<'a>,
}

impl<'a> Normals<'a> {
    /// The stage `normals`: fits normals to a cloud in metres and to its keypoints.
    ///
    /// # Errors
    /// [`Skip::NoKeypointWithNormal`].
    pub fn new(
        cloud: &'a Cloud,
        keypoints: &Keypoints,
        preprocess: &Preprocess,
    ) -> Result<Self, PrepareError> {
        let search = RadiusSearch::new(&cloud.points)?;
        let radius = preprocess.normal_radius();
        let of_keypoints = normals(&search, &keypoints.points, radius, cloud.viewpoint);
        if of_keypoints.iter().all(Option::is_none) {
            return Err(Skip::NoKeypointWithNormal { keypoints: keypoints.len() }.into());
        }
        let of_cloud = normals(&search, &cloud.points, radius, cloud.viewpoint);
        Ok(Self { cloud: of_cloud, keypoints: of_keypoints, search })
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

/// One neighbour of a keypoint: the classes of its angle to the keypoint's normal and of its colour.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct Record {
    pub(crate) angle: u16,
    pub(crate) colour: u16,
}

/// The keypoints of one cloud that have a normal, each with its neighbours that have one, quantised.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PreparedCloud {
    /// Keypoint after keypoint, in each from the innermost shell outwards, in a shell by index of the neighbour.
    records: Vec<Record>,
    /// Where each keypoint's records begin, and where the last one's end.
    starts: Vec<usize>,
    /// For every keypoint and every radius of the quantiser: how many of its records lie within.
    within: Vec<u32>,
    radii: usize,
    digest: [u8; 32],
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

    /// The stage `describe`: finds and quantises the neighbours of each keypoint, for a cloud in metres.
    ///
    /// # Errors
    /// [`PrepareError::NoColours`] if the quantiser has colour and the cloud has not.
    pub fn describe(
        cloud: &Cloud,
        keypoints: &Keypoints,
        normals: &Normals<'_>,
        quantiser: &Quantiser,
    ) -> Result<Self, PrepareError> {
        let colours: Vec<u16> = match (&cloud.colours, quantiser.has_colour()) {
            (Some(colours), true) => colours.iter().map(|&colour| quantiser.colour_class(colour)).collect(),
            (None, true) => return Err(PrepareError::NoColours),
            (_, false) => vec![0; cloud.len()],
        };
        let radii = quantiser.radii();
        let mut prepared = Self {
            records: Vec::new(),
            starts: vec![0],
            within: Vec::new(),
            radii,
            digest: quantiser.digest(),
        };
        let mut candidates = Candidates::default();
        let mut found: Vec<(usize, Record)> = Vec::new();
        let mut places = vec![0usize; radii];
        for (&keypoint, normal) in keypoints.points.iter().zip(&normals.keypoints) {
            let Some(axis) = *normal else { continue };
            normals.search.candidates(keypoint, quantiser.reach(), &mut candidates);
            found.clear();
            for &index in &candidates.indices {
                let index = index as usize;
                let d2 = squared_distance(cloud.points[index], keypoint);
                let Some(normal) = normals.cloud[index] else { continue };
                if d2 <= quantiser.reach2() {
                    let cosine = axis[0] * normal[0] + axis[1] * normal[1] + axis[2] * normal[2];
                    let record = Record { angle: quantiser.angle_class(cosine), colour: colours[index] };
                    found.push((quantiser.shell(d2), record));
                }
            }

            // Counting sort by shell; stable, so ascending by index within one.
            places.fill(0);
            for &(shell, _) in &found {
                places[shell] += 1;
            }
            let start = prepared.records.len();
            let mut total = 0;
            for place in &mut places {
                let count = *place;
                *place = start + total;
                total += count;
                prepared.within.push(total as u32);
            }
            prepared.records.resize(start + total, Record::default());
            for &(shell, record) in &found {
                prepared.records[places[shell]] = record;
                places[shell] += 1;
            }
            prepared.starts.push(prepared.records.len());
        }
        prepared.records.shrink_to_fit();
        Ok(prepared)
    }

    /// Number of keypoints with a normal, at least 1.
    pub fn keypoints(&self) -> usize {
        self.starts.len() - 1
    }

    /// Number of records over all keypoints.
    pub fn records(&self) -> usize {
        self.records.len()
    }

    /// Memory that the cloud takes, bytes.
    pub fn bytes(&self) -> usize {
        size_of::<Self>()
            + size_of_val(self.records.as_slice())
            + size_of_val(self.starts.as_slice())
            + size_of_val(self.within.as_slice())
    }

    /// Digest of the quantiser that the records were made with.
    pub(crate) fn digest(&self) -> &[u8; 32] {
        &self.digest
    }

    /// A keypoint's records in the disk and in the ring, given the positions of R1 and R2 among the radii.
    pub(crate) fn regions(&self, keypoint: usize, disk: usize, ring: usize) -> [&[Record]; 2] {
        let records = &self.records[self.starts[keypoint]..self.starts[keypoint + 1]];
        let within = &self.within[keypoint * self.radii..(keypoint + 1) * self.radii];
        let (disk, ring) = (within[disk] as usize, within[ring] as usize);
        [&records[..disk], &records[disk..ring]]
    }
}
