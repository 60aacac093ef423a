"""Three and five disks on shafts: the published figures of projection and assembly, and where its formula fails."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.linalg.eigen import null_space
from cmsreduce.project import Projection, extraneous_count, project_shapes, returned

CHAINS = {
    "three disks": (
        (np.diag([4.0, 0.5]), np.array([[2.0, -1], [-1, 1]]), np.array([[0.0, 1]])),
        (np.diag([0.5, 1.0]), np.array([[1.0, -1], [-1, 2]]), np.array([[-1.0, 0]])),
    ),
    "five disks": (
        (np.diag([4.0, 1, 0.5]), np.array([[2.0, -1, 0], [-1, 2, -1], [0, -1, 1]]), np.array([[0.0, 0, 1]])),
        (np.diag([0.5, 1.0, 1]), np.array([[1.0, -1, 0], [-1, 2, -1], [0, -1, 2]]), np.array([[-1.0, 0, 0]])),
    ),
}
SQUARED = {
    "three disks": [0.2803442, 1.1694398, 3.0502160],
    "five disks": [0.1933442, 0.5466260, 1.4695587, 2.6608796, 3.6295916],
}


@dataclass(frozen=True)
class Reassembled:
    """Squared frequencies, modes in the coordinates of each body, and the rank of the reduced constraints."""

    squared: np.ndarray
    shapes: tuple[np.ndarray, ...]
    constrained: int


def reassemble(bodies: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]], A: Sequence[np.ndarray]) -> Reassembled:
    """Join bodies M, K reduced to shapes Q by constraints A, over the true null space of the reduced constraints.

    The closed formula published for it is not always of full rank (three disks with all modes kept: 4 x 4 of rank 3).
    """
    P, rank = null_space(np.hstack([part @ Q for part, (_, _, Q) in zip(A, bodies, strict=True)]))
    M, K = (P.T @ la.block_diag(*(body[2].T @ body[k] @ body[2] for body in bodies)) @ P for k in (0, 1))
    squared, X = la.eigh((K + K.T) / 2, (M + M.T) / 2)
    parts = np.split(P @ X, np.cumsum([Q.shape[1] for _, _, Q in bodies])[:-1])
    return Reassembled(squared, tuple(Q @ q for (_, _, Q), q in zip(bodies, parts, strict=True)), rank)


def full(name):
    """All modes of a chain and their parts on the bodies."""
    bodies = [(M, K, np.eye(len(M))) for M, K, _ in CHAINS[name]]
    return reassemble(bodies, [A for _, _, A in CHAINS[name]])


def reduced(name, modes, tolerance=1e-8):
    """Keep some modes, project, reassemble."""
    whole = full(name)
    parts = [
        project_shapes(f"body {k + 1}", [shapes[:, modes]], M, tolerance)
        for k, (shapes, (M, _, _)) in enumerate(zip(whole.shapes, CHAINS[name], strict=True))
    ]
    bodies = [(M, K, part.Q) for part, (M, K, _) in zip(parts, CHAINS[name], strict=True)]
    return parts, reassemble(bodies, [A for _, _, A in CHAINS[name]])


@pytest.mark.parametrize("name", CHAINS)
def test_the_whole_chain(name):
    np.testing.assert_allclose(full(name).squared, SQUARED[name], atol=6e-8)


def test_three_disks_one_mode_by_the_published_figures():
    parts, again = reduced("three disks", [0])
    np.testing.assert_allclose(again.squared, [0.2803442], atol=6e-8)
    # The norms of the projections squared are the reduced masses of the system mode itself.
    mass = [part.singular[0] ** 2 for part in parts]
    np.testing.assert_allclose(mass, [0.8714415, 0.1285585], atol=6e-8)
    stiffness = [
        m * (part.Q.T @ K @ part.Q).item()
        for m, part, (_, K, _) in zip(mass, parts, CHAINS["three disks"], strict=True)
    ]
    np.testing.assert_allclose(stiffness, [0.2016147, 0.0787295], atol=6e-8)


@pytest.mark.parametrize(("kept", "expected"), [(2, 3), (3, 3)])
def test_three_disks_two_or_three_modes_return_all(kept, expected):
    """With three, the projections are 2 x 3 and the published closed form is deficient in rank."""
    parts, again = reduced("three disks", list(range(kept)))
    assert [part.rank for part in parts] == [2, 2]
    assert again.squared.size == expected
    np.testing.assert_allclose(again.squared, SQUARED["three disks"], atol=6e-8)
    assert extraneous_count([part.rank for part in parts], again.constrained, kept) == expected - kept


def test_five_disks_two_modes_and_the_extraneous_one():
    parts, again = reduced("five disks", [0, 1])
    np.testing.assert_allclose(again.squared, [0.1933442, 0.5466260, 1.6873167], atol=6e-8)
    assert extraneous_count([part.rank for part in parts], again.constrained, 2) == 1
    root = np.sqrt(np.concatenate([np.diag(M) for M, _, _ in CHAINS["five disks"]]))[:, None]
    chosen, shapes = (root * np.vstack(found.shapes) for found in (full("five disks"), again))
    np.testing.assert_allclose(returned(chosen[:, :2].T @ shapes), [1, 1, 0], atol=1e-12)


@pytest.mark.parametrize("name", CHAINS)
@pytest.mark.parametrize("kept", [1, 2, 3])
def test_chosen_modes_return(name, kept):
    parts, again = reduced(name, list(range(kept)))
    whole = full(name).squared[:kept]
    nearest = again.squared[abs(again.squared[:, None] - whole).argmin(axis=0)]
    np.testing.assert_allclose(nearest, whole, rtol=1e-12)
    count = extraneous_count([part.rank for part in parts], again.constrained, kept)
    assert again.squared.size == kept + count
    assert all(part.rank == min(kept, len(M)) for part, (M, _, _) in zip(parts, CHAINS[name], strict=True))


@pytest.mark.parametrize("scale", [1e-9, 1.0, 1e9])
def test_the_rank_does_not_depend_on_units(scale):
    """Two configurations of the same modes hold nothing new, in whatever unit the shapes and masses are."""
    M = np.array([[4.0, 1.0], [1.0, 0.5]]) * scale**2
    X = np.array([[1.0, 0.3], [0.2, 1e-3]]) / scale
    once, twice = project_shapes("a", [X], M), project_shapes("a", [X, X @ np.array([[0.0, 1.0], [1.0, 0.0]])], M)
    assert once.rank == twice.rank == 2
    np.testing.assert_allclose(twice.singular[:2] / once.singular, np.sqrt(2.0), rtol=1e-12)
    np.testing.assert_allclose(once.Q.T @ M @ once.Q, np.eye(2), atol=1e-13)
    small = project_shapes("a", [X, X[:, :1] + 1e-10 / scale], M)
    assert small.rank == 2 and isinstance(small, Projection)
    compressed = project_shapes("a", [X], M, 0.5 * float(sum(once.singular)))
    assert compressed.rank == 1 and compressed.left_out == once.singular[1]


def test_a_sparse_mass_is_the_matrix_of_it():
    X, m = np.random.default_rng(0).standard_normal((5, 3)), np.arange(1.0, 6.0)
    sparse, whole = (project_shapes("a", [X], M) for M in (sp.diags_array(m, format="csc"), np.diag(m)))
    np.testing.assert_allclose(sparse.singular, la.svdvals(np.sqrt(m)[:, None] * X), rtol=1e-13)
    np.testing.assert_allclose(sparse.Q, whole.Q, atol=1e-13)


def test_a_coordinate_without_mass_follows():
    """The second coordinate is a spring's end that carries nothing: half of the first."""
    X = np.array([[2.0, 1.0], [1.0, 0.5]])
    found = project_shapes("rod", [X], np.diag([4.0, 0.0]))
    assert found.rank == 1
    np.testing.assert_allclose(abs(found.Q), [[0.5], [0.25]], rtol=1e-14)
    assert project_shapes("rod", [X], np.zeros((2, 2))).rank == 0
