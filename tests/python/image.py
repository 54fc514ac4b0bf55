"""Runs the demo in containers of the image that `deploy/image` builds, on two machines, and checks what they may do.

Usage: image.py PROGRAMS OUT_DIR [--strip]

PROGRAMS is the folder of `coordinator` and `worker`; `--strip` is for those of profile release, whose symbols are larger than
the programs. Needs Debian with umoci, podman, runc and skopeo, and root for a network namespace, which is the other machine:
it has a network address, an engine and images of its own. Every container runs as a user that is nobody, without
capabilities, with a root file system that cannot be written, /tmp included. A worker is killed, coordinator and workers are
stopped by SIGTERM, and what cannot work must say why. Exit code 1 if anything is otherwise. Takes a minute.
"""

import argparse
import json
import os
import pathlib
import resource
import shutil
import subprocess
import time

import waiting

REPOSITORY = pathlib.Path(__file__).resolve().parents[2]
DEMO = "3266a896a19e77b6a9e4d64931f94eb4b669a4ed783e04c35aee3ef41f71d9a3"
MOST_BYTES = 80_000_000
USER = 65532
PATIENCE = 120  # seconds until a state that has to come has failed to
# `podman stop` sends SIGKILL after so many seconds.
STOP_SECONDS = 30
HARDENED = ["--read-only", "--read-only-tmpfs=false", "--cap-drop=ALL", "--security-opt=no-new-privileges"]
PORT = waiting.free_port()
ADDRESSES = ("198.51.100.1", "198.51.100.2")
CREATED = set()  # the containers, of which none may be left


def run(*command, code=0, **more):
    command = [str(word) for word in command]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, **more)
    if code is not None and done.returncode != code:
        raise SystemExit(f"{' '.join(command)}: must end with {code}, got {done.returncode}\n{done.stdout}{done.stderr}")
    return done


def check(what, found, expected):
    if found != expected:
        raise SystemExit(f"{what}: must be {expected}, got {found}")
    print(f"{what}: {found}", flush=True)


def within(what, text, part):
    if part not in text:
        raise SystemExit(f"{what}: must say {part!r}, got\n{text}")
    print(f"{what}: {part}", flush=True)


class Machine:
    """An engine with images and containers of its own; `prefix` brings commands to its network."""

    def __init__(self, folder, prefix=()):
        self.folder, self.prefix = folder, list(prefix)
        folder.mkdir(parents=True)
        files, processes = (resource.getrlimit(kind)[1] for kind in (resource.RLIMIT_NOFILE, resource.RLIMIT_NPROC))
        # A sandbox may not raise limits, and has neither bridges nor an overlay.
        (folder / "containers.conf").write_text(f"""[containers]
default_ulimits = ["nofile={files}:{files}", "nproc={min(processes, 4096)}:{min(processes, 4096)}"]
netns = "host"
log_driver = "k8s-file"
[engine]
runtime = "runc"
cgroup_manager = "cgroupfs"
events_logger = "file"
""")
        (folder / "storage.conf").write_text(f"""[storage]
driver = "vfs"
graphroot = "{folder}/storage"
runroot = "{folder}/run"
""")
        self.environment = {**os.environ, "CONTAINERS_CONF": f"{folder}/containers.conf",
                            "CONTAINERS_STORAGE_CONF": f"{folder}/storage.conf"}

    def command(self, *words):
        return [*self.prefix, *(str(word) for word in words)]

    def podman(self, *words, code=0):
        return run(*self.command("podman", *words), code=code, env=self.environment)

    def start(self, name, *words):
        self.podman("run", "--detach", "--name", name, *HARDENED, *words)
        return Container(self, name)

    def show(self):
        """The logs of all containers, for whoever has to find out why."""
        for name in self.podman("ps", "--all", "--format", "{{.Names}}", code=None).stdout.split():
            print(f"--- {name}\n{Container(self, name).log()}", flush=True)

    def stop(self):
        self.podman("rm", "--all", "--force", "--time", "0", code=None)
        self.podman("volume", "prune", "--force", code=None)


