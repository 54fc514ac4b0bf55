//! A client of the cluster: a run, or a member of a sweep.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use proto::journal::Assurance;
use proto::task::{
    Described, Description, DescriptorBytes, Evaluation, EvaluationResult, GridCell, Scale, Task, TaskResult,
};
use proto::{Digest, JobId, Principal, WorkerId};
use tokio::sync::Notify;

use super::{Cluster, ClusterError, ClusterNews};
use crate::events::{Event, EventKind, Omitted};
use crate::scheduler::{ClientId, Expected, Finished, Provenance, Staffing};
use crate::sharding::{AwaitingScales, Batch, FoundScale};

/// Tasks by job, with their index among all that were submitted together.
type Asked = BTreeMap<JobId, (usize, Arc<Task>)>;

/// Submits tasks to a cluster and waits for their results. Several clients share its workers fairly, and the results of
/// equal tasks.
pub struct Client {
    id: ClientId,
    cluster: Arc<Cluster>,
    /// Wakes it when there is news.
    wakeup: Arc<Notify>,
}

/// A cell of the grid that was counted.
#[derive(Debug)]
pub struct CellAnswer {
    /// Its index among those that were submitted.
    pub place: usize,
    /// How many queries each descriptor recognises.
    pub counts: Vec<u32>,
    /// The worker that counted, who answers for it, and another principal that counted the same, if one did.
    pub by: (WorkerId, Principal, Option<Principal>),
    /// Whether nothing more is needed to believe it.
    pub settled: bool,
    /// Its provenance; `None` if it is nothing to go on with for others than this search.
    pub provenance: Option<Provenance>,
}

/// A shard that was described.
#[derive(Clone, Debug)]
pub struct DescriptionAnswer {
    /// Its index among those that were submitted.
    pub place: usize,
    /// Its description; `None` of one of which only the name is kept.
    pub bytes: Option<Arc<[u8]>>,
    /// Its provenance; `None` if it is nothing to go on with for others.
    pub provenance: Option<Provenance>,
}

/// Events that are looked at together, each of which may take two reads of a file: nobody is answered meanwhile.
const EVENTS_AT_ONCE: usize = 64;

/// How long a worker of the own process is waited for: it joins at once, or is refused and never comes.
const OWN_JOINS_WITHIN: Duration = Duration::from_secs(10);

impl Client {
    pub(super) fn new(cluster: &Arc<Cluster>, owner: Option<ClientId>) -> Self {
        let (id, wakeup) = cluster.state().clients.join(owner);
        Self { id, cluster: Arc::clone(cluster), wakeup }
    }

    /// By what the cluster knows it.
    pub fn id(&self) -> ClientId {
        self.id
    }

    /// As [`Cluster::wait_for_worker`].
    pub(super) async fn wait_for_worker(&self, is_own_coming: bool, mut still_waiting: impl FnMut(Duration)) {
        let (mut waited, mut last) = (Duration::ZERO, Instant::now());
        let mut next = Duration::from_secs(60);
        loop {
            let now = Instant::now();
            let (staffing, has_own, is_halted) = {
                let state = self.cluster.state();
                (state.scheduler.staffing(now), state.scheduler.has_own(), state.is_halted())
            };
            if !is_halted {
                waited += now.saturating_duration_since(last);
            }
            last = now;
            let is_own_missing = is_own_coming && !has_own && waited < OWN_JOINS_WITHIN;
            if staffing == Staffing::Staffed && !is_own_missing {
                return;
            }
            if waited >= next {
                still_waiting(waited);
                next += Duration::from_secs(60);
            }
            self.wait().await;
        }
    }

