//! What is computed of a cloud once for all descriptors of a search space; each family has its own form.

use crate::disk_ring::encoding::DecodeError;
use crate::disk_ring::{GeneTable, QuantiseError, QuantisedCloud, Quantiser};
use crate::family::Family;
use crate::fixed::OrientedCloud;
use crate::global_hue::GlobalHue;
use crate::prepare_error::PrepareError;
use crate::structure::StructureCloud;
use crate::{Cloud, Preprocess};

/// A cloud made ready for all descriptors of a search space.
#[derive(Clone, Debug, PartialEq)]
pub enum PreparedCloud {
    /// Disk-ring: neighbours of each keypoint as classes.
    Quantised(QuantisedCloud),
    /// Descriptors without genes: points and keypoints with their normals.
    Oriented(OrientedCloud),
    /// Global hue: the colour of every point.
    Colours(Vec<[u8; 3]>),
    /// Structures: points, and keypoints of several grids, with their normals.
    Structure(StructureCloud),
}

impl PreparedCloud {
    /// Memory that the cloud takes, bytes.
    pub fn bytes(&self) -> usize {
        match self {
            Self::Quantised(cloud) => cloud.bytes(),
            Self::Oriented(cloud) => cloud.bytes(),
            Self::Colours(colours) => size_of::<Self>() + size_of_val(colours.as_slice()),
            Self::Structure(cloud) => cloud.bytes(),
        }
    }

    /// The cloud of disk-ring.
    pub fn quantised(&self) -> Option<&QuantisedCloud> {
        match self {
            Self::Quantised(cloud) => Some(cloud),
            Self::Oriented(_) | Self::Colours(_) | Self::Structure(_) => None,
        }
    }
}

/// Prepares clouds for the descriptors of one search space.
#[derive(Clone, Debug, PartialEq)]
pub struct Preparer {
    family: Family,
    form: Form,
}

#[derive(Clone, Debug, PartialEq)]
enum Form {
    Quantised(Box<Quantiser>),
    Oriented,
    Colours,
    Structure,
}

impl Preparer {
    /// For all descriptors of a gene table.
    pub(crate) fn quantised(table: &GeneTable) -> Result<Self, QuantiseError> {
        let form = Form::Quantised(Box::new(Quantiser::new(table)?));
        Ok(Self { family: Family::DiskRing, form })
    }

    /// For descriptors that need points and keypoints with their normals.
    pub(crate) fn oriented(family: Family) -> Self {
        Self { family, form: Form::Oriented }
    }

    /// For descriptors that need colours only.
    pub(crate) fn colours(family: Family) -> Self {
        Self { family, form: Form::Colours }
    }

    /// For structures.
    pub(crate) fn structure(family: Family) -> Self {
        Self { family, form: Form::Structure }
    }

    /// The family of the search space.
    pub fn family(&self) -> Family {
        self.family
    }

    /// Whether prepared clouds are worth keeping: preparing one takes far longer than reading its encoded form. Only
    /// such clouds have one.
    pub fn is_kept(&self) -> bool {
        matches!(self.form, Form::Quantised(_) | Form::Structure)
    }

    /// Digest of what the encoded form of a prepared cloud depends on, beside cloud and preprocessing; `None` of clouds
    /// that are not kept.
    pub fn digest(&self) -> Option<[u8; 32]> {
        match &self.form {
            Form::Quantised(quantiser) => Some(quantiser.digest()),
            Form::Structure => Some(*blake3::hash(b"descry prepared cloud of structures v1").as_bytes()),
            Form::Oriented | Form::Colours => None,
        }
    }

    /// The classes of disk-ring's records: what the encoded form of a prepared cloud depends on.
    pub fn quantiser(&self) -> Option<&Quantiser> {
        match &self.form {
            Form::Quantised(quantiser) => Some(quantiser),
            Form::Oriented | Form::Colours | Form::Structure => None,
        }
    }

    pub(crate) fn is_of_structures(&self) -> bool {
        self.form == Form::Structure
    }

    pub(crate) fn is_of_oriented(&self) -> bool {
        self.form == Form::Oriented
    }

    pub(crate) fn is_of_colours(&self) -> bool {
        self.form == Form::Colours
    }

    /// Prepares a cloud as stored.
    ///
    /// # Errors
    /// If the cloud takes no part, or cannot be used as it is.
    pub fn prepare(&self, cloud: &Cloud, preprocess: &Preprocess) -> Result<PreparedCloud, PrepareError> {
        match &self.form {
            Form::Quantised(quantiser) => {
                QuantisedCloud::new(cloud, preprocess, quantiser).map(PreparedCloud::Quantised)
            }
            Form::Oriented => OrientedCloud::new(cloud, preprocess).map(PreparedCloud::Oriented),
            Form::Colours => GlobalHue::colours(cloud, preprocess).map(PreparedCloud::Colours),
            Form::Structure => StructureCloud::new(cloud, preprocess).map(PreparedCloud::Structure),
        }
    }

    /// The encoded form of a prepared cloud; `None` of those that are not kept.
    pub fn encode(&self, cloud: &PreparedCloud) -> Option<Vec<u8>> {
        match cloud {
            PreparedCloud::Quantised(cloud) => Some(cloud.encode()),
            PreparedCloud::Structure(cloud) => Some(cloud.encode()),
            PreparedCloud::Oriented(_) | PreparedCloud::Colours(_) => None,
        }
    }

    /// Undoes [`Preparer::encode`].
    ///
    /// # Errors
    /// If the bytes are not those of a cloud that was prepared for this search space.
    pub fn decode(&self, bytes: &[u8]) -> Result<PreparedCloud, DecodeError> {
        match &self.form {
            Form::Quantised(quantiser) => {
                QuantisedCloud::decode(bytes, quantiser).map(PreparedCloud::Quantised)
            }
            Form::Structure => StructureCloud::decode(bytes).map(PreparedCloud::Structure),
            Form::Oriented | Form::Colours => Err(DecodeError::OtherQuantiser),
        }
    }
}
