"""Runs pymoo's NSGA-II on ZDT1, ZDT2, ZDT3 and DTLZ2 with the operators and the encoding of Descry's.

Usage: nsga2_peer.py [SEEDS]; needs pymoo. Prints the median hypervolume of the last population over SEEDS seeds (101),
as the tests of coordinator/evolution/src/nsga2.rs have it, with its quartiles.

Genome: bits, BITS a variable, most significant first. Objectives are scaled to whole numbers as in those tests.
"""

import sys

import numpy as np
from pymoo.algorithms.moo.nsga2 import NSGA2
from pymoo.core.crossover import Crossover
from pymoo.core.mutation import Mutation
from pymoo.core.problem import Problem
from pymoo.indicators.hv import HV
from pymoo.operators.sampling.rnd import BinaryRandomSampling
from pymoo.operators.survival.rank_and_crowding import RankAndCrowding
from pymoo.operators.survival.rank_and_crowding.metrics import calc_crowding_distance
from pymoo.optimize import minimize
from pymoo.problems import get_problem

BITS = 12
POPULATION = 100
GENERATIONS = 100
FLIPS = 2  # mutated bits a child, about
SCALE = 2**20

# Name, variables, objectives, reference point; f2 of ZDT3 can be negative, so 1 is added to it.
PROBLEMS = [
    ("zdt1", 10, 2, 0.0, 1.1),
    ("zdt2", 10, 2, 0.0, 1.1),
    ("zdt3", 10, 2, 1.0, 2.1),
    ("dtlz2", 7, 3, 0.0, 1.1),
]


class Bits(Problem):
    def __init__(self, name, variables, objectives, shift):
        super().__init__(n_var=BITS * variables, n_obj=objectives, xl=0, xu=1, vtype=bool)
        options = {"n_obj": objectives} if objectives == 3 else {}
        self.inner = get_problem(name, n_var=variables, **options)
        self.shift = np.array([0.0] * (objectives - 1) + [shift])

    def _evaluate(self, x, out, *args, **kwargs):
        powers = 2 ** np.arange(BITS - 1, -1, -1)
        codes = (x.reshape(len(x), -1, BITS).astype(int) * powers).sum(axis=2)
        values = self.inner.evaluate(codes / (2**BITS - 1), return_values_of=["F"])
        out["F"] = np.round((values + self.shift) * SCALE)


class Uniform(Crossover):
    """Each bit is exchanged with probability 0.5."""

    def __init__(self):
        super().__init__(2, 2, prob=1.0)

    def _do(self, problem, x, *args, random_state=None, **kwargs):
        mask = random_state.random(x.shape[1:]) < 0.5
        return np.array([np.where(mask, x[1], x[0]), np.where(mask, x[0], x[1])])


class InOrder(Mutation):
    """Two points, then a chance for each bit between them, both included."""

    def __init__(self, rate):
        super().__init__(prob=1.0)
        self.rate = rate

    def _do(self, problem, x, *args, random_state=None, **kwargs):
        x = x.copy()
        for row in x:
            low, high = np.sort(random_state.integers(0, len(row), 2))
            row[low : high + 1] ^= random_state.random(high + 1 - low) < self.rate
        return x


def hypervolume(name, variables, objectives, shift, reference, seed):
    problem = Bits(name, variables, objectives, shift)
    algorithm = NSGA2(
        pop_size=POPULATION,
        sampling=BinaryRandomSampling(),
        crossover=Uniform(),
        mutation=InOrder(3 * FLIPS / problem.n_var),
        # Given as a function, it filters points out that are equal in all objectives.
        survival=RankAndCrowding(crowding_func=calc_crowding_distance),
        eliminate_duplicates=True,
    )
    algorithm.tournament_type = "comp_by_rank_and_crowding"
    result = minimize(problem, algorithm, ("n_gen", GENERATIONS), seed=seed)
    # The first objectives go to 1.1, the last, which may be shifted, to its own reference.
    ends = np.array([1.1] * (objectives - 1) + [reference])
    return HV(ref_point=ends)(result.pop.get("F") / SCALE)


def main():
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 101
    for problem in PROBLEMS:
        volumes = [hypervolume(*problem, seed) for seed in range(1, seeds + 1)]
        low, median, high = np.percentile(volumes, [25, 50, 75])
        print(f"{problem[0]} {median:.5f} ({low:.5f} - {high:.5f})", flush=True)


if __name__ == "__main__":
    main()
