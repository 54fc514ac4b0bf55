"""A receiver of OTLP over gRPC has the spans of a run and of its workers, and one that does not work changes nothing.

Usage: otlp.py PROGRAMS OUT_DIR [--without PROGRAMS] [--overhead N [--experiment FILE]]

Needs grpcio and opentelemetry-proto (pip). PROGRAMS is a folder with coordinator and worker, built with --features otlp;
--without names one with programs that were built without. Two workers compute a run; one of them is killed while it holds
a lease. Checks the tree of spans across the processes, names and attributes, interruption and resumption, sampling, the
environment's variables, and that collectors that are down, hang or refuse cost one warning and no digest. --overhead
measures runs with and without export, in turns, so many times each, and prints ratios.
"""

import argparse
import collections
import concurrent.futures
import json
import os
import pathlib
import re
import resource
import shutil
import signal
import socket
import statistics
import subprocess
import threading
import time

import grpc
import waiting
from opentelemetry.proto.collector.trace.v1 import trace_service_pb2, trace_service_pb2_grpc

REPOSITORY = pathlib.Path(__file__).parents[2]
PATIENCE = 300  # seconds
ENDPOINT = "OTEL_EXPORTER_OTLP_ENDPOINT"
ERROR = 2  # status code
STAGES = {"fetch", "prepare", "describe", "match"}
Span = collections.namedtuple("Span", "trace id parent name kind start end error message attributes resource")


def wait(what, condition, seconds=PATIENCE):
    return waiting.wait(what, condition, seconds, look=0.02)


def values(attributes):
    """Attributes by name."""
    return {one.key: getattr(one.value, one.value.WhichOneof("value")) for one in attributes}


class Receiver(trace_service_pb2_grpc.TraceServiceServicer):
    """A server that keeps what it is sent, or refuses it."""

    def __init__(self, refuses=False):
        self.refuses, self.requests, self.spans, self.lock = refuses, 0, [], threading.Lock()
        self.server = grpc.server(concurrent.futures.ThreadPoolExecutor(4))
        trace_service_pb2_grpc.add_TraceServiceServicer_to_server(self, self.server)
        self.address = f"http://127.0.0.1:{self.server.add_insecure_port('127.0.0.1:0')}"
        self.server.start()

    def Export(self, request, context):
        with self.lock:
            self.requests += 1
        if self.refuses:
            context.abort(grpc.StatusCode.PERMISSION_DENIED, "not here")
        spans = []
        for resource_spans in request.resource_spans:
            of = values(resource_spans.resource.attributes)
            for scope_spans in resource_spans.scope_spans:
                for one in scope_spans.spans:
                    ids = (one.trace_id.hex(), one.span_id.hex(), one.parent_span_id.hex())
                    times = (one.start_time_unix_nano, one.end_time_unix_nano)
                    status = (one.status.code == ERROR, one.status.message)
                    spans.append(Span(*ids, one.name, one.kind, *times, *status, values(one.attributes), of))
        with self.lock:
            self.spans += spans
        return trace_service_pb2.ExportTraceServiceResponse()

    def named(self, name, **of):
        """Spans of this name, from processes with these attributes."""
        with self.lock:
            spans = list(self.spans)
        has = lambda span: all(span.resource.get(key.replace("_", ".")) == value for key, value in of.items())
        return [span for span in spans if span.name == name and has(span)]


class Hanging:
    """Takes connections and never answers."""

    def __init__(self):
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.address = f"http://127.0.0.1:{self.listener.getsockname()[1]}"
        self.taken = []
        threading.Thread(target=self.take, daemon=True).start()

    def take(self):
        while True:
            self.taken.append(self.listener.accept()[0])


