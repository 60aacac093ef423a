"""Integrals over bodies against closed forms, rigid motion, sums over points, another program; energies of shapes."""

from dataclasses import replace
from fractions import Fraction

import h5py
import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.errors import DofMapError
from cmsreduce.mechanics import Tie, energies, lumped_mass, modal_integrals, tie_nodes
from cmsreduce.mechanics.geometric_stiffness import inertia_loads
from cmsreduce.mechanics.lumped_mass import total_mass
from cmsreduce.model import DofTable, FEModel, Interface, Nodes, Units, cross_matrix, in_units, rigid_body_shapes
from tests.frames import BAR, Section, frame, line, rotation
from tests.solids import RHO, block, face

TURN = rotation([1, -2, 0.5], 0.7)
SIDES = np.array([2.0, 0.6, 0.4])
AWAY = np.array([0.3, -1.0, 0.2])
# The bars' polar inertia comes without the inertia of bending that a section would have with it: next to nothing here.
THREAD = Section(Iy=1e-16, Iz=1e-16)


def lumps(axes=None, offsets=True):
    """Rigid lumps, each with an offset and an inertia at its node: mass matrix, and their properties."""
    rng = np.random.default_rng(4)
    N = 5
    axes = np.tile(np.eye(3), (N, 1, 1)) if axes is None else axes
    xyz, mass = rng.normal(size=(N, 3)), rng.uniform(1, 3, N)
    away = rng.normal(size=(N, 3)) * offsets
    # Second moments of what is spread about each lump's own centre.
    spread = np.array([A @ A.T for A in rng.normal(size=(N, 3, 3)) / 3])
    blocks = []
    for k in range(N):
        S = -cross_matrix(away[k])
        own = np.trace(spread[k]) * np.eye(3) - spread[k]
        G = np.hstack([np.eye(3), S])
        B = mass[k] * G.T @ G
        B[3:, 3:] += own
        T = np.kron(np.eye(2), axes[k])
        blocks.append(T @ B @ T.T)
    node = np.repeat(np.arange(1, N + 1), 6)
    dofs = DofTable(node, np.tile(np.arange(1, 7), N))
    M = sp.csc_array(sp.block_diag(blocks))
    body = FEModel("lumps", 0 * M, M, dofs, Nodes(np.arange(1, N + 1), xyz, axes))
    return body, xyz, mass, away, spread


def rigid_pairs(J, moment, mass):
    """int r_i phi_j and int phi_i phi_j of the six rigid motions about the origin, from rigid properties."""
    second = np.trace(J) / 2 * np.eye(3) - J
    r_phi, phi_phi = np.zeros((3, 3, 6)), np.zeros((3, 3, 6, 6))
    for a in range(3):
        r_phi[:, a, a] = moment
        r_phi[:, :, 3 + a] = second @ cross_matrix(np.eye(3)[a]).T
    grow = [np.column_stack([e, np.zeros((3, 3))]) for e in np.eye(3)]
    grow += [np.column_stack([np.zeros(3), cross_matrix(e)]) for e in np.eye(3)]
    four = np.block([[np.array([[mass]]), moment[None]], [moment[:, None], second]])
    for a in range(6):
        for b in range(6):
            phi_phi[:, :, a, b] = grow[a] @ four @ grow[b].T
    return r_phi, phi_phi


