//! Tests of whole run folders.

mod fixture;
mod folder;
mod format;
mod grid;
mod schema;
mod tamper;
