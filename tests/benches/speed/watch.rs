//! A coordinator's memory and journal while it runs.

use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

use crate::programs;
use crate::sampler::Sampler;

/// How often it is looked at.
const GLANCE: Duration = Duration::from_millis(100);

/// What was seen at one moment.
#[derive(Clone, Copy, Debug)]
pub struct Glance {
    /// When.
    pub at: Instant,
    /// Resident memory, bytes.
    pub memory: u64,
    /// Size of the journal, bytes.
    pub journal: u64,
}

/// Looks at a process that writes into a run's folder.
pub fn watch(process: u32, run: &Path) -> Sampler<Glance> {
    let journal = run.join("journal.log");
    Sampler::start(GLANCE, move || {
        let memory = programs::resident(process)?;
        let journal = fs::metadata(&journal).ok()?.len();
        Some(Glance { at: Instant::now(), memory, journal })
    })
}
