//! A coordinator's scheduler and its plans, workers that only wait, and a network, on one virtual clock.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::time::{Duration, Instant};

use proto::task::{CloudEntry, Evaluation, Label, SplitManifest, Task};
use proto::{Digest, JobId};

use super::generations::{Asked, CLOUDS, Generations};
use super::structures::channels_of;
use super::worker::Worker;
use crate::blobs::BlobStore;
use crate::scheduler::{Answer, ClientId, Expected, Finished, Limits, Poll, RunSecret, Scheduler};
use crate::sharding::{Batch, Layouts, Load, Planner, ShardCount};

/// The one that asks.
const CLIENT: ClientId = ClientId::new(1);
/// A message takes this, one way.
const MESSAGE: Duration = Duration::from_micros(300);
/// A commit of the journal takes this.
const COMMIT: Duration = Duration::from_millis(1);
/// From the last answer of a generation to the first question of the next.
const BETWEEN: Duration = Duration::from_millis(5);
/// Generations that are not measured: in the first, nobody knows yet what an evaluation takes.
const EARLY: u32 = 2;
const TICK: Duration = Duration::from_millis(500);
const HOLD: Duration = Duration::from_secs(10);
/// All generations are over by then.
const END: Duration = Duration::from_secs(10_000);
const HEARTBEAT: Duration = Duration::from_secs(5);

/// What is simulated.
#[derive(Clone, Copy, Debug)]
pub struct Setting {
    pub workers: usize,
    pub shard_count: ShardCount,
    /// The slowest worker takes so many times as long as the fastest.
    pub slowest: f64,
    /// Jobs that a worker takes beside the one in hand.
    pub ahead: usize,
}

/// What a generation takes, and why workers are idle in it: shares of all workers' time.
#[derive(Clone, Copy, Debug, Default)]
pub struct Measured {
    pub generation: f64,
    pub busy: f64,
    /// Jobs that were begun.
    pub jobs: f64,
    /// Jobs that somebody else had answered first.
    pub twice: f64,
    /// No generation is under way.
    pub between: f64,
    /// There is a job that nobody has begun, on its way or behind another.
    pub waiting: f64,
    /// Tiles wait for descriptions, or evaluations for scales.
    pub barrier: f64,
    /// Everything has been begun.
    pub last: f64,
    /// Megabytes of descriptions.
    pub up: f64,
    pub down: f64,
}

/// Something that happens at its time; polls and replies with the worker's number and which call it is.
enum Event {
    Poll(usize, Poll, u64),
    Reply(usize, Answer, u64),
    HoldEnds(usize, u64),
    Heartbeat(usize, u64),
    Done(usize),
    Tick,
    /// A client looks for results.
    Look(ClientId),
    Submit(ClientId, Vec<Task>),
    Generation,
}

/// Who asks: see [`Client`](crate::Client).
struct Asking {
    batch: Batch,
    /// The part that each evaluation belongs to.
    parts: Vec<usize>,
    /// Evaluations that are not done.
    open: usize,
    /// The places of jobs.
    asked: BTreeMap<JobId, usize>,
    inbox: Vec<Finished>,
    /// Whether news wakes it.
    waits: bool,
}

/// What all of them do.
pub struct Simulation {
    setting: Setting,
    generations: Box<dyn Generations>,
    scheduler: Scheduler,
    planner: Planner,
    layouts: Layouts,
    blobs: BlobStore,
    sides: [Digest; 2],
    /// The one that evaluates a generation, while one is under way, and those that foresee the next and this one.
    clients: BTreeMap<ClientId, Asking>,
    foreseen: u32,
    /// Evaluations of each part that are not done.
    open: BTreeMap<usize, usize>,
    tasks: BTreeMap<JobId, Arc<Task>>,
    waiting: BTreeMap<JobId, Vec<ClientId>>,
    results: BTreeMap<JobId, Finished>,
    workers: Vec<Worker>,
    /// Polls that are held back: sequence number, jobs wanted and call.
    held: BTreeMap<usize, (u64, usize, u64)>,
    agenda: BTreeMap<(Duration, u64), Event>,
    events: u64,
    begun: Instant,
    clock: Duration,
    generation: u32,
    generation_begun: Duration,
    /// Jobs that nobody has begun.
    unstarted: BTreeSet<JobId>,
    answered: BTreeSet<JobId>,
    /// Tiles of the generation that were not asked for yet.
    unasked: usize,
    measured: Measured,
    /// Seconds of useful work.
    work: f64,
}