    /// Submits evaluations and waits for all of them; results are in the order of submission, whatever the order
    /// of arrival. `watch` is shown all news.
    ///
    /// # Errors
    /// If a job failed for good, there were too few workers for too long, the journal or what has outgrown memory cannot be
    /// used any more, or results that were delivered were wrong ([`ClusterError::Corrected`]).
    pub async fn evaluate(
        &mut self,
        evaluations: Vec<Evaluation>,
        mut watch: impl FnMut(&ClusterNews),
    ) -> Result<Vec<Finished<EvaluationResult>>, ClusterError> {
        let evaluations = evaluations.into_iter().map(AwaitingScales::from).collect();
        let watch = |news: &ClusterNews, _: &[(usize, &EvaluationResult)]| watch(news);
        Ok(self.evaluate_and_scale(evaluations, (Vec::new(), &[]), watch).await?.0)
    }

    /// Evaluates and asks for scales at the same time, as one that waits for the other leaves workers idle: see
    /// [`Client::evaluate`] and [`Client::scales`]. An evaluation begins when the scales that it awaits are found. `watch` is
    /// also shown the evaluations that were finished, by index.
    ///
    /// # Errors
    /// As for evaluations.
    pub async fn evaluate_and_scale(
        &mut self,
        evaluations: Vec<AwaitingScales>,
        (scales, needed_by): (Vec<Scale>, &[DescriptorBytes]),
        mut watch: impl FnMut(&ClusterNews, &[(usize, &EvaluationResult)]),
    ) -> Result<(Vec<Finished<EvaluationResult>>, Vec<Finished<FoundScale>>), ClusterError> {
        let has_scales = !scales.is_empty();
        if has_scales {
            let expected = Expected::new(needed_by, self.cluster.limits.channels_of);
            self.cluster.state().scheduler.expect(self.id, expected);
        }
        let (id, cluster, mut batch) = (self.id, Arc::clone(&self.cluster), Batch::new(evaluations));
        let mut tasks = cluster.begin_ready(id, &mut batch, scales.len());
        tasks.extend(cluster.begin_scales(&mut batch, scales));
        self.perform(tasks, |news, finished| {
            let mut further = Vec::new();
            for (place, finished) in finished {
                further.extend(batch.take(place, finished));
            }
            further.extend(cluster.begin_ready(id, &mut batch, 0));
            let evaluated = batch.evaluated();
            news.finished = evaluated.len();
            watch(news, &evaluated);
            Ok::<_, ClusterError>(further)
        })
        .await?;
        if has_scales {
            self.cluster.state().scheduler.expect_nothing(self.id);
            self.cluster.flush().await?;
        }
        Ok(batch.finish())
    }

    /// Has everything confirmed that this run knows about a descriptor, by the coordinator's own process or by a second
    /// principal, while other tasks go on. The next call that waits for results waits for this as well, as far as there is
    /// anybody who can confirm; it fails with [`ClusterError::Corrected`] if something was wrong.
    pub fn confirm(&self, descriptor: &DescriptorBytes) {
        self.cluster.state().confirm(self.id, descriptor, Instant::now());
    }

    /// Waits for what [`Client::confirm`] has asked for.
    ///
    /// # Errors
    /// As for evaluations.
    pub async fn confirmed(&mut self, watch: impl FnMut(&ClusterNews)) -> Result<(), ClusterError> {
        self.evaluate(Vec::new(), watch).await.map(drop)
    }

    /// Asks for the scales of channels and waits for all of them; they are in the order of submission, whatever the order
    /// of arrival, and on the disk, so that evaluations that name them mean the same to the next start. The descriptors
    /// that need them are evaluated next: workers are given scales so that few clouds are described twice for that.
    /// `watch` is shown all news.
    ///
    /// # Errors
    /// As for evaluations.
    pub async fn scales(
        &mut self,
        scales: Vec<Scale>,
        needed_by: &[DescriptorBytes],
        mut watch: impl FnMut(&ClusterNews),
    ) -> Result<Vec<Finished<FoundScale>>, ClusterError> {
        let watch = |news: &ClusterNews, _: &[(usize, &EvaluationResult)]| watch(news);
        Ok(self.evaluate_and_scale(Vec::new(), (scales, needed_by), watch).await?.1)
    }

