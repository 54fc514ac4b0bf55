"""Counts how many channels of the structures that a search has evaluated were known from structures before them.

Usage: known_channels.py RUN...

RUN is the folder of a run of family "structure". Elites and other structures that were evaluated before do not count. A
channel is known if it differs in nothing but its weight, which no signature depends on.
"""

import glob
import sys

import polars


def known(run):
    """Structures, their channels, and those of them that were known."""
    evaluations = polars.read_parquet(sorted(glob.glob(f"{run}/evaluations/*.parquet")))
    evaluations = evaluations.filter(~polars.col("remembered")).sort("generation", "individual")
    slots = [name.removesuffix("active") for name in evaluations.columns if name.endswith("_active")]
    no_gene = ("_active", "_weight")
    genes = {
        slot: [name for name in evaluations.columns if name.startswith(slot) and not name.endswith(no_gene)]
        for slot in slots
    }
    met, channels, again = set(), 0, 0
    for row in evaluations.iter_rows(named=True):
        active = {tuple(row[gene] for gene in genes[slot]) for slot in slots if row[f"{slot}active"]}
        channels += len(active)
        again += len(active & met)
        met |= active
    return evaluations.height, channels, again


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    for run in sys.argv[1:]:
        structures, channels, again = known(run)
        print(f"{run}: {structures} structures of {channels} channels, of which {100 * again / channels:.1f} % were known")
