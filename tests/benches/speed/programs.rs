//! The programs of this workspace as users start them: what they print and when, how long they take, what memory.

use std::ffi::OsStr;
use std::fs;
use std::io::{BufRead as _, BufReader, Read as _};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use serde_json::Value;
pub use tests::process::program;

/// How often a program's memory and end are looked at: short against all that is measured this way.
const GLANCE: Duration = Duration::from_millis(5);

/// Lines of a program's log with the seconds from its start to each.
type Log = Arc<Mutex<Vec<(f64, String)>>>;

/// A program that was run to its end.
#[derive(Debug)]
pub struct Finished {
    /// Wall time.
    pub seconds: f64,
    /// Largest resident memory, bytes.
    pub peak: u64,
    /// Its standard output.
    pub stdout: String,
    /// Lines of its log.
    pub log: Vec<String>,
}

impl Finished {
    /// The JSON object on standard output.
    pub fn json(&self) -> Value {
        serde_json::from_str(&self.stdout).unwrap_or_else(|error| panic!("{error}: {}", self.stdout))
    }
}

/// A program that is running; killed when dropped.
#[derive(Debug)]
pub struct Running {
    command: String,
    child: Child,
    started: Instant,
    log: Log,
    stdout: Option<JoinHandle<String>>,
    stderr: Option<JoinHandle<()>>,
    peak: u64,
}

impl Running {
    /// Starts it.
    pub fn start(mut command: Command) -> Self {
        command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
        let started = Instant::now();
        let mut child = command.spawn().unwrap_or_else(|error| panic!("{command:?}: {error}"));
        let (mut stdout, stderr) = (child.stdout.take().unwrap(), child.stderr.take().unwrap());
        let log = Log::default();
        let written = Arc::clone(&log);
        let stdout = thread::spawn(move || {
            let mut text = String::new();
            stdout.read_to_string(&mut text).unwrap();
            text
        });
        let stderr = thread::spawn(move || {
            for line in BufReader::new(stderr).lines() {
                written.lock().unwrap().push((started.elapsed().as_secs_f64(), line.unwrap()));
            }
        });
        let command = format!("{command:?}");
        Self { command, child, started, log, stdout: Some(stdout), stderr: Some(stderr), peak: 0 }
    }

    /// Waits for a line of its log that contains `text`: seconds from the start, and the line.
    pub fn wait_for(&mut self, text: &str) -> (f64, String) {
        loop {
            let ended = self.has_ended();
            if let Some(line) = self.log.lock().unwrap().iter().find(|(_, line)| line.contains(text)) {
                return line.clone();
            }
            assert!(!ended, "{}: ended before `{text}`\n{}", self.command, self.text());
            thread::sleep(GLANCE);
        }
    }

    /// Waits for its end, which must be a success.
    pub fn finish(mut self) -> Finished {
        while !self.has_ended() {
            thread::sleep(GLANCE);
        }
        let seconds = self.started.elapsed().as_secs_f64();
        let status = self.child.wait().unwrap();
        self.stderr.take().unwrap().join().unwrap();
        assert!(status.success(), "{}: {status}\n{}", self.command, self.text());
        let stdout = self.stdout.take().unwrap().join().unwrap();
        let log = std::mem::take(&mut *self.log.lock().unwrap());
        Finished { seconds, peak: self.peak, stdout, log: log.into_iter().map(|(_, line)| line).collect() }
    }

    /// Its number.
    pub fn process(&self) -> u32 {
        self.child.id()
    }

    /// Largest resident memory so far, bytes.
    pub fn peak(&mut self) -> u64 {
        self.has_ended();
        self.peak
    }

    fn has_ended(&mut self) -> bool {
        if let Some(peak) = peak(self.child.id()) {
            self.peak = peak;
        }
        self.child.try_wait().unwrap().is_some()
    }

    fn text(&self) -> String {
        let log = self.log.lock().unwrap();
        log.iter().map(|(seconds, line)| format!("{seconds:8.3} {line}\n")).collect()
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // Already gone is as good as killed.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Runs a program of this workspace to its end.
pub fn run<A: AsRef<OsStr>>(name: &str, args: impl IntoIterator<Item = A>) -> Finished {
    let mut command = program(name);
    command.args(args);
    Running::start(command).finish()
}

/// Largest resident memory of a process so far, bytes; `None` once it has ended, and where there is no /proc.
pub fn peak(process: u32) -> Option<u64> {
    status(process, "VmHWM:")
}

/// Resident memory of a process now, bytes; `None` as for [`peak`].
pub fn resident(process: u32) -> Option<u64> {
    status(process, "VmRSS:")
}

fn status(process: u32, field: &str) -> Option<u64> {
    let status = fs::read_to_string(format!("/proc/{process}/status")).ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix(field))?;
    let kibibytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kibibytes << 10)
}
