//! The paper's family of descriptors: shape and colour of a disk and a ring about each keypoint (DESIGN 5.4 to 5.8).

pub mod genes;

pub mod angle;
mod bins;
mod describe;
mod direct;
pub mod encoding;
pub mod grid;
pub mod histogram;
mod near;
pub mod quantise;
pub mod quantised;
mod records;
pub mod signature;
mod step_table;

pub use genes::{GENES, GeneKind, GeneTable, Parameters};
pub use quantise::{Binning, QuantiseError, Quantiser};
pub use quantised::QuantisedCloud;
pub use signature::weighted;
