//! Reference clouds: those that the test clouds of a data set are recognised by, described by this process.

use std::path::PathBuf;

use artefact::{Database, DatabaseCloud, DatabasePart, DatabaseParts};
use descriptor::cloud_file;
use descriptor::structure::Structure;
use descriptor::{Describer, Descriptor, Preprocess, Signature};
use rayon::prelude::*;

use crate::dataset::{CloudEntry, Dataset, cloud_bytes};
use crate::evaluate::{Seconds, stages};
use crate::run::matching::Matching;

/// A run goes on where it was.
const AGAIN: &str = "put the file back and give the same command again";

/// Why reference clouds cannot be described.
#[derive(Debug, thiserror::Error)]
pub enum ReferenceError {
    /// A cloud that was usable when the data set was opened.
    #[error("{path}: {what}")]
    Cloud {
        /// Its file.
        path: PathBuf,
        /// What is wrong with it.
        what: String,
    },
    /// The descriptor describes none.
    #[error("{0}")]
    Descriptor(String),
}

/// The signatures of the first clouds of the final test's database, in its order, by the current rayon pool.
///
/// # Errors
/// [`ReferenceError`]
pub fn describe(
    dataset: &Dataset,
    count: usize,
    preprocess: &Preprocess,
    descriptor: &Descriptor,
) -> Result<Database, ReferenceError> {
    let describer =
        Describer::new(descriptor).map_err(|error| ReferenceError::Descriptor(error.to_string()))?;
    let entries: Vec<&CloudEntry> = Matching::Test.database(dataset).take(count).collect();
    let signatures: Vec<Vec<Signature>> = entries
        .par_iter()
        .map(|&entry| {
            let failed = |what: String| ReferenceError::Cloud { path: dataset.clouds.file(entry), what };
            let cloud =
                cloud_file::read(&read(dataset, entry)?).map_err(|error| failed(error.to_string()))?;
            let cloud = preprocess.in_metres(&cloud);
            let described = stages(&cloud, preprocess, &describer, &mut Seconds::default());
            Ok(described.map_err(|error| failed(error.to_string()))?.signatures)
        })
        .collect::<Result<_, ReferenceError>>()?;
    let part = |channel: usize| part_of(&signatures, channel);
    let parts = match descriptor {
        Descriptor::Structure(Structure { channels }) => {
            DatabaseParts::Channels((0..channels.len()).map(part).collect())
        }
        _ => DatabaseParts::ShapeColour([part(0), part(1)]),
    };
    let clouds = entries.iter().map(|&entry| labelled(dataset, entry)).collect();
    Ok(Database { clouds, parts })
}

/// The signatures of clouds in one channel, as a database has them.
pub fn part_of(signatures: &[Vec<Signature>], channel: usize) -> DatabasePart {
    DatabasePart {
        centroids: signatures.iter().flat_map(|cloud| &cloud[channel].centroid).copied().collect(),
        deviations: signatures.iter().flat_map(|cloud| &cloud[channel].deviation).copied().collect(),
    }
}

/// A cloud's path and names.
pub fn labelled(dataset: &Dataset, entry: &CloudEntry) -> DatabaseCloud {
    let sequence = entry.sequence.map(|index| dataset.clouds.sequences[index as usize].clone());
    DatabaseCloud {
        sequence,
        addition: None,
        cloud: entry.path.clone(),
        instance: dataset.clouds.instances[entry.instance as usize].name.clone(),
        category: dataset.clouds.categories[entry.category as usize].clone(),
    }
}

/// The bytes of a cloud, which are those that the data digest covers.
///
/// # Errors
/// [`ReferenceError::Cloud`]
pub fn read(dataset: &Dataset, entry: &CloudEntry) -> Result<Vec<u8>, ReferenceError> {
    let path: PathBuf = dataset.clouds.file(entry);
    let bytes = match cloud_bytes(&path) {
        Ok(bytes) => bytes,
        Err(reason) => {
            let what = format!("cannot be read, got {reason}\n{AGAIN}");
            return Err(ReferenceError::Cloud { path, what });
        }
    };
    if *blake3::hash(&bytes).as_bytes() != entry.digest {
        let what = format!("content must stay the same meanwhile, got another\n{AGAIN}");
        return Err(ReferenceError::Cloud { path, what });
    }
    Ok(bytes)
}

/// Of each cloud of the final test's database, in its order.
pub fn sequences(dataset: &Dataset) -> Vec<Option<u32>> {
    Matching::Test.database(dataset).map(|cloud| cloud.sequence).collect()
}
