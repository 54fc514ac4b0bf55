//! Workers, a network and a coordinator on one virtual clock.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use descriptor::random::stream;
use proto::{Introduction, Lease, Principal, WorkerId};
use rand::RngExt;

use super::super::{
    Answer, Audit, Channel, ClientId, Limits, MAX_PRIORITY, Poll, PollRefusal, RunSecret, Scheduler,
};
use super::actor::{Actor, Nature, by_address};
use super::driver::{CLIENTS, Driver};
use super::mishaps::Mishaps;
use crate::scheduler::worker::Worker;
use crate::store::Job;

const TICK: Duration = Duration::from_millis(500);
const HOLD: Duration = Duration::from_secs(10);
const HEARTBEAT: Duration = Duration::from_secs(5);
/// A worker gives up a call after so long.
const TIMEOUT: Duration = Duration::from_secs(20);
/// A worker is called within so long although others, who do not hear it, were called before.
const NEGLECT: Duration = Duration::from_secs(5);
/// Nothing goes wrong any more after so long.
const CALM: Duration = Duration::from_secs(400);
/// Everything is done after so long: the slowest worker alone needs less for all tasks from when it is calm.
const END: Duration = Duration::from_secs(3_000);

/// Something that happens at its time.
enum Happening {
    /// A registration or a poll reaches the coordinator.
    Register(usize),
    Poll(usize, Poll, u64),
    /// A reply reaches a worker, unless it has given up that call.
    Registered(usize, bool),
    Reply(usize, Result<Answer, PollRefusal>, u64),
    /// A poll has been held back for long enough.
    HoldEnds(usize, u64),
    /// A worker gives up a call, or is due to poll.
    Timeout(usize, u64),
    /// A job is done.
    Done(usize),
    /// The coordinator looks around.
    Tick,
    /// The next generation.
    Submit,
    Mishap,
    Join(Nature, Principal),
    /// An operator lets a client go on, or a worker.
    Resume(ClientId),
    EndDrain(WorkerId),
    /// A worker asks for jobs again.
    EndHang(usize),
}

/// One schedule.
pub struct World {
    random: chacha20::ChaCha8Rng,
    scheduler: Scheduler,
    driver: Driver,
    actors: Vec<Actor>,
    agenda: BTreeMap<(Duration, u64), Happening>,
    happenings: u64,
    begun: Instant,
    clock: Duration,
    /// The coordinator is stopped until then.
    deaf_until: Duration,
    /// Polls that are held back: how many jobs are wanted and which call it is.
    held: BTreeMap<usize, (u64, usize, u64)>,
    /// Workers whose poll is held back although there is a job, since when.
    neglected: BTreeMap<usize, Duration>,
    /// Chance in 100 that a message is lost.
    loss: u32,
    generations: u32,
    next_task: u32,
    mishaps: Mishaps,
}

impl World {
    pub fn new(seed: u64) -> Self {
        let mut random = stream(seed, "simulation", &[]);
        let liars = random.random_range(0..3u32);
        // Whoever lies from the beginning is found whatever the share, for the first answers of all are audited.
        let share = [0.0, 0.3, 1.0][random.random_range(0..3usize)];
        let limits = Limits {
            lease: Duration::from_secs(30),
            job: Duration::from_secs(200),
            max_failures: [3, u32::MAX][random.random_range(0..2usize)],
            max_losses: [5, u32::MAX][random.random_range(0..2usize)],
            worker_grace: Duration::from_secs(100_000),
            max_workers: 100,
            audit: Audit { share, first: [2, 10][random.random_range(0..2usize)] },
            check_description: |_, _, _| Ok(()),
            channels_of: |descriptor| {
                let numbers = descriptor.bytes().iter().map(|byte| u64::from(byte % 8));
                numbers.map(|number| Channel { number, cost: 1 + number }).collect()
            },
        };
        let mut world = Self {
            scheduler: Scheduler::new(limits, RunSecret::new([seed as u8; 32]), None),
            driver: Driver::default(),
            actors: Vec::new(),
            agenda: BTreeMap::new(),
            happenings: 0,
            begun: Instant::now(),
            clock: Duration::ZERO,
            deaf_until: Duration::ZERO,
            held: BTreeMap::new(),
            neglected: BTreeMap::new(),
            loss: random.random_range(0..30),
            generations: 3,
            next_task: 8,
            mishaps: Mishaps::default(),
            random,
        };
        // Three honest principals, of which one may have several workers; liars that stand for themselves, or are many
        // ids of one; and sick ones. In some schedules the coordinator works, too.
        let mut cast: Vec<(Nature, Principal)> =
            (1..=3).map(|number| (Nature::Honest, by_address(number))).collect();
        cast.extend((0..world.below(3)).map(|_| (Nature::Honest, by_address(3))));
        let sybil = world.below(2) == 0;
        world.mishaps.sybils += u64::from(sybil && liars > 1);
        cast.extend(
            (0..liars).map(|liar| (Nature::Lying, by_address(if sybil { 10 } else { 10 + liar as u8 }))),
        );
        cast.push((Nature::Failing, by_address(20)));
        cast.extend((0..world.below(3)).map(|sick| (Nature::Sick, by_address(30 + sick as u8))));
        if world.below(3) == 0 {
            let nature = if world.below(2) == 0 { Nature::Honest } else { Nature::Failing };
            cast.push((nature, Principal::Coordinator));
        }
        for (nature, principal) in cast {
            world.soon(30_000, Happening::Join(nature, principal));
        }
        world.at(Duration::ZERO, Happening::Tick);
        world.at(Duration::ZERO, Happening::Submit);
        world.soon(60_000, Happening::Mishap);
        world
    }

