"""Findings about an unreduced body, against hand calculation and against pyYeti's cbcheck."""

from __future__ import annotations

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.model import DofTable, FEModel, Nodes, rigid_body_shapes
from cmsreduce.read import MatrixSource, read_body
from cmsreduce.verify import (
    cancelled_masses,
    effective_mass,
    grounding,
    light_dofs,
    negative_directions,
    principal_inertia,
    rigid_mass_properties,
    rigid_motions,
    stiffness_contrast,
)
from tests.frames import frame, line

BENT = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 1, 2], [2, 1, 2]]
BARS = [(1, 2), (2, 3), (3, 4), (4, 5)]


def shapes(body: FEModel) -> np.ndarray:
    return rigid_body_shapes(body.dofs, body.nodes)


def with_entry(body: FEModel, letter: str, row: int, value: float) -> FEModel:
    A = getattr(body, letter) + sp.csc_array(([value], ([row], [row])), shape=(body.n, body.n))
    return replace(body, **{letter: sp.csc_array(A)})


# Grounding.


def test_a_free_body_is_held_nowhere() -> None:
    found = grounding(frame("f", BENT, BARS), shapes(frame("f", BENT, BARS)))
    assert found.relative.max() < 1e-14


def test_a_spring_to_ground_is_found_with_its_force_and_moment() -> None:
    body = frame("f", BENT, BARS)
    sprung = with_entry(body, "K", body.dofs.rows(4, 2)[0], 500.0)
    found = grounding(sprung, shapes(sprung))
    assert found.node[found.worst] == 4
    # Node 4 at (1, 1, 2) moves along y by 2 for a unit turn about x.
    np.testing.assert_allclose(found.translation[found.worst], 1000.0, rtol=1e-6)
    assert found.rotation[found.worst] < 1e-6
    turned = with_entry(body, "K", body.dofs.rows(2, 6)[0], 30.0)
    found = grounding(turned, shapes(turned))
    assert found.node[found.worst] == 2
    np.testing.assert_allclose(found.rotation[found.worst], 30.0, rtol=1e-6)


# Effective mass.


def cantilever(elements: int) -> tuple[FEModel, np.ndarray, np.ndarray]:
    """A uniform beam along x and its modes held at node 1, of unit modal mass."""
    import scipy.linalg as la

    body = line("beam", [0, 0, 0], [1, 0, 0], elements)
    free = np.flatnonzero(body.dofs.node != 1)
    lam, X = la.eigh(body.K.toarray()[np.ix_(free, free)], body.M.toarray()[np.ix_(free, free)])
    Phi = np.zeros((body.n, lam.size))
    Phi[free] = X
    return body, np.sqrt(lam) / (2 * np.pi), Phi


def test_a_cantilever_has_its_textbook_effective_masses() -> None:
    """61.31, 18.83, 6.47 and 3.31 per cent across (Blevins), 8/pi^2 and 8/(3 pi)^2 along, for a slender beam."""
    body, hz, Phi = cantilever(40)
    R = shapes(body)
    MR = body.M @ R
    found = effective_mass(hz, MR.T @ Phi, R.T @ MR)
    for axis, expected in ((1, [0.6131, 0.1883, 0.0647, 0.0331]), (2, [0.6131, 0.1883, 0.0647, 0.0331])):
        share = found.share[:, axis]
        np.testing.assert_allclose(share[share > 1e-3][:4], expected, atol=1e-4)
    along = found.share[:, 0]
    np.testing.assert_allclose(along[along > 1e-3][:2], [8 / np.pi**2, 8 / (9 * np.pi**2)], rtol=2e-3)
    # What the sum lacks is the mass of the held node: M_ii - M_ij M_jj^-1 M_ji.
    i, j = body.dofs.node == 1, body.dofs.node != 1
    M = body.M.toarray()
    held = M[np.ix_(i, i)] - M[np.ix_(i, j)] @ np.linalg.solve(M[np.ix_(j, j)], M[np.ix_(j, i)])
    np.testing.assert_allclose(found.total[:3] * (1 - found.running[-1, :3]), held.diagonal()[:3], rtol=1e-8)


# Rigid motions.


@pytest.mark.parametrize("elements", [3, 150], ids=["dense", "sparse"])
def test_the_three_sources_agree_for_a_free_bar(elements: int) -> None:
    body = line("bar", [0, 1, 0], [2, 1, 1], elements)
    assert (body.n > 600) == (elements == 150)
    found = rigid_motions(body, shapes(body))
    # A chain of elements costs a digit for each that stands between a dof and the reference.
    assert max(found.apart(body.M)) < 1e-13 * elements**3
    # First bending of a free beam: (4.730)^2 / 2 pi L^2 sqrt(EI / rho A), softer axis.
    L = np.sqrt(5.0)
    first = 4.73004**2 / (2 * np.pi * L**2) * np.sqrt(70e9 * 1e-8 / (2700 * 4e-4))
    assert found.elastic_hz == pytest.approx(first, rel=5e-3)
    assert abs(found.rigid_hz).max() < 1e-3 * first


