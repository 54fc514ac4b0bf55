//! Jobs that several clients ask for, and those that are only foreseen: until somebody asks for them, or nobody will.

use std::time::Instant;

use proto::JobId;

use super::Scheduler;
use super::fair_queue::ClientId;

impl Scheduler {
    /// Another client asks for a job, which may be open: it is handed out as early as for the one that waits less.
    pub fn share(&mut self, id: JobId, client: ClientId, now: Instant) {
        let Some(job) = self.jobs.get_mut(id) else { return };
        let position = self.queue.position(client);
        let was_foreseen = job.is_foreseen();
        job.clients.insert(client);
        if was_foreseen && job.leases.is_empty() && job.votes.is_empty() && !client.foresees() {
            job.submitted = now; // nobody has waited for it so far
        }
        let before = job.position;
        job.position = position.min(before);
        self.queue.set_waiting(before, id, false);
        self.refile(id);
        self.fail_hopeless(); // what had failed while it was only foreseen
    }

    /// A client will submit no more jobs. Those that it has foreseen, and that nobody else wants or has begun, are dropped,
    /// and returned.
    pub fn forget_client(&mut self, client: ClientId) -> Vec<JobId> {
        let dropped = if client.foresees() { self.drop_foreseen(client) } else { Vec::new() };
        self.queue.forget_client(client);
        self.expected.remove(&client);
        if self.paused.remove(&client) {
            self.refile_all();
        }
        dropped
    }

    fn drop_foreseen(&mut self, client: ClientId) -> Vec<JobId> {
        let its_own = self.jobs.iter().filter(|(_, job)| job.clients.contains(&client)).map(|(id, _)| id);
        let mut dropped = Vec::new();
        for id in its_own.collect::<Vec<_>>() {
            let Some(job) = self.jobs.get_mut(id) else { continue };
            if job.clients.len() > 1 {
                job.clients.remove(&client);
                self.refile(id);
            } else if job.leases.is_empty() && job.votes.is_empty() {
                self.forget(id);
                dropped.push(id);
            }
        }
        dropped
    }
}
