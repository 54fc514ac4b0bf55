"""A real Prometheus scrapes a coordinator with 1000 workers each second, and has the figures of the run's own tables.

Usage: metrics.py COORDINATOR OUT_DIR [--workers N] [--seconds N]

Needs prometheus and promtool (Debian: prometheus). The workers are in the coordinator's own process, and compute a random
search on the demo's clouds. Then the run is paused, so that nothing changes any more, Prometheus scrapes it twice, and what
it answers is compared with the tables attempts, workers and generations that the run leaves when it is stopped. Checks the
metrics, the alert rules and their tests with promtool, and the queries of the Grafana dashboard with Prometheus. Prints
series, bytes and seconds of a scrape, and the processor time that scraping takes.
"""

import argparse
import json
import os
import pathlib
import re
import shutil
import statistics
import subprocess
import time
import urllib.parse
import urllib.request

import waiting

REPOSITORY = pathlib.Path(__file__).parents[2]
DEPLOY = REPOSITORY / "deploy"
PATIENCE = 600  # seconds
OPENER = urllib.request.build_opener(urllib.request.ProxyHandler({}))
TICKS = os.sysconf("SC_CLK_TCK")


def get(url):
    with OPENER.open(url, timeout=60) as response:
        return response.read().decode()


def wait(what, condition, seconds=PATIENCE):
    return waiting.wait(what, condition, seconds, look=0.1, ignoring=(OSError, ValueError))


def cpu_seconds(pid):
    fields = pathlib.Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


def promtool(*arguments, text=None):
    done = subprocess.run(["promtool", *map(str, arguments)], input=text, capture_output=True, text=True)
    assert done.returncode == 0 and not (text and done.stderr.strip()), f"promtool {arguments}: {done.stdout}{done.stderr}"


class Prometheus:
    """A server that scrapes one address each second."""

    def __init__(self, folder, target):
        self.address = f"127.0.0.1:{waiting.free_port()}"
        shutil.copy(DEPLOY / "prometheus/alerts.yml", folder / "alerts.yml")
        config = {
            "global": {"scrape_interval": "1s", "evaluation_interval": "5s"},
            "rule_files": ["alerts.yml"],
            "scrape_configs": [{"job_name": "descry", "static_configs": [{"targets": [target]}]}],
        }
        path = folder / "prometheus.yml"
        path.write_text(json.dumps(config))  # which is YAML
        promtool("check", "config", path)
        log = open(folder / "prometheus.log", "wb")
        arguments = [f"--config.file={path}", f"--storage.tsdb.path={folder / 'tsdb'}", f"--web.listen-address={self.address}"]
        self.process = subprocess.Popen(["prometheus", *arguments], stdout=log, stderr=log)

    def query(self, expression):
        """Values by labels, without those that Prometheus adds."""
        text = get(f"http://{self.address}/api/v1/query?query={urllib.parse.quote(expression)}")
        added = {"__name__", "instance", "job"}
        result = json.loads(text)["data"]["result"]
        label = lambda one: tuple(sorted(pair for pair in one["metric"].items() if pair[0] not in added))
        return {label(one): float(one["value"][1]) for one in result}

    def one(self, expression):
        values = list(self.query(expression).values())
        return values[0] if len(values) == 1 else None


