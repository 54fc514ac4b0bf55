//! What a process costs while it runs, as Linux counts it: processor time and memory.

use std::fs;
use std::time::{Duration, Instant};

use crate::programs;
use crate::sampler::Sampler;

/// How often a process is looked at.
const GLANCE: Duration = Duration::from_millis(50);
/// Length of one of the ticks in which Linux counts processor time for programs, seconds.
const TICK: f64 = 0.01;

/// What a process has cost at one moment.
#[derive(Clone, Copy, Debug)]
struct Reading {
    at: Instant,
    /// Processor time of the process, seconds.
    cpu: f64,
    /// Of it that of the thread that writes the journal.
    journal: f64,
    /// Largest resident memory so far, bytes.
    peak: u64,
}

/// Looks at a process.
pub struct Meter(Sampler<Reading>);

impl Meter {
    /// Begins to look.
    pub fn start(process: u32) -> Self {
        Self(Sampler::start(GLANCE, move || read(process)))
    }

    /// What the process cost between two moments in the past.
    pub fn cost(self, from: Instant, to: Instant) -> Cost {
        let readings = self.0.stop();
        let peak = readings.iter().map(|reading| reading.peak).max().unwrap_or_default();
        let within: Vec<Reading> =
            readings.into_iter().filter(|reading| (from..=to).contains(&reading.at)).collect();
        let [first, .., last] = within[..] else { panic!("no readings in {:?}", to - from) };
        let seconds = (last.at - first.at).as_secs_f64();
        Cost {
            cores: (last.cpu - first.cpu) / seconds,
            journal_cores: (last.journal - first.journal) / seconds,
            peak,
        }
    }
}

/// What a process cost in some time.
#[derive(Clone, Copy, Debug)]
pub struct Cost {
    /// Cores that it kept busy.
    pub cores: f64,
    /// Of them by the thread that writes the journal.
    pub journal_cores: f64,
    /// Largest resident memory from its beginning to its end, bytes.
    pub peak: u64,
}

fn read(process: u32) -> Option<Reading> {
    let at = Instant::now();
    let cpu = cpu(&format!("/proc/{process}/stat"), None)?;
    let threads = fs::read_dir(format!("/proc/{process}/task")).ok()?;
    let stats = threads.flatten().map(|thread| thread.path().join("stat").display().to_string());
    let journal = stats.filter_map(|path| self::cpu(&path, Some("journal"))).sum();
    Some(Reading { at, cpu, journal, peak: programs::peak(process)? })
}

/// Processor time of a process or a thread, seconds; `None` if it is gone, or has another name.
fn cpu(path: &str, name: Option<&str>) -> Option<f64> {
    let stat = fs::read_to_string(path).ok()?;
    let (front, fields) = stat.rsplit_once(") ")?;
    let (_, own_name) = front.split_once('(')?;
    if name.is_some_and(|name| name != own_name) {
        return None;
    }
    // The fields after the name begin with the third, and 14 and 15 are user and system time.
    let ticks =
        fields.split(' ').skip(11).take(2).map(|field| field.parse::<f64>().ok()).sum::<Option<f64>>()?;
    Some(ticks * TICK)
}
