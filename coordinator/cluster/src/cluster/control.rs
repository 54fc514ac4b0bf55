//! What an operator orders while a run goes on, and what a dashboard shows of the workers.

use std::time::Instant;

use proto::Principal;

use super::Cluster;
use super::state::ClusterState;
use crate::events::{ControlAction, Controlled, EventKind};
use crate::journal::Journal;
use crate::scheduler::{ClientId, MAX_PRIORITY, SchedulerMetrics, WorkerStatus};

/// Workers that a message names.
const MAX_NAMED: usize = 20;

/// Why an order is not carried out.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ControlRefusal {
    /// Nothing would change.
    #[error("pause: must be a run that goes on, got one that is paused\nresume lets it go on")]
    Paused,
    /// Nothing would change.
    #[error("resume: must be a run that is paused, got one that goes on\npause it first")]
    NotPaused,
    /// A weight that there is none of.
    #[error(
        "priority: must be from 1 to {MAX_PRIORITY}, got {0}\ngive one in between; 1 is that of all at first"
    )]
    Priority(u32),
    /// Nobody of this label is here.
    #[error("worker: must be one that is here, got {label:?}\nhere are: {here}")]
    UnknownWorker {
        /// The label.
        label: String,
        /// Labels of those that are here.
        here: String,
    },
    /// Nothing would change.
    #[error(
        "drain: must be a worker that is given jobs, got {0}, which is drained already\nresume --worker {0} gives it jobs again"
    )]
    Drained(String),
    /// Nothing would change.
    #[error("resume: must be a worker that is drained, got {0}, which is given jobs\ndrain it first")]
    NotDrained(String),
    /// It goes with the coordinator.
    #[error(
        "deny: must be a worker of another process, got {0}, which is the coordinator's own\ndrain it, or start with --local-workers 0"
    )]
    Own(String),
}

impl Cluster {
    /// Carries out what an operator orders for these clients: all, or one that a sweep's member has. Gives a sentence for
    /// whoever ordered it. What ends the run is only noted: its driver ends it.
    ///
    /// # Errors
    /// Why nothing was done.
    pub fn control(&self, order: Controlled, clients: &[ClientId]) -> Result<String, ControlRefusal> {
        self.state().control(order, clients, Instant::now())
    }

    /// Whether jobs of a client are not handed out because an operator has said so.
    pub fn is_paused(&self, client: ClientId) -> bool {
        self.state().scheduler.is_paused(client)
    }

    /// The weight of a client among those that compete for workers, from 1.
    pub fn priority(&self, client: ClientId) -> u32 {
        self.state().scheduler.priority(client)
    }

    /// Who answers for the worker of this label, if it is here.
    pub fn principal_of(&self, label: &str) -> Option<Principal> {
        self.state().scheduler.worker_labelled(label).map(|(_, principal)| principal)
    }

    /// Every worker that is here, by id.
    pub fn fleet(&self) -> Vec<WorkerStatus> {
        let state = self.state();
        state.scheduler.fleet(Instant::now(), |at| state.time_of(at))
    }

    /// What there is to measure of jobs and workers. Looks at all of them under the lock.
    pub fn metrics(&self) -> SchedulerMetrics {
        let mut metrics = self.state().scheduler.metrics();
        if !*self.begun.borrow() {
            // Jobs are not submitted before a worker is here: one is wanted for that.
            metrics.wanted_workers = metrics.wanted_workers.max(1);
            metrics.wanted_threads = metrics.wanted_threads.max(1);
        }
        metrics
    }

    /// The journal, if one is kept.
    pub fn journal(&self) -> Option<&Journal> {
        self.journal.as_deref()
    }
}

impl ClusterState {
    fn control(
        &mut self,
        order: Controlled,
        clients: &[ClientId],
        now: Instant,
    ) -> Result<String, ControlRefusal> {
        let done = self.carry_out(&order.action, clients, now)?;
        self.append(now, EventKind::Controlled(order));
        self.hold_checks();
        self.settle(now);
        self.wake(now);
        self.clients.wake_all();
        Ok(done)
    }

    fn carry_out(
        &mut self,
        action: &ControlAction,
        clients: &[ClientId],
        now: Instant,
    ) -> Result<String, ControlRefusal> {
        let scheduler = &mut self.scheduler;
        Ok(match action {
            ControlAction::Pause => {
                let paused = clients.iter().filter(|client| scheduler.pause(**client)).count();
                if paused == 0 {
                    return Err(ControlRefusal::Paused);
                }
                "paused: no more jobs are handed out, those in hand end".to_owned()
            }
            ControlAction::Resume { worker: None } => {
                let resumed = clients.iter().filter(|client| scheduler.resume(**client)).count();
                if resumed == 0 {
                    return Err(ControlRefusal::NotPaused);
                }
                "resumed".to_owned()
            }
            ControlAction::Resume { worker: Some(label) } => {
                let (id, _) = self.worker(label)?;
                if !self.scheduler.end_drain(id) {
                    return Err(ControlRefusal::NotDrained(label.clone()));
                }
                format!("worker {label}: is given jobs again")
            }
            ControlAction::Stop => "stopped".to_owned(),
            &ControlAction::Priority { priority } => {
                if !(1..=MAX_PRIORITY).contains(&priority) {
                    return Err(ControlRefusal::Priority(priority));
                }
                clients.iter().for_each(|client| scheduler.set_priority(*client, priority));
                format!("priority {priority}")
            }
            ControlAction::Drain { worker: label } => {
                let (id, _) = self.worker(label)?;
                let drained = self.scheduler.drain(id, now);
                let drained = drained.ok_or_else(|| ControlRefusal::Drained(label.clone()))?;
                let in_hand = match drained.leases {
                    0 => "has none in hand".to_owned(),
                    1 => "ends the one in hand".to_owned(),
                    leases => format!("ends the {leases} in hand"),
                };
                let alone = if drained.others == 0 { "; no other worker is here to go on" } else { "" };
                format!("worker {label}: gets no more jobs, {in_hand}{alone}")
            }
            ControlAction::Deny { worker: label } => {
                let (id, principal) = self.worker(label)?;
                if principal == Principal::Coordinator {
                    return Err(ControlRefusal::Own(label.clone()));
                }
                self.scheduler.ban(id, now);
                format!("worker {label}: denied, its jobs go to others")
            }
        })
    }

    fn worker(&self, label: &str) -> Result<(proto::WorkerId, Principal), ControlRefusal> {
        self.scheduler.worker_labelled(label).ok_or_else(|| {
            let labels = self.scheduler.labels();
            let mut here = labels.iter().take(MAX_NAMED).cloned().collect::<Vec<_>>().join(", ");
            match labels.len().saturating_sub(MAX_NAMED) {
                0 if labels.is_empty() => here = "none".to_owned(),
                0 => {}
                more => here += &format!(" and {more} more"),
            }
            ControlRefusal::UnknownWorker { label: label.to_owned(), here }
        })
    }

    /// Hands out checks of accepted results as long as anybody waits for a result who is not paused.
    pub(super) fn hold_checks(&mut self) {
        if self.is_halted() {
            self.scheduler.pause(ClientId::AUDITOR);
        } else {
            self.scheduler.resume(ClientId::AUDITOR);
        }
    }

    /// Whether nobody waits for a result but clients that are paused, if any is: then nothing is to be handed out.
    pub(super) fn is_halted(&self) -> bool {
        let is_paused = |client| self.scheduler.is_paused(client);
        self.scheduler.has_paused() && self.clients.that_wait().all(is_paused)
    }
}
