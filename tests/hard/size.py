"""Many interface dofs, and many dofs in a long row."""

from __future__ import annotations

import numpy as np

from tests.hard.case import Case
from tests.hard.structures import bars, rigid_motions, rows

__all__ = ["grillage", "mast"]


def grillage() -> Case:
    """A square grid of bars held at 167 nodes."""
    side = 16
    x, y = np.meshgrid(np.arange(side), np.arange(side), indexing="ij")
    # Slightly warped, so that the plate has no plane of symmetry.
    xyz = 0.5 * np.column_stack([x.ravel(), y.ravel(), 0.05 * np.sin(x.ravel() + 0.7 * y.ravel())])
    number = 1 + np.arange(side * side).reshape(side, side)
    pairs = [*zip(number[:-1].ravel(), number[1:].ravel(), strict=True)]
    pairs += [*zip(number[:, :-1].ravel(), number[:, 1:].ravel(), strict=True)]
    body = bars("grillage", xyz, [(int(i), int(j)) for i, j in pairs])
    face = rows(body, range(1, 168))
    return Case(
        "1000 interface dofs",
        "1002 of 1536 dofs are interface: constraint modes of neighbouring nodes are nearly equal, residuals even "
        "more.",
        "Right-hand sides are solved in blocks; modes are improved over all dofs after the basis is combined.",
        body,
        face,
        (0.5, 2.5),
        rigid_motions(body),
        sensors=rows(body, (200, 256), (1, 2, 3)),
        points=4,
        probes=face[[0, 2, 40, 500, 601, 1001]],
    )


def mast() -> Case:
    """A triangular mast of 5555 bays, 2800 m long and half a metre wide."""
    bays, a = 5555, 2 * np.pi * np.arange(3) / 3
    ring = np.column_stack([0 * a, 0.25 * np.cos(a), 0.25 * np.sin(a)])
    xyz = np.vstack([ring + np.array([0.5 * bay, 0, 0]) for bay in range(bays + 1)])
    pairs = []
    for bay in range(bays + 1):
        for c in range(3):
            node, beside = 3 * bay + c + 1, 3 * bay + (c + 1) % 3 + 1
            pairs.append((node, beside))
            if bay < bays:
                pairs += [(node, node + 3), (node, beside + 3)]
    body = bars("mast", xyz, pairs)
    return Case(
        "slender, 1e5 dofs",
        "A lattice mast of 5555 bays, 5600 times as long as wide: K of a bent shape cancels to its last three "
        "digits, and an eigensolver finds its first bending modes among the null vectors.",
        "The energy after inverse iteration separates null vectors from the first bending. Frequencies are right "
        "to 1e-3, as far as the entries of K hold them.",
        body,
        rows(body, (1, 16666)),
        (2e-4, 1.5e-3),
        rigid_motions(body),
        sensors=rows(body, 8001, (1, 2, 3)),
        points=4,
        # What the first-order estimate gives for the same mast of a hundred bays, 0.06, half as much again and 0.01.
        limits={"craig-bampton": 0.1},
    )
