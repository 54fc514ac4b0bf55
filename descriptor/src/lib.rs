//! Evolvable 3D point-cloud descriptors: from a coloured cloud to the name of the object.
//!
//! The crate is pure: no clock, no global random numbers, no network, no files.

pub mod cloud;
pub mod genes;
pub mod random;

pub use cloud::Cloud;
pub use genes::{Encoding, GENES, GeneKind, GeneSpec, GeneTable, Parameters};
