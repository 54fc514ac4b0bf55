//! Evolvable 3D point-cloud descriptors: from a coloured cloud to the name of the object.
//!
//! The crate is pure: no clock, no global random numbers, no network, no files.
//!
//! Which of two objects is in the third cloud?
//!
//! ```
//! use descriptor::recognise::recognise_from;
//! use descriptor::{Descriptor, Label, Parameters, PreparedCloud, Preprocess, SearchSpace, cloud_file, pcd};
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
//! let descriptor = Descriptor::DiskRing(Parameters::PAPER_BEST); // or one that a search has found
//! let preparer = SearchSpace::single(&descriptor)?.preparer()?;
//! let prepare = |file| -> Result<PreparedCloud, Box<dyn std::error::Error>> {
//!     Ok(preparer.prepare(&cloud_file::read(&std::fs::read(file)?)?, &Preprocess::default())?)
//! };
//! let (known, asked) = ([prepare(mug)?, prepare(box_)?], [prepare(query)?]);
//! let mut distances = Vec::new();
//! for (channel, weight) in descriptor.channels() {
//!     let extractor = channel.extractor(&preparer)?;
//!     let [queries, database] = [extractor.signatures(&asked)?, extractor.signatures(&known)?];
//!     distances.push((channel.distances(&queries, &database), weight));
//! }
//! let labels = [Label { category: 0, instance: 0 }, Label { category: 1, instance: 1 }];
//! let found = recognise_from(1, &distances, &labels)?[0];
//! println!("cloud {} at a distance of {}", found.nearest.index, found.nearest.distance);
//! # assert_eq!(found.nearest.index, 1);
//! # std::fs::remove_dir_all(folder)?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod cloud;
pub mod cloud_file;
mod header_text;
pub mod pcd;
pub mod ply;
pub mod preprocess;
pub mod spacing;
pub mod synth;

mod cell_list;
pub mod eigen;
pub mod keypoints;
pub mod neighbours;
pub mod normals;
pub mod prepare;
mod prepare_error;
mod select;
mod surface;
pub mod wide;

mod bytes;
pub mod colour;
mod column;
pub mod disk_ring;
mod domain;
mod family;
pub mod fixed;
mod gene;
mod global_hue;
pub mod structure;

mod channel;
pub mod cost;
mod describer;
mod descriptor;
mod layout;
mod preparation;
mod prepared;
mod search_space;

pub mod database;
pub mod distance;
pub mod fitness;
pub mod pruning;
pub mod recognise;
pub mod recogniser;
pub mod rgbd;
mod set_distance;
pub mod signature;
pub mod signature_bytes;
mod transposed;
mod vector_metric;
pub mod weigh;

mod perturb;

pub mod random;

#[cfg(test)]
mod geometry_tests;
#[cfg(test)]
mod golden_tests;
#[cfg(test)]
mod oracle;
#[cfg(test)]
mod pipeline_tests;
#[cfg(test)]
mod seam_tests;
#[cfg(test)]
mod testing;

pub use bytes::BytesError;
pub use channel::{Channel, ChannelError, Extractor};
pub use cloud::Cloud;
pub use column::Column;
pub use database::Database;
pub use describer::{Described, Describer, DescriberError};
pub use descriptor::{COST_DATABASE, Descriptor};
pub use disk_ring::genes::{GENES, GeneKind, GeneTable, Parameters};
pub use disk_ring::{Binning, QuantiseError, QuantisedCloud, Quantiser, grid};
pub use distance::{DistanceMatrix, SetDistance};
pub use domain::Domain;
pub use family::Family;
pub use fixed::{DescribeError, FixedDescriptor, FixedKind};
pub use gene::{FieldSpec, GeneError, GeneSpec};
pub use global_hue::GlobalHue;
pub use layout::{ChannelLayout, Part, Region};
pub use perturb::Perturbation;
pub use preparation::Preparation;
pub use prepare_error::{PrepareError, Skip};
pub use prepared::{PreparedCloud, Preparer};
pub use preprocess::{Preprocess, Unit};
pub use pruning::PrunedDatabase;
pub use recognise::{Correct, Label, Match, recognise};
pub use search_space::SearchSpace;
pub use signature::{Signature, Signatures};
pub use signature_bytes::SignatureError;
pub use vector_metric::VectorMetric;

/// Version of everything that is computed from a cloud. It is raised whenever any output changes by a bit: workers
/// of another version are refused, and results of another version are not reused.
pub const EVALUATION_VERSION: u32 = 2;