class Programs:
    """Starts programs in a folder of their own, each with a cache of its own."""

    def __init__(self, folder, out):
        self.folder, self.out, self.started = pathlib.Path(folder).resolve(), out, 0
        out.mkdir(exist_ok=True)

    def start(self, program, *arguments, **variables):
        self.started += 1
        clean = {name: value for name, value in os.environ.items() if not name.startswith(("OTEL_", "DESCRY_CO"))}
        caches = {"XDG_CACHE_HOME": str(self.out / f"cache-{self.started}")}
        command = [self.folder / program, *map(str, arguments)]
        self.log = self.out / f"{program}-{self.started}.log"
        process = subprocess.Popen(
            command, env=clean | caches | variables, stdout=subprocess.PIPE, stderr=open(self.log, "wb"), text=True
        )
        process.log = self.log
        return process

    def run(self, experiment, *arguments, **variables):
        """A run in this process alone: its summary and what it said."""
        out = self.out / f"run-{self.started}"
        process = self.start("coordinator", "run", experiment, "--out", out, "--json", *arguments, **variables)
        return finished(process)


def finished(process, code=0):
    """The summary of a run, and what it said."""
    text, _ = process.communicate(timeout=PATIENCE)
    said = process.log.read_text()
    assert process.returncode == code, f"exit code {process.returncode}, expected {code}: {said}"
    return (json.loads(text) if code == 0 else None), said


def experiment(out, name, generations, clouds):
    """The demo with other numbers, and workers that are given up soon."""
    text = (REPOSITORY / "experiments/demo.toml").read_text()
    for key, value in [("root", f'"{out / "clouds"}"'), ("objects", clouds), ("generations", generations)]:
        text, count = re.subn(rf"(?m)^{key} = \S+", f"{key} = {value}", text)
        assert count == 1, key
    path = out / f"{name}.toml"
    path.write_text(text + "\n[coordinator]\nlease_seconds = 2\naudit = 0.2\n")
    return path


def check_tree(spans, killed=()):
    """Every span has its parent, and each is of the kind that it should be; returns children by parent."""
    by_id = {span.id: span for span in spans}
    assert len(by_id) == len(spans), "ids are unique"
    assert len({span.trace for span in spans}) == 1, "one trace"
    children = collections.defaultdict(list)
    jobs = {"evaluation", "description", "tile", "scale"}
    allowed = {"run": {"session"}, "generation": {"run"}, "lease": jobs, "job": {"lease"}}
    for span in spans:
        assert span.start <= span.end, span
        if span.name == "session":
            assert span.parent == "", span
            continue
        parent = by_id.get(span.parent)
        if not parent and span.name in STAGES and span.resource["service.name"] == "mortal":
            continue  # of the job that it was killed in
        assert parent, f"no parent: {span}"
        children[parent.id].append(span)
        expected = allowed.get(span.name) or ({"job"} if span.name in STAGES else {"generation", "run"})
        # An attempt that nobody waits for may outlast the run.
        late = parent.name == "session" and all(it.attributes.get("descry.outcome") == "dropped" for it in spans if it.parent == span.id)
        assert parent.name in expected or late, f"{span} is a child of {parent}"
    for lease in [span for span in spans if span.name == "lease"]:
        of_lease = lease.attributes
        for job in children[lease.id]:
            assert job.resource["process.pid"] != lease.resource["process.pid"], "another process"
            for key in ["descry.job.id", "descry.job.kind", "descry.attempt", "descry.worker.id", "descry.task"]:
                assert job.attributes[key] == of_lease[key], key
        if of_lease["descry.outcome"] in ("answered", "agreed") and of_lease["descry.worker.id"] not in killed:
            assert len(children[lease.id]) == 1, f"one job of {lease}"
    return children


