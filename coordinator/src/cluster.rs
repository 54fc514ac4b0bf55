//! The scheduler as several tasks share it: the service feeds it, the run waits on it, a clock expires leases.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use proto::{JobId, Lease, SessionId, WorkerId};
use tokio::sync::Notify;

use crate::blobs::BlobStore;
use crate::evaluation::{Evaluation, EvaluationResult};
use crate::scheduler::{
    Answer, Arrival, Farewell, Finished, Introduction, JobFailed, Limits, Poll, PollRefusal, Scheduler,
    Staffing,
};
use crate::task::{GridCell, Task, TaskResult};

/// How often silence is looked for.
const TICK: Duration = Duration::from_millis(500);

/// Why evaluations stopped for good.
#[derive(Debug, thiserror::Error)]
pub enum ClusterError {
    /// A job failed as often as the limit allows.
    #[error("{task}: failed {count} times, got\n  {failures}\nlook at the workers' logs; coordinator.max_failures and coordinator.job_seconds set the limits", task = .0.task, count = .0.failures.len(), failures = first_lines(&.0.failures))]
    JobFailed(JobFailed),
    /// No worker is left, and none came back.
    #[error(
        "workers: the last one was lost {seconds} s ago and none has joined since\nstart workers, then run the same command again"
    )]
    NoWorkers {
        /// Since when.
        seconds: u64,
    },
}

/// What failed, a line each: advice given to one machine is not repeated for all.
fn first_lines(failures: &[String]) -> String {
    let lines: Vec<&str> = failures.iter().filter_map(|failure| failure.lines().next()).collect();
    lines.join("\n  ")
}

/// Scheduler, blobs and the signals between those who use them.
pub struct Cluster {
    /// Names this start of the coordinator.
    pub session: SessionId,
    /// What workers may fetch.
    pub blobs: BlobStore,
    limits: Limits,
    scheduler: Mutex<Scheduler>,
    /// There may be a job for a poll that is held back.
    work: Notify,
    /// Something was finished, failed or lost.
    news: Notify,
}

impl Cluster {
    /// A cluster without workers.
    pub fn new(limits: Limits) -> Arc<Self> {
        Arc::new(Self {
            session: SessionId(rand::random()),
            blobs: BlobStore::default(),
            limits,
            scheduler: Mutex::new(Scheduler::new(limits)),
            work: Notify::new(),
            news: Notify::new(),
        })
    }

    /// How often a busy worker has to poll: several polls may be lost before its lease ends.
    pub fn heartbeat(&self) -> Duration {
        (self.limits.lease / 6).min(Duration::from_secs(5))
    }

    /// How long a poll may be held back.
    pub fn hold(&self) -> Duration {
        (self.limits.lease / 3).min(Duration::from_secs(10))
    }

    /// See [`Scheduler::register`].
    pub fn register(&self, id: WorkerId, introduction: Introduction) -> Option<String> {
        let label = self.scheduler().register(id, introduction, Instant::now());
        self.news.notify_one();
        label
    }

    /// Answers a poll; holds the answer back while it would be empty and the worker wants jobs.
    pub async fn poll(&self, id: WorkerId, poll: Poll) -> Result<Answer, PollRefusal> {
        let (sequence, wanted, leaving) = (poll.sequence, poll.wanted, poll.leaving);
        let reports = !poll.finished.is_empty();
        let (mut answer, waiting) = {
            let mut scheduler = self.scheduler();
            let answer = scheduler.poll(id, poll, Instant::now())?;
            (answer, scheduler.has_waiting())
        };
        if reports || leaving {
            self.news.notify_one();
        }
        if waiting {
            // A failure, a goodbye or a lost reply has put jobs back that this worker did not take.
            self.work.notify_waiters();
        }
        let empty = answer.jobs.is_empty() && answer.acknowledged.is_empty() && answer.revoked.is_empty();
        if empty && wanted > 0 && !leaving {
            answer.jobs = self.wait_for_jobs(id, sequence, wanted).await?;
        }
        Ok(answer)
    }

