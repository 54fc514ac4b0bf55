"""Runs workers as jobs of a real Slurm and checks that it may take them away and give them back as it likes.

Usage: slurm.py COORDINATOR OUT_DIR [CASE...]

Needs slurm-wlm and munge (Debian), whose programs it starts for itself, with files and ports of its own: two unequal nodes,
and two partitions of which one preempts jobs of the other. `worker` must lie beside COORDINATOR. Each case ends with the
digest of an undisturbed run, with nothing done again but what a worker had in hand, and with an empty queue. Exit code 1 if
one does not. Takes twelve minutes.
"""

import json
import os
import pathlib
import shutil
import signal
import socket
import subprocess
import sys
import time

import waiting

HOST = socket.gethostname()
GENERATIONS = {"exp": 50, "long": 800, "minutes": 2500}  # of each experiment
IDLE = 10  # seconds
PATIENCE = 90  # seconds until a state that has to come has failed to
NODES = {"one": 4, "two": 2}  # name and processors
EXPERIMENT = """
version = 1
name = "slurm"
seed = 5
[dataset]
root = "data"
[search]
method = "random"
[ga]
population = 20
[stop]
generations = {generations}
stagnation = "off"
validation_patience = "off"
[coordinator]
lease_seconds = 6
audit = 0
"""


PORT = waiting.free_port()


def wait_for(what, state, patience=PATIENCE):
    begun = time.monotonic()
    while time.monotonic() - begun < patience:
        found = state()
        if found:
            return found
        time.sleep(0.2)
    raise SystemExit(f"not in {patience} s: {what}")


class Slurm:
    """A cluster of two nodes on this machine; ended by `stop`."""

    def __init__(self, folder):
        self.folder, self.processes = folder, {}
        folder.mkdir(parents=True)
        host = socket.gethostname().split(".")[0]
        key, munge = folder / "munge.key", folder / "munge.socket"
        key.write_bytes(os.urandom(1024))
        key.chmod(0o400)
        nodes = "".join(
            f"NodeName={name} NodeHostname={host} NodeAddr=127.0.0.1 Port={waiting.free_port()} CPUs={cpus} RealMemory=1000\n"
            for name, cpus in NODES.items()
        )
        user = os.environ.get("USER") or "root"
        (folder / "slurm.conf").write_text(f"""ClusterName=descry
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={waiting.free_port()}
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
AuthInfo=socket={munge}
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool-%n
SlurmctldPidFile={folder}/ctld.pid
SlurmdPidFile={folder}/slurmd-%n.pid
SlurmctldLogFile={folder}/ctld.log
SlurmdLogFile={folder}/slurmd-%n.log
ProctrackType=proctrack/pgid
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
PreemptType=preempt/partition_prio
PreemptMode=REQUEUE
SchedulerParameters=sched_interval=1,bf_interval=1
SlurmdParameters=config_overrides
SlurmdTimeout=10
ReturnToService=2
KillWait=3
MpiDefault=none
{nodes}PartitionName=low Nodes=ALL Default=YES PriorityTier=1 PreemptMode=REQUEUE MaxTime=INFINITE State=UP
PartitionName=high Nodes=ALL PriorityTier=10 PreemptMode=OFF MaxTime=INFINITE State=UP
""")
        (folder / "state").mkdir()
        self.environment = {**os.environ, "SLURM_CONF": str(folder / "slurm.conf")}
        self.start("munged", ["munged", "--foreground", "--force", f"--key-file={key}", f"--socket={munge}",
                              f"--pid-file={folder}/munge.pid", f"--log-file={folder}/munge.log",
                              f"--seed-file={folder}/munge.seed"])
        wait_for("munged", munge.exists)
        self.start("slurmctld", ["slurmctld", "-D"])
        for name in NODES:
            self.start_node(name)
        idle = {f"{name} idle" for name in NODES}
        wait_for("nodes", lambda: set(self("sinfo", "-h", "-N", "-o", "%N %t").splitlines()) == idle)

    def start(self, name, command):
        path = os.environ["PATH"] + ":/usr/sbin:/sbin"
        log = (self.folder / f"{name}.out").open("w")
        environment = {**self.environment, "PATH": path}
        self.processes[name] = subprocess.Popen(command, stdout=log, stderr=log, env=environment)

    def start_node(self, name):
        (self.folder / f"spool-{name}").mkdir(exist_ok=True)
        self.start(f"slurmd-{name}", ["slurmd", "-D", "-N", name])

    def __call__(self, *command, **more):
        done = subprocess.run(command, capture_output=True, text=True, env=self.environment, **more)
        if done.returncode != 0:
            raise SystemExit(f"{command}: {done.stdout}{done.stderr}")
        return done.stdout

    def submit(self, line, partition="low"):
        """The number of the job that a command line of sbatch makes."""
        environment = {**self.environment, "SBATCH_PARTITION": partition, "SBATCH_OUTPUT": f"{self.folder}/job-%A-%a.log"}
        done = subprocess.run(["sh", "-c", line], capture_output=True, text=True, env=environment)
        if done.returncode != 0:
            raise SystemExit(f"{line}: {done.stderr}")
        return done.stdout.split()[-1]

    def jobs(self, *number):
        """Of each task of a job, or of all jobs that it remembers, what Slurm says: a dictionary."""
        tasks = self("scontrol", "-o", "show", "job", *number).splitlines()
        return [dict(word.split("=", 1) for word in task.split() if "=" in word) for task in tasks]

    def states(self, number):
        return sorted(job["JobState"] for job in self.jobs(number))

    def hurry(self, number):
        """The states of a job's tasks; those that are queued again need not wait the two minutes that Slurm lets pass."""
        for job in self.jobs(number):
            if job["JobState"] == "PENDING":
                # It may have begun meanwhile, which is an error.
                subprocess.run(["scontrol", "update", f"jobid={job['JobId']}", "starttime=now"], env=self.environment,
                               capture_output=True)
        return self.states(number)

    def queue(self):
        return self("squeue", "-h").strip()

    def stop(self):
        subprocess.run(["scancel", "--user", os.environ.get("USER") or "root"], env=self.environment)
        for process in reversed(self.processes.values()):
            process.terminate()
        for process in self.processes.values():
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()


