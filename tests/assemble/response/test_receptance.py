"""How a body's receptance is computed: by a model over shapes, or point by point where that is not sure."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.assemble import (
    PointStack,
    couple,
    physical_substructure,
    receptance,
    receptances,
    rigid_response,
    tabulated,
    wire,
)
from cmsreduce.errors import MatrixError
from cmsreduce.linalg.response import DynamicStiffness, adaptive_flexibility
from cmsreduce.model import Damping, Scene, System, cross_matrix, rigid_body_shapes
from tests.assemble.rigs import at, physical
from tests.frames import Section, line
from tests.solids import block, face

OMEGA = 2 * np.pi * np.geomspace(0.1, 300.0, 80)
FEW = OMEGA[::4]


def mast(damping=Damping(structural=0.002), held=(1,)):  # noqa: B008
    return physical(line("mast", [0, 0, 0], [0, 0, 5], 50, held=held, interfaces={"b": 51}, damping=damping))


def dense_response(sub, L, omega):
    K, M = sub.K.toarray(), sub.M.toarray()
    D, loss = (np.zeros_like(K) if A is None else A.toarray() for A in (sub.D, sub.loss))
    return np.array([L @ np.linalg.solve(K - w**2 * M + 1j * (loss + w * D), L.T) for w in omega])


def counted(monkeypatch):
    """Frequencies at which the whole body is solved."""
    solved = []
    honest = DynamicStiffness.flexibility

    def flexibility(self, load, w, *seen):
        solved.append(w)
        return honest(self, load, w, *seen)

    monkeypatch.setattr(DynamicStiffness, "flexibility", flexibility)
    return solved


def same(found, expected, tolerance=1e-6):
    """Errors against the driving-point receptances of both ends."""
    size = np.sqrt(abs(np.einsum("faa->fa", expected)))
    with np.errstate(invalid="ignore"):
        share = abs(found - expected) / (size[:, :, None] * size[:, None, :])
    return bool(np.nanmax(share) < tolerance)


def test_no_point_of_a_body_with_proportional_damping_is_solved(monkeypatch):
    solved = counted(monkeypatch)
    for damping in (Damping(), Damping(structural=0.002), Damping(rayleigh=(0.5, 1e-5))):
        sub = mast(damping)
        L = sub.motion["51"].toarray()
        assert same(receptances(sub, FEW, sub.motion["51"]), dense_response(sub, L, FEW))
    assert not solved


def test_a_held_body_without_a_mode_below_the_cutoff_stands_still():
    """A damper that a parameter adds to it is a matrix of no rows."""
    sub = replace(mast().narrowed(np.zeros(0, dtype=np.int64)), D=sp.csc_array((0, 0)))
    assert receptances(sub, OMEGA, np.zeros((6, 0))).shape == (OMEGA.size, 6, 6)
    assert not receptances(sub, OMEGA, np.zeros((6, 0))).any()


def test_a_dashpot_couples_the_modes_and_two_points_are_solved(monkeypatch):
    solved = counted(monkeypatch)
    sub = mast()
    u = sp.csc_array(([1.0], ([150], [0])), shape=(sub.m, 1))
    sub = replace(sub, D=sp.csc_array(40.0 * u @ u.T))
    found = receptances(sub, OMEGA, sub.motion["51"])
    assert len(solved) == 2
    assert same(found, dense_response(sub, sub.motion["51"].toarray(), OMEGA))


@pytest.mark.parametrize("damping", ["structural", "dashpot"])
def test_a_body_of_many_sensors_has_shapes_for_the_forces_alone(damping, monkeypatch):
    """Its responses are as accurate at motions that are only seen; those of efforts along these have a digit."""
    asked = []

    def prepared(Z, load, *others, **named):
        asked.append(load.shape[1])
        return adaptive_flexibility(Z, load, *others, **named)

    monkeypatch.setitem(receptance.__globals__, "adaptive_flexibility", prepared)
    sub = mast()
    if damping == "dashpot":
        u = sp.csc_array(([1.0], ([150], [0])), shape=(sub.m, 1))
        sub = replace(mast(Damping(structural=0.002)), D=sp.csc_array(40.0 * u @ u.T))
    L = sp.eye_array(sub.m, format="csr")[::2].toarray()
    loaded = np.zeros(len(L), dtype=bool)
    loaded[-2:] = True
    of = receptance(sub, FEW, L, loaded)
    left, right = np.eye(len(L)), np.eye(len(L))[loaded]
    assert asked == [2]
    assert of.has_fewer([(left, right)])
    G = np.zeros((len(L), 2, FEW.size), dtype=complex)
    of.add(G, left, right, FEW)
    expected = dense_response(sub, L, FEW)
    size = np.sqrt(abs(np.einsum("faa->af", expected)))
    assert (abs(G - expected[:, :, loaded].transpose(1, 2, 0)) < 1e-6 * size[:, None] * size[loaded]).all()
    own, some = np.zeros((9, 9, FEW.size), dtype=complex), left[5:50:5]
    of.add(own, some, some, FEW)
    ratio = abs(np.einsum("aaf->af", own)) / size[5:50:5] ** 2
    assert asked == [2]
    assert ratio.min() > 0.5
    assert ratio.max() < 2
    # At motions with forces, such as those of joints, the response to efforts along the others has all digits.
    across = np.zeros((2, 9, FEW.size), dtype=complex)
    of.add(across, right, some, FEW)
    assert asked == [2]
    wanted = expected[:, loaded, 5:50:5].transpose(1, 2, 0)
    assert (abs(across - wanted) < 1e-6 * size[loaded][:, None] * size[5:50:5]).all()
    # Forces along motions that were not announced, seen elsewhere, measure nothing: they are exact.
    exact = np.zeros((len(L) - 1, 1, FEW.size), dtype=complex)
    of.add(exact, left[1:], left[[0]], FEW)
    assert (abs(exact[:, 0] - expected[:, 1:, 0].T) < 1e-6 * size[1:] * size[0]).all()


def test_a_free_solid_has_no_rotations_and_its_rigid_part_is_exact(monkeypatch):
    solved = counted(monkeypatch)
    cells = (10, 2, 2)
    body = replace(block("bar", [1.0, 0.1, 0.1], cells, {"end": face(cells, 10)[:1]}), damping=Damping(structural=0.01))
    sub = physical(body)
    motions = next(iter(sub.motion.values()))
    L = motions.toarray()
    Y = receptances(sub, np.geomspace(1e-3, 1e4, 60), motions)
    assert not solved
    assert not Y[:, 3:].any() and not Y[:, :, 3:].any()
    rigid = -L @ sub.rigid @ (L @ sub.rigid).T / 1e-6
    np.testing.assert_allclose(Y[0], rigid, rtol=1e-10, atol=1e-10 * abs(rigid).max())
    w = np.array([300.0, 2e3, 9e3])
    assert same(receptance(sub, np.geomspace(1e-3, 1e4, 60), motions)(w), dense_response(sub, L, w))


@pytest.mark.parametrize("reason", ["few points", "above the band", "stiffness that pushes"])
def test_where_no_model_is_sure_every_point_is_solved(monkeypatch, reason):
    solved = counted(monkeypatch)
    sub = mast()
    prepared, asked = OMEGA, np.array([10.0, 1234.0])
    if reason == "few points":
        prepared = OMEGA[:7]
    elif reason == "above the band":
        asked = np.array([3.0, 5.0]) * OMEGA[-1]
    else:
        sub = replace(sub, K=sp.csc_array(sub.K - 1e4 * sp.diags_array(np.eye(sub.m)[-6])))
    Y = receptance(sub, prepared, sub.motion["51"])(asked)
    assert solved == list(asked)
    assert same(Y, dense_response(sub, sub.motion["51"].toarray(), asked), 1e-9)


def test_an_undamped_body_of_many_dofs_at_its_resonance_is_named():
    """Second bending of a cantilever: (4.694091 / L)^2 sqrt(EI / rho A), and the same number from the model."""
    sub = mast(Damping())
    E, inertia, rho, area = 70e9, 1e-8, 2700.0, 4e-4
    K, M = sub.K.toarray(), sub.M.toarray()
    w = np.sqrt(np.sort(np.linalg.eigvals(np.linalg.solve(M, K)).real))
    exact = (4.694091 / 5) ** 2 * np.sqrt(E * inertia / (rho * area))
    second = w[abs(w - exact).argmin()]
    assert abs(second / exact - 1) < 1e-4
    of_body = receptance(sub, OMEGA, sub.motion["51"])
    # The resonance to the last digit, from the ratio of energies at its shape.
    shape = np.linalg.solve(K - (1 + 1e-7) * second**2 * M, M @ np.ones(sub.m))
    second = np.sqrt((shape @ K @ shape) / (shape @ M @ shape))
    with pytest.raises(MatrixError, match=r"'mast' has no damping and resonates at .* Hz, where its response is inf"):
        of_body(np.array([1.0, second]))


def test_points_are_coupled_in_blocks_that_fit_in_memory():
    """Receptances of 3000 points over 75 motions would take 270 MB; those of a block, no more than 16 MiB."""
    names = [f"p{k}" for k in range(25)]
    cells = (24, 1, 1)
    sub = physical(block("bar", [1.0, 0.1, 0.1], cells, {name: [4 * k + 1] for k, name in enumerate(names)}))
    stack = PointStack({"bar": sub})
    scene = Scene(("bar",), (0.0, 1.0), actuators=(at("bar.p0", "x"),), sensors=(at("bar.p24", "x"),))
    wiring = wire(stack, scene, scene.configurations[0])
    largest = 0

    def flexibility(omega):
        nonlocal largest
        Y = np.zeros((omega.size, 75, 75), dtype=complex)
        Y[:, 0, 72] = Y[:, 72, 0] = 1 / omega
        largest = max(largest, Y.nbytes)
        return Y

    omega = np.linspace(1.0, 2.0, 3000)
    H = couple({"bar": flexibility}, stack, [wiring], [omega])[0]
    np.testing.assert_allclose(H[:, 0, 0], 1 / omega, rtol=1e-15)
    assert 2**20 < largest <= 2**24


def test_a_table_answers_as_its_source():
    sub = mast()
    of_body = receptance(sub, OMEGA, sub.motion["51"])
    table = tabulated(of_body, OMEGA, 6)
    np.testing.assert_array_equal(table(OMEGA[20:30]), of_body(OMEGA)[20:30])
    assert tabulated(of_body, OMEGA, 10**5) is of_body


@pytest.mark.parametrize("bars", [4, 40])
def test_a_body_with_a_wheel_keeps_its_digits_at_low_frequencies(bars: int) -> None:
    """It moves as one piece, R (i w R^T G R - w^2)^-1 R^T: K cancels on rigid motion to 1e-16 of 1e15 alone."""
    body = line("boom", [0, 0, 0], [1.5, 0.4, 0.2], bars, section=Section(E=7e15, G=3e15))
    assert body.nodes is not None
    R = rigid_body_shapes(body.dofs, body.nodes)
    R = np.linalg.solve(np.linalg.cholesky(R.T @ (body.M @ R)), R.T).T
    wheel = sp.lil_array((body.n, body.n))
    wheel[9:12, 9:12] = -cross_matrix(np.array([0.3, -0.1, 0.2]))
    D = sp.csc_array(wheel)
    sub = replace(physical_substructure(body, ["1", str(bars + 1)], R), D=D)
    omega = 2 * np.pi * np.array([1e-3, 0.01, 0.1])
    L = np.vstack([sub.motion["1"].toarray(), sub.motion[str(bars + 1)].toarray()])
    found = receptance(sub, omega, L)(omega)
    for w, Y in zip(omega, found, strict=True):
        expected = (L @ R) @ np.linalg.solve(1j * w * (R.T @ (D @ R)) - w**2 * np.eye(6), (L @ R).T)
        assert abs(Y - expected).max() < 1e-8 * abs(expected).max()


@pytest.mark.parametrize("bars", [4, 40])
@pytest.mark.parametrize("alpha", [0.0, 0.5])
def test_a_small_wheel_on_a_stiff_damped_body_acts_on_its_rigid_motion(bars: int, alpha: float) -> None:
    """Steel with beta K of up to 1e7 N*s/m beside 0.02 N*m*s: the wheel is no rounding of the damping."""
    steel = Section(E=2.1e11, G=8e10, A=1e-2, Iy=1e-5, Iz=2e-5, J=3e-5, rho=7850.0)
    damping = Damping(rayleigh=(alpha, 1e-2 if bars == 4 else 1e-4))
    body = line("boom", [0, 0, 0], [1.5, 0.4, 0.2], bars, section=steel, damping=damping)
    assert body.nodes is not None
    R = rigid_body_shapes(body.dofs, body.nodes)
    R = np.linalg.solve(np.linalg.cholesky(R.T @ (body.M @ R)), R.T).T
    wheel = sp.lil_array((body.n, body.n))
    wheel[9:12, 9:12] = -cross_matrix(np.array([0.012, -0.004, 0.016]))
    G = sp.csc_array(wheel)
    sub = physical_substructure(body, ["1", str(bars + 1)], R)
    sub = replace(sub, D=sp.csc_array(sub.D + G))
    omega = 2 * np.pi * np.array([1e-5, 1e-4, 1e-3])
    L = np.vstack([sub.motion["1"].toarray(), sub.motion[str(bars + 1)].toarray()])
    found = receptance(sub, omega, L)(omega)
    one, channels = Scene(("boom",), (0.0, 1.0)).configurations[0], tuple(map(str, range(len(L))))
    T = np.eye(sub.m)
    system = System(one, T, sub.M, sub.K, sub.D, None, L.T, L, 0 * L, R, {"boom": sub.m}, channels, channels)
    rigid = rigid_response(system, omega)
    for w, Y, of_rigid in zip(omega, found, rigid, strict=True):
        expected = (L @ R) @ np.linalg.solve(1j * w * (R.T @ (G @ R)) - w**2 * np.eye(6), (L @ R).T)
        assert abs(Y - expected).max() < 1e-7 * abs(expected).max()
        assert abs(of_rigid - expected).max() < 1e-8 * abs(expected).max()


def test_a_rigid_part_without_nutation_is_finite_at_the_nutation():
    """Transverse inertia 1 and momentum 1: a torque turns the body by (s + r*) / (s (s + 1)^2), r = +-i, at s = i."""
    one, axes = Scene(("top",), (0.0, 1.0)).configurations[0], ("rx", "ry")
    unit, G = np.eye(2), np.array([[0.0, 1.0], [-1.0, 0.0]])
    top = System(one, unit, unit, 0 * unit, G, None, unit, unit, 0 * unit, unit, {"top": 2}, axes, axes)
    (found,) = rigid_response(top, np.array([1.0]), nutation=False)
    np.testing.assert_allclose(found, (1j * unit - G) / (1j * (1j + 1) ** 2), rtol=1e-12, atol=1e-12)
