//! Evaluations go to workers that have described clouds in their channels, and scales to where evaluations will go.

use super::*;
use proto::task::{DescribedShard, DescribedSplit, Facts, Scale, Subject};

/// Describing a cloud in a channel of this number or a higher one costs a hundred times as much as in others.
const DEAR: u8 = 100;
const TRAINING: Digest = Digest([1; 32]);
const VALIDATION: Digest = Digest([2; 32]);

impl Bench {
    /// Descriptors have a channel for each of their bytes.
    fn with_channels(workers: u8) -> Self {
        let mut bench = Self::new(workers);
        bench.scheduler.limits.channels_of = |descriptor| {
            let cost = |&number: &u8| if number < DEAR { 1 } else { 100 };
            let channel = |number: &u8| Channel { number: u64::from(*number), cost: cost(number) };
            descriptor.bytes().iter().map(channel).collect()
        };
        bench
    }

    fn submit_task(&mut self, task: Task) -> JobId {
        let task = Arc::new(task);
        let job = self.names.next(&task);
        self.scheduler.submit(job, task, ClientId::new(1), self.now);
        job
    }

    fn submit_with(&mut self, channels: &[u8]) -> JobId {
        self.submit_among(channels, TRAINING)
    }

    /// An evaluation of 10 clouds against 10 of the training clouds.
    fn submit_among(&mut self, channels: &[u8], query: Digest) -> JobId {
        let mut evaluation = Evaluation::sample(1, 10, 10);
        evaluation.subject.descriptor = channels.to_vec().into();
        (evaluation.query, evaluation.database) = (vec![query], vec![TRAINING]);
        evaluation.subject.facts = Facts { cloud_cost: 100, pair_cost: 1, ..evaluation.subject.facts };
        self.submit_task(Task::Evaluation(evaluation))
    }

    /// The same of training clouds, of which those in some channels, by place, were described before.
    fn submit_described(&mut self, channels: &[u8], described: &[u32]) -> JobId {
        let mut evaluation = Evaluation::sample(1, 10, 10);
        evaluation.subject.descriptor = channels.to_vec().into();
        (evaluation.query, evaluation.database) = (vec![TRAINING], vec![TRAINING]);
        let shard = DescribedShard { manifest: TRAINING, description: Digest([9; 32]) };
        let split = |&channel: &u32| DescribedSplit { channel, split: TRAINING, shards: vec![shard] };
        evaluation.described = described.iter().map(split).collect();
        self.submit_task(Task::Evaluation(evaluation))
    }

    fn submit_scale(&mut self, channel: u8) -> JobId {
        let subject = Subject { descriptor: vec![channel].into(), ..Subject::sample(1) };
        self.submit_task(Task::Scale(Scale {
            subject,
            splits: vec![TRAINING],
            clouds: 10,
            described: vec![],
        }))
    }

    fn expect(&mut self, evaluations: &[&[u8]]) {
        let descriptors: Vec<_> = evaluations.iter().map(|channels| channels.to_vec().into()).collect();
        let expected = Expected::new(&descriptors, self.scheduler.limits.channels_of);
        self.scheduler.expect(ClientId::new(1), expected);
    }

    /// Has a worker answer its next job.
    fn answer_next(&mut self, number: u8) -> JobId {
        let lease = self.take(number);
        let is_scale = |job: &Job| matches!(*job.task, Task::Scale(_));
        let outcome = match self.scheduler.jobs.get(lease.job).is_some_and(is_scale) {
            true => Ok(TaskResult::Scale(0.5)),
            false => good(),
        };
        self.report(number, lease, outcome);
        lease.job
    }
}

#[test]
fn a_worker_gets_the_job_for_which_no_other_is_better_suited() {
    let mut bench = Bench::with_channels(3);
    for (number, channels) in [(1, [1, 2]), (2, [3, 4])] {
        let job = bench.submit_with(&channels);
        assert_eq!(bench.answer_next(number), job);
    }
    let unknown = bench.submit_with(&[9]);
    let [of_both, of_second, of_first] =
        [[1, 3, 4], [3, 4, 6], [1, 2, 5]].map(|channels| bench.submit_with(&channels));
    assert_eq!(bench.answer_next(1), unknown, "nobody has it, and it came first");
    assert_eq!(bench.answer_next(1), of_first);
    assert_eq!(bench.answer_next(3), of_both, "it has none, so the first");
    assert_eq!(bench.answer_next(2), of_second);
    let [of_second, again] = [[6].as_slice(), &[9, 1, 2, 5]].map(|channels| bench.submit_with(channels));
    assert_eq!(bench.answer_next(1), again, "what it was given since counts, too");
    assert_eq!(bench.answer_next(1), of_second, "it is not kept waiting where there is something to do");
}

