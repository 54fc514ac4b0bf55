//! Spans of jobs, and where those of both programs go: built with feature `otlp`, they are exported over OTLP.
//!
//! No context travels with a job. Both sides derive the id of a session's trace and of a lease's span from what they know
//! anyway, and decide by the id of the trace whether it is sampled: workers of any build fit, and a coordinator cannot
//! have a worker export what it does not want to.

use proto::task::{Failure, Task, TaskResult};
use proto::{Lease, SessionId, WorkerId};
use tracing::Span;
use tracing::field::Empty;

use crate::log::say;

#[cfg(feature = "otlp")]
pub use otlp::{Exporter, exporter};
#[cfg(not(feature = "otlp"))]
use unavailable as otlp;

pub use otlp::{announce, layer, stop};

/// The variables that say where spans go, the first that is set.
const ENDPOINTS: [&str; 2] = ["OTEL_EXPORTER_OTLP_TRACES_ENDPOINT", "OTEL_EXPORTER_OTLP_ENDPOINT"];

/// The variable that says where spans go, unless none does or all of OpenTelemetry is turned off.
fn endpoint() -> Option<&'static str> {
    let value = |name| std::env::var(name).unwrap_or_default();
    let is_off = value("OTEL_SDK_DISABLED").eq_ignore_ascii_case("true");
    ENDPOINTS.into_iter().find(|name| !is_off && !value(name).is_empty())
}

/// The span of a job, from when it is taken up.
pub(crate) fn job(session: Option<SessionId>, worker: WorkerId, lease: &Lease, task: Option<&Task>) -> Span {
    let kind = task.map_or("", |task| task.kind().as_str());
    let task = task.map(ToString::to_string).unwrap_or_default();
    let span = tracing::debug_span!(
        "job",
        otel.kind = "consumer",
        descry.job.id = %lease.job,
        descry.job.kind = kind,
        descry.task = task,
        descry.attempt = i64::from(lease.attempt), // of other integers the layer makes texts
        descry.worker.id = %worker,
        descry.outcome = Empty,
        "error.type" = Empty,
        otel.status_code = Empty,
        otel.status_description = Empty,
    );
    if let Some(session) = session {
        otlp::adopt(&span, session, worker, lease);
    }
    span
}

/// Notes on the span of a job how it ended.
pub(crate) fn end_job(span: &Span, outcome: &Result<TaskResult, Failure>) {
    match outcome {
        Ok(_) => {
            span.record("descry.outcome", "result");
        }
        Err(failure) => {
            span.record("descry.outcome", "failure");
            span.record("error.type", tracing::field::display(&failure.reason));
            span.record("otel.status_code", "ERROR");
            span.record("otel.status_description", tracing::field::display(failure));
        }
    }
}

/// What a program does that was built without the feature.
#[cfg(not(feature = "otlp"))]
mod unavailable {
    use std::sync::Once;

    use super::*;
    use crate::log::SpanLayer;

    /// Says once that nothing is exported, if somebody asks for it.
    pub fn announce() {
        static ONCE: Once = Once::new();
        if let Some(variable) = endpoint() {
            ONCE.call_once(|| {
                say(format_args!(
                    "warning: {variable}: spans are not exported, got a program that was built without\nbuild it with --features otlp"
                ));
            });
        }
    }

    /// No spans are exported.
    pub fn layer(_service: &'static str) -> Option<SpanLayer> {
        None
    }

    pub(super) fn adopt(_span: &Span, _session: SessionId, _worker: WorkerId, _lease: &Lease) {}

    /// There is nothing to wait for.
    pub fn stop() {}
}

#[cfg(feature = "otlp")]
mod otlp {
    use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
    use std::sync::{Arc, OnceLock};
    use std::time::Duration;

    use opentelemetry::trace::{
        SpanContext, SpanId, SpanKind, TraceContextExt as _, TraceFlags, TraceId, TraceState,
        TracerProvider as _,
    };
    use opentelemetry::{Context, KeyValue};
    use opentelemetry_otlp::{SpanExporter as OtlpExporter, WithExportConfig as _};
    use opentelemetry_sdk::Resource;
    use opentelemetry_sdk::error::{OTelSdkError, OTelSdkResult};
    use opentelemetry_sdk::trace::{
        BatchConfigBuilder, BatchSpanProcessor, Config, SamplingDecision, SdkTracerProvider, ShouldSample,
        SpanData, SpanExporter, SpanProcessor,
    };
    use proto::{Digest, JobId};
    use tokio::runtime::Runtime;
    use tracing::level_filters::LevelFilter;
    use tracing_opentelemetry::OpenTelemetrySpanExt as _;
    use tracing_subscriber::Layer as _;
    use tracing_subscriber::filter::filter_fn;

