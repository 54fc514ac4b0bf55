//! Lines for people on standard error, above the live display if there is one.

use std::io::{self, IsTerminal as _};

use indicatif::ProgressBar;
pub use worker::log::say;

/// Where lines for people go. Copies share the live display.
#[derive(Clone, Debug, Default)]
pub struct Console {
    bar: Option<ProgressBar>,
}

impl Console {
    /// With this live display.
    pub fn with(bar: ProgressBar) -> Self {
        Self { bar: Some(bar) }
    }

    /// The live display; `None` where the program does not write to a terminal, and once it has ended.
    pub fn bar(&self) -> Option<&ProgressBar> {
        self.bar.as_ref()
    }

    /// A line that stays.
    pub fn say(&self, line: &str) {
        match &self.bar {
            Some(bar) => bar.suspend(|| say(line)),
            None => say(line),
        }
    }
}

/// Whether a live display can be shown: somebody looks, and the lines are for people.
pub fn has_viewer() -> bool {
    io::stderr().is_terminal() && !worker::log::is_json()
}
