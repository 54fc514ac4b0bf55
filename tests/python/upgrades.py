"""The last release's programs against today's: what one has left or begun, the other reads and goes on with.

Usage: upgrades.py PROGRAMS OUT_DIR [--old PROGRAMS] [--samples FILE]

PROGRAMS is a folder with coordinator and worker. Without --old, the last release of tests/releases.toml is built once, into
OUT_DIR/VERSION, from its commit. Where both may not work together, because numbers or messages have changed, the test insists
on a refusal that says what to do. --samples instead writes what the programs of PROGRAMS leave behind, for
tests/tests/it/upgrades.rs; call it in a folder and on a host that may be named in public.
"""

import argparse
import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import tarfile
import time
import tomllib
import urllib.parse
import urllib.request

import waiting

REPOSITORY = pathlib.Path(__file__).parents[2]
PATIENCE = 300  # seconds

# Few and coarse clouds: much is said and written, little is computed.
COARSE = """version = 1
name = "{name}"
seed = 7

[dataset]
root = "clouds"

[preprocess]
leaf_cm = 8.0

[descriptor.genes]
shape_bins = {{ min = 8, max = {bins}, step = 1 }}
m = {{ min = 3, max = 4, step = 1 }}
R1 = {{ min = 0.5, max = 1.0, step = 0.1 }}
R2 = {{ min = 2.0, max = 2.5, step = 0.1 }}
w = {{ min = 0.0, max = 1.0, step = 0.1 }}

[ga]
population = 6

[stop]
generations = {generations}
stagnation = "off"
validation_patience = "off"
perfect = false
"""
RANDOM = '\n[search]\nmethod = "random"\n'
BARE = "\n[results]\nbaselines = false\n"
SWEEP = '\n[sweep]\nseeds = "1..3"\n'
# Some of it is computed only when it is asked for.
QUERY = """SELECT generation, individual, shape_bins, m, R1, R2, w, object_correct, category_correct, queries, remembered
FROM evaluations ORDER BY generation, individual"""
# Ends of the messages with which one release refuses what another has begun or sent.
ADVICE = ("install the coordinator's release", "finish this run with that build", "go on with the release that began it",
          "use the release that made", "use the release that wrote it")


class Programs:
    """The programs of a release."""

    def __init__(self, folder, name):
        self.folder, self.name = pathlib.Path(folder).resolve(), name
        said = subprocess.run([self.folder / "coordinator", "--version"], capture_output=True, text=True, check=True).stdout
        found = re.fullmatch(r"coordinator (\S+) \(commit (\S+), evaluation version (\d+)\)\n", said)
        assert found, f"coordinator --version: {said!r}"
        self.version, self.commit, self.numbers = found.groups()

    def __str__(self):
        return f"{self.version} ({self.commit})"


class Program:
    """A program at work; its standard error goes to a file."""

    def __init__(self, command, log, folder, cache):
        self.log = log
        kept = {name: value for name, value in os.environ.items() if not name.startswith("DESCRY_")}
        with open(log, "wb") as file:
            self.process = subprocess.Popen(
                [str(part) for part in command], cwd=folder, env=kept | {"XDG_CACHE_HOME": str(cache)},
                stdout=subprocess.PIPE, stderr=file, text=True)

    def said(self, pattern):
        """What its log says, once it does."""

        def find():
            found = re.search(pattern, self.log.read_text())
            assert found or self.process.poll() is None, f"{self.process.args} ended\n{self.log.read_text()}"
            return found

        return waiting.wait(f"{self.log.name} says {pattern}", find, PATIENCE)[1]

    def ended(self):
        """Its exit code, standard output and log."""
        stdout, _ = self.process.communicate(timeout=PATIENCE)
        return self.process.returncode, stdout, self.log.read_text()

    def kill(self):
        self.process.send_signal(signal.SIGKILL)
        assert self.process.wait() == -signal.SIGKILL, f"{self.log}: it had ended before it was killed"


