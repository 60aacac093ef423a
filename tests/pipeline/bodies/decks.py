"""Small bodies whose decks state elements and materials, written for a run."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from pathlib import Path

import numpy as np
import scipy.sparse as sp

from cmsreduce.model import FEModel
from tests.frames import BAR
from tests.solids import NU, RHO, E

__all__ = ["bar_cards", "brick_cards", "write_deck_body"]

# Corners of a brick of `tests.solids` (z fastest) in the order of CHEXA.
_CHEXA = (0, 4, 6, 2, 1, 5, 7, 3)


def brick_cards(cells: Sequence[int], *, density: float = RHO) -> list[str]:
    """CHEXA cards of a block of `tests.solids`, with their property and material."""
    index = 1 + np.arange(np.prod(np.array(cells) + 1)).reshape(np.array(cells) + 1)
    cards = []
    for e, at in enumerate(product(*(range(n) for n in cells)), 1):
        corners = [index[tuple(np.array(at) + c)] for c in product((0, 1), repeat=3)]
        ids = ",".join(str(corners[k]) for k in _CHEXA[:6])
        cards += [f"CHEXA,{e},1,{ids}", f",{corners[_CHEXA[6]]},{corners[_CHEXA[7]]}"]
    return [*cards, "PSOLID,1,1", f"MAT1,1,{E:.6E},,{NU},{density}"]


def bar_cards(bars: Sequence[tuple[int, int]], xyz: Sequence[Sequence[float]]) -> list[str]:
    """CBAR cards of a frame of `tests.frames`, with its first plane of bending."""
    cards = []
    for k, (a, b) in enumerate(bars, 1):
        x = np.asarray(xyz[b - 1], dtype=float) - np.asarray(xyz[a - 1], dtype=float)
        up = [0.0, 0.0, 1.0] if abs(x[2]) < 0.9 * np.linalg.norm(x) else [0.0, 1.0, 0.0]
        y = np.cross(up, x)
        y /= np.linalg.norm(y)
        cards.append(f"CBAR,{k},1,{a},{b},{y[0]:.6f},{y[1]:.6f},{y[2]:.6f}")
    section = f"PBAR,1,1,{BAR.A:.6E},{BAR.Iz:.6E},{BAR.Iy:.6E},{BAR.J:.6E}"
    return [*cards, section, f"MAT1,1,{BAR.E:.6E},{BAR.G:.6E},,{BAR.rho}"]


def write_deck_body(folder: Path, body: FEModel, cards: Sequence[str], keys: str = "") -> Path:
    """Write matrices, deck, row order and a pipeline that holds the body nowhere and moves it at its last node."""
    assert body.nodes is not None
    for name, A in (("K", body.K), ("M", body.M)):
        sp.save_npz(folder / f"{name}.npz", sp.csc_array(A))
    grids = []
    for node, (x, y, z) in zip(body.nodes.id, body.nodes.xyz, strict=True):
        grids.append(f"GRID*   {node:16d}{'':16}{x:16.9E}{y:16.9E}\n*       {z:16.9E}")
    (folder / "deck.bdf").write_text("\n".join(["BEGIN BULK", *grids, *cards, "ENDDATA"]) + "\n")
    (folder / "rows.txt").write_text("\n".join(body.dofs.labels))
    last = int(body.dofs.node.max())
    path = folder / "run.yaml"
    path.write_text(
        f"name: deck\noutput: out\ncomponents:\n  part:\n    stiffness: K.npz\n    mass: M.npz\n"
        f"    geometry: deck.bdf\n    rows: {{file: rows.txt}}\n    damping: {{modal: 0.01}}\n{keys}"
        f"scene:\n  band: 200 Hz\n  actuators: {{push: {{at: part.{last}, force: [0, 0, 1]}}}}\n"
        f"  sensors: {{seen: {{at: part.{last}, measure: [z]}}}}\n"
        "reduce: {method: macneal-rubin, cutoff: 8}\nbalance: {keep: all}\n"
        "verify: {limits: {frf_error: 0.05}}\n"
    )
    return path