    /// Submits cells of the grid and waits for all of them. `take` is given all news, with the counts of
    /// the cells that were finished, numbered in the order of submission, and who counted them; its error ends the
    /// waiting.
    ///
    /// # Errors
    /// As for evaluations, and those of `take`.
    pub async fn evaluate_cells<E: From<ClusterError>>(
        &mut self,
        cells: Vec<GridCell>,
        mut take: impl FnMut(&ClusterNews, Vec<CellAnswer>) -> Result<(), E>,
    ) -> Result<(), E> {
        let cluster = Arc::clone(&self.cluster);
        self.perform(cells.into_iter().map(Task::GridCell).collect(), |news, finished| {
            let answer = |(place, finished): (usize, Finished)| {
                let provenance = cluster.state().scheduler.provenance(&finished);
                let Finished { worker_id, principal, seconded, assurance, .. } = finished;
                let settled = assurance > Assurance::Owed;
                match finished.result {
                    TaskResult::GridCell(counts) => {
                        let by = (worker_id, principal, seconded);
                        Some(CellAnswer { place, counts, by, settled, provenance })
                    }
                    _ => None, // `Task::check` lets none pass
                }
            };
            take(news, finished.into_iter().filter_map(answer).collect()).map(|()| Vec::new())
        })
        .await
    }

    /// Asks for descriptions and waits for all of them; they are in the order of the shards, whatever the order of
    /// arrival. `watch` is called whenever there is news, with the descriptions that have come; one that was in doubt may
    /// come again.
    ///
    /// # Errors
    /// As for evaluations, and [`ClusterError::Gone`].
    pub async fn describe(
        &mut self,
        shards: &[Description],
        mut watch: impl FnMut(Vec<DescriptionAnswer>),
    ) -> Result<Vec<Arc<[u8]>>, ClusterError> {
        let cluster = Arc::clone(&self.cluster);
        loop {
            let mut names = vec![None; shards.len()];
            let tasks = shards.iter().cloned().map(Task::Description).collect();
            let done = self
                .perform(tasks, |_, finished| {
                    let mut answers = Vec::new();
                    for (place, finished) in finished {
                        let provenance = cluster.state().scheduler.provenance(&finished);
                        if let TaskResult::Description(Described { digest, bytes, .. }) = finished.result {
                            names[place] = Some((digest, bytes.clone()));
                            answers.push(DescriptionAnswer { place, bytes, provenance });
                        }
                    }
                    watch(answers);
                    Ok::<_, ClusterError>(Vec::new())
                })
                .await;
            match done {
                // Results that still hold are delivered again, the others computed anew.
                Err(ClusterError::Corrected(_)) => continue,
                done => done?,
            }
            let bytes = |(digest, bytes): (Digest, Option<Arc<[u8]>>)| match bytes {
                Some(bytes) => Ok(bytes),
                None => self.cluster.blobs.read(digest).map(Into::into).map_err(|_| ClusterError::Gone),
            };
            return names.into_iter().map(|name| name.ok_or(ClusterError::Gone).and_then(bytes)).collect();
        }
    }

    /// Submits tasks and waits for all of them. `take` is given all news, with the tasks that were
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
                // Tasks that name a result must not be handed out before the next start would know that result.
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

    /// Submits tasks, and adds them to `asked`. Results come by [`Client::look`], those that are there already at once.
    fn ask(&mut self, tasks: Vec<Task>, asked: &mut Asked) {
        let (mut state, now) = (self.cluster.state(), Instant::now());
        for task in tasks {
            let (place, task) = (asked.len(), Arc::new(task));
            asked.insert(state.ask(self.id, Arc::clone(&task), now), (place, task));
        }
        state.wake(now);
    }

    /// Notes that this client waits for a result and has submitted everything else that it could.
    fn arrive(&self) {
        let mut state = self.cluster.state();
        state.clients.account(self.id).arrive();
        self.cluster.begin_if_all_arrived(&state);
    }