class Container:
    def __init__(self, machine, name):
        self.machine, self.name = machine, name

    def log(self):
        done = self.machine.podman("logs", self.name)
        return done.stdout + done.stderr

    def state(self):
        return json.loads(self.machine.podman("inspect", self.name).stdout)[0]["State"]

    def wait_for(self, text):
        def said():
            log = self.log()
            if text not in log and self.state()["Status"] == "exited":
                raise SystemExit(f"{self.name} has ended before it said {text!r}:\n{self.log()}")
            return text in log
        try:
            waiting.wait(f"{self.name}: {text}", said, PATIENCE, look=0.2)
        except AssertionError as error:
            raise SystemExit(f"{error}\n{self.log()}") from error

    def code(self):
        """The exit code, once there is one."""
        return int(self.machine.podman("wait", self.name).stdout)

    def stop(self):
        """Exit code after SIGTERM."""
        begun = time.monotonic()
        self.machine.podman("stop", "--time", STOP_SECONDS, self.name)
        print(f"{self.name}: stopped in {time.monotonic() - begun:.1f} s", flush=True)
        return self.code()

    def restrictions(self):
        """What the kernel says of the process."""
        process = pathlib.Path("/proc") / str(self.state()["Pid"])
        status = dict(line.split(":", 1) for line in (process / "status").read_text().splitlines() if ":" in line)
        root = [line.split() for line in (process / "mountinfo").read_text().splitlines() if line.split()[4] == "/"]
        writable = [line.split()[4] for line in (process / "mountinfo").read_text().splitlines()
                    if line.split()[5].startswith("rw") and not line.split()[4].startswith(("/proc", "/dev", "/sys"))]
        return {
            "users": sorted(set(status["Uid"].split() + status["Gid"].split())),
            "capabilities": sorted({status[name].strip() for name in status if name.startswith("Cap")}),
            "no_new_privileges": status["NoNewPrivs"].strip(),
            "seccomp": status["Seccomp"].strip(),
            "root": root[0][5].split(",")[0],
            "writable": sorted(writable),
        }


def restricted(*writable):
    return {"users": [str(USER)], "capabilities": ["0" * 16], "no_new_privileges": "1", "seccomp": "2", "root": "ro",
            "writable": sorted(writable)}


def build(programs, folder, more):
    """The image, built twice."""
    built = []
    for name in ("descry.tar", "again.tar"):
        out = folder / name
        line = run(REPOSITORY / "deploy/image", programs, out, "--packages", folder / "packages", *more).stdout
        built.append((json.loads(line), out.read_bytes()))
    if built[0] != built[1]:
        raise SystemExit(f"two builds: must be equal, got {built[0][0]} and {built[1][0]}")
    (folder / "again.tar").unlink()
    facts = built[0][0]
    print(json.dumps(facts), flush=True)
    if facts["unpacked_bytes"] >= MOST_BYTES:
        raise SystemExit(f"size: must be below {MOST_BYTES} bytes, got {facts['unpacked_bytes']}")
    return facts


def owned(path):
    """A folder that the user of the containers may write."""
    path.mkdir(parents=True)
    os.chown(path, USER, USER)
    return path


class Site:
    """What the coordinator's containers are given, on the first machine."""

    def __init__(self, folder, image):
        self.folder, self.image = folder, image
        self.results, self.cache, self.secrets = (owned(folder / name) for name in ("results", "cache", "secrets"))

    def volumes(self):
        return ["--volume", f"{REPOSITORY}/experiments:/data/experiments:ro", "--volume", f"{self.results}:/data/results",
                "--volume", f"{self.cache}:/cache", "--volume", f"{self.secrets}:/data/secrets:ro"]

    def arguments(self, out):
        return ["coordinator", "run", "experiments/demo.toml", "--out", f"results/runs/{out}", "--listen", f"0.0.0.0:{PORT}",
                "--tls", "secrets/tls", "--local-workers", "0", "--json"]

    def coordinator(self, machine, name, out):
        return machine.start(name, *self.volumes(), self.image, *self.arguments(out))

    def worker(self, machine, name, cache):
        """A worker whose join address is in a file."""
        return machine.start(name, "--volume", f"{self.secrets}/tls/join:/run/descry/join:ro", "--volume", f"{cache}:/cache",
                             self.image, "worker", "--coordinator-file", "/run/descry/join", "--threads", "1", "--name", name)


def digest(container):
    code, log = container.code(), container.log()
    if code != 0:
        raise SystemExit(f"{container.name}: must end with 0, got {code}\n{log}")
    summary = next(line for line in log.splitlines() if line.startswith("{"))
    return json.loads(summary)["run_digest"]


