"""Floating frames: the rigid motion taken off the modes, by closed forms; the remaining motion, by the body itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.errors import FloatingFrameError
from cmsreduce.mechanics import REMOVED, floating_frame, lumped_mass
from cmsreduce.mechanics.floating_frames import chord_axes
from cmsreduce.model import FEModel, FrameCondition, ModalComponent, rigid_body_shapes
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.reduce import CraigBampton, MacNealRubin
from tests.frames import BAR, frame, line, rotation
from tests.solids import block, face

CELLS = (4, 2, 2)
ALL = 1e9
ENDS = [face(CELLS, 0), face(CELLS, CELLS[0])]
CROSS = np.array(
    [[[0, 0, 0], [0, 0, 1], [0, -1, 0]], [[0, 0, -1], [0, 0, 0], [1, 0, 0]], [[0, 1, 0], [-1, 0, 0], [0, 0, 0]]]
)
SKEW = np.array([rotation([1, 2, 3], 0.3 * k) for k in range(5)])


def bent(**options) -> FEModel:
    """A frame that lies in no plane, with its own axes at each node."""
    xyz = [[0.3, 0, 0.1], [1, 0, 0], [1, 1, 0], [1.2, 1, 1], [2, 1.5, 0.6]]
    faces = {"root": 1, "tip": 5}
    return frame("bent", xyz, [(1, 2), (2, 3), (3, 4), (4, 5)], faces, masses={3: 1.5}, axes=SKEW, **options)


def solid() -> FEModel:
    """Bricks: nodes without rotations, interfaces of nine nodes."""
    faces = {name: (tuple(nodes), (1, 2, 3)) for name, nodes in zip(("root", "tip"), ENDS, strict=True)}
    return block("solid", (1.0, 0.2, 0.3), CELLS, {name: nodes for name, (nodes, _) in faces.items()}, origin=(1, 2, 3))


def bare() -> FEModel:
    """The frame without inertia of its tip's rotations, so that some modes have no mass."""
    body = bent()
    M = body.M.toarray()
    rows = body.dofs.rows_of(5, (4, 5, 6))
    M[rows] = 0.0
    M[:, rows] = 0.0
    return replace(body, M=sp.csc_array(M))


def craig_bampton(body: FEModel, hz: float = ALL) -> ModalComponent:
    rows = np.unique(np.concatenate([body.interface_rows(name) for name in body.interfaces]))
    return orthogonalise(CraigBampton(hz).reduce(body, rows))


def free_modes(body: FEModel) -> ModalComponent:
    rows = np.unique(np.concatenate([body.interface_rows(name) for name in body.interfaces]))
    return orthogonalise(MacNealRubin(300.0).reduce(body, rows))


CLAMPED, MEAN = FrameCondition("clamped", "root"), FrameCondition("mean-axis")
CHORD, SOLID_CHORD = FrameCondition("chord", "root", "tip"), FrameCondition("chord", "root", "tip", "3.y")
BODIES = {
    "Craig-Bampton": (lambda: craig_bampton(bent()), (CLAMPED, MEAN, CHORD)),
    "few modes": (lambda: craig_bampton(bent(), 60.0), (CLAMPED, MEAN, CHORD)),
    "free-free": (lambda: free_modes(bent()), (CLAMPED, MEAN, CHORD)),
    "solid": (lambda: craig_bampton(solid()), (CLAMPED, MEAN, SOLID_CHORD)),
    "massless": (lambda: craig_bampton(bare()), (CLAMPED, MEAN, CHORD)),
}
CASES = [(name, condition) for name, (_, conditions) in BODIES.items() for condition in conditions]


@pytest.fixture(scope="module")
def components() -> dict[str, ModalComponent]:
    return {name: make() for name, (make, _) in BODIES.items()}


def seen(component: ModalComponent, condition: FrameCondition, **options):
    """The frame, and the deforming modes relative to it."""
    found = floating_frame(component.body, component.Phi, component.rigid_count, condition, **options)
    return found, (component.Phi @ found.change)[:, component.rigid_count :]


def frequencies(K: np.ndarray, M: np.ndarray) -> np.ndarray:
    """Finite squared frequencies, by the reciprocal problem, so that massless motions are harmless."""
    shift = np.diag(K)[np.diag(K) > 0].min()
    mu = la.eigvalsh(M, K + shift * M + shift * 1e-3 * np.diag(np.diag(M) == 0).astype(float))
    return 1 / mu[mu > 1e-12 * mu.max()][::-1] - shift


