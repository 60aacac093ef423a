"""Equations of a deck that rigid motion breaks: named only where the stiffness holds them and they make the forces."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import scipy.io as sio
import scipy.sparse as sp

from cmsreduce.errors import DofMapError
from cmsreduce.model import FEModel
from cmsreduce.read import MatrixSource, read_body
from tests.solids import block

Equation = tuple[tuple[int, int], tuple[int, int], float]
APART = [((1, c), (9, c), 1.0) for c in (1, 2, 3)]
ROLLER = [((5, 1), (5, 2), -1.0)]


def tied(
    at: Path,
    stated: Sequence[Equation],
    cells: tuple[int, int, int] = (4, 2, 2),
    *,
    holds: bool = True,
    swap: Sequence[int] = (),
    times: int = 1,
    grounded: bool = False,
) -> FEModel:
    """Body as read from files: a block whose stiffness holds u_first = factor u_second, with two nodes exchanged."""
    body = block("b", (1.0, 0.1, 0.15), cells)
    T, gone = sp.eye_array(body.n, format="lil"), []
    for first, second, factor in stated if holds else ():
        row, other = body.dofs.rows(*first)[0], body.dofs.rows(*second)[0]
        T[row, row], T[row, other] = 0.0, factor
        gone.append(row)
    kept = np.setdiff1d(np.arange(body.n), gone)
    T = T.tocsc()[:, kept]
    for name, A in (("K", body.K), ("M", body.M)):
        sio.mmwrite(at / f"{name}.mtx", sp.coo_array(T.T @ A @ T), symmetry="symmetric", precision=17)
    other_node = {str(a): str(b) for a, b in zip(swap, reversed(swap), strict=True)}
    labels = [label.split(".") for label in body.dofs[kept].labels]
    (at / "rows.dof").write_text("".join(f"{other_node.get(node, node)}.{c}\n" for node, c in labels))
    assert body.nodes is not None
    text = "*NODE\n" + "".join(
        f"{i}, {x:.17g}, {y:.17g}, {z:.17g}\n" for i, (x, y, z) in zip(body.nodes.id, body.nodes.xyz, strict=True)
    )
    for (node, c), (one, d), factor in stated:
        text += times * f"*EQUATION\n2\n{node}, {c}, 1., {one}, {d}, {-factor}\n"
    (at / "b.inp").write_text(text)
    K, M = (MatrixSource(at / f"{name}.mtx") for name in "KM")
    return read_body("b", stiffness=K, mass=M, geometry=at / "b.inp", rows=at / "rows.dof", grounded=grounded)


def test_equations_between_apart_nodes_are_named(tmp_path: Path) -> None:
    with pytest.raises(DofMapError, match=r"EQUATION of nodes 1, 9, which lie 0.15 apart, and 2 more do not hold"):
        tied(tmp_path, APART)


@pytest.mark.parametrize(
    ("stated", "named"), [(ROLLER, "node 5"), ([((1, 1), (9, 1), 0.5)], "nodes 1, 9")], ids=["roller", "lever"]
)
def test_equations_that_hold_the_body_as_a_support_does_are_named_so(tmp_path: Path, stated, named: str) -> None:
    """An inclined roller was told to join coincident nodes, 0 apart."""
    words = rf"EQUATION of {named} does not hold under translation of the whole body: .*`grounded: true`"
    with pytest.raises(DofMapError, match=words):
        tied(tmp_path, stated)
    assert tied(tmp_path, stated, grounded=True).grounded


@pytest.mark.parametrize("stated", [APART, ROLLER, APART + ROLLER], ids=["apart", "roller", "both"])
@pytest.mark.parametrize("holds", [False, True])
def test_exchanged_nodes_are_not_blamed_on_equations(tmp_path: Path, stated, holds: bool) -> None:
    """Nor on equations that the stiffness does not hold, enough of which explain any force."""
    with pytest.raises(DofMapError, match="not proven") as refused:
        tied(tmp_path, stated, holds=holds, swap=(20, 33))
    assert "EQUATION" not in str(refused.value)


def test_many_equations_that_no_matrix_holds_explain_nothing(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    pairs = [rng.choice(45, 2, replace=False) + 1 for _ in range(60)]
    stated = [((int(a), k % 3 + 1), (int(b), k % 3 + 1), 1.0) for k, (a, b) in enumerate(pairs)]
    with pytest.raises(DofMapError, match="Likely cause: ") as refused:
        tied(tmp_path, stated, holds=False, swap=(1, 2))
    assert "EQUATION" not in str(refused.value)


def test_periodic_faces_have_tens_of_thousands_of_equations(tmp_path: Path) -> None:
    """Their motions take memory of one row each: a square of them ended in a MemoryError."""
    cells = (4, 10, 10)
    stated = [((k, c), (k + 4 * 121, c), 1.0) for k in range(1, 122) for c in (1, 2, 3)]
    with pytest.raises(DofMapError, match=r"nodes 1, 485, which lie 1 apart, and 24199 more do not hold"):
        tied(tmp_path, stated, cells, times=100)


@pytest.mark.parametrize("term", ["1, 11", "1, 300", "1, 1"], ids=["component 11", "component 300", "twice"])
def test_an_equation_that_cannot_be_read_hides_no_cause(tmp_path: Path, term: str) -> None:
    with pytest.raises(DofMapError):
        tied(tmp_path, APART, swap=(20, 33))
    deck = tmp_path / "b.inp"
    deck.write_text(deck.read_text() + f"*EQUATION\n2\n1, 1, 1., {term}, -1.\n")
    K, M = (MatrixSource(tmp_path / f"{name}.mtx") for name in "KM")
    with pytest.raises(DofMapError, match=r"resist.*Likely cause"):
        read_body("b", stiffness=K, mass=M, geometry=deck, rows=tmp_path / "rows.dof")
