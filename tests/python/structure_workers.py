"""Measures what a search for structures, as in the shipped experiments but with the default operators, costs on several
machines, each of which keeps signatures of its own.

Usage: structure_workers.py PROGRAMS DATA OUT [--before PROGRAMS] [--workers N...] [--evaluations N] [--repeat N]

PROGRAMS is a folder with coordinator and worker, DATA is household-rgbd or tabletop-rgbd of the benchmark clouds, OUT a
new folder. Each run has new caches and one thread a worker; all must end with one digest. Runs take turns; `--before` are the
programs of another build. Prints medians of processor seconds of all programs, wall seconds, and scales and evaluations
that were answered twice. No test cloud is looked at.
"""

import argparse
import glob
import json
import os
import pathlib
import resource
import statistics
import subprocess
import time

import polars

from waiting import free_port

EXPERIMENT = """version = 1

[dataset]
root = "{data}"
layout = "uw"

[dataset.splits]
train1 = "train1.txt"
train2 = ["train2.txt", "validation.txt"]
validation = []
test = "unused.txt"

[descriptor]
family = "structure"
members = 4
max_bins = 500
max_cost = 600_000

[search]
winner = "fitness"

[search.fitness]
cross-sequence = 1

[stop]
evaluations = {evaluations}

[results]
baselines = false

[coordinator]
local_workers = 0
"""


def processor_seconds():
    """Of all children that have ended."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def run(programs, experiment, out, workers):
    out.mkdir(parents=True)
    url = f"http://127.0.0.1:{free_port()}"
    before, began = processor_seconds(), time.monotonic()

    def start(program, log, *options):
        env = {**os.environ, "XDG_CACHE_HOME": str(out / f"{log}-cache"), "DESCRY_COORDINATOR": url}
        with open(out / f"{log}.out", "wb") as told, open(out / f"{log}.log", "wb") as said:
            return subprocess.Popen([programs / program, *options], env=env, stdout=told, stderr=said)

    told = ["--out", out / "run", "--listen", url.removeprefix("http://"), "--json"]
    coordinator = start("coordinator", "coordinator", "run", experiment, *told)
    joined = [start("worker", f"worker-{n}", "--threads", "1", "--patience", "60") for n in range(workers)]
    codes = [process.wait() for process in (coordinator, *joined)]
    wall, processor = time.monotonic() - began, processor_seconds() - before
    assert not any(codes), f"{out}: ended with {codes}"
    attempts = polars.read_parquet(glob.glob(f"{out}/run/attempts/*.parquet"))
    return {
        "processor": processor,
        "wall": wall,
        "twice": attempts.filter(polars.col("end") == "agreed").height,
        "digest": json.loads((out / "coordinator.out").read_text())["run_digest"],
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("programs", type=pathlib.Path)
    parser.add_argument("data", type=pathlib.Path)
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--before", type=pathlib.Path)
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 6])
    parser.add_argument("--evaluations", type=int, default=240)
    parser.add_argument("--repeat", type=int, default=3)
    asked = parser.parse_args()
    asked.out.mkdir(parents=True)
    experiment = asked.out / "experiment.toml"
    experiment.write_text(EXPERIMENT.format(data=asked.data.resolve(), evaluations=asked.evaluations))
    builds = {"now": asked.programs.resolve()}
    if asked.before:
        builds["before"] = asked.before.resolve()
    found = {}
    for turn in range(asked.repeat):
        for workers in asked.workers:
            for build, programs in builds.items():
                out = asked.out.resolve() / f"{build}-{workers}-{turn}"
                found.setdefault((workers, build), []).append(run(programs, experiment, out, workers))
    digests = {one["digest"] for runs in found.values() for one in runs}
    assert len(digests) == 1, f"one search has ended with {digests}"
    for (workers, build), runs in found.items():
        median = {key: statistics.median(one[key] for one in runs) for key in ("processor", "wall", "twice")}
        print(
            f"{workers} workers, {build}: {median['processor']:.1f} processor seconds, {median['wall']:.1f} s,"
            f" {median['twice']} answered twice"
        )


if __name__ == "__main__":
    main()