class Site:
    """A folder with clouds, experiments and runs."""

    def __init__(self, out, maker):
        self.out, self.count, self.programs, self.digests = out, 0, [], {}
        shutil.rmtree(out, ignore_errors=True)
        out.mkdir(parents=True)
        self.finish(maker, "synth", "clouds", "--objects", "4", "--views", "4", "--seed", "7")

    def experiment(self, name, more="", generations=3, bins=15):
        (self.out / f"{name}.toml").write_text(COARSE.format(name=name, generations=generations, bins=bins) + more)
        return f"{name}.toml"

    def start(self, programs, program, *arguments):
        self.count += 1
        log = self.out / f"{self.count:03}-{program}-{programs.name}.log"
        command = [programs.folder / program, *arguments]
        started = Program(command, log, self.out, self.out / f"cache-{self.count}")
        self.programs.append(started)
        return started

    def finish(self, programs, *arguments):
        """Standard output of a command of the coordinator that must succeed."""
        code, stdout, log = self.start(programs, "coordinator", *arguments).ended()
        assert code == 0, f"{programs}: {arguments}\n{log}"
        return stdout

    def run(self, programs, experiment, out, *more):
        """Starts a run."""
        at = () if "--listen" in more else ("--listen", "127.0.0.1:0")
        return self.start(programs, "coordinator", "run", experiment, "--out", out, "--json", *at, *more)

    def digest(self, programs, experiment, out, *more):
        return digest(self.run(programs, experiment, out, *more))

    def worker(self, programs, address, name):
        return self.start(programs, "worker", "--coordinator", address, "--name", name, "--threads", "1")

    def finished(self, programs):
        """The folder of a finished run of these programs, made once, and its digest."""
        out = f"read-{programs.name}"
        if out not in self.digests:
            self.digests[out] = self.digest(programs, self.experiment("read"), out)
        return out, self.digests[out]

    def killed(self, programs, experiment, out, *more):
        """A run whose coordinator is killed in its third generation or later."""
        begun = self.run(programs, experiment, out, *more)
        written = self.out / out / "generations/generation-00002.parquet"
        waiting.wait(f"{out} comes to its third generation", written.exists, PATIENCE, look=0.01)
        begun.kill()
        assert (self.out / out / "journal.log").exists(), f"{out}: no journal is left"
        assert not (self.out / out / "run/run.parquet").exists(), f"{out}: it was finished before it was killed"

    def end(self):
        for program in self.programs:
            if program.process.poll() is None:
                program.process.kill()
                program.process.wait()


def digest(program):
    """The digest of a run that must end well."""
    code, stdout, log = program.ended()
    assert code == 0, log
    return json.loads(stdout)["run_digest"]


def same(what, expected, got):
    assert got == expected, f"{what}: {got}, expected {expected}"


def goes_on(what, program, expected):
    """A run that another release has begun ends with the expected digest, or is refused with what to do."""
    code, stdout, log = program.ended()
    if code == 0:
        same(what, expected, json.loads(stdout)["run_digest"])
        return "same digest"
    assert any(advice in log for advice in ADVICE), f"{what}: {log}"
    return "refused, with advice"


def both_ways(old, new):
    return [("old, then new", old, new), ("new, then old", new, old)]


def numbers(site, old, new):
    """Both compute the same, or name another evaluation version."""
    digests = [site.digest(programs, site.long, f"alone-{name}") for name, programs in (("old", old), ("new", new))]
    assert (digests[0] == digests[1]) == (old.numbers == new.numbers), (digests, old.numbers, new.numbers)
    site.expected = digests[1]
    return f"digest {digests[1][:12]}, evaluation versions {old.numbers} and {new.numbers}"


def killed(site, old, new):
    """A coordinator of one release is killed in the middle of a run, and one of the other goes on with it."""
    said = []
    for name, first, second in both_ways(old, new):
        out = f"killed-{first.name}"
        site.killed(first, site.long, out)
        resumed = site.start(second, "coordinator", "resume", out, "--listen", "127.0.0.1:0", "--json")
        said.append(f"{name}: {goes_on(name, resumed, site.expected)}")
    return "; ".join(said)


def replaced(site, old, new):
    """A coordinator is killed and replaced beneath its worker, which stays what it is and keeps its jobs."""
    said = []
    for name, first, second in both_ways(old, new):
        out, address = f"replaced-{first.name}", f"127.0.0.1:{waiting.free_port()}"
        worker = site.worker(first, f"http://{address}", "stays")
        at = ("--local-workers", "0", "--listen", address)
        site.killed(first, site.long, out, *at)
        ended = goes_on(name, site.run(second, site.long, out, *at), site.expected)
        if ended == "same digest":
            code, _, log = worker.ended()
            assert code == 0 and log.count("joined as stays") == 1, log
        said.append(f"{name}: {ended}")
    return "; ".join(said)


