//! Evolvable 3D point-cloud descriptors: from a coloured cloud to the name of the object.
//!
//! The crate is pure: no clock, no global random numbers, no network, no files.

pub mod angle;
pub mod cloud;
pub mod colour;
mod cubes;
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
