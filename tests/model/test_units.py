"""Unit systems and bodies restated in them."""

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from cmsreduce.errors import UnitsError
from cmsreduce.model import (
    SI,
    Damping,
    DofTable,
    FEModel,
    RigidBody,
    Scene,
    Units,
    in_units,
    rigid_body_shapes,
    rigid_in_units,
)
from tests.frames import line

SYSTEMS = ["m-kg-s", "mm-t-s", "in-slinch-s", "mm-kg-ms", "cm-g-s", "ft-slug-s", "in-lb-s"]


@pytest.mark.parametrize(
    ("name", "force", "energy"),
    [
        ("SI", 1.0, 1.0),
        ("mm-t-s", 1.0, 1e-3),
        ("mm-kg-ms", 1e3, 1.0),
        ("cm-g-s", 1e-5, 1e-7),
        ("in-slinch-s", 4.4482216152605, 0.112984829027616),
        ("ft-slug-s", 4.4482216152605, 1.3558179483314),
        ("in-lb-s", 0.45359237 * 0.0254, 0.45359237 * 0.0254**2),
    ],
)
def test_forces_and_energies(name, force, energy):
    """Newtons and joules of published conversion tables (dyne, erg, pound-force, foot-pound)."""
    units = Units.parse(name)
    assert units.force == pytest.approx(force, rel=1e-12)
    assert units.energy == pytest.approx(energy, rel=1e-12)


@pytest.mark.parametrize("text", ["m", "m-kg", "m-kg-s-K", "furlong-kg-s", "m-stone-s", "m-kg-h", ""])
def test_unknown_units_are_refused(text):
    with pytest.raises(UnitsError, match="units '"):
        Units.parse(text)


def rod(**options) -> FEModel:
    return line("rod", [0.2, 0, 0], [1.2, 0.4, 0], 4, **options)


@settings(max_examples=20, deadline=None, derandomize=True)
@given(one=st.sampled_from(SYSTEMS), two=st.sampled_from(SYSTEMS))
def test_there_and_back(one, two):
    body = in_units(rod(damping=Damping(rayleigh=(2.0, 1e-4))), Units.parse(one))
    back = in_units(in_units(body, Units.parse(two)), Units.parse(one))
    for letter in "KM":
        A, B = getattr(body, letter).toarray(), getattr(back, letter).toarray()
        np.testing.assert_allclose(B, A, rtol=1e-12, atol=1e-300)
    np.testing.assert_allclose(back.nodes.xyz, body.nodes.xyz, rtol=1e-14)
    np.testing.assert_allclose(back.interfaces["b"].position, body.interfaces["b"].position, rtol=1e-14)
    np.testing.assert_allclose(back.damping.rayleigh, body.damping.rayleigh, rtol=1e-14)


@pytest.mark.parametrize("name", SYSTEMS)
def test_frequencies_mass_and_damping_are_what_they_were(name):
    units = Units.parse(name)
    body = rod(damping=Damping(rayleigh=(2.0, 1e-4)))
    there = in_units(body, units)
    lam, other = (la.eigvalsh(b.K.toarray(), b.M.toarray())[6:] for b in (body, there))
    np.testing.assert_allclose(other / units.time**2, lam, rtol=1e-7)
    # The mass of the bar in the new unit of mass, and its inertia about the origin.
    R, S = (rigid_body_shapes(b.dofs, b.nodes) for b in (body, there))
    mass, new = R.T @ (body.M @ R), S.T @ (there.M @ S)
    assert new[0, 0] * units.mass == pytest.approx(mass[0, 0])
    assert new[5, 5] * units.mass * units.length**2 == pytest.approx(mass[5, 5])
    ratios = [b.damping.ratios(np.sqrt(w)) for b, w in ((body, lam), (there, other))]
    np.testing.assert_allclose(ratios[1], ratios[0], rtol=1e-7)


def test_a_spring_in_inches():
    """100 lbf/in and 386.088 lb-ish of slinch: 1 N/mm = 5.71 lbf/in."""
    inch = Units.parse("in-slinch-s")
    K, M = sp.csc_array([[100.0]]), sp.csc_array([[2.0]])
    body = FEModel("spring", K, M, DofTable([1], [1]), units=inch, D=sp.csc_array([[3.0]]))
    si = in_units(body, SI)
    assert si.K[0, 0] == pytest.approx(100 * 175.126835, rel=1e-8)
    assert si.M[0, 0] == pytest.approx(2 * 175.126835, rel=1e-8)
    assert si.D[0, 0] == pytest.approx(3 * 175.126835, rel=1e-8)
    # A moment arm carries an inch twice: torsional springs in in-lbf per radian.
    turn = FEModel("spring", K, M, DofTable([1], [4]), units=inch)
    assert in_units(turn, SI).K[0, 0] == pytest.approx(100 * 0.112984829, rel=1e-8)


def test_a_rigid_body_in_other_units():
    body = RigidBody("box", 2.0, np.array([1.0, 2, 3]), np.diag([1.0, 2.0, 2.5]))
    mm = rigid_in_units(body, Units.parse("mm-t-s"))
    assert mm.mass == pytest.approx(2e-3)
    np.testing.assert_allclose(mm.cg, [1000, 2000, 3000])
    np.testing.assert_allclose(mm.inertia.diagonal(), [1e3, 2e3, 2.5e3])


def test_rounding_of_coordinates_is_a_length():
    from dataclasses import replace

    body = rod()
    body = replace(body, nodes=replace(body.nodes, xyz_rounding=1e-6))
    assert in_units(body, Units.parse("mm-t-s")).nodes.xyz_rounding == pytest.approx(1e-3)


def test_a_scene_counts_seconds():
    """Bands and cutoffs are in Hz, for any unit of time of the bodies."""
    with pytest.raises(UnitsError, match=r"'mm-kg-ms' do not count time in seconds"):
        Scene(("a",), (0.0, 1.0), units=Units.parse("mm-kg-ms"))