    async fn wait_for_jobs(
        &self,
        id: WorkerId,
        sequence: u64,
        wanted: usize,
    ) -> Result<Vec<(Lease, Arc<Task>)>, PollRefusal> {
        let deadline = tokio::time::Instant::now() + self.hold();
        loop {
            let mut work = std::pin::pin!(self.work.notified());
            work.as_mut().enable(); // before looking, so that a job submitted in between is not missed
            let jobs = self.scheduler().lease_later(id, sequence, wanted, Instant::now())?;
            if !jobs.is_empty() {
                return Ok(jobs);
            }
            if tokio::time::timeout_at(deadline, work).await.is_err() {
                return Ok(jobs);
            }
        }
    }

    /// Submits evaluations and waits for all of them; results are in the order of submission, whatever the order
    /// of arrival. `watch` is shown every piece of news.
    pub async fn evaluate(
        &self,
        evaluations: Vec<Evaluation>,
        mut watch: impl FnMut(&ClusterNews),
    ) -> Result<Vec<Finished<EvaluationResult>>, ClusterError> {
        let mut results: Vec<Option<Finished<EvaluationResult>>> = evaluations.iter().map(|_| None).collect();
        let tasks = evaluations.into_iter().map(Task::Evaluation);
        self.perform(tasks, |news, finished| {
            for (place, Finished { job, result, worker, attempt, queued, run_seconds }) in finished {
                if let TaskResult::Evaluation(result) = result {
                    results[place] = Some(Finished { job, result, worker, attempt, queued, run_seconds });
                }
            }
            watch(news);
            Ok::<_, ClusterError>(())
        })
        .await?;
        Ok(results.into_iter().flatten().collect())
    }

    /// Submits cells of the grid and waits for all of them. `take` is given every piece of news, with the counts of
    /// the cells that were finished, numbered in the order of submission; its error ends the waiting.
    pub async fn evaluate_cells<E: From<ClusterError>>(
        &self,
        cells: Vec<GridCell>,
        mut take: impl FnMut(&ClusterNews, Vec<(usize, Vec<u32>)>) -> Result<(), E>,
    ) -> Result<(), E> {
        self.perform(cells.into_iter().map(Task::GridCell), |news, finished| {
            let counts = finished.into_iter().filter_map(|(place, finished)| match finished.result {
                TaskResult::GridCell(counts) => Some((place, counts)),
                TaskResult::Evaluation(_) => None, // `Task::check` lets none pass
            });
            take(news, counts.collect())
        })
        .await
    }

    /// Submits tasks and waits for all of them. `take` is given every piece of news, with the tasks that were
    /// finished, numbered in the order of submission; its error ends the waiting.
    async fn perform<E: From<ClusterError>>(
        &self,
        tasks: impl Iterator<Item = Task>,
        mut take: impl FnMut(&ClusterNews, Vec<(usize, Finished)>) -> Result<(), E>,
    ) -> Result<(), E> {
        let jobs: Vec<JobId> = {
            let mut scheduler = self.scheduler();
            let now = Instant::now();
            tasks.map(|task| scheduler.submit(Arc::new(task), now)).collect()
        };
        self.work.notify_waiters();
        let mut missing = jobs.len();
        loop {
            let (news, finished) = self.look();
            let numbered = |finished: Finished| Some((jobs.binary_search(&finished.job).ok()?, finished));
            let finished: Vec<(usize, Finished)> = finished.into_iter().filter_map(numbered).collect();
            missing -= finished.len();
            take(&news, finished)?;
            if let Some(failed) = news.failed {
                return Err(ClusterError::JobFailed(failed).into());
            }
            if missing == 0 {
                return Ok(());
            }
            if news.staffing == Staffing::GraceOver {
                return Err(ClusterError::NoWorkers { seconds: self.limits.worker_grace.as_secs() }.into());
            }
            let _ = tokio::time::timeout(TICK, self.news.notified()).await; // the tick expires leases
        }
    }

    /// Waits until a worker has joined; calls `still_waiting` each minute.
    pub async fn wait_for_worker(&self, mut still_waiting: impl FnMut(Duration)) {
        let begun = Instant::now();
        let mut next = Duration::from_secs(60);
        // Without draining what happened: that is for whoever watches the evaluations.
        while self.scheduler().staffing(Instant::now()) != Staffing::Staffed {
            if begun.elapsed() >= next {
                still_waiting(begun.elapsed());
                next += Duration::from_secs(60);
            }
            let _ = tokio::time::timeout(TICK, self.news.notified()).await;
        }
    }

