//! One of those who ask for evaluations: a run, or a member of a sweep.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use proto::task::{Described, Description, Evaluation, EvaluationResult, GridCell, Task, TaskResult};
use proto::{Digest, JobId, WorkerId};
use results::Proceedings;
use tokio::sync::Notify;

use super::{Cluster, ClusterError, ClusterNews, TICK};
use crate::scheduler::{ClientId, Finished, Staffing};

/// Tasks by job, with their place among all that were asked for together.
type Asked = BTreeMap<JobId, (usize, Arc<Task>)>;

/// Asks a cluster for evaluations and waits for them. Several clients share its workers fairly, and the answers to equal
/// questions.
pub struct Client {
    id: ClientId,
    cluster: Arc<Cluster>,
    /// There is something to tell.
    bell: Arc<Notify>,
}

/// A cell of the grid that was counted.
#[derive(Debug)]
pub struct CellAnswer {
    /// Its place among those that were submitted.
    pub place: usize,
    /// How many queries each descriptor recognises.
    pub counts: Vec<u32>,
    /// Who counted, if that is known.
    pub worker_id: Option<WorkerId>,
    /// As [`Finished::settled`].
    pub settled: bool,
}

impl Client {
    pub(super) fn new(cluster: &Arc<Cluster>) -> Self {
        let (id, bell) = cluster.floor().clients.join();
        Self { id, cluster: Arc::clone(cluster), bell }
    }

    /// Waits until a worker has joined; calls `still_waiting` each minute.
    pub async fn wait_for_worker(&self, mut still_waiting: impl FnMut(Duration)) {
        let begun = Instant::now();
        let mut next = Duration::from_secs(60);
        // Without reading what happened: that is for whoever watches the evaluations.
        while self.cluster.floor().scheduler.staffing(Instant::now()) != Staffing::Staffed {
            if begun.elapsed() >= next {
                still_waiting(begun.elapsed());
                next += Duration::from_secs(60);
            }
            self.wait().await;
        }
    }

    /// Submits evaluations and waits for all of them; results are in the order of submission, whatever the order
    /// of arrival. `watch` is shown every piece of news.
    pub async fn evaluate(
        &mut self,
        evaluations: Vec<Evaluation>,
        mut watch: impl FnMut(&ClusterNews),
    ) -> Result<Vec<Finished<EvaluationResult>>, ClusterError> {
        let (mut batch, tasks) = self.cluster.plan(evaluations);
        self.perform(tasks, |news, finished| {
            let done = batch.done();
            let further = finished.into_iter().flat_map(|(task, answer)| batch.take(task, answer)).collect();
            news.finished = batch.done() - done;
            watch(news);
            Ok::<_, ClusterError>(further)
        })
        .await?;
        Ok(batch.finish())
    }

    /// Submits cells of the grid and waits for all of them. `take` is given every piece of news, with the counts of
    /// the cells that were finished, numbered in the order of submission, and who counted them; its error ends the
    /// waiting.
    pub async fn evaluate_cells<E: From<ClusterError>>(
        &mut self,
        cells: Vec<GridCell>,
        mut take: impl FnMut(&ClusterNews, Vec<CellAnswer>) -> Result<(), E>,
    ) -> Result<(), E> {
        let cluster = Arc::clone(&self.cluster);
        self.perform(cells.into_iter().map(Task::GridCell).collect(), |news, finished| {
            let answer = |(place, finished): (usize, Finished)| match finished.result {
                TaskResult::GridCell(counts) => {
                    let worker_id = cluster.floor().scheduler.id_of(&finished.worker);
                    Some(CellAnswer { place, counts, worker_id, settled: finished.settled })
                }
                TaskResult::Evaluation(_) | TaskResult::Description(_) => None, // `Task::check` lets none pass
            };
            take(news, finished.into_iter().filter_map(answer).collect()).map(|()| Vec::new())
        })
        .await
    }

    /// Asks for descriptions and waits for all of them; they are in the order of the shards, whatever the order of
    /// arrival. `watch` is shown every piece of news.
    ///
    /// # Errors
    /// As for evaluations, and [`ClusterError::Gone`].
    pub async fn describe(
        &mut self,
        shards: &[Description],
        mut watch: impl FnMut(&ClusterNews),
    ) -> Result<Vec<Arc<[u8]>>, ClusterError> {
        loop {
            let mut names = vec![None; shards.len()];
            let tasks = shards.iter().cloned().map(Task::Description).collect();
            let done = self
                .perform(tasks, |news, finished| {
                    news.finished = finished.len();
                    for (place, finished) in finished {
                        if let TaskResult::Description(Described { digest, bytes }) = finished.result {
                            names[place] = Some((digest, bytes));
                        }
                    }
                    watch(news);
                    Ok::<_, ClusterError>(Vec::new())
                })
                .await;
            match done {
                // Answered from what still holds, and anew.
                Err(ClusterError::Corrected(_)) => continue,
                done => done?,
            }
            let bytes = |(digest, parts): (Digest, Option<Arc<[u8]>>)| match parts {
                Some(parts) => Ok(parts),
                None => self.cluster.blobs.read(digest).map(Into::into).map_err(|_| ClusterError::Gone),
            };
            return names.into_iter().map(|name| name.ok_or(ClusterError::Gone).and_then(bytes)).collect();
        }
    }

