//! Lines for people on standard error, above the live display if there is one.

use std::fmt::Display;
use std::io::{self, Write as _};

use indicatif::ProgressBar;

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

    /// The live display; `None` where standard error is no terminal.
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

/// A line on standard error. Where that is closed, or its volume full, the line is lost and the program goes on.
pub fn say(line: impl Display) {
    // In one piece, so that lines of several programs in one file stay whole.
    let _ = io::stderr().write_all(format!("{line}\n").as_bytes());
}