    /// Plays the schedule to its end.
    pub fn run(mut self) -> Mishaps {
        while let Some(((time, _), happening)) = self.agenda.pop_first() {
            self.clock = time;
            self.happens(happening);
            self.scheduler.check_invariants();
            if self.generations == 0 && self.is_over() {
                self.driver.check();
                self.check_quarantined();
                self.scheduler.close(self.now());
                self.scheduler.check_invariants();
                return self.mishaps;
            }
            assert!(self.clock < END, "{} answers are missing", self.driver.missing());
        }
        unreachable!("the coordinator always looks around once more")
    }

    /// Whether every task has its result, given that there is somebody to doubt it.
    fn is_over(&self) -> bool {
        self.scheduler.present.len() >= 2 && self.driver.is_done(&self.scheduler)
    }

    fn check_quarantined(&mut self) {
        for actor in &self.actors {
            assert!(!actor.quarantined || actor.nature == Nature::Lying, "an honest worker was quarantined");
        }
        self.mishaps.disagreed = self.driver.disagreements;
        self.mishaps.quarantined = self.driver.quarantined.len() as u64;
        self.mishaps.excluded = self.driver.excluded;
        let is_liar = |principal: &Principal| {
            self.actors.iter().all(|actor| actor.principal != *principal || actor.nature == Nature::Lying)
        };
        assert!(self.driver.quarantined.iter().all(is_liar), "{:?}", self.driver.quarantined);
    }

    /// No job waits while a worker that may have it waits, too, unless another was called for it; and that one was
    /// heard, or the next is called soon.
    fn check_nobody_is_left_waiting(&mut self) {
        let mut neglected = BTreeMap::new();
        if self.clock < self.deaf_until {
            return;
        }
        for (index, (sequence, _, _)) in &self.held {
            let id = self.actors[*index].id;
            let fresh = self.scheduler.workers.get(&id).is_some_and(|worker| worker.sequence == *sequence);
            if fresh && self.scheduler.next_job(id, self.now()).is_some() {
                assert_eq!(self.scheduler.queue.wakeups(self.now()), 0, "worker {index} was not called");
                let since = self.neglected.get(index).copied().unwrap_or(self.clock);
                assert!(self.clock - since < NEGLECT, "worker {index} is not called");
                neglected.insert(*index, since);
            }
        }
        self.neglected = neglected;
    }

    fn happens(&mut self, happening: Happening) {
        let heard = matches!(
            happening,
            Happening::Register(_)
                | Happening::Poll(..)
                | Happening::HoldEnds(..)
                | Happening::Tick
                | Happening::Resume(_)
                | Happening::EndDrain(_)
        );
        if heard && self.clock < self.deaf_until {
            self.neglected.clear();
            self.at(self.deaf_until, happening);
            return;
        }
        match happening {
            Happening::Register(actor) => self.register(actor),
            Happening::Poll(actor, poll, call) => self.polled(actor, poll, call),
            Happening::Registered(actor, welcome) => self.registered(actor, welcome),
            Happening::Reply(actor, reply, call) => self.replied(actor, reply, call),
            Happening::HoldEnds(actor, call) => self.hold_ends(actor, call),
            Happening::Timeout(actor, call) if self.actors[actor].call == call => self.speak(actor),
            Happening::Timeout(..) => {}
            Happening::Done(actor) => self.done(actor),
            Happening::Tick => self.tick(),
            Happening::Submit => self.submit(),
            Happening::Mishap => self.mishap(),
            Happening::Join(nature, principal) => self.join(nature, principal),
            Happening::Resume(client) => {
                self.scheduler.resume(client);
                self.look();
            }
            Happening::EndDrain(id) => {
                self.scheduler.end_drain(id);
                self.look();
            }
            Happening::EndHang(actor) => self.actors[actor].hangs = false,
        }
    }

