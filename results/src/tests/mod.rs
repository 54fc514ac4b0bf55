//! Tests of whole run folders.

mod comparison;
mod database;
mod file_digests;
pub(crate) mod fixture;
mod folder;
mod foreign;
mod format;
mod front;
mod grid;
#[cfg(feature = "sql")]
mod query;
mod schema;
mod tamper;
