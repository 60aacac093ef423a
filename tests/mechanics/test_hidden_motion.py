"""One structure, stated with and without rigid elements, offsets and condensation: one geometric stiffness."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.errors import DofMapError, ReadError
from cmsreduce.mechanics import bars_stiffness, condensed_dofs, end_dofs, hidden_motion
from cmsreduce.mechanics.bars import BarStiffness, end_motion, member_stiffness
from cmsreduce.mechanics.geometric_stiffness import unit_forces
from cmsreduce.model import (
    INERTIA_LOADS,
    Bars,
    DofTable,
    FEModel,
    GeometricStiffness,
    Nodes,
    Recovery,
    cross_matrix,
    rigid_body_shapes,
)
from cmsreduce.read import MatrixSource, read_bars, read_body, read_bulk, read_followers, read_members
from tests.frames import BAR, Section, beam_matrices, frame, rotation
from tests.mechanics.test_geometric_stiffness import chain

PLACES = np.array([[0, 0, 0], [1, 0.2, 0], [1.5, 0.8, 0.4], [2, 1, 1.1], [1.2, 1.4, 0.3], [0.4, 1.0, 0.5]], dtype=float)
PAIRS = ((1, 2), (2, 3), (3, 4), (3, 5), (5, 6), (6, 1))
ROUND_OFF = 1e-9
"""Difference of two statements of one structure, relative to the largest entry: K has a condition number of 2e5 on
elastic motion, and the forces of members are differences of solutions with it (20 roundings; 1e-10 is usual)."""

MATERIAL = f"MAT1,3,{BAR.E:.10E},{BAR.G:.10E},,{BAR.rho}\nPBAR,7,3,{BAR.A:.8E},{BAR.Iz:.8E},{BAR.Iy:.8E},{BAR.J:.8E}\n"


def grids(nodes: Nodes) -> str:
    """Each grid with a frame of its own, as in the body."""
    lines = []
    for node, xyz, axes in zip(nodes.id, nodes.xyz, nodes.frame, strict=True):
        z, x = axes[2], axes[0]
        lines.append(f"CORD2R*,{node},,{','.join(f'{v:.17e}' for v in np.zeros(2))}")
        lines.append(f"*,0.0,{','.join(f'{v:.17e}' for v in z)}")
        lines.append(f"*,{','.join(f'{v:.17e}' for v in x)}")
        lines.append(f"GRID*,{node},,{xyz[0]:.17e},{xyz[1]:.17e}")
        lines.append(f"*,{xyz[2]:.17e},{node}")
    return "\n".join(lines) + "\n"


def bars(nodes: Nodes, named: dict[int, int] | None = None, arms: dict[int, np.ndarray] | None = None) -> str:
    """Bars of the structure: on other nodes than their own where named, with arms (basic) from these."""
    named, arms = named or {}, arms or {}
    lines = []
    for number, (a, b) in enumerate(PAIRS, start=1):
        x = PLACES[b - 1] - PLACES[a - 1]
        up = np.cross([0.0, 0.0, 1.0], x)
        on = [named.get(a, a), named.get(b, b)]
        axes = nodes.frame[nodes.index(on)]
        v = axes[0] @ up
        w = [axes[end] @ arms.get(node, np.zeros(3)) for end, node in enumerate((a, b))]
        lines.append(f"CBAR*,{number},7,{on[0]},{on[1]}")
        lines.append("*," + ",".join(f"{value:.17e}" for value in v) + ",")
        lines.append("*,,," + ",".join(f"{value:.17e}" for value in w[0][:2]))
        lines.append("*," + ",".join(f"{value:.17e}" for value in (w[0][2], *w[1])))
    return "\n".join(lines) + "\n"


def structure() -> FEModel:
    axes = np.array([rotation([1, k, 2], 0.4 * k) for k in range(len(PLACES))])
    return frame("rig", PLACES, PAIRS, axes=axes, masses={4: 0.6, 6: 0.2})


def geometric(folder: Path, body: FEModel, cards: str, node: int = 1) -> GeometricStiffness:
    """Geometric stiffness by the bars of the deck, held at a node."""
    path = folder / "rig.bdf"
    path.write_text("BEGIN BULK\n" + cards + MATERIAL + "ENDDATA\n")
    nodes = read_bulk(path).nodes
    body = replace(body, nodes=nodes)
    found, followers = read_bars(path), read_followers(path, nodes)
    members = read_members(path, nodes) if len(condensed_dofs(body, followers, end_dofs(found))) else None
    hidden = hidden_motion(body, followers, members)
    return bars_stiffness(body, found, held=np.flatnonzero(body.dofs.node == node), hidden=hidden)


def assert_same(one: GeometricStiffness, other: GeometricStiffness, T: np.ndarray, loads: slice = slice(None)) -> None:
    """K_l of both is the same, in the motions T."""
    for load, a, b in zip(one.loads[loads], one.matrices[loads], other.matrices[loads], strict=True):
        expected = T.T @ (b @ T)
        assert abs(a - expected).max() <= ROUND_OFF * abs(expected).max(), load.label


def moved(body: FEModel, node: int, arm: np.ndarray) -> tuple[FEModel, np.ndarray]:
    """The body with a node shifted by an arm and its bars unmoved; the old motion in terms of the new one."""
    assert body.nodes is not None
    at = int(body.nodes.index(node)[0])
    F = np.kron(np.eye(2), body.nodes.frame[at])
    carried = np.eye(6)
    carried[:3, 3:] = -cross_matrix(-arm)
    T = np.eye(body.n)
    rows = body.dofs.rows_of(node, range(1, 7))
    T[np.ix_(rows, rows)] = F @ carried @ F.T
    xyz = body.nodes.xyz.copy()
    xyz[at] += arm
    A = sp.csc_array(T)
    return replace(body, K=A.T @ body.K @ A, M=A.T @ body.M @ A, nodes=replace(body.nodes, xyz=xyz)), T


ARM = np.array([0.05, -0.12, 0.2])
HUNG = {
    "RBE2": "RBE2,90,3,123456,103\n",
    "RBAR": "RBAR,90,3,103,123456\n",
    "RBE1": "RBE1,90,3,123456\n+,UM,103,123456\n",
    "a chain": "RBE2,90,3,123456,104\nRBE2,91,104,123456,103\n",
}


@pytest.mark.parametrize("rigid", HUNG.values(), ids=HUNG.keys())
def test_bars_on_dependent_nodes_are_bars_on_the_body(tmp_path: Path, rigid: str) -> None:
    """Node 3 stands aside; its bars hang on node 103, where it was, by a rigid element, or by offsets.

    The centrifugal force of a mass matrix is exact only for lumps, so it depends on where nodes are: it is compared
    between the two ways to hang the bars.
    """
    plain = structure()
    assert plain.nodes is not None
    expected = geometric(tmp_path, plain, grids(plain.nodes) + bars(plain.nodes))
    body, T = moved(plain, 3, ARM)
    assert body.nodes is not None
    turned = rotation([0, 1, 1], 0.8)[None]
    more = Nodes(np.array([103, 104]), PLACES[[2, 4]] + 0.0, np.concatenate([turned, turned]))
    hung = grids(body.nodes) + grids(more) + rigid + bars(_joined(body.nodes, more), {3: 103})
    by_element = geometric(tmp_path, body, hung)
    by_offset = geometric(tmp_path, body, grids(body.nodes) + bars(body.nodes, arms={3: -ARM}))
    assert_same(by_element, expected, T, slice(6))
    assert_same(by_element, by_offset, np.eye(body.n))


def _joined(one: Nodes, two: Nodes) -> Nodes:
    return Nodes(*(np.concatenate([getattr(one, part), getattr(two, part)]) for part in ("id", "xyz", "frame")))


def condensed(body: FEModel, keep: np.ndarray) -> tuple[FEModel, np.ndarray]:
    """The body condensed statically to some rows, and the motion of all."""
    K, rest = body.K.toarray(), np.setdiff1d(np.arange(body.n), keep)
    T = np.zeros((body.n, keep.size))
    T[keep] = np.eye(keep.size)
    T[rest] = -la.solve(K[np.ix_(rest, rest)], K[np.ix_(rest, keep)], assume_a="pos")
    small = replace(
        body,
        K=sp.csc_array(T.T @ K @ T),
        M=sp.csc_array(T.T @ body.M @ T),
        dofs=DofTable(body.dofs.node[keep], body.dofs.component[keep]),
        interfaces={},
    )
    return small, T


def test_condensed_dofs_move_as_the_matrices_were_condensed(tmp_path: Path) -> None:
    """A node without rows, another without rotations: T^T K_g T of the whole body, under the same tension."""
    body = structure()
    assert body.nodes is not None
    deck = grids(body.nodes) + bars(body.nodes)
    keep = np.flatnonzero((body.dofs.node != 5) & ((body.dofs.component <= 3) | (body.dofs.node < 4)))
    small, T = condensed(body, keep)
    path = tmp_path / "rig.bdf"
    found = geometric(tmp_path, small, deck)
    hidden = hidden_motion(small, read_followers(path, body.nodes), read_members(path, body.nodes))
    rows = hidden.dofs.rows(body.dofs.node, body.dofs.component)
    gone = np.setdiff1d(np.arange(body.n), keep)
    np.testing.assert_allclose(hidden.T[rows[gone]].toarray(), T[gone], atol=1e-9)
    whole = bars_stiffness_under(body, read_bars(path), T, small)
    for a, b in zip(found.matrices, whole, strict=True):
        expected = T.T @ (b @ T)
        assert abs(a - expected).max() <= 1e-8 * abs(expected).max()


def bars_stiffness_under(body: FEModel, bars: Bars, T: np.ndarray, small: FEModel) -> list[sp.csc_array]:
    """K_g of the whole body under the tensions of the condensed one."""
    whole = BarStiffness(body, bars)
    forces = unit_forces(small, INERTIA_LOADS, np.zeros(3))
    free = np.flatnonzero(small.dofs.node != 1)
    u = np.zeros_like(forces)
    u[free] = la.solve(small.K.toarray()[np.ix_(free, free)], forces[free], assume_a="pos")
    return [whole.stiffness(column) for column in (whole.forces @ (T @ u)).T]


def test_condensation_by_something_else_is_refused(tmp_path: Path) -> None:
    """A stiffness that the deck's members do not add up to."""
    body = structure()
    assert body.nodes is not None
    keep = np.flatnonzero(body.dofs.component <= 3)
    small, _ = condensed(body, keep)
    other = replace(small, K=sp.csc_array(small.K * 1.5))
    with pytest.raises(DofMapError, match="are not the stiffness matrix"):
        geometric(tmp_path, other, grids(body.nodes) + bars(body.nodes))
    beams = bars(body.nodes).replace("CBAR*", "CBEAM*") + "PBEAM,7,3,4.-4,2.-8,1.-8,,2.5-8\n"
    with pytest.raises(ReadError, match="write it as a CBAR"):
        geometric(tmp_path, small, grids(body.nodes) + beams)