    fn look(&self) -> (ClusterNews, Vec<Finished>) {
        let mut scheduler = self.scheduler();
        let now = Instant::now();
        scheduler.expire(now);
        let farewells = scheduler.drain_farewells();
        if !farewells.is_empty() {
            self.work.notify_waiters();
        }
        let finished = scheduler.drain_finished();
        let news = ClusterNews {
            finished: finished.len(),
            failed: scheduler.failed().cloned(),
            farewells,
            staffing: scheduler.staffing(now),
            arrivals: scheduler.drain_arrivals(),
            workers: scheduler.worker_count(),
        };
        (news, finished)
    }

    fn scheduler(&self) -> MutexGuard<'_, Scheduler> {
        // Decisions are made in one go: a panic in one of them is a bug, but leaves no half-made state to fear.
        self.scheduler.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// What happened since the last look.
#[derive(Debug)]
pub struct ClusterNews {
    /// How many tasks were finished.
    pub finished: usize,
    /// Workers that went.
    pub farewells: Vec<Farewell>,
    /// Workers that came.
    pub arrivals: Vec<Arrival>,
    /// How many workers are there.
    pub workers: usize,
    staffing: Staffing,
    failed: Option<JobFailed>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scheduler::Report;

    const LIMITS: Limits = Limits {
        lease: Duration::from_secs(30),
        job: Duration::from_secs(600),
        max_failures: 2,
        max_losses: 5,
        worker_grace: Duration::from_secs(300),
        max_workers: 4,
    };

    fn cell(disk_um: u32) -> GridCell {
        GridCell { disk_um, ring_um: 21_000, query: vec![], database: vec![], queries: 9, descriptors: 2 }
    }

    /// A worker that gives each cell the counts that `answer` has for its R1.
    async fn work(cluster: &Cluster, answer: impl Fn(u32) -> Vec<u32>) {
        let id = WorkerId([1; 16]);
        let introduction = Introduction { name: "one".to_owned(), threads: 1, build: "test".to_owned() };
        cluster.register(id, introduction);
        let mut finished: Vec<Report> = Vec::new();
        for sequence in 1.. {
            let reports = std::mem::take(&mut finished);
            let poll = Poll { sequence, finished: reports, wanted: 2, ..Poll::default() };
            for (lease, task) in cluster.poll(id, poll).await.unwrap().jobs.into_iter().rev() {
                let Task::GridCell(cell) = &*task else { panic!("{task}") };
                let outcome = Ok(TaskResult::GridCell(answer(cell.disk_um)));
                finished.push(Report { lease, run_seconds: 0.1, outcome });
            }
            tokio::task::yield_now().await; // an answer that is there at once would leave nobody else a turn
        }
    }

    async fn evaluate(answer: impl Fn(u32) -> Vec<u32>) -> Result<Vec<(usize, Vec<u32>)>, ClusterError> {
        let cluster = Cluster::new(LIMITS);
        let mut all = Vec::new();
        let evaluation = cluster.evaluate_cells([5_000, 6_000, 7_000].map(cell).to_vec(), |_, finished| {
            all.extend(finished);
            Ok(())
        });
        tokio::select! {
            done = evaluation => done?,
            () = work(&cluster, answer) => {}
        }
        all.sort();
        Ok(all)
    }

    #[tokio::test]
    async fn cells_are_given_with_their_place_whatever_the_order_of_arrival() {
        let counts = evaluate(|disk_um| vec![disk_um / 1000, 0]).await.unwrap();
        assert_eq!(counts, [(0, vec![5, 0]), (1, vec![6, 0]), (2, vec![7, 0])]);
    }

    #[tokio::test]
    async fn a_cell_that_is_never_answered_well_is_named() {
        let failed = evaluate(|disk_um| vec![disk_um / 1000; if disk_um == 6_000 { 3 } else { 2 }]).await;
        let message = failed.unwrap_err().to_string();
        assert!(message.starts_with("grid cell of R1=0.6 cm R2=2.1 cm: failed 2 times, got\n"), "{message}");
        assert!(message.contains("one: counts: must be 2, got 3"), "{message}");
    }
}
