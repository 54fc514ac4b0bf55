"""Measures how many new structures a search evaluates a second, with each width of vectors.

Usage: structure_rates.py COORDINATOR OUT [--before COORDINATOR] [--evaluations N] [--repeat N]

Runs a random search of N structures (200) in the space, and by the fitness, of each shipped experiment for structures, with
the threads and benchmark clouds that it finds: DESCRY_SHARED says where these are. OUT is a new folder. Clouds are prepared
beforehand, and no channel is known. Runs take turns; `--before` is the program of another build. All vectors and builds
must give one digest. Prints medians over repetitions, without the time that a run of one structure takes. No test cloud is
looked at.
"""

import argparse
import json
import os
import pathlib
import shutil
import statistics
import subprocess

EXPERIMENTS = pathlib.Path(__file__).parents[2] / "experiments"
VECTORS = ("", "v3", "baseline")  # the widest, AVX2, and what every x86-64 has


def main():
    parser = argparse.ArgumentParser(usage=__doc__)
    parser.add_argument("coordinator")
    parser.add_argument("out", type=pathlib.Path)
    parser.add_argument("--before")
    parser.add_argument("--evaluations", type=int, default=200)
    parser.add_argument("--repeat", type=int, default=1)
    args = parser.parse_args()
    args.out.mkdir(parents=True)
    builds = {"now": args.coordinator} | ({"before": args.before} if args.before else {})
    for name in ("structure", "structure-household"):
        rates = rates_of(name, builds, args)
        for (build, vectors), found in rates.items():
            rate = statistics.median(found)
            print(f"{name}, {vectors or 'widest vectors'}, {build}: {rate:.2f} structures a second", flush=True)


def rates_of(name, builds, args):
    """Structures a second of each build and width, in every repetition."""
    one, many = (experiment(name, args.out, evaluations) for evaluations in (1, args.evaluations))
    prepared = args.out / f"{name}-cache"
    search(args.coordinator, one, prepared, args.out / "run", 1, "")
    rates = {}
    for repetition in range(args.repeat):
        digests = set()
        for vectors in VECTORS:
            for build, coordinator in builds.items():
                cache = args.out / "cache"
                shutil.copytree(prepared, cache)
                whole = search(coordinator, many, cache, args.out / "run", 100 + repetition, vectors)
                rest = search(coordinator, one, cache, args.out / "run", 1, vectors)
                shutil.rmtree(cache)
                digests.add(whole["run_digest"])
                seconds = whole["seconds"] - rest["seconds"]
                rates.setdefault((build, vectors), []).append(args.evaluations / seconds)
        assert len(digests) == 1, f"one search has ended with {digests}"
    return rates


def experiment(name, out, evaluations):
    """The shipped experiment as a random search of so many structures."""
    shared = os.environ.get("DESCRY_SHARED", EXPERIMENTS.parents[1] / "shared")
    text = (EXPERIMENTS / f"{name}.toml").read_text().replace("${DESCRY_SHARED:-../../shared}", str(shared))
    # A run ends with a look at its test clouds: here at those that no list has.
    for shipped, wanted in [('"test.txt"', '"unused.txt"'), ("[search]\n", '[search]\nmethod = "random"\n')]:
        assert text.count(shipped) == 1, shipped
        text = text.replace(shipped, wanted)
    file = out / f"{name}-{evaluations}.toml"
    file.write_text(f'{text}\n[stop]\nevaluations = {evaluations}\n\n[results]\nbaselines = false\n')
    return file


def search(coordinator, file, cache, out, seed, vectors):
    """What a run says of itself at its end."""
    shutil.rmtree(out, ignore_errors=True)
    env = {name: value for name, value in os.environ.items() if name != "DESCRY_VECTORS"}
    env |= {"DESCRY_VECTORS": vectors} if vectors else {}
    options = ["--cache", cache, "--out", out, "--seed", str(seed), "--listen", "127.0.0.1:0", "--json"]
    run = subprocess.run([coordinator, "run", file, *options], env=env, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    return json.loads(run.stdout)


if __name__ == "__main__":
    main()