def test_a_mean_motion_is_refused(tmp_path: Path) -> None:
    body = structure()
    assert body.nodes is not None
    more = Nodes.in_basic([103], PLACES[[2]])
    mean = "RBE3,90,,103,123456,1.,123,2,4\n+,5\n"
    with pytest.raises(DofMapError, match=r"mean \(RBE3\)"):
        geometric(tmp_path, body, grids(body.nodes) + grids(more) + mean + bars(_joined(body.nodes, more), {3: 103}))


MEMBERS = {
    "a bar": (BAR, "PBAR,7,3,4.-4,2.-8,1.-8,2.5-8\n"),
}


@pytest.mark.parametrize("section, card", MEMBERS.values(), ids=MEMBERS.keys())
def test_a_member_is_as_stiff_as_its_closed_form(tmp_path: Path, section: Section, card: str) -> None:
    path = tmp_path / "one.bdf"
    a, b = PLACES[1], PLACES[3]
    text = f"GRID,1,,{a[0]},{a[1]},{a[2]}\nGRID,2,,{b[0]},{b[1]},{b[2]}\nMAT1,3,7.+10,2.7+10\n"
    up = np.cross([0.0, 0.0, 1.0], b - a)
    path.write_text(f"BEGIN BULK\n{text}{card}CBAR,1,7,1,2,{up[0]},{up[1]},{up[2]}\n")
    nodes = read_bulk(path).nodes
    K = member_stiffness(read_members(path, nodes), nodes)[0]
    expected, _ = beam_matrices(a, b, section)
    np.testing.assert_allclose(K, expected, atol=1e-11 * abs(expected).max())


