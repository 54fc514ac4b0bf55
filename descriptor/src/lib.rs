//! Evolvable 3D point-cloud descriptors: from a coloured cloud to the name of the object.
//!
//! The crate is pure: no clock, no global random numbers, no network, no files.
//!
//! Which of two objects is in the third cloud?
//!
//! ```
//! use descriptor::{Database, GeneTable, Label, Parameters, Parts, PreparedCloud, Preprocess, Quantiser, Summary, pcd};
//!
//! # use descriptor::synth::{self, SynthSettings};
//! # let settings = SynthSettings::default();
//! # let objects = synth::catalogue(&settings);
//! # let folder = std::env::temp_dir().join(format!("descriptor-example-{}", std::process::id()));
//! # std::fs::create_dir_all(&folder)?;
//! # let file = |object: usize, view| {
//! #     let cloud = synth::render(&settings, &objects[object], view);
//! #     let file = folder.join(format!("{object}-{view}.pcd"));
//! #     std::fs::write(&file, pcd::write(&cloud, pcd::DataEncoding::Binary)).map(|()| file)
//! # };
//! # let [mug, box_, query] = [file(0, 0)?, file(1, 0)?, file(1, 1)?];
//! let parameters = Parameters::PAPER_BEST; // or those that a search has found
//! let quantiser = Quantiser::new(&GeneTable::single(&parameters)?)?;
//! let binning = quantiser.binning(&parameters)?;
//! let prepare = |file| -> Result<PreparedCloud, Box<dyn std::error::Error>> {
//!     Ok(PreparedCloud::new(&pcd::read(&std::fs::read(file)?)?, &Preprocess::default(), &quantiser)?)
//! };
//! let [shape, colour] = Parts::both(&[prepare(mug)?, prepare(box_)?], &binning);
//! let labels = vec![Label { category: 0, instance: 0 }, Label { category: 1, instance: 1 }];
//! let database = Database::new([&shape, &colour], labels, parameters.shape_weight())?;
//! let found = database.recognise(&Summary::new(&prepare(query)?, &binning));
//! println!("cloud {} at a distance of {}", found.nearest.index, found.nearest.distance);
//! # assert_eq!(found.nearest.index, 1);
//! # std::fs::remove_dir_all(folder)?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod angle;
mod bins;
pub mod bytes;
pub mod cloud;
pub mod colour;
mod cubes;
pub mod database;
mod describe;
pub mod description;
pub mod distance;
pub mod eigen;
pub mod encoding;
pub mod fixed;
pub mod genes;
pub mod grid;
pub mod histogram;
pub mod keypoints;
mod kind;
pub mod neighbours;
pub mod normals;
pub mod pcd;
pub mod prepare;
pub mod preprocess;
pub mod quantise;
pub mod random;
pub mod recognise;
mod records;
mod steps;
pub mod summary;
mod surface;
pub mod synth;
mod wide;

#[cfg(test)]
mod geometry_tests;
#[cfg(test)]
mod golden_tests;
#[cfg(test)]
mod oracle;
#[cfg(test)]
mod pipeline_tests;
#[cfg(test)]
mod testing;

pub use cloud::Cloud;
pub use database::Database;
pub use distance::{DistanceMatrix, SetDistance};
pub use fixed::{FixedDescriptor, FixedKind};
pub use genes::{Encoding, GENES, GeneKind, GeneSpec, GeneTable, Parameters};
pub use kind::Descriptor;
pub use prepare::{PrepareError, PreparedCloud, Skip};
pub use preprocess::{Preprocess, Unit};
pub use quantise::{Binning, QuantiseError, Quantiser};
pub use recognise::{Correct, Label, Match, recognise};
pub use summary::{Parts, Summary, summarise};

/// Version of everything that is computed from a cloud. It is raised whenever any output changes by a bit: workers
/// of another version are refused, and results of another version are not reused.
pub const EVALUATION_VERSION: u32 = 2;
