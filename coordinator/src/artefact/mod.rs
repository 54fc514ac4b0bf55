//! A run's descriptor taken away: a folder that recognises objects without the run, its data, or a network.
//!
//! `export` makes the folder from a run, `learn` adds clouds to it, `write` writes it, `recogniser` answers from it,
//! `assess` measures its answers, `settings` is its `descriptor.toml`, `test_vector` its example for other implementations,
//! `readme` its text for people, `scales` what a structure needs beside its database, `recognition` how it names objects
//! where that is not by the nearest cloud, `reference` the reference clouds as recognisers take them, `reject` when an answer
//! is not believed.

mod assess;
mod error;
mod export;
mod learn;
mod readme;
mod recogniser;
mod recognition;
mod reference;
mod reject;
mod scales;
mod settings;
mod test_vector;
mod write;

#[cfg(test)]
mod tests;

use descriptor::structure::Structure;
use descriptor::{Descriptor, Family};

pub use assess::{Assessment, Rejected, assess};
pub use error::{ArtefactError, CloudError, ExportError};
pub use export::export;
pub use learn::{Sized, learn};
pub use recogniser::{Answer, Named, Recogniser};
pub use reject::{FALSE_REJECTIONS, FoldsBy, MOST_FALSE_REJECTIONS, Reject};

/// Which descriptor is taken away.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum DescriptorChoice {
    /// The run's winner.
    Evolved,
    /// This point of the run's front, from 1.
    Point(u32),
    /// The paper's best chromosome, on the run's clouds.
    Paper,
    /// This structure, on the run's clouds.
    Structure(Structure),
}

/// Whether this is the text of an artefact's settings that mean something.
pub(crate) fn reads_settings(text: &str) -> bool {
    let folder = std::path::Path::new("artefact");
    settings::Settings::parse(text, folder.join(SETTINGS)).is_ok_and(|settings| {
        settings.resolve(folder).is_ok()
            && settings.recognition(folder).is_ok()
            && settings.reject(folder).is_ok()
    })
}

/// Texts of sound settings: one of each family that artefacts hold, the second with a recogniser that learns.
pub(crate) fn sample_settings() -> [String; 2] {
    [Family::DiskRing, Family::Structure].map(|family| {
        let mut sample = settings::Settings::sample(&Default::default(), &Descriptor::default_of(family));
        if family == Family::Structure {
            let learns = recognition::RecognitionSettings::KernelRidge { width: 3.0, ridge: 0.001 };
            sample.recognition = Some(learns);
            sample.reject = Some(reject::RejectSettings::default());
        }
        sample.seal().unwrap_or_default()
    })
}

/// The descriptor's settings; digests of the other files.
pub(crate) const SETTINGS: &str = "descriptor.toml";
/// Summaries of the reference clouds.
const DATABASE: &str = "database.parquet";
/// One cloud with its summary and its answer.
const TEST_VECTOR: &str = "test-vector.json";
/// That cloud.
const EXAMPLE: &str = "example.pcd";
/// How to use it.
const README: &str = "README.md";

/// All files of an artefact, beside its signature.
pub(crate) const FILES: [&str; 5] = [SETTINGS, DATABASE, TEST_VECTOR, EXAMPLE, README];
