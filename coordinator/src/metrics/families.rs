//! What there is to tell of a coordinator: every metric with its labels and the words of its help.

use std::fmt::Write as _;
use std::time::SystemTime;

use cache::TierReads;
use cluster::counters::{DEPARTURES, Histogram, OUTCOMES};
use cluster::scheduler::{JobState, WorkerState};
use proto::task::TaskKind;
use transport::{Direction, SigningOutcome};

use super::source::{RunState, Snapshot};

/// Names and values of a sample's labels.
pub type Labels = Vec<(&'static str, String)>;

/// The samples of a metric.
pub enum Samples {
    /// What only grows while the process lasts.
    Counters(Vec<(Labels, u64)>),
    /// What is so now.
    Gauges(Vec<(Labels, f64)>),
    /// How long something took, each time.
    Histograms(Vec<(Labels, Histogram)>),
    /// What says all by its labels.
    Info(Labels),
}

/// A metric.
pub struct Family {
    /// Without the suffix of counters and infos.
    name: &'static str,
    /// What it says, for people.
    pub help: &'static str,
    labels: &'static [&'static str],
    /// Its samples.
    pub samples: fn(&Snapshot, SystemTime) -> Samples,
}

impl Family {
    /// Its name, without the suffix that formats add to counters and infos.
    pub fn name(&self) -> &'static str {
        self.name
    }
}