def test_a_coordinate_that_the_stiffness_does_not_know_shows() -> None:
    """Node 3 of the deck is a tenth off: the motions of K keep the bar's own coordinates."""
    body = line("bar", [0, 0, 0], [2, 0, 0], 4)
    xyz = body.nodes.xyz.copy()
    xyz[2, 0] += 0.1
    moved = replace(body, nodes=replace(body.nodes, xyz=xyz))
    found = rigid_motions(body, shapes(moved))
    rows = body.dofs.rows(3, [2, 3])
    assert not set(rows) & set(found.reference)
    assert abs(found.stiffness[rows] - found.geometry[rows]).max() == pytest.approx(0.1, rel=1e-6)


# Mass and stiffness.


def test_dofs_without_mass_and_nearly_without() -> None:
    body = line("bar", [0, 0, 0], [2, 0, 0], 4)
    M = body.M.toarray()
    for row, value in ((15, 0.0), (21, 1e-14)):
        M[row], M[:, row] = 0.0, 0.0
        M[row, row] = value
    light = light_dofs(replace(body, M=sp.csc_array(M)))
    assert light.massless.tolist() == [15] and light.nearly.tolist() == [21]
    assert (light.highest, light.highest_hz) == (21, pytest.approx(np.sqrt(body.K[21, 21] / 1e-14) / 2 / np.pi))


def test_contrast_names_the_softest_dof() -> None:
    body = FEModel(
        "springs",
        sp.csc_array(np.diag([5.0, 2e7, 3.0, 0.0])),
        sp.eye_array(4, format="csc"),
        DofTable(np.array([1, 2, 3, 4]), np.zeros(4, dtype=np.int8)),
    )
    (found,) = stiffness_contrast(body)
    assert (found.kind, found.stiffest, found.softest) == ("scalars", 1, 2)
    assert found.ratio == pytest.approx(2e7 / 3)


@pytest.mark.parametrize(("weakened", "count"), [(0.0, 0), (1.2, 1)])
def test_motions_of_negative_energy_are_counted(weakened: float, count: int) -> None:
    """A spring taken out of a bar more than once leaves one motion whose energy is negative."""
    body = line("bar", [0, 0, 0], [2, 0, 0], 4)
    pair = np.zeros(body.n)
    pair[[6, 12]] = 1.0, -1.0
    K = body.K.toarray() - weakened * 70e9 * 4e-4 / 0.5 * np.outer(pair, pair)
    assert negative_directions(sp.csc_array(K), 2.0**-53) == count
    assert negative_directions(body.M, 2.0**-53) == 0


def bars_with_knot(left: float, length: float, heavy: float = 0.0) -> FEModel:
    """Five bars along x, their last node with a rotation whose mass cancelled; a mass on the first of two others."""
    bars = np.zeros((9, 9))
    for i in range(5):
        bars[i : i + 2, i : i + 2] += 0.125
    bars[6, 6] = left * length**2
    bars[6, 4:6] = bars[4:6, 6] = 4e-19 * length
    bars[7:, 7:] = np.diag([heavy, 1.0])
    K = np.eye(9)
    K[6, :6] = K[:6, 6] = 0.1
    xyz = np.array([[0.2 * length * i, 0.0, 0.0] for i in range(6)] + [[1e6, 0.0, 0.0], [0.0, 1e6, 0.0]])
    dofs = DofTable(np.array([1, 2, 3, 4, 5, 6, 6, 7, 8]), np.array([1, 1, 1, 1, 1, 1, 6, 1, 1], dtype=np.int8))
    nodes = Nodes.in_basic(np.arange(1, 9), xyz)
    return FEModel("bars", sp.csc_array(K), sp.csc_array(bars), dofs, nodes)


