//! A stage: what it has to do, and how long it takes.

use tests::benches::table::Samples;

use crate::work::Work;

/// One row of the table.
#[derive(Debug)]
pub struct Stage {
    pub name: &'static str,
    pub work: Work,
    /// Seconds.
    pub times: Samples,
}

impl Stage {
    /// A stage that has not been timed yet.
    pub fn new(name: &'static str, work: Work) -> Self {
        Self { name, work, times: Samples::default() }
    }
}