    use super::*;
    use crate::log::SpanLayer;

    /// At its end a program waits for a collector that hangs no longer than this.
    const STOP_TIMEOUT: Duration = Duration::from_secs(3);
    /// Spans that may wait for export unless `OTEL_BSP_MAX_QUEUE_SIZE` says otherwise: a generation of some thousand
    /// individuals ends at once.
    const MAX_QUEUE: usize = 16_384;
    const QUEUE_VARIABLE: &str = "OTEL_BSP_MAX_QUEUE_SIZE";

    static EXPORTER: OnceLock<Exporter> = OnceLock::new();

    /// What becomes of spans.
    #[derive(Debug, Default)]
    struct Tally {
        variable: &'static str,
        ended: AtomicU64,
        exported: AtomicU64,
        /// A collector that does not work is said once.
        is_told: AtomicBool,
        /// Nothing more is tried with a collector that does not work.
        is_ending: AtomicBool,
    }

    impl Tally {
        fn tell(&self, what: &str) {
            if !self.is_told.swap(true, Ordering::Relaxed) {
                say(format_args!("warning: {}: {what}", self.variable));
            }
        }
    }

    /// Exports batches, and says so once if that fails.
    #[derive(Debug)]
    struct Telling(OtlpExporter, Arc<Tally>);

    impl SpanExporter for Telling {
        async fn export(&self, batch: Vec<SpanData>) -> OTelSdkResult {
            let Self(exporter, tally) = self;
            if tally.is_ending.load(Ordering::Relaxed) && tally.is_told.load(Ordering::Relaxed) {
                return Err(OTelSdkError::AlreadyShutdown);
            }
            let spans = batch.len() as u64;
            let done = exporter.export(batch).await;
            match &done {
                Ok(()) => {
                    tally.exported.fetch_add(spans, Ordering::Relaxed);
                }
                Err(error) => tally.tell(&format!(
                    "spans cannot be exported, got {error}\nstart a collector there that takes OTLP over gRPC; the program goes on without"
                )),
            }
            done
        }

        fn set_resource(&mut self, resource: &Resource) {
            self.0.set_resource(resource);
        }
    }

    /// Spans that wait for export. Who adds one never waits: there is a bound, and what is beyond it is lost.
    #[derive(Clone, Debug)]
    struct Queue(Arc<BatchSpanProcessor>, Arc<Tally>);

    impl SpanProcessor for Queue {
        fn on_start(&self, _: &mut opentelemetry_sdk::trace::Span, _: &Context) {}

        fn on_end(&self, span: SpanData) {
            self.1.ended.fetch_add(1, Ordering::Relaxed);
            self.0.on_end(span);
        }

        fn force_flush(&self) -> OTelSdkResult {
            self.0.force_flush()
        }

        fn shutdown_with_timeout(&self, timeout: Duration) -> OTelSdkResult {
            self.0.shutdown_with_timeout(timeout)
        }
    }

    /// Where the spans of this process go.
    pub struct Exporter {
        queue: Queue,
        sampler: Box<dyn ShouldSample>,
        provider: SdkTracerProvider,
        /// Its own, as exporting goes on where that of the program has ended or is busy.
        _runtime: Runtime,
    }

    impl Exporter {
        /// As OpenTelemetry's variables say; `service` is its name unless they give one.
        fn new(variable: &'static str, service: &'static str) -> Result<Self, String> {
            let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build();
            let runtime = runtime.map_err(|error| error.to_string())?;
            let exporter = {
                let _inside = runtime.enter();
                let endpoint = std::env::var(variable).unwrap_or_default();
                let builder = OtlpExporter::builder().with_tonic().with_endpoint(endpoint);
                builder.build().map_err(|error| error.to_string())?
            };
            let tally = Arc::new(Tally { variable, ..Tally::default() });
            let mut batches = BatchConfigBuilder::default();
            if std::env::var_os(QUEUE_VARIABLE).is_none() {
                batches = batches.with_max_queue_size(MAX_QUEUE);
            }
            let exporter = Telling(exporter, Arc::clone(&tally));
            let mut processor =
                BatchSpanProcessor::builder(exporter).with_batch_config(batches.build()).build();
            let resource = resource(service);
            processor.set_resource(&resource);
            let queue = Queue(Arc::new(processor), tally);
            let provider =
                SdkTracerProvider::builder().with_span_processor(queue.clone()).with_resource(resource);
            let sampler = Config::default().sampler;
            Ok(Self { queue, sampler, provider: provider.build(), _runtime: runtime })
        }

