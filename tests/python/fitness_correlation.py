"""Asks how well each fitness foretells the error on another sequence, for random structures.

Usage: fitness_correlation.py COORDINATOR DATA OUT [STRUCTURES], where DATA is household-rgbd or tabletop-rgbd of the
benchmark clouds and OUT a new folder; needs polars. Prints Spearman's rank correlation of each fitness with the error.

Only training clouds are looked at, of sequences 1 and 4. What is to be foretold is the error of sequence 4 matched with
sequence 1. Fitness "split" and "leave-one-out" see sequence 1 alone. "cross-sequence" needs two sequences, so it sees
every other cloud of both, and foretells the error of those that are left. A random search with the same seed evaluates
the same structures whatever the fitness is, so runs are joined by chromosome.
"""

import pathlib
import re
import subprocess
import sys

import polars as pl

EXPERIMENT = """version = 1
seed = 1

[dataset]
root = "{data}"
layout = "uw"

[dataset.splits]
train1 = "{lists}/{train1}.txt"
train2 = "{lists}/{train2}.txt"
test = "{lists}/unused.txt"

[descriptor]
family = "structure"

[search]
method = "random"
winner = "fitness"

[search.fitness]
{fitness} = 1
margin = true

[ga]
population = 50

[stop]
evaluations = {structures}
"""


def lists_of(data, folder):
    """Writes the lists of clouds that runs take."""
    lines = [line for name in ("train1", "train2") for line in (data / f"{name}.txt").read_text().split()]
    sequence = {line: re.search(r"_(\d+)_\d+\.pcd$", line).group(1) for line in lines}
    folder.mkdir(parents=True)
    for number in ("1", "4"):
        clouds = [line for line in lines if sequence[line] == number]
        for name, part in (("all", clouds), ("odd", clouds[::2]), ("even", clouds[1::2])):
            (folder / f"s{number}-{name}.txt").write_text("\n".join(part) + "\n")
    # A run ends with a look at its test clouds: here at one that no list has.
    (folder / "unused.txt").write_text((data / "unused.txt").read_text().split()[0] + "\n")


def run(coordinator, out, name, **values):
    """The evaluations of a random search."""
    toml = out / f"{name}.toml"
    toml.write_text(EXPERIMENT.format(lists=(out / "lists").resolve(), **values))
    subprocess.run([coordinator, "run", toml, "--out", out / name], check=True, stdout=subprocess.DEVNULL)
    rows = pl.read_parquet(out / name / "evaluations" / "**" / "*.parquet")
    return rows.unique("chromosome").select("chromosome", "object_correct", "margin")


def main():
    coordinator, data, out = sys.argv[1], pathlib.Path(sys.argv[2]).resolve(), pathlib.Path(sys.argv[3])
    structures = int(sys.argv[4]) if len(sys.argv) > 4 else 200
    lists_of(data, out / "lists")

    def evaluations(name, fitness, train1, train2):
        values = dict(data=data, fitness=fitness, train1=train1, train2=train2, structures=structures)
        return run(coordinator, out, name, **values)

    of_all = evaluations("error", "split", "s4-all", "s1-all")
    of_even = evaluations("error-even", "split", "s4-even", "s1-even")
    print("| fitness | clouds | counts | counts, then margin | structures |\n|---|---|---|---|---|")
    for fitness, clouds, train1, train2, truth in (
        ("split", "sequence 1", "s1-odd", "s1-even", of_all),
        ("leave-one-out", "sequence 1", "s1-odd", "s1-even", of_all),
        ("cross-sequence", "half of 1 and 4", "s1-odd", "s4-odd", of_even),
    ):
        rows = evaluations(fitness, fitness, train1, train2).join(truth, on="chromosome", suffix="_truth")
        correct = pl.col("object_correct")
        # Fewer wrong and a wider margin are better: both are correlated with clouds that are recognised.
        both = correct + pl.col("margin") / 4  # a margin lies between -1 and 1
        counts, margin = rows.select(
            pl.corr(correct, "object_correct_truth", method="spearman").alias("counts"),
            pl.corr(both, "object_correct_truth", method="spearman").alias("margin"),
        ).row(0)
        print(f"| {fitness} | {clouds} | {counts:.3f} | {margin:.3f} | {rows.height} |", flush=True)


if __name__ == "__main__":
    main()