@pytest.mark.parametrize(("name", "condition"), CASES, ids=str)
def test_the_free_body_keeps_its_frequencies(components, name, condition) -> None:
    """Rigid and deforming modes together, by the mass of the modes in the frame and the unchanged stiffness."""
    component = components[name]
    found, _ = seen(component, condition)
    T, K = found.change, np.diag(component.stiffness)
    np.testing.assert_allclose(T.T @ K @ T, K, atol=1e-15 * K.max())
    lam = frequencies(K, T.T @ np.diag(component.mass) @ T)
    finite = component.omega[np.isfinite(component.omega)] ** 2
    np.testing.assert_allclose(lam, finite, rtol=1e-9, atol=1e-9 * finite[6])
    assert found.residual < REMOVED


@pytest.mark.parametrize("name", ["Craig-Bampton", "few modes", "free-free"])
def test_a_clamped_frame_holds_shapes_and_slopes(components, name) -> None:
    component = components[name]
    _, shapes = seen(component, CLAMPED)
    rows = component.body.interface_rows("root")
    assert abs(component.Phi[rows, 6:]).max() > 0.1
    np.testing.assert_allclose(shapes[rows], 0, atol=1e-11 * abs(component.Phi).max())


def test_a_face_that_a_frame_is_clamped_at_does_not_move_or_turn_in_the_mean(components) -> None:
    component = components["solid"]
    _, shapes = seen(component, CLAMPED)
    at = component.body.nodes.xyz[np.array(ENDS[0]) - 1]
    u = shapes[component.body.interface_rows("root")].reshape(9, 3, -1)
    assert abs(u).max() > 0.1
    np.testing.assert_allclose(u.mean(axis=0), 0, atol=1e-11)
    np.testing.assert_allclose(np.einsum("iab,pa,pbk->ik", CROSS, at - at.mean(axis=0), u), 0, atol=1e-11)


@pytest.mark.parametrize("lumping", ["consistent", "row-sum", "diagonal"])
@pytest.mark.parametrize("name", BODIES)
def test_modes_seen_from_mean_axes_have_no_momentum(components, name, lumping) -> None:
    component = components[name]
    body = component.body
    _, shapes = seen(component, MEAN, lumping=lumping)
    R = rigid_body_shapes(body.dofs, body.nodes, body.nodes.xyz.mean(axis=0))
    M = lumped_mass(body, lumping)
    momentum = R.T @ (M @ shapes)
    np.testing.assert_allclose(momentum, 0, atol=1e-11 * np.sqrt(M.diagonal().sum()))
    if lumping != "consistent" and name == "Craig-Bampton":
        assert abs(R.T @ (body.M @ shapes)).max() > 1e-3


@pytest.mark.parametrize(("name", "condition"), [("Craig-Bampton", CHORD), ("solid", SOLID_CHORD)])
def test_a_chord_is_not_left(components, name, condition) -> None:
    component = components[name]
    body = component.body
    found, shapes = seen(component, condition)
    ends = []
    for face_name in ("root", "tip"):
        nodes = body.interfaces[face_name].node
        rows = body.dofs.rows(np.repeat(nodes, 3), np.tile([1, 2, 3], nodes.size)).reshape(-1, 3)
        axes = body.nodes.frame[body.nodes.index(nodes)]
        ends.append(np.einsum("pij,pik->jk", axes, shapes[rows]) / nodes.size)
    x = body.interfaces["tip"].position.mean(axis=0) - body.interfaces["root"].position.mean(axis=0)
    np.testing.assert_allclose(found.axes[0], x / np.linalg.norm(x), atol=1e-15)
    np.testing.assert_allclose(found.axes @ found.axes.T, np.eye(3), atol=1e-15)
    scale = 1e-11 * abs(component.Phi).max()
    np.testing.assert_allclose(ends[0], 0, atol=scale)
    np.testing.assert_allclose(np.cross(x, ends[1], axisb=0), 0, atol=scale)
    if name == "solid":
        np.testing.assert_allclose(shapes[body.dofs.rows_of(3, (2,))], 0, atol=scale)
    else:
        turn = SKEW[0].T @ shapes[body.dofs.rows_of(1, (4, 5, 6))]
        np.testing.assert_allclose(x @ turn, 0, atol=scale)


def test_the_first_mode_of_a_free_beam_by_the_books() -> None:
    """Blevins' first bending mode: ends at 1, slope -4.64727 / L at the root, -0.60781 in the middle."""
    L = 1.0
    body = line("beam", [0, 0, 0], [L, 0, 0], 24, interfaces={"root": 1, "tip": 25})
    component = craig_bampton(body)
    rows = body.dofs.rows(np.arange(1, 26), np.full(25, 2))
    first = 6 + int(np.argmax(abs(component.Phi[rows[0], 6:8])))
    unit = component.Phi[rows[0], first]
    slope, middle = -4.64727 / L, -0.60781
    for condition, expected in (
        (FrameCondition("clamped", "root"), [0, middle - 1 - slope * L / 2, -slope * L]),
        (FrameCondition("clamped", "tip"), [-slope * L, middle - 1 - slope * L / 2, 0]),
        (CHORD, [0, middle - 1, 0]),
        (MEAN, [1, middle, 1]),
    ):
        _, shapes = seen(component, condition)
        np.testing.assert_allclose(shapes[rows[[0, 12, 24]], first - 6] / unit, expected, atol=2e-5)


