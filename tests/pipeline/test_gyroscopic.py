"""Gyroscopic forces of wheels and rotors, against systems assembled densely here and against closed forms."""

from __future__ import annotations

import re
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from pyyeti.nastran import op4
from scipy.io import loadmat

from cmsreduce.errors import CmsReduceError
from cmsreduce.model import SI, FEModel, cross_matrix, rigid_body_shapes, unresisted
from cmsreduce.pipeline import Run, execute
from cmsreduce.pipeline.bodies import reduced_body
from cmsreduce.pipeline.results import floating_bodies, multibody_scene
from cmsreduce.pipeline.system import system_roots
from cmsreduce.read import in_dofs
from cmsreduce.simulate import scene_system
from cmsreduce.write import convert, export_scene
from tests.frames import Section, line
from tests.pipeline.study import PIPELINE, arm, panel, write_body, write_study
from tests.pipeline.test_parameters import Dense, open_run

# Kilogram metre squared per second: of the hub's and the panel's wheel, and per metre of the arm.
HUB, PANEL, SHAFT = np.array([0.8, 0.0, 0.0]), 0.3 * np.array([0.0, 0.6, 0.8]), 0.2
WHEELS = {
    "    rigid: {{": "    wheels: {{roll: {{axis: x, momentum: 0.8 N*m*s}}}}\n    rigid: {{",
    "    geometry: arm.bdf\n": "    geometry: arm.bdf\n    gyroscopic: {{file: turning.op4, matrix: GA}}\n",
    "    geometry: panel.bdf\n": "    geometry: panel.bdf\n"
    "    wheels: {{yaw: {{at: 4, axis: [0, 0.6, 0.8], momentum: 300 N*mm*s}}}}\n",
}


def shaft(body: FEModel, length: float, momentum: float) -> np.ndarray:
    """Gyroscopic matrix of a shaft along x: its slopes v' and w' turn a momentum along it, int h (dv' w' - dw' v')."""
    n = body.n // 6 - 1
    h = length / n
    g = np.array([[36, 3 * h, -36, 3 * h], [3 * h, 4 * h * h, -3 * h, -h * h]])
    g = momentum * np.vstack([g, -g[0], [3 * h, -h * h, -3 * h, 4 * h * h]]) / (30 * h)
    G = np.zeros((body.n, body.n))
    for e in range(n):
        v, w = (6 * e + np.array(dofs) for dofs in ([1, 5, 7, 11], [2, 4, 8, 10]))
        # A slope of w is a rotation about minus y.
        G[np.ix_(v, w)] += g * [1, -1, 1, -1]
        G[np.ix_(w, v)] -= (g * [1, -1, 1, -1]).T
    return G


def wheel(n: int, row: int, momentum: np.ndarray) -> np.ndarray:
    """Moment w x h on three rotations from a row on."""
    G = np.zeros((n, n))
    G[row : row + 3, row : row + 3] = -cross_matrix(momentum)
    return G


def coriolis(body: FEModel) -> np.ndarray:
    """2 w x v of the mass of each node, for a frame that turns about x at 1 rad/s."""
    each = la.block_diag(np.zeros((1, 1)), [[0.0, -2.0], [2.0, 0.0]], np.zeros((3, 3)))
    return la.block_diag(*[each * body.M[row, row] for row in range(1, body.n, 6)])


@pytest.fixture
def dense() -> Dense:
    found = Dense(np.zeros((30, 30)), np.zeros((36, 36)), np.zeros((30, 30)))
    found.gyroscopic = (wheel(6, 3, HUB), shaft(arm(), 0.8, SHAFT), wheel(36, 6 * 3 + 3, PANEL))
    return found


def study(folder: Path, text: str = PIPELINE) -> Path:
    for body in (arm(), panel()):
        write_body(folder, body)
    matrices = {"GA": shaft(arm(), 0.8, SHAFT), "GB": arm().K.toarray(), "GC": coriolis(arm())}
    op4.write(str(folder / "turning.op4"), matrices)
    for before, after in WHEELS.items():
        text = text.replace(before, after, 1)
    path = folder / "study.yaml"
    path.write_text(text.format(output=folder / "out"))
    return path