def demo(site, here, there):
    """The demo by a coordinator here and workers there, of which one is killed."""
    coordinator = site.coordinator(here, "coordinator", "demo")
    coordinator.wait_for("workers may join")
    check("what the coordinator may do", coordinator.restrictions(), restricted("/cache", "/data/results"))
    first, second = (owned(there.folder / name) for name in ("first-cache", "second-cache"))
    killed = site.worker(there, "killed", first)
    coordinator.wait_for("generation 5/")
    check("what a worker may do", killed.restrictions(), restricted("/cache"))
    there.podman("kill", "--signal", "KILL", "killed")
    check("exit code of the worker that was killed", killed.code(), 137)
    coordinator.wait_for("killed: lost")
    other = site.worker(there, "other", second)
    check("digest with a worker that was killed", digest(coordinator), DEMO)
    check("exit code of the worker whose run has ended", other.code(), 0)
    within("other", other.log(), "left: the run has ended")


def stopped(site, here, there):
    """SIGTERM ends both well, at once also while they begin, and the run goes on afterwards."""
    early = site.coordinator(here, "early", "early")
    check("exit code of a coordinator that is stopped at its start", early.stop(), 143)
    coordinator = site.coordinator(here, "stopped", "stopped")
    cache = owned(there.folder / "cache")
    worker = site.worker(there, "leaving", cache)
    coordinator.wait_for("generation 3/")
    check("exit code of a worker that is stopped", worker.stop(), 0)
    coordinator.wait_for("leaving: left: said goodbye")
    check("exit code of a coordinator that is stopped", coordinator.stop(), 143)
    again = site.coordinator(here, "again", "stopped")
    again.wait_for("workers may join")
    site.worker(there, "waiting", owned(there.folder / "waiting-cache"))
    check("digest of the run that went on", digest(again), DEMO)


def wrong(site, here):
    """What cannot work says why."""
    def fails(what, words, part, code=1):
        done = here.podman("run", "--rm", *HARDENED, *words, code=None)
        check(f"{what}, exit code", done.returncode, code)
        within(what, done.stdout + done.stderr, part)

    experiments = ["--volume", f"{REPOSITORY}/experiments:/data/experiments:ro"]
    alone = ["coordinator", "run", "experiments/demo.toml", "--listen", "127.0.0.1:0"]
    fails("no volume for results", [*experiments, site.image, *alone], "Read-only file system")
    closed = site.folder / "closed"
    closed.mkdir()
    fails("results of another user", [*experiments, "--volume", f"{closed}:/data/results", site.image, *alone],
          "Permission denied")
    join = site.folder / "unreadable"
    join.write_text("http://127.0.0.1:7700\n")
    join.chmod(0o600)
    worker = ["--volume", f"{join}:/run/descry/join:ro", site.image, "worker", "--coordinator-file", "/run/descry/join"]
    fails("a join address of another user", worker, "Permission denied")
    fails("no such program", [site.image, "sh"], "not found", code=127)
    done = here.podman("run", "--rm", *HARDENED, site.image)
    within("nothing to do", done.stdout, "Usage: coordinator")


def network(name):
    """A network namespace with a wire to this one."""
    run("ip", "netns", "add", name)
    enter = ["nsenter", f"--net=/run/netns/{name}"]  # unlike `ip netns exec`, which hides the control groups
    wire = ["ip", "link", "add", name, "type", "veth", "peer", "name", "wire", "netns", name]
    run(*wire)
    for prefix, device, address in (((), name, ADDRESSES[0]), (enter, "wire", ADDRESSES[1])):
        run(*prefix, "ip", "address", "add", f"{address}/30", "dev", device)
        run(*prefix, "ip", "link", "set", device, "up")
    return enter


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("programs", metavar="PROGRAMS", type=pathlib.Path)
    parser.add_argument("out", metavar="OUT_DIR", type=pathlib.Path)
    parser.add_argument("--strip", action="store_true")
    options = parser.parse_args()
    folder = options.out.resolve()
    shutil.rmtree(folder / "machines", ignore_errors=True)
    folder.mkdir(parents=True, exist_ok=True)
    image = build(options.programs, folder, ["--strip"] if options.strip else [])["image"]

    name = f"descry{os.getpid()}"
    machines = []
    try:
        here = Machine(folder / "machines/here")
        machines.append(here)
        there = Machine(folder / "machines/there", network(name))
        machines.append(there)
        for machine in machines:
            machine.podman("load", "--input", folder / "descry.tar")
        site = Site(here.folder, image)
        here.podman("run", "--rm", *HARDENED, "--volume", f"{site.secrets}:/data/secrets", image, "coordinator", "certs",
                    "secrets/tls", "--host", ADDRESSES[0], "--port", PORT)
        demo(site, here, there)
        stopped(site, here, there)
        wrong(site, here)
    except BaseException:
        for machine in machines:
            machine.show()
        raise
    finally:
        for machine in machines:
            machine.stop()
        run("ip", "netns", "delete", name, code=None)


if __name__ == "__main__":
    main()
