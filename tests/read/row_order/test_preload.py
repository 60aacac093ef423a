"""Matrices of a loaded body: its stress resists rotation, which no order of the rows explains."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.errors import DofMapError
from cmsreduce.read import MatrixSource, read_body
from tests.solids import block

STRESS = 1e5  # N/m of a string; the block is of aluminium


def written(folder: Path, step: str, *, held: bool = False) -> Path:
    """Deck, matrices and rows of a block with strings between neighbours along x."""
    body = block("block", [0.6, 0.2, 0.3], (6, 2, 2), held=range(1, 10) if held else ())
    assert body.nodes is not None
    x = body.nodes.xyz
    of = {int(node): np.flatnonzero(body.dofs.node == node) for node in np.unique(body.dofs.node)}
    K = body.K.tolil()
    for a in of:
        if (b := a + 9) in of:
            rows = np.concatenate([of[a], of[b]])
            # Stress alone: along the string nothing changes.
            K[np.ix_(rows, rows)] += STRESS * np.kron([[1, -1], [-1, 1]], np.diag([0.0, 1, 1]))
    sp.save_npz(folder / "K.npz", sp.csc_array(K))
    sp.save_npz(folder / "M.npz", body.M)
    rows = zip(body.dofs.node, body.dofs.component, strict=True)
    (folder / "body.rows").write_text("".join(f"{n}.{c}\n" for n, c in rows))
    lines = [f"{n}, {', '.join(f'{v:.12g}' for v in at)}" for n, at in zip(body.nodes.id, x, strict=True)]
    supports = ["*BOUNDARY", *(f"{n}, 1, 3" for n in range(1, 10))] if held else []
    deck = folder / "body.inp"
    deck.write_text("\n".join(["*NODE", *lines, *supports, "*STEP", "*STATIC", "*END STEP", *step.split("\n"), ""]))
    return deck


def read(deck: Path, *, grounded: bool = False) -> None:
    folder = deck.parent
    read_body(
        "block",
        stiffness=MatrixSource(folder / "K.npz"),
        mass=MatrixSource(folder / "M.npz"),
        geometry=deck,
        rows=folder / "body.rows",
        grounded=grounded,
    )


@pytest.mark.parametrize("held", [False, True], ids=["free", "held"])
def test_a_perturbation_step_is_named(tmp_path: Path, held: bool) -> None:
    deck = written(tmp_path, "*STEP, PERTURBATION\n*FREQUENCY, SOLVER=MATRIXSTORAGE", held=held)
    with pytest.raises(DofMapError, match=r"Likely cause: a preload: .*body\.inp, line \d+: \*STEP with PERTURBATION"):
        read(deck, grounded=held)


def test_without_such_a_step_no_preload_is_named(tmp_path: Path) -> None:
    with pytest.raises(DofMapError, match="is not proven") as found:
        read(written(tmp_path, "*STEP\n*FREQUENCY"))
    assert "preload" not in str(found.value)


def test_rows_in_disorder_are_no_preload(tmp_path: Path) -> None:
    deck = written(tmp_path, "*STEP, PERTURBATION\n*FREQUENCY")
    rows = (tmp_path / "body.rows").read_text().split()
    rows[:3], rows[60:63] = rows[60:63], rows[:3]
    (tmp_path / "body.rows").write_text("\n".join(rows) + "\n")
    with pytest.raises(DofMapError, match="is not proven") as found:
        read(deck)
    assert "preload" not in str(found.value)
