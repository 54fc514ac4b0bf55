//! A cloud made ready for every descriptor of a gene table: its keypoints' neighbours as quantised records (DESIGN 6).

use std::ops::Range;

use crate::disk_ring::quantise::Quantiser;
use crate::disk_ring::records::Records;
use crate::prepare::{Normals, keypoints};
use crate::prepare_error::PrepareError;
use crate::{Cloud, Preprocess};

/// The keypoints of one cloud that have a normal, each with its neighbours that have one, quantised.
///
/// A neighbour's record is the class of its angle to the keypoint's normal and the class of its colour, kept apart, as
/// shape needs only the one and colour only the other. Records lie keypoint after keypoint, in each from the innermost
/// shell outwards; their order in a shell means nothing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct QuantisedCloud {
    pub(crate) angles: Records,
    /// Empty if the quantiser has no colour.
    pub(crate) colours: Records,
    /// Where each keypoint's records begin, and where the last one's end.
    pub(crate) starts: Vec<usize>,
    /// For every radius of the quantiser and every keypoint: how many of its records lie within.
    pub(crate) within: Vec<u32>,
    pub(crate) digest: [u8; 32],
}

impl QuantisedCloud {
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