#[test]
fn those_that_get_no_jobs_or_have_left_are_no_better_suited() {
    let leave = |bench: &mut Bench| {
        bench.scheduler.remove_worker(worker(2), Departure::Left, bench.now);
    };
    let drain = |bench: &mut Bench| {
        bench.scheduler.drain(worker(2), bench.now);
    };
    let stay = |_: &mut Bench| {};
    for (what, is_kept_for_it) in [(&leave as &dyn Fn(&mut Bench), false), (&drain, false), (&stay, true)] {
        let mut bench = Bench::with_channels(2);
        bench.submit_with(&[1]);
        bench.answer_next(2);
        what(&mut bench);
        let [of_second, unknown] = [[1], [2]].map(|channels| bench.submit_with(&channels));
        assert_eq!(bench.answer_next(1), if is_kept_for_it { unknown } else { of_second });
    }
}

#[test]
fn who_has_answered_a_job_is_no_better_suited_to_confirm_it() {
    let mut bench = Bench::with_channels(2);
    bench.scheduler.trust = Trust::new(Audit { share: 1.0, first: 0 });
    let of_first = bench.submit_with(&[1]);
    assert_eq!(bench.answer_next(1), of_first);
    bench.submit_with(&[2]);
    assert_eq!(bench.answer_next(2), of_first, "it came first, and only this one may take it");
    assert!(!bench.scheduler.drain_finished().is_empty());
}

#[test]
fn what_is_at_the_coordinator_costs_little() {
    let mut bench = Bench::with_channels(2);
    for (number, channels) in [(1, [1, DEAR]), (2, [2, DEAR + 1])] {
        let known = bench.submit_with(&channels);
        assert_eq!(bench.answer_next(number), known);
    }
    let describing = bench.submit_described(&[1, 2, DEAR + 1], &[]);
    let taking = bench.submit_described(&[1, 2, DEAR + 1], &[2]);
    // The other worker lacks channel 1 only; of those that this one lacks, the dear one has only to be taken.
    assert_eq!(bench.answer_next(1), taking);
    assert_eq!(bench.answer_next(1), describing);
}

#[test]
fn a_job_that_others_are_better_suited_for_does_not_wait_for_ever() {
    let mut bench = Bench::with_channels(2);
    for (number, channel) in [(1, 1), (2, 2)] {
        let known = bench.submit_with(&[channel]);
        assert_eq!(bench.answer_next(number), known);
    }
    let of_second = bench.submit_with(&[2]);
    for _ in 0..4 {
        bench.pass(15);
        let known = bench.submit_with(&[1]);
        assert_eq!(bench.answer_next(1), known);
        bench.poll(2, &[], 0); // it is there, and wants nothing
    }
    bench.pass(1);
    bench.submit_with(&[1]);
    assert_eq!(bench.answer_next(1), of_second);
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
    let mut bench = Bench::with_channels(2);
    bench.scheduler.limits.channels_of = |descriptor| {
        let first = u64::from(descriptor.bytes()[0]);
        (first * 100..first * 100 + 100).map(|number| Channel { number, cost: 1 }).collect()
    };
    for block in 1..=16 {
        bench.submit_with(&[block]);
        bench.answer_next(1);
    }
    bench.submit_with(&[1]);
    bench.answer_next(2);
    let forgotten = bench.submit_with(&[1]);
    let kept = bench.submit_with(&[16]);
    assert_eq!([bench.answer_next(1), bench.answer_next(1)], [kept, forgotten]);
}

#[test]
fn what_costs_most_to_describe_decides() {
    let mut bench = Bench::with_channels(2);
    for (number, channels) in [(1, [1, 2]), (2, [DEAR, 3])] {
        let job = bench.submit_with(&channels);
        assert_eq!(bench.answer_next(number), job);
    }
    let [of_two_cheap, of_dear] = [[1, 2, DEAR], [4, 5, DEAR]].map(|channels| bench.submit_with(&channels));
    assert_eq!(bench.answer_next(2), of_two_cheap, "as much to describe, and it came first");
    assert_eq!(bench.answer_next(2), of_dear);
    let [dear, cheap] = [[6, 7, DEAR], [3, 4, 5]].map(|channels| bench.submit_with(&channels));
    assert_eq!(bench.answer_next(1), cheap, "the other has three channels of 1 instead of one of 100");
    assert_eq!(bench.answer_next(1), dear);
}