@pytest.mark.parametrize("length", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize(("left", "count"), [(2.6e-18, 0), (-2.6e-18, 0), (-5e-16, 1)])
def test_masses_that_cancelled_are_no_negative_energy(left: float, count: int, length: float) -> None:
    """Elements of one point give a stretch of their nodes no mass but the rounding of what cancels, of either sign.

    In millimetres a rotation has a million times the entries, and so has what cancels of them.
    """
    for heavy in (0.0, 1e6):
        bars = bars_with_knot(left, length, heavy)
        # So it is where another unit makes the mass a million times smaller.
        for unit in (1.0, 1e-6):
            found = replace(bars, M=sp.csc_array(unit * bars.M))
            kind = found.dofs.component
            assert negative_directions(found.M, 2.0**-53, kind, cancelled_masses(found)) == count


def test_masses_far_away_hide_no_negative_energy() -> None:
    """A mass that no element joins to a light row, and the distance to it, say nothing of what cancelled in that."""
    bars = bars_with_knot(-5e-10, 1.0, 1e9)
    assert (cancelled_masses(bars)[:6] == 0).all()
    assert negative_directions(bars.M, 2.0**-53, bars.dofs.component, cancelled_masses(bars)) == 1
    # A stiffness has no such rows: the smallest spring counts beside a stop of any stiffness.
    assert negative_directions(sp.csc_array(np.diag([1e30, 1.0, -1e-3])), 2.0**-53) == 1


@pytest.mark.parametrize(("changed", "count"), [((), 0), ((0, 1, 2), 3), ((1,), 1)])
def test_equal_parts_of_a_mass_are_counted_each(changed: tuple[int, ...], count: int) -> None:
    """The mass of a solid in x, y and z is one matrix three times, unless one of them is wrong."""
    one = sp.csc_array(sp.diags_array([1.0, 4.0, 1.0], offsets=[-1, 0, 1], shape=(30, 30)))
    wrong = one + sp.csc_array(([-5.0], ([7], [7])), shape=one.shape)
    parts = [wrong if k in changed else one for k in range(3)]
    M = sp.csc_array(sp.block_diag(parts))
    assert negative_directions(M, 2.0**-53) == count
    # The parts follow from the kinds of rows where no kind is coupled with another; one kind may have several parts.
    for kind in (np.repeat([1, 2, 3], 30), np.repeat([1, 2, 1], 30), np.arange(90) % 3, np.zeros(90, dtype=int)):
        assert negative_directions(M, 2.0**-53, kind) == count
    shuffled = np.random.default_rng(3).permutation(90)
    apart = sp.csc_array(M[shuffled][:, shuffled])
    assert negative_directions(apart, 2.0**-53, np.repeat([1, 2, 3], 30)[shuffled]) == count


# Against another program.


@pytest.mark.shared
@pytest.mark.parametrize(("name", "q"), [("inboard", 8), ("outboard", 22)])
def test_nas2cam_as_cbcheck_sees_it(shared_data: Path, name: str, q: int) -> None:
    """Mass, centre, radii of gyration, principal moments, effective masses, K R: pyYeti's, to its printed digits."""
    from pyyeti import cb, nastran
    from pyyeti.nastran import op4

    stem = shared_data / "nas2cam" / name
    m, k = (op4.read(f"{stem}.op4")[letter] for letter in ("mxx", "kxx"))
    uset, _ = nastran.bulk2uset(f"{stem}.asm")
    said = io.StringIO()
    theirs = cb.cbcheck(said, m, k, np.arange(24), np.arange(6), uset=uset)
    source = [MatrixSource(Path(f"{stem}.op4"), letter) for letter in ("kxx", "mxx")]
    body = read_body(name, stiffness=source[0], mass=source[1], geometry=Path(f"{stem}.asm"))
    assert body.n == 24 + q
    R = shapes(body)
    np.testing.assert_allclose(R[:24], theirs.rbg, atol=1e-12)
    assert not R[24:].any()

    motions = rigid_motions(body, R)
    # Theirs are relative to the first grid; in the plane of all motions they are the same.
    for ours, other in ((motions.stiffness, theirs.rbs), (motions.eigen, theirs.rbe)):
        combined = other @ np.linalg.lstsq(other, ours, rcond=None)[0]
        np.testing.assert_allclose(ours, combined, atol=1e-6 * abs(ours).max())
    printed = said.getvalue()
    for X in (R, motions.stiffness, motions.eigen):
        found = rigid_mass_properties(X.T @ (body.M @ X))
        centre = table(printed, "Geometry", "Distance to CG")
        np.testing.assert_allclose(found.cg, centre, atol=2e-5)
        solid = principal_inertia(found)
        np.testing.assert_allclose(solid.gyration, table(printed, "Geometry", "X, Y, Z axes (from CG)"), atol=1e-5)
        np.testing.assert_allclose(solid.radii, table(printed, "Geometry", "principal axes (from CG)"), atol=1e-5)

    free = np.arange(24, body.n)
    # Modes of unit mass are the q-set itself: the effective mass is the square of its row of M R.
    hz = np.sqrt(body.K.diagonal()[free]) / (2 * np.pi)
    np.testing.assert_allclose(hz, theirs.cb_frq, rtol=1e-9)
    masses = effective_mass(hz, (body.M @ R)[free].T, R.T @ (body.M @ R))
    np.testing.assert_allclose(masses.mass, theirs.effmass.to_numpy(), atol=1e-9 * masses.total.max())
    share = theirs.effmass_percent.to_numpy()[:, -6:] / 100
    np.testing.assert_allclose(masses.share, share, atol=1e-9)

    # A spring to ground under each, so that there is more than rounding to compare.
    row = body.dofs.rows(19, 2)[0]
    sprung = with_entry(body, "K", row, 1e4)
    held = grounding(sprung, R)
    expected = theirs.k[:24, :24] @ theirs.rbg
    expected[row] += 1e4 * theirs.rbg[row]
    np.testing.assert_allclose(held.force[:24], expected, atol=1e-8 * abs(expected).max())
    assert held.node[held.worst] == 19


def table(printed: str, row: str, after: str) -> np.ndarray:
    """Three numbers of a row in the part of the report after some words."""
    lines = printed[printed.index(after) :].splitlines()
    (found, *_) = (line.split()[-3:] for line in lines if line.strip().startswith(row))
    return np.array(found, dtype=float)
