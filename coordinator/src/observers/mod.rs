//! Who follows what happens in a run: each observer has a cursor of its own in the event log.

pub mod event_file;
pub mod tables;