def dense_roots(K: np.ndarray, M: np.ndarray, D: np.ndarray) -> np.ndarray:
    """The five smallest roots that oscillate, by size."""
    n = len(K)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-la.solve(M, K), -la.solve(M, D)]])
    s = la.eigvals(A)
    s = s[s.imag > 1e-2]
    return np.array([refined(root, K, M, D) for root in s[np.argsort(abs(s))][:5]])


def refined(s: complex, K: np.ndarray, M: np.ndarray, D: np.ndarray) -> complex:
    """A root by Newton's steps on the quadratic form of its two shapes: the companion matrix rounds by its largest."""
    for _ in range(3):
        left, _, right = la.svd(K + s * D + s**2 * M)
        y, x = left[:, -1].conj(), right[-1].conj()
        s -= (y @ (K + s * D + s**2 * M) @ x) / (y @ (D + 2 * s * M) @ x)
    return s


def dense_peaks(K: np.ndarray, M: np.ndarray, D: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Size of each such root's part in the response, with that of its conjugate, at its natural frequency."""
    n = len(K)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-la.solve(M, K), -la.solve(M, D)]])
    s, left, right = la.eig(A, left=True)
    own = s.imag > 1e-2
    s, left, right = s[own], left[:, own], right[:, own]
    residue = (c @ right[:n]) * (left[n:].conj().T @ la.solve(M, b)) / np.sum(left.conj() * right, axis=0)
    peaks = abs(residue / (1j * abs(s) - s) + residue.conj() / (1j * abs(s) - s.conj()))
    return np.asarray(peaks[np.argsort(abs(s))])


def test_wheels_and_rotors_against_dense_algebra(tmp_path: Path, dense: Dense) -> None:
    """Of a rigid hub, of a shaft by its matrix, of a node: nutation, whirl and responses at two angles."""
    path = study(tmp_path)
    run = open_run(path, ["reduce.cutoff=30"])
    values = {"tension": 0.0, "ballast": 0.0, "drag": 0.0, "latch": 0.0}
    omega = 2 * np.pi * np.array([3.0, 17.0, 41.0])
    for each in run.scene.configurations:
        K, M, D, b, c = dense.matrices(each.angles["hinge", 4], values)
        expected = dense_roots(K, M, D)
        for model, rtol in ((run.comparison.reference.assembled, 1e-7), (run.model.assembled, 1e-3)):
            found = model.damped_modes(each)
            assert found is not None
            np.testing.assert_allclose(found.s[:5], expected, rtol=rtol, atol=1e-6)
            # Hardly anything damps these, and their peaks are rounding.
            peaks = dense_peaks(K, M, D, b, c)[2:5]
            np.testing.assert_allclose(found.peaks[2:5, -1, 0], peaks, rtol=1e-4 if rtol < 1e-6 else 2e-2)
        wanted = np.array([c @ np.linalg.solve(K + 1j * w * D - w**2 * M, b.astype(complex)) for w in omega])
        still = np.array([c @ np.linalg.solve(K + 0.5j * w * (D + D.T) - w**2 * M, b.astype(complex)) for w in omega])
        assert (abs(still - wanted) > 0.02 * abs(wanted)).any()
        np.testing.assert_allclose(
            run.comparison.reference.assembled.response(each, omega)[:, -1, 0], wanted, rtol=1e-6
        )
        np.testing.assert_allclose(run.model.assembled.response(each, omega)[:, -1, 0], wanted, rtol=2e-3)
    (note,) = [note for note in run.verification_notes(run.verified) if "gyroscopic" in note]
    found = re.search(r"those of the reference to ([\d.]+) %", note)
    assert found is not None and 0 < float(found[1]) < 0.1


