//! The log of both programs on standard error: text for people, or one JSON object a line for programs.

use std::fmt::Display;
use std::io::{self, IsTerminal as _, Write as _};
use std::sync::OnceLock;

use clap::ValueEnum;
use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::time::{FormatTime as _, SystemTime};
use tracing_subscriber::layer::SubscriberExt as _;
use tracing_subscriber::util::SubscriberInitExt as _;
use tracing_subscriber::{EnvFilter, Layer, Registry};

use crate::names::Names;

/// What spans are handed to, beside the log.
pub type SpanLayer = Box<dyn Layer<Registry> + Send + Sync>;

/// How the log is written.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum LogFormat {
    /// Lines for people
    #[default]
    Text,
    /// One JSON object a line: timestamp, level, message, and the spans it is in
    Json,
}

static FORMAT: OnceLock<LogFormat> = OnceLock::new();

/// Starts the log, once in a process. `filter` says what is logged unless the environment does (`DESCRY_LOG`); `spans` is
/// called when a line can be written.
pub fn start(format: LogFormat, filter: &str, spans: impl FnOnce() -> Option<SpanLayer>) {
    let _ = FORMAT.set(format); // a second start changes nothing
    let filter = EnvFilter::try_from_env("DESCRY_LOG").unwrap_or_else(|_| filter.into());
    let lines = tracing_subscriber::fmt::layer()
        .with_writer(|| Renamed(io::stderr()))
        .with_ansi(io::stderr().is_terminal())
        .with_target(false)
        .log_internal_errors(false); // they would go to standard error, too, and panic where that is lost
    let lines = match format {
        LogFormat::Text => lines.boxed(),
        LogFormat::Json => lines.json().flatten_event(true).boxed(),
    };
    tracing_subscriber::registry().with(spans()).with(lines.with_filter(filter)).init();
}

/// Passes lines on with the names under which people have the programs.
struct Renamed(io::Stderr);

impl io::Write for Renamed {
    fn write(&mut self, line: &[u8]) -> io::Result<usize> {
        match std::str::from_utf8(line) {
            Ok(text) => self.0.write_all(Names::of_this_process().in_text(text).as_bytes())?,
            Err(_) => self.0.write_all(line)?,
        }
        Ok(line.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        self.0.flush()
    }
}

/// Whether each line is a JSON object.
pub fn is_json() -> bool {
    FORMAT.get() == Some(&LogFormat::Json)
}

/// A line for people, whatever the filter says: it begins with `error: ` or `warning: ` if it is one. Where standard error
/// is closed, or its volume full, the line is lost and the program goes on.
pub fn say(line: impl Display) {
    let line = line.to_string();
    let line = Names::of_this_process().in_text(&line).into_owned();
    let line = if is_json() { json(&line) } else { line };
    // In one piece, so that lines of several programs in one file stay whole.
    let _ = io::stderr().write_all(format!("{line}\n").as_bytes());
}

/// A line as the log writes events in JSON.
fn json(line: &str) -> String {
    let mut timestamp = String::new();
    // Writing to a string cannot fail.
    let _ = SystemTime.format_time(&mut Writer::new(&mut timestamp));
    let line = line.trim();
    let (level, message) = match (line.strip_prefix("error: "), line.strip_prefix("warning: ")) {
        (Some(message), _) => ("ERROR", message),
        (None, Some(message)) => ("WARN", message),
        (None, None) => ("INFO", line),
    };
    serde_json::json!({"timestamp": timestamp, "level": level, "message": message}).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_one_object_and_keeps_its_advice() {
        for (line, level, message) in [
            (
                "error: port: in use, got 1\nstop the \"other\"",
                "ERROR",
                "port: in use, got 1\nstop the \"other\"",
            ),
            ("\nerror: interrupted\ngo on", "ERROR", "interrupted\ngo on"),
            ("warning: --insecure", "WARN", "--insecure"),
            ("generation 1/2", "INFO", "generation 1/2"),
        ] {
            let text = json(line);
            assert_eq!(text.lines().count(), 1, "{text}");
            let value: serde_json::Value = serde_json::from_str(&text).unwrap();
            assert_eq!((&value["level"], &value["message"]), (&level.into(), &message.into()));
            assert!(value["timestamp"].as_str().unwrap().ends_with('Z'), "{text}");
        }
    }
}
