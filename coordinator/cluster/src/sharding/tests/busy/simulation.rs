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
use crate::job_names::JobNames;
use crate::scheduler::{Answer, ClientId, Expected, Finished, Limits, Poll, RunSecret, Scheduler};
use crate::sharding::{Batch, Layouts, Load, Planner, ShardCount};

/// The one that asks.
const CLIENT: ClientId = ClientId(1);
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
    /// The client looks for results.
    Look,
    Submit(Vec<Task>),
    Generation,
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
    batch: Option<Batch>,
    names: JobNames,
    /// Evaluations of the generation.
    evaluations: usize,
    asked: BTreeMap<JobId, (usize, Arc<Task>)>,
    inbox: Vec<Finished>,
    /// Whether news wakes the client.
    client_waits: bool,
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
        let mut scheduler = Scheduler::new(limits, RunSecret::new([7; 32]));
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
            batch: None,
            names: JobNames::default(),
            evaluations: 0,
            asked: BTreeMap::new(),
            inbox: Vec::new(),
            client_waits: false,
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
        let place = match &self.batch {
            None => &mut self.measured.between,
            Some(_) if !self.unstarted.is_empty() => &mut self.measured.waiting,
            Some(batch) if self.unasked + batch.waiting().evaluations > 0 => &mut self.measured.barrier,
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
            Event::Look => self.look(),
            Event::Submit(tasks) => {
                self.submit(tasks);
                self.look();
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
        let has_news = !finished.is_empty();
        self.inbox.extend(finished);
        self.scheduler.drain_events();
        if answer.is_empty() && wanted > 0 {
            self.held.insert(worker, (sequence, wanted, call));
            self.at(HOLD, Event::HoldEnds(worker, call));
        } else {
            self.at(MESSAGE, Event::Reply(worker, answer, call));
        }
        self.wake();
        if has_news && std::mem::take(&mut self.client_waits) {
            self.at(Duration::ZERO, Event::Look);
        }
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
        let Asked { evaluations, scales, needed_by } = self.generations.next(self.sides);
        (self.generation, self.generation_begun) = (self.generation + 1, self.clock);
        (self.evaluations, self.unasked) = (evaluations.len(), 0);
        self.asked.clear();
        self.scheduler.expect(CLIENT, Expected::new(&needed_by, channels_of));
        let mut batch = Batch::new(evaluations);
        let mut first = self.begin_ready(&mut batch, scales.len());
        self.planner.decide_scales(&scales, self.scheduler.worker_count(), &mut self.scheduler.jobs);
        let planned = scales.into_iter().map(|scale| {
            let plan = self.scheduler.jobs.plan(Task::Scale(scale.clone()).job(0)).flatten();
            self.layouts.lay_out_scale(scale, plan, &self.blobs)
        });
        first.extend(batch.begin_scales(planned.collect()));
        self.batch = Some(batch);
        self.submit(first);
        self.look();
    }

    /// Begins what waits for no scale any more, and returns its first tasks.
    fn begin_ready(&mut self, batch: &mut Batch, scales: usize) -> Vec<Task> {
        let (places, evaluations): (Vec<usize>, Vec<Evaluation>) = batch.take_ready().into_iter().unzip();
        let workers = self.scheduler.worker_count();
        let load = Load { jobs: self.scheduler.open_jobs() + scales, workers };
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

    fn submit(&mut self, tasks: Vec<Task>) {
        let now = self.now();
        for task in tasks {
            let (job, task) = (self.names.next(&task), Arc::new(task));
            assert_eq!(job, task.job(0));
            if let Task::Tile(_) = &*task {
                self.unasked -= 1;
            }
            self.unstarted.insert(job);
            self.asked.insert(job, (self.asked.len(), Arc::clone(&task)));
            self.scheduler.submit(job, task, CLIENT, now);
        }
        self.wake();
    }

    /// What a client does whenever there is news.
    fn look(&mut self) {
        let Some(mut batch) = self.batch.take() else { return };
        let mut further = Vec::new();
        for finished in std::mem::take(&mut self.inbox) {
            let (place, task) = &self.asked[&finished.job];
            self.planner.observe(task, finished.run_seconds);
            further.extend(batch.take(*place, finished));
        }
        further.extend(self.begin_ready(&mut batch, 0));
        if batch.evaluated() == self.evaluations {
            self.generations.found(batch.finish().1);
            self.scheduler.expect_nothing(CLIENT);
            if self.generation > EARLY {
                self.measured.generation += (self.clock - self.generation_begun).as_secs_f64();
            }
            self.at(BETWEEN, Event::Generation);
            return;
        }
        self.batch = Some(batch);
        if further.is_empty() {
            self.client_waits = true;
        } else {
            self.at(COMMIT, Event::Submit(further));
        }
    }
}
