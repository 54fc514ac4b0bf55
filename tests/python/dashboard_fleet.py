"""Measures how the dashboard bears 2000 individuals a generation and 1000 workers: the first view, and updates while open.

Usage: dashboard_fleet.py COORDINATOR OUT_DIR [--workers N] [--population N] [--seconds N] [--views NAMES] [--page DIR]

Needs playwright (PyPI) and Chromium. A coordinator with that many workers in its own process runs a random search on the
demo's clouds; another process serves its folder. First views are timed while the run is paused: the search would take the
cores that they need. Then it goes on, each view stays open for so many seconds, and what page (the process that runs it),
browser (all its other processes, which draw without a graphics card) and server take of a core a second is read from the
operating system. Exit code 1 if a figure is over the budget: a first view of 2 s, updates of 100 ms for page or server.
"""

import argparse
import json
import os
import pathlib
import statistics
import sys
import time

import dashboard_runs as runs

FIRST_VIEW = 2.0  # seconds
UPDATES = 100.0  # milliseconds of a core a second
SHOWN = {
    "overview": ".panel h2",
    "convergence": ".chart svg path",
    "population": "tbody td",
    "fleet": "tbody td",
    "timeline": ".lanes canvas",
    "log": ".panel",
}
TICKS = os.sysconf("SC_CLK_TCK")


def processor():
    lines = pathlib.Path("/proc/cpuinfo").read_text().splitlines()
    name = next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), "unknown")
    return f"{name}, {os.cpu_count()} cores"


def cpu_ms(pid):
    """Milliseconds of a core that a process has taken so far."""
    fields = pathlib.Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return 1000 * (int(fields[11]) + int(fields[12])) / TICKS


class Browser:
    """The browser's processes by what they do."""

    def __init__(self, browser):
        self.session = browser.new_browser_cdp_session()

    def cpu_ms(self):
        """Of renderers, and of all others."""
        of = {"page": 0.0, "browser": 0.0}
        for process in self.session.send("SystemInfo.getProcessInfo")["processInfo"]:
            of["page" if process["type"] == "renderer" else "browser"] += 1000 * process["cpuTime"]
        return of


def order(served, run, action):
    body = json.dumps({"id": run, "action": action, "reason": "a measurement"}).encode()
    status, text = runs.ask(f"{served.address()}api/control", body, Origin=served.address().rstrip("/"))
    return status == 200 or b"already" in text


def state(served, run):
    return json.loads(runs.ask(f"{served.address()}api/run?id={run}")[1])["run"]


def open_view(test, served, view):
    """A page with a view, and the seconds until it shows something."""
    page = test.new_context(viewport={"width": 1440, "height": 900}).new_page()
    if served.page_folder:
        page.route("**/*.js", lambda route: from_folder(served.page_folder, route))
    begun = time.monotonic()
    page.goto(runs.address(served.address(), "fleet", view=view))
    page.locator(f"#content {SHOWN[view]}").first.wait_for(state="attached")
    return page, time.monotonic() - begun


def from_folder(folder, route):
    path = pathlib.Path(folder) / route.request.url.split("?")[0].rsplit("/", 1)[1]
    route.fulfill(path=path) if path.exists() else route.continue_()


def first_views(browser, served, views):
    seconds = {}
    for view in views:
        taken = []
        for _ in range(3):
            page, took = open_view(browser, served, view)
            taken.append(took)
            page.context.close()
        seconds[view] = statistics.median(taken)
    return seconds


def updates(browser, served, view, seconds):
    """Milliseconds of a core a second of page, other processes of the browser, and server; messages a second."""
    page, _ = open_view(browser, served, view)
    processes = Browser(browser)
    time.sleep(3)  # the first view is over
    before, server, begun = processes.cpu_ms(), cpu_ms(served.process.pid), time.monotonic()
    time.sleep(seconds)
    after, server = processes.cpu_ms(), cpu_ms(served.process.pid) - server
    took = time.monotonic() - begun
    page.context.close()
    return {**{name: (after[name] - before[name]) / took for name in after}, "server": server / took}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("coordinator")
    parser.add_argument("out")
    parser.add_argument("--workers", type=int, default=1000)
    parser.add_argument("--population", type=int, default=2000)
    parser.add_argument("--seconds", type=int, default=20)
    parser.add_argument("--views", default=",".join(SHOWN))
    parser.add_argument("--page", help="takes the page's modules from a folder instead of from the program")
    options = parser.parse_args()
    out = runs.fresh(options.out)
    programs = runs.Programs(pathlib.Path(options.coordinator).resolve(), out)
    views = options.views.split(",")
    try:
        exp = runs.experiment(out, out / "data", objects=6, views=8, **{"population": options.population, "generations": 100_000, "leaf_cm": 4})
        exp.write_text(exp.read_text() + '\n[search]\nmethod = "random"\n')
        program = programs.run("fleet", exp, "--local-workers", str(options.workers), cold=False)
        program.said(r"(generation 1/)", seconds=600)
        served = programs.dashboard(out / "runs")
        served.page_folder = options.page
        runs.wait("the run is paused", lambda: order(served, "fleet", "pause"))
        runs.wait("its jobs are done", lambda: state(served, "fleet")["state"] == "paused")
        now = state(served, "fleet")
        assert now["workers"] == options.workers, f"{options.workers} workers expected, got {now['workers']}"
        with runs.browser() as browser:
            first = first_views(browser, served, views)
            assert order(served, "fleet", "resume"), "the run is not resumed"
            begun, done = time.monotonic(), now["evaluations_computed"]
            rows = {view: updates(browser, served, view, options.seconds) for view in views}
        now = state(served, "fleet")
        rate = (now["evaluations_computed"] - done) / (time.monotonic() - begun)
        print(f"{processor()}; {options.population} individuals a generation, {options.workers} workers")
        print(f"{now['generation']} generations, {rate:.0f} evaluations a second while views were open")
        print("view         first view, s   ms of a core a second:  page  browser  server")
        for view, row in rows.items():
            print(f"{view:12} {first[view]:13.2f} {row['page']:28.0f} {row['browser']:8.0f} {row['server']:7.0f}")
        slow = [view for view in views if first[view] > FIRST_VIEW]
        dear = [view for view in views if max(rows[view]["page"], rows[view]["server"]) > UPDATES]
        print(f"over the budget: first view {slow or 'none'}, updates {dear or 'none'}")
    finally:
        programs.close()
    sys.exit(1 if slow or dear else 0)


if __name__ == "__main__":
    main()
