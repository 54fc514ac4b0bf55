"""The Debian package and the tarball on clean machines: the demo, a second machine, services that are killed.

Usage: packages.py PACKAGES OUT_DIR

PACKAGES is the folder that `deploy/package` has packed. Needs root, mmdebstrap, systemd-container, and a machine on which
systemd-nspawn can boot. OUT_DIR keeps an untouched Debian for the next time. What each step has found is printed.
"""

import argparse
import contextlib
import os
import pathlib
import re
import shutil
import signal
import subprocess

import waiting

HOME = "root"  # folder of who is root there
DIGEST = "3266a896a19e77b6a9e4d64931f94eb4b669a4ed783e04c35aee3ef41f71d9a3"
SUITE = "bookworm"
PATIENCE = 60  # seconds
NSPAWN = ["systemd-nspawn", "--quiet", "--register=no", "--keep-unit"]
# Its locks need a folder that a machine without systemd does not have.
ENVIRONMENT = {**os.environ, "SYSTEMD_NSPAWN_LOCK": "0"}


def say(what):
    print(what, flush=True)


def output(*command, check=True):
    done = subprocess.run(command, capture_output=True, text=True, env=ENVIRONMENT)
    text = done.stdout + "".join(line for line in done.stderr.splitlines(True) if "propagate" not in line)
    assert not check or done.returncode == 0, f"{command}: exit code {done.returncode}\n{text}"
    return text


class Machine:
    """A Debian of its own, on the host's network."""

    def __init__(self, clean, folder):
        self.root = folder
        shutil.rmtree(folder, ignore_errors=True)
        subprocess.run(["cp", "-a", clean, folder], check=True)

    def command(self, line, *, user="root"):
        """A command line, to be run in a container of its own."""
        script = f"cd ~ && {line}"
        return [*NSPAWN, "--pipe", "--directory", str(self.root), f"--user={user}", "sh", "-c", script]

    def run(self, line, *, user="root"):
        return output(*self.command(line, user=user))

    def put(self, file, place):
        target = self.root / place
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(file, target)

    def install(self, package):
        self.put(package, f"{HOME}/descry.deb")
        # What the package does not bring, it must not need.
        return self.run("dpkg -i descry.deb 2>&1")

    @contextlib.contextmanager
    def booted(self):
        """The machine with its services; gives what runs a command in it."""
        with open(f"{self.root}.console", "w") as console:
            nspawn = subprocess.Popen(
                [*NSPAWN, "--boot", "--console=read-only", "--directory", str(self.root)],
                stdin=subprocess.DEVNULL,
                stdout=console,
                stderr=console,
                env=ENVIRONMENT,
            )
        children = pathlib.Path(f"/proc/{nspawn.pid}/task/{nspawn.pid}/children")
        try:
            leader = waiting.wait("init", lambda: children.read_text().split(), PATIENCE)[0]

            def run(*command, check=True):
                return output("nsenter", "--target", leader, "--all", *command, check=check)

            state = lambda: run("systemctl", "is-system-running", check=False).split("\n")[0]
            waiting.wait("boot", lambda: state() in ("running", "degraded"), PATIENCE)
            yield run
        finally:
            # To systemd-nspawn it means an orderly end of what is inside.
            nspawn.send_signal(signal.SIGTERM)
            nspawn.wait(PATIENCE)


def digest(text):
    found = re.findall(r"run digest\s+([0-9a-f]{64})", text)
    return found[-1] if found else None


def demo(machine, program="descry"):
    """The demo as somebody who has installed it would begin."""
    text = machine.run(f"cp -r /usr/share/doc/descry/examples experiments && {program} run experiments/demo.toml 2>&1")
    assert digest(text) == DIGEST, text


def two_machines(first, second):
    """A coordinator without workers on one, a worker on the other, which has nothing but the join address."""
    port = waiting.free_port()
    first.run(f"descry certs tls --host 127.0.0.1 --port {port} 2>&1")
    line = f"descry run experiments/demo.toml --seed 1 --out second --no-cache --listen 127.0.0.1:{port}"
    coordinator = subprocess.Popen(
        first.command(f"{line} --tls tls --local-workers 0 2>&1"), stdout=subprocess.PIPE, text=True, env=ENVIRONMENT
    )
    try:
        second.put(first.root / HOME / "tls/join", f"{HOME}/join")
        worker = second.run("timeout 120 descry-worker --coordinator-file join --name second --no-cache 2>&1")
        text, _ = coordinator.communicate(timeout=PATIENCE)
    finally:
        coordinator.kill()  # ended, unless something has gone wrong
    assert coordinator.returncode == 0 and digest(text) == DIGEST, text
    assert "second" in text, text
    return worker