    // The workers' side.

    fn join(&mut self, nature: Nature, principal: Principal) {
        let slowness = if self.below(4) == 0 { 10 } else { 1 };
        self.actors.push(Actor::new(self.actors.len(), (nature, principal), slowness));
        self.speak(self.actors.len() - 1);
    }

    /// A worker registers or polls, and gives up what it has said before.
    fn speak(&mut self, index: usize) {
        let actor = &mut self.actors[index];
        if actor.dead || actor.quarantined {
            return;
        }
        actor.call += 1;
        let call = actor.call;
        let said = match actor.registered {
            true => Happening::Poll(index, actor.poll(false), call),
            false => Happening::Register(index),
        };
        self.send(index, said);
        self.at(self.clock + TIMEOUT, Happening::Timeout(index, call));
    }

    fn registered(&mut self, index: usize, welcome: bool) {
        self.actors[index].registered = welcome;
        self.actors[index].quarantined = !welcome;
        self.speak(index);
    }

    fn replied(&mut self, index: usize, reply: Result<Answer, PollRefusal>, call: u64) {
        let actor = &mut self.actors[index];
        if actor.call != call || actor.dead {
            return;
        }
        match reply {
            Ok(answer) => actor.absorb(&answer),
            Err(PollRefusal::UnknownWorker) => actor.registered = false,
            Err(PollRefusal::Quarantined) => actor.quarantined = true,
            Err(PollRefusal::Stale) => {}
        }
        self.start(index);
        let actor = &mut self.actors[index];
        if !actor.registered || actor.wanted() > 0 || actor.has_reports() {
            self.speak(index);
        } else {
            actor.call += 1;
            let call = actor.call;
            self.at(self.clock + HEARTBEAT, Happening::Timeout(index, call));
        }
    }

    fn start(&mut self, index: usize) {
        if self.actors[index].start() {
            let milliseconds = 500 + self.below(5_000) * self.actors[index].slowness;
            self.soon_after(milliseconds, Happening::Done(index));
        }
    }

    fn done(&mut self, index: usize) {
        if self.actors[index].dead {
            return;
        }
        let fails = self.clock < CALM && self.below(3) == 0;
        self.mishaps.failed += u64::from(fails && self.actors[index].nature == Nature::Failing);
        self.actors[index].finish(fails, self.clock < CALM);
        self.start(index);
        self.speak(index);
    }

    // The network.

    /// Sends a message from or to a worker: it may be lost, doubled and overtaken.
    fn send(&mut self, index: usize, message: Happening) {
        let calm = self.clock >= CALM;
        if self.clock < self.actors[index].cut_until || !calm && self.below(100) < self.loss {
            self.mishaps.lost += 1;
            return;
        }
        if let Happening::Poll(index, poll, call) = &message
            && !calm
            && self.below(20) == 0
        {
            let (index, call) = (*index, *call);
            let (held, finished) = (poll.held.clone(), poll.finished.clone());
            self.soon(15_000, Happening::Poll(index, Poll { held, finished, ..*poll }, call));
            self.mishaps.doubled += 1;
        }
        let slow = !calm && self.below(10) == 0;
        self.soon(if slow { 25_000 } else { 50 }, message);
    }

    // The coordinator's side.

    fn register(&mut self, index: usize) {
        let actor = &self.actors[index];
        let name = format!("{:?}", actor.nature);
        let principal = actor.principal;
        let introduction = Introduction { name, threads: 1, build: String::new(), principal };
        let welcome = self.scheduler.register(actor.id, introduction, self.now()).is_ok();
        self.send(index, Happening::Registered(index, welcome));
    }

