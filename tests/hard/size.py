"""Many interface dofs, and many dofs in a long row."""

from __future__ import annotations

import numpy as np

from tests.hard.case import Case
from tests.hard.structures import bars, rigid_motions, rows

__all__ = ["grillage", "mast", "slender_mast"]


def grillage() -> Case:
    """A square grid of bars held at 94 nodes."""
    side = 12
    x, y = np.meshgrid(np.arange(side), np.arange(side), indexing="ij")
    # Slightly warped, so that the plate has no plane of symmetry.
    xyz = 0.5 * np.column_stack([x.ravel(), y.ravel(), 0.05 * np.sin(x.ravel() + 0.7 * y.ravel())])
    number = 1 + np.arange(side * side).reshape(side, side)
    pairs = [*zip(number[:-1].ravel(), number[1:].ravel(), strict=True)]
    pairs += [*zip(number[:, :-1].ravel(), number[:, 1:].ravel(), strict=True)]
    body = bars("grillage", xyz, [(int(i), int(j)) for i, j in pairs])
    face = rows(body, range(1, 95))
    return Case(
        "most dofs at the interface",
        "564 of 864 dofs are interface: constraint modes of neighbouring nodes are nearly equal, residuals even more.",
        "Right-hand sides are solved in blocks; modes are improved over all dofs after the basis is combined.",
        body,
        face,
        (0.9, 4.5),
        rigid_motions(body),
        sensors=rows(body, (113, 144), (1, 2, 3)),
        points=4,
        probes=face[[0, 2, 40, 282, 339, 563]],
    )


def slender_mast() -> Case:
    """A triangular mast of 694 bays, 416 m long and 31 mm wide."""
    # As below: the estimate for a hundred bays is 0.08.
    return _mast("slender", 694, 1 / 64, 0.6, (1.6e-3, 1.2e-2), 0.13)


def mast() -> Case:
    """A triangular mast of 5555 bays, 2800 m long and half a metre wide."""
    # What the first-order estimate gives for the same mast of a hundred bays, 0.06, half as much again and 0.01.
    return _mast("slender, 1e5 dofs", 5555, 0.25, 0.5, (2e-4, 1.5e-3), 0.1)


def _mast(name: str, bays: int, radius: float, bay_length: float, band_hz: tuple[float, float], limit: float) -> Case:
    a = 2 * np.pi * np.arange(3) / 3
    ring = radius * np.column_stack([0 * a, np.cos(a), np.sin(a)])
    xyz = np.vstack([ring + np.array([bay_length * bay, 0, 0]) for bay in range(bays + 1)])
    pairs = []
    for bay in range(bays + 1):
        for c in range(3):
            node, beside = 3 * bay + c + 1, 3 * bay + (c + 1) % 3 + 1
            pairs.append((node, beside))
            if bay < bays:
                pairs += [(node, node + 3), (node, beside + 3)]
    body = bars("mast", xyz, pairs)
    return Case(
        name,
        f"A lattice mast of {bays} bays, {100 * round(bays * bay_length / radius / 200)} times as long as wide: K of a "
        "bent shape cancels to its last three digits, and an eigensolver finds its first bending modes among the null "
        "vectors.",
        "The energy after inverse iteration separates null vectors from the first bending. Frequencies are right "
        "to 1e-3, as far as the entries of K hold them.",
        body,
        rows(body, (1, 3 * bays + 1)),
        band_hz,
        rigid_motions(body),
        sensors=rows(body, 3 * round(0.48 * bays) + 3, (1, 2, 3)),
        points=4,
        limits={"craig-bampton": limit},
    )