CLOSED = {
    # Tip deflection along z of a bar of length 2 along x under a unit force there; E = 7e10, G = 2.7e10.
    "bending": ("PBAR,7,3,4.-4,2.-8,1.-8,2.5-8\n", "", 2**3 / (3 * 7e10 * 2e-8)),
    "with shear": (
        "PBAR,7,3,4.-4,2.-8,1.-8,2.5-8\n+\n+,.8,.5\n",
        "",
        2**3 / (3 * 7e10 * 2e-8) + 2 / (0.8 * 2.7e10 * 4e-4),
    ),
    # Skew bending: E (I1 I2 - I12^2) in place of I1, over I2.
    "with a product of inertia": (
        "PBAR,7,3,4.-4,2.-8,1.-8,2.5-8\n+\n+,,,5.-9\n",
        "",
        2**3 / (3 * 7e10 * (2e-8 - 5e-9**2 / 1e-8)),
    ),
    # An arm of 0.5 m along x makes the bar that much shorter, and its end turn the tip.
    "with an arm": (
        "PBAR,7,3,4.-4,2.-8,1.-8,2.5-8\n",
        "+,,,,,,-.5\n",
        (1.5**3 / 3 + 1.5**2 * 0.5 + 1.5 * 0.5**2) / (7e10 * 2e-8),
    ),
}