@pytest.mark.parametrize(
    "body",
    [
        block("block", SIDES, (3, 2, 2), axes=TURN, origin=(0.2, 0.1, -1)),
        line(
            "beam", [0.2, 0.1, -1], [1.2, 0.7, 0.3], 3, axes=np.array([rotation([1, 2, 3], 0.4 * k) for k in range(4)])
        ),
        frame("frame", [[0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 1, 2]], [(1, 2), (2, 3), (3, 4)], masses={4: 2.5}),
        lumps(np.array([rotation([1, 2, 3], 0.3 * k) for k in range(5)]))[0],
    ],
    ids=lambda body: body.name,
)
@pytest.mark.parametrize("lumping", ["consistent", "row-sum", "diagonal"])
def test_rigid_motion_is_integrated_exactly(body, lumping):
    R = rigid_body_shapes(body.dofs, body.nodes, AWAY) @ np.kron(np.eye(2), TURN.T)
    found = modal_integrals(body, R, origin=AWAY, axes=TURN, lumping=lumping)
    r_phi, phi_phi = rigid_pairs(found.inertia, found.first_moment, found.mass)
    scale = abs(found.inertia).max()
    np.testing.assert_allclose(found.r_phi, r_phi, atol=1e-13 * scale)
    np.testing.assert_allclose(found.phi_phi, phi_phi, atol=1e-13 * scale)
    np.testing.assert_allclose(found.phi[:, :3], found.mass * np.eye(3), atol=1e-13 * scale)
    np.testing.assert_allclose(found.r_cross_phi[:, 3:], found.inertia, atol=1e-13 * scale)
    np.testing.assert_allclose(
        np.einsum("iiab->ab", found.phi_phi), R.T @ lumped_mass(body, lumping) @ R, atol=1e-13 * scale
    )


def test_rigid_lumps_are_integrated_point_by_point():
    body, xyz, mass, away, spread = lumps(np.array([rotation([1, 2, 3], 0.3 * k) for k in range(5)]))
    shapes = np.random.default_rng(5).normal(size=(body.n, 3))
    found = modal_integrals(body, shapes)
    r_phi, phi_phi = np.zeros((3, 3, 3)), np.zeros((3, 3, 3, 3))
    for k in range(5):
        # Six points of equal mass have the lump's mass, centre and second moment.
        L = np.linalg.cholesky(spread[k] / mass[k] * 3)
        for arm in np.vstack([L.T, -L.T]):
            rho, dm = away[k] + arm, mass[k] / 6
            q = (np.kron(np.eye(2), body.nodes.frame[k].T) @ shapes[6 * k : 6 * k + 6]).reshape(2, 3, 3)
            motion = q[0] + np.cross(q[1], rho, axis=0)
            r_phi += dm * np.einsum("i,jk->ijk", xyz[k] + rho, motion)
            phi_phi += dm * np.einsum("ia,jb->ijab", motion, motion)
    np.testing.assert_allclose(found.r_phi, r_phi, atol=1e-12)
    np.testing.assert_allclose(found.phi_phi, phi_phi, atol=1e-12)


