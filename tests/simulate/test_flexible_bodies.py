"""Flexible bodies: verification cases of multibody codes, against closed forms, finite elements and scipy."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la
from scipy.integrate import solve_ivp

from cmsreduce.errors import FloatingFrameError
from cmsreduce.model import FEModel, FrameCondition, Interface, RigidBody
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.pipeline.results import floating_body
from cmsreduce.reduce import CraigBampton
from cmsreduce.simulate import Method, Pulse, scene_system
from cmsreduce.simulate.movements import point_row
from tests.consumers.bodies import modes
from tests.consumers.predictions import PlaneBeam, tumbling_tip
from tests.frames import Section, frame, line
from tests.simulate.four_bar import bars
from tests.simulate.scenes import hinged, joint, rigid_part, simulate, written
from tests.solids import block, face

# Rotating flexible beam: 2 m, 1 x 2 cm.
BEAM = Section(E=6.895e10, G=2.6e10, A=2e-4, Iy=2e-2**3 * 1e-2 / 12, Iz=1e-2**3 * 2e-2 / 12, J=5e-9, rho=2500.0)
# Both planes as printed, and the fourth of the weak plane from its closed form.
PRINTED = [2.1209, 4.2418, 13.291, 26.583, 37.216, 2.1209 * (10.995541 / 1.875104) ** 2, 74.432]
ELEMENTS = 16
CLAMPED = {"beam": FrameCondition("clamped", "root")}


def beam() -> FEModel:
    return line("beam", [0, 0, 0], [2, 0, 0], ELEMENTS, interfaces={"root": 1}, section=BEAM)


def hub() -> RigidBody:
    face = Interface("face", np.array([-1]), ((1, 2, 3, 4, 5, 6),), np.zeros((1, 3)), np.eye(3))
    return RigidBody("hub", 3.2, np.array([-0.15, 0, 0]), np.diag([2e-4, 0.01, 0.01]), {"face": face})


def rotor(folder: Path, cutoff_hz: float, free: tuple[int, ...] = (5,), ground: tuple[str, ...] = ("hub.face",)):
    joints = [joint("axle", "hub.face", "beam.root", free)]
    return hinged([hub(), modes(beam(), cutoff_hz)], joints, folder, ground=ground, frames=CLAMPED)


def frequencies(scene) -> np.ndarray:
    """In rad/s, joints closed, at rest."""
    bodies = {body.name: floating_body(body.file) for body in scene.bodies if body.file is not None}
    system = scene_system(scene, bodies)
    return np.sqrt(np.maximum(system.linear(system.start())[0], 0.0))


def test_clamped_frequencies_of_the_rotating_beam(tmp_path: Path) -> None:
    """The hinge locked: the five digits that are printed, and the error of sixteen elements."""
    found = frequencies(rotor(tmp_path, 80.0, ()))
    np.testing.assert_allclose(found[:7] / (2 * np.pi), PRINTED, rtol=2e-4)


def test_spin_up_of_the_rotating_beam(tmp_path: Path) -> None:
    """A pulse of torque: the tip against a beam in a moving frame, by scipy from the finite elements."""
    end = 0.4
    pulse = Pulse(10.0, 2 * end)
    motion = simulate(rotor(tmp_path, 20.0), end, points=4, efforts={"axle.5": pulse}, accuracy=1e-7)
    body = beam()
    plane = np.isin(body.dofs.component, (2, 6))
    K, M = (A.toarray()[np.ix_(plane, plane)] for A in (body.K, body.M))
    model = PlaneBeam.of(K, M, np.linspace(0, 2, ELEMENTS + 1), count=2)
    expected = model.spun_up(pulse, np.array([end]))[0]
    assert motion.joints["axle.rz"][-1] > 0.1 and abs(expected[2]) > 1e-3
    np.testing.assert_allclose(motion.point("beam", ELEMENTS + 1)[-1, :2], expected[:2], rtol=0, atol=1e-8)
    assert motion.imbalance < 1e-8


@pytest.mark.parametrize(("method", "accuracy", "limit"), [("explicit", 1e-8, 1e-8), ("implicit", 1e-3, 1e-3)])
def test_the_rotating_beam_on_a_floating_hub(tmp_path: Path, method: Method, accuracy: float, limit: float) -> None:
    """Nothing acts from outside: momentum stays, and energy."""
    scene = rotor(tmp_path, 20.0, ground=())
    start = {"velocity": [0.1, -0.2, 0.05], "spin": [0.5, -0.3, 1.0], "rates": {"axle.rz": 10.0}}
    start["modes"] = {"beam": [0.01, 0.005, 0.01]}
    motion = simulate(scene, 0.08, points=2, **start, accuracy=accuracy, method=method)
    assert abs(motion.joints["axle.rz"]).max() > 0.1
    assert motion.imbalance < limit
    assert abs(motion.momentum - motion.momentum[0]).max() < limit * abs(motion.momentum[0]).max()


def flexible_four_bar(folder: Path, cut: dict[str, int | None]):
    """Links rigid, of some modes, or of all of them (None)."""
    found = []
    for bar in bars():
        whole = modes(bar)
        kept = cut.get(bar.name, 0)
        if kept == 0:
            found.append(rigid_part(whole))
        else:
            found.append(whole if kept is None else whole.truncated(np.arange(6, 6 + kept)))
    joints = [
        joint("a", "ground.a", "crank.a"),
        joint("b", "crank.b", "coupler.b"),
        joint("c", "coupler.c", "rocker.c"),
        joint("d", "ground.d", "rocker.d"),
    ]
    return hinged(found, joints, folder, ground=["ground.a"])


def test_a_four_bar_with_a_flexible_coupler_keeps_its_energy_and_its_loop(tmp_path: Path) -> None:
    # Two modes of bending in each plane.
    motion = simulate(flexible_four_bar(tmp_path, {"coupler": 4}), 0.015, points=10, rates={"a.rz": 10.0})
    q = motion.modal["coupler"]
    K = motion.system.bodies[2].K
    assert (np.einsum("ta,ab,tb->t", q, K, q) / (2 * motion.energy[0, 0])).max() > 1e-6
    assert motion.imbalance < 1e-8
    gap = motion.point("rocker", "d") - motion.point("ground", "d")
    assert abs(gap).max() < 1e-10


def test_frozen_frequencies_of_a_flexible_four_bar(tmp_path: Path) -> None:
    """All links flexible: against finite elements of the whole linkage, its hinges as dofs that meet."""
    parts = bars()[1:]
    K, M = (la.block_diag(*(getattr(bar, name).toarray() for bar in parts)) for name in ("K", "M"))
    n = parts[0].n
    rows, eye = [], np.eye(3 * n)
    # Pinned at a and at d, joined at b and c: the turn about z is free.
    for first, second in ((0, None), (n - 6, n), (2 * n - 6, 2 * n), (3 * n - 6, None)):
        for k in range(5):
            rows.append(eye[first + k] - (0 if second is None else eye[second + k]))
    N = la.null_space(np.array(rows))
    lam = la.eigh(N.T @ K @ N, N.T @ M @ N, eigvals_only=True)
    found = frequencies(flexible_four_bar(tmp_path, dict.fromkeys(("crank", "coupler", "rocker"))))
    # Its motion as a mechanism, then what bends.
    np.testing.assert_allclose(found[1:], np.sqrt(lam[1:]), rtol=1e-8)


def test_free_tumbling(tmp_path: Path) -> None:
    """A free block turns about no principal axis while a corner is pulled: every inertia term of the frame counts."""
    body = block("block", (2.0, 0.04, 0.05), (12, 1, 1), origin=(-1.0, -0.02, -0.025))
    component = orthogonalise(CraigBampton(250.0).reduce(body, ()))
    corner, spin, force = len(body.nodes.xyz) - 1, np.array([3.0, 8.0, 14.0]), np.array([0.0, 120.0, 400.0])
    times = np.array([0.05, 0.1])
    elastic = slice(component.rigid_count, None)
    expected = tumbling_tip(
        body.M, body.nodes.xyz, component.Phi[:, elastic], component.omega[elastic], corner, spin, force, times
    )
    system = scene_system(hinged([component], [], tmp_path), {"block": floating_body(tmp_path / "block.h5")})
    block_ = system.bodies[0]
    marker = block_.markers[str(body.nodes.id[corner])]

    def pulled(t: float, y: np.ndarray) -> np.ndarray:
        f, change = system.frames(y)[0], system.rate(t, y)
        along = point_row(marker, np.concatenate([f.R.T @ force, np.zeros(3)]), f.q)
        M = block_.inertia(f.q, np.concatenate([f.v, f.w, f.rate]))[0]
        change[system.first_speed : system.first_speed + system.n] += np.linalg.solve(M, along)
        return change

    start = system.start(base=(0, np.cross(spin, system.place(0)), spin))
    found = solve_ivp(pulled, (0, times[-1]), start, "DOP853", times, rtol=1e-8, atol=1e-11).y.T
    for y, place in zip(found, expected, strict=True):
        f = system.frames(y)[0]
        np.testing.assert_allclose(f.x + f.R @ (marker.position + marker.translation @ f.q), place, rtol=0, atol=1e-8)


def test_a_body_held_by_its_matrices(tmp_path: Path) -> None:
    """Its frame stands still, and it vibrates at its own frequencies."""
    body = frame("mast", [[0, 0, 0], [0.5, 0, 0.1], [1, 0, 0]], [(1, 2), (2, 3)], {"tip": 3}, held=[1])
    component = modes(body)
    found = frequencies(hinged([component], [], tmp_path))
    np.testing.assert_allclose(found, component.omega, rtol=1e-8)


def test_joints_on_faces_of_several_nodes(tmp_path: Path) -> None:
    """Two blocks of solids joined node by node are one block: nodes without rotations lock displacements alone."""
    cells = (4, 1, 1)
    left = block("left", (1.0, 0.05, 0.04), cells, {"face": face(cells, 4)})
    right = block("right", (1.0, 0.05, 0.04), cells, {"face": face(cells, 0)}, origin=(1.0, 0.0, 0.0))
    n = left.n
    ends = [np.flatnonzero(np.isin(body.dofs.node, body.interfaces["face"].node)) for body in (left, right)]
    G = np.zeros((12, 2 * n))
    G[np.arange(12), ends[0]], G[np.arange(12), n + ends[1]] = 1.0, -1.0
    Z = la.null_space(G)
    K, M = (la.block_diag(getattr(left, A).toarray(), getattr(right, A).toarray()) for A in ("K", "M"))
    lam = la.eigh(Z.T @ K @ Z, Z.T @ M @ Z, eigvals_only=True)
    clamp = joint("weld", "left.face", "right.face", ())
    clamp = replace(clamp, locked=((0, 1, 2),) * 4, arms=np.zeros((4, 3)))
    found = frequencies(hinged([modes(left), modes(right)], [clamp], tmp_path))
    np.testing.assert_allclose(found[6:], np.sqrt(lam[6:]), rtol=1e-7)


def test_a_body_in_a_plane_is_refused(tmp_path: Path) -> None:
    body = frame("flat", [[0, 0, 0], [1, 0, 0]], [(1, 2)], {"tip": 2}, held=[])
    whole = modes(body)
    flat = replace(
        whole,
        **{
            name: getattr(whole, name)[1:] if getattr(whole, name).ndim == 1 else getattr(whole, name)[:, 1:]
            for name in ("Phi", "omega", "zeta", "source_hz", "sigma", "spacing")
        },
        kind=whole.kind[1:],
        why=whole.why[1:],
        rigid_count=5,
        rankings={},
    )
    with pytest.raises(FloatingFrameError, match="5 rigid motions"):
        floating_body(written(tmp_path, flat))
