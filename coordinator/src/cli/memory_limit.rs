//! A bound on the memory of a command that does not know beforehand what it will take.

use std::process;
use std::thread;
use std::time::Duration;

use cache::{ByteSize, held_memory};

use crate::console::say;

/// How often is looked: in this time a query takes some megabytes more.
const EVERY: Duration = Duration::from_millis(5);

/// Ends the program with an error as soon as it holds more than `most`; `advice` says what to do then. Where the system
/// does not tell what a program holds, nothing is bounded.
pub(super) fn bound(most: ByteSize, advice: &'static str) {
    let watch = move || {
        while let Some(held) = held_memory() {
            if held > most {
                say(format_args!(
                    "error: --memory: at most {} expected, got {}\n{advice}",
                    most.display().iec(),
                    held.display().iec()
                ));
                process::exit(1);
            }
            thread::sleep(EVERY);
        }
    };
    if let Err(error) = thread::Builder::new().name("memory".to_owned()).spawn(watch) {
        tracing::warn!("memory is not bounded: no thread, got {error}");
    }
}
