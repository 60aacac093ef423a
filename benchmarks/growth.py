"""Growth of a factor with its body, from the symbolic phase alone, and estimates for bodies that were not factorised.

``python benchmarks/growth.py [--largest DOFS]`` prints, for a slender, a thin and a compact body of bricks, entries and
operations of the factor in METIS's order, exponents of growth, and what 1e7 and 1e8 dofs need by them. Times and memory
follow from the rates of benchmarks/performance.md, named below.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import scipy.sparse as sp

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from cmsreduce.linalg.sparse.factor_size import factor_cost  # noqa: E402
from cmsreduce.multifrontal import nested_dissection  # noqa: E402

Cells = tuple[int, int, int]

SIZES = (3e4, 1e5, 3e5, 1e6, 3e6)
ASKED = (1e7, 1e8)
# benchmarks/performance.md, slender solid of 1e6 dofs on 2 cores: operations a second in the factorisation; seconds for
# an entry of the factor in 60 static solves and 50 modes together; bytes for a dof without the factor.
RATE, SOLVES, BESIDE = 43.1e9, 98.3 / 1.2e9, 6.4e3
# One node of a cluster, as assumed.
NODE_BYTES, NODE_CORES, SHARE = 512 * 2.0**30, 64, 0.5


def slender(n: float) -> Cells:
    """The bar of the benchmarks: 3.0 x 0.17 x 0.18 in bricks that are as long as half a side and more."""
    side = (n / 3 / 17.4) ** (1 / 3)
    return round(17.4 * side), round(side), round(side)


def thin(n: float) -> Cells:
    """A square plate, one brick thick."""
    side = round((n / 6) ** 0.5)
    return side, side, 1


def compact(n: float) -> Cells:
    """A cube."""
    side = round((n / 3) ** (1 / 3))
    return side, side, side


BODIES: dict[str, Callable[[float], Cells]] = {"slender": slender, "thin": thin, "compact": compact}


def nodes_graph(cells: Cells) -> sp.csc_array:
    """Graph of the nodes that share a brick, nodes at x = 0 held."""
    shape = tuple(count + 1 for count in cells)
    number = np.arange(np.prod(shape)).reshape(shape)
    corners = [(a, b, c) for a in (0, 1) for b in (0, 1) for c in (0, 1)]
    at = [tuple(slice(k, k + m) for k, m in zip(corner, cells, strict=True)) for corner in corners]
    bricks = np.stack([number[each].ravel() for each in at], axis=1)
    rows = np.repeat(np.arange(len(bricks)), 8)
    touches = sp.csr_array(
        (np.ones(rows.size, dtype=np.int8), (rows, bricks.ravel())), shape=(len(bricks), number.size)
    )
    free = number[1:].ravel()
    touches = touches[:, free]
    return sp.csc_array(touches.T @ touches)


def counted(cells: Cells) -> tuple[int, float, float]:
    """Dofs, entries and operations of the factor of a body; an entry of the node graph is nine of the matrix."""
    graph = nodes_graph(cells)
    cost = factor_cost(graph, nested_dissection(graph))
    return 3 * graph.shape[0], 9.0 * cost.nnz, 27.0 * cost.flops


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--largest", type=float, default=1e6, help="dofs of the largest body that is ordered")
    largest = parser.parse_args().largest
    found = {}
    print("| body | dofs | entries | a dof | GFLOP |\n|---|---|---|---|---|")
    for name, cells in BODIES.items():
        found[name] = np.array([counted(cells(n)) for n in SIZES if n <= largest])
        for n, entries, flops in found[name]:
            print(f"| {name} | {n:.0f} | {entries:.3g} | {entries / n:.0f} | {flops / 1e9:.4g} |", flush=True)
    print("\n| body | entries ~ n^a | operations ~ n^b | between the last two |\n|---|---|---|---|")
    growth = {}
    for name, table in found.items():
        n, *costs = np.log(table.T)
        a, b = (float(np.polyfit(n, cost, 1)[0]) for cost in costs)
        growth[name] = tuple(float((cost[-1] - cost[-2]) / (n[-1] - n[-2])) for cost in costs)
        print(f"| {name} | {a:.2f} | {b:.2f} | {growth[name][0]:.2f}, {growth[name][1]:.2f} |")
    print("\n| body | dofs | entries | factor, GiB | all, GiB | nodes | PFLOP | 2 cores, h | the nodes, h |")
    print("|---|---|---|---|---|---|---|---|---|")
    for name, table in found.items():
        for asked in ASKED:
            ratio = asked / table[-1, 0]
            entries, flops = (table[-1, 1 + k] * ratio ** growth[name][k] for k in (0, 1))
            memory = 8 * entries + BESIDE * asked
            nodes = int(np.ceil(memory / NODE_BYTES))
            # Factor and certificate, then solves.
            seconds = 2 * flops / RATE + SOLVES * entries
            there = seconds * 2 / (nodes * NODE_CORES * SHARE)
            print(
                f"| {name} | {asked:.0e} | {entries:.2g} | {8 * entries / 2**30:.3g} | {memory / 2**30:.3g} | {nodes} "
                f"| {flops / 1e15:.3g} | {seconds / 3600:.3g} | {there / 3600:.2g} |"
            )


if __name__ == "__main__":
    main()