        /// The context of the whole trace of a session, without a span, and whether it is sampled.
        pub fn trace(&self, session: SessionId) -> (TraceId, TraceFlags) {
            let id = TraceId::from_bytes(derived("trace", &[&session.0]));
            let sampled = self.sampler.should_sample(None, id, "session", &SpanKind::Internal, &[], &[]);
            let flags = match sampled.decision {
                SamplingDecision::RecordAndSample => TraceFlags::SAMPLED,
                _ => TraceFlags::default(),
            };
            (id, flags)
        }

        /// The span of the attempt of a worker at a job.
        pub fn lease_span(session: SessionId, worker: WorkerId, job: JobId, attempt: u32) -> SpanId {
            let lease = [&session.0[..], &worker.0, &job.0.to_le_bytes(), &attempt.to_le_bytes()];
            SpanId::from_bytes(derived("lease", &lease))
        }

        /// Exports a span, some time.
        pub fn export(&self, span: SpanData) {
            self.queue.on_end(span);
        }
    }

    /// Bytes that belong to some ids, and say nothing of them.
    fn derived<const N: usize>(what: &str, ids: &[&[u8]]) -> [u8; N] {
        let digest = Digest::of(&[b"descry span 1 ", what.as_bytes(), &ids.concat()].concat());
        let mut bytes = [0; N];
        bytes.copy_from_slice(&digest.0[..N]);
        bytes
    }

    /// What this process is, unless the environment says otherwise.
    fn resource(service: &'static str) -> Resource {
        let host = hostname::get().unwrap_or_default().to_string_lossy().into_owned();
        let known = Resource::builder().build();
        let is_named = known
            .get(&"service.name".into())
            .is_some_and(|name| !name.as_str().starts_with("unknown_service"));
        let mut attributes = vec![
            KeyValue::new("service.version", env!("CARGO_PKG_VERSION")),
            KeyValue::new("host.name", host),
            KeyValue::new("process.pid", i64::from(std::process::id())),
        ];
        attributes.retain(|attribute| known.get(&attribute.key).is_none());
        let builder = Resource::builder().with_attributes(attributes);
        if is_named { builder.build() } else { builder.with_service_name(service).build() }
    }

    /// Where the spans of this process go; `None` if nobody wants them.
    pub fn exporter() -> Option<&'static Exporter> {
        EXPORTER.get()
    }

    /// There is nothing to say: spans are exported if somebody asks for it.
    pub fn announce() {}

    /// Begins to export, if there is an endpoint, and gives what hands on the spans of this crate.
    pub fn layer(service: &'static str) -> Option<SpanLayer> {
        let variable = endpoint()?;
        let exporter = match Exporter::new(variable, service) {
            Ok(exporter) => exporter,
            Err(error) => {
                say(format_args!(
                    "warning: {variable}: spans cannot be exported, got {error}\nname a collector as http://HOST:PORT that takes OTLP over gRPC"
                ));
                return None;
            }
        };
        let layer = tracing_opentelemetry::layer()
            .with_tracer(exporter.provider.tracer("descry"))
            .with_location(false)
            .with_threads(false)
            .with_target(false)
            .with_level(false)
            .with_tracked_inactivity(false);
        let _ = EXPORTER.set(exporter); // the log is started once
        // Nothing but the spans of jobs: those that exporting makes would be exported, and so on.
        let own = filter_fn(|metadata| metadata.is_span() && metadata.target().starts_with("worker"));
        Some(layer.with_filter(own.with_max_level_hint(LevelFilter::DEBUG)).boxed())
    }

    /// Makes the span of a job a child of its lease's.
    pub(super) fn adopt(span: &Span, session: SessionId, worker: WorkerId, lease: &Lease) {
        if let Some(exporter) = exporter() {
            let (trace, flags) = exporter.trace(session);
            let parent = Exporter::lease_span(session, worker, lease.job, lease.attempt);
            let parent = SpanContext::new(trace, parent, flags, true, TraceState::NONE);
            // It fails only for spans that are not recorded.
            let _ = span.set_parent(Context::new().with_remote_span_context(parent));
        }
    }

    /// Exports what is left, for a bounded time, and says so if some of it is lost.
    pub fn stop() {
        let Some(Exporter { queue, .. }) = exporter() else { return };
        let tally = &queue.1;
        tally.is_ending.store(true, Ordering::Relaxed);
        let ended = tally.ended.load(Ordering::Relaxed);
        let _ = queue.shutdown_with_timeout(STOP_TIMEOUT); // what it could not do is counted
        let lost = ended.saturating_sub(tally.exported.load(Ordering::Relaxed));
        if lost > 0 {
            tally.tell(&format!(
                "{lost} of {ended} spans were not exported: the collector is too slow\nlook at its log; {QUEUE_VARIABLE} says how many may wait"
            ));
        }
    }
}
