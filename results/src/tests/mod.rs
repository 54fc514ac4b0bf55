//! Tests of whole run folders.

mod comparison;
mod database;
mod fixture;
mod folder;
mod format;
mod grid;
mod schema;
mod tamper;
