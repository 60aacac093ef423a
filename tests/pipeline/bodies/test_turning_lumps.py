"""Point masses that turn under inertia forces, against the potential of their particles; and a spun beam with one."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.config import load_pipeline
from cmsreduce.mechanics import bars_stiffness
from cmsreduce.mechanics.turning_lumps import turning_lumps
from cmsreduce.model import INERTIA_LOADS, UnitLoad, cross_matrix
from cmsreduce.pipeline import Run, Silent
from cmsreduce.read import read_bars
from tests.spinning_beam import beam, write_beam

STEP = 1e-3
UNIT = dict(zip("xyz", np.eye(3), strict=True))


def acceleration(load: UnitLoad, r: np.ndarray) -> np.ndarray:
    """Of a point at rest in the frame; a product of two angular velocities is what their sum has over each alone."""
    if load.kind == "acceleration":
        return UNIT[load.axes]
    if load.kind == "angular acceleration":
        return np.cross(UNIT[load.axes], r)
    u, v = (UNIT[axis] for axis in load.axes)

    def spun(w: np.ndarray) -> np.ndarray:
        return np.cross(w, np.cross(w, r))

    return spun(u) if load.axes[0] == load.axes[1] else spun(u + v) - spun(u) - spun(v)


def hessian(potential: Callable[[np.ndarray], float]) -> np.ndarray:
    e = STEP * np.eye(3)
    corner = [[[potential(s * a + t * b) for t in (1, -1)] for s in (1, -1)] for a in e for b in e]
    found = [(c[0][0] - c[0][1] - c[1][0] + c[1][1]) / (4 * STEP**2) for c in corner]
    return np.reshape(found, (3, 3))


def lump(particles: list[tuple[float, np.ndarray]]) -> np.ndarray:
    """Mass matrix (6, 6) of particles at places from their node."""
    R = [(m, np.hstack([np.eye(3), -cross_matrix(rho)])) for m, rho in particles]
    return sum(m * X.T @ X for m, X in R)


@pytest.mark.parametrize("load", INERTIA_LOADS, ids=lambda load: load.label)
def test_a_lump_is_as_stiff_as_its_particles(load: UnitLoad) -> None:
    body, rng, origin = beam(3), np.random.default_rng(1), np.array([0.3, -0.2, 0.5])
    particles = [(m, rng.normal(size=3) / 5) for m in (0.5, 0.2, 0.8, 0.3)]
    points = np.zeros((4, 6, 6))
    points[2] = lump(particles)
    (found,) = turning_lumps(body, points, body.recovery, [load], origin)
    r = body.nodes.xyz[2] - origin

    def potential(t: np.ndarray) -> float:
        return sum(m * acceleration(load, r + rho) @ la.expm(cross_matrix(t)) @ rho for m, rho in particles)

    rows = body.dofs.rows_of(3, (4, 5, 6))
    dense = found.toarray()
    np.testing.assert_allclose(dense[np.ix_(rows, rows)], hessian(potential), atol=1e-5)
    dense[np.ix_(rows, rows)] = 0
    assert not dense.any()


def test_a_mass_that_hangs_is_a_pendulum() -> None:
    body, points = beam(3), np.zeros((4, 6, 6))
    points[3] = lump([(2.0, np.array([0.0, 0.0, -0.1]))])
    # The frame accelerates upwards, as on a table under weight.
    up, push = turning_lumps(
        body, points, body.recovery, [UnitLoad("acceleration", "z"), UnitLoad("force", "z", "4")], np.zeros(3)
    )
    rows = body.dofs.rows_of(4, (4, 5, 6))
    np.testing.assert_allclose(up.toarray()[np.ix_(rows, rows)], np.diag([0.2, 0.2, 0.0]), atol=1e-15)
    assert not push.nnz


def test_a_ball_at_the_tip_of_a_spun_beam_feels_no_spin(tmp_path: Path) -> None:
    """Its inertia is the same about all axes: the deck's card gives back what the mass matrix softens, w^2 E of it."""
    from pyyeti.nastran import op4

    mass, inertia, elements = 0.5, 0.02, 20
    card = f"CONM2,90,{elements + 1},,{mass},,,,,+A\n+A,{inertia},0.,{inertia},0.,0.,{inertia}\n"
    path = write_beam(tmp_path, elements, cards=card)
    body = beam(elements)
    M = body.M.toarray()
    M[-6:, -6:] += np.diag([mass] * 3 + [inertia] * 3)
    op4.write(str(tmp_path / "beam.op4"), {"KAA": body.K.toarray(), "MAA": M})
    run = Run(load_pipeline(path), tmp_path / "out", Silent())
    flexible, bars = run.bodies["beam"], read_bars(tmp_path / "beam.bdf")
    held = flexible.body.interface_rows("root")
    bare = bars_stiffness(flexible.body, bars, held=held)
    assert flexible.stiffening is not None
    at = [load.label for load in bare.loads].index("centrifugal zz")
    extra = (flexible.stiffening.matrices[at] - bare.matrices[at]).toarray()
    expected = np.zeros_like(extra)
    expected[-3:, -3:] = inertia / 2 * np.diag([1.0, 1.0, 2.0])
    np.testing.assert_allclose(extra, expected, atol=1e-9)