impl Simulation {
    /// Workers that have joined, before the first generation.
    pub fn new(setting: Setting, generations: impl Generations + 'static) -> Self {
        let blobs = BlobStore::default();
        let entry = |index: u32| CloudEntry {
            digest: Digest([1; 32]),
            bytes: 1,
            label: Label { category: 0, instance: 0 },
            path: index.to_string(),
            sequence: None,
        };
        let side = |first: u32| SplitManifest {
            split: first.to_string(),
            clouds: (first..first + CLOUDS).map(entry).collect(),
        };
        let sides = [0, CLOUDS].map(|first| blobs.publish_bytes(side(first).encode()));
        let begun = Instant::now();
        let limits = Limits { max_workers: setting.workers, channels_of, ..Limits::SAMPLE };
        let mut scheduler = Scheduler::new(limits, RunSecret::new([7; 32]), None);
        let steps = (setting.workers - 1).max(1) as f64;
        let slowness = |number: usize| 1.0 + (setting.slowest - 1.0) * number as f64 / steps;
        let workers: Vec<Worker> = (0..setting.workers)
            .map(|number| Worker::new(number, slowness(number * 37 % setting.workers), setting.ahead))
            .collect();
        for worker in &workers {
            scheduler.register(worker.caller.0, Worker::introduction(), begun).unwrap();
        }
        let mut planner = Planner::default();
        planner.set_shard_count(setting.shard_count);
        let mut simulation = Self {
            setting,
            generations: Box::new(generations),
            scheduler,
            planner,
            layouts: Layouts::default(),
            blobs,
            sides,
            clients: BTreeMap::new(),
            foreseen: 0,
            open: BTreeMap::new(),
            tasks: BTreeMap::new(),
            waiting: BTreeMap::new(),
            results: BTreeMap::new(),
            workers,
            held: BTreeMap::new(),
            agenda: BTreeMap::new(),
            events: 0,
            begun,
            clock: Duration::ZERO,
            generation: 0,
            generation_begun: Duration::ZERO,
            unstarted: BTreeSet::new(),
            answered: BTreeSet::new(),
            unasked: 0,
            measured: Measured::default(),
            work: 0.0,
        };
        simulation.at(Duration::ZERO, Event::Tick);
        simulation.at(Duration::ZERO, Event::Generation);
        for worker in 0..setting.workers {
            simulation.proceed(worker);
        }
        simulation
    }

    fn at(&mut self, after: Duration, event: Event) {
        self.events += 1;
        self.agenda.insert((self.clock + after, self.events), event);
    }

    fn now(&self) -> Instant {
        self.begun + self.clock
    }

    /// Plays so many generations.
    pub fn run(mut self, generations: u32) -> Measured {
        let mut clock_from = Duration::ZERO;
        while let Some(((at, _), event)) = self.agenda.pop_first() {
            self.pass(at);
            if let Event::Generation = event {
                if self.generation == EARLY {
                    clock_from = self.clock;
                }
                if self.generation == generations {
                    break;
                }
            }
            self.handle(event);
        }
        let all = (self.clock - clock_from).as_secs_f64() * self.setting.workers as f64;
        let count = f64::from(generations - EARLY);
        let Measured { generation, twice, jobs, between, waiting, barrier, last, .. } = self.measured;
        let [up, down] =
            [0, 1].map(|way| self.workers.iter().map(|worker| worker.traffic[way]).sum::<u64>() as f64);
        Measured {
            generation: generation / count,
            busy: self.work / all,
            jobs: jobs / count,
            twice: twice / all,
            between: between / all,
            waiting: waiting / all,
            barrier: barrier / all,
            last: last / all,
            up: up / f64::from(generations) / 1e6,
            down: down / f64::from(generations) / 1e6,
        }
    }

    /// Accounts for the time until then.
    fn pass(&mut self, until: Duration) {
        let seconds = (until - self.clock).as_secs_f64();
        self.clock = until;
        if self.generation <= EARLY || seconds == 0.0 {
            return;
        }
        let idle = self.workers.iter().filter(|worker| worker.is_idle()).count() as f64 * seconds;
        let place = match self.clients.get(&CLIENT) {
            None => &mut self.measured.between,
            Some(_) if !self.unstarted.is_empty() => &mut self.measured.waiting,
            Some(asking) if self.unasked + asking.batch.waiting().evaluations > 0 => {
                &mut self.measured.barrier
            }
            Some(_) => &mut self.measured.last,
        };
        *place += idle;
    }