def test_a_point_of_the_grid_at_the_nutation_of_rigid_bodies_hides_no_error(tmp_path: Path) -> None:
    """Flexible bodies nutate below it: less the rigid part, the response is infinite, and its errors would vanish."""
    keys = [
        "reduce.cutoff=1.5",
        "scene.joints.hinge.free=[]",
        "scene.articulation=null",
        "scene.actuators={pitch: {at: hub.cg, torque: [0, 1, 1]}}",
        "scene.sensors={gyro: {at: hub.cg, measure: [ry, rz]}}",
    ]
    path, points = write_study(tmp_path), 60

    def opened(momentum: float, points: int) -> Run:
        wheel = f"components.hub.wheels={{roll: {{axis: x, momentum: {momentum!r} N*m*s}}}}"
        return open_run(path, [*keys, wheel, f"verify.frf.points={points}"])

    system = (run := opened(30.0, points)).model.assembled.system(run.scene.configurations[0])
    nutation = abs(la.eigvals(system.rigid.T @ system.D @ system.rigid)).max() / (2 * np.pi)
    grid = np.geomspace(0.06, 60, points)
    at = grid[abs(grid - nutation).argmin()]
    on, beside = (opened(30.0 * at / nutation, each).verified.configurations[0] for each in (points, points + 1))
    assert abs(on.response.frequency_hz / at - 1).min() < 1e-9 < abs(beside.response.frequency_hz / at - 1).min()
    found, expected = (each.errors["reduced"] for each in (on, beside))
    assert found.frf_error == pytest.approx(expected.frf_error, rel=1e-3) and found.frf_error > 0.1
    np.testing.assert_allclose(found.channel_errors, expected.channel_errors, rtol=1e-3)


def test_whirl_of_a_rotor_on_springs(tmp_path: Path) -> None:
    """Closed form w = +-h / 2J + sqrt((h / 2J)^2 + k / J), h the momentum; forward and backward whirl split."""
    J, k, h = 0.02, 50.0, 3.0
    path = tmp_path / "rotor.yaml"
    path.write_text(ROTOR.format(output=tmp_path / "out", J=J, k=k, h=h))
    body = line("mast", [0, 0, 0], [0, 0, 0.5], 2, interfaces={"root": 1, "top": 3}, section=Section(E=7e15, G=3e15))
    write_body(tmp_path, body)
    run = open_run(path)
    assert execute(run, path, report=False) is not None
    spin, split = h / (2 * J), np.sqrt((h / (2 * J)) ** 2 + k / J)
    still, turning = (run.model.assembled.damped_modes(each) for each in run.scene.configurations)
    assert still is None and turning is not None
    # The mast is 1e7 times stiffer than the springs.
    np.testing.assert_allclose(turning.s, [1j * (split - spin), 1j * (split + spin)], rtol=1e-4)
    rotor = turning.shapes["rotor"]
    # Backward whirl turns against the spin, forward whirl with it.
    np.testing.assert_allclose(rotor[4] / rotor[3], [1j, -1j], atol=1e-4)
    roots = system_roots(run.model.assembled, run.scene.configurations[1])
    assert roots is not None and not roots.growing.size


