"""Crowds of viewers, and a dashboard that dies: the part of dashboard.py that asks whether runs stay as they are."""

import json
import socket
import threading
import time

import dashboard_runs as runs

VIEWERS = 100


class Crowd:
    """Viewers that ask for the whole stream of a run, again and again, and read all of it."""

    def __init__(self, port, run, viewers):
        self.port, self.run, self.over = port, run, threading.Event()
        self.bytes, self.streams, self.refused = 0, 0, 0
        self.lock = threading.Lock()
        self.threads = [threading.Thread(target=self.view, daemon=True) for _ in range(viewers)]
        for thread in self.threads:
            thread.start()

    def view(self):
        head = f"GET /api/stream?id={self.run} HTTP/1.1\r\nHost: 127.0.0.1:{self.port}\r\n\r\n".encode()
        while not self.over.is_set():
            try:
                with socket.create_connection(("127.0.0.1", self.port), timeout=2) as stream:
                    stream.sendall(head)
                    self.read(stream)
            except OSError:
                with self.lock:
                    self.refused += 1
                self.over.wait(0.2)  # it is full, or has ended

    def read(self, stream):
        """Two seconds of a stream."""
        end, got = time.monotonic() + 2, 0
        while not self.over.is_set() and time.monotonic() < end:
            try:
                part = stream.recv(1 << 16)
            except TimeoutError:
                break
            if not part:
                break
            got += len(part)
        with self.lock:
            self.bytes += got
            self.streams += got > 0

    def end(self):
        self.over.set()
        for thread in self.threads:
            thread.join()


def timed(test, name, viewers):
    """Digest and seconds of a run, and its crowd."""
    begun = time.monotonic()
    program = test.programs.run(name, test.exp, "--dashboard", "127.0.0.1:0")
    crowd = Crowd(program.port(), name, viewers)
    try:
        digest = program.digest()
        return digest, time.monotonic() - begun, crowd
    finally:
        crowd.end()


def crowd(test):
    digest, alone, _ = timed(test, "alone", 0)
    assert digest == test.digest, "a run with a dashboard has another digest"
    digest, watched, viewers = timed(test, "crowd", VIEWERS)
    assert digest == test.digest, "a run with a crowd has another digest"
    assert viewers.streams > 0, "nobody in the crowd has seen anything"
    return (
        f"{viewers.streams} streams of {VIEWERS} viewers with {viewers.bytes / 1e6:.1f} MB, {viewers.refused} times "
        f"refused or ended; the run took {watched:.1f} s instead of {alone:.1f} s, the same digest"
    )


def killed(test):
    """A dashboard of its own is killed while the run that it shows goes on."""
    program = test.programs.run("survivor", test.exp)
    served = test.programs.dashboard(test.out / "runs", name="killed")

    def order(action):
        body = json.dumps({"id": "survivor", "action": action, "reason": "a test looks"}).encode()
        return runs.ask(f"{served.address()}api/control", body, Origin=served.address().rstrip("/"))[0] == 200

    # Paused until somebody watches: it may be a matter of seconds.
    runs.wait("the run is paused", lambda: order("pause"))
    viewers = Crowd(served.port(), "survivor", 4)
    try:
        runs.wait("somebody watches", lambda: viewers.streams)
        assert order("resume"), "the run is not resumed"
        served.kill()
        assert program.process.poll() is None, "the run has ended with its dashboard"
        assert program.digest() == test.digest, "a run whose dashboard was killed has another digest"
    finally:
        viewers.end()
    return "kill -9 of the dashboard: the run goes on, the same digest"


CHECKS = [("crowd", crowd), ("killed", killed)]
