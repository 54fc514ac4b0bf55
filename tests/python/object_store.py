"""A bucket that machines share saves the second one its work; a server that fails costs time, never a digest.

Usage: object_store.py PROGRAMS OUT_DIR S3S_FS [--traffic WORKERS] [--generations N]

PROGRAMS is a folder with coordinator and worker, built with --features s3; S3S_FS a server that speaks S3 and keeps objects
as files (cargo install s3s-fs --version 0.14.1 --locked --features binary). As root, for a server whose disk is full.
Each run has a coordinator without workers of its own, and one worker, which has nothing in its cache. --traffic counts
instead what so many workers take from the coordinator and from the bucket, on clouds of which each describes a part.
"""

import argparse
import contextlib
import json
import os
import pathlib
import re
import shutil
import signal
import socket
import ssl
import statistics
import subprocess
import threading
import time

import waiting

REPOSITORY = pathlib.Path(__file__).parents[2]
KEY = {"AWS_ACCESS_KEY_ID": "DESCRYTEST", "AWS_SECRET_ACCESS_KEY": "not-a-secret", "AWS_REGION": "us-east-1"}
URL = "s3://lab/descry"
PATIENCE = 600  # seconds


class Server:
    """A server of one bucket, in a folder."""

    def __init__(self, program, folder):
        self.program, self.folder = program, folder
        (folder / "lab").mkdir(parents=True, exist_ok=True)
        self.port = waiting.free_port()
        self.start()

    def start(self):
        key = ["--access-key", KEY["AWS_ACCESS_KEY_ID"], "--secret-key", KEY["AWS_SECRET_ACCESS_KEY"]]
        address = ["--host", "127.0.0.1", "--port", str(self.port)]
        self.process = subprocess.Popen(
            [self.program, *address, *key, self.folder], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        connect = lambda: socket.create_connection(("127.0.0.1", self.port), 1)
        waiting.wait("the server of the bucket", connect, 30, ignoring=OSError).close()

    def stop(self, how=signal.SIGTERM):
        self.process.send_signal(signal.SIGCONT)
        self.process.send_signal(how)
        self.process.wait()

    def objects(self):
        """Files of objects; the server keeps others of its own."""
        return [path for path in (self.folder / "lab" / "descry").rglob("*") if re.fullmatch("[0-9a-f]{64}", path.name)]


class Relay:
    """Passes bytes on to a port and back, counts them, and waits before each answer; or speaks TLS for it."""

    def __init__(self, port, delay=0.0, tls=None):
        self.port, self.delay, self.tls, self.up, self.down = port, delay, tls, 0, 0
        self.counting = threading.Lock()
        self.listener = socket.create_server(("127.0.0.1", 0), backlog=1024)
        self.own = self.listener.getsockname()[1]
        threading.Thread(target=self.take, daemon=True).start()

    def take(self):
        while True:
            threading.Thread(target=self.connect, args=(self.listener.accept()[0],), daemon=True).start()

    def connect(self, near):
        try:
            near = self.tls.wrap_socket(near, server_side=True) if self.tls else near
            far = socket.create_connection(("127.0.0.1", self.port))
        except OSError:
            near.close()
        else:
            threading.Thread(target=self.carry, args=(near, far, "up"), daemon=True).start()
            self.carry(far, near, "down")

    def carry(self, source, target, way):
        try:
            while piece := source.recv(1 << 16):
                if way == "down" and self.delay:
                    time.sleep(self.delay)
                with self.counting:
                    setattr(self, way, getattr(self, way) + len(piece))
                target.sendall(piece)
        except OSError:
            pass
        for one in (source, target):
            try:
                one.shutdown(socket.SHUT_RDWR)
            except OSError:
                pass


class Site:
    """A folder for runs, with programs and an experiment."""

    def __init__(self, programs, out):
        self.programs, self.out, self.count = pathlib.Path(programs).resolve(), out, 0
        shutil.rmtree(out, ignore_errors=True)
        out.mkdir(parents=True)

    def experiment(self, name, more="", **values):
        text = (REPOSITORY / "experiments/demo.toml").read_text()
        for key, value in {"root": f'"{self.out / name}-clouds"', **values}.items():
            text, count = re.subn(rf"(?m)^{key} = [^ #\n]+", f"{key} = {value}", text)
            assert count == 1, key
        path = self.out / f"{name}.toml"
        path.write_text(text + more)
        return path

    def start(self, program, *arguments, niceness=0, **variables):
        self.count += 1
        log = self.out / f"{program}-{self.count}.log"
        kept = {name: value for name, value in os.environ.items() if not name.startswith(("AWS_", "DESCRY_"))}
        caches = {"XDG_CACHE_HOME": str(self.out / f"cache-{self.count}")}
        command = ["nice", "-n", str(niceness), self.programs / program, *map(str, arguments)]
        process = subprocess.Popen(
            command, env=kept | caches | variables, stdout=subprocess.PIPE, stderr=open(log, "wb"), text=True
        )
        process.log = log
        return process

    def coordinator(self, experiment, *arguments, **variables):
        """A coordinator that waits for workers, and its port."""
        out = self.out / f"run-{self.count}"
        listen = ["--listen", "127.0.0.1:0", "--local-workers", "0", "--json"]
        process = self.start("coordinator", "run", experiment, "--out", out, *listen, *arguments, **variables)
        said = lambda: re.search(r"http://[^ ]+:(\d+)", process.log.read_text())
        return process, int(waiting.wait("the coordinator's port", said, 60)[1])

    def run(self, experiment, *arguments, worker=(), during=None, **variables):
        """A run with one worker: digest, seconds, clouds that the worker has prepared, and what both said."""
        coordinator, port = self.coordinator(experiment, *arguments, **variables)
        begun = time.monotonic()
        believed = {name: value for name, value in variables.items() if name == "SSL_CERT_FILE"}
        helper = self.start("worker", "--coordinator", f"http://127.0.0.1:{port}", *worker, **believed)
        if during:
            during(helper)
        text, _ = coordinator.communicate(timeout=PATIENCE)
        seconds = time.monotonic() - begun
        assert coordinator.returncode == 0, coordinator.log.read_text()
        assert helper.wait(60) == 0, helper.log.read_text()
        said = coordinator.log.read_text() + helper.log.read_text()
        prepared = sum(map(int, re.findall(r"prepared (\d+) and loaded", said)))
        self.waited = sum(map(float, re.findall(r"waited ([0-9.]+) s for it", said)))
        return json.loads(text)["run_digest"], seconds, prepared, said


def same(expected, got, what):
    assert got == expected, f"{what}: digest {got}, expected {expected}"


def works(site, server, environment, generations):
    """Two machines one after the other, with and without a bucket, in turns."""
    experiment = site.experiment("long", population=60, generations=generations)
    times, digest = {"without": [], "filling": [], "filled": []}, None
    for _ in range(3):
        shutil.rmtree(server.folder / "lab" / "descry", ignore_errors=True)
        for name, shared in [("without", []), ("filling", ["--shared", URL]), ("filled", ["--shared", URL])]:
            got, seconds, prepared, said = site.run(experiment, *shared, **environment)
            digest = digest or got
            same(digest, got, name)
            assert (prepared == 0) == (name == "filled"), (name, prepared, said)
            times[name].append(seconds)
            print(f"{name}: {seconds:.2f} s, waited {site.waited} s, {prepared} clouds prepared")
    medians = {name: statistics.median(seconds) for name, seconds in times.items()}
    print("seconds, medians of three in turns:", {name: round(value, 2) for name, value in medians.items()})
    print("objects in the bucket:", len(server.objects()))
    return experiment, digest, medians["without"]


def fails(site, server, environment, experiment, digest, without, program):
    """A server that does not do what it should."""

    def one(name, expected, *arguments, during=None, **variables):
        got, seconds, prepared, said = site.run(
            experiment, "--shared", URL, *arguments, during=during, **(environment | variables)
        )
        same(digest, got, name)
        # What a worker may lose at once and in the long run, and the wait in which that was found out.
        assert site.waited <= 2 + seconds / 20, f"{name}: waited {site.waited} s of {seconds:.1f} s"
        words = [line for line in said.splitlines() if "bucket" in line or "s3://" in line]
        assert any(re.search(expected, line) for line in words), f"{name}: {expected!r} is not in {words}"
        print(f"{name}: {seconds / without:.3f} of the time without, waited {site.waited} s, {prepared} clouds prepared; "
              f"{words[0]}")

    os.kill(server.process.pid, signal.SIGSTOP)
    one("hung", "no answer in time")
    server.stop()
    one("down", "refused")
    server.start()

    def kill(worker):
        waiting.wait("the worker takes from the bucket", lambda: "loaded" in worker.log.read_text(), 60)
        server.stop(signal.SIGKILL)

    got, seconds, _, _ = site.run(experiment, "--shared", URL, during=kill, **environment)
    same(digest, got, "killed")
    print(f"killed during a run: {seconds / without:.3f} of the time without")
    server.start()

    tls, believed = certificate(site.out)
    https = {"AWS_ENDPOINT_URL": f"https://127.0.0.1:{Relay(server.port, tls=tls).own}"}
    got, _, prepared, said = site.run(experiment, "--shared", URL, **environment | https | believed)
    same(digest, got, "over TLS")
    assert prepared == 0, said
    print("over TLS: 0 clouds prepared")
    one("over TLS, without trust in its certificate", "UnknownIssuer", **https)

    slow = Relay(server.port, delay=0.5)
    one("slow, half a second", "no answer in time", AWS_ENDPOINT_URL=f"http://127.0.0.1:{slow.own}")
    one("wrong key", "SignatureDoesNotMatch", AWS_SECRET_ACCESS_KEY="another")

    for path in server.objects():
        with open(path, "r+b") as file:
            file.seek(path.stat().st_size // 2)
            byte = file.read(1)[0]
            file.seek(-1, os.SEEK_CUR)
            file.write(bytes([byte ^ 1]))
    one("corrupt", "doing without it")
    got, _, prepared, _ = site.run(experiment, "--shared", URL, **environment)
    same(digest, got, "mended")
    assert prepared == 0, "what was corrupt was not stored again"

    forge(server.objects())
    got, _, prepared, said = site.run(experiment, "--shared", URL, **environment)
    same(digest, got, "forged")
    assert "is not what its source gives" in said and prepared > 0, said
    print(f"forged by whoever has the key: {prepared} clouds prepared")

    before = {path: path.stat().st_mtime_ns for path in server.objects()}
    shutil.rmtree(server.folder / "lab" / "descry" / "derived")
    got, _, prepared, _ = site.run(experiment, "--shared", URL, "--shared-read-only", **environment)
    same(digest, got, "read only")
    assert prepared > 0 and set(server.objects()) <= set(before), "something was stored"
    print(f"read only: nothing was stored, {prepared} clouds prepared")

    small = site.out / "small"
    small.mkdir()
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=256k", "none", small], check=True)
    try:
        full = Server(program, small)
        one("full", "cannot be written", AWS_ENDPOINT_URL=f"http://127.0.0.1:{full.port}")
        full.stop()
    finally:
        subprocess.run(["umount", "-l", small], check=True)


def certificate(folder):
    """A server's certificate for this machine, and TLS with it."""
    file = folder / "bucket.pem"
    extensions = ["subjectAltName=IP:127.0.0.1", "basicConstraints=critical,CA:FALSE"]
    make = ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-days", "2",
            "-subj", "/CN=bucket", "-keyout", file, "-out", folder / "public.pem"]
    for extension in extensions:
        make += ["-addext", extension]
    subprocess.run(make, check=True, stderr=subprocess.DEVNULL)
    file.write_text(file.read_text() + (folder / "public.pem").read_text())
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(file)
    return context, {"SSL_CERT_FILE": str(folder / "public.pem")}


def forge(paths):
    """Makes each prepared cloud another one, whose checksums are right. As `worker/cache/src/entry.rs` has entries."""
    from blake3 import blake3  # pip install blake3

    for path in (path for path in paths if "prepared-cloud" in str(path)):
        entry = path.read_bytes()
        size = int.from_bytes(entry[48:56], "little")
        payload = bytearray(entry[-size:])
        payload[-1] ^= 1
        header = entry[:56] + blake3(payload).digest() + entry[88 : -size - 32]
        path.write_bytes(header + blake3(header).digest() + payload)


def prunes(site, server, environment):
    """Old objects of Descry go, and nothing else."""
    foreign = server.folder / "lab" / "descry" / "notes.txt"
    foreign.write_text("somebody else's")
    prune = lambda *arguments: site.start("coordinator", "prune", URL, *arguments, **environment).communicate()[0]
    count = len(server.objects())
    print(prune("--days", "1").strip())
    assert len(server.objects()) == count
    print(prune("--days", "0", "--dry-run").strip())
    assert len(server.objects()) == count
    print(prune("--days", "0").strip())
    assert not server.objects() and foreign.exists()


def traffic(site, server, environment, workers):
    """What workers take from the coordinator and from the bucket, on machines that join one after the other."""
    # As many jobs at once as this machine can serve, and twelve evaluations for each worker: work must be left when the
    # last joins.
    more = "\n[coordinator]\npieces = 8\n"
    experiment = site.experiment("traffic", more, generations=workers * 3, population=4, objects=18)
    filling = site.experiment("filling", more, generations=1, population=4, objects=18)
    _, _, prepared, _ = site.run(filling, "--shared", URL, **environment)
    print(f"one worker has filled the bucket: {prepared} clouds, {len(server.objects())} objects", flush=True)
    digests = set()
    for name, shared in [("without", []), ("with", ["--shared", URL])]:
        bucket = Relay(server.port)
        variables = environment | {"AWS_ENDPOINT_URL": f"http://127.0.0.1:{bucket.own}"}
        coordinator, port = site.coordinator(experiment, *shared, **variables)
        relay = Relay(port)
        address = ["--coordinator", f"http://127.0.0.1:{relay.own}", "--threads", "1", "--memory", "64MiB"]
        crowd = []
        for index in range(workers):
            # Workers have processors of their own, elsewhere: here, whoever serves them goes first.
            crowd.append(site.start("worker", *address, "--name", f"w{index}", niceness=19))
            said = lambda: re.search("prepared|run has ended", crowd[-1].log.read_text())
            with contextlib.suppress(AssertionError):  # where others have all the work
                waiting.wait("the worker has clouds", said, 0.3)
        text, _ = coordinator.communicate(timeout=PATIENCE)
        assert coordinator.returncode == 0, coordinator.log.read_text()
        digests.add(json.loads(text)["run_digest"])
        for one in crowd:
            if "joined as" not in one.log.read_text():
                one.terminate()  # the run had ended before it came
            one.wait(120)
        logs = [one.log.read_text() for one in crowd]
        prepared = sum(int(count) for log in logs for count in re.findall(r"prepared (\d+) and loaded", log))
        busy = sum("prepared" in log for log in logs)
        mb = lambda count: f"{count / 1e6:.1f} MB"
        print(f"{busy} of {workers} workers {name} a bucket: coordinator {mb(relay.down)} down, {mb(relay.up)} up;",
              f"bucket {mb(bucket.down)} down, {mb(bucket.up)} up; {prepared} clouds prepared", flush=True)
    assert len(digests) == 1, digests


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("programs")
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("s3s_fs", type=pathlib.Path)
    parser.add_argument("--traffic", type=int)
    parser.add_argument("--generations", type=int, default=120)
    options = parser.parse_args()
    site = Site(options.programs, options.out.resolve())
    server = Server(options.s3s_fs.resolve(), site.out / "objects")
    environment = KEY | {"AWS_ENDPOINT_URL": f"http://127.0.0.1:{server.port}"}
    try:
        if options.traffic:
            traffic(site, server, environment, options.traffic)
        else:
            experiment, digest, without = works(site, server, environment, options.generations)
            fails(site, server, environment, experiment, digest, without, options.s3s_fs.resolve())
            prunes(site, server, environment)
            print("a bucket saves work, and one that fails changes no digest:", digest)
    finally:
        server.stop()
