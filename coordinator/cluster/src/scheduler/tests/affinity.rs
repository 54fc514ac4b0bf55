//! Evaluations go to workers that have described clouds in their channels.

use super::*;

impl Bench {
    /// Subjects have a channel for each byte of their descriptor.
    fn with_channels(workers: u8) -> Self {
        let mut bench = Self::new(workers);
        bench.scheduler.limits.channels_of =
            |subject| subject.descriptor.bytes().iter().map(|&channel| u64::from(channel)).collect();
        bench
    }

    fn submit_with(&mut self, channels: &[u8]) -> JobId {
        let mut evaluation = Evaluation::sample(1, 10, 10);
        evaluation.subject.descriptor = channels.to_vec().into();
        let task = Arc::new(Task::Evaluation(evaluation));
        let job = self.names.next(&task);
        self.scheduler.submit(job, task, ClientId(1), self.now);
        job
    }

    /// Has a worker answer its next job.
    fn answer_next(&mut self, number: u8) -> JobId {
        let lease = self.take(number);
        self.report(number, lease, good());
        lease.job
    }
}

#[test]
fn a_worker_gets_the_job_of_which_it_has_described_most() {
    let mut bench = Bench::with_channels(3);
    for (number, channels) in [(1, [1, 2]), (2, [3, 4])] {
        let job = bench.submit_with(&channels);
        assert_eq!(bench.answer_next(number), job);
    }
    let unknown = bench.submit_with(&[9]);
    let [of_both, of_second, of_first] =
        [[1, 3, 4], [3, 4, 6], [1, 2, 5]].map(|channels| bench.submit_with(&channels));
    assert_eq!(bench.answer_next(1), unknown, "as few to describe, and it came first");
    assert_eq!(bench.answer_next(1), of_first);
    assert_eq!(bench.answer_next(3), of_both, "it has none, so the first");
    assert_eq!(bench.answer_next(2), of_second);
    let [other, again] = [[7].as_slice(), &[9, 1, 2, 5]].map(|channels| bench.submit_with(channels));
    assert_eq!(bench.answer_next(1), again, "what it was given since counts, too");
    assert_eq!(bench.answer_next(1), other);
}

#[test]
fn a_job_that_nobody_has_anything_of_does_not_wait_for_ever() {
    let mut bench = Bench::with_channels(1);
    let known = bench.submit_with(&[1]);
    assert_eq!(bench.answer_next(1), known);
    let unknown = bench.submit_with(&[2]);
    for _ in 0..4 {
        bench.pass(15);
        let known = bench.submit_with(&[1]);
        assert_eq!(bench.answer_next(1), known);
    }
    bench.pass(1);
    bench.submit_with(&[1]);
    assert_eq!(bench.answer_next(1), unknown);
}

#[test]
fn without_channels_jobs_keep_their_order() {
    let mut bench = Bench::with_channels(1);
    let jobs: Vec<JobId> = (0..5).map(|_| bench.submit_with(&[])).collect();
    let answered: Vec<JobId> = jobs.iter().map(|_| bench.answer_next(1)).collect();
    assert_eq!(answered, jobs);
}

#[test]
fn what_was_described_long_ago_is_forgotten() {
    let mut bench = Bench::with_channels(1);
    bench.scheduler.limits.channels_of = |subject| {
        let first = u64::from(subject.descriptor.bytes()[0]);
        (first * 100..first * 100 + 100).collect()
    };
    for block in 1..=6 {
        bench.submit_with(&[block]);
        bench.answer_next(1);
    }
    let forgotten = bench.submit_with(&[1]);
    let kept = bench.submit_with(&[6]);
    assert_eq!([bench.answer_next(1), bench.answer_next(1)], [kept, forgotten]);
}
