//! Which answers are kept and which were: nobody is told that an answer was accepted before it is on the disk.

use std::collections::BTreeMap;
use std::sync::Arc;

use proto::task::Task;
use proto::{JobId, Lease, WorkerId};

use crate::assembly::Cut;
use crate::journal::{Accepted, Entry, Journal, Mark, Member, Told};
use crate::scheduler::Finished;

/// The cluster's side of the journal. Without one, as for a single evaluation, nothing is kept and nothing recalled.
#[derive(Default)]
pub struct Ledger {
    journal: Option<Arc<Journal>>,
    /// Answers of earlier starts that have not been asked for again yet.
    recalled: BTreeMap<JobId, Accepted>,
    /// Accepted by this start, and not known to be on the disk: the worker that gave it keeps it.
    pending: BTreeMap<Lease, Mark>,
}

impl Ledger {
    /// A ledger that goes on where earlier starts ended.
    pub fn new(journal: Arc<Journal>, recalled: BTreeMap<JobId, Accepted>) -> Self {
        Self { journal: Some(journal), recalled, pending: BTreeMap::new() }
    }

    /// Whether an answer to this job is there.
    pub fn has(&self, job: JobId) -> bool {
        self.recalled.contains_key(&job)
    }

    /// The answer that an earlier start accepted, if it is one to this task.
    pub fn recall(&mut self, job: JobId, task: &Task) -> Option<Finished> {
        let accepted = self.recalled.remove(&job)?;
        if let Err(what) = task.check(&accepted.result) {
            tracing::warn!("journal: {task} is computed again, its answer cannot be one: {what}");
            return None;
        }
        Some(accepted)
    }

    /// Keeps of an answer what is to be kept.
    pub fn accept(&mut self, finished: &Finished) {
        let (Some(journal), Some(result)) = (&self.journal, finished.result.kept()) else { return };
        let (job, attempt) = (finished.job, finished.attempt);
        let accepted = Accepted { result, ..finished.clone() };
        let mark = journal.record(Entry::Accepted(Box::new(accepted)));
        self.pending.insert(Lease { job, attempt }, mark);
    }

    /// Keeps how the evaluation of this job is cut: the answers to its pieces are of no use to any other cut.
    pub fn cut(&self, job: JobId, cut: Cut) {
        self.record(|| Entry::Cut(job, cut));
    }

    /// Keeps who holds a job.
    pub fn lease(&self, lease: Lease, holder: WorkerId) {
        self.record(|| Entry::Leased(lease, holder));
    }

    /// Keeps that a worker is there.
    pub fn join(&self, id: WorkerId, member: impl FnOnce() -> Member) {
        self.record(|| Entry::Joined(id, member()));
    }

    /// Keeps that a worker went.
    pub fn leave(&self, id: WorkerId) {
        self.record(|| Entry::Left(id));
    }

    /// Takes back an answer: it is in doubt.
    pub fn strike(&self, job: JobId) {
        self.record(|| Entry::Struck(job));
    }

    /// Takes back what this worker has answered in earlier starts and was not asked for again: it was wrong. The run
    /// stays marked as one in which a worker was.
    pub fn distrust(&mut self, worker: &str, id: WorkerId) {
        self.record(|| Entry::Distrusted(id));
        let doubtful = self.recalled.extract_if(.., |_, accepted| accepted.worker == worker);
        for (job, _) in doubtful.collect::<Vec<_>>() {
            self.strike(job);
        }
    }

    /// Keeps what is told.
    pub fn tell(&self, told: Vec<(u32, Told)>) {
        for (place, told) in told {
            self.record(|| Entry::Told(place, Box::new(told)));
        }
    }

    fn record(&self, entry: impl FnOnce() -> Entry) {
        if let Some(journal) = &self.journal {
            journal.record(entry());
        }
    }

    /// Takes out of `acknowledged` what is accepted and not on the disk yet.
    pub fn withhold(&mut self, acknowledged: &mut Vec<Lease>) -> Vec<Lease> {
        let Some(journal) = &self.journal else { return Vec::new() };
        let pending = &mut self.pending;
        let is_pending = |lease: &mut Lease| match pending.get(lease) {
            Some(mark) if journal.is_durable(*mark) => {
                pending.remove(lease);
                false
            }
            held => held.is_some(),
        };
        acknowledged.extract_if(.., is_pending).collect()
    }

    /// Takes out of `withheld` what is on the disk by now.
    pub fn release(&mut self, withheld: &mut Vec<Lease>) -> Vec<Lease> {
        let still = self.withhold(withheld);
        std::mem::replace(withheld, still)
    }

    /// Until when all that was kept so far is on the disk.
    pub fn end(&self) -> Option<Mark> {
        self.journal.as_ref().map(|journal| journal.end())
    }

    /// Whether everything up to the mark is on the disk.
    pub fn is_durable(&self, mark: Mark) -> bool {
        self.journal.as_ref().is_none_or(|journal| journal.is_durable(mark))
    }

    /// Until when the last of these leases is on the disk.
    pub fn mark(&self, leases: &[Lease]) -> Option<Mark> {
        leases.iter().filter_map(|lease| self.pending.get(lease)).max().copied()
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use proto::task::{Evaluation, EvaluationResult, TaskResult};

    fn task(queries: u32) -> Task {
        Task::Evaluation(Evaluation::sample(1, queries, 3))
    }

    fn accepted(job: JobId) -> Accepted {
        let result =
            EvaluationResult { queries: 10, object_correct: 4, category_correct: 6, matches: vec![] };
        let worker = "rack".to_owned();
        Accepted {
            job,
            result: TaskResult::Evaluation(result),
            worker,
            attempt: 3,
            queued: Duration::from_secs(1),
            run_seconds: 0.5,
            settled: true,
        }
    }

    #[test]
    fn an_answer_is_withheld_until_it_is_on_the_disk_and_nothing_else_is() {
        let (journal, held) = Journal::held();
        let job = task(10).job(0);
        let mut ledger = Ledger::new(Arc::new(journal), [(job, accepted(job))].into());
        let finished = ledger.recall(job, &task(10)).unwrap();
        assert!(!ledger.has(job) && ledger.recall(job, &task(10)).is_none());

        ledger.accept(&finished);
        let (lease, other) = (Lease { job, attempt: 3 }, Lease { job, attempt: 2 });
        let mut acknowledged = vec![lease, other];
        assert_eq!(ledger.withhold(&mut acknowledged), [lease]);
        assert_eq!(acknowledged, [other]);
        assert!(ledger.mark(&[lease]).is_some());
        assert_eq!(held.commit(), 1);
        let mut acknowledged = vec![lease, other];
        assert_eq!(ledger.withhold(&mut acknowledged), []);
        assert_eq!(acknowledged, [lease, other]);
        assert!(ledger.mark(&[lease]).is_none());
    }

    #[test]
    fn an_answer_that_cannot_be_one_is_not_recalled() {
        let (journal, _held) = Journal::held();
        let job = task(9).job(0);
        let mut ledger = Ledger::new(Arc::new(journal), [(job, accepted(job))].into());
        assert!(ledger.has(job));
        assert!(ledger.recall(job, &task(9)).is_none());
    }
}