def test_files_and_time(tmp_path: Path) -> None:
    """Component files hold the matrix, free motion in time keeps its energy and nutates; other programs refuse it."""
    path = study(tmp_path)
    run = open_run(path, ["scene.articulation=null", "reduce.cutoff=6", "verify=null"])
    execute(run, path, report=False)
    for name in ("arm", "panel"):
        with h5py.File(run.folder / f"{name}.h5") as file:
            G = file["modes/gyroscopic"][()]
        (term,) = run.final[name].terms
        np.testing.assert_allclose(G, term.dense, atol=1e-12 * abs(G).max())
    # As input, in other coordinates: the same rates of turning.
    modal = reduced_body("arm", run.folder / "arm.h5", SI)
    again = in_dofs(modal, {})
    (term,), M = again.terms, again.M.toarray()
    rates = la.eigvals(la.solve(M, term.dense)).imag
    with h5py.File(run.folder / "arm.h5") as file:
        expected = la.eigvals(la.solve(file["modes/mass"][()], file["modes/gyroscopic"][()])).imag
    np.testing.assert_allclose(np.sort(rates), np.sort(expected), atol=1e-8 * expected.max())
    scene = multibody_scene(run.folder)
    system = scene_system(scene, floating_bodies(scene))
    y = system.projected(system.start({}, None, {}))
    spinning = y.copy()
    spinning[system.first_speed :][: system.n] = np.random.default_rng(2).standard_normal(system.n)
    spinning = system.projected(spinning)
    u = system.u(spinning)
    pairs = zip(system.bodies, system.speeds, strict=True)
    assert min(float(np.linalg.norm(body.gyroscopic @ u[own])) for body, own in pairs) > 0.01
    # The momentum of each wheel, along its axis that turns with the slope of the node.
    own = dict(zip((body.name for body in system.bodies), system.bodies, strict=True))
    modes = run.final["panel"]
    turns = (modes.body.dofs.node == 4) & (modes.body.dofs.component > 3)
    slope = np.asarray(modes.Phi)[turns, modes.rigid_count :]
    q = 1e-3 * np.random.default_rng(3).standard_normal(own["panel"].k)
    np.testing.assert_allclose(own["panel"].wheels(q), PANEL + np.cross(slope @ q, PANEL), rtol=0, atol=1e-10)
    np.testing.assert_allclose(own["hub"].wheels(np.zeros(0)), HUB, rtol=0, atol=1e-15)
    np.testing.assert_allclose(own["arm"].wheels(np.zeros(own["arm"].k)), [0.8 * SHAFT, 0, 0], rtol=0, atol=1e-10)
    # Energy changes by the work of the damping alone, in fast motion too.
    rate, h = system.rate(0.0, spinning), 1e-7
    after, before = (sum(system.energies(spinning + step * rate)) for step in (h, -h))
    power = np.linalg.norm(u) * max(float(np.linalg.norm(body.gyroscopic)) for body in system.bodies)
    assert abs((after - before) / (2 * h) - rate[-1]) < 1e-5 * (power + abs(rate[-1]))
    # Small motions in time are those of the assembled system: the same roots, nutation included.
    J = np.zeros((y.size, y.size))
    for k in range(y.size):
        step = np.zeros(y.size)
        step[k] = 1e-6
        J[:, k] = (system.rate(0.0, y + step) - system.rate(0.0, y - step)) / 2e-6
    s = la.eigvals(J)
    found = run.model.assembled.damped_modes(run.scene.configurations[0])
    assert found is not None
    for root in found.s[:4]:
        assert abs(s - root).min() < 1e-5 * abs(root) + 1e-5
    with pytest.raises(CmsReduceError, match=r"a scene for exudyn has no place for the (gyroscopic|momentum)"):
        export_scene(scene, "exudyn", tmp_path / "scene")
    with pytest.raises(CmsReduceError, match="the format sid has no place for the gyroscopic matrix"):
        convert(run.folder / "arm.h5", tmp_path / "arm.SID_FEM")
    (states,) = convert(run.folder / "arm.h5", tmp_path / "arm.mat")
    A = loadmat(states)["A"]
    m = len(A) // 2
    with h5py.File(run.folder / "arm.h5") as file:
        damped = file["modes/damping"][()] + file["modes/gyroscopic"][()]
    np.testing.assert_allclose(-A[m:, m:], damped, atol=1e-9 * abs(damped).max())


