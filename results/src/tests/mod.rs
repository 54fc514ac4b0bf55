//! Tests of whole run folders.

mod comparison;
mod database;
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
