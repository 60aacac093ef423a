"""Cases of the verification library of multibody codes, against closed forms and against scipy."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import scipy.linalg as la
from scipy.integrate import solve_ivp

from cmsreduce.model import FEModel, ModalComponent
from cmsreduce.write import write_component
from tests.consumers.bodies import clamped, modes
from tests.consumers.predictions import PlaneBeam
from tests.frames import BAR, Section, line

Point = tuple[float, float, float]


def load(linkage: ModuleType, folder: Path, component: ModalComponent):
    """A body through its component file."""
    path = folder / f"{component.name}.h5"
    write_component(path, component, nodes=(), inputs={}, outputs={}, checks=(), provenance={}, all_nodes=True)
    return linkage.load(path)


def link(name: str, start: Point, end: Point, faces: dict[str, int], **options: object) -> FEModel:
    return line(name, start, end, 4, interfaces=faces, **options)


def no_torque(count: int):
    return lambda *_: np.zeros(count)


# Double pendulum: two bars from the horizontal, under gravity.


def test_double_pendulum(linkage: ModuleType, tmp_path: Path) -> None:
    """Against Lagrange's equations of two rods, by scipy."""
    lengths, g = (0.8, 0.6), 9.81
    parts = [
        link("wall", (-0.1, 0, 0), (0, 0, 0), {"a": 5}),
        link("upper", (0, 0, 0), (0.8, 0, 0), {"a": 1, "b": 5}),
        link("lower", (0.8, 0, 0), (1.4, 0, 0), {"b": 1}),
    ]
    bodies = [load(linkage, tmp_path, modes(part)).cut(0) for part in parts]
    hinges = [linkage.Hinge("wall.a", "upper.a", 1), linkage.Hinge("upper.b", "lower.b", 1)]
    pendulum = linkage.Linkage(bodies, hinges, gravity=(0, 0, -g))
    s, h, steps = pendulum.rest(), 1 / 50, 40
    start = pendulum.energy(s)
    for number in range(steps):
        s = pendulum.step(s, number * h, h, no_torque(2))

    m1, m2 = (BAR.rho * BAR.A * length for length in lengths)
    (L, short), about = lengths, [m * length**2 / 3 for m, length in zip((m1, m2), lengths, strict=True)]

    def rate(_: float, y: np.ndarray) -> np.ndarray:
        one, two, w1, w2 = y
        c, k = m2 * L * short / 2 * np.cos(one - two), m2 * L * short / 2 * np.sin(one - two)
        M = np.array([[about[0] + m2 * L**2, c], [c, about[1]]])
        # About y a positive turn lowers what lies along x.
        pull = g * np.array([(m1 / 2 + m2) * L * np.cos(one), m2 * short / 2 * np.cos(two)])
        return np.r_[w1, w2, np.linalg.solve(M, pull + np.array([-k * w2**2, k * w1**2]))]

    y = solve_ivp(rate, (0, steps * h), np.zeros(4), "DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    assert abs(y[:2]).max() > 1.5
    np.testing.assert_allclose(s.angles, [y[0], y[1] - y[0]], rtol=0, atol=1e-8)
    scale = m1 * g * L
    assert abs(pendulum.energy(s) - start) < 1e-8 * scale


# Rotating flexible beam: 2 m, 1 x 2 cm.

BEAM = Section(E=6.895e10, G=2.6e10, A=2e-4, Iy=2e-2**3 * 1e-2 / 12, Iz=1e-2**3 * 2e-2 / 12, J=5e-9, rho=2500.0)
# Both planes as printed, and the fourth of the weak plane from its closed form.
PRINTED = [2.1209, 4.2418, 13.291, 26.583, 37.216, 2.1209 * (10.995541 / 1.875104) ** 2, 74.432]
ELEMENTS = 16


def beam() -> FEModel:
    return line("beam", [0, 0, 0], [2, 0, 0], ELEMENTS, interfaces={"root": 1}, section=BEAM)


def hub() -> FEModel:
    return line("hub", [-0.2, 0, 0], [0, 0, 0], 2, interfaces={"face": 3}, masses={1: 3.0})


def rotor(linkage: ModuleType, folder: Path, kind: str, cutoff_hz: float, **options: object):
    component = clamped(modes(beam(), cutoff_hz), "root")
    bodies = [load(linkage, folder, modes(hub())).cut(0), load(linkage, folder, component)]
    return getattr(linkage, kind)(bodies, [linkage.Hinge("hub.face", "beam.root", 2)], **options)


def frequencies(tree, count: int) -> np.ndarray:
    """In rad/s at rest: modal accelerations for each modal coordinate of 1e-9."""
    rest = tree.rest()
    skip = rest.u.size - rest.q.size
    pulled = []
    for q in np.eye(rest.q.size):
        s = type(rest)(rest.place, rest.axes, rest.angles, 1e-9 * q, rest.u)
        pulled.append(-tree.rate(s, np.zeros(rest.angles.size)).u[skip:] / 1e-9)
    # What a mechanism leaves free has zeros to rounding.
    return np.sqrt(np.sort(abs(np.linalg.eigvals(np.array(pulled).T)))[:count])


def test_clamped_frequencies_of_the_rotating_beam(linkage: ModuleType, tmp_path: Path) -> None:
    """The hinge locked: the five digits that are printed, and the error of sixteen elements."""
    held = rotor(linkage, tmp_path, "Linkage", 80.0, locked=[0])
    np.testing.assert_allclose(frequencies(held, 7) / (2 * np.pi), PRINTED, rtol=2e-4)


def test_spin_up_of_the_rotating_beam(linkage: ModuleType, tmp_path: Path) -> None:
    """A pulse of torque: the tip against a beam in a moving frame, by scipy from the finite elements."""
    held = rotor(linkage, tmp_path, "Linkage", 20.0)
    h, steps = 6e-3, 100
    end = steps * h

    def torque(t: float, *_: object) -> np.ndarray:
        return np.array([10.0 * np.sin(np.pi * t / (2 * end)) ** 2])

    s = held.rest()
    for number in range(steps):
        s = held.step(s, number * h, h, torque)
    assert abs(held.energy(s) - s.work) < 1e-8 * s.work
    body = beam()
    plane = np.isin(body.dofs.component, (2, 6))
    K, M = (A.toarray()[np.ix_(plane, plane)] for A in (body.K, body.M))
    model = PlaneBeam.of(K, M, np.linspace(0, 2, ELEMENTS + 1), count=2)
    expected = model.spun_up(lambda t: float(torque(t)[0]), np.array([end]))[0]
    component = clamped(modes(body, 20.0), "root")
    tip = component.Phi[body.dofs.node == ELEMENTS + 1][:3] @ s.q
    found = s.axes[1] @ (np.array([2.0, 0, 0]) + tip)
    assert s.angles[0] > 0.4 and abs(expected[2]) > 1e-3
    np.testing.assert_allclose(found[:2], expected[:2], rtol=0, atol=1e-8)


def test_the_rotating_beam_on_a_floating_hub(linkage: ModuleType, tmp_path: Path) -> None:
    """Nothing acts from outside: momentum stays, and energy once the motor has stopped."""
    free = rotor(linkage, tmp_path, "Tree", 20.0)
    start = free.rest()
    start.u[:10] = [0.1, -0.2, 0.05, 0.5, -0.3, 1.0, 10.0, 0.1, 0.05, -0.02]
    s, h, widest = start, 2e-3, 0.0
    for number in range(80):
        s = free.step(s, number * h, h, no_torque(1))
        widest = max(widest, abs(s.angles[0]))
    momentum = free.momentum(start)
    assert widest > 0.1
    assert abs(free.energy(s) / free.energy(start) - 1) < 1e-8
    assert abs(free.momentum(s) - momentum).max() < 1e-8 * abs(momentum).max()


# Four-bar: crank 0.3, coupler 0.9, rocker 0.7, ground 1 m; the crank at 60 degrees as built.

CRANK, COUPLER, ROCKER, GROUND = 0.3, 0.9, 0.7, 1.0
THIN = Section(Iy=1e-9, Iz=1e-9)


def circles(angle: float) -> tuple[np.ndarray, np.ndarray]:
    """Where crank and coupler, and coupler and rocker, meet in the plane."""
    b, d = CRANK * np.array([np.cos(angle), np.sin(angle)]), np.array([GROUND, 0.0])
    way = d - b
    far = np.linalg.norm(way)
    along = (COUPLER**2 - ROCKER**2 + far**2) / (2 * far)
    return b, b + (along * way + np.sqrt(COUPLER**2 - along**2) * np.array([-way[1], way[0]])) / far


def bars() -> list[FEModel]:
    b, c = (np.r_[point, 0.0] for point in circles(np.pi / 3))
    a, d = np.zeros(3), np.array([GROUND, 0.0, 0.0])
    return [
        link("ground", a, d, {"a": 1, "d": 5}),
        link("crank", a, b, {"a": 1, "b": 5}),
        link("coupler", b, c, {"b": 1, "c": 5}, section=THIN),
        link("rocker", c, d, {"c": 1, "d": 5}),
    ]


def inertia(angle: float) -> float:
    """Of the whole linkage about the crank's turn: twice the energy at unit rate."""
    b, c = circles(angle)
    d = np.array([GROUND, 0.0])

    def turned(v: np.ndarray) -> np.ndarray:
        return np.array([-v[1], v[0]])

    # v_c = v_b + w3 x (c - b) = w4 x (c - d).
    _, w4 = np.linalg.solve(np.column_stack([turned(c - b), -turned(c - d)]), -turned(b))
    at_b, at_c = turned(b), w4 * turned(c - d)
    per_length = BAR.rho * BAR.A
    coupler = (at_b @ at_b + at_b @ at_c + at_c @ at_c) / 3 * COUPLER
    return per_length * (CRANK**3 / 3 + coupler + w4**2 * ROCKER**3 / 3)


def test_a_rigid_four_bar_keeps_the_energy_of_its_closed_form(linkage: ModuleType, tmp_path: Path) -> None:
    bodies = [load(linkage, tmp_path, modes(bar)).cut(0) for bar in bars()]
    loop = linkage.four_bar(bodies)
    s, h, start = loop.spun(8.0), 1.5e-2, np.pi / 3
    for number in range(40):
        s = loop.step(s, number * h, h, no_torque(3))
    turn = start + s.angles[0]
    assert s.angles[0] > 4.0
    assert s.u[6] == pytest.approx(8.0 * np.sqrt(inertia(start) / inertia(turn)), rel=1e-8)
    assert abs(loop.gap(s)).max() < 1e-8


def test_a_four_bar_with_a_flexible_coupler_keeps_its_energy_and_its_loop(linkage: ModuleType, tmp_path: Path) -> None:
    # Two modes of bending in each plane.
    kept = {"coupler": 4}
    bodies = [load(linkage, tmp_path, modes(bar, 100.0)).cut(kept.get(bar.name, 0)) for bar in bars()]
    loop = linkage.four_bar(bodies)
    s, h = loop.spun(10.0), 5e-4
    start, bent = loop.energy(s), 0.0
    for number in range(30):
        s = loop.step(s, number * h, h, no_torque(3))
        q = s.q
        bent = max(bent, float(q @ bodies[2].K @ q) / (2 * start))
    assert bent > 1e-6
    assert abs(loop.energy(s) / start - 1) < 1e-8
    assert abs(loop.gap(s)).max() < 1e-9


def test_frozen_frequencies_of_a_flexible_four_bar(linkage: ModuleType, tmp_path: Path) -> None:
    """All links flexible: against finite elements of the whole linkage, its hinges as dofs that meet."""
    parts = bars()[1:]
    bodies = [load(linkage, tmp_path, modes(bar)) for bar in bars()]
    loop = linkage.four_bar([bodies[0].cut(0), *bodies[1:]])
    K, M = (la.block_diag(*(getattr(bar, name).toarray() for bar in parts)) for name in ("K", "M"))
    n = parts[0].n
    rows = []
    eye = np.eye(3 * n)
    # Pinned at a and at d, joined at b and c: the turn about z is free.
    for first, second in ((0, None), (n - 6, n), (2 * n - 6, 2 * n), (3 * n - 6, None)):
        for k in range(5):
            rows.append(eye[first + k] - (0 if second is None else eye[second + k]))
    N = la.null_space(np.array(rows))
    lam = la.eigh(N.T @ K @ N, N.T @ M @ N, eigvals_only=True)
    # Its motion as a mechanism, then what bends.
    expected = np.sqrt(lam[1:13])
    found = frequencies(loop, 60)
    found = found[found > 0.1 * expected[0]][:12]
    # Eigenvalues of an unsymmetric matrix whose largest is 1e7 times the lowest of these.
    np.testing.assert_allclose(found, expected, rtol=1e-6)
