"""Bodies of solid elements in Exudyn: joints on a face of nodes without rotations, and free tumbling."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.model import rigid_body_shapes
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.reduce import CraigBampton
from tests.consumers.bodies import modes, npz
from tests.consumers.predictions import tumbling_tip
from tests.solids import block, face

pytest.importorskip("exudyn")
from tests.consumers.exudyn_scene import ExudynScene

pytestmark = pytest.mark.exudyn


@pytest.mark.parametrize("free", [(), (5,), (3, 4)], ids=["clamped", "hinged", "two axes"])
def test_joint_on_a_face(tmp_path: Path, free: tuple[int, ...]) -> None:
    """A marker of several nodes turns with their mean rotation: what solids, which have no rotations, are joined by."""
    cells = (6, 1, 1)
    # The marker is where the mean of its nodes is, here the origin.
    body = block("block", (1.0, 0.05, 0.04), cells, {"root": face(cells, 0)}, origin=(0, -0.025, -0.02))
    scene = ExudynScene()
    made = scene.add(npz(tmp_path, modes(body)))
    root = np.asarray(face(cells, 0)) - 1
    scene.join(scene.ground, scene.marker_on(made, root), free=free)
    # Mean translation, and moment of the displacements, of the face: held or left as the joint says.
    rows = np.flatnonzero(np.isin(body.dofs.node, root + 1))
    means = np.zeros((6, body.n))
    means[:, rows] = rigid_body_shapes(body.dofs, body.nodes)[rows].T
    Z = la.null_space(means[[axis for axis in range(6) if axis not in free]])
    expected = np.sqrt(la.eigh(Z.T @ (body.K @ Z), Z.T @ (body.M @ Z), eigvals_only=True)[len(free) :])
    found = scene.frequencies()[-expected.size :]
    np.testing.assert_allclose(found, expected, rtol=1e-8)


def test_free_tumbling(tmp_path: Path) -> None:
    """A free block turns about no principal axis while a corner is pulled: every inertia term of the frame counts."""
    body = block("block", (2.0, 0.04, 0.05), (12, 1, 1), origin=(-1.0, -0.02, -0.025))
    component = orthogonalise(CraigBampton(250.0).reduce(body, ()))
    corner, spin, force = len(body.nodes.xyz) - 1, np.array([3.0, 8.0, 14.0]), np.array([0.0, 120.0, 400.0])
    times, steps = np.array([0.1, 0.2, 0.3]), 24000
    elastic = slice(component.rigid_count, None)
    args = body.M, body.nodes.xyz, component.Phi[:, elastic], component.omega[elastic], corner, spin, force, times
    expected = tumbling_tip(*args)
    rigid = tumbling_tip(*args[:2], args[2][:, :0], args[3][:0], *args[4:])
    scene = ExudynScene()
    made = scene.add(npz(tmp_path, component), initialAngularVelocity=spin)
    scene.pull(made, corner, force)
    sensor = scene.watch_point(made, corner)
    scene.move(times[-1], steps)
    found = scene.seen(sensor)[np.round(times / times[-1] * steps).astype(int)]
    np.testing.assert_allclose(found[:, 0], times, rtol=1e-9)
    # Bending shows a hundred times as much as what is asserted.
    assert abs(expected - rigid).max() > 1e-4
    np.testing.assert_allclose(found[:, 1:], expected, rtol=0, atol=1e-6)