def test_modal_mass_of_a_rod_seen_from_its_end() -> None:
    """Stretching, cos(pi x / L), less its value at the end: three times the mass, and coupling by the root of 2.

    The linear shapes of n elements integrate the square of the cosine a little short: 2 becomes 6 / (2 + cos(pi / n)).
    """
    n = 32
    body = line("rod", [0, 0, 0], [2, 0, 0], n, interfaces={"root": 1, "tip": n + 1})
    component = craig_bampton(body)
    x = body.dofs.rows(np.arange(1, n + 2), np.ones(n + 1, dtype=int))
    first = 6 + int(np.argmax(abs(component.Phi[x[0], 6:]) > 0.3))
    assert component.omega[first] == pytest.approx(np.pi / 2 * np.sqrt(BAR.E / BAR.rho), rel=1e-3)
    found, _ = seen(component, CLAMPED)
    mass = found.change.T @ found.change
    two = 6 / (2 + np.cos(np.pi / n))
    assert mass[first, first] == pytest.approx(1 + two, rel=1e-10)
    assert np.linalg.norm(mass[:6, first]) == pytest.approx(np.sqrt(two), rel=1e-10)


@pytest.mark.parametrize(
    ("change", "condition", "count", "message"),
    [
        (lambda b: b, CLAMPED, 7, r"'bent'.* 7 motions without strain: it holds a mechanism"),
        (lambda b: b, CLAMPED, 5, r"'bent'.* this body has 5: it is held to the ground"),
        (lambda b: replace(b, nodes=None), MEAN, 6, "needs `geometry:`, and it has none"),
        (lambda b: b, FrameCondition("clamped", "foot"), 6, r"no interface 'foot'.*it has: root, tip"),
        (lambda b: b, FrameCondition("chord", "root", "root"), 6, "no direction, its ends are 0 apart"),
        (lambda b: b, FrameCondition("chord", "root", "tip", "77.y"), 6, "names no interface and no node"),
        (
            lambda b: replace(b, interfaces={"root": replace(b.interfaces["root"], components=((1, 2, 3),))}),
            CLAMPED,
            6,
            "by clamped at root determines 3 of six rigid motions; clamp it at an interface with rotations",
        ),
    ],
)
def test_bodies_without_the_frame_asked_for_are_refused(components, change, condition, count, message) -> None:
    component = components["Craig-Bampton"]
    with pytest.raises(FloatingFrameError, match=message):
        floating_frame(change(component.body), component.Phi, count, condition)


@pytest.mark.parametrize(
    ("roll", "message"),
    [
        ("", "the nodes of 'root' do not turn.*give `roll: NODE.DOF`"),
        ("3.rx", "node 3 does not turn about every axis"),
        ("root.z", "determines 5 of six rigid motions; state another `roll`"),
        ("3.x", "determines 5 of six"),
    ],
)
def test_a_chord_must_be_held_against_turning(components, roll, message) -> None:
    component = components["solid"]
    with pytest.raises(FloatingFrameError, match=message):
        floating_frame(component.body, component.Phi, 6, FrameCondition("chord", "root", "tip", roll))


def test_a_wire_of_point_masses_has_no_mean_axes() -> None:
    body = line("wire", [0, 0, 0], [1, 0, 0], 4)
    keep = np.flatnonzero(body.dofs.component <= 3)
    M = np.zeros((body.n, body.n))
    M[keep, keep] = 1.0
    wire = replace(body, M=sp.csc_array(M))
    with pytest.raises(FloatingFrameError, match="determines 5 of six rigid motions; its mass has no inertia"):
        floating_frame(wire, np.eye(body.n)[:, :8], 6, MEAN)


def test_axes_of_a_chord_do_not_depend_on_rounding() -> None:
    axes = [
        chord_axes(line("beam", [0, 0, 0], [1, 0, tilt], 2, interfaces={"root": 1, "tip": 3}), CHORD)
        for tilt in (0.0, 1e-15, -1e-15)
    ]
    np.testing.assert_allclose(axes[0], np.eye(3), atol=1e-15)
    for found in axes[1:]:
        np.testing.assert_allclose(found, axes[0], atol=1e-14)