def together(site, coordinator, workers):
    """A run with these workers only; all of them compute some of it."""
    names = [f"{worker.name}-{number}" for number, worker in enumerate(workers)]
    out = f"with-{coordinator.name}-{'-'.join(names)}"
    begun = site.run(coordinator, site.long, out, "--local-workers", "0")
    address = begun.said(r"--coordinator (http://\S+)")
    helpers = [site.worker(worker, address, name) for worker, name in zip(workers, names, strict=True)]
    for helper, name in zip(helpers, names, strict=True):
        joined = lambda: "joined as" in helper.log.read_text() or helper.process.poll() is not None
        waiting.wait(f"{name} joins {coordinator} or is refused", joined, PATIENCE)
        if helper.process.poll() not in (None, 0):
            log = helper.log.read_text()
            assert any(advice in log for advice in ADVICE), log
            begun.kill()
            return "refused, with advice"
    same(out, site.expected, digest(begun))
    answered = site.finish(
        coordinator, "query", out, "SELECT worker, count(*) AS jobs FROM attempts GROUP BY worker", "--format", "json")
    jobs = {row["worker"]: row["jobs"] for row in json.loads(answered)}
    assert sorted(jobs) == sorted(names) and all(jobs.values()), f"{out}: {jobs}"
    for helper, worker in zip(helpers, workers, strict=True):
        assert helper.ended()[0] == 0, helper.log.read_text()
        assert f", descry {worker.version}" in begun.log.read_text(), begun.log.read_text()
    return "same digest, jobs " + ", ".join(f"{name} {count}" for name, count in sorted(jobs.items()))


def old_coordinator_new_workers(site, old, new):
    return together(site, old, [new, new])


def new_coordinator_old_workers(site, old, new):
    return together(site, new, [old, old])


def mixed_workers(site, old, new):
    return "; ".join(f"{one.name}: {together(site, one, [old, new])}" for one in (old, new))


def cache(site, old, new):
    """Both use one cache folder in turns; nothing of the other's is removed or computed again."""
    if old.numbers != new.numbers:
        return separate_caches(site, old, new)
    short = site.experiment("cached", BARE)
    folder = site.out / "cache"

    def run(programs, name, seed):
        finished = site.run(programs, short, name, "--cache", folder, "--seed", seed)
        code, stdout, log = finished.ended()
        assert code == 0 and "WARN" not in log, log
        summary = json.loads(stdout)
        return summary["run_digest"], summary["evaluations_computed"]

    first, computed = run(old, "cached-old-1", "1")
    assert computed > 0, "there was nothing to compute"
    same("what old has left", (first, 0), run(new, "cached-new-1", "1"))
    second, computed = run(new, "cached-new-2", "2")
    assert computed > 0, "there was nothing to compute"
    same("what old has left, after new has written", (first, 0), run(old, "cached-old-again", "1"))
    same("what new has left", (second, 0), run(old, "cached-old-2", "2"))

    before = [path for path in files(folder) if "remembered-counts" not in str(path)]
    for one in (new, old):
        # Counts are forgotten, so that there is something to compute. Those of workers that nobody has audited are not kept.
        shutil.rmtree(folder / "derived/remembered-counts", ignore_errors=True)
        begun = site.run(one, short, f"prepared-{one.name}", "--cache", folder, "--seed", "1", "--local-workers", "0")
        address = begun.said(r"--coordinator (http://\S+)")
        worker = site.start(one, "worker", "--coordinator", address, "--threads", "1", "--cache", folder)
        same("computed again from prepared clouds", first, digest(begun))
        code, _, log = worker.ended()
        prepared = re.findall(r"prepared (\d+) and loaded (\d+)", log)
        assert code == 0 and prepared and {count for count, _ in prepared} == {"0"}, log
    gone = [path for path in before if not path.exists()]
    assert not gone, f"removed: {gone}"
    return f"3 runs with 0 evaluations computed, 2 with 0 clouds prepared; all {len(before)} entries are still there"


def separate_caches(site, old, new):
    """Releases of different numbers: each leaves the other's entries alone."""
    short, folder = site.experiment("cached", BARE), site.out / "cache"
    first = site.digest(old, short, "cached-old", "--cache", folder)
    before = {path: path.read_bytes() for path in files(folder) if "finished-run" not in str(path)}
    site.digest(new, short, "cached-new", "--cache", folder)
    same("entries of old", before, {path: path.read_bytes() for path in before if path.exists()})
    same("old again", first, site.digest(old, short, "cached-old-again", "--cache", folder))
    return f"{len(before)} entries of evaluation version {old.numbers} left alone"


def files(folder):
    return sorted(path for path in folder.rglob("*") if path.is_file())


