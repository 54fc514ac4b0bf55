//! A run's descriptor taken away: the artefact made, added to, and measured. The crate `artefact` reads it and answers.
//!
//! `of_run` makes the folder from a run, `learn` adds clouds to it, `write` writes it, `assess` measures its answers,
//! `readme` is its text for people, `reject` finds when an answer is not believed; `weigh` makes no artefact, but the file of
//! a structure with weights for its values.

mod assess;
mod error;
mod held;
mod learn;
mod of_run;
mod readme;
mod reject;
mod weigh;
mod write;

#[cfg(test)]
mod tests;

use artefact::{Recogniser, RecognitionSettings, RejectSettings, SETTINGS, Settings};
use descriptor::structure::Structure;
use descriptor::{Descriptor, Family, Signature};
use proto::Message;
use rayon::iter::Either;
use rayon::prelude::*;

use crate::dataset::{NamedCloud, cloud_bytes};
use crate::evaluate::Seconds;

pub use assess::{Assessment, Rejected, assess};
pub use error::ExportError;
pub use learn::{Sized, learn};
pub use of_run::export;
pub use reject::{FoldsBy, Reject};
pub use weigh::weigh;

/// Which descriptor is taken away.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum DescriptorChoice {
    /// The run's winner, with weights for its values where it was weighed.
    Evolved,
    /// The run's winner as the search has found it.
    Searched,
    /// This point of the run's front, from 1.
    Point(u32),
    /// The paper's best chromosome, on the run's clouds.
    Paper,
    /// This structure, on the run's clouds.
    Structure(Structure),
}

/// The signatures of a cloud, or in a line why it has none.
fn describe(recogniser: &Recogniser, cloud: &NamedCloud) -> Result<Vec<Signature>, String> {
    let bytes = cloud_bytes(&cloud.file)?;
    let described = recogniser.describe(&bytes, &mut Seconds::default());
    Ok(described.map_err(|error| Message::of(&error).what)?.signatures)
}

/// What there is where no cloud can be used.
fn none_usable(skipped: &[(String, String)]) -> String {
    match skipped.first() {
        Some((cloud, reason)) => format!("{} that cannot be used, such as {cloud}: {reason}", skipped.len()),
        None => "none".to_owned(),
    }
}

/// Clouds with their signatures, and those that have none, with the reason.
type DescribedClouds<'a> = (Vec<(&'a NamedCloud, Vec<Signature>)>, Vec<(String, String)>);

/// The signatures of clouds, in their order.
fn describe_all<'a>(recogniser: &Recogniser, clouds: &'a [NamedCloud]) -> DescribedClouds<'a> {
    let one = |cloud: &'a NamedCloud| match describe(recogniser, cloud) {
        Ok(signatures) => Either::Left((cloud, signatures)),
        Err(reason) => Either::Right((cloud.path.clone(), reason)),
    };
    clouds.par_iter().partition_map(one)
}

/// Whether this is the text of an artefact's settings that mean something.
pub(crate) fn reads_settings(text: &str) -> bool {
    let folder = std::path::Path::new("artefact");
    Settings::parse(text, folder.join(SETTINGS)).is_ok_and(|settings| {
        settings.resolve(folder).is_ok()
            && settings.recognition(folder).is_ok()
            && settings.reject(folder).is_ok()
    })
}

/// Texts of sound settings: one of each family that artefacts hold, the second with a recogniser that learns.
pub(crate) fn sample_settings() -> [String; 2] {
    [Family::DiskRing, Family::Structure].map(|family| {
        let mut sample = Settings::sample(&Default::default(), &Descriptor::default_of(family));
        if family == Family::Structure {
            let learns = RecognitionSettings::KernelRidge { width: 3.0, ridge: 0.001 };
            sample.recognition = Some(learns);
            sample.reject = Some(RejectSettings::default());
        }
        sample.seal().unwrap_or_default()
    })
}
