//! Tests of whole run folders.

mod fixture;
mod folder;
mod format;
mod schema;
mod tamper;
