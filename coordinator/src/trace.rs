//! Spans of a session, its runs, generations, jobs and leases, which feature `otlp` exports: made of the event log, so that
//! nothing that decides knows of them.

#[cfg(not(feature = "otlp"))]
use unavailable as recording;

pub use recording::{Open, Trace, interrupted};

/// What a span says beside its name and times.
#[derive(Clone, Debug, PartialEq)]
pub enum Attribute {
    /// How many.
    Count(u64),
    /// A share, from 0 to 1.
    Share(f64),
    /// A name or a word.
    Text(String),
}

/// Attributes by name.
pub type Attributes<'a> = &'a [(&'static str, Attribute)];

/// What a program does that was built without the feature: nothing.
#[cfg(not(feature = "otlp"))]
mod unavailable {
    use std::fmt::Display;
    use std::sync::Arc;

    use cluster::Cluster;
    use cluster::scheduler::ClientId;

    use super::Attributes;

    /// The spans of a session.
    pub struct Trace;

    /// A span that has begun.
    pub struct Open;

    impl Trace {
        /// Says once that nothing is exported, if somebody asks for it.
        pub fn new(_cluster: &Arc<Cluster>) -> Self {
            worker::trace::announce();
            Self
        }

        /// Nobody follows.
        pub fn follow(&self) {}

        /// A run that is not recorded.
        pub fn run(&self, _client: ClientId, _attributes: Attributes<'_>) -> Open {
            Open
        }

        /// A generation that is not recorded.
        pub fn generation(&self, _client: ClientId, _generation: u32) -> Open {
            Open
        }

        /// Nothing ends.
        pub fn end(&self, _error: Option<&dyn Display>) {}
    }

    impl Open {
        /// Nothing ends.
        pub fn end(self, _attributes: Attributes<'_>) {}

        /// Nothing ends.
        pub fn fail(self, _error: &dyn Display) {}
    }

    /// Nothing is left.
    pub fn interrupted() {}
}

#[cfg(feature = "otlp")]
mod recording {
    use std::borrow::Cow;
    use std::collections::BTreeMap;
    use std::fmt::Display;
    use std::sync::{Arc, Mutex, Weak};
    use std::time::SystemTime;

    use cluster::Cluster;
    use cluster::events::{Attempt, AttemptEnd, Departure, Event, EventCursor, EventKind};
    use cluster::scheduler::ClientId;
    use opentelemetry::trace::{SpanContext, SpanId, SpanKind, Status, TraceFlags, TraceId, TraceState};
    use opentelemetry::{InstrumentationScope, KeyValue, Value};
    use opentelemetry_sdk::trace::{IdGenerator as _, RandomIdGenerator, SpanData, SpanEvents, SpanLinks};
    use proto::task::TaskKind;
    use proto::{JobId, SessionId};
    use tokio::task::AbortHandle;
    use worker::trace::{Exporter, exporter};

    use super::{Attribute, Attributes};
    use crate::lock::lock;

    /// The session of this process: an interruption ends its spans.
    static LATEST: Mutex<Weak<Recorder>> = Mutex::new(Weak::new());

    /// The spans of a session; `None` if nobody wants them.
    pub struct Trace(Option<Arc<Recorder>>);

    /// A span that has begun; one that is dropped has not come to its end.
    pub struct Open(Option<(Arc<Recorder>, Level, ClientId)>);

    #[derive(Clone, Copy)]
    enum Level {
        Run,
        Generation,
    }

    /// What follows the event log of a session.
    struct Recorder {
        cluster: Arc<Cluster>,
        exporter: &'static Exporter,
        state: Mutex<(EventCursor, Tree)>,
        follower: Mutex<Option<AbortHandle>>,
    }

    impl Trace {
        /// Of a session that begins, if its trace is sampled.
        pub fn new(cluster: &Arc<Cluster>) -> Self {
            let sampled = exporter().map(|exporter| (exporter, exporter.trace(cluster.session)));
            let Some((exporter, (trace, _))) = sampled.filter(|(_, (_, flags))| flags.is_sampled()) else {
                return Self(None);
            };
            let tree = Tree::new(trace, cluster.session, SystemTime::now());
            let recorder = Arc::new(Recorder {
                cluster: Arc::clone(cluster),
                exporter,
                state: Mutex::new((cluster.events(), tree)),
                follower: Mutex::default(),
            });
            *lock(&LATEST) = Arc::downgrade(&recorder);
            Self(Some(recorder))
        }

        /// Exports leases as they end, from now on.
        pub fn follow(&self) {
            let Some(recorder) = &self.0 else { return };
            let (mut events, weak) = (recorder.cluster.events(), Arc::downgrade(recorder));
            let follower = tokio::spawn(async move {
                loop {
                    events.wait().await;
                    events.read();
                    let Some(recorder) = weak.upgrade() else { return };
                    recorder.change(|_, _| Vec::new());
                }
            });
            *lock(&recorder.follower) = Some(follower.abort_handle());
        }

        /// The run of a client begins.
        pub fn run(&self, client: ClientId, attributes: Attributes<'_>) -> Open {
            self.open(Level::Run, client, values(attributes))
        }

        /// A generation of a client's run begins.
        pub fn generation(&self, client: ClientId, generation: u32) -> Open {
            let number = KeyValue::new("descry.generation", i64::from(generation));
            self.open(Level::Generation, client, vec![number])
        }

        fn open(&self, level: Level, client: ClientId, attributes: Vec<KeyValue>) -> Open {
            Open(self.0.as_ref().map(|recorder| {
                recorder.change(|tree, now| {
                    tree.begin(level, client, attributes, now);
                    Vec::new()
                });
                (Arc::clone(recorder), level, client)
            }))
        }

        /// The session ends, with an error if there is one.
        pub fn end(&self, error: Option<&dyn Display>) {
            if let Some(recorder) = &self.0 {
                let status = error.map_or(Status::Unset, failed);
                recorder.change(|tree, now| tree.end_all(&status, now));
                if let Some(follower) = lock(&recorder.follower).take() {
                    follower.abort();
                }
            }
        }
    }

    impl Drop for Trace {
        fn drop(&mut self) {
            self.end(Some(&"did not come to its end"));
        }
    }

    impl Open {
        /// It has come to its end.
        pub fn end(mut self, attributes: Attributes<'_>) {
            self.close(values(attributes), &Status::Unset);
        }

        /// It has failed.
        pub fn fail(mut self, error: &dyn Display) {
            self.close(Vec::new(), &failed(error));
        }

        fn close(&mut self, attributes: Vec<KeyValue>, status: &Status) {
            if let Some((recorder, level, client)) = self.0.take() {
                recorder.change(|tree, now| tree.end(level, client, attributes, status, now));
            }
        }
    }

    impl Drop for Open {
        fn drop(&mut self) {
            self.close(Vec::new(), &failed(&"did not come to its end"));
        }
    }

    /// The program is about to end: so do all spans.
    pub fn interrupted() {
        let latest = lock(&LATEST).upgrade();
        if let Some(recorder) = latest {
            recorder.change(|tree, now| tree.end_all(&failed(&"interrupted"), now));
        }
        worker::trace::stop();
    }

    impl Recorder {
        /// Takes in what has happened, then changes the tree: what comes before a generation is none of its own. Answers
        /// are in the log before anybody is told of them.
        fn change(&self, change: impl FnOnce(&mut Tree, SystemTime) -> Vec<SpanData>) {
            let mut state = lock(&self.state);
            let (events, tree) = &mut *state;
            for event in events.read_to_end() {
                if let EventKind::Attempt(attempt) = &event.kind {
                    let asker = self.cluster.asker(attempt.job);
                    tree.attempt(&event, attempt, asker)
                        .into_iter()
                        .for_each(|span| self.exporter.export(span));
                }
            }
            change(tree, SystemTime::now()).into_iter().for_each(|span| self.exporter.export(span));
        }
    }

    fn failed(error: &(impl Display + ?Sized)) -> Status {
        // What to do about it is for the terminal.
        let error = error.to_string();
        Status::error(error.lines().next().unwrap_or_default().to_owned())
    }

    fn values(attributes: Attributes<'_>) -> Vec<KeyValue> {
        let value = |attribute: &Attribute| match attribute {
            Attribute::Count(count) => Value::I64(i64::try_from(*count).unwrap_or(i64::MAX)),
            Attribute::Share(share) => Value::F64(*share),
            Attribute::Text(text) => Value::from(text.clone()),
        };
        attributes.iter().map(|(name, attribute)| KeyValue::new(*name, value(attribute))).collect()
    }

    /// A span without its end.
    struct Begun {
        id: SpanId,
        parent: SpanId,
        name: Cow<'static, str>,
        start: SystemTime,
        attributes: Vec<KeyValue>,
    }

    impl Begun {
        fn new(
            parent: SpanId,
            name: impl Into<Cow<'static, str>>,
            start: SystemTime,
            attributes: Vec<KeyValue>,
        ) -> Self {
            let id = RandomIdGenerator::default().new_span_id();
            Self { id, parent, name: name.into(), start, attributes }
        }
    }

    /// A job that was leased at least once and is not answered.
    struct Job {
        span: Begun,
        attempts: i64,
    }

    /// Answered jobs whose late attempts find them.
    const MAX_ANSWERED: usize = 100_000;

    /// The spans of one start of a session: which are open, and what is whose child. Without IO; time is an argument.
    struct Tree {
        trace: TraceId,
        session: SessionId,
        scope: InstrumentationScope,
        root_id: SpanId,
        /// `None`: it has ended.
        root: Option<Begun>,
        runs: BTreeMap<ClientId, Begun>,
        generations: BTreeMap<ClientId, Begun>,
        jobs: BTreeMap<JobId, Job>,
        answered: BTreeMap<JobId, SpanId>,
    }

    impl Tree {
        fn new(trace: TraceId, session: SessionId, now: SystemTime) -> Self {
            let attributes = vec![KeyValue::new("descry.session.id", session.to_string())];
            let root = Begun::new(SpanId::INVALID, "session", now, attributes);
            Self {
                trace,
                session,
                scope: InstrumentationScope::builder("descry")
                    .with_version(env!("CARGO_PKG_VERSION"))
                    .build(),
                root_id: root.id,
                root: Some(root),
                runs: BTreeMap::new(),
                generations: BTreeMap::new(),
                jobs: BTreeMap::new(),
                answered: BTreeMap::new(),
            }
        }

        fn begin(&mut self, level: Level, client: ClientId, attributes: Vec<KeyValue>, now: SystemTime) {
            match level {
                Level::Run => {
                    self.runs.insert(client, Begun::new(self.root_id, "run", now, attributes));
                }
                Level::Generation => {
                    let run = self.runs.get(&client).map_or(self.root_id, |run| run.id);
                    self.generations.insert(client, Begun::new(run, "generation", now, attributes));
                }
            }
        }

        fn end(
            &mut self,
            level: Level,
            client: ClientId,
            attributes: Vec<KeyValue>,
            status: &Status,
            now: SystemTime,
        ) -> Vec<SpanData> {
            let begun = match level {
                Level::Run => self.runs.remove(&client),
                Level::Generation => self.generations.remove(&client),
            };
            let Some(mut begun) = begun else { return Vec::new() };
            begun.attributes.extend(attributes);
            vec![self.data(begun, now, status.clone(), SpanKind::Internal)]
        }

        /// Ends all that is open, once.
        fn end_all(&mut self, status: &Status, now: SystemTime) -> Vec<SpanData> {
            let Some(root) = self.root.take() else { return Vec::new() };
            let jobs = std::mem::take(&mut self.jobs).into_values().map(|job| job.span);
            let generations = std::mem::take(&mut self.generations).into_values();
            let runs = std::mem::take(&mut self.runs).into_values();
            let open: Vec<Begun> = jobs.chain(generations).chain(runs).chain([root]).collect();
            open.into_iter().map(|span| self.data(span, now, status.clone(), SpanKind::Internal)).collect()
        }

        /// An attempt that has ended: its lease, and its job, if this is the answer.
        fn attempt(&mut self, event: &Event, attempt: &Attempt, asker: Option<ClientId>) -> Vec<SpanData> {
            let Attempt { job, number, task, kind, worker, label, run_seconds, end, .. } = attempt;
            let start = attempt.leased_at(event.at);
            let kind = kind.map_or("", TaskKind::as_str);
            let of_job = vec![
                KeyValue::new("descry.job.id", job.to_string()),
                KeyValue::new("descry.job.kind", kind),
                KeyValue::new("descry.task", task.clone()),
            ];
            // Nobody has asked for what checks a result.
            let only = || self.runs.keys().next().copied().filter(|_| self.runs.len() == 1);
            let asker = asker.or_else(only);
            let open =
                asker.and_then(|client| self.generations.get(&client).or_else(|| self.runs.get(&client)));
            let within = open.map_or(self.root_id, |span| span.id);
            let parent = match self.answered.get(job) {
                Some(id) => *id,
                None => {
                    let entry = self.jobs.entry(*job).or_insert_with(|| Job {
                        span: Begun::new(within, kind, start, of_job.clone()),
                        attempts: 0,
                    });
                    entry.attempts += 1;
                    entry.span.start = entry.span.start.min(start);
                    entry.span.id
                }
            };
            let is_answer = matches!(end, AttemptEnd::Answered | AttemptEnd::Agreed | AttemptEnd::Late);
            let answered = if is_answer { self.jobs.remove(job) } else { None };
            if answered.is_some() {
                self.answered.insert(*job, parent);
                if self.answered.len() > MAX_ANSWERED {
                    self.answered.pop_first(); // ids are hashes: any of them
                }
            }
            let mut lease = Begun::new(parent, "lease", start, of_job);
            // The end of an attempt that is given up comes before its late result.
            if *end != AttemptEnd::Late {
                lease.id = Exporter::lease_span(self.session, *worker, *job, *number);
            }
            lease.attributes.extend([
                KeyValue::new("descry.attempt", i64::from(*number)),
                KeyValue::new("descry.outcome", end.as_str()),
                KeyValue::new("descry.worker.id", worker.to_string()),
                KeyValue::new("descry.worker.name", label.clone()),
            ]);
            lease.attributes.extend(run_seconds.map(|seconds| KeyValue::new("descry.run_seconds", seconds)));
            let mut status = Status::Unset;
            if is_error(end) {
                lease.attributes.push(KeyValue::new("error.type", end.as_str()));
                status = failed(end.reason().unwrap_or(end.as_str()));
            }
            let mut ended = vec![self.data(lease, event.at, status, SpanKind::Producer)];
            if let Some(Job { mut span, attempts }) = answered {
                span.attributes.push(KeyValue::new("descry.attempts", attempts));
                ended.push(self.data(span, event.at, Status::Unset, SpanKind::Internal));
            }
            ended
        }

        fn data(&self, span: Begun, end: SystemTime, status: Status, kind: SpanKind) -> SpanData {
            let Begun { id, parent, name, start, attributes } = span;
            SpanData {
                span_context: SpanContext::new(self.trace, id, TraceFlags::SAMPLED, false, TraceState::NONE),
                parent_span_id: parent,
                parent_span_is_remote: false,
                span_kind: kind,
                name,
                start_time: start,
                end_time: end.max(start),
                attributes,
                dropped_attributes_count: 0,
                events: SpanEvents::default(),
                links: SpanLinks::default(),
                status,
                instrumentation_scope: self.scope.clone(),
            }
        }
    }

    /// Whether an attempt came to nothing that should have come to something.
    fn is_error(end: &AttemptEnd) -> bool {
        match end {
            AttemptEnd::Answered | AttemptEnd::Agreed | AttemptEnd::Late => false,
            AttemptEnd::Revoked | AttemptEnd::Dropped | AttemptEnd::Gone(Departure::Left) => false,
            AttemptEnd::Disagreed
            | AttemptEnd::Failed(_)
            | AttemptEnd::Overdue
            | AttemptEnd::Undelivered
            | AttemptEnd::Gone(_) => true,
        }
    }

    #[cfg(test)]
    mod tests {
        use std::time::Duration;

        use proto::WorkerId;

        use super::*;

        const SESSION: SessionId = SessionId([7; 16]);
        const CLIENT: ClientId = ClientId::new(1);

        fn at(seconds: u64) -> SystemTime {
            SystemTime::UNIX_EPOCH + Duration::from_secs(seconds)
        }

        fn tree() -> Tree {
            let mut tree = Tree::new(TraceId::from_bytes([1; 16]), SESSION, at(0));
            tree.begin(Level::Run, CLIENT, Vec::new(), at(1));
            tree.begin(Level::Generation, CLIENT, Vec::new(), at(2));
            tree
        }

        /// What an attempt at a job that has ended at some time, a second after it was leased, leaves.
        fn ended(tree: &mut Tree, job: u64, number: u32, seconds: u64, end: AttemptEnd) -> Vec<SpanData> {
            let attempt = Attempt {
                job: JobId(job),
                number,
                task: "grid cell of x".to_owned(),
                kind: Some(TaskKind::GridCell),
                worker: WorkerId([number as u8; 16]),
                label: format!("host-{number}"),
                held_seconds: 1.0,
                run_seconds: None,
                end,
            };
            let kind = EventKind::Attempt(attempt.clone());
            let event = Event { sequence: 0, at: at(seconds), kind, omitted: false };
            tree.attempt(&event, &attempt, Some(CLIENT))
        }

        fn names(spans: &[SpanData]) -> Vec<&str> {
            spans.iter().map(|span| &*span.name).collect()
        }

        fn attribute(span: &SpanData, name: &str) -> String {
            let of_name = span.attributes.iter().filter(|attribute| attribute.key.as_str() == name);
            of_name.map(|attribute| attribute.value.to_string()).collect()
        }

        #[test]
        fn a_lost_lease_is_an_error_and_its_job_lasts_until_another_worker_answers() {
            let mut tree = tree();
            let generation = tree.generations[&CLIENT].id;
            let lost = ended(&mut tree, 5, 1, 4, AttemptEnd::Gone(Departure::Lost));
            let answered = ended(&mut tree, 5, 2, 9, AttemptEnd::Answered);
            assert_eq!((names(&lost), names(&answered)), (vec!["lease"], vec!["lease", "grid cell"]));
            let [lost, lease, job] = [&lost[0], &answered[0], &answered[1]];
            assert_eq!(lost.status, Status::error("no sign of life within the lease"));
            assert_eq!(attribute(lost, "error.type"), "lost");
            assert_eq!((&lease.status, &job.status), (&Status::Unset, &Status::Unset));
            assert_eq!((job.start_time, job.end_time), (at(3), at(9)));
            assert_eq!((lease.start_time, lease.end_time), (at(8), at(9)));
            assert_eq!(attribute(job, "descry.attempts"), "2");
            assert_eq!(job.parent_span_id, generation);
            for (number, lease) in [(1, lost), (2, lease)] {
                assert_eq!(lease.parent_span_id, job.span_context.span_id());
                // What the worker takes for the parent of its own span.
                let known = Exporter::lease_span(SESSION, WorkerId([number; 16]), JobId(5), number.into());
                assert_eq!(lease.span_context.span_id(), known);
            }
        }

        #[test]
        fn what_ends_late_finds_its_job_and_no_two_spans_have_one_id() {
            let mut tree = tree();
            let overdue = ended(&mut tree, 5, 1, 4, AttemptEnd::Overdue);
            let answered = ended(&mut tree, 5, 2, 6, AttemptEnd::Answered);
            let first = tree.end(Level::Generation, CLIENT, Vec::new(), &Status::Unset, at(7));
            tree.begin(Level::Generation, CLIENT, Vec::new(), at(7));
            let late = ended(&mut tree, 5, 1, 8, AttemptEnd::Late);
            assert_eq!(names(&late), ["lease"], "the job is exported once");
            assert_eq!(late[0].parent_span_id, answered[1].span_context.span_id());
            assert_eq!(answered[1].parent_span_id, first[0].span_context.span_id());
            let all = [overdue, answered, late].concat();
            let ids: std::collections::BTreeSet<_> =
                all.iter().map(|span| span.span_context.span_id().to_bytes()).collect();
            assert_eq!(ids.len(), all.len());
            assert!(tree.jobs.is_empty());
        }

        #[test]
        fn an_end_before_its_time_ends_everything_once() {
            let mut tree = tree();
            ended(&mut tree, 5, 1, 4, AttemptEnd::Failed("out of memory".to_owned()));
            let all = tree.end_all(&failed(&"interrupted\ngo on"), at(5));
            assert_eq!(names(&all), ["grid cell", "generation", "run", "session"]);
            assert!(all.iter().all(|span| span.status == Status::error("interrupted")), "{all:?}");
            for pair in all.windows(2) {
                assert_eq!(pair[0].parent_span_id, pair[1].span_context.span_id());
            }
            assert!(tree.end_all(&Status::Unset, at(6)).is_empty());
            assert!(tree.end(Level::Run, CLIENT, Vec::new(), &Status::Unset, at(6)).is_empty());
        }
    }
}