def test_quadratic_motion_of_a_block():
    """phi = (y, 0, z x) is a motion of bricks with three linear factors, so that nothing is lost to the mesh."""
    body = block("block", SIDES, (3, 2, 2))
    a, b, c = SIDES
    x, y, z = body.nodes.xyz.T
    shape = np.column_stack([y, 0 * y, z * x]).reshape(-1, 1)
    found = modal_integrals(body, shape)
    m = RHO * SIDES.prod()
    np.testing.assert_allclose(found.phi[:, 0], m * np.array([b / 2, 0, a * c / 4]), rtol=1e-12)
    expected = m * np.array([[a * b / 4, 0, a**2 * c / 6], [b**2 / 3, 0, a * b * c / 8], [b * c / 4, 0, a * c**2 / 6]])
    np.testing.assert_allclose(found.r_phi[:, :, 0], expected, rtol=1e-12, atol=1e-12)
    expected = m * np.array([[b**2 / 3, 0, a * b * c / 8], [0, 0, 0], [a * b * c / 8, 0, a**2 * c**2 / 9]])
    np.testing.assert_allclose(found.phi_phi[:, :, 0, 0], expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("direction", [[1, 0, 0], [0.3, -1.0, 0.7]], ids=["along x", "askew"])
def test_bending_of_a_clamped_beam(direction):
    """w = 3 s^2 - 2 s^3 and its slope are a motion of cubic beams; integrals by hand, s = x / L."""
    e = np.array(direction) / np.linalg.norm(direction)
    up = np.cross(e, [0.2, 0.4, 1.0])
    up /= np.linalg.norm(up)
    L, n = 2.0, 4
    body = line("beam", [0, 0, 0], L * e, n, section=THREAD)
    s = np.linspace(0, 1, n + 1)
    w, slope = 3 * s**2 - 2 * s**3, (6 * s - 6 * s**2) / L
    shape = np.hstack([w[:, None] * up, slope[:, None] * np.cross(e, up)]).reshape(-1, 1)
    found = modal_integrals(body, shape)
    m = BAR.rho * BAR.A * L
    np.testing.assert_allclose(found.phi[:, 0], m / 2 * up, atol=1e-12)
    np.testing.assert_allclose(found.r_phi[:, :, 0], m * L * 7 / 20 * np.outer(e, up), atol=1e-12)
    np.testing.assert_allclose(found.phi_phi[:, :, 0, 0], m * 13 / 35 * np.outer(up, up), atol=1e-12)


def test_the_first_mode_of_a_cantilever_has_the_integrals_of_the_books():
    """int x w over int w^2 of Blevins' first mode, mass 1 per length: m = 1.8751, mass 1 per length."""
    body = line("beam", [0, 0, 0], [1, 0, 0], 16, section=THREAD)
    rows = np.flatnonzero((body.dofs.node > 1) & np.isin(body.dofs.component, (2, 6)))
    _, Phi = la.eigh(body.K.toarray()[np.ix_(rows, rows)], body.M.toarray()[np.ix_(rows, rows)])
    shape = np.zeros((body.n, 1))
    shape[rows, 0] = Phi[:, 0] * np.sign(Phi[-2, 0])
    found = modal_integrals(body, shape)
    root, m = np.sqrt(BAR.rho * BAR.A), 1.875104068711961
    alpha = (np.cos(m) + np.cosh(m)) / (np.sin(m) + np.sinh(m))
    assert found.phi[1, 0] == pytest.approx(root * 2 * alpha / m, rel=1e-6)
    assert found.r_phi[0, 1, 0] == pytest.approx(root * 2 / m**2, rel=1e-6)
    assert found.phi_phi[1, 1, 0, 0] == pytest.approx(1.0, rel=1e-10)


def test_another_frame_moves_and_turns_them():
    body = block("block", SIDES, (3, 2, 2), axes=TURN)
    shapes = np.random.default_rng(1).normal(size=(body.n, 2))
    here, there = modal_integrals(body, shapes), modal_integrals(body, shapes, origin=AWAY, axes=TURN)
    m, c = here.mass, here.centre_of_mass
    J = here.inertia - m * (c @ c * np.eye(3) - np.outer(c, c))
    d = c - AWAY
    np.testing.assert_allclose(there.first_moment, m * TURN @ d, rtol=1e-12)
    np.testing.assert_allclose(
        there.inertia, TURN @ (J + m * (d @ d * np.eye(3) - np.outer(d, d))) @ TURN.T, rtol=1e-11
    )
    moved = here.r_phi - np.einsum("i,jk->ijk", AWAY, here.phi)
    np.testing.assert_allclose(there.r_phi, np.einsum("ai,bj,ijk->abk", TURN, TURN, moved), rtol=1e-10, atol=1e-10)
    turned = np.einsum("ci,dj,ijab->cdab", TURN, TURN, here.phi_phi)
    np.testing.assert_allclose(there.phi_phi, turned, rtol=1e-10, atol=1e-10)


def test_a_held_direction_has_no_mass():
    """Point masses, one of them held in z: only the others move along z."""
    body = FEModel(
        "points",
        sp.csc_array((5, 5)),
        sp.csc_array(np.diag([2.0, 2, 3, 3, 3])),
        DofTable(np.array([1, 1, 2, 2, 2]), np.array([1, 2, 1, 2, 3])),
        Nodes.in_basic([1, 2], [[0.0, 0, 0], [1, 2, 4]]),
    )
    found = modal_integrals(body, np.ones((5, 1)))
    assert found.mass == total_mass(body) == 5.0
    np.testing.assert_allclose(found.phi[:, 0], [5, 5, 3])
    # z of the centre shows in the motions along x and y, which carry all of the mass.
    assert found.centre_of_mass[2] == pytest.approx(2.4)
    np.testing.assert_allclose(found.r_phi[:, :, 0], 3 * np.outer([1, 2, 4], [1, 1, 1]))


@pytest.mark.parametrize("lumping", ["row-sum", "diagonal"])
def test_lumping_keeps_the_mass_and_does_not_see_frames(lumping):
    bare, turned = (block("block", SIDES, (3, 2, 2), axes=a) for a in (None, TURN))
    m = RHO * SIDES.prod()
    T = sp.block_diag([TURN] * (bare.n // 3))
    A, B = lumped_mass(bare, lumping), lumped_mass(turned, lumping)
    assert A.diagonal().sum() / 3 == pytest.approx(m, rel=1e-13)
    np.testing.assert_allclose((T @ A @ T.T - B).toarray(), 0, atol=1e-12 * m)
    beams = [
        frame("f", [[0, 0, 0], [1, 0, 0], [1, 1, 0]], [(1, 2), (2, 3)], axes=a) for a in (None, np.array([TURN] * 3))
    ]
    T = sp.kron(sp.eye_array(6), TURN)
    A, B = (lumped_mass(body, lumping) for body in beams)
    np.testing.assert_allclose((T @ A @ T.T - B).toarray(), 0, atol=1e-13)


@pytest.mark.shared
def test_quadratic_elements_get_negative_masses_by_row_sums(shared_data):
    body = calculix(shared_data)
    lumped = lumped_mass(body, "row-sum").diagonal()
    assert lumped.min() < 0
    assert lumped.sum() / 3 == pytest.approx(93600, rel=1e-12)


def calculix(folder):
    dof = np.loadtxt(folder / "calculix_body" / "calculix.dof", dtype=str)
    i, j, v = np.loadtxt(folder / "calculix_body" / "calculix.mas").T
    n = len(dof)
    half = sp.coo_array((v, (i.astype(int) - 1, j.astype(int) - 1)), shape=(n, n)).tocsc()
    M = sp.csc_array(half + sp.triu(half, 1).T)
    node, component = np.array([text.split(".") for text in dof], dtype=int).T
    with h5py.File(folder / "calculix_body" / "input_data.h5") as file:
        xyz = file["nodal relative position"][()].reshape(-1, 3)
    return FEModel("brick", 0 * M, M, DofTable(node, component), Nodes.in_basic(node[::3], xyz))


@pytest.mark.shared
def test_integrals_of_another_program(shared_data):
    """MBSim's integrals of a brick of quadratic elements, over the diagonal of its mass scaled to the whole."""
    body = calculix(shared_data)
    with h5py.File(shared_data / "calculix_body" / "input_data.h5") as file:
        theirs = {name: file[name][()] for name in file}
    shapes = theirs["nodal shape matrix of translation"]
    found = modal_integrals(body, shapes, lumping="diagonal")
    assert found.mass == pytest.approx(theirs["mass"], rel=1e-12)
    k = shapes.shape[1]
    pairs = [found.phi_phi[i, j] for i in range(3) for j in range(i, 3)]
    for name, ours in {
        "position integral": found.first_moment,
        "position position integral": found.second_moment,
        "shape function integral": found.phi,
        "position shape function integral": found.r_phi.reshape(9, k),
        "shape function shape function integral": np.concatenate(pairs),
    }.items():
        np.testing.assert_allclose(ours, theirs[name], rtol=1e-12, atol=1e-12 * abs(theirs[name]).max(), err_msg=name)
    # A solid 1 x 1.5 x 8: int x x dm = m / 3, and the lumps miss it by 7.5 %.
    assert modal_integrals(body, shapes).second_moment[0, 0] == pytest.approx(31200, rel=1e-11)
    assert found.second_moment[0, 0] == pytest.approx(33540, rel=1e-11)


@pytest.mark.parametrize("kind", ["rigid", "average"])
@pytest.mark.parametrize("lumping", ["consistent", "row-sum", "diagonal"])
@pytest.mark.parametrize("axes", [None, TURN], ids=["basic", "turned"])
def test_a_tied_body_has_the_integrals_of_the_body(kind, lumping, axes):
    """Any motion that a tie allows, over the bricks before the tie; also in other units."""
    cells = (4, 2, 2)
    body = block("block", SIDES, cells, origin=(1, 2, 3), axes=axes)
    ids = np.array(face(cells, 4))
    end = Interface("end", ids, ((1, 2, 3),) * 9, body.nodes.xyz[ids - 1], np.eye(3))
    tied = tie_nodes(replace(body, interfaces={"end": end}), "end", Tie(kind))
    shapes = np.random.default_rng(2).normal(size=(tied.n, 3))
    motion = tied.recovery.T[tied.recovery.dofs.rows(body.dofs.node, body.dofs.component)] @ shapes
    whole, found = (modal_integrals(b, x, lumping=lumping, origin=AWAY) for b, x in ((body, motion), (tied, shapes)))
    for name in ("mass", "first_moment", "inertia", "phi", "r_cross_phi", "r_phi", "phi_phi"):
        expected = np.asarray(getattr(whole, name))
        np.testing.assert_allclose(getattr(found, name), expected, rtol=0, atol=1e-13 * abs(expected).max())
    small = in_units(tied, Units.parse("mm-t-s"))
    scale = np.where(small.dofs.component <= 3, 1e3, 1.0)[:, None]
    again = modal_integrals(small, scale * shapes, lumping=lumping, origin=1e3 * AWAY)
    for name, factor in (("mass", 1e-3), ("inertia", 1e3), ("phi", 1.0), ("r_phi", 1e3), ("phi_phi", 1e3)):
        expected = factor * np.asarray(getattr(found, name))
        np.testing.assert_allclose(getattr(again, name), expected, rtol=0, atol=1e-12 * abs(expected).max())


def test_a_disk_on_a_cantilever_turns_with_its_tip():
    """The tip of a massless beam moves by 1 and turns; it carries a mass m with an inertia J."""
    L, n, m, J, turn = 2.0, 4, 3.0, 0.7, 0.4
    body = line("beam", [0, 0, 0], [L, 0, 0], n, section=replace(THREAD, rho=1e-9))
    M = body.M.tolil()
    tip = body.dofs.rows_of(n + 1, (1, 2, 3, 4, 5, 6))
    M[tip, tip] = M[tip, tip].toarray() + np.array([m, m, m, 2 * J, J, J])
    body = replace(body, M=sp.csc_array(M))
    shape = np.zeros((body.n, 1))
    shape[tip[[1, 5]], 0] = 1.0, turn
    found = modal_integrals(body, shape)
    assert np.einsum("iiab->ab", found.phi_phi)[0, 0] == pytest.approx(m + J * turn**2, rel=1e-6)
    np.testing.assert_allclose(found.r_cross_phi[:, 0], [0, 0, m * L + J * turn], atol=1e-6)
    np.testing.assert_allclose(np.diag(found.inertia), [2 * J, m * L**2 + J, m * L**2 + J], rtol=1e-6)
    # A disk square with x spreads J along y and z each, and nothing along x: u_x = -y turn.
    np.testing.assert_allclose(found.phi_phi[:, :, 0, 0], np.diag([J * turn**2, m, 0]), atol=1e-6)
    np.testing.assert_allclose(found.r_phi[:, :, 0], [[0, m * L, 0], [-J * turn, 0, 0], [0, 0, 0]], atol=1e-6)


def superelement(whole, boundary, count):
    """Craig-Bampton matrices of a body, scalar points for its fixed-interface modes, and T from them to its rows."""
    rows = np.flatnonzero(np.isin(whole.dofs.node, boundary))
    inner = np.setdiff1d(np.arange(whole.n), rows)
    K, M = whole.K.toarray(), whole.M.toarray()
    T = np.zeros((whole.n, rows.size + count))
    T[rows, np.arange(rows.size)] = 1
    T[inner, : rows.size] = -la.solve(K[np.ix_(inner, inner)], K[np.ix_(inner, rows)])
    T[inner, rows.size :] = la.eigh(K[np.ix_(inner, inner)], M[np.ix_(inner, inner)])[1][:, :count]
    points = DofTable(900 + np.arange(count), np.zeros(count, np.int8))
    at = whole.nodes.index(np.array(boundary))
    nodes = Nodes(np.array(boundary), whole.nodes.xyz[at], whole.nodes.frame[at])
    K, M = (sp.csc_array(T.T @ A @ T) for A in (K, M))
    return FEModel("reduced", K, M, whole.dofs[rows].joined(points), nodes), T


def test_a_superelement_has_the_momenta_of_its_body_and_no_integrals_of_second_order():
    """Its boundary alone has a trace of int phi_i phi_j that is not the modal mass."""
    whole = block("solid", SIDES, [3, 2, 1])
    body, T = superelement(whole, face([3, 2, 1], 0), 9)
    shapes = np.random.default_rng(1).normal(size=(body.n, 4))
    found = modal_integrals(body, shapes, origin=AWAY, axes=TURN)
    right = modal_integrals(whole, T @ shapes, origin=AWAY, axes=TURN)
    for name in ("mass", "first_moment", "inertia", "phi", "r_cross_phi"):
        expected = getattr(right, name)
        np.testing.assert_allclose(getattr(found, name), expected, atol=1e-10 * abs(np.asarray(expected)).max())
    np.testing.assert_allclose(np.einsum("iiab->ab", right.phi_phi), shapes.T @ body.M @ shapes, rtol=1e-9)
    assert found.second_order is None
    with pytest.raises(DofMapError, match="not determined: mass moves with generalised coordinates"):
        _ = found.phi_phi
    with pytest.raises(DofMapError, match="cannot be lumped at its nodes"):
        lumped_mass(body, "row-sum")
    with pytest.raises(DofMapError, match="centrifugal forces are unknown"):
        inertia_loads(body)


def test_without_geometry_there_is_nothing_to_integrate_over():
    with pytest.raises(DofMapError, match="'rod' has no geometry"):
        modal_integrals(replace(line("rod", [0, 0, 0], [1, 0, 0], 1), nodes=None), np.zeros((12, 0)))


@pytest.mark.parametrize("n", [3, 40])
def test_a_soft_shape_of_a_stiff_chain(n: int) -> None:
    """x^T K x of springs of 1e9 that hardly stretch; doubles keep nine digits of it, extended precision twelve."""
    rng = np.random.default_rng(n)
    K = 1e9 * sp.diags_array([np.full(n, 2.0), -np.ones(n - 1), -np.ones(n - 1)], offsets=[0, 1, -1], format="csc")
    X = 1.0 + 1e-4 * rng.standard_normal((n, 20))
    K = sp.csc_array(K - sp.csc_array(([1e9, 1e9], ([0, n - 1], [0, n - 1])), shape=(n, n)))
    exact = []
    for x in X.T:
        terms = [Fraction(float(v)) for v in x]
        exact.append(float(10**9 * sum((a - b) ** 2 for a, b in zip(terms[1:], terms[:-1], strict=True))))
    digits = float(np.finfo(np.longdouble).eps) / float(np.finfo(float).eps)
    np.testing.assert_allclose(energies(K, X), exact, rtol=max(1e-7 * digits, 1e-12))
    np.testing.assert_allclose(energies(K.toarray(), X), energies(K, X), rtol=max(1e-7 * digits, 1e-12))