@pytest.mark.parametrize("section, more, expected", CLOSED.values(), ids=CLOSED.keys())
def test_a_member_bends_as_its_closed_form(tmp_path: Path, section: str, more: str, expected: float) -> None:
    path = tmp_path / "one.bdf"
    text = "GRID,1,,0.,0.,0.\nGRID,2,,2.,0.,0.\nMAT1,3,7.+10,2.7+10\n"
    path.write_text(f"BEGIN BULK\n{text}{section}CBAR,1,7,1,2,0.,0.,1.\n{more}")
    nodes = read_bulk(path).nodes
    members = read_members(path, nodes)
    dofs = DofTable(np.full(6, 2), np.arange(1, 7))
    known = Recovery(dofs, dofs, sp.csr_array(np.eye(6)))
    T = end_motion(nodes, members.node.ravel(), known, members.offset.reshape(-1, 3)).toarray()
    flexibility = la.inv(T.T @ member_stiffness(members, nodes)[0] @ T)
    assert flexibility[2, 2] == pytest.approx(expected, rel=1e-12)


def test_a_hinge_at_one_end_is_a_cubic_without_curvature_there() -> None:
    """N int v'^2 dx of v = (3 x^2 / L^2 - x^3 / L^3) / 2, clamped at 0 and moved at the hinge: 6 / 5 L."""
    body = frame("one", [[0, 0, 0], [2, 0, 0]], [(1, 2)])
    hinged = replace(chain(1, section=BAR), hinged=np.array([[False, True]]))
    K = BarStiffness(body, hinged).stiffness(np.array([1.0])).toarray()
    tip = body.dofs.rows_of(2, (2, 3))
    np.testing.assert_allclose(K[tip, tip], 6 / (5 * 2.0), rtol=1e-12)
    slopes = body.dofs.rows_of(2, (4, 5, 6))
    assert abs(K[slopes]).max() == 0


SAMPLES = {"galileo/rotor": ("AA", 1001, 387), "galileo/stator": ("AA", 2001, 51), "station/outboard": ("FF", 1, 0)}


@pytest.mark.parametrize("sample", SAMPLES)
def test_samples_that_are_condensed_or_hinged_have_one(sample: str) -> None:
    """Every body of the samples but the plane beams; stress alone resists no translation, for all dependent dofs."""
    letters, node, condensed_count = SAMPLES[sample]
    folder, name = (Path(__file__).parents[2] / "sample_models" / sample).parent, sample.split("/")[1]
    stiffness, mass = (MatrixSource(folder / f"{name}.op4", f"{kind}{letters}", None) for kind in "KM")
    body = read_body(name, stiffness=stiffness, mass=mass, geometry=folder / f"{name}.bdf")
    assert body.nodes is not None
    path = folder / f"{name}.bdf"
    found, followers = read_bars(path), read_followers(path, body.nodes)
    gone = condensed_dofs(body, followers, end_dofs(found))
    assert len(gone) == condensed_count
    members = read_members(path, body.nodes) if len(gone) else None
    hidden = hidden_motion(body, followers, members)
    stress = bars_stiffness(body, found, held=np.flatnonzero(body.dofs.node == node), hidden=hidden)
    rigid = rigid_body_shapes(body.dofs, body.nodes)
    for load, K in zip(stress.loads, stress.matrices, strict=True):
        assert abs(K @ rigid[:, :3]).max() <= 1e-9 * abs(K).max(), load.label
