"""Null spaces of constraints, rigid-body modes and mechanisms of frames."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.errors import MatrixError
from cmsreduce.linalg.eigen import null_space, only_motions, rigid_body_modes, row_basis, stiffness_null_space
from cmsreduce.linalg.machine import SolverSettings, solver_settings
from cmsreduce.mechanics import Tie, tie_nodes
from cmsreduce.model import rigid_body_shapes
from tests.frames import BAR, frame, line
from tests.solids import block, face

XYZ = [[0, 0, 0], [1, 0, 0], [1, 1, 0.2], [0, 1, 0], [0.4, 0.5, 0.8]]
BARS = [(1, 2), (2, 3), (3, 4), (4, 1), (1, 5), (2, 5), (3, 5)]


def ranked(c: int, m: int, rank: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.standard_normal((c, rank)) @ rng.standard_normal((rank, m))


CONSTRAINTS = {
    "full rank": (ranked(4, 9, 4), 4),
    "dependent rows": (ranked(7, 9, 3), 3),
    "square": (ranked(5, 5, 5), 5),
    "more rows than columns": (ranked(9, 4, 4), 4),
    "unlike units": (np.diag([1e4, 1.0, 1e-3]) @ ranked(3, 6, 3), 3),
    "zero rows": (np.vstack([np.zeros((2, 6)), ranked(2, 6, 2)]), 2),
    "nothing but zeros": (np.zeros((3, 4)), 0),
    "no rows": (np.zeros((0, 4)), 0),
    "no columns": (np.zeros((3, 0)), 0),
}


@pytest.mark.parametrize(("A", "rank"), CONSTRAINTS.values(), ids=CONSTRAINTS)
def test_null_space(A, rank):
    N, found = null_space(A)
    assert (found, N.shape) == (rank, (A.shape[1], A.shape[1] - rank))
    np.testing.assert_allclose(N.T @ N, np.eye(N.shape[1]), atol=1e-13)
    sizes = np.linalg.norm(A, axis=1, keepdims=True)
    np.testing.assert_allclose((A / np.where(sizes > 0, sizes, 1)) @ N, 0, atol=1e-13)


@pytest.mark.parametrize(("A", "rank"), [case for name, case in CONSTRAINTS.items() if name != "no columns"])
def test_row_basis(A, rank):
    U = row_basis(A)
    assert U.shape == (rank, A.shape[0])
    if rank:
        s = la.svdvals(U @ A)
        assert s[-1] > 1e-8 * s[0]
        assert null_space(np.vstack([U @ A, A]))[1] == rank


def held(*rows: int):
    """The frame with rows taken out."""
    body = frame("frame", XYZ, BARS)
    keep = np.setdiff1d(np.arange(body.n), rows)
    R = rigid_body_shapes(body.dofs, body.nodes)
    return body.K[keep][:, keep], body.M[keep][:, keep], R[keep]


def hinged():
    """Two bars that share the translations of their middle node only: three mechanisms beside six rigid motions."""
    one, two = line("one", [0, 0, 0], [1, 0, 0], 2), line("two", [1, 0, 0], [1.5, 0.8, 0.3], 2)
    T = np.zeros((36, 33))
    T[:18, :18] = np.eye(18)
    T[18:21, 12:15] = np.eye(3)
    T[21:, 18:] = np.eye(15)
    R = np.vstack([rigid_body_shapes(body.dofs, body.nodes) for body in (one, two)])
    K, M = (la.block_diag(*(getattr(body, A).toarray() for body in (one, two))) for A in "KM")
    return sp.csc_array(T.T @ K @ T), sp.csc_array(T.T @ M @ T), la.lstsq(T, R)[0]


BODIES = {
    "free": (held(), 6),
    "one node pinned": (held(0, 1, 2), 3),
    "two nodes pinned": (held(0, 1, 2, 6, 7, 8), 1),
    "statically determinate": (held(0, 1, 2, 7, 8, 14), 0),
    "clamped": (held(*range(6)), 0),
    "rolls along x": (held(1, 2, 3, 4, 5), 1),
    "hinge in the middle": (hinged(), 9),
}


@pytest.mark.parametrize("geometry", [True, False], ids=["geometry", "no geometry"])
@pytest.mark.parametrize(("body", "count"), BODIES.values(), ids=BODIES)
def test_rigid_motions_and_mechanisms_are_counted(body, count, geometry):
    K, M, R = body
    Phi = rigid_body_modes(K, M, R if geometry else None, 2.0**-53, "body")
    assert Phi.shape == (K.shape[0], count)
    np.testing.assert_allclose(Phi.T @ (M @ Phi), np.eye(count), atol=1e-11)
    assert abs(K @ Phi).max(initial=0.0) < 1e-11 * abs(K).max() * abs(Phi).max(initial=1.0)
    # A dense solver finds as many zero frequencies.
    lam = la.eigvalsh(K.toarray(), M.toarray())
    assert np.count_nonzero(lam < 1e-9 * np.median(lam)) == count


@pytest.mark.parametrize("geometry", [True, False], ids=["geometry", "no geometry"])
def test_a_body_beyond_dense_algebra(geometry):
    body = line("mast", [0, 0, 0], [3, 1, 0.5], 110)
    R = rigid_body_shapes(body.dofs, body.nodes) if geometry else None
    Phi = rigid_body_modes(body.K, body.M, R, body.rounding, "mast")
    assert Phi.shape == (666, 6)
    # The modes represent all mass in translation.
    T = rigid_body_shapes(body.dofs, body.nodes)[:, :3]
    np.testing.assert_allclose(((Phi.T @ (body.M @ T)) ** 2).sum(axis=0), 2700 * 4e-4 * np.sqrt(10.25), rtol=1e-9)


@pytest.mark.parametrize("digits", [16, 9, 7, 5])
def test_rotations_from_printed_coordinates_lead_to_those_of_the_stiffness(digits):
    """They strain the body by their rounding; one factorisation removes it, and would show a soft spring."""
    body = line("mast", [0, 0, 0], [3, 1, 0.5], 110)
    printed = replace(body.nodes, xyz=np.array([[float(f"{x:.{digits - 1}e}") for x in row] for row in body.nodes.xyz]))
    R = rigid_body_shapes(body.dofs, printed)
    with solver_settings(SolverSettings()) as settings:
        proven = only_motions(body.K, R, body.rounding)
    assert len(settings.work) == 1
    assert proven is not None
    Phi = rigid_body_modes(body.K, body.M, R, body.rounding, "mast", proven, prove=False)
    assert Phi.shape[1] == 6
    assert abs(body.K @ Phi).max() < 1e-9 * abs(body.K).max() * abs(Phi).max()


@pytest.mark.parametrize(("places", "digits"), [(3, 10), (4, 10), (5, 10), (5, 12)])
@pytest.mark.parametrize("spring", [0.0, 1e-5])
def test_few_digits_of_the_places_prove_no_support(places, digits, spring):
    """A plane grid of slender bars: rounding of K adds up to sound pivots at soft dofs."""
    rng, nx, ny = np.random.default_rng(0), 10, 9
    xyz = np.array([[i / nx, 0.6 * j / ny, 0] for i in range(nx + 1) for j in range(ny + 1)])
    xyz[:, :2] += 0.02 * rng.uniform(-1, 1, (len(xyz), 2))
    at = np.arange(1, len(xyz) + 1).reshape(nx + 1, ny + 1)
    bars = [
        *zip(at[:-1].ravel(), at[1:].ravel(), strict=True),
        *zip(at[:, :-1].ravel(), at[:, 1:].ravel(), strict=True),
    ]
    section = replace(BAR, A=4e-6, Iy=1.3e-12, Iz=1.3e-12, J=2.3e-12)
    body = frame("grid", xyz.tolist(), [(int(a), int(b)) for a, b in bars], section=section)
    K = sp.csc_array(body.K + sp.csc_array(([spring * body.K[2, 2]], ([2], [2])), shape=body.K.shape))
    K.data = np.array([float(f"{value:.{digits - 1}e}") for value in K.data])
    R = rigid_body_shapes(body.dofs, replace(body.nodes, xyz=body.nodes.xyz.round(places)))
    Phi = rigid_body_modes(sp.csc_array((K + K.T) / 2), body.M, R, 0.5 * 10.0**-digits, "grid")
    assert (Phi.shape[1] == 6) == (spring == 0)


@pytest.mark.parametrize("digits", [12, 9, 8])
@pytest.mark.parametrize("elements", [6, 110], ids=["dense", "sparse"])
def test_rigid_motions_have_the_digits_of_the_stiffness_and_not_those_of_the_coordinates(elements, digits):
    """Rotations that strain the body by the rounding of its coordinates couple with its soft modes."""
    body = line("mast", [0, 0, 0], [3, 1, 0.5], elements)
    R = rigid_body_shapes(body.dofs, replace(body.nodes, xyz=body.nodes.xyz.round(digits - 1)))
    Phi = rigid_body_modes(body.K, body.M, R, body.rounding, "mast")
    own = np.sqrt(body.K.diagonal())[:, None]
    assert Phi.shape[1] == 6
    assert (abs(body.K @ Phi) <= 1e-13 * own * (own * abs(Phi)).max(axis=0)).all()


@pytest.mark.parametrize("digits", [14, 12, 10])
@pytest.mark.parametrize("cells", [(6, 4, 1), (13, 8, 1)], ids=["dense", "sparse"])
def test_rigid_motions_behind_a_tie_are_those_of_the_geometry(cells, digits):
    """The edge of a thin plate: its tied rotation is soft, and has the rounding of all stiff rows of the edge."""
    body = block("plate", [1, 0.6, 0.003], cells, {"root": face(cells, 0)})
    lower = sp.csc_array(sp.tril(body.K))
    lower.data = np.array([float(f"{value:.{digits - 1}e}") for value in lower.data])
    K, rounding = sp.csc_array(lower + sp.tril(lower, -1).T), 0.5 * 10.0 ** (1 - digits)
    tied = tie_nodes(replace(body, K=K, rounding=rounding), "root", Tie("rigid"))
    R = rigid_body_shapes(tied.dofs, tied.nodes)
    Phi = rigid_body_modes(tied.K, tied.M, R, rounding, "plate")
    np.testing.assert_allclose(R @ np.linalg.lstsq(R, Phi)[0], Phi, atol=1e-12)


def test_rigid_motions_of_a_body_with_a_hinge_have_the_digits_of_its_stiffness():
    K, M, R = hinged()
    rough = np.where(abs(R) > 0.1, R + 1e-9 * np.sin(np.arange(R.size)).reshape(R.shape), R)
    Phi = rigid_body_modes(K, M, rough, 2.0**-53, "hinged")
    own = np.sqrt(K.diagonal())[:, None]
    assert Phi.shape[1] == 9
    assert (abs(K @ Phi) <= 1e-13 * own * (own * abs(Phi)).max(axis=0)).all()


def test_soft_mounts_are_proven_to_hold():
    """Springs of a millionth of the diagonal at one face are far softer than any other motion, but not rounding."""
    body = block("bar", [2.7, 0.2, 0.2], [27, 2, 2])
    K = sp.csc_array(body.K + sp.diags_array(np.where(np.arange(body.n) < 27, 1e-6, 0.0) * body.K.diagonal()))
    proven = only_motions(K, rigid_body_shapes(body.dofs, body.nodes), body.rounding)
    assert proven is not None and proven.shape == (body.n, 0)


@pytest.mark.parametrize("elements", [20, 60, 100])
@pytest.mark.parametrize(("digits", "rounding"), [(None, 6e-8), (9, 5e-10), (8, 5e-9)], ids=["single", "9", "8"])
def test_coarse_files_do_not_turn_bending_into_a_mechanism(elements, digits, rounding):
    body = line("slender", [0, 0, 0], [1.3, 0.7, 0.2], elements)
    K = body.K.copy()
    K.data = K.data.astype(np.float32) if digits is None else np.array([float(f"{x:.{digits - 1}e}") for x in K.data])
    K = sp.csc_array((K + K.T) / 2)
    R = rigid_body_shapes(body.dofs, body.nodes)
    assert rigid_body_modes(K, body.M, R, rounding, "slender").shape[1] == 6
    if elements < 60:
        assert stiffness_null_space(K, rounding).shape[1] == 6


def test_an_unheld_scalar_dof_is_a_motion_of_its_own():
    K, M = sp.diags_array([4.0, 0.0, 2.0], format="csc"), sp.diags_array([1.0, 9.0, 1.0], format="csc")
    np.testing.assert_allclose(abs(rigid_body_modes(K, M, None, 2.0**-53, "body")), [[0], [1 / 3], [0]], atol=1e-15)


def test_a_motion_without_mass_is_refused():
    body = line("rod", [0, 0, 0], [1, 0, 0], 3)
    spin = body.dofs.component == 4
    M = body.M.toarray()
    M[np.ix_(spin, spin)] = 0.0
    with pytest.raises(MatrixError, match=r"'rod'.*carries no mass"):
        rigid_body_modes(body.K, sp.csc_array(M), rigid_body_shapes(body.dofs, body.nodes), body.rounding, "rod")


# Squared frequencies (rad/s)^2 of two rows of n unit masses on springs joined by a soft spring: 1e-4 Hz and 1e3 Hz.
SOFT, STIFF = (2 * np.pi * 1e-4) ** 2, (2 * np.pi * 1e3) ** 2


def train(n: int, joined: bool, massless: int = 0):
    """Two rows of n masses joined by a soft spring k_s: lam = k_s (1/n + 1/n) in relative motion.

    ``massless`` further points hang on the last mass by springs, and have no mass.
    """
    k, soft = STIFF / 4, SOFT * n / 2
    springs = [(i, i + 1, k) for i in range(2 * n - 1) if i != n - 1] + [(n - 1, n, soft)] * joined
    springs += [(2 * n - 1, 2 * n + i, k) for i in range(massless)]
    size = 2 * n + massless
    C = np.zeros((len(springs), size))
    for row, (i, j, stiffness) in enumerate(springs):
        C[row, [i, j]] = np.sqrt(stiffness) * np.array([1, -1])
    mass = np.where(np.arange(size) < 2 * n, 1.0, 0.0)
    return sp.csc_array(C).T @ sp.csc_array(C), sp.diags_array(mass, format="csc")


@pytest.mark.parametrize("n", [10, 400], ids=["dense", "sparse"])
@pytest.mark.parametrize("geometry", [True, False], ids=["geometry", "no geometry"])
@pytest.mark.parametrize("massless", [0, 7])
def test_soft_is_not_rigid_and_rigid_is_not_soft(n, geometry, massless):
    K, M = train(n, joined=True, massless=massless)
    R = np.ones((K.shape[0], 1)) if geometry else None
    Phi = rigid_body_modes(sp.csc_array(K), M, R, 2.0**-53, "train")
    assert Phi.shape[1] == 1
    # Without geometry the motion is as accurate as the soft spring, which is added to a stiff one.
    np.testing.assert_allclose(abs(Phi), 1 / np.sqrt(2 * n), rtol=1e-12 if geometry else 5e-3)
    K, M = train(n, joined=False, massless=massless)
    Phi = rigid_body_modes(sp.csc_array(K), M, R, 2.0**-53, "train")
    assert Phi.shape[1] == 2
    # Each row moves as one piece.
    np.testing.assert_allclose(Phi[:n] - Phi[0], 0, atol=1e-9)
    np.testing.assert_allclose(Phi[n:] - Phi[n], 0, atol=1e-9)


def planar_beam(elements: int, hinges: int = 0, held: tuple[int, ...] = (), lumped: bool = False):
    """Beam of unit properties and length in bending; K, M and its two rigid motions, from deflections and slopes.

    At a hinge the slopes on either side are dofs of their own. ``lumped`` leaves the slopes without mass.
    """
    h = 1 / elements
    k = np.array([[12, 6 * h, -12, 6 * h], [6 * h, 4 * h * h, -6 * h, 2 * h * h]]) / h**3
    k = np.vstack([k, -k[0], [6 / h**2, 2 / h, -6 / h**2, 4 / h]])
    m = np.array([[156, 22 * h, 54, -13 * h], [22 * h, 4 * h * h, 13 * h, -3 * h * h]]) * h / 420
    m = np.vstack([m, [54 * h / 420, 13 * h * h / 420, 156 * h / 420, -22 * h * h / 420]])
    m = np.vstack([m, np.array([-13 * h, -3 * h * h, -22 * h, 4 * h * h]) * h / 420])
    if lumped:
        m = np.diag([h / 2, 0, h / 2, 0])
    dofs = 2 * np.arange(elements)[:, None] + np.arange(4)
    cuts = np.linspace(0, elements, hinges + 2).astype(int)[1:-1]
    dofs[cuts, 1] = 2 * (elements + 1) + np.arange(hinges)
    n = 2 * (elements + 1) + hinges
    i, j = np.repeat(dofs, 4, axis=1).ravel(), np.tile(dofs, (1, 4)).ravel()
    K, M = (sp.csc_array((np.tile(part.ravel(), elements), (i, j)), shape=(n, n)) for part in (k, m))
    R = np.zeros((n, 2))
    R[0 : 2 * elements + 2 : 2, 0] = 1.0
    R[0 : 2 * elements + 2 : 2, 1] = np.linspace(0, 1, elements + 1)
    R[1 : 2 * elements + 2 : 2, 1] = R[2 * elements + 2 :, 1] = 1.0
    keep = np.setdiff1d(np.arange(n), held)
    return K[keep][:, keep], M[keep][:, keep], R[keep]


@pytest.mark.parametrize("geometry", [True, False], ids=["geometry", "no geometry"])
@pytest.mark.parametrize(
    ("elements", "hinges", "held", "count"),
    [
        (60, 0, (), 2),
        (60, 0, (0,), 1),
        (60, 0, (0, 1), 0),
        (60, 1, (), 3),
        (60, 16, (0, 1), 16),
        (400, 0, (), 2),
        (400, 0, (0, 1), 0),
        (400, 16, (), 18),
        (400, 40, (0,), 41),
        (2500, 0, (), 2),
        (2500, 1, (), 3),
    ],
)
@pytest.mark.parametrize("lumped", [False, True], ids=["consistent", "lumped"])
def test_a_beam_with_hinges(elements, hinges, held, count, lumped, geometry):
    """Each hinge adds one motion to the two of a free beam."""
    K, M, R = planar_beam(elements, hinges, held, lumped)
    Phi = rigid_body_modes(K, M, R if geometry else None, 2.0**-53, "beam")
    assert Phi.shape == (K.shape[0], count)
    np.testing.assert_allclose(Phi.T @ (M @ Phi), np.eye(count), atol=1e-8)
    if not count:
        return
    # The beam does not bend between hinges.
    d = np.sqrt(K.diagonal())
    assert abs((K @ Phi) / d[:, None]).max() < 1e-9 * abs(d[:, None] * Phi).max()
    # The motions contain translation and rotation of the beam.
    if not held:
        share = Phi.T @ (M @ R)
        np.testing.assert_allclose(share.T @ share, R.T @ M @ R, rtol=1e-7)


@pytest.mark.parametrize("hinges", [0, 1, 3])
def test_bending_of_a_clamped_beam_is_no_mechanism(hinges):
    """Its first mode has an energy of three roundings of the file; rows away from the clamp show that K has none."""
    K, M, R = planar_beam(64, hinges, held=(0, 1))
    Phi = rigid_body_modes(K, M, R, 5e-9, "beam")
    assert Phi.shape[1] == hinges
    assert abs(K @ Phi).max(initial=0.0) < 1e-9 * abs(K).max()


@pytest.mark.parametrize(("elements", "digits"), [(64, 6), (64, 8), (400, 8), (400, 11)])
def test_a_clamp_shows_in_few_printed_digits(elements, digits):
    """A rotation about the clamp strains one element: a share of h^3/4, below the last digit of all others."""
    K, M, R = planar_beam(elements, held=(0, 1))
    K.data = np.array([float(f"{value:.{digits - 1}e}") for value in K.data])
    assert la.eigh(K.toarray(), M.toarray(), eigvals_only=True)[0] == pytest.approx(1.8751**4, rel=0.02)
    assert rigid_body_modes(K, M, R, 0.5 * 10.0 ** (1 - digits), "beam").shape[1] == 0


@pytest.mark.parametrize("size", [8, 120], ids=["dense", "sparse"])
@pytest.mark.parametrize(
    ("pinned", "count"), [((), 6), ((0, 1, 2), 3), ((2, 3, 4), 3), ((0, 1, 2, 3, 4), 1), (tuple(range(6)), 0)]
)
def test_space_frames_without_rotary_inertia(size, pinned, count):
    """Massless rotations that bending stiffness holds are not counted as motions."""
    angle = np.linspace(0, 1.5 * np.pi, size)
    body = frame("bow", np.c_[np.cos(angle), np.sin(angle), 0.1 * angle], [(k, k + 1) for k in range(1, size)])
    lumps = np.where(body.dofs.component <= 3, body.M.diagonal(), 0.0)
    keep = np.setdiff1d(np.arange(body.n), pinned)
    R = rigid_body_shapes(body.dofs, body.nodes)[keep]
    K, M = body.K[keep][:, keep], sp.diags_array(lumps[keep], format="csc")
    for shapes in (R, None):
        Phi = rigid_body_modes(K, M, shapes, body.rounding, "bow")
        assert Phi.shape[1] == count
        np.testing.assert_allclose(Phi.T @ (M @ Phi), np.eye(count), atol=1e-9)


def test_a_weak_spring_shows_in_a_coarse_file():
    """A weak torsional spring holds a rod: rounding in single precision hides it in the forces, not in the energy."""
    body = line("rod", [0, 0, 0], [3, 0, 0], 20)
    K = body.K.toarray()
    K[3, 3] += 1e-2 * K[3, 3]
    coarse = sp.csc_array(K.astype(np.float32).astype(float))
    R = rigid_body_shapes(body.dofs, body.nodes)
    assert abs(coarse @ R[:, 3]).max() < 1e4 * 6e-8 * abs(coarse).sum(axis=0).max()
    assert rigid_body_modes(coarse, body.M, R, 6e-8, "rod").shape[1] == 5