#[test]
fn a_scale_goes_to_who_has_the_other_channels_of_an_evaluation_that_waits_for_it() {
    let mut bench = Bench::with_channels(3);
    for (number, channels) in [(1, [1, 2]), (2, [3, 4])] {
        let job = bench.submit_with(&channels);
        assert_eq!(bench.answer_next(number), job);
    }
    bench.expect(&[&[3, 4, 11], &[1, 2, 12, 13], &[14, 15]]);
    let [of_second, of_first, also_of_first, one, other] =
        [11, 12, 13, 14, 15].map(|channel| bench.submit_scale(channel));
    assert_eq!(bench.answer_next(1), of_first, "13 is missing, too, but 1 and 2 are there");
    assert_eq!(
        bench.answer_next(3),
        one,
        "one channel is missing beside it, of 11 two, and it came before the other"
    );
    assert_eq!(bench.answer_next(1), also_of_first);
    assert_eq!(bench.answer_next(3), other);
    assert_eq!(bench.answer_next(2), of_second);
    // Nobody describes anything twice for the evaluations themselves.
    let evaluations = [[3, 4, 11].as_slice(), &[1, 2, 12, 13], &[14, 15]];
    let jobs = evaluations.map(|channels| bench.submit_with(channels));
    assert_eq!([3, 1, 2].map(|number| bench.answer_next(number)), [jobs[2], jobs[1], jobs[0]]);
}

#[test]
fn scales_that_nobody_is_known_to_wait_for_keep_their_order() {
    let forget_client = |scheduler: &mut Scheduler, client| drop(scheduler.forget_client(client));
    for forget in [Scheduler::expect_nothing, forget_client] {
        let mut bench = Bench::with_channels(1);
        bench.expect(&[&[5, 9]]); // it would come last
        forget(&mut bench.scheduler, ClientId::new(1));
        let jobs = [5, 2, 1].map(|channel| bench.submit_scale(channel));
        assert_eq!([(); 3].map(|()| bench.answer_next(1)), jobs);
    }
}

/// Workers 1 and 2, which have described 10 clouds of 100 units in a dear channel, and matched 100 pairs of 1 unit: that
/// took 11 s, and 1 s when they had them.
fn timed() -> Bench {
    let mut bench = Bench::with_channels(2);
    for number in [1, 2] {
        for seconds in [11, 1] {
            bench.submit_with(&[DEAR]);
            let lease = bench.take(number);
            bench.pass(seconds);
            bench.report(number, lease, good());
        }
    }
    bench
}

impl Bench {
    /// Asserts that a worker is given a job that worker 1 has, after so many seconds and not before; both answer it.
    fn assert_late_after(&mut self, seconds: u64, (lease, number): (Lease, u8)) {
        for second in 0..seconds {
            assert!(self.poll(number, &[], 1).jobs.is_empty(), "after {second} s");
            self.poll(1, &[lease], 0);
            self.pass(1);
        }
        let again = self.take(number);
        assert_eq!(again.job, lease.job);
        self.report(1, lease, good());
        self.report(number, again, good());
    }
}

#[test]
fn a_job_is_late_by_what_its_worker_has_to_describe() {
    let mut bench = timed();
    // In a channel that both have after 1.5 s, in one that nobody has, or of other clouds, after 16.5 s.
    for (channel, query, late) in
        [(DEAR, TRAINING, 2), (DEAR + 1, TRAINING, 17), (DEAR, VALIDATION, 17), (DEAR, VALIDATION, 2)]
    {
        bench.submit_among(&[channel], query);
        let lease = bench.take(1);
        bench.assert_late_after(late, (lease, 2));
    }
}

#[test]
fn what_was_not_described_after_all_is_not_counted_as_described() {
    let mut bench = timed();
    let job = bench.submit_with(&[DEAR + 1]);
    let undelivered = bench.take(1);
    bench.poll(1, &[], 0);
    let lease = bench.take(1);
    assert_eq!((undelivered.job, lease.job), (job, job));
    bench.assert_late_after(17, (lease, 2));
}

#[test]
fn a_job_is_late_for_a_worker_that_would_have_to_describe_more_only_after_what_that_takes() {
    let mut bench = timed();
    bench.submit_with(&[DEAR]);
    let lease = bench.take(1);
    bench.join(3).unwrap();
    bench.scheduler.drain(worker(2), bench.now);
    bench.assert_late_after(17, (lease, 3));
}

#[test]
fn what_describing_takes_is_expected_in_proportion_where_it_is_not_known() {
    let mut bench = Bench::with_channels(2);
    bench.submit_scale(DEAR);
    bench.answer_next(1);
    for _ in 0..2 {
        bench.submit_with(&[DEAR]);
        let lease = bench.take(1);
        bench.pass(1);
        bench.report(1, lease, good());
    }
    // 1 s for the 100 units of a worker that has all of it are 11 s for the 1100 of the other.
    bench.submit_with(&[DEAR]);
    let lease = bench.take(1);
    bench.assert_late_after(17, (lease, 2));
}