def table(coordinator, run, sql):
    """Rows of a query of a run's tables."""
    done = subprocess.run([coordinator, "query", run, sql, "--format", "json"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    text = done.stdout.strip()
    return json.loads(text) if text.startswith("[") else [json.loads(line) for line in text.splitlines()]


def check_dashboard(prometheus):
    """Prometheus understands every query of the dashboard; how many it has an answer to."""
    panels = json.loads((DEPLOY / "grafana/descry.json").read_text())["panels"]
    answered = 0
    for panel in panels:
        for target in panel["targets"]:
            expression = target["expr"].replace("$instance", ".*").replace("$__rate_interval", "10s")
            answered += bool(prometheus.query(expression))
    return answered, sum(len(panel["targets"]) for panel in panels)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("coordinator")
    parser.add_argument("out")
    parser.add_argument("--workers", type=int, default=1000)
    parser.add_argument("--seconds", type=int, default=30)
    options = parser.parse_args()
    out = pathlib.Path(options.out).resolve()
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    coordinator, run = pathlib.Path(options.coordinator).resolve(), out / "run"
    promtool("check", "rules", DEPLOY / "prometheus/alerts.yml")
    promtool("test", "rules", DEPLOY / "prometheus/alerts_test.yml")

    text = (REPOSITORY / "experiments/demo.toml").read_text().replace('"../results/data/demo"', json.dumps(str(out / "data")))
    for key, value in {"objects": 6, "views": 8, "population": 2000, "generations": 100_000, "leaf_cm": 4}.items():
        text, found = re.subn(rf"^{key} = .*$", f"{key} = {value}", text, flags=re.MULTILINE)
        assert found, key
    (out / "exp.toml").write_text(text + '\n[search]\nmethod = "random"\n')
    log = open(out / "coordinator.log", "wb")
    command = [coordinator, "run", out / "exp.toml", "--out", run, "--listen", "127.0.0.1:0", "--cache", out / "cache"]
    command += ["--local-workers", str(options.workers), "--metrics", "127.0.0.1:0"]
    processes = [subprocess.Popen([str(part) for part in command], stdout=log, stderr=log)]
    said = lambda pattern: re.search(pattern, (out / "coordinator.log").read_text())
    try:
        at = wait("an address", lambda: said(r"metrics: http://([^/]+)/")).group(1)
        prometheus = Prometheus(out, at)
        processes.append(prometheus.process)
        here = "sum(descry_workers)"
        wait("workers", lambda: prometheus.one(here) == options.workers)
        wait("a generation", lambda: prometheus.one("descry_generation") >= 1)
        seconds, sizes = [], []
        before = cpu_seconds(processes[0].pid), prometheus.one("sum(descry_attempts_total)"), time.monotonic()
        for _ in range(options.seconds):
            begun = time.monotonic()
            sizes.append(len(get(f"http://{at}/metrics")))
            seconds.append(time.monotonic() - begun)
            time.sleep(1)
        rate = (prometheus.one("sum(descry_attempts_total)") - before[1]) / (time.monotonic() - before[2])
        missed = prometheus.one(f"{options.seconds} - sum_over_time(up[{options.seconds}s])")
        took = prometheus.query(f"quantile_over_time(0.5, scrape_duration_seconds[{options.seconds}s])")
        wanted = prometheus.one("descry_wanted_workers")
        assert wanted > 0, "a search at work wants workers"
        assert get(f"http://{at}/healthz") == "ok\n" and get(f"http://{at}/readyz") == "ready\n"
        promtool("check", "metrics", text=get(f"http://{at}/metrics"))
        answered, queries = check_dashboard(prometheus)

        # Nothing changes any more.
        order = lambda action: subprocess.run([coordinator, "control", run, action, "--reason", "a measurement"], check=True, capture_output=True)
        order("pause")
        wait("the pause", lambda: prometheus.one('descry_workers{state="idle"}') == options.workers)
        idle_from = time.monotonic()
        idle_cpu = cpu_seconds(processes[0].pid)
        time.sleep(5)
        idle_cpu = (cpu_seconds(processes[0].pid) - idle_cpu) / (time.monotonic() - idle_from)
        loops = 200
        cpu, begun = cpu_seconds(processes[0].pid), time.monotonic()
        for _ in range(loops):
            get(f"http://{at}/metrics")
        each = (cpu_seconds(processes[0].pid) - cpu - idle_cpu * (time.monotonic() - begun)) / loops
        scraped = {name: prometheus.query(name) for name in (
            "sum by (outcome) (descry_attempts_total)", "descry_workers_joined_total", "descry_generation",
            "descry_best_fitness_ratio", "sum(descry_attempt_duration_seconds_count)", "descry_wanted_threads",
            "sum(descry_leases_total)", "sum(descry_worker_threads)")}
        series = prometheus.one("scrape_samples_scraped")
        order("stop")
        processes[0].wait(PATIENCE)

        one = lambda name: next(iter(scraped[name].values()))
        ends = {row["end"]: row["n"] for row in table(coordinator, run, "SELECT \"end\", COUNT(*) AS n FROM attempts GROUP BY \"end\"")}
        outcomes = {labels[0][1]: value for labels, value in scraped["sum by (outcome) (descry_attempts_total)"].items() if value}
        omitted = max(0, sum(outcomes.values()) - sum(ends.values()))
        if omitted:
            print(f"the table attempts has the first {sum(ends.values())} of {sum(outcomes.values()):.0f} attempts: only sums of generations are compared")
        else:
            assert outcomes == ends, f"{outcomes} scraped, {ends} in the table"
        assert one("sum(descry_leases_total)") == sum(outcomes.values()), "leases without an end"
        rows = table(coordinator, run, "SELECT COUNT(*) AS n FROM workers")[0]["n"]
        assert one("descry_workers_joined_total") == rows == options.workers, rows
        last = table(coordinator, run, "SELECT COUNT(*) AS n, MAX(best_so_far_fitness) AS best FROM generations")[0]
        assert one("descry_generation") == last["n"] and abs(one("descry_best_fitness_ratio") - last["best"]) < 1e-12, last
        assert one("descry_wanted_threads") == 0, "a paused run wants nobody"
        print(f"{options.workers} workers, {rate:.0f} attempts a second while scraped each second; {wanted:.0f} workers were wanted")
        print(f"attempts by outcome, workers, generations ({last['n']}) and best fitness are those of the tables: {outcomes}")
        print(f"{series:.0f} series, {statistics.median(sizes)} bytes, {1e3 * statistics.median(seconds):.1f} ms a scrape (longest {1e3 * max(seconds):.1f}), "
              f"{1e3 * next(iter(took.values())):.1f} ms as Prometheus sees it, {1e3 * each:.2f} ms of a core each while idle; {missed:.0f} scrapes missed")
        print(f"promtool: metrics, rules, tests of rules are clean; {answered} of {queries} queries of the dashboard have an answer")
    finally:
        for process in processes:
            if process.poll() is None:
                process.kill()
                process.wait()


if __name__ == "__main__":
    main()
