"""Changes of mass and of integrals, against changes made by hand."""

import numpy as np
import pytest

from cmsreduce.model import rigid_body_shapes
from cmsreduce.verify import integral_change, mass_change, momentum_balance
from tests.frames import frame, line

BENT = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 1, 2]]
BARS = [(1, 2), (2, 3), (3, 4)]


def rigid_mass(body):
    R = rigid_body_shapes(body.dofs, body.nodes)
    return R.T @ (body.M @ R)


def test_a_mass_added_at_the_centre_changes_the_mass_alone():
    bare, heavier = (line("rod", [0, 0, 0], [2, 0, 0], 2, masses=m) for m in (None, {2: 0.216}))
    found = mass_change(rigid_mass(bare), rigid_mass(heavier))
    # 2 m of 4 cm2, 2700 kg/m3.
    assert found["mass"] == pytest.approx(0.216 / 2.16, rel=1e-12)
    assert found["centre of mass"] < 1e-14 and found["inertia"] < 1e-14


def test_a_mass_added_at_an_end_moves_the_centre():
    bare, heavier = (line("rod", [0, 0, 0], [2, 0, 0], 2, masses=m) for m in (None, {3: 0.24}))
    found = mass_change(rigid_mass(bare), rigid_mass(heavier))
    gyration = np.sqrt(2.0**2 / 12)
    # The lesser moment of the bar about its own axis is far below.
    assert found["centre of mass"] == pytest.approx(0.1 / gyration, rel=1e-4)


def test_units_do_not_weigh():
    bodies = [rigid_mass(frame("f", BENT, BARS, masses=m)) for m in (None, {4: 0.5})]
    plain = mass_change(*bodies)
    to_mm = np.repeat([1.0, 1e3], 3)
    scaled = mass_change(*(1e-3 * np.outer(to_mm, to_mm) * each for each in bodies))
    assert scaled == pytest.approx(plain, rel=1e-12)


def test_integrals_of_turned_modes_are_the_same():
    rng = np.random.default_rng(2)
    turn = np.linalg.qr(rng.standard_normal((4, 4)))[0]
    phi, pairs = rng.standard_normal((3, 4)), rng.standard_normal((3, 3, 4, 4))
    turned = np.einsum("ijab,ca,db->ijcd", pairs, turn, turn)
    assert integral_change(phi, phi @ turn.T, (1,), turn, 1.0) < 1e-14
    assert integral_change(pairs, turned, (2, 3), turn, 1.0) < 1e-13
    assert integral_change(phi, 1.01 * phi, (1,), np.eye(4), 2.0) == pytest.approx(abs(phi).max() * 0.005)


def test_momentum_of_a_free_frame_is_in_its_rigid_modes():
    body = frame("f", BENT, BARS)
    values, Phi = np.linalg.eigh(
        np.linalg.solve(L := np.linalg.cholesky(body.M.toarray()), np.linalg.solve(L, body.K.toarray()).T)
    )
    Phi = np.linalg.solve(L.T, Phi)
    assert values[5] < 1e-8 * values[6]
    R = rigid_body_shapes(body.dofs, body.nodes)
    momentum = R.T @ (body.M @ Phi)
    carried, left = momentum_balance(rigid_mass(body), momentum, 6)
    assert carried < 1e-10 and left < 1e-6
    # With one shape called elastic that is rigid, both are of order one.
    wrong = momentum_balance(rigid_mass(body), momentum, 5)
    assert min(wrong) > 0.05