    fn polled(&mut self, index: usize, poll: Poll, call: u64) {
        let (id, sequence, wanted, held) =
            (self.actors[index].id, poll.sequence, poll.wanted, poll.held.clone());
        let caller = (id, self.actors[index].principal);
        let reply = self.scheduler.poll(caller, poll, self.now());
        if let (Ok(answer), Some(worker)) = (&reply, self.scheduler.workers.get(&id)) {
            let new = |lease: &Lease| answer.jobs.iter().any(|(job, _)| job == lease);
            let secret = &self.scheduler.secret;
            let mut booked = worker
                .leases()
                .iter()
                .map(|&(job, attempt)| secret.lease(job, attempt, (id, worker.principal)));
            assert!(booked.all(|lease| held.contains(&lease) || new(&lease)), "worker {index} has less");
        }
        match reply {
            Ok(answer) if answer.is_empty() && wanted > 0 => {
                self.held.insert(index, (sequence, wanted, call));
                self.at(self.clock + HOLD, Happening::HoldEnds(index, call));
            }
            reply => self.send(index, Happening::Reply(index, reply, call)),
        }
        self.look();
    }

    fn hold_ends(&mut self, index: usize, call: u64) {
        if self.held.get(&index).is_some_and(|(_, _, held)| *held == call) {
            self.held.remove(&index);
            self.send(index, Happening::Reply(index, Ok(Answer::default()), call));
        }
    }

    fn look(&mut self) {
        let now = self.now();
        self.driver.look(&mut self.scheduler, now);
        let mut called = self.scheduler.wake(now);
        while let Some(id) = called.pop() {
            let index = self.actors.iter().position(|actor| actor.id == id).expect("a worker");
            let Some((sequence, wanted, call)) = self.held.remove(&index) else { continue };
            let caller = (id, self.actors[index].principal);
            match self.scheduler.lease_later(caller, sequence, wanted, now) {
                Ok(jobs) if jobs.is_empty() => drop(self.held.insert(index, (sequence, wanted, call))),
                Ok(jobs) => {
                    let answer = Answer { jobs, ..Answer::default() };
                    self.send(index, Happening::Reply(index, Ok(answer), call));
                }
                Err(refusal) => self.send(index, Happening::Reply(index, Err(refusal), call)),
            }
            called.extend(self.scheduler.wake(now));
        }
        self.check_nobody_is_left_waiting();
    }

    fn tick(&mut self) {
        self.scheduler.expire(self.now());
        self.look();
        let is_passive = |worker: &Worker| worker.is_left_out() && !worker.draining;
        self.mishaps.passive +=
            self.scheduler.workers.values().filter(|worker| is_passive(worker)).count() as u64;
        let is_tried = |job: &Job| {
            let mut idle = self.scheduler.present.keys().filter(|principal| !job.answered_by(**principal));
            idle.any(|principal| !self.scheduler.may_answer(*principal, job))
        };
        self.mishaps.tried += self.scheduler.jobs.iter().filter(|(_, job)| is_tried(job)).count() as u64;
        self.at(self.clock + TICK, Happening::Tick);
    }

    fn submit(&mut self) {
        let now = self.now();
        self.driver.ask_foreseen(&mut self.scheduler, now);
        self.look();
        if self.generations > 0 && self.driver.is_done(&self.scheduler) {
            let now = self.now();
            for _ in 0..1 + self.below(8) {
                self.driver.submit(&mut self.scheduler, self.next_task, now);
                self.next_task += 1;
            }
            self.generations -= 1;
            self.look();
        }
        if self.generations > 0 || self.driver.has_foreseen() {
            self.soon(5_000, Happening::Submit);
        }
    }

