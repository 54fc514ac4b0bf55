//! What the scheduler knows of one worker.

use std::collections::BTreeSet;
use std::time::{Duration, Instant};

use proto::{Introduction, JobId, Principal};

use super::health::Health;

pub(super) struct Worker {
    pub(super) principal: Principal,
    pub(super) threads: u32,
    pub(super) build: String,
    pub(super) joined: Instant,
    pub(super) health: Health,
    /// An operator has said that it gets no more jobs.
    pub(super) draining: bool,
    /// It has asked for no job for longer than any may take, although it has none: nobody waits for it.
    passive: bool,
    pub(super) last_seen: Instant,
    /// When it last asked for a job or had one.
    last_wanted: Instant,
    pub(super) sequence: u64,
    /// Jobs and attempts in the order in which it took them, which is the order in which it works on them.
    leases: Vec<(JobId, u32)>,
    /// Since when the first lease has been the first: a job taken ahead is not worked on yet.
    first_since: Instant,
}

impl Worker {
    pub(super) fn new(introduction: &Introduction, now: Instant) -> Self {
        Self {
            principal: introduction.principal,
            threads: introduction.threads,
            build: introduction.build.clone(),
            joined: now,
            health: Health::default(),
            draining: false,
            passive: false,
            last_seen: now,
            last_wanted: now,
            sequence: 0,
            leases: Vec::new(),
            first_since: now,
        }
    }

    pub(super) fn leases(&self) -> &[(JobId, u32)] {
        &self.leases
    }

    pub(super) fn is_idle(&self) -> bool {
        self.leases.is_empty()
    }

    /// Whether it may be given jobs.
    pub(super) fn is_available(&self) -> bool {
        !self.health.is_excluded() && !self.is_left_out()
    }

    /// Whether it is not waited for: an operator has said so, or it asks for nothing.
    pub(super) fn is_left_out(&self) -> bool {
        self.draining || self.passive
    }

    /// Notes how many jobs it asks for; `true` if it may be given jobs again.
    pub(super) fn wants(&mut self, jobs: usize, now: Instant) -> bool {
        if jobs > 0 || !self.is_idle() {
            self.last_wanted = now;
        }
        jobs > 0 && std::mem::take(&mut self.passive) && self.is_available()
    }

    /// Whether it is given up that it may be given jobs: it has neither had nor asked for one for so long.
    pub(super) fn becomes_passive(&mut self, patience: Duration, now: Instant) -> bool {
        let is_silent = self.is_idle() && now.saturating_duration_since(self.last_wanted) > patience;
        let was_available = self.is_available();
        self.passive |= is_silent;
        was_available && is_silent
    }

    /// Whether it has no job, and is not kept from having one by an operator.
    pub(super) fn is_free(&self) -> bool {
        self.is_idle() && !self.draining
    }

    /// The job it works on, and since when.
    pub(super) fn in_hand(&self) -> Option<(JobId, Instant)> {
        self.leases.first().map(|(job, _)| (*job, self.first_since))
    }

    /// Since when it works on this job; `None` while that waits behind another.
    pub(super) fn works_on(&self, job: JobId) -> Option<Instant> {
        self.in_hand().and_then(|(first, since)| (first == job).then_some(since))
    }

    pub(super) fn take(&mut self, job: JobId, attempt: u32, now: Instant) {
        if self.leases.is_empty() {
            self.first_since = now;
        }
        self.leases.push((job, attempt));
    }

    pub(super) fn put_down(&mut self, job: JobId, now: Instant) {
        if self.leases.first().is_some_and(|(first, _)| *first == job) {
            self.first_since = now;
        }
        self.leases.retain(|(other, _)| *other != job);
    }

    /// Leaves a pause of the coordinator out of all times.
    pub(super) fn forgive(&mut self, pause: Duration, now: Instant) {
        self.last_seen = (self.last_seen + pause).min(now);
        self.last_wanted = (self.last_wanted + pause).min(now);
        self.first_since = (self.first_since + pause).min(now);
    }
}

/// What is kept of a worker that may be gone.
pub(super) struct WorkerIdentity {
    pub(super) label: String,
    /// Valid results of jobs that were open.
    pub(super) answers: u64,
    /// What computing them took on its clock.
    pub(super) busy_seconds: f64,
}

impl WorkerIdentity {
    /// A new worker; the label is taken from those that are left.
    pub(super) fn new(name: &str, used_labels: &mut BTreeSet<String>) -> Self {
        let label = unique_label(name, used_labels);
        used_labels.insert(label.clone());
        Self { label, answers: 0, busy_seconds: 0.0 }
    }
}

/// `name`, or `name-2`, `name-3`, … if that is taken. Thousands of one name cost no more than a few looks each.
fn unique_label(name: &str, taken: &BTreeSet<String>) -> String {
    let name = if name.is_empty() { "worker" } else { name };
    let label = |number: u64| if number < 2 { name.to_owned() } else { format!("{name}-{number}") };
    let is_taken = |number: u64| taken.contains(&label(number));
    if !is_taken(1) {
        return label(1);
    }
    let (mut last_taken, mut free) = (1, 2);
    while is_taken(free) {
        (last_taken, free) = (free, 2 * free);
    }
    while free - last_taken > 1 {
        let between = last_taken + (free - last_taken) / 2;
        if is_taken(between) { last_taken = between } else { free = between }
    }
    label(free)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_are_unique_and_count_up() {
        let mut taken = BTreeSet::new();
        for number in 1..=300u32 {
            let expected = if number == 1 { "rack".to_owned() } else { format!("rack-{number}") };
            let label = unique_label("rack", &taken);
            assert_eq!(label, expected);
            assert!(taken.insert(label));
        }
        taken.remove("rack");
        assert_eq!(unique_label("rack", &taken), "rack");
        assert_eq!(unique_label("", &taken), "worker");
    }
}