def two_workers(programs, toml, expected):
    """Spans of two workers, one of which is killed, come together in one tree."""
    receiver, port, out = Receiver(), waiting.free_port(), programs.out / "two-workers"
    address = f"127.0.0.1:{port}"
    arguments = ["--out", out, "--json", "--local-workers", 0, "--listen", address, "--events", programs.out / "events"]
    coordinator = programs.start("coordinator", "run", toml, *arguments, **{ENDPOINT: receiver.address})
    variables = {"OTEL_BSP_SCHEDULE_DELAY": "50", "OTEL_EXPORTER_OTLP_TRACES_ENDPOINT": receiver.address}
    named = {"OTEL_SERVICE_NAME": "mortal", "OTEL_RESOURCE_ATTRIBUTES": "deployment.environment.name=lab"}
    at = ["--coordinator", f"http://{address}", "--threads", 1]
    worker = lambda name, **more: programs.start("worker", *at, "--name", name, **variables, **more)
    mortal, other = worker("mortal", **named), worker("other")
    wait("both are at work", lambda: receiver.named("job", service_name="mortal") and receiver.named("job", process_pid=other.pid))
    mortal.send_signal(signal.SIGSTOP)  # it holds a lease, or is given one: it waits for a job
    seen = len(receiver.named("job", process_pid=other.pid))
    wait("jobs go on", lambda: len(receiver.named("job", process_pid=other.pid)) > seen + 3)
    mortal.kill()
    summary, said = finished(coordinator)
    assert finished_worker(other) == 0, other.log.read_text()
    assert "warning" not in said.replace("warning: nothing", ""), said
    assert summary["run_digest"] == expected, "the digest does not change"

    spans = receiver.spans
    of_worker = {span.attributes["descry.worker.name"]: span.attributes["descry.worker.id"] for span in receiver.named("lease")}
    children = check_tree(spans, killed=of_worker["mortal"])
    leases = receiver.named("lease")
    lost = [lease for lease in leases if lease.attributes["descry.outcome"] == "lost"]
    assert lost and all(lease.error and lease.attributes["error.type"] == "lost" for lease in lost), lost
    assert {lease.attributes["descry.worker.name"] for lease in lost} == {"mortal"}
    assert {lease.resource["service.name"] for lease in leases} == {"descry-coordinator"}
    for lease in lost:
        outcomes = {other.attributes["descry.outcome"] for other in children[lease.parent]}
        assert "answered" in outcomes, "what was lost was given to the other"
    events = [json.loads(line) for line in (programs.out / "events").read_text().splitlines()]
    end = lambda event: event["reason"] if event["end"] == "gone" else event["end"]
    ended = [(event["job"], event["attempt"], end(event)) for event in events if event["event"] == "attempt"]
    of_lease = lambda it: (int(it["descry.job.id"]), it["descry.attempt"], it["descry.outcome"])
    assert sorted(ended) == sorted(of_lease(lease.attributes) for lease in leases), "one lease an attempt"
    numbers = [span.attributes["descry.generation"] for span in receiver.named("generation")]
    assert sorted(numbers) == list(range(1, summary["generations"] + 1)), numbers
    run, = receiver.named("run")
    assert run.attributes["descry.stop_reason"] == summary["stop_reason"] and not run.error
    pids = {job.resource["process.pid"] for job in receiver.named("job")}
    assert pids == {mortal.pid, other.pid}, "jobs of two processes"
    ours = receiver.named("job", service_name="mortal")[0].resource
    assert ours["deployment.environment.name"] == "lab" and ours["service.version"] and ours["host.name"]
    stages = {span.name for job in receiver.named("job") for span in children[job.id]}
    assert stages == STAGES, stages
    print(f"two workers: {len(spans)} spans, {len(lost)} lost leases, {dict(collections.Counter(span.name for span in spans))}")


def finished_worker(worker):
    worker.communicate(timeout=PATIENCE)
    return worker.returncode


def interrupted(programs, toml, expected):
    """An interruption ends all spans; what goes on is another session in the same trace."""
    receiver, out = Receiver(), programs.out / "interrupted"
    arguments = ["--out", out, "--json"]
    variables = {ENDPOINT: receiver.address, "OTEL_BSP_SCHEDULE_DELAY": "50"}
    run = programs.start("coordinator", "run", toml, *arguments, **variables)
    wait("a generation is there", lambda: receiver.named("generation"))
    run.send_signal(signal.SIGINT)
    finished(run, code=130)
    for name in ["session", "run", "generation"]:
        last = receiver.named(name)[-1]
        assert last.error and last.message == "interrupted", last
    check_in_process(receiver.spans)
    summary, _ = finished(programs.start("coordinator", "run", toml, *arguments, **variables))
    assert summary["run_digest"] == expected
    check_in_process(receiver.spans)
    assert [session.error for session in receiver.named("session")] == [True, False]
    print(f"interrupted and resumed: {len(receiver.spans)} spans in one trace")


def check_in_process(spans):
    """Every span has its parent, except for jobs whose lease ended with the process."""
    ids = {span.id for span in spans}
    assert len({span.trace for span in spans}) == 1
    orphans = {span.name for span in spans if span.parent and span.parent not in ids}
    assert orphans <= {"job"} | STAGES, orphans