    /// Submits tasks and waits for all of them. `take` is given every piece of news, with the tasks that were
    /// finished, numbered in the order of submission, and returns tasks that are to be submitted as well; its error ends
    /// the waiting.
    async fn perform<E: From<ClusterError>>(
        &mut self,
        tasks: Vec<Task>,
        take: impl FnMut(&mut ClusterNews, Vec<(usize, Finished)>) -> Result<Vec<Task>, E>,
    ) -> Result<(), E> {
        let done = self.wait_for_all(tasks, take).await;
        if done.is_err() {
            let _ = self.cluster.flush().await; // the run ends with its own error
        }
        done
    }

    async fn wait_for_all<E: From<ClusterError>>(
        &mut self,
        tasks: Vec<Task>,
        mut take: impl FnMut(&mut ClusterNews, Vec<(usize, Finished)>) -> Result<Vec<Task>, E>,
    ) -> Result<(), E> {
        let mut asked = Asked::new();
        self.ask(tasks, &mut asked);
        loop {
            let (mut news, answers) = self.look().await?;
            let mut finished = Vec::new();
            for answer in answers {
                if let Some((place, task)) = asked.get(&answer.job) {
                    self.cluster.learn(task, &answer);
                    finished.push((*place, answer));
                }
            }
            let further = take(&mut news, finished)?;
            self.cluster.check_failures(&news)?;
            if !further.is_empty() {
                // What is asked by the name of an answer must not be handed out before the next start would know it.
                self.cluster.flush().await?;
                self.ask(further, &mut asked);
                continue; // their answers may be there
            }
            if self.has_all()? {
                return Ok(());
            }
            self.cluster.check_staffing(&news)?;
            self.arrive();
            self.wait().await;
        }
    }

    /// Asks for tasks, and adds them to those that were asked for. Answers come by [`Client::look`], those that are there
    /// at once.
    fn ask(&mut self, tasks: Vec<Task>, asked: &mut Asked) {
        let (mut floor, now) = (self.cluster.floor(), Instant::now());
        for task in tasks {
            let (place, task) = (asked.len(), Arc::new(task));
            asked.insert(floor.ask(self.id, Arc::clone(&task), now), (place, task));
        }
        floor.call(now);
    }

    /// It waits for something that had no answer, and has asked for everything else that it could.
    fn arrive(&self) {
        let mut floor = self.cluster.floor();
        floor.clients.account(self.id).arrive();
        self.cluster.begin_if_all_arrived(&floor);
    }

    /// What happened since the last look, and the answers that have come.
    async fn look(&mut self) -> Result<(ClusterNews, Vec<Finished>), ClusterError> {
        let (finished, news, struck) = {
            let (mut floor, now) = (self.cluster.floor(), Instant::now());
            floor.expire(now);
            let finished = floor.clients.account(self.id).take_inbox();
            let news = floor.news(self.id, finished.len(), now);
            (finished, news, floor.struck())
        };
        if let Some(mark) = struck {
            // Before anybody is told: a coordinator that is killed now must not go on with what is in doubt.
            self.cluster.durable(mark).await?;
        }
        Ok((news, finished))
    }

    /// Whether every answer was told, and none of them is in doubt.
    ///
    /// # Errors
    /// If answers that were told have turned out to be wrong: what was made of them has to be made again, by the
    /// same calls in the same order. They are answered from what is known, as far as it still holds.
    fn has_all(&mut self) -> Result<bool, ClusterError> {
        let mut floor = self.cluster.floor();
        if !floor.clients.account(self.id).has_all() || floor.is_in_doubt() {
            return Ok(false);
        }
        let account = floor.clients.account(self.id);
        if account.corrected.is_empty() {
            return Ok(true);
        }
        Err(ClusterError::Corrected(account.begin_again()))
    }

    /// Waits until there is something to tell, for a while: silence has to be looked for.
    async fn wait(&self) {
        let _ = tokio::time::timeout(TICK, self.bell.notified()).await;
    }

    /// Has no more to ask, as far as it knows: what waits for the first question of every client need not wait for this.
    pub fn rest(&mut self) {
        self.arrive();
    }

    /// Whether answers that it was told have turned out to be wrong since its last question; then it begins again.
    pub fn begins_again(&mut self) -> bool {
        let mut floor = self.cluster.floor();
        let account = floor.clients.account(self.id);
        !account.corrected.is_empty() && !account.begin_again().is_empty()
    }

    /// Notes that the run begins again, and why.
    pub fn note_rewind(&self, generation: u32, why: String) {
        self.cluster.floor().note_rewind(Instant::now(), generation, why);
    }

    /// What is to be told so far of workers and events, and of the attempts at what this client has asked for.
    pub fn proceedings(&self) -> Proceedings {
        self.cluster.floor().proceedings(self.id, Instant::now())
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        let mut floor = self.cluster.floor();
        floor.leave(self.id);
        self.cluster.begin_if_all_arrived(&floor);
    }
}