    /// What happened since the last look, and the results that have come.
    async fn look(&mut self) -> Result<(ClusterNews, Vec<Finished>), ClusterError> {
        let (finished, news, retracted) = {
            let (mut state, now) = (self.cluster.state(), Instant::now());
            state.check_spilled()?;
            let finished = state.clients.account(self.id).take_inbox();
            let news = state.news(self.id, finished.len(), now);
            (finished, news, state.retracted())
        };
        if let Some(sequence) = retracted {
            // Before anything is delivered: a coordinator that is killed now must not go on with what is in doubt.
            self.cluster.durable(sequence).await?;
        }
        Ok((news, finished))
    }

    /// Whether every result was delivered, and none of them is in doubt.
    ///
    /// # Errors
    /// If results that were delivered have turned out to be wrong: what was made of them has to be made again, by the
    /// same calls in the same order. Those that still hold are delivered again at once. And if what has outgrown memory
    /// cannot be looked up any more.
    pub(super) fn has_all(&mut self) -> Result<bool, ClusterError> {
        let mut state = self.cluster.state();
        let has_all = state.clients.account(self.id).has_all();
        if has_all {
            state.share_held_doubts(self.id, Instant::now());
        }
        let in_doubt = has_all && state.is_in_doubt(self.id);
        state.clients.account(self.id).in_doubt = in_doubt;
        if !has_all || in_doubt {
            return Ok(false);
        }
        // A check of a result that cannot be read has corrected nothing.
        state.check_spilled()?;
        let account = state.clients.account(self.id);
        if account.corrected.is_empty() {
            return Ok(true);
        }
        Err(ClusterError::Corrected(account.begin_again()))
    }

    /// Waits for news, or the next tick of the clock: a grace may be over.
    async fn wait(&self) {
        self.wakeup.notified().await;
    }

    /// Has nothing more to submit, as far as it knows: polls that wait for every client's first task need not wait for this.
    /// What is still in doubt of its results is not held back either, though it was paused.
    pub fn rest(&mut self) {
        self.arrive();
        let mut state = self.cluster.state();
        if state.scheduler.resume(self.id) {
            state.hold_checks();
            state.wake(Instant::now());
        }
    }

    /// Whether results that were delivered to it have turned out to be wrong since it last asked; then it begins again.
    ///
    /// # Errors
    /// [`ClusterError::Spill`], here and below, if what it has asked for cannot be looked up any more.
    pub fn begins_again(&mut self) -> Result<bool, ClusterError> {
        let mut state = self.cluster.state();
        state.check_spilled()?;
        let account = state.clients.account(self.id);
        Ok(!account.corrected.is_empty() && !account.begin_again().is_empty())
    }

    /// Notes that the run begins again, and why.
    pub fn note_rewind(&self, generation: u32, why: String) {
        self.cluster.state().append(Instant::now(), EventKind::Rewind { generation, why });
    }

    /// Everything that has happened in all starts of the run, without attempts at what only others have asked for. Workers
    /// are answered meanwhile.
    pub async fn events(&self) -> Result<Vec<Arc<Event>>, ClusterError> {
        let mut concerning = Vec::new();
        for some in self.cluster.events.follow_from_first().read_to_end().chunks(EVENTS_AT_ONCE) {
            let concerns = {
                let state = self.cluster.state();
                some.iter().map(|event| state.concerns(self.id, event)).collect::<Vec<_>>()
            };
            let some = some.iter().zip(concerns).filter(|(_, concerns)| *concerns);
            concerning.extend(some.map(|(event, _)| Arc::clone(event)));
            tokio::task::yield_now().await;
        }
        self.cluster.check_spilled().map(|()| concerning)
    }

    /// How many events had no room in the log since this start.
    pub fn omitted_events(&self) -> Omitted {
        self.cluster.events.omitted()
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        let mut state = self.cluster.state();
        state.leave(self.id);
        self.cluster.begin_if_all_arrived(&state);
    }
}
