//! A run's descriptor taken away: a folder that recognises objects without the run, its data, or a network. This crate
//! reads it and answers from it, for programs of any kind: no async, no tables but its own, no thread of its own.
//!
//! [`Recogniser`] answers; [`Contents`] is what the files say: `settings` is `descriptor.toml`, `database_file` reads the
//! summaries of the reference clouds, `recognition` how objects are named where that is not by the nearest cloud, `reject`
//! when an answer is not believed, `scales` what a structure needs beside its database. `test_vector` is its example for
//! other implementations, [`sections`] what its settings have in common with experiments.

pub mod metadata;
pub mod parquet_column;
pub mod sections;
pub mod text;

mod buffers;
mod database;
mod database_file;
mod error;
mod recogniser;
mod recognition;
mod reference;
mod reject;
mod scales;
mod settings;
mod stages;
mod structure_file;
mod test_vector;

pub use buffers::{BufferError, MAX_POINTS, cloud_of};
pub use database::{Database, DatabaseCloud, DatabasePart, DatabaseParts, MAX_CHANNELS};
pub use database_file::{DatabaseError, decode_database, read_database};
pub use error::{ArtefactError, CloudError};
pub use recogniser::{Answer, Contents, Known, Learned, Named, Recogniser};
pub use recognition::{RecognitionSettings, names_objects_by};
pub use reference::{channels, labels, signatures};
pub use reject::{FALSE_REJECTIONS, MOST_FALSE_REJECTIONS, RejectSettings};
pub use scales::found as found_scales;
pub use settings::{DatabaseSettings, Settings, TestVectorSettings};
pub use stages::{Seconds, stages};
pub use structure_file::{StructureFileError, parse as parse_structure, read as read_structure};
pub use test_vector::{Example, Verdict, test_vector};

/// The descriptor's settings; digests of the other files.
pub const SETTINGS: &str = "descriptor.toml";
/// Summaries of the reference clouds.
pub const DATABASE: &str = "database.parquet";
/// One cloud with its summary and its answer.
pub const TEST_VECTOR: &str = "test-vector.json";
/// That cloud.
pub const EXAMPLE: &str = "example.pcd";
/// How to use it.
pub const README: &str = "README.md";

/// All files of an artefact, beside its signature.
pub const FILES: [&str; 5] = [SETTINGS, DATABASE, TEST_VECTOR, EXAMPLE, README];
