//! Sections `[preprocess]` and `[descriptor]`, which experiments and artefacts have in common: as written, what they
//! mean, and what is wrong with them.

mod error;
mod forms;
mod genes;
mod one;
mod preprocess;
mod raw;
mod suggest;
mod toml_fault;

pub use error::{ConfigError, Fault};
pub use forms::{RawGene, RawInterval};
pub use genes::{max_cost, search_space};
pub use one::{of_one, one};
pub use preprocess::{micrometres, preprocess};
pub use raw::{RawDescriptor, RawFamily, RawGenes, RawMetric, RawPreprocess};
pub use suggest::{advice, nearest_name};
pub use toml_fault::{EXCERPT, TABLE_ADVICE, excerpt, key_fault, syntax_fault};
