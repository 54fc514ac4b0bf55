"""Asks what family, members, fitness, operators and weights of a search each contribute, and each channel of a winner.

Usage: ablation.py COORDINATOR DATA OUT [SEEDS [EVALUATIONS]], where DATA is household-rgbd or tabletop-rgbd of the
benchmark clouds and OUT a new folder. Prints the median error over seeds 1 to SEEDS (3) of searches of EVALUATIONS
(1200) for each combination, of structures also with the weights that `coordinator weigh` finds for their values, and
the errors of the last one's winners without each of their channels.

Only training clouds are looked at, of sequences 1 and 4. Searches see every other cloud of train1 and of train2. The
error is that of the clouds that are left, sequence 4 matched with sequence 1 and back: clouds that no search has seen,
and a video that none of them shares with the clouds it is matched with.
"""

import itertools
import json
import pathlib
import re
import statistics
import subprocess
import sys
import tomllib

EXPERIMENT = """version = 1
seed = {seed}

[dataset]
root = "{data}"
layout = "uw"

[dataset.splits]
train1 = "{lists}/train1.txt"
train2 = "{lists}/train2.txt"
test = "{lists}/unused.txt"

[descriptor]
{family}

[search]
winner = "fitness"

[search.fitness]
{fitness} = 1
margin = true

[ga]
{operators}

[stop]
generations = 10000
stagnation = "off"
validation_patience = "off"
evaluations = {evaluations}
"""

# The paper's, and the defaults of family structure.
OPERATORS = {
    "paper": """population = 10
elite = 1
scaling = "none"
crossover = "uniform"
mutation = "in-order"
mutation_rate = 0.40
mutation_decay = 0.97""",
    "structure": """population = 60
elite = 4
scaling = "rank"
crossover = "slots"
mutation = "field"
mutation_rate = 0.03
mutation_decay = 1.0""",
}
# Structures as the shipped experiments have them, and of one member.
FAMILIES = {
    "disk-ring": """family = "disk-ring\"""",
    "structure, 1 member": """family = "structure"
max_bins = 500
max_cost = 600_000""",
    "structure, 4 members": """family = "structure"
members = 4
max_bins = 500
max_cost = 600_000""",
}
FITNESSES = ("split", "cross-sequence")


def lists_of(data, folder):
    """Writes the lists of clouds that searches see, and of those that they do not."""
    folder.mkdir(parents=True)
    left = {"1": [], "4": []}
    for name in ("train1", "train2"):
        clouds = (data / f"{name}.txt").read_text().split()
        (folder / f"{name}.txt").write_text("\n".join(clouds[::2]) + "\n")
        for cloud in clouds[1::2]:
            left[re.search(r"_(\d+)_\d+\.pcd$", cloud).group(1)].append(cloud)
    for sequence, clouds in left.items():
        (folder / f"left{sequence}.txt").write_text("\n".join(clouds) + "\n")
    # A run ends with a look at its test clouds: here at one that no list has.
    (folder / "unused.txt").write_text((data / "unused.txt").read_text().split()[0] + "\n")


class Bench:
    """A data set, and the program that searches it."""

    def __init__(self, coordinator, data, out):
        self.coordinator, self.data, self.out = coordinator, data, out
        self.lists = (out / "lists").resolve()
        lists_of(data, self.lists)

    def command(self, *args):
        return subprocess.run([self.coordinator, *args], check=True, stdout=subprocess.PIPE, text=True).stdout

    def winner(self, name, **values):
        """The section [descriptor] of the winner of a search, and the file of it with weights, if it is a structure."""
        toml = self.out / f"{name}.toml"
        toml.write_text(EXPERIMENT.format(lists=self.lists, data=self.data, **values))
        self.command("run", toml, "--out", self.out / name, "--listen", "127.0.0.1:0")
        artefact = self.out / f"{name}.artefact"
        self.command("export", self.out / name, artefact)
        descriptor = tomllib.loads((artefact / "descriptor.toml").read_text())["descriptor"]
        if descriptor.get("family") != "structure":
            return descriptor, None
        weighed = self.out / f"{name}.weighed.toml"
        self.command("weigh", self.out / name, weighed)
        return descriptor, ["--structure", weighed]

    def error(self, options):
        """The share of wrong objects of the descriptor that these options of evaluate name, both ways."""
        wrong = queries = 0
        for query, database in (("left4", "left1"), ("left1", "left4")):
            lists = ["--query", self.lists / f"{query}.txt", "--database", self.lists / f"{database}.txt"]
            told = json.loads(self.command("evaluate", "--data", self.data, *lists, *options, "--json"))
            wrong, queries = wrong + told["object_wrong"], queries + told["queries"]
        return wrong / queries

    def options(self, descriptor):
        if descriptor.get("family") != "structure":
            return [f"--set={name}={value}" for name, value in descriptor["genes"].items()]
        lines = ["version = 1"]
        for channel in descriptor["channel"]:
            lines.append("[[channel]]")
            # JSON's strings, numbers and lists of them are TOML's.
            lines += [f"{key} = {json.dumps(value)}" for key, value in channel.items()]
        file = self.out / "structure.toml"
        file.write_text("\n".join(lines) + "\n")
        return ["--structure", file]


def main():
    coordinator, data, out = sys.argv[1], pathlib.Path(sys.argv[2]).resolve(), pathlib.Path(sys.argv[3])
    seeds = range(1, 1 + int(sys.argv[4] if len(sys.argv) > 4 else 3))
    evaluations = int(sys.argv[5]) if len(sys.argv) > 5 else 1200
    bench = Bench(coordinator, data, out)

    def percent(errors):
        return ", ".join(f"{100 * error:.2f}" for error in errors) + " %"

    print("| family | fitness | operators | median | seeds | weighed | seeds |\n|---|---|---|---|---|---|---|")
    for family, fitness, operators in itertools.product(FAMILIES, FITNESSES, OPERATORS):
        winners = [
            bench.winner(
                f"{re.sub('[^a-z0-9]+', '-', family)}-{fitness}-{operators}-{seed}",
                family=FAMILIES[family],
                fitness=fitness,
                operators=OPERATORS[operators],
                seed=seed,
                evaluations=evaluations,
            )
            for seed in seeds
        ]
        errors = [bench.error(bench.options(winner)) for winner, _ in winners]
        cells = [percent([statistics.median(errors)]), percent(errors)]
        weighed = [bench.error(options) for _, options in winners if options]
        cells += [percent([statistics.median(weighed)]), percent(weighed)] if weighed else ["", ""]
        print(f"| {family} | {fitness} | {operators} | {' | '.join(cells)} |", flush=True)

    print("\n| seed | all channels | without channel 1, 2, … |\n|---|---|---|")
    for seed, (winner, _), error in zip(seeds, winners, errors):
        channels = winner["channel"]
        without = [
            bench.error(bench.options({**winner, "channel": channels[:index] + channels[index + 1 :]}))
            for index in range(len(channels))
            if len(channels) > 1
        ]
        print(f"| {seed} | {percent([error])} | {percent(without)} |", flush=True)


if __name__ == "__main__":
    main()