/// Every metric.
pub const FAMILIES: [Family; 27] = [
    Family {
        name: "descry_jobs",
        help: "Open jobs, by kind of task and by what they wait for: a worker (queued), the worker that has them \
               (leased), an operator (paused), or a worker of another principal (blocked)",
        labels: &["kind", "state"],
        samples: |now, _| {
            let jobs = &now.scheduler.jobs;
            let count = |kind, state| jobs.get(&(kind, state)).map_or(0.0, |count| *count as f64);
            let of_kind = |kind: TaskKind| {
                JobState::ALL.map(|state| {
                    let labels = vec![("kind", word(kind.as_str())), ("state", text(state.as_str()))];
                    (labels, count(kind, state))
                })
            };
            Samples::Gauges(TaskKind::ALL.into_iter().flat_map(of_kind).collect())
        },
    },
    Family {
        name: "descry_wanted_workers",
        help: "Workers that the open jobs could keep busy now, each with one job: results that jobs need and that \
               somebody may compute; 1 while the run waits for its first worker. 0 when there is nothing to do; neither \
               paused nor blocked jobs count",
        labels: &[],
        samples: |now, _| gauge(now.scheduler.wanted_workers as f64),
    },
    Family {
        name: "descry_wanted_threads",
        help: "Worker threads that the open jobs could keep busy now: wanted workers times the mean threads of the \
               workers that are here, rounded up; one thread each while none is here",
        labels: &[],
        samples: |now, _| gauge(now.scheduler.wanted_threads as f64),
    },
    Family {
        name: "descry_queue_wait_seconds",
        help: "Time from the submission of a job to its first lease",
        labels: &[],
        samples: |now, _| Samples::Histograms(vec![(vec![], now.scheduler.counters.queue_times)]),
    },
    Family {
        name: "descry_leases",
        help: "Leases that were granted, or kept by workers while the coordinator was started again, by kind of task",
        labels: &["kind"],
        samples: |now, _| {
            let leases = &now.scheduler.counters.leases;
            Samples::Counters(by_kind(|kind| leases.get(&kind).copied().unwrap_or(0)))
        },
    },
    Family {
        name: "descry_attempts",
        help: "Attempts at jobs that ended, by kind of task and by how, in the words of the table attempts",
        labels: &["kind", "outcome"],
        samples: |now, _| {
            let attempts = &now.scheduler.counters.attempts;
            let of_kind = |kind: TaskKind| {
                OUTCOMES.map(|outcome| {
                    let labels = vec![("kind", word(kind.as_str())), ("outcome", text(outcome))];
                    (labels, attempts.get(&(kind, outcome)).copied().unwrap_or(0))
                })
            };
            Samples::Counters(TaskKind::ALL.into_iter().flat_map(of_kind).collect())
        },
    },
    Family {
        name: "descry_attempt_duration_seconds",
        help: "Time that attempts took on the worker's clock, of those that were reported, by kind of task",
        labels: &["kind"],
        samples: |now, _| {
            let times = &now.scheduler.counters.run_times;
            Samples::Histograms(by_kind(|kind| times.get(&kind).copied().unwrap_or_default()))
        },
    },
    Family {
        name: "descry_audits_required",
        help: "Jobs that a second principal has to answer as well",
        labels: &[],
        samples: |now, _| counter(now.scheduler.counters.audits),
    },
    Family {
        name: "descry_audits_agreed",
        help: "Audited jobs of which two principals gave the same result",
        labels: &[],
        samples: |now, _| counter(now.scheduler.counters.agreements),
    },
    Family {
        name: "descry_disagreements",
        help: "Jobs, audited or not, of which workers gave different results",
        labels: &[],
        samples: |now, _| counter(now.scheduler.counters.disagreements),
    },
    Family {
        name: "descry_workers",
        help: "Workers that are connected, by what they do; one that fails too often is excluded for a while, one that \
               an operator drains gets no more jobs",
        labels: &["state"],
        samples: |now, _| by_worker_state(now, |(workers, _)| workers),
    },
    Family {
        name: "descry_worker_threads",
        help: "Threads of the workers that are connected, by what the worker does",
        labels: &["state"],
        samples: |now, _| by_worker_state(now, |(_, threads)| threads),
    },
    Family {
        name: "descry_workers_joined",
        help: "Workers that joined, those that came back among them",
        labels: &[],
        samples: |now, _| counter(now.scheduler.counters.joined),
    },
    Family {
        name: "descry_workers_departed",
        help: "Workers that went, by why",
        labels: &["reason"],
        samples: |now, _| {
            let departed = &now.scheduler.counters.departed;
            let of = |reason: &'static str| {
                (vec![("reason", text(reason))], departed.get(reason).copied().unwrap_or(0))
            };
            Samples::Counters(DEPARTURES.map(|departure| of(departure.as_str())).into())
        },
    },
    Family {
        name: "descry_worker_exclusions",
        help: "How often a worker got no jobs for a while because it had failed too often",
        labels: &[],
        samples: |now, _| counter(now.scheduler.counters.exclusions),
    },
    Family {
        name: "descry_quarantined_principals",
        help: "Principals that gave a wrong result and whose workers are not let in any more",
        labels: &[],
        samples: |now, _| gauge(now.scheduler.quarantined as f64),
    },
    Family {
        name: "descry_refusals",
        help: "Connections and registrations that were refused, by why",
        labels: &["reason"],
        samples: |now, _| {
            let all = now.refusals.iter().chain(&now.scheduler.counters.refused);
            let sample = |(reason, count): (&&'static str, &u64)| (vec![("reason", word(reason))], *count);
            Samples::Counters(all.map(sample).collect())
        },
    },
    Family {
        name: "descry_generation",
        help: "Generations that are complete, by run; 0 before the first",
        labels: &["run"],
        samples: |now, _| {
            let run = |(name, state): (&String, &RunState)| {
                (vec![("run", name.clone())], f64::from(state.generation))
            };
            Samples::Gauges(now.runs.iter().map(run).collect())
        },
    },
    Family {
        name: "descry_best_fitness_ratio",
        help: "Best training fitness so far, from 0 to 1, by run; none before the first generation is complete",
        labels: &["run"],
        samples: |now, _| {
            let run = |(name, state): (&String, &RunState)| {
                Some((vec![("run", name.clone())], state.best_fitness?))
            };
            Samples::Gauges(now.runs.iter().filter_map(run).collect())
        },
    },
    Family {
        name: "descry_journal_commit_duration_seconds",
        help: "Time that the journal took to have a group of entries on the disk",
        labels: &[],
        samples: |now, _| Samples::Histograms(vec![(vec![], now.journal.commits)]),
    },
    Family {
        name: "descry_journal_entries",
        help: "Entries of the journal that are on the disk",
        labels: &[],
        samples: |now, _| counter(now.journal.entries),
    },
    Family {
        name: "descry_journal_failed",
        help: "1 if the journal cannot be written any more, which ends the run",
        labels: &[],
        samples: |now, _| gauge(f64::from(u8::from(now.journal.failed))),
    },
    Family {
        name: "descry_cache_reads",
        help: "Reads of the cache by this process and its own workers, by tier (disk, shared) and by how they ended: the \
               entry was there (hit) or not (miss), was damaged, or the tier could not be read (error)",
        labels: &["tier", "outcome"],
        samples: |now, _| {
            let (disk, shared) = now.reads;
            let tiers = [("disk", disk), ("shared", shared)];
            let of_tier =
                |(tier, reads): (&'static str, Option<TierReads>)| {
                    let TierReads { hits, misses, faults, damaged } = reads?;
                    let ended = [
                        ("hit", hits.saturating_sub(damaged)),
                        ("miss", misses),
                        ("damaged", damaged),
                        ("error", faults),
                    ];
                    Some(ended.map(|(outcome, count)| {
                        (vec![("tier", text(tier)), ("outcome", text(outcome))], count)
                    }))
                };
            Samples::Counters(tiers.into_iter().filter_map(of_tier).flatten().collect())
        },
    },
    Family {
        name: "descry_bucket_urls",
        help: "URLs to the bucket that workers asked for, by kind of object (prepared_cloud; blob: clouds and descriptions \
               of shards), by direction (read, write) and by what became of it: signed, withheld (not released, not there, \
               not to be trusted, stored by another, or read only), or failed, for want of a key or of an answer of the \
               bucket. None without a bucket",
        labels: &["kind", "direction", "outcome"],
        samples: |now, _| {
            let sample = |(&(kind, direction, outcome), &count): (&(_, Direction, SigningOutcome), &u64)| {
                let labels = vec![
                    ("kind", text(kind)),
                    ("direction", text(direction.as_str())),
                    ("outcome", text(outcome.as_str())),
                ];
                (labels, count)
            };
            Samples::Counters(now.urls.iter().map(sample).collect())
        },
    },
    Family {
        name: "descry_ready",
        help: "1 as long as workers are let in and given jobs",
        labels: &[],
        samples: |now, _| gauge(f64::from(u8::from(now.ready))),
    },
    Family {
        name: "process_start_time_seconds",
        help: "When the process was started, in seconds since 1970",
        labels: &[],
        samples: |_, started| {
            let since = started.duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
            gauge(since.as_secs_f64())
        },
    },
    Family {
        name: "descry_build",
        help: "The release that is at work, and the version of what it computes",
        labels: &["version", "evaluation_version"],
        samples: |_, _| {
            let evaluation_version = descriptor::EVALUATION_VERSION.to_string();
            Samples::Info(vec![("version", text(worker::BUILD)), ("evaluation_version", evaluation_version)])
        },
    },
];

