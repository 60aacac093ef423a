"""Craig-Bampton and Guyan bases of frames: the checks of theory section 2."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.errors import ConfigError, SingularInterfaceError, UnitsError
from cmsreduce.linalg.eigen import rigid_body_modes
from cmsreduce.model import DofTable, FEModel, Units, in_units, rigid_body_shapes
from cmsreduce.orthogonalise import orthogonalise, orthogonality_errors
from cmsreduce.reduce import CraigBampton, Guyan, reduction
from tests.frames import frame

XYZ = [[0, 0, 0], [1, 0, 0], [1, 1, 0.2], [0, 1, 0], [0.4, 0.5, 0.8], [0.5, 0.5, 1.6]]
BARS = [(1, 2), (2, 3), (3, 4), (4, 1), (1, 5), (2, 5), (3, 5), (5, 6)]
EVERYTHING = 1e9  # Hz
INTERFACES = {
    "one node": {"a": 1},
    "three translations thrice": {"a": ((1, 2, 4), (1, 2, 3))},
    "two nodes": {"a": 1, "b": 3},
    "determinate over three nodes": {"a": (1, (1, 2, 3)), "b": (2, (2, 3)), "c": (4, (3,))},
}
DETERMINATE = {"one node", "determinate over three nodes"}
faces = pytest.mark.parametrize("faces", INTERFACES.values(), ids=INTERFACES)


def tower(interfaces=None, **options) -> FEModel:
    return frame("tower", XYZ, BARS, interfaces, **options)


def i_set(body: FEModel) -> np.ndarray:
    return np.concatenate([body.interface_rows(name) for name in body.interfaces])


def elastic_omega(body: FEModel, rigid: int) -> np.ndarray:
    return np.sqrt(la.eigvalsh(body.K.toarray(), body.M.toarray())[rigid:])


@faces
def test_basis_is_that_of_the_definition(faces):
    body = tower(faces)
    i = i_set(body)
    j = np.setdiff1d(np.arange(body.n), i)
    K, M = body.K.toarray(), body.M.toarray()
    modes = CraigBampton(400.0).reduce(body, i).modes
    static = np.array([kind == "constraint" for kind in modes.kind])
    assert static[: i.size].all() and not static[i.size :].any()
    assert modes.label[: i.size] == tuple(body.dofs.labels[row] for row in i)
    Psi, phi = modes.Phi[:, static], modes.Phi[:, ~static]
    np.testing.assert_allclose(Psi[i], np.eye(i.size), atol=0)
    np.testing.assert_allclose(Psi[j], -la.solve(K[np.ix_(j, j)], K[np.ix_(j, i)]), atol=1e-10)
    lam = la.eigvalsh(K[np.ix_(j, j)], M[np.ix_(j, j)])
    below = lam[lam <= (2 * np.pi * 400) ** 2]
    assert 0 < below.size < lam.size
    np.testing.assert_allclose((2 * np.pi * modes.source_hz[~static]) ** 2, below, rtol=1e-9)
    assert np.isnan(modes.source_hz[static]).all()
    assert abs(phi[i]).max() == 0
    np.testing.assert_allclose(phi.T @ M @ phi, np.eye(below.size), atol=1e-11)
    # Static and normal shapes are K-orthogonal.
    assert abs(Psi.T @ K @ phi).max() < 1e-10 * abs(K).max() * abs(phi).max()


@pytest.mark.parametrize("name", INTERFACES)
def test_interface_stiffness_vanishes_where_the_interface_is_determinate(name):
    body = tower(INTERFACES[name])
    i = i_set(body)
    Kbb = CraigBampton(400.0).reduce(body, i).K[: i.size, : i.size]
    share = abs(Kbb).max() / abs(body.K.toarray()[np.ix_(i, i)]).max()
    assert share < 1e-12 if name in DETERMINATE else share > 1e-6


@faces
@pytest.mark.parametrize("method", ["guyan", "craig-bampton"])
def test_rigid_motion_is_in_the_constraint_modes(faces, method):
    body = tower(faces)
    i = i_set(body)
    R = rigid_body_shapes(body.dofs, body.nodes)
    component = reduction(method, 400.0).reduce(body, i)
    Psi = component.modes.Phi[:, : i.size]
    np.testing.assert_allclose(Psi @ R[i], R, atol=1e-9)
    assert component.rigid.shape[1] == 6
    np.testing.assert_allclose(component.rigid.T @ component.M @ component.rigid, np.eye(6), atol=1e-11)
    assert abs(component.K @ component.rigid).max() < 1e-13 * abs(body.K).max() * abs(component.rigid).max()
    # Rigid motion of the reduced body, recovered, is rigid motion of the body.
    assert np.linalg.matrix_rank(np.hstack([R, component.modes.Phi @ component.rigid]), tol=1e-8) == 6


@faces
def test_all_modes_kept_is_exact(faces):
    body = tower(faces)
    modal = orthogonalise(CraigBampton(EVERYTHING).reduce(body, i_set(body)))
    assert modal.Phi.shape == (body.n, body.n)
    assert (modal.omega[:6] == 0).all()
    np.testing.assert_allclose(modal.omega[6:], elastic_omega(body, 6), rtol=1e-9)
    assert max(orthogonality_errors(modal)) < 1e-9


@faces
def test_guyan_is_craig_bampton_without_normal_modes(faces):
    body = tower(faces)
    i = i_set(body)
    guyan, cb = Guyan(400.0).reduce(body, i), CraigBampton(400.0).reduce(body, i)
    assert guyan.modes.m == i.size
    np.testing.assert_array_equal(guyan.modes.Phi, cb.modes.Phi[:, : i.size])
    # Kbb of either is the Schur complement.
    j = np.setdiff1d(np.arange(body.n), i)
    K = body.K.toarray()
    schur = K[np.ix_(i, i)] - K[np.ix_(i, j)] @ la.solve(K[np.ix_(j, j)], K[np.ix_(j, i)])
    np.testing.assert_allclose(guyan.K, schur, atol=1e-10 * abs(K).max())
    modal = orthogonalise(guyan)
    assert modal.rigid_count == 6
    # Rayleigh: condensing statically never lowers a frequency.
    assert (modal.omega[6:] >= elastic_omega(body, 6)[: modal.elastic_count] * (1 - 1e-9)).all()


def test_static_loads_on_the_interface_are_exact():
    body = tower({"a": 3, "b": 6}, held=(1,))
    i = i_set(body)
    F = np.zeros((body.n, i.size))
    F[i, np.arange(i.size)] = 1.0
    exact = la.solve(body.K.toarray(), F)
    for method in ("guyan", "craig-bampton"):
        component = reduction(method, 300.0).reduce(body, i)
        Phi = component.modes.Phi
        np.testing.assert_allclose(Phi @ la.solve(component.K, Phi.T @ F), exact, atol=1e-10 * abs(exact).max())


def strut(body: FEModel, *ends: int) -> np.ndarray:
    """Pair of unit forces that pushes two nodes apart."""
    a, b = (np.array(XYZ[node - 1], dtype=float) for node in ends)
    line = (b - a) / np.linalg.norm(b - a)
    load = np.zeros((body.n, 1))
    for node, force in zip(ends, (-line, line), strict=True):
        load[body.dofs.rows(node, [1, 2, 3]), 0] = force
    return load


LOADS = {
    "one strut": [(2, 4)],
    "two struts": [(2, 4), (5, 1)],
    "the same strut twice": [(2, 4), (4, 2), (2, 4)],
    "from the interface": [(1, 3)],
    "between two interfaces": [(1, 6), (2, 5)],
}


@pytest.mark.parametrize("cutoff", [0.0, 200.0, EVERYTHING])
@pytest.mark.parametrize("interfaces", [{"a": 1}, {"a": 1, "b": 6}, {}], ids=["one", "two", "none"])
@pytest.mark.parametrize("ends", LOADS.values(), ids=LOADS)
def test_struts_are_exact_statically(ends, interfaces, cutoff):
    body = tower(interfaces)
    i = i_set(body) if interfaces else np.empty(0, dtype=int)
    loads = np.hstack([strut(body, *pair) for pair in ends])
    modal = orthogonalise(CraigBampton(cutoff).reduce(body, i, loads))
    assert modal.rigid_count == 6
    lam, X = la.eigh(body.K.toarray(), body.M.toarray())
    exact = X[:, 6:] @ ((X[:, 6:].T @ loads) / lam[6:, None])
    Phi = modal.Phi[:, 6:]
    found = Phi @ ((Phi.T @ loads) / (modal.omega[6:] ** 2)[:, None])
    # Between loads: the collocated and cross flexibilities; along the body: their shapes.
    flexibility = loads.T @ exact
    np.testing.assert_allclose(loads.T @ found, flexibility, atol=1e-9 * abs(flexibility).max())
    np.testing.assert_allclose(found, exact, atol=2e-6 * abs(exact).max())


def test_no_interface_gives_free_modes():
    body = tower()
    component = CraigBampton(300.0).reduce(body)
    exact = elastic_omega(body, 6) / (2 * np.pi)
    exact = exact[exact <= 300]
    assert component.modes.kind == ("rigid",) * 6 + ("free",) * exact.size
    np.testing.assert_allclose(component.modes.source_hz[6:], exact, rtol=1e-9)
    np.testing.assert_allclose(component.M, np.eye(6 + exact.size), atol=1e-10)


def test_the_interface_may_be_all_there_is():
    body = tower({"all": (1, 2, 3, 4, 5, 6)})
    modal = orthogonalise(CraigBampton(100.0).reduce(body, i_set(body)))
    np.testing.assert_allclose(modal.omega[6:], elastic_omega(body, 6), rtol=1e-9)


@pytest.mark.parametrize(
    ("interfaces", "dofs", "held"),
    [
        ({"a": (1, (1, 2, 3))}, 3, 3),
        ({"a": (1, (1, 2, 3)), "b": (2, (1, 2, 3))}, 6, 5),
        ({"a": (5, (4, 5, 6))}, 3, 3),
        ({"a": (6, (2,))}, 1, 1),
    ],
    ids=["a pin", "two pins in line", "rotations only", "one dof"],
)
def test_an_interface_that_does_not_hold_the_body_is_refused(interfaces, dofs, held):
    body = tower(interfaces)
    message = rf"'tower' has 6 rigid-body motions, but its {dofs} interface dofs hold only {held} of them"
    with pytest.raises(SingularInterfaceError, match=message):
        CraigBampton(100.0).reduce(body, i_set(body))


@pytest.mark.parametrize(("rounding", "named"), [(5e-9, True), (0.0, False)])
def test_few_digits_are_named_where_a_body_moves_too_freely(rounding, named):
    """A thin rod with entries of eight digits has more motions without force than a rigid one."""
    body = tower({"a": 1})
    rigid = np.linalg.qr(np.column_stack([rigid_body_shapes(body.dofs, body.nodes), np.eye(body.n)[:, 30]]))[0]
    with pytest.raises(SingularInterfaceError, match="has 7 rigid-body motions") as caught:
        CraigBampton(100.0).basis(replace(body, rounding=rounding), i_set(body), rigid, np.zeros((body.n, 0)))
    assert ("known to 5e-09 of their size" in str(caught.value)) is named


def test_a_mechanism_behind_the_interface_is_named():
    body = tower({"a": 1})
    K = body.K.tolil()
    spin = int(body.dofs.rows(6, 6)[0])
    K[spin, :] = K[:, spin] = 0.0
    loose = FEModel("tower", sp.csc_array(K), body.M, body.dofs, body.nodes, body.interfaces)
    rigid = rigid_body_modes(body.K, body.M, rigid_body_shapes(body.dofs, body.nodes), body.rounding, "tower")
    with pytest.raises(SingularInterfaceError, match=r"dof 6\.6 still moves freely"):
        CraigBampton(100.0).reduce(loose, i_set(loose), rigid=rigid)


def test_unknown_methods_are_named():
    with pytest.raises(ConfigError, match=r"'macneal' is not available \(there are: craig-bampton, macneal-rubin, "):
        reduction("macneal", 10.0)


@pytest.mark.parametrize("cutoff_hz", [0.0, 0.05])
def test_a_massless_dof_on_a_soft_spring_between_interface_dofs_is_static(cutoff_hz):
    """A free chain of masses, and on its end a massless point that follows its load without delay.

    Both ends of the soft spring are interface dofs, so that the point moves none of the masses inside the chain.
    """
    rng = np.random.default_rng(3)
    n, soft = 12, 1e-7
    k = np.append(rng.uniform(0.5, 2.0, n - 1), soft)
    K = np.diag(np.append(k, 0)) + np.diag(np.append(0, k)) - np.diag(k, 1) - np.diag(k, -1)
    M = np.diag(np.append(rng.uniform(0.5, 2.0, n), 0.0))
    dofs = DofTable(np.arange(1, n + 2), np.zeros(n + 1, dtype=np.int64))
    body = FEModel("chain", sp.csc_array(K), sp.csc_array(M), dofs)
    modes = orthogonalise(CraigBampton(cutoff_hz).reduce(body, [0, n - 1, n]))
    assert (modes.rigid_count, modes.static_count) == (1, 1)
    # The chain alone has the same modes.
    alone = FEModel("chain", sp.csc_array(K[:n, :n] - np.diag([0] * (n - 1) + [soft])), body.M[:n, :n], dofs[:n])
    expected = orthogonalise(CraigBampton(cutoff_hz).reduce(alone, [0, n - 1]))
    np.testing.assert_allclose(modes.omega[modes.elastic], expected.omega[expected.elastic], rtol=1e-12)
    # A unit load stretches the soft spring by 1 / soft.
    static = modes.Phi[:, modes.elastic.stop :]
    np.testing.assert_allclose(static[n] ** 2, [1 / soft], rtol=1e-6)


def test_a_body_in_milliseconds_is_refused():
    """Its frequencies, and the cutoff, would be a thousand times those in Hz."""
    body = in_units(frame("bar", [[0, 0, 0], [1, 0, 0]], [(1, 2)], {"root": 1}), Units.parse("mm-t-ms"))
    with pytest.raises(UnitsError, match=r"'mm-t-ms' of body 'bar' do not count time in seconds.*cms\.in_units"):
        CraigBampton(100.0).reduce(body)
