//! Tests of whole run folders.

mod database;
mod fixture;
mod folder;
mod format;
mod grid;
mod schema;
mod tamper;
