"""Stress against closed forms: spinning beams and cords, hanging chains, columns, twisted struts; and any frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from scipy.special import jn_zeros

from cmsreduce.errors import SceneError, SingularInterfaceError
from cmsreduce.mechanics import bars_stiffness, modal_integrals, modal_stiffening, spinning_modes
from cmsreduce.mechanics.bars import BarStiffness
from cmsreduce.mechanics.geometric_stiffness import inertia_loads, unit_forces
from cmsreduce.model import INERTIA_LOADS, Bars, FEModel, UnitLoad
from tests.frames import BAR, Section, frame, line, rotation
from tests.spinning_beam import BEAM, LENGTH, beam

# Slender: stretching is 1e8 times as stiff as bending over the length of one.
SLENDER = Section(E=1e4, G=1e4, A=1.0, Iy=1e-4, Iz=1e-4, J=1e-4, rho=1.0)
NONE = np.zeros(0, dtype=np.int64)


def bars_of(pairs: list[tuple[int, int]], section: Section, bends: bool = True) -> Bars:
    b = len(pairs)
    polar = (section.Iy + section.Iz) / section.A
    return Bars(
        np.arange(1, b + 1),
        np.array(pairs),
        np.full(b, section.E * section.A),
        np.full(b, polar),
        np.full(b, bends),
    )


def chain(elements: int, bends: bool = True, section: Section = SLENDER) -> Bars:
    return bars_of([(k, k + 1) for k in range(1, elements + 1)], section, bends)


def clamped(body: FEModel) -> np.ndarray:
    return body.dofs.rows_of(1, (1, 2, 3, 4, 5, 6))


def tensions(body: FEModel, bars: Bars, forces: np.ndarray, held: np.ndarray) -> np.ndarray:
    """Force along each bar (b, l) under static loads on the rows (n, l), some rows held."""
    free, u = np.setdiff1d(np.arange(body.n), held), np.zeros(forces.shape)
    u[free] = la.solve(body.K[free][:, free].toarray(), forces[free], assume_a="pos")
    return BarStiffness(body, bars).forces @ u


def lowest(K: np.ndarray, M: np.ndarray, free: np.ndarray, count: int = 3) -> np.ndarray:
    return np.sqrt(la.eigh(K[np.ix_(free, free)], M[np.ix_(free, free)], eigvals_only=True)[:count])


def moving_along(body: FEModel, *components: int) -> np.ndarray:
    """Rows of some components of all nodes but the first."""
    return np.flatnonzero(np.isin(body.dofs.component, components) & (body.dofs.node > 1))


def stress_of(found, label: str) -> np.ndarray:
    return found.matrices[[load.label for load in found.loads].index(label)].toarray()


# First flapping frequency of a clamped beam at a spin of gamma, both times sqrt(rho A L^4 / E I), hub radius 0
# (Wright, Smith, Thresher and Wang, J. Appl. Mech. 49, 1982, table 1).
WRIGHT = {0: 3.5160, 1: 3.6817, 2: 4.1373, 3: 4.7973, 4: 5.5850, 5: 6.4495, 10: 11.2023}


@pytest.mark.parametrize("gamma, flap", WRIGHT.items())
def test_a_spinning_clamped_beam_has_its_published_frequencies(gamma: float, flap: float) -> None:
    body = line("beam", [0, 0, 0], [1, 0, 0], 30, section=SLENDER)
    stress = stress_of(bars_stiffness(body, chain(30), held=clamped(body)), "centrifugal zz")
    out_of_plane = moving_along(body, 3, 5)
    K, M = body.K.toarray() + gamma**2 * stress, body.M.toarray()
    found = lowest(K, M, out_of_plane)[0]
    assert found == pytest.approx(flap, rel=1e-4)
    # In the plane of the spin the centrifugal force follows the beam, and takes gamma^2 off (Southwell).
    in_plane = moving_along(body, 1, 2, 6)
    softening = np.zeros_like(M)
    along = np.flatnonzero(np.isin(body.dofs.component, (1, 2, 6)))
    softening[np.ix_(along, along)] = M[np.ix_(along, along)]
    chord = lowest(K - gamma**2 * softening, M, in_plane)[0]
    assert chord**2 == pytest.approx(flap**2 - gamma**2, rel=3e-4, abs=3e-4)


def test_a_spinning_cord_has_the_frequencies_of_legendre_functions() -> None:
    """Out of plane: omega^2 = n (2 n - 1) times the square of the spin."""
    section = replace(SLENDER, Iy=1e-12, Iz=1e-12)
    body = line("cord", [0, 0, 0], [1, 0, 0], 60, section=section)
    stress = stress_of(bars_stiffness(body, chain(60, section=section), held=clamped(body)), "centrifugal zz")
    out = np.setdiff1d(moving_along(body, 3, 5), [])
    # The cord is hinged, not clamped: its slope at the hub is free.
    out = np.union1d(out, body.dofs.rows_of(1, (5,)))
    spin = 0.5
    found = lowest(body.K.toarray() + spin**2 * stress, body.M.toarray(), out)
    np.testing.assert_allclose(found / spin, np.sqrt([1, 6, 15]), rtol=1e-3)


@pytest.mark.parametrize("bends", [True, False])
def test_a_hanging_chain_has_the_frequencies_of_bessel_functions(bends: bool) -> None:
    """Hung at its first node, acceleration upwards: omega = j_0k / 2 sqrt(g / L)."""
    section, g = replace(SLENDER, Iy=1e-13, Iz=1e-13), 0.01
    body = line("chain", [0, 0, 0], [1, 0, 0], 80, section=section)
    found = bars_stiffness(body, chain(80, bends, section), [UnitLoad("acceleration", "x")], held=clamped(body))
    # The end hangs towards +x where the frame accelerates towards -x.
    K, M = body.K.toarray() - g * found.matrices[0].toarray(), body.M.toarray()
    rows = np.union1d(moving_along(body, 3, 5), body.dofs.rows_of(1, (5,)))
    if not bends:
        rows = moving_along(body, 3)
        K = -g * found.matrices[0].toarray()
        M = np.diag(np.where(body.dofs.component == 3, np.where(body.dofs.node == 81, 0.5, 1.0) / 80, 1.0))
    np.testing.assert_allclose(lowest(K, M, rows), jn_zeros(0, 3) / 2 * np.sqrt(g), rtol=3e-3)


EULER = {
    "clamped and free": ((1, 2, 3, 4, 5, 6), (), 0.25),
    "hinged at both ends": ((1, 2, 3, 4), (2, 3, 4), 1.0),
    "clamped at both ends": ((1, 2, 3, 4, 5, 6), (2, 3, 4, 5, 6), 4.0),
    "clamped and hinged": ((1, 2, 3, 4, 5, 6), (2, 3, 4), 2.0457),
}


@pytest.mark.parametrize("first, last, share", EULER.values(), ids=EULER.keys())
def test_a_column_buckles_under_its_euler_load(first: tuple, last: tuple, share: float) -> None:
    """P = share pi^2 E I / L^2, in both planes, for any direction of the column."""
    turn = rotation([1, 2, 3], 0.7)
    tip = 2.0 * turn[:, 0]
    axes = np.tile(turn.T, (17, 1, 1))
    body = line("column", [0, 0, 0], tip, 16, section=BAR, axes=axes)
    held = body.dofs.rows_of(1, first)
    held = np.concatenate([held, body.dofs.rows_of(17, last)]) if last else held
    loads = [UnitLoad("force", axis, "17") for axis in "xyz"]
    found = bars_stiffness(body, chain(16, section=BAR), loads, held=held)
    push = -sum(part * A.toarray() for part, A in zip(turn[:, 0], found.matrices, strict=True))
    free = np.setdiff1d(np.arange(body.n), held)
    K = body.K.toarray()[np.ix_(free, free)]
    loads_at = 1 / -la.eigh(push[np.ix_(free, free)], K, eigvals_only=True)[0]
    assert loads_at == pytest.approx(share * np.pi**2 * BAR.E * min(BAR.Iy, BAR.Iz) / 4, rel=2e-4)


def test_a_strut_twists_away_at_g_j_over_its_polar_radius() -> None:
    """Torsional buckling: P = G J A / Ip."""
    body = line("strut", [0, 0, 0], [1, 0, 0], 4)
    push = -stress_of(
        bars_stiffness(body, chain(4, section=BAR), [UnitLoad("force", "x", "5")], held=clamped(body)), "force 5.x"
    )
    twist = moving_along(body, 4)
    K = body.K.toarray()
    load = 1 / -la.eigh(push[np.ix_(twist, twist)], K[np.ix_(twist, twist)], eigvals_only=True)[0]
    assert load == pytest.approx(BAR.G * BAR.J * BAR.A / (BAR.Iy + BAR.Iz), rel=1e-12)


def test_centrifugal_tension_of_a_rod_is_its_mass_outboard_times_its_acceleration() -> None:
    """N(r) = rho A omega^2 (L^2 - r^2) / 2, of each bar its mean."""
    body = line("rod", [0, 0, 0], [1, 0, 0], 10, section=SLENDER)
    # Mass of rods: alike in every direction, linear between the nodes.
    mass = np.diag(np.r_[2.0, np.full(9, 4.0), 2.0]) + np.eye(11, k=1) + np.eye(11, k=-1)
    body = replace(body, M=sp.csc_array(np.kron(mass / 60, np.diag([1, 1, 1, 0, 0, 0]))))
    tension = tensions(body, chain(10), inertia_loads(body)[:, [8]], clamped(body))[:, 0]
    ends = np.linspace(0, 1, 11)
    exact = (np.diff(ends) - np.diff(ends**3) / 3) / 2 / np.diff(ends)
    np.testing.assert_allclose(tension, exact, rtol=1e-10)


def test_centrifugal_forces_are_the_derivative_of_the_inertia_that_codes_are_given() -> None:
    body = frame("b", [[0, 0, 0], [0.5, 0.2, 0.1], [1, 0.1, 0.4]], [(1, 2), (2, 3)], masses={2: 0.3})
    shapes = np.random.default_rng(1).standard_normal((body.n, 4))
    origin, w = np.array([0.1, 0.2, 0.3]), np.array([1.0, -2.0, 3.0])
    products = [w[0] ** 2, w[1] ** 2, w[2] ** 2, w[0] * w[1], w[1] * w[2], w[0] * w[2]]
    force = shapes.T @ inertia_loads(body, origin)[:, 6:] @ products
    r_phi = modal_integrals(body, shapes, origin=origin).r_phi
    outward = np.outer(w, w) - w @ w * np.eye(3)
    np.testing.assert_allclose(force, -np.einsum("ij,ijk->k", outward, r_phi), rtol=1e-12)


def test_the_stress_of_balanced_loads_does_not_depend_on_what_holds_the_body() -> None:
    body = frame("arch", [[0, 0, 0], [0.5, 0.3, 0], [1, 0.3, 0.2], [1.5, 0, 0]], [(1, 2), (2, 3), (3, 4)])
    bars, push = bars_of([(1, 2), (2, 3), (3, 4)], BAR), UnitLoad("force", "x", "4")
    pull = UnitLoad("force", "x", "1")
    turned = unit_forces(body, [pull, push], np.zeros(3)) @ [-1.0, 1.0]
    found = [tensions(body, bars, turned[:, None], body.dofs.rows_of(node, range(1, 7))) for node in (1, 3)]
    np.testing.assert_allclose(found[0], found[1], rtol=1e-9)


def test_a_body_in_other_frames_and_another_order_is_the_same_body() -> None:
    """Displacement frames of nodes turn rows and columns, and nothing else."""
    xyz = [[0, 0, 0], [0.4, 0.1, 0], [0.8, 0.3, 0.2], [0.9, 0.8, 0.1]]
    pairs = [(1, 2), (2, 3), (3, 4)]
    axes = np.array([rotation([1, k, 2], 0.3 + k) for k in range(4)])
    plain, turned = frame("a", xyz, pairs), frame("a", xyz, pairs, axes=axes)
    bars = bars_of(pairs, BAR)
    held = plain.dofs.rows_of(1, range(1, 7))
    T = la.block_diag(*(part for A in axes for part in (A, A)))
    one, other = (bars_stiffness(body, bars, held=held) for body in (plain, turned))
    for a, b in zip(one.matrices, other.matrices, strict=True):
        np.testing.assert_allclose(T @ a.toarray() @ T.T, b.toarray(), atol=1e-9 * abs(a).max())


def test_stress_resists_no_translation_and_spins_add_up() -> None:
    body = beam(8)
    found = bars_stiffness(body, chain(8, section=BEAM), held=clamped(body))
    modes = modal_stiffening(found, np.eye(body.n))
    assert [load.label for load in found.loads] == [load.label for load in INERTIA_LOADS]
    shift = np.zeros((body.n, 3))
    for axis in range(3):
        shift[body.dofs.component == axis + 1, axis] = 1
    for K in modes.K:
        assert abs(K @ shift).max() <= 1e-12 * abs(K).max()
    # A spin about a skew axis across the beam pulls on it as a spin about z.
    skew = modes.spinning(np.array([0.0, 3.0, 4.0]))
    np.testing.assert_allclose(skew, 25 * modes.of("centrifugal zz"), atol=1e-9 * abs(skew).max())
    assert replace(modes, loads=modes.loads[:7], K=modes.K[:7]).spinning(np.array([0.0, 0.0, 1.0])) is None


def test_the_verification_beam_diverges_without_stress_and_stands_with_it() -> None:
    """Spun at 6.03 Hz, gamma = 10 of its weak axis and 5 of its strong one; unstressed it fails at 4.2418 Hz."""
    body = beam(20)
    held, M = clamped(body), body.M.toarray()
    free = np.setdiff1d(np.arange(body.n), held)
    values, X = la.eigh(body.K.toarray()[np.ix_(free, free)], M[np.ix_(free, free)])
    Phi = np.zeros((body.n, 16))
    Phi[free] = X[:, :16]
    np.testing.assert_allclose(np.sqrt(values[:2]) / (2 * np.pi), [2.1209, 4.2418], rtol=2e-5)
    modes = modal_stiffening(bars_stiffness(body, chain(20, section=BEAM), held=held), Phi)
    phi_phi = modal_integrals(body, Phi).phi_phi
    w = np.array([0, 0, 10 * np.sqrt(BEAM.E * BEAM.Iy / (BEAM.rho * BEAM.A * LENGTH**4))])
    assert spinning_modes(np.diag(values[:16]), phi_phi, w)[1] > 1.0
    omega, growth = spinning_modes(np.diag(values[:16]), phi_phi, w, modes.spinning(w))
    assert growth == 0
    weak, strong = 2.1209 / WRIGHT[0], 4.2418 / WRIGHT[0]
    expected = sorted([WRIGHT[10] * weak, np.sqrt(WRIGHT[5] ** 2 - 5**2) * strong])
    np.testing.assert_allclose(omega[:2] / (2 * np.pi), expected, rtol=1e-3)


def test_loads_that_nothing_holds_are_refused() -> None:
    body = line("arm", [0, 0, 0], [1, 0, 0], 4)
    with pytest.raises(SingularInterfaceError, match="held:"):
        bars_stiffness(body, chain(4, section=BAR), held=NONE)
    with pytest.raises(SceneError, match="no such motion"):
        unit_forces(body, [UnitLoad("force", "x", "99")], np.zeros(3))
    with pytest.raises(SceneError, match="not a unit load"):
        UnitLoad.parse("centrifugal x")