def services(machine):
    """The coordinator's service works for a worker's, is killed in the middle, starts again and ends as ever."""
    settings = machine.root / "etc/descry"
    experiment = (machine.root / "usr/share/doc/descry/examples/demo.toml").read_text()
    experiment = experiment.replace("../results/data/demo", "/var/lib/descry/clouds")
    (settings / "demo.toml").write_text(experiment)
    port = waiting.free_port()
    (settings / "demo.join").write_text(f"http://127.0.0.1:{port}\n")
    (settings / "demo.conf").write_text(
        f"DESCRY_OPTIONS=--listen 127.0.0.1:{port} --local-workers 0 --no-cache\nDESCRY_WORKER_OPTIONS=--threads 1\n"
    )
    coordinator, worker = "descry-coordinator@demo.service", "descry-worker@demo.service"
    generation = machine.root / "var/lib/descry/demo/generations/generation-00003.parquet"
    with machine.booted() as run:
        units = ("systemctl", "show", coordinator, "--property")
        value = lambda name: run(*units, name, "--value").strip()
        try:
            run("systemctl", "start", coordinator, worker)
            waiting.wait("three generations", generation.exists, PATIENCE, look=0.01)
            run("systemctl", "kill", "--signal=KILL", coordinator)
            waiting.wait("restart", lambda: value("NRestarts") == "1", PATIENCE)
            waiting.wait("end of the run", lambda: value("ActiveState") == "inactive", PATIENCE)
        finally:
            say(run("journalctl", "--no-pager", "--output=cat", "--unit", coordinator, "--unit", worker, check=False))
        assert value("Result") == "success" and value("ExecMainStatus") == "0", run(*units, "Result,ExecMainStatus")
        journal = run("journalctl", "--no-pager", "--output=cat", "--unit", coordinator)
        assert digest(journal) == DIGEST and "Killed" in journal or "status=9/KILL" in journal, journal
        # The worker waits for the next run, and ends when it is told to.
        assert run("systemctl", "is-active", worker).strip() == "active"
        run("systemctl", "stop", worker)
        show = run("systemctl", "show", worker, "--property=ActiveState,Result,ExecMainStatus")
        assert "ActiveState=inactive" in show and "Result=success" in show, show
        # A bad experiment is told once, not again and again.
        (settings / "bad.toml").write_text("version = 1\n")
        bad = "descry-coordinator@bad.service"
        run("systemctl", "start", bad)
        bad_value = lambda name: run("systemctl", "show", bad, "--property", name, "--value").strip()
        waiting.wait("failure", lambda: bad_value("ActiveState") == "failed", PATIENCE)
        assert (bad_value("ExecMainStatus"), bad_value("NRestarts")) == ("1", "0"), run("systemctl", "status", bad, check=False)
        # A finished run is only shown again.
        run("systemctl", "restart", coordinator)
        waiting.wait("end", lambda: value("ActiveState") == "inactive", PATIENCE)
        assert "this run is finished" in run("journalctl", "--no-pager", "--output=cat", "--unit", coordinator)
        say(run("systemd-analyze", "security", "--no-pager", coordinator).splitlines()[-1])
        say(run("systemd-analyze", "security", "--no-pager", worker).splitlines()[-1])
        run("systemd-analyze", "verify", "--man=no", coordinator, worker)
    owner = (machine.root / "var/lib/descry/demo").stat()
    assert owner.st_uid != 0, "the run belongs to root"


def left(machine):
    """What removal and purge leave."""
    for how in ("--remove", "--purge"):
        machine.run(f"dpkg {how} descry 2>&1")
        found = machine.run("find / -xdev -iname '*descry*' -not -path '/proc/*' -not -path '/sys/*' 2>/dev/null | sort")
        paths = [path for path in found.split("\n") if path and not path.startswith((f"/{HOME}/", "/var/log/"))]
        say(f"left after dpkg {how}: {' '.join(paths)}")
    assert not any(path.startswith(("/usr/", "/lib/", "/etc/systemd")) for path in paths), paths


def lists(machine, packages, place):
    """The lists of what the programs are made of are installed, and are those beside the packages."""
    for program in ("descry", "descry-worker"):
        name = f"{program}.cdx.json"
        installed = (machine.root / place / name).read_bytes()
        assert installed == (packages / name).read_bytes(), f"{place}/{name} is another list than the one beside the packages"


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("packages", type=pathlib.Path)
    parser.add_argument("out", type=pathlib.Path)
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    clean = arguments.out / "clean"
    if not clean.exists():
        output("mmdebstrap", "--variant=minbase", "--include=systemd-sysv,dbus", SUITE, str(clean))
    [package] = arguments.packages.glob("*.deb")
    [tarball] = arguments.packages.glob("*-linux.tar.gz")

    first = Machine(clean, arguments.out / "first")
    first.install(package)
    say(f"installed: {first.run('descry --version; descry-worker --version').strip()}")
    lists(first, arguments.packages, "usr/share/doc/descry/sbom")
    demo(first)
    say("demo: digest as expected")

    second = Machine(clean, arguments.out / "second")
    second.put(tarball, f"{HOME}/descry.tar.gz")
    second.run("tar -xzf descry.tar.gz --strip-components=1 -C /usr/local")
    lists(second, arguments.packages, "usr/local/share/doc/descry/sbom")
    worker = two_machines(first, second)
    assert "left" in worker or "ended" in worker, worker
    say("two machines, one by the package and one by the tarball: digest as expected")

    services(first)
    say("services: killed, started again, digest as expected")
    left(first)
    for machine in (first, second):
        shutil.rmtree(machine.root)


if __name__ == "__main__":
    main()