    fn handle(&mut self, event: Event) {
        match event {
            Event::Poll(worker, poll, call) => self.polled(worker, poll, call),
            Event::Reply(worker, answer, call) if self.workers[worker].call == call => {
                self.workers[worker].absorb(answer);
                self.start(worker);
                if self.workers[worker].wanted() > 0 {
                    self.proceed(worker);
                } else {
                    self.at(HEARTBEAT, Event::Heartbeat(worker, call));
                }
            }
            Event::Heartbeat(worker, call) if self.workers[worker].call == call => self.proceed(worker),
            Event::HoldEnds(worker, call) if self.held.get(&worker).is_some_and(|held| held.2 == call) => {
                self.held.remove(&worker);
                self.at(MESSAGE, Event::Reply(worker, Answer::default(), call));
            }
            Event::Reply(..) | Event::Heartbeat(..) | Event::HoldEnds(..) => {}
            Event::Done(worker) => {
                if let Some((lease, begun)) = self.workers[worker].finish(self.clock) {
                    let seconds = (self.clock - begun).as_secs_f64();
                    let is_first = self.answered.insert(lease.job);
                    if self.generation > EARLY {
                        *(if is_first { &mut self.work } else { &mut self.measured.twice }) += seconds;
                    }
                }
                self.proceed(worker);
            }
            Event::Tick => {
                let now = self.now();
                self.scheduler.expire(now);
                assert!(
                    self.scheduler.failed().is_none() && self.clock < END,
                    "{:?}",
                    self.scheduler.failed()
                );
                self.wake();
                self.at(TICK, Event::Tick);
            }
            Event::Look(client) => self.look(client),
            Event::Submit(client, tasks) => {
                self.submit(client, tasks);
                self.look(client);
            }
            Event::Generation => self.begin_generation(),
        }
    }

    /// Has a worker take up its next job.
    fn start(&mut self, worker: usize) {
        if let Some((took, task)) = self.workers[worker].start(self.clock) {
            self.unstarted.remove(&task.job(0));
            if self.generation > EARLY {
                self.measured.jobs += 1.0;
            }
            self.at(took, Event::Done(worker));
        }
    }

    /// Has a worker poll.
    fn proceed(&mut self, worker: usize) {
        self.start(worker);
        let poll = self.workers[worker].poll();
        let call = self.workers[worker].call;
        self.at(MESSAGE, Event::Poll(worker, poll, call));
    }

    fn polled(&mut self, worker: usize, poll: Poll, call: u64) {
        let (sequence, wanted, now) = (poll.sequence, poll.wanted, self.now());
        let answer = self.scheduler.poll(self.workers[worker].caller, poll, now).unwrap();
        self.held.remove(&worker);
        let finished = self.scheduler.drain_finished();
        self.scheduler.drain_events();
        if answer.is_empty() && wanted > 0 {
            self.held.insert(worker, (sequence, wanted, call));
            self.at(HOLD, Event::HoldEnds(worker, call));
        } else {
            self.at(MESSAGE, Event::Reply(worker, answer, call));
        }
        self.wake();
        for finished in finished {
            self.deliver(finished);
        }
    }

    fn deliver(&mut self, finished: Finished) {
        for client in self.waiting.remove(&finished.job).unwrap_or_default() {
            let Some(asking) = self.clients.get_mut(&client) else { continue };
            asking.inbox.push(finished.clone());
            if std::mem::take(&mut asking.waits) {
                self.at(Duration::ZERO, Event::Look(client));
            }
        }
        self.results.insert(finished.job, finished);
    }

    /// Answers polls that are held back, as far as there are jobs for them.
    fn wake(&mut self) {
        let now = self.now();
        let mut is_progress = true;
        while std::mem::take(&mut is_progress) {
            for id in self.scheduler.wake(now) {
                let worker = self.workers.iter().position(|worker| worker.caller.0 == id).unwrap();
                let Some(&(sequence, wanted, call)) = self.held.get(&worker) else { continue };
                let caller = self.workers[worker].caller;
                let Ok(jobs) = self.scheduler.lease_later(caller, sequence, wanted, now) else { continue };
                if !jobs.is_empty() {
                    is_progress = true;
                    self.held.remove(&worker);
                    self.at(MESSAGE, Event::Reply(worker, Answer { jobs, ..Answer::default() }, call));
                }
            }
        }
    }

    fn begin_generation(&mut self) {
        let asked = self.generations.next(self.sides);
        (self.generation, self.generation_begun) = (self.generation + 1, self.clock);
        self.unasked = 0;
        for part in &asked.parts {
            *self.open.entry(*part).or_default() += 1;
        }
        let foreseen: Vec<ClientId> = self.clients.keys().copied().collect();
        self.ask(CLIENT, asked);
        for client in foreseen {
            self.clients.remove(&client);
            for job in self.scheduler.forget_client(client) {
                self.waiting.remove(&job);
                self.unstarted.remove(&job);
            }
        }
    }

