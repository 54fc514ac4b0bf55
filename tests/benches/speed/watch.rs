//! A coordinator while it runs: its memory and its journal, on a thread of its own.

use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use crate::programs;

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

/// Looks at a coordinator.
pub struct Watch {
    stop: Arc<AtomicBool>,
    thread: JoinHandle<Vec<Glance>>,
}

impl Watch {
    /// Begins to look at a process that writes into a run's folder.
    pub fn start(process: u32, run: &Path) -> Self {
        let stop = Arc::new(AtomicBool::new(false));
        let (stopped, journal) = (Arc::clone(&stop), run.join("journal.log"));
        let thread = thread::spawn(move || {
            let mut glances = Vec::new();
            while !stopped.load(Ordering::Relaxed) {
                let memory = programs::resident(process);
                let journal = fs::metadata(&journal).map(|file| file.len()).ok();
                let glance = |(memory, journal)| Glance { at: Instant::now(), memory, journal };
                glances.extend(memory.zip(journal).map(glance));
                thread::sleep(GLANCE);
            }
            glances
        });
        Self { stop, thread }
    }

    /// What was seen.
    pub fn stop(self) -> Vec<Glance> {
        self.stop.store(true, Ordering::Relaxed);
        self.thread.join().unwrap()
    }
}