def tables(site, old, new):
    """Finished runs are read, verified, compared and reported by both."""
    said = []
    for name, first, second in both_ways(old, new):
        out, written = site.finished(first)
        rows = [site.finish(programs, "query", out, QUERY, "--format", "csv") for programs in (first, second)]
        same(f"{name}: rows", rows[0], rows[1])
        assert rows[0].count("\n") == 1 + 3 * 6, rows[0]
        sample = "10" if old.numbers == new.numbers else "0"
        verified = site.finish(second, "verify", out, "--sample", sample)
        assert written in verified, verified
        if sample != "0":
            again = site.digest(second, "read.toml", out)
            same(f"{name}: a finished run is shown again", written, again)
        page = site.out / f"{out}.html"
        site.finish(second, "report", out, "--out", page)
        assert written[:12] in page.read_text(), f"{page} does not name the run digest"
        said.append(f"{name}: {rows[0].count(chr(10)) - 1} rows, verified, reported")
    return "; ".join(said)


def artefacts(site, old, new):
    """What one exports, the other opens, and gives the same answers, bit for bit."""
    said = []
    for name, first, second in both_ways(old, new):
        (out, _), artefact = site.finished(first), f"artefact-{first.name}"
        site.finish(first, "export", out, artefact)
        clouds = [f"clouds/{line}" for line in (site.out / "clouds/test.txt").read_text().split()]
        clouds = clouds[:4] + [f"{artefact}/example.pcd"]
        answers = [site.start(programs, "coordinator", "recognise", artefact, *clouds, "--json").ended()
                   for programs in (first, second)]
        assert answers[0][0] == 0 and len(answers[0][1].splitlines()) == len(clouds), answers[0]
        if old.numbers == new.numbers:
            same(f"{name}: answers", answers[0][:2], answers[1][:2])
            said.append(f"{name}: {len(clouds)} answers")
        else:
            assert answers[1][0] == 1 and any(advice in answers[1][2] for advice in ADVICE), answers[1]
            said.append(f"{name}: refused, with advice")
    return "; ".join(said)


def dashboards(site, old, new):
    """Run folders in a browser: finished ones, and one whose coordinator was killed."""
    for programs in (old, new):
        site.killed(programs, site.long, f"dead-{programs.name}")
    folders = [site.finished(old)[0], site.finished(new)[0], "dead-old", "dead-new"]
    for programs in (new, old):
        served = site.start(programs, "coordinator", "dashboard", *folders, "--listen", "127.0.0.1:0")
        base = served.said(r"(http://127\.0\.0\.1:\d+)")
        ask = lambda path: urllib.request.urlopen(f"{base}/{path}", timeout=60).read()
        listed = json.loads(ask("api/runs"))["runs"]
        states = sorted(one["state"] for one in listed)
        assert len(states) == 4 and states.count("finished") == 2 and states.count("running") == 0, listed
        for one in listed:
            generations = json.loads(ask(f"api/generations?id={urllib.parse.quote(one['id'], safe='')}"))
            assert generations, f"{one['id']}: no generations"
        served.process.send_signal(signal.SIGTERM)
        served.ended()
    return "4 folders on show in each"


def sweeps_and_grids(site, old, new):
    """A sweep and a grid whose coordinator was killed are finished by the other release."""
    sweep = site.experiment("sweep", RANDOM + SWEEP, generations=60)
    grid = site.experiment("grid")
    listen = ("--listen", "127.0.0.1:0", "--json")
    whole = [json.loads(line)["run_digest"] for line in site.finish(new, "run", sweep, "--out", "sweep", *listen).splitlines()]
    cells = json.loads(site.finish(new, "exhaust", grid, "--out", "grid", *listen))
    assert len(whole) == 3, whole
    said = []
    for name, first, second in both_ways(old, new):
        out = f"sweep-{first.name}"
        begun = site.start(first, "coordinator", "run", sweep, "--out", out, *listen)
        written = site.out / out / "seed-2/generations/generation-00002.parquet"
        waiting.wait("the sweep's second generation", written.exists, PATIENCE, look=0.01)
        begun.kill()
        code, stdout, log = site.start(second, "coordinator", "resume", out, *listen).ended()
        got = [json.loads(line)["run_digest"] for line in stdout.splitlines()]
        assert got == whole if code == 0 else any(advice in log for advice in ADVICE), f"{name}: {got}\n{log}"

        out = f"grid-{first.name}"
        begun = site.start(first, "coordinator", "exhaust", grid, "--out", out, *listen)
        begun.said(r"(cell [3-9]/)")
        begun.kill()
        code, stdout, log = site.start(second, "coordinator", "exhaust", grid, "--out", out, *listen).ended()
        if code == 0:
            summary = json.loads(stdout)
            same(f"{name}: grid", cells["grid_digest"], summary["grid_digest"])
            assert summary["cells_found"] >= 3, summary
        else:
            assert any(advice in log for advice in ADVICE), f"{name}: {log}"
        said.append(f"{name}: {'both finished' if code == 0 else 'refused, with advice'}")
    return "; ".join(said)


