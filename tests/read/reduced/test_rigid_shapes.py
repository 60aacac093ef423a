"""Shapes of reduced bodies against the geometry: rigid motions prove every node, and modes of few digits keep their
mass."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.errors import DofMapError
from cmsreduce.linalg.eigen import modes_below
from cmsreduce.model import rigid_body_shapes
from cmsreduce.read import InterfaceSpec, ModalBody, in_dofs
from tests.pipeline.study import arm, panel

ROOT = {"root": InterfaceSpec((1,))}
DIGITS = 6
# Half a unit of the last of six digits.
ROUNDING = 5e-6


def modal(body, count: int = 30) -> ModalBody:
    """Modes of unit mass of a free body, rigid ones first, printed with six digits."""
    lam, Phi = la.eigh(body.K.toarray(), body.M.toarray())
    lam[:6] = 0.0
    shapes = np.vectorize(lambda x: float(f"{x:.{DIGITS - 1}e}"))(Phi[:, :count])
    none = np.zeros((count, count))
    return ModalBody(
        body.name, np.diag(lam[:count]), np.eye(count), none, body.dofs, shapes, body.nodes, rounding=ROUNDING
    )


@pytest.mark.parametrize("body", [arm(), panel()], ids=lambda body: body.name)
def test_all_modes_of_six_digits_come_back(body) -> None:
    """The mass of the highest of them is less than six digits of that of the whole body, and is a mass."""
    given = modal(body)
    found = in_dofs(given, ROOT)
    R = rigid_body_shapes(found.dofs, found.nodes)
    R = la.solve_triangular(la.cholesky(R.T @ found.M @ R, lower=True), R.T, lower=True).T
    exact = np.sqrt(given.K.diagonal()[6:])
    omega, _ = modes_below(found.K, found.M, 1.01 * exact[-1], rigid=R, rounding=found.rounding)
    np.testing.assert_allclose(omega, exact, rtol=1e-10)


def exchanged(table: np.ndarray, first: int, second: int) -> np.ndarray:
    rows = np.arange(len(table))
    rows[[first, second]] = second, first
    return table[rows]


def turned(table: np.ndarray, factor: float) -> np.ndarray:
    found = table.copy()
    found.reshape(-1, 6, table.shape[1])[:, 3:] *= factor
    return found


@pytest.mark.parametrize(
    ("shapes", "message"),
    [
        (lambda S: exchanged(S, 12, 13), r"1 of 6 nodes move otherwise; the worst are 3 .*other nodes or axes"),
        (lambda S: exchanged(S, 0, 1), r"1 of 6 nodes move otherwise; the worst are 1 .*other nodes or axes"),
        (lambda S: np.vstack([S[:6], S[12:18], S[6:12], S[18:]]), r"2 of 6 nodes move otherwise; the worst are [23] "),
        (lambda S: turned(S, 180 / np.pi), "its rotations are in degrees"),
        (lambda S: turned(S, -1.0), "its rotations have the other sign"),
    ],
)
def test_rows_of_shapes_that_are_not_those_of_the_geometry(shapes, message: str) -> None:
    """One interface with six dofs resists no motion, so that its stiffness proves none of them."""
    given = modal(panel())
    with pytest.raises(DofMapError, match=rf"'panel': its shapes of frequency 0 are not .*{message}"):
        in_dofs(replace(given, shapes=shapes(given.shapes)), ROOT)


def test_coordinates_in_another_unit() -> None:
    given = modal(panel())
    nodes = replace(given.nodes, xyz=1000 * given.nodes.xyz)
    with pytest.raises(DofMapError, match="the coordinates are 1000 times those of the shapes"):
        in_dofs(replace(given, nodes=nodes), ROOT)


@pytest.mark.parametrize("rows", [np.arange(0, 36, 6), np.arange(36)[np.tile([1, 1, 0, 0, 0, 1], 6) > 0]])
def test_nodes_that_show_fewer_motions(rows: np.ndarray) -> None:
    """A line of sensors along x, and dofs in a plane: the motions that they show are compared, and agree."""
    given = modal(panel())
    part = replace(given, dofs=given.dofs[rows], shapes=given.shapes[rows])
    assert in_dofs(part, {}).n == 30
    wrong = replace(part, shapes=exchanged(part.shapes, 0, rows.size - 1) * np.linspace(1, 2, rows.size)[:, None])
    with pytest.raises(DofMapError, match="shapes of frequency 0"):
        in_dofs(wrong, {})


@pytest.mark.parametrize("factor", [1e3, 1e-3])
def test_elastic_shapes_in_another_unit_than_the_rigid_ones(factor: float) -> None:
    """Rigid motions prove the rows of shapes, and not the size of the elastic ones."""
    given = modal(panel())
    assert given.doubts == ()
    wrong = replace(given, shapes=given.shapes * np.where(np.arange(30) < 6, 1.0, factor))
    (doubt,) = wrong.doubts
    least, most = (float(word) for word in doubt.partition("nodes ")[2].split(" times")[0].split(" to "))
    assert 0.1 * factor < least < most < 10 * factor
    if factor > 1:
        # Rounding of such shapes hides the rigid motions; the message names no support.
        with pytest.raises(DofMapError, match=r"not proven.*Likely cause: the elastic shapes of modal mass 1 move"):
            in_dofs(wrong, ROOT)


def test_a_mode_that_is_a_copy_of_another() -> None:
    given = modal(panel())
    shapes = given.shapes.copy()
    shapes[:, 9] = -shapes[:, 8]
    assert replace(given, shapes=shapes).doubts == ("modes 9 and 10 move all 36 dofs alike: is one a copy?",)


def test_the_order_of_modal_masses_is_known_by_their_records() -> None:
    """Matrices of their own show it only if all masses are one."""
    given = modal(panel())
    assert given.order is not None and given.order.status == "modal"
    apart = replace(given, apart=True)
    assert apart.order is not None and "alike" in apart.order.remark
    assert replace(apart, M=np.diag(np.linspace(1, 2, 30)), K=given.K * np.linspace(1, 2, 30)).order is None