def sampled(programs, toml):
    """Both sides of a trace decide alike."""
    receiver = Receiver()
    nothing = {ENDPOINT: receiver.address, "OTEL_TRACES_SAMPLER": "always_off"}
    programs.run(toml, **nothing)
    programs.run(toml, **{ENDPOINT: receiver.address, "OTEL_SDK_DISABLED": "true"})
    assert not receiver.requests, "nothing is sent"
    half = nothing | {"OTEL_TRACES_SAMPLER": "parentbased_traceidratio", "OTEL_TRACES_SAMPLER_ARG": "0.5"}
    for _ in range(6):
        programs.run(toml, **half)
    names = collections.defaultdict(set)
    for span in receiver.spans:
        names[span.trace].add(span.name)
    assert all({"session", "job"} <= found for found in names.values()), names
    print(f"sampled: {len(names)} of 6 traces at a ratio of 0.5, whole")


def broken(programs, toml, expected):
    """A collector that does not work costs one warning."""
    refusing, hanging = Receiver(refuses=True), Hanging()
    for what, address in [
        ("down", f"http://127.0.0.1:{waiting.free_port()}"),
        ("refusing", refusing.address),
        ("hanging", hanging.address),
        ("encrypted", "https://127.0.0.1:1"),
        ("unreadable", "::"),
    ]:
        started = time.monotonic()
        summary, said = programs.run(toml, **{ENDPOINT: address})
        seconds = time.monotonic() - started
        warnings = [line for line in said.splitlines() if ENDPOINT in line]
        assert len(warnings) == 1 and warnings[0].startswith("warning: "), said
        assert summary["run_digest"] == expected, what
        print(f"{what}: {seconds:.1f} s, {warnings[0]}")
    assert refusing.requests and hanging.taken, "the faults have happened"


def overhead(programs, toml, repeats):
    """Seconds of runs with and without export, in turns."""
    receiver, seconds, cpu = Receiver(), {False: [], True: []}, {False: [], True: []}
    for turn in range(2 * repeats):
        # Whoever is first of a pair changes.
        on = (turn % 2 == 1) != (turn // 2 % 2 == 1)
        before, used = time.monotonic(), resource.getrusage(resource.RUSAGE_CHILDREN)
        programs.run(toml, **({ENDPOINT: receiver.address} if on else {}))
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        seconds[on].append(time.monotonic() - before)
        cpu[on].append(after.ru_utime + after.ru_stime - used.ru_utime - used.ru_stime)
    for what, of in [("seconds", seconds), ("CPU seconds of the program", cpu)]:
        ratio = statistics.median(on / off for on, off in zip(of[True], of[False]))
        print(f"{toml.stem}: {what}: median {statistics.median(of[True]):.2f} with export, {statistics.median(of[False]):.2f} without; median ratio of {repeats} pairs {ratio:.3f}")
    print(f"{toml.stem}: {len(receiver.spans) / repeats:.0f} spans a run")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("programs")
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--without")
    parser.add_argument("--overhead", type=int)
    parser.add_argument("--experiment", type=pathlib.Path, default=REPOSITORY / "experiments/demo.toml")
    arguments = parser.parse_args()
    out = arguments.out.resolve()
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    programs = Programs(arguments.programs, out)
    if arguments.overhead:
        overhead(programs, arguments.experiment, arguments.overhead)
        return
    toml, small = experiment(out, "run", 60, 12), experiment(out, "small", 2, 12)
    expected, of_small = (programs.run(one)[0]["run_digest"] for one in (toml, small))
    two_workers(programs, toml, expected)
    interrupted(programs, toml, expected)
    sampled(programs, small)
    broken(programs, small, of_small)
    if arguments.without:
        summary, said = Programs(arguments.without, out / "without").run(small, **{ENDPOINT: "http://127.0.0.1:1"})
        assert said.count(ENDPOINT) == 1 and "--features otlp" in said, said
        assert summary["run_digest"] == of_small
        print("without the feature: said once")
    print("all as it should be")


if __name__ == "__main__":
    main()