SCENARIOS = [numbers, killed, replaced, old_coordinator_new_workers, new_coordinator_old_workers, mixed_workers, cache, tables,
             artefacts, dashboards, sweeps_and_grids]


def samples(site, programs, file):
    """What a release leaves: a finished run, an unfinished one, an artefact with its answers, a cache."""
    home = programs.version
    site.experiment("finished")
    site.experiment("unfinished", RANDOM, generations=40)
    site.experiment("cached", BARE)
    site.digest(programs, "finished.toml", "finished")
    site.killed(programs, "unfinished.toml", "unfinished")
    site.finish(programs, "export", "finished", "artefact")
    answers = site.finish(programs, "recognise", "artefact", "artefact/example.pcd", "--json", "--top", "3")
    (site.out / "answers.json").write_text(answers)
    (site.out / "query.sql").write_text(QUERY)
    (site.out / "query.csv").write_text(site.finish(programs, "query", "finished", QUERY, "--format", "csv"))
    cached = site.digest(programs, "cached.toml", "cached", "--cache", "cache")
    (site.out / "cached.digest").write_text(cached)
    parts = ["finished.toml", "finished", "unfinished.toml", "unfinished", "artefact", "answers.json", "query.sql", "query.csv",
             "cached.toml", "cached.digest", "cache"]

    def anonymous(info):
        info.uid, info.gid, info.uname, info.gname = 0, 0, "", ""
        return info

    with tarfile.open(file, "w:gz", compresslevel=9) as archive:
        for part in parts:
            archive.add(site.out / part, f"{home}/{part}", filter=anonymous)
    print(f"{file}: {file.stat().st_size} bytes of {programs}")


def build(out):
    """The programs of the last release, built once from its commit."""
    release = tomllib.loads((REPOSITORY / "tests/releases.toml").read_text())["release"][-1]
    folder, source = out / release["version"], out / f"{release['version']}-source"
    if not (folder / "worker").is_file():
        subprocess.run(["git", "worktree", "prune"], cwd=REPOSITORY, check=True)
        if not source.is_dir():
            subprocess.run(["git", "worktree", "add", "--detach", source, release["commit"]], cwd=REPOSITORY, check=True)
        command = ["nice", "-n", "19", "cargo", "build", "--release", "--locked", "-p", "coordinator", "-p", "worker"]
        target = out / f"{release['version']}-target"
        subprocess.run([*command, "--target-dir", target], cwd=source, check=True)
        folder.mkdir(parents=True, exist_ok=True)
        for name in ("coordinator", "worker"):
            shutil.copy2(target / "release" / name, folder / name)
        subprocess.run(["git", "worktree", "remove", "--force", source], cwd=REPOSITORY, check=True)
        shutil.rmtree(target)
    programs = Programs(folder, "old")
    assert release["commit"].startswith(programs.commit), f"{folder}: is of commit {programs.commit}, expected {release}"
    return programs


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("programs", type=pathlib.Path, help="folder of today's coordinator and worker")
    parser.add_argument("out", type=pathlib.Path, help="folder for everything that is written")
    parser.add_argument("--old", type=pathlib.Path, help="folder of the last release's programs, instead of building them")
    parser.add_argument("--samples", type=pathlib.Path, help="only write samples of PROGRAMS into this file")
    parser.add_argument("--only", help="only scenarios whose names contain this; numbers come first in any case")
    options = parser.parse_args()
    out, new = options.out.resolve(), Programs(options.programs, "new")
    if options.samples:
        site = Site(out / "samples", new)
        return samples(site, new, options.samples.resolve())
    out.mkdir(parents=True, exist_ok=True)
    old = Programs(options.old, "old") if options.old else build(out)
    print(f"old: {old}; new: {new}")
    site = Site(out / "site", new)
    try:
        site.long = site.experiment("long", RANDOM + BARE, generations=100)
        for scenario in SCENARIOS:
            if scenario is numbers or not options.only or options.only in scenario.__name__:
                begun = time.monotonic()
                said = scenario(site, old, new)
                print(f"{scenario.__name__.replace('_', ' ')}, {time.monotonic() - begun:.1f} s: {said}", flush=True)
    finally:
        site.end()


if __name__ == "__main__":
    main()