    /// A client asks.
    fn ask(&mut self, client: ClientId, asked: Asked) {
        let Asked { evaluations, parts, scales, needed_by } = asked;
        self.scheduler.expect(client, Expected::new(&needed_by, channels_of));
        let mut batch = Batch::new(evaluations);
        let mut first = self.begin_ready(client, &mut batch, scales.len());
        self.planner.decide_scales(&scales, self.scheduler.worker_count(), &mut self.scheduler.jobs);
        let planned = scales.into_iter().map(|scale| {
            let plan = self.scheduler.jobs.plan(Task::Scale(scale.clone()).job(0)).flatten();
            self.layouts.lay_out_scale(scale, plan, &self.blobs)
        });
        first.extend(batch.begin_scales(planned.collect()));
        let open = parts.len();
        let asking = Asking { batch, parts, open, asked: BTreeMap::new(), inbox: Vec::new(), waits: false };
        self.clients.insert(client, asking);
        self.submit(client, first);
        self.look(client);
    }

    /// Begins what waits for no scale any more, and returns its first tasks.
    fn begin_ready(&mut self, client: ClientId, batch: &mut Batch, scales: usize) -> Vec<Task> {
        let (places, evaluations): (Vec<usize>, Vec<Evaluation>) = batch.take_ready().into_iter().unzip();
        let workers = self.scheduler.worker_count();
        let load = Load { jobs: self.scheduler.open_jobs(client.foresees()) + scales, workers };
        self.planner.decide(&evaluations, batch.waiting(), load, &mut self.scheduler.jobs);
        let mut tasks = Vec::new();
        for (place, evaluation) in places.into_iter().zip(evaluations) {
            let plan = self.scheduler.jobs.plan(Task::Evaluation(evaluation.clone()).job(0)).flatten();
            if let Some(plan) = plan {
                self.unasked += (plan.query.ranges * plan.database.ranges) as usize;
            }
            tasks.extend(batch.begin(place, self.layouts.lay_out(evaluation, plan, &self.blobs)));
        }
        tasks
    }

    fn submit(&mut self, client: ClientId, tasks: Vec<Task>) {
        let now = self.now();
        let Some(asking) = self.clients.get_mut(&client) else { return };
        for task in tasks {
            let (job, task) = (task.job(0), Arc::new(task));
            if let Task::Tile(_) = &*task {
                self.unasked -= 1;
            }
            asking.asked.insert(job, asking.asked.len());
            self.tasks.insert(job, Arc::clone(&task));
            if let Some(finished) = self.results.get(&job) {
                asking.inbox.push(finished.clone());
                continue;
            }
            let waiting = self.waiting.entry(job).or_default();
            waiting.push(client);
            if waiting.len() > 1 {
                self.scheduler.share(job, client, now);
            } else {
                self.unstarted.insert(job);
                self.scheduler.submit(job, task, client, now);
            }
        }
        self.wake();
    }

    /// What a client does whenever there is news.
    fn look(&mut self, client: ClientId) {
        let Some(mut asking) = self.clients.remove(&client) else { return };
        let mut further = Vec::new();
        for finished in std::mem::take(&mut asking.inbox) {
            self.planner.observe(&self.tasks[&finished.job], finished.run_seconds);
            further.extend(asking.batch.take(asking.asked[&finished.job], finished));
        }
        further.extend(self.begin_ready(client, &mut asking.batch, 0));
        let evaluated: Vec<usize> = asking.batch.evaluated().iter().map(|(index, _)| *index).collect();
        let parts: Vec<usize> = evaluated.into_iter().map(|index| asking.parts[index]).collect();
        asking.open -= parts.len();
        if asking.open == 0 {
            self.scheduler.expect_nothing(client);
        }
        if asking.open == 0 && client == CLIENT {
            self.generations.found(asking.batch.finish().1);
            if self.generation > EARLY {
                self.measured.generation += (self.clock - self.generation_begun).as_secs_f64();
            }
            self.at(BETWEEN, Event::Generation);
            return self.foresee(parts);
        }
        asking.waits = further.is_empty();
        self.clients.insert(client, asking);
        if !further.is_empty() {
            self.at(COMMIT, Event::Submit(client, further));
        }
        if client == CLIENT {
            self.foresee(parts);
        }
    }

    /// Asks for what is certain of the next generation now that an evaluation of each of these parts is done.
    fn foresee(&mut self, parts: Vec<usize>) {
        for part in parts {
            let open = self.open.get_mut(&part).unwrap();
            *open -= 1;
            if *open == 0
                && let Some(asked) = self.generations.foresee(part, self.sides)
            {
                self.foreseen += 1;
                self.ask(CLIENT.foresight(self.foreseen), asked);
            }
        }
    }
}
