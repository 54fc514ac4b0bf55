//! A single cloud under a single descriptor, once its keypoints and normals are there: the path of whoever evaluates one
//! descriptor, measures its stages, or recognises clouds as they come.

use crate::descriptor::Descriptor;
use crate::disk_ring::{Binning, QuantiseError, Quantiser};
use crate::fixed::{DescribeError, FixedDescriptor};
use crate::gene::GeneError;
use crate::global_hue::GlobalHue;
use crate::keypoints::Keypoints;
use crate::prepare::Normals;
use crate::prepare_error::PrepareError;
use crate::signature::Signature;
use crate::structure::{Structure, StructureCloud, StructurePlan};
use crate::{Cloud, GeneTable, Preprocess};

/// What matching needs of a cloud.
#[derive(Clone, Debug, PartialEq)]
pub struct Described {
    /// One for each of the descriptor's channels.
    pub signatures: Vec<Signature>,
    /// How many keypoints they are made of.
    pub keypoints: usize,
}

/// Describes clouds under one descriptor. The signatures are those that a [`Channel`](crate::Channel) makes of prepared
/// clouds, bit for bit.
#[derive(Clone, Debug)]
pub struct Describer {
    form: Form,
}

#[derive(Clone, Debug)]
enum Form {
    DiskRing(Box<(Quantiser, Binning)>),
    Fixed(FixedDescriptor),
    GlobalHue(GlobalHue),
    /// Its channels.
    Structure(Vec<StructurePlan>),
}

/// Why there is no describer.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum DescriberError {
    /// No experiment may use the descriptor.
    #[error(transparent)]
    Genes(#[from] GeneError),
    /// Its search space has too many values.
    #[error(transparent)]
    Quantise(#[from] QuantiseError),
}

impl Describer {
    /// For a descriptor.
    ///
    /// # Errors
    /// If no experiment may use the descriptor.
    pub fn new(descriptor: &Descriptor) -> Result<Self, DescriberError> {
        let form = match descriptor {
            Descriptor::DiskRing(parameters) => {
                let quantiser = Quantiser::new(&GeneTable::single(parameters)?)?;
                let binning = quantiser.binning(parameters)?;
                Form::DiskRing(Box::new((quantiser, binning)))
            }
            Descriptor::Fixed(fixed) => Form::Fixed(*fixed),
            Descriptor::GlobalHue(hue) => Form::GlobalHue(*hue),
            Descriptor::Structure(Structure { channels }) => {
                Form::Structure(channels.iter().map(|one| StructurePlan::new(&one.channel)).collect())
            }
        };
        Ok(Self { form })
    }

    /// Whether the descriptor looks at normals.
    pub fn needs_normals(&self) -> bool {
        match &self.form {
            Form::DiskRing(_) | Form::Fixed(_) => true,
            Form::GlobalHue(_) => false,
            Form::Structure(plans) => plans.iter().any(StructurePlan::needs_normals),
        }
    }

    /// The stage `normals` for this descriptor: fits them to a cloud in metres and to its keypoints if it looks at them.
    ///
    /// # Errors
    /// Those of [`Normals::new`] in either case, so that the same clouds take part whatever the descriptor is.
    pub fn normals(
        &self,
        cloud: &Cloud,
        keypoints: &Keypoints,
        preprocess: &Preprocess,
    ) -> Result<Normals, PrepareError> {
        let of_cloud = if self.needs_normals() { Normals::new } else { Normals::none };
        of_cloud(cloud, keypoints, preprocess)
    }

    /// The signatures of a cloud in metres, whose keypoints are those of `preprocess` and whose normals are those of
    /// [`Describer::normals`], or of [`Normals::new`] if several descriptors are to share them. Structures have keypoints
    /// of their own.
    ///
    /// # Errors
    /// If the cloud takes no part, or the descriptor says nothing about it.
    pub fn describe(
        &self,
        cloud: &Cloud,
        keypoints: &Keypoints,
        normals: &Normals,
        preprocess: &Preprocess,
    ) -> Result<Described, DescribeError> {
        match &self.form {
            Form::DiskRing(form) => {
                let (quantiser, binning) = &**form;
                let signatures = binning.signature_of(cloud, keypoints, normals, quantiser)?.into();
                Ok(Described { signatures, keypoints: normals.keypoints.iter().flatten().count() })
            }
            Form::Fixed(fixed) => {
                let histograms = fixed.describe(cloud, keypoints, normals)?;
                Ok(Described { signatures: vec![histograms.signature()], keypoints: histograms.rows().len() })
            }
            Form::GlobalHue(hue) => {
                let colours = cloud.colours.as_ref().ok_or(PrepareError::NoColours)?;
                Ok(Described { signatures: vec![hue.signature(colours)], keypoints: keypoints.points.len() })
            }
            Form::Structure(plans) => {
                let cloud = StructureCloud::for_plans(cloud, keypoints, normals, preprocess, plans)?;
                let signatures = plans.iter().map(|plan| plan.signature(&cloud)).collect::<Result<_, _>>()?;
                Ok(Described { signatures, keypoints: keypoints.points.len() })
            }
        }
    }
}
