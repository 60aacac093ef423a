"""Mass, centre and inertia of frames against rods by hand."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.errors import DofMapError
from cmsreduce.mechanics import rigid_mass
from cmsreduce.model import Nodes
from cmsreduce.verify import free_mass, rigid_mass_properties
from tests.frames import BAR, frame, line, rotation

PER_LENGTH = BAR.rho * BAR.A
POLAR = BAR.rho * (BAR.Iy + BAR.Iz)


def rod_inertia(L: float, axis: np.ndarray) -> np.ndarray:
    """Slender rod about its middle, with the polar inertia about its axis that the elements carry."""
    P = np.outer(axis, axis)
    return PER_LENGTH * L**3 / 12 * (np.eye(3) - P) + POLAR * L * P


@pytest.mark.parametrize("end", [[2, 0, 0], [0.3, -1.0, 0.7]], ids=["along x", "askew"])
@pytest.mark.parametrize("start", [[0, 0, 0], [5.0, -2.0, 1.0]], ids=["at the origin", "away"])
def test_a_rod(start, end):
    start, end = np.array(start, float), np.array(start, float) + end
    L = np.linalg.norm(end - start)
    found = rigid_mass_properties(rigid_mass(line("rod", start, end, 4)))
    np.testing.assert_allclose(found.mass, PER_LENGTH * L, rtol=1e-12)
    np.testing.assert_allclose(found.cg, (start + end) / 2, atol=1e-12)
    np.testing.assert_allclose(found.inertia, rod_inertia(L, (end - start) / L), atol=1e-10)


def test_displacement_frames_do_not_matter():
    axes = np.array([rotation([1, 2, 3], 0.3 * k) for k in range(4)])
    xyz, bars = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 1, 2]], [(1, 2), (2, 3), (3, 4)]
    frames = (frame("f", xyz, bars, axes=own, masses={4: 2.5}) for own in (None, axes))
    plain, turned = (rigid_mass_properties(rigid_mass(body)) for body in frames)
    assert plain.mass[0] == pytest.approx(2.5 + 4 * PER_LENGTH)
    np.testing.assert_allclose(turned.mass, plain.mass, rtol=1e-12)
    np.testing.assert_allclose(turned.cg, plain.cg, atol=1e-12)
    np.testing.assert_allclose(turned.inertia, plain.inertia, atol=1e-11)


def test_without_geometry_there_is_no_centre():
    with pytest.raises(DofMapError, match="'rod' has no geometry"):
        rigid_mass_properties(rigid_mass(replace(line("rod", [0, 0, 0], [1, 0, 0], 1), nodes=None)))


def test_rows_of_the_mass_matrix_in_another_order_show():
    xyz = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 1, 1], [0, 2, 1]]
    body = frame("frame", xyz, [(1, 2), (2, 3), (3, 4), (4, 5)])
    assert free_mass(body).disorder < 1e-14
    order = np.random.default_rng(3).permutation(body.n)
    shuffled = replace(body, M=sp.csc_array(body.M[order][:, order]))
    assert free_mass(shuffled).disorder > 0.1


def test_a_condensed_body_that_moves_in_a_plane_is_held_to_its_motions():
    """A frame out of the plane of its motion: M couples rotations about x and y, which are no motions, anyhow."""
    xyz = [[0, 0, 0], [1, 0, 0.3], [1.4, 1, 0], [0.8, 1.3, 0.9], [0, 2, 1]]
    whole = frame("frame", xyz, [(1, 2), (2, 3), (3, 4), (4, 5)])
    plane = np.isin(whole.dofs.component, [1, 2, 6])
    kept, inner = plane & np.isin(whole.dofs.node, [1, 3, 5]), plane & np.isin(whole.dofs.node, [2, 4])
    K, M, T = whole.K.toarray(), whole.M.toarray(), np.eye(whole.n)[:, kept]
    T[inner] = -np.linalg.solve(K[np.ix_(inner, inner)], K[np.ix_(inner, kept)])
    body = replace(
        whole, K=sp.csc_array(T.T @ K @ T), M=sp.csc_array(T.T @ M @ T), dofs=whole.dofs[np.flatnonzero(kept)]
    )
    found = free_mass(body)
    assert found.along.tolist() == [0, 1] and found.disorder < 1e-12
    order = [1, 0, *range(2, body.n)]
    assert free_mass(replace(body, M=sp.csc_array(body.M[order][:, order]))).disorder > 0.01


def test_a_spare_node_does_not_hide_a_mass_in_another_order():
    """A body held along z that has a grid for the orientation of its bars."""
    xyz = np.array([[k, 0.3 * (k % 3), 0.1 * (k % 2)] for k in range(13)], dtype=float)
    whole = frame("frame", xyz[:12], [(k, k + 1) for k in range(1, 12)])
    kept = np.flatnonzero(whole.dofs.component != 3)
    K, M = (sp.csc_array(A[kept][:, kept]) for A in (whole.K, whole.M))
    body = replace(whole, K=K, M=M, dofs=whole.dofs[kept], nodes=Nodes.in_basic(np.arange(1, 14), xyz))
    assert free_mass(body).disorder < 1e-12
    order = np.arange(body.n)
    first = int(np.flatnonzero((body.dofs.node == 5) & (body.dofs.component == 4))[0])
    order[[first, first + 1]] = order[[first + 1, first]]
    assert free_mass(replace(body, M=sp.csc_array(M[order][:, order]))).disorder > 1e-4
