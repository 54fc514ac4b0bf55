"""Starts the coordinator, its dashboards and a browser for dashboard.py and dashboard_cost.py."""

import contextlib
import json
import os
import pathlib
import re
import shutil
import ssl
import subprocess
import urllib.error
import urllib.parse
import urllib.request

import waiting
from playwright.sync_api import sync_playwright

REPOSITORY = pathlib.Path(__file__).parents[2]
DEMO = REPOSITORY / "experiments/demo.toml"
BROWSER = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
PATIENCE = 40  # seconds, for what takes some on a busy machine
UNCHECKED = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)  # of certificates that a test has just made
UNCHECKED.check_hostname, UNCHECKED.verify_mode = False, ssl.CERT_NONE
OPENER = urllib.request.build_opener(
    urllib.request.ProxyHandler({}), urllib.request.HTTPSHandler(context=UNCHECKED)
)


def wait(what, condition, seconds=PATIENCE):
    return waiting.wait(what, condition, seconds)


def experiment(folder, data, **values):
    """A copy of the demo in a folder, with other values of some keys, such as population=4."""
    text = DEMO.read_text().replace('"../results/data/demo"', json.dumps(str(data)))
    for key, value in values.items():
        text, found = re.subn(rf"^{key} = .*$", f"{key} = {value}", text, flags=re.MULTILINE)
        assert found, f"{DEMO}: no {key}"
    path = pathlib.Path(folder) / f"{'-'.join(f'{key}-{value}' for key, value in values.items()) or 'demo'}.toml"
    path.write_text(text)
    return path


class Program:
    """A program whose standard error goes to a file."""

    def __init__(self, command, log):
        self.log = pathlib.Path(log)
        with open(log, "wb") as file:
            self.process = subprocess.Popen([str(part) for part in command], stdout=file, stderr=file)

    def said(self, pattern, seconds=PATIENCE):
        """What a line of its output says, once it does."""

        def find():
            found = re.search(pattern, self.log.read_text())
            assert found or self.process.poll() in (None, 0), f"{self.process.args} failed: {self.log.read_text()}"
            return found

        return wait(f"{self.log.name} says {pattern}", find, seconds).group(1)

    def address(self):
        return self.said(r"dashboard: (https?://[^/]+/)")

    def port(self):
        return int(self.address().rstrip("/").rsplit(":", 1)[1])

    def ended(self, seconds=PATIENCE * 3):
        """Its exit code."""
        return self.process.wait(seconds)

    def digest(self):
        """The digest of the run, once it has ended."""
        assert self.ended() == 0, f"{self.process.args} failed: {self.log.read_text()}"
        return self.said(r"run digest\s+([0-9a-f]{64})")

    def kill(self):
        self.process.kill()
        self.process.wait()


class Programs:
    """Makes programs that end with it."""

    def __init__(self, coordinator, out):
        self.coordinator, self.out = coordinator, pathlib.Path(out)
        self.running = []

    def start(self, name, *arguments):
        program = Program([self.coordinator, *arguments], self.out / f"{name}.log")
        self.running.append(program)
        return program

    def run(self, name, exp, *arguments, cold=True):
        """An experiment; cold: nothing that others have computed is used."""
        cache = ["--no-cache"] if cold else ["--cache", self.out / "cache"]
        place = ["--out", self.out / "runs" / name, "--listen", "127.0.0.1:0"]
        return self.start(name, "run", exp, *place, *cache, *arguments)

    def dashboard(self, folder, *arguments, listen="127.0.0.1:0", name="dashboard"):
        return self.start(name, "dashboard", folder, "--listen", listen, *arguments)

    def close(self):
        for program in self.running:
            if program.process.poll() is None:
                program.kill()


@contextlib.contextmanager
def browser():
    """Chromium as the system has it."""
    executable = shutil.which("chromium")
    assert executable, "chromium: not installed"
    with sync_playwright() as playwright:
        made = playwright.chromium.launch(executable_path=executable, args=BROWSER)
        try:
            yield made
        finally:
            made.close()


def address(base, run=None, **values):
    """The address of a view."""
    if run is not None:
        values = {"run": run, **values}
    return base + "#" + "&".join(f"{key}={urllib.parse.quote(value, safe='')}" for key, value in values.items())


def ask(url, body=None, **headers):
    """Status and body of a request; header names with _ for -."""
    headers = {name.replace("_", "-"): value for name, value in headers.items()}
    request = urllib.request.Request(url, data=body, headers=headers)
    try:
        with OPENER.open(request, timeout=PATIENCE) as response:
            return response.status, response.read()
    except urllib.error.HTTPError as error:
        return error.code, error.read()


def peak_bytes(pid):
    """The most memory that a process has had so far; None once it has gone."""
    try:
        found = re.search(r"VmHWM:\s+(\d+) kB", pathlib.Path(f"/proc/{pid}/status").read_text())
    except (FileNotFoundError, ProcessLookupError):
        return None
    return int(found.group(1)) * 1024 if found else None


def fresh(folder):
    """An empty folder."""
    shutil.rmtree(folder, ignore_errors=True)
    os.makedirs(folder)
    return pathlib.Path(folder).resolve()
