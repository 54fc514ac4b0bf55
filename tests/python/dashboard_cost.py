"""Measures what a dashboard costs the run that it shows, and how soon a long run is on show.

Usage: dashboard_cost.py COORDINATOR OUT_DIR [--times N]

Needs playwright (PyPI) and Chromium for the second part. The same run goes on without a dashboard, with one, and with one
that somebody watches, in turn, N times each (5); the table has medians, and the least and most in brackets. Everything
is computed, nothing remembered. The first view is of a run of 2000 individuals; a run of so many workers that
each attempt has another cannot be made here.
"""

import argparse
import json
import os
import pathlib
import socket
import statistics
import threading
import time

import dashboard_runs as runs

FIRST_VIEW = 2.0  # seconds
ARMS = [("without", [], 0), ("with", ["--dashboard", "127.0.0.1:0"], 0), ("watched", ["--dashboard", "127.0.0.1:0"], 1)]


def watch(port, run, over):
    """Reads the stream of a run as the page does."""
    with socket.create_connection(("127.0.0.1", port)) as stream:
        stream.settimeout(0.2)
        stream.sendall(f"GET /api/stream?id={run} HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode())
        while not over.is_set():
            try:
                if not stream.recv(1 << 16):
                    return
            except TimeoutError:
                pass
            except OSError:
                return


def measure(programs, exp, name, options, viewers):
    """Evaluations a second, peak memory in MB, digest."""
    program = programs.run(name, exp, "--json", "--local-workers", "2", *options)
    over, threads = threading.Event(), []
    if viewers:
        port = program.port()
        threads = [threading.Thread(target=watch, args=(port, name, over)) for _ in range(viewers)]
        for thread in threads:
            thread.start()
    _, status, usage = os.wait4(program.process.pid, 0)
    program.process.returncode = os.waitstatus_to_exitcode(status)
    over.set()
    for thread in threads:
        thread.join()
    assert program.process.returncode == 0, program.log.read_text()
    line = next(line for line in program.log.read_text().splitlines() if line.startswith("{"))
    summary = json.loads(line)
    return summary["evaluations_computed"] / summary["seconds"], usage.ru_maxrss / 1024, summary["run_digest"]


def spread(values, digits):
    return f"{statistics.median(values):.{digits}f} [{min(values):.{digits}f}, {max(values):.{digits}f}]"


def cost(programs, exp, times):
    measured = {name: [] for name, _, _ in ARMS}
    measure(programs, exp, "warm", [], 0)
    for turn in range(times):
        for name, options, viewers in ARMS[turn % 3 :] + ARMS[: turn % 3]:
            measured[name].append(measure(programs, exp, f"{name}-{turn}", options, viewers))
    digests = {digest for rows in measured.values() for _, _, digest in rows}
    assert len(digests) == 1, f"one digest expected, got {digests}"
    base = statistics.median(row[0] for row in measured["without"])
    print("dashboard  evaluations a second  against without  peak memory, MB")
    for name, rows in measured.items():
        rates = [row[0] for row in rows]
        change = 100 * (statistics.median(rates) / base - 1)
        print(f"{name:10} {spread(rates, 1):>21} {change:+14.1f} %  {spread([row[1] for row in rows], 0)}")


def first_view(programs, exp):
    programs.run("large", exp, cold=False).digest()
    served = programs.dashboard(programs.out / "runs")
    with runs.browser() as browser:
        print("first view of 2000 individuals, seconds")
        for view, shown in [("overview", ".panel h2"), ("population", "tbody td"), ("timeline", ".lanes canvas")]:
            seconds = []
            for _ in range(3):
                page = browser.new_context(viewport={"width": 1440, "height": 900}).new_page()
                begun = time.monotonic()
                page.goto(runs.address(served.address(), "large", view=view))
                page.locator(f"#content {shown}").first.wait_for()
                if view == "population":
                    runs.wait("all individuals", lambda: "2\u202f000 individuals" in page.inner_text("#content"))
                seconds.append(time.monotonic() - begun)
                page.context.close()
            print(f"{view:10} {spread(seconds, 2)}")
            assert statistics.median(seconds) < FIRST_VIEW, f"{view}: under {FIRST_VIEW} s expected, got {seconds}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("coordinator")
    parser.add_argument("out")
    parser.add_argument("--times", type=int, default=5, help="0: only the first view")
    options = parser.parse_args()
    out = runs.fresh(options.out)
    programs = runs.Programs(pathlib.Path(options.coordinator).resolve(), out)
    try:
        if options.times:
            cost(programs, runs.experiment(out, out / "data"), options.times)
        large = {"population": 500, "generations": 4, "objects": 6, "views": 8}
        first_view(programs, runs.experiment(out, out / "few", **large))
    finally:
        programs.close()


if __name__ == "__main__":
    main()
