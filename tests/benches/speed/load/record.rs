//! What workers saw, and what follows from it for the time in which all of them were at work.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use tonic::Status;

/// Time after the last worker's first job that is left out: the first jobs are all handed out in one go.
const SETTLING: Duration = Duration::from_secs(1);
/// Share of the jobs after whose start the rest is left out: at the end of a generation workers have to wait.
const MOST: f64 = 0.9;

/// One job in hand.
#[derive(Clone, Copy, Debug)]
pub struct Span {
    /// When it was taken up.
    pub start: Instant,
    /// When it was done.
    pub end: Instant,
    /// How long the evaluation is meant to take: what a busy process or a timer adds is no work.
    pub took: Duration,
}

/// A poll and its reply.
#[derive(Clone, Copy, Debug)]
pub struct Answered {
    /// When it was sent.
    pub sent: Instant,
    /// Until when the reply was there.
    pub took: Duration,
}

/// Counts bytes.
#[derive(Debug, Default)]
pub struct Traffic([AtomicU64; 2]);

impl Traffic {
    /// To the coordinator.
    pub fn sent(&self, bytes: usize) {
        self.0[0].fetch_add(bytes as u64, Ordering::Relaxed);
    }

    /// From the coordinator.
    pub fn received(&self, bytes: usize) {
        self.0[1].fetch_add(bytes as u64, Ordering::Relaxed);
    }

    /// Both.
    pub fn bytes(&self) -> [u64; 2] {
        self.0.each_ref().map(|bytes| bytes.load(Ordering::Relaxed))
    }
}

/// What one worker saw.
#[derive(Debug, Default)]
pub struct Record {
    /// Its jobs, in order.
    pub spans: Vec<Span>,
    /// Its polls that brought jobs, in order.
    pub dispatches: Vec<Answered>,
    /// Its polls that handed in a result, in order.
    pub reports: Vec<Answered>,
    /// Bytes of its messages, to the coordinator and from it.
    pub traffic: [u64; 2],
    /// When and how the coordinator went.
    pub end: Option<(Instant, Status)>,
}

/// What many workers saw from one moment to another.
#[derive(Debug)]
pub struct Findings {
    /// When all were at work.
    pub from: Instant,
    /// When jobs began to run out.
    pub to: Instant,
    /// Jobs finished a second.
    pub rate: f64,
    /// Share of the workers' time that evaluations took.
    pub busy: f64,
    /// From sending a poll, with a report in it, until its job was there, seconds, in order of size.
    pub dispatches: Vec<f64>,
    /// From the end of one job to the start of the worker's next, seconds, in order of size.
    pub gaps: Vec<f64>,
}

impl Findings {
    /// What these workers saw while all of them were at work.
    pub fn of(records: &[Record]) -> Self {
        let firsts = records.iter().map(|record| record.spans.first().expect("a job for each worker").start);
        let from = firsts.max().expect("workers") + SETTLING;
        let mut starts: Vec<Instant> = spans(records).map(|span| span.start).collect();
        starts.sort();
        let to = starts[(starts.len() as f64 * MOST) as usize];
        assert!(to > from, "the jobs were done before all workers were at work");
        for record in records {
            let (end, status) = record.end.as_ref().expect("each has seen the end");
            assert!(*end > to, "a worker was shown out in the middle: {status}");
        }
        let within = |at: Instant| (from..to).contains(&at);
        let done: Vec<Span> = spans(records).filter(|span| within(span.end)).copied().collect();
        let seconds = (to - from).as_secs_f64();
        let worked: f64 = done.iter().map(|span| span.took.as_secs_f64()).sum();
        let dispatches = records.iter().flat_map(|record| &record.dispatches);
        let dispatches = dispatches.filter(|dispatch| within(dispatch.sent));
        let gaps = records.iter().flat_map(|record| record.spans.windows(2));
        let gaps = gaps.filter(|pair| within(pair[0].end)).map(|pair| pair[1].start - pair[0].end);
        Self {
            from,
            to,
            rate: done.len() as f64 / seconds,
            busy: worked / (seconds * records.len() as f64),
            dispatches: in_order(dispatches.map(|dispatch| dispatch.took)),
            gaps: in_order(gaps),
        }
    }
}

fn spans(records: &[Record]) -> impl Iterator<Item = &Span> {
    records.iter().flat_map(|record| &record.spans)
}

fn in_order(times: impl Iterator<Item = Duration>) -> Vec<f64> {
    let mut seconds: Vec<f64> = times.map(|time| time.as_secs_f64()).collect();
    seconds.sort_by(f64::total_cmp);
    seconds
}

/// The value below which this share of values in order lies.
pub fn percentile(in_order: &[f64], share: f64) -> f64 {
    in_order.get((in_order.len() as f64 * share) as usize).copied().unwrap_or(f64::NAN)
}