def test_a_parameter_of_several_wheels_of_a_body_is_one_matrix_of_its_file(tmp_path: Path) -> None:
    """Phi^T G Phi of a wheel along y at node 4, of one along x at node 2, and of a matrix, for 1 N*m*s."""
    op4.write(str(tmp_path / "drum.op4"), {"G": wheel(36, 9, np.array([0.0, 0.0, 2.0]))})
    text = PIPELINE.replace("scene:\n", "scene:\n  parameters: {{spin: " + SPUN + "}}\n", 1)
    path = study(tmp_path, text)
    own = path.read_text().replace("{yaw: {at: 4, axis: [0, 0.6, 0.8]", "{roll: {at: 2, axis: x}, yaw: {at: 4, axis: y")
    path.write_text(own)
    run = open_run(path, ["scene.articulation=null", "reduce.cutoff=6", "verify=null"])
    execute(run, path, report=False)
    nodes = {4: [0.0, 1.0, 0.0], 2: [1.0, 0.0, 0.0]}
    G = sum(wheel(36, 6 * (node - 1) + 3, np.array(axis)) for node, axis in nodes.items())
    G += wheel(36, 9, np.array([0.0, 0.0, 2.0]))
    with h5py.File(run.folder / "panel.h5") as file:
        found, power = file["parameters/spin/gyroscopic"][()], file["parameters/spin"].attrs["gyroscopic_power"]
    Phi = np.asarray(run.final["panel"].Phi)
    np.testing.assert_allclose(found, Phi.T @ G @ Phi, atol=1e-12 * abs(found).max())
    assert power == 1
    path.write_text(own.replace("matrix: G}", "matrix: G, power: 2}"))
    with pytest.raises(CmsReduceError, match="give the wheel a parameter of its own"):
        _ = open_run(path).bodies["panel"]


SPUN = "{{values: [0, 2], wheels: [panel.yaw, panel.roll], gyroscopic: {{panel: {{file: drum.op4, matrix: G}}}}}}"
REFUSED = {
    "a damping": ("turning.op4, matrix: GA", "turning.op4, matrix: GB", "is not skew"),
    "Coriolis": ("turning.op4, matrix: GA", "turning.op4, matrix: GC", "Coriolis matrix of a rotating frame"),
    "a wheel nowhere": ("at: 4", "at: 40", "wheel 'yaw': the body has no node 40"),
    "no momentum": ("0.8 N*m*s", "0.8 N*m", "is no angular momentum"),
    "no place": ("{{at: 4, axis", "{{axis", "a wheel in a flexible body needs its node or interface"),
}


@pytest.mark.parametrize(("before", "after", "message"), REFUSED.values(), ids=REFUSED)
def test_what_does_not_turn_is_refused(tmp_path: Path, before: str, after: str, message: str) -> None:
    path = study(tmp_path)
    text = path.read_text()
    before, after = (each.replace("{{", "{") for each in (before, after))
    assert before in text
    path.write_text(text.replace(before, after))
    with pytest.raises(CmsReduceError, match=message):
        _ = open_run(path).bodies["arm"], open_run(path).bodies["panel"]


def test_shapes_that_a_matrix_leaves_alone_in_any_rigid_basis() -> None:
    """A wheel leaves translations and the turn about its axis alone, whichever combinations the rigid modes are."""
    body = panel()
    R = rigid_body_shapes(body.dofs, body.nodes)
    mixed = R @ np.linalg.qr(np.random.default_rng(1).standard_normal((6, 6)))[0]
    G = sp.csc_array(wheel(body.n, 6 * 3 + 3, PANEL))
    still = unresisted([G], mixed)
    assert still.shape == (6, 4)
    np.testing.assert_allclose(still.T @ still, np.eye(4), atol=1e-12)
    np.testing.assert_allclose(G @ mixed @ still, 0.0, atol=1e-12)


ROTOR = """\
name: rotor
output: {output}
components:
  mast:
    stiffness: {{file: mast.op4, matrix: KAA}}
    mass: {{file: mast.op4, matrix: MAA}}
    geometry: mast.bdf
    interfaces: {{root: {{node: 1}}, top: {{node: 3}}}}
  rotor:
    rigid: {{mass: 1.0, cg: [0, 0, 0.5], inertia: [{J}, {J}, 0.03, 0, 0, 0]}}
    interfaces: {{hub: {{position: [0, 0, 0.5]}}}}
    wheels: {{disc: {{axis: z}}}}
scene:
  band: 40 Hz
  ground: [mast.root]
  joints:
    gimbal: {{connect: [mast.top, rotor.hub], free: [rx, ry], stiffness: {{rx: {k} N*m/rad, ry: {k} N*m/rad}}}}
  parameters:
    spin: {{values: [0, {h} N*m*s], wheels: rotor.disc}}
reduce: {{method: craig-bampton, cutoff: 2}}
verify: {{limits: {{frf_error: 1 %}}}}
"""