    /// Something goes wrong.
    fn mishap(&mut self) {
        if self.clock >= CALM {
            return;
        }
        let index = self.below(self.actors.len().max(1) as u32) as usize;
        let what = self.below(9);
        self.steal();
        match what {
            0 => {
                // The machine's connections are reset: nothing that is under way arrives.
                let messages = |happening: &Happening| {
                    matches!(
                        happening,
                        Happening::Register(_)
                            | Happening::Poll(..)
                            | Happening::Registered(..)
                            | Happening::Reply(..)
                    )
                };
                self.agenda.retain(|_, happening| !messages(happening));
                self.held.clear();
                self.mishaps.reconnected += 1;
            }
            1 => {
                // What was put off until the end of one pause must not miss the end of another.
                let until = self.clock + Duration::from_secs(self.below(60).into());
                self.deaf_until = self.deaf_until.max(until);
                self.mishaps.paused += 1;
            }
            5 | 6 => {
                let client = ClientId::new(self.below(CLIENTS));
                if what == 5 && self.scheduler.pause(client) {
                    self.mishaps.held += 1;
                    self.later(Happening::Resume(client));
                } else {
                    let priority = 1 + self.below(MAX_PRIORITY);
                    self.scheduler.set_priority(client, priority);
                    self.mishaps.prioritised += 1;
                }
            }
            _ if index >= self.actors.len() || self.actors[index].dead => {}
            2 => {
                self.actors[index].cut_until = self.clock + Duration::from_secs(self.below(100).into());
                self.mishaps.cut += 1;
            }
            7 => {
                let id = self.actors[index].id;
                if self.scheduler.drain(id, self.now()).is_some() {
                    self.mishaps.drained += 1;
                    self.later(Happening::EndDrain(id));
                }
            }
            8 => {
                self.actors[index].hangs = true;
                self.mishaps.hung += 1;
                let end = self.clock + Duration::from_secs(self.below(400).into());
                self.at(end.min(CALM), Happening::EndHang(index));
            }
            what => {
                let actor = &mut self.actors[index];
                if what == 3 {
                    let (goodbye, call) = (actor.poll(true), actor.call);
                    self.send(index, Happening::Poll(index, goodbye, call));
                    self.mishaps.left += 1;
                } else {
                    self.mishaps.crashed += 1;
                }
                let actor = &mut self.actors[index];
                actor.dead = true;
                let (nature, principal) = (actor.nature, actor.principal);
                self.soon(60_000, Happening::Join(nature, principal));
            }
        }
        self.soon(60_000, Happening::Mishap);
    }

    /// A liar speaks in the name of others: it locks them out, takes their leave, and reports on what was leased to them.
    fn steal(&mut self) {
        let Some(thief) =
            self.actors.iter().position(|actor| actor.nature == Nature::Lying && actor.registered)
        else {
            return;
        };
        let now = self.now();
        let (id, principal) = (self.actors[thief].id, self.actors[thief].principal);
        let others = self.actors.iter().filter(|actor| actor.principal != principal);
        let victims: Vec<(proto::WorkerId, Vec<Lease>)> =
            others.map(|actor| (actor.id, actor.held())).collect();
        for (victim, leases) in victims {
            let poll = Poll { sequence: u64::MAX, leaving: true, ..Poll::default() };
            assert!(self.scheduler.poll((victim, principal), poll, now).is_err(), "{victim} was robbed");
            let votes = |scheduler: &Scheduler, lease: &Lease| {
                scheduler.jobs.get(lease.job).map(|job| job.votes.len())
            };
            let before: Vec<_> = leases.iter().map(|lease| votes(&self.scheduler, lease)).collect();
            let sequence = self.scheduler.workers.get(&id).map_or(0, |worker| worker.sequence);
            let held = self.scheduler.workers.get(&id).map_or_else(Vec::new, |worker| {
                let lease =
                    |&(job, attempt): &(_, _)| self.scheduler.secret.lease(job, attempt, (id, principal));
                worker.leases().iter().map(lease).collect()
            });
            let finished = leases.iter().map(|lease| self.actors[thief].lie_about(*lease)).collect();
            self.actors[thief].sequence = self.actors[thief].sequence.max(sequence + 1);
            let poll = Poll { sequence: sequence + 1, held, finished, ..Poll::default() };
            let _ = self.scheduler.poll((id, principal), poll, now);
            let after: Vec<_> = leases.iter().map(|lease| votes(&self.scheduler, lease)).collect();
            assert_eq!(before, after, "a lease of {victim} was used by another");
            self.mishaps.stolen += leases.len() as u64;
        }
        self.look();
    }

    // Time and chance.

    fn now(&self) -> Instant {
        self.begun + self.clock
    }

    fn at(&mut self, time: Duration, happening: Happening) {
        self.happenings += 1;
        self.agenda.insert((time, self.happenings), happening);
    }

    fn soon_after(&mut self, milliseconds: u32, happening: Happening) {
        self.at(self.clock + Duration::from_millis(milliseconds.into()), happening);
    }

    /// Within a minute, and not after it is calm.
    fn later(&mut self, happening: Happening) {
        let after = Duration::from_secs(self.below(60).into());
        self.at((self.clock + after).min(CALM), happening);
    }

    /// Within so many milliseconds.
    fn soon(&mut self, milliseconds: u32, happening: Happening) {
        let after = self.below(milliseconds);
        self.soon_after(after, happening);
    }

    fn below(&mut self, limit: u32) -> u32 {
        self.random.random_range(0..limit)
    }
}
