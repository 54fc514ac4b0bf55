//! Tests of whole run folders.

mod comparison;
pub(crate) mod fixture;
mod folder;
mod format;
mod grid;
mod schema;
mod tamper;