class Run:
    """A coordinator beside the cluster, whose workers are all jobs."""

    def __init__(self, coordinator, slurm, folder, name, *more, experiment="exp.toml"):
        self.coordinator, self.slurm, self.out = coordinator, slurm, folder / name
        self.log = folder / f"{name}.log"
        command = [coordinator, "run", folder / experiment, "--out", self.out, "--json", "--local-workers", "0",
                   "--listen", *(more or [f"127.0.0.1:{PORT}"]), "--tls", folder / "tls", "--no-cache"]
        environment = {**slurm.environment, "SBATCH_PARTITION": "low"}
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=self.log.open("w"), text=True,
                                        env=environment)

    def wait_for(self, text):
        def state():
            if self.process.poll() is not None:
                raise SystemExit(f"the run has ended before {text!r}:\n{self.log.read_text()}")
            return text in self.log.read_text()
        wait_for(text, state)

    def digest(self):
        stdout, _ = self.process.communicate(timeout=10 * PATIENCE)
        if self.process.returncode != 0:
            raise SystemExit(self.log.read_text())
        return json.loads(stdout)["run_digest"]


def join_command(coordinator, folder, *more, join=None, idle=IDLE):
    join = join or ["--tls", folder / "tls"]
    command = [coordinator, "join-command", *join, "--over", "slurm", "--threads", "1", *more]
    line = subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    # A worker that is queued again when the run has ended finds nobody: it should not take 15 minutes to give up.
    assert "--idle-timeout 900" in line
    return line.replace("--idle-timeout 900", f"--idle-timeout {idle}")


def attempts(coordinator, out):
    """How many attempts of a run ended in which way, over all workers."""
    sql = "SELECT \"end\", COUNT(*) AS n FROM attempts GROUP BY \"end\""
    done = subprocess.run([coordinator, "query", out, sql, "--format", "json"], capture_output=True, text=True)
    if done.returncode != 0:
        raise SystemExit(done.stderr)
    return {row["end"]: row["n"] for row in json.loads(done.stdout)}