fn text(text: &str) -> String {
    text.to_owned()
}

/// A few words as the value of a label.
fn word(text: &str) -> String {
    text.to_lowercase().replace(' ', "_")
}

fn counter(count: u64) -> Samples {
    Samples::Counters(vec![(vec![], count)])
}

fn gauge(value: f64) -> Samples {
    Samples::Gauges(vec![(vec![], value)])
}

fn by_kind<T>(value: impl Fn(TaskKind) -> T) -> Vec<(Labels, T)> {
    TaskKind::ALL.map(|kind| (vec![("kind", word(kind.as_str()))], value(kind))).into()
}

fn by_worker_state(now: &Snapshot, number: fn((u64, u64)) -> u64) -> Samples {
    let of = |state: WorkerState| {
        let numbers = now.scheduler.workers.get(&state).copied().unwrap_or_default();
        (vec![("state", text(state.as_str()))], number(numbers) as f64)
    };
    Samples::Gauges(WorkerState::ALL.map(of).into())
}

/// The page of the book that lists all metrics, in Markdown.
pub fn reference() -> String {
    let mut table = "# Metrics\n\nWhat `--metrics` of `coordinator run` and `resume` serves, as its help texts say it; see \
                     [Monitor runs with Prometheus](../how-to/monitoring.md). Counters and histograms begin at 0 when the \
                     coordinator is started. A histogram has `_bucket`, `_sum` and `_count`.\n\n| metric | type | labels | what it says |\n|---|---|---|---|\n".to_owned();
    for family in &FAMILIES {
        let (kind, suffix) = match (family.samples)(&Snapshot::default(), SystemTime::UNIX_EPOCH) {
            Samples::Counters(_) => ("counter", "_total"),
            Samples::Gauges(_) => ("gauge", ""),
            Samples::Histograms(_) => ("histogram", ""),
            Samples::Info(_) => ("info", "_info"),
        };
        let labels: Vec<String> = family.labels.iter().map(|label| format!("`{label}`")).collect();
        let Family { name, help, .. } = family;
        // Writing to a string cannot fail.
        let _ = writeln!(table, "| `{name}{suffix}` | {kind} | {} | {help} |", labels.join(", "));
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_have_the_labels_that_the_table_says() {
        let tier = Some(TierReads::default());
        let mut now = Snapshot { reads: (tier, tier), ..Snapshot::default() };
        now.urls.insert(("blob", Direction::Read, SigningOutcome::Signed), 1);
        now.refusals.insert("no TLS handshake", 1);
        let state = RunState { generation: 1, best_fitness: Some(0.5) };
        now.runs.insert("run".to_owned(), state);
        for family in &FAMILIES {
            let labels: Vec<Labels> = match (family.samples)(&now, SystemTime::UNIX_EPOCH) {
                Samples::Counters(samples) => samples.into_iter().map(|(labels, _)| labels).collect(),
                Samples::Gauges(samples) => samples.into_iter().map(|(labels, _)| labels).collect(),
                Samples::Histograms(samples) => samples.into_iter().map(|(labels, _)| labels).collect(),
                Samples::Info(labels) => vec![labels],
            };
            assert!(!labels.is_empty(), "{}", family.name);
            for labels in labels {
                let names: Vec<&str> = labels.iter().map(|(name, _)| *name).collect();
                assert_eq!(names, family.labels, "{}", family.name);
            }
        }
    }
}