def shown_digest(coordinator, folder, experiment, out):
    """The digest of a run that has ended."""
    show = [coordinator, "run", folder / f"{experiment}.toml", "--out", out, "--json", "--no-cache"]
    done = subprocess.run(show, capture_output=True, text=True, check=True)
    return json.loads(done.stdout)["run_digest"]


def undisturbed(coordinator, folder, experiment):
    """The digest of an experiment without Slurm."""
    command = [coordinator, "run", folder / f"{experiment}.toml", "--out", folder / f"undisturbed-{experiment}", "--json",
               "--no-cache", "--listen", "127.0.0.1:0"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    return json.loads(done.stdout)["run_digest"]


def check(what, found, expected):
    if found != expected:
        raise SystemExit(f"{what}: must be {expected}, got {found}")
    print(f"{what}: {found}", flush=True)


def done_again(coordinator, out, departures):
    """Evaluations that were begun and not finished: at most the one in hand and the one ahead of each that went."""
    ends = attempts(coordinator, out)
    again = sum(count for end, count in ends.items() if end in ("left", "lost"))
    print(f"attempts: {ends}", flush=True)
    if ends.get("answered", 0) == 0 or again > 2 * departures:
        raise SystemExit(f"done again: at most {2 * departures}, got {again}")


def preempted(coordinator, slurm, folder, expected):
    """All workers are preempted by other jobs, queued again, and come back."""
    run = Run(coordinator, slurm, folder, "preempted")
    workers = slurm.submit(join_command(coordinator, folder, "--workers", "3"))
    run.wait_for("generation 3/")
    others = [slurm.submit(f"sbatch --nodelist={name} --exclusive --wrap='sleep 4'", "high") for name in NODES]
    run.wait_for(": left: said goodbye")
    wait_for("other jobs", lambda: all(slurm.states(other) == ["COMPLETED"] for other in others))
    check("digest after preemption", run.digest(), expected)
    wait_for("an empty queue", lambda: not slurm.queue())
    jobs = slurm.jobs(workers)
    check("workers' states", slurm.states(workers), ["COMPLETED"] * 3)
    restarts = sum(int(job["Restarts"]) for job in jobs)
    if restarts == 0:
        raise SystemExit("no worker was queued again")
    done_again(coordinator, run.out, restarts)


def node_down(coordinator, slurm, folder, expected):
    """A node goes; its workers are queued again and get an allocation when it is back."""
    run = Run(coordinator, slurm, folder, "node-down")
    workers = slurm.submit(join_command(coordinator, folder, "--workers", "4"))
    run.wait_for("generation 3/")
    running = wait_for("two nodes", lambda: {job.get("NodeList") for job in slurm.jobs(workers)} >= set(NODES) or None)
    assert running
    slurm("scontrol", "update", "nodename=two", "state=down", "reason=test")
    wait_for("workers queued again", lambda: any(int(job["Restarts"]) for job in slurm.jobs(workers)))
    if "down" in slurm("sinfo", "-h", "-n", "two", "-o", "%t"):
        slurm("scontrol", "update", "nodename=two", "state=resume")  # else it has registered again by itself
    slurm.hurry(workers)
    check("digest after a node was down", run.digest(), expected)
    wait_for("an empty queue", lambda: not slurm.queue())
    check("workers' states", slurm.states(workers), ["COMPLETED"] * 4)
    done_again(coordinator, run.out, 4)


def lifetime(coordinator, slurm, folder, expected):
    """Workers whose lifetime is short leave in time and well; others follow. One whose program is not there fails alone."""
    run = Run(coordinator, slurm, folder, "lifetime", experiment="long.toml")
    line = join_command(coordinator, folder, "--workers", "2")
    short = line.replace("--lifetime 3540", "--lifetime 3 --lifetime-stagger 1")
    assert short != line
    first = slurm.submit(short)
    bad = slurm.submit("sbatch --wrap='exec srun /nonexistent/worker'")
    wait_for("short lives", lambda: slurm.states(first) == ["COMPLETED"] * 2)
    wait_for("a bad worker", lambda: slurm.states(bad) == ["FAILED"])
    if run.process.poll() is not None:
        raise SystemExit("the run has ended before its workers left")
    second = slurm.submit(line)
    check("digest after short lives", run.digest(), expected)
    wait_for("an empty queue", lambda: not slurm.queue())
    check("workers' states", slurm.states(second), ["COMPLETED"] * 2)
    done_again(coordinator, run.out, 2)


def asked_for(coordinator, slurm, folder, expected):
    """The coordinator asks Slurm for workers, also after Slurm's controller was killed, and leaves none in the queue."""
    own = ["0.0.0.0:0", "--join-file", folder / "asked", "--slurm-workers", "8", "--slurm-threads", "1"]
    run = Run(coordinator, slurm, folder, "asked-for", *own, experiment="long.toml")
    run.wait_for("Slurm: asked for 8 more workers")
    run.wait_for("generation 2/")
    # Of jobs that it has not yet written down, a controller that is killed starts a second time, and drains their nodes.
    state = slurm.folder / "state/job_state"
    starts = [job["StartTime"] for job in slurm.jobs() if job["JobState"] == "RUNNING"]
    begun = max(time.mktime(time.strptime(start, "%Y-%m-%dT%H:%M:%S")) for start in starts)
    wait_for("what the controller writes down", lambda: state.exists() and state.stat().st_mtime > begun + 1)
    slurm.processes["slurmctld"].kill()
    slurm.processes["slurmctld"].wait()
    run.wait_for("Slurm: slurm_load_jobs error: ")
    slurm.start("slurmctld", ["slurmctld", "-D"])
    wait_for("workers", lambda: run.log.read_text().count("joined, 1 threads") >= 4)
    check("digest with workers that were asked for", run.digest(), expected)
    wait_for("an empty queue", lambda: not slurm.queue())
    done_again(coordinator, run.out, 8)
    print((folder / "asked-for.log").read_text().count("Slurm: asked for"), "times asked for workers", flush=True)


def refused_and_failing(coordinator, slurm, folder):
    """What Slurm would not take is refused at once; a worker that fails is not asked for for ever."""
    own = ["0.0.0.0:0", "--join-file", folder / "failing-join", "--slurm-workers", "4", "--slurm-threads", "1"]
    for wrong, message in ((["--slurm-args=--partition=nowhere"], "--slurm-workers: Slurm refuses such jobs, got "),
                           (["--listen", "127.0.0.1:0"], "--slurm-workers: needs an address")):
        arguments = wrong[1:] + own[1:] if wrong[0] == "--listen" else own + wrong
        run = Run(coordinator, slurm, folder, "refused", *arguments)
        run.process.communicate(timeout=PATIENCE)
        if run.process.returncode != 1 or message not in run.log.read_text():
            raise SystemExit(f"{wrong}: must be refused, got {run.process.returncode}\n{run.log.read_text()}")
    programs = folder / "programs"
    programs.mkdir()
    shutil.copy(coordinator, programs / "coordinator")
    (programs / "worker").write_text("#!/bin/sh\nexit 7\n")
    (programs / "worker").chmod(0o755)
    run = Run(programs / "coordinator", slurm, folder, "failing", *own)
    run.wait_for("Slurm: asked for no more workers for 2 min")
    asked = run.log.read_text().count("Slurm: asked for 4 more workers")
    run.process.send_signal(signal.SIGINT)
    run.process.communicate(timeout=PATIENCE)
    check("times asked for failing workers", asked, 1)
    wait_for("an empty queue", lambda: not slurm.queue())


def coordinator_job(coordinator, slurm, folder, expected):
    """The coordinator is a job as well: told to end and preempted, it goes on elsewhere, and its workers find it."""
    script = pathlib.Path(__file__).parents[2] / "deploy/slurm/coordinator.sh"
    here, out = folder / "tls/here", folder / "job"
    place = "--listen 0.0.0.0:0 --local-workers 0 --no-cache"
    job = slurm.submit(f"COORDINATOR={coordinator} sbatch --time=60 {script} run {folder}/exp.toml --out {out} "
                       f"--tls {folder}/tls --join-file {here} {place}")
    log = folder / f"slurm/job-{job}-4294967294.log"
    workers = slurm.submit(join_command(coordinator, folder, "--workers", "2", join=["--join-file", here], idle=60))
    addresses, ends = set(), []

    def begun(generation):
        addresses.add(here.read_text() if here.exists() else "")
        return log.exists() and f"generation {generation}/" in log.read_text()

    def told_to_end():
        slurm("scancel", "--signal=TERM", job)

    def preempt():
        node = slurm.jobs(job)[0]["NodeList"]
        ends.append(slurm.submit(f"sbatch --nodelist={node} --exclusive --wrap='sleep 4'", "high"))

    for restarts, (generation, disturb) in enumerate([(3, told_to_end), (10, preempt)], 1):
        wait_for(f"generation {generation}", lambda: begun(generation))
        disturb()
        wait_for("the coordinator queued again", lambda: int(slurm.jobs(job)[0]["Restarts"]) == restarts)
        wait_for("the coordinator in its next place", lambda: slurm.hurry(job) == ["RUNNING"])
    wait_for("the run's end", lambda: slurm.hurry(workers) and slurm.states(job) == ["COMPLETED"])
    addresses.add(here.read_text())
    if here.stat().st_mode & 0o077 or len(addresses - {""}) < 2:
        raise SystemExit(f"{here}: must name each place in turn, and be its owner's alone")
    check("digest after the coordinator moved", shown_digest(coordinator, folder, "exp", out), expected)
    wait_for("an empty queue", lambda: not slurm.queue())
    check("workers' states", slurm.states(workers), ["COMPLETED"] * 2)


def job_that_asks(coordinator, slurm, folder, expected):
    """A coordinator that is a job asks for workers as well."""
    script = pathlib.Path(__file__).parents[2] / "deploy/slurm/coordinator.sh"
    out, asks = folder / "asks", "--slurm-workers 3 --slurm-threads 1 --slurm-args=--partition=low"
    place = f"--tls {folder}/tls --join-file {folder}/asks-join --listen 0.0.0.0:0 --local-workers 0 --no-cache"
    job = slurm.submit(f"COORDINATOR={coordinator} sbatch --cpus-per-task=2 {script} run {folder}/exp.toml --out {out} {place} {asks}")
    wait_for("the run's end", lambda: slurm.states(job) == ["COMPLETED"])
    check("digest of a job that asks for workers", shown_digest(coordinator, folder, "exp", out), expected)
    wait_for("an empty queue", lambda: not slurm.queue())


def time_limits(coordinator, slurm, folder, expected):
    """Slurm's time limits run out under a coordinator, which is queued again, and under its workers, which are replaced."""
    script = pathlib.Path(__file__).parents[2] / "deploy/slurm/coordinator.sh"
    out = folder / "limits"
    asks = "--slurm-workers 2 --slurm-threads 1 --slurm-args='--partition=low --time=1'"
    place = f"--tls {folder}/tls --join-file {folder}/limits-join --listen 0.0.0.0:0 --local-workers 0 --no-cache"
    job = slurm.submit(f"COORDINATOR={coordinator} sbatch --time=2 {script} run {folder}/minutes.toml --out {out} {place} {asks}")
    log, states, ended = folder / f"slurm/job-{job}-4294967294.log", [], set()

    def at_end():
        """Slurm forgets jobs some minutes after their end."""
        ended.update(job["JobId"] for job in slurm.jobs() if job["JobState"] == "TIMEOUT")
        states.extend(state for state in slurm.hurry(job) if state not in states[-1:])
        return states[-1] == "COMPLETED"

    wait_for("the run's end", at_end, 10 * PATIENCE)
    restarts = int(slurm.jobs(job)[0]["Restarts"])
    print(f"coordinator: {' '.join(states)}, queued again {restarts} times; workers killed at their limit: {len(ended)}", flush=True)
    if restarts == 0 or len(ended) < 2 or job in ended:
        raise SystemExit(f"time_limits: limits must have run out under both, and the coordinator have left before:\n{log.read_text()}")
    check("digest after time limits", shown_digest(coordinator, folder, "minutes", out), expected)
    wait_for("an empty queue", lambda: not slurm.queue())
    done_again(coordinator, out, len(ended) + 2 * restarts)


def interrupted(coordinator, slurm, folder):
    """After Ctrl-C no worker waits for an allocation, and the others can be ended by the command that is named."""
    own = ["0.0.0.0:0", "--join-file", folder / "interrupted-join", "--slurm-workers", "12", "--slurm-threads", "1"]
    run = Run(coordinator, slurm, folder, "interrupted", *own, experiment="long.toml")
    run.wait_for("generation 2/")
    waiting_for_places = slurm("squeue", "-h", "--array", "--states=PENDING").count("\n")
    run.process.send_signal(signal.SIGINT)
    run.process.communicate(timeout=PATIENCE)
    check("exit code after Ctrl-C", run.process.returncode, 130)
    if not waiting_for_places:
        raise SystemExit("interrupted: must have workers that wait for an allocation, got none")
    wait_for("nobody who waits for an allocation", lambda: not slurm("squeue", "-h", "--states=PENDING").strip())
    command = run.log.read_text().rsplit("at once by ", 1)[1].split()
    slurm(*command)
    wait_for("an empty queue", lambda: not slurm.queue())


def cancelled(coordinator, slurm, folder):
    """A coordinator that is cancelled is not queued again."""
    script = pathlib.Path(__file__).parents[2] / "deploy/slurm/coordinator.sh"
    job = slurm.submit(f"COORDINATOR={coordinator} sbatch {script} run {folder}/exp.toml --out {folder}/cancelled "
                       f"--tls {folder}/tls --listen 127.0.0.1:0 --local-workers 0 --no-cache")
    log = folder / f"slurm/job-{job}-4294967294.log"
    wait_for("a coordinator", lambda: log.exists() and "waiting for a worker" in log.read_text())
    slurm("scancel", job)
    wait_for("an empty queue", lambda: not slurm.queue())
    check("cancelled coordinator", slurm.states(job), ["CANCELLED"])


def without_coordinator(coordinator, slurm, folder):
    """A worker that finds nobody gives its allocation back."""
    alone = slurm.submit(join_command(coordinator, folder, "--workers", "1"))
    wait_for("an idle worker's end", lambda: slurm.states(alone) == ["COMPLETED"])
    check("idle worker", slurm.states(alone), ["COMPLETED"])


# Each with the experiment whose digest it must have. The last takes Slurm's controller away, which forgets a node for a while.
CASES = [(coordinator_job, "exp"), (preempted, "exp"), (node_down, "exp"), (lifetime, "long"), (refused_and_failing,),
         (job_that_asks, "exp"), (time_limits, "minutes"), (interrupted,), (cancelled,), (without_coordinator,), (asked_for, "long")]


def main():
    coordinator, out = pathlib.Path(sys.argv[1]).absolute(), pathlib.Path(sys.argv[2]).absolute()
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    for name, generations in GENERATIONS.items():
        (out / f"{name}.toml").write_text(EXPERIMENT.format(generations=generations))
    quiet = {"check": True, "capture_output": True}
    subprocess.run([coordinator, "synth", out / "data", "--objects", "6", "--views", "12"], **quiet)
    subprocess.run([coordinator, "certs", out / "tls", "--host", "127.0.0.1", "--host", HOST, "--port", str(PORT)], **quiet)
    cases = [case for case in CASES if len(sys.argv) == 3 or case[0].__name__ in sys.argv[3:]]
    expected = {name: undisturbed(coordinator, out, name) for name in sorted({name for _, *names in cases for name in names})}
    slurm = Slurm(out / "slurm")
    try:
        for case, *names in cases:
            print(f"== {case.__doc__.splitlines()[0]}", flush=True)
            case(coordinator, slurm, out, *(expected[name] for name in names))
    finally:
        slurm.stop()
    print("no place is kept, every digest is that of the undisturbed run")


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))
    main()
