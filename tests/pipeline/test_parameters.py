"""Parameters beside the angles, against bodies assembled densely here and against closed forms."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from pyyeti.nastran import op4

from cmsreduce.balance import keep_all
from cmsreduce.config import load_pipeline
from cmsreduce.errors import CmsReduceError
from cmsreduce.model import Configuration, FEModel
from cmsreduce.orthogonalise import at_parameters
from cmsreduce.pipeline import Run, execute
from cmsreduce.pipeline.results import floating_bodies, multibody_scene
from cmsreduce.pipeline.system import selection_cost
from cmsreduce.simulate import scene_system
from cmsreduce.write import export_scene
from tests.frames import BAR, line, rotation
from tests.pipeline.study import PIPELINE, Log, arm, panel, write_body

ELEMENTS, PRELOAD = 16, 20e3
STRING = """\
name: string
output: {output}
components:
  string:
    stiffness: {{file: string.op4, matrix: KAA}}
    mass: {{file: string.op4, matrix: MAA}}
    geometry: string.bdf
    interfaces: {{left: {{node: 1, dofs: 1234}}, right: {{node: 17, dofs: 23}}}}
    damping: {{modal: 0.01}}
scene:
  band: 400 Hz
  ground: [string.left, string.right]
  parameters:
    preload: {{values: [0, 20 kN], stiffness: {{string: {{file: kg.op4, matrix: KG}}}}}}
  actuators: {{push: {{at: string.5, force: [0, 1, 0.5]}}}}
  sensors: {{seen: {{at: string.12, measure: [y, z]}}}}
reduce: {{method: craig-bampton, cutoff: 2}}
verify: {{limits: {{frf_error: 1 %}}}}
write: {{formats: [hdf5]}}
"""
VARIED = """\
  parameters:
    tension: {{values: [0, 2 kN], unit: 1 kN, stiffness: {{arm: {{file: kg.op4, matrix: KG}}}}}}
    ballast: {{values: [0, 1.5 kg], mass: {{panel: {{file: lump.op4, matrix: MP}}}}}}
    drag: {{values: [20], damping: {{arm: {{file: lump.op4, matrix: DP}}}}}}
    latch: {{values: [50, 800], joints: {{hinge: stiffness}}}}
"""


def open_run(path: Path, overrides: Sequence[str] = ()) -> Run:
    pipeline = load_pipeline(path, overrides)
    return Run(pipeline, pipeline.output, Log())


def string_stiffness(body: FEModel, length: float) -> np.ndarray:
    """Geometric stiffness of bars along x under unit tension: the consistent matrix of cubic deflections."""
    n = body.n // 6 - 1
    h = length / n
    g = np.array([[36, 3 * h, -36, 3 * h], [3 * h, 4 * h * h, -3 * h, -h * h]])
    g = np.vstack([g, -g[0], [3 * h, -h * h, -3 * h, 4 * h * h]]) / (30 * h)
    K = np.zeros((body.n, body.n))
    for e in range(n):
        for dofs, sign in (([1, 5, 7, 11], 1.0), ([2, 4, 8, 10], -1.0)):
            at = [6 * e + dof for dof in dofs]
            K[np.ix_(at, at)] += g * np.outer([1, sign, 1, sign], [1, sign, 1, sign])
    return K


@pytest.fixture
def string(tmp_path: Path) -> Path:
    body = line("string", [0, 0, 0], [1, 0, 0], ELEMENTS, interfaces={"left": 1, "right": ELEMENTS + 1})
    write_body(tmp_path, body)
    op4.write(str(tmp_path / "kg.op4"), {"KG": string_stiffness(body, 1.0)})
    path = tmp_path / "string.yaml"
    path.write_text(STRING.format(output=tmp_path / "out"))
    return path


def pinned_hz(tension: float, count: int) -> np.ndarray:
    """Frequencies of a pinned beam of 1 m under tension, in both planes."""
    found = []
    for inertia in (BAR.Iy, BAR.Iz):
        EI, line_mass = BAR.E * inertia, BAR.rho * BAR.A
        n = np.arange(1, 8)
        found.append((n * np.pi) ** 2 * np.sqrt(EI / line_mass) * np.sqrt(1 + tension / (EI * (n * np.pi) ** 2)))
    return np.sort(np.concatenate(found))[:count] / (2 * np.pi)


def test_a_beam_under_preload(string: Path) -> None:
    """The closed form at both ends of the range and inside it, by one basis and by the component file alone."""
    run = open_run(string)
    result = execute(run, string, report=False)
    assert result is not None and result.verdict.word == "PASS"
    assert [each.parameters for each in run.scene.configurations] == [{"preload": 0.0}, {"preload": PRELOAD}]
    for tension in (0.0, PRELOAD, 0.3 * PRELOAD):
        there = Configuration(f"asked {tension}", parameters={"preload": tension})
        found = run.model.assembled.resonances(there).omega[:5] / (2 * np.pi)
        # The mesh of 16 elements and the rotary inertia of the beam are in the 3e-4.
        np.testing.assert_allclose(found, pinned_hz(tension, 5), rtol=3e-4)
        reference = run.comparison.reference.assembled.resonances(there).omega[:5] / (2 * np.pi)
        np.testing.assert_allclose(found, reference, rtol=2e-6)
    assert result.between is not None
    assert list(result.between.errors) == ["midpoint preload=10000", "beside preload=5000", "beside preload=15000"]
    assert max(result.between.errors.values()) < 0.01
    with h5py.File(run.folder / "string.h5") as file:
        K, K1 = file["modes/stiffness"][()], file["parameters/preload/stiffness"][()]
        assert file["parameters/preload"].attrs["stiffness_power"] == 1
        faces = [file[f"interfaces/{name}/shapes"][()] for name in ("left", "right")]
    held = la.null_space(np.vstack(faces))
    squares = la.eigh(held.T @ (K + PRELOAD * K1) @ held, held.T @ held, eigvals_only=True)
    np.testing.assert_allclose(np.sqrt(squares[:5]) / (2 * np.pi), pinned_hz(PRELOAD, 5), rtol=3e-4)


def test_files_of_other_programs_hold_the_configuration_asked_for(string: Path) -> None:
    run = open_run(string, ["write.formats=[hdf5, nastran]", "write.configuration=preload=20000", "verify=null"])
    execute(run, string, report=False)
    names, matrices, *_ = op4.load(str(run.folder / "string.op4"), into="list")
    found = dict(zip(names, matrices, strict=True))
    K, M = (next(A for name, A in found.items() if name.upper().startswith(letter)) for letter in "KM")
    own = at_parameters(run.written("string"), {"preload": PRELOAD})
    squares = la.eigvalsh(np.asarray(K), np.asarray(M))
    np.testing.assert_allclose(np.sqrt(np.maximum(squares, 0))[-6:], np.sort(own.omega[own.elastic])[-6:], rtol=1e-6)
    # Tension of a fixed direction resists both rotations across the beam.
    assert (own.rigid_count, run.written("string").rigid_count) == (4, 6)
    assert any("files of other programs hold it with preload=20000" in note for note in run.stages.notes)
    with pytest.raises(CmsReduceError, match=r"write\.configuration: .*'preload=3'"):
        execute(open_run(string, ["write.configuration=preload=3"]), string)


class Dense:
    """The study, assembled by rows that equate motions, in the null space that scipy finds."""

    def __init__(self, tension: np.ndarray, ballast: np.ndarray, drag: np.ndarray) -> None:
        self.arm, self.panel = arm(), panel()
        self.tension, self.ballast, self.drag = tension, ballast, drag
        self.gyroscopic = tuple(np.zeros((n, n)) for n in (6, self.arm.n, self.panel.n))
        """Of the hub, the arm and the panel."""

    @staticmethod
    def damping(body: FEModel, ratio: float) -> np.ndarray:
        K, M = body.K.toarray(), body.M.toarray()
        squares, X = la.eigh(K, M)
        elastic = squares > 1e-6 * squares.max() * 1e-6 * len(K)
        elastic[:6] = False
        X, w = X[:, elastic], np.sqrt(squares[elastic])
        return M @ X @ np.diag(2 * ratio * w) @ X.T @ M

    def matrices(self, angle: float, values: dict[str, float]) -> tuple[np.ndarray, ...]:
        turn = la.block_diag(*[rotation([0, 1, 0], angle)] * (2 * len(self.panel.nodes.id)))
        hub = la.block_diag(5.0 * np.eye(3), [[0.2, 0.01, 0], [0.01, 0.3, 0], [0, 0, 0.25]])
        a, p = self.arm, self.panel
        K = la.block_diag(
            np.zeros((6, 6)), a.K.toarray() + values["tension"] * self.tension, turn @ p.K.toarray() @ turn.T
        )
        M = la.block_diag(hub, a.M.toarray(), turn @ (p.M.toarray() + values["ballast"] * self.ballast) @ turn.T)
        D = la.block_diag(
            np.zeros((6, 6)),
            self.damping(a, 0.01) + values["drag"] * self.drag,
            turn @ self.damping(p, 0.01) @ turn.T,
        )
        hub_turns, arm_turns, panel_turns = self.gyroscopic
        D += la.block_diag(hub_turns, arm_turns, turn @ panel_turns @ turn.T)
        n = len(K)
        root, tip, inner = 6, 6 + 6 * 4, 6 + a.n
        rows = []
        arm_from_cg = np.array([0.1, 0.0, -0.05])
        for k in range(3):
            row = np.zeros(n)
            row[root + k], row[k] = 1, -1
            row[3:6] = -np.cross(arm_from_cg, np.eye(3)[k])
            rows.append(row)
            row = np.zeros(n)
            row[root + 3 + k], row[3 + k] = 1, -1
            rows.append(row)
        for k in (0, 1, 2, 3, 5):
            row = np.zeros(n)
            row[tip + k], row[inner + k] = 1, -1
            rows.append(row)
        hinge = np.zeros(n)
        hinge[inner + 4], hinge[tip + 4] = 1, -1
        K += values["latch"] * np.outer(hinge, hinge)
        Z = la.null_space(np.array(rows))
        force = np.zeros(n)
        force[inner + 4], force[tip + 4] = 1, -1
        # The probe is on the panel and measures along its own z, which turns with it.
        probe = np.zeros(n)
        probe[inner + 6 * 5 : inner + 6 * 5 + 3] = rotation([0, 1, 0], angle)[:, 2]
        return (*(Z.T @ A @ Z for A in (K, M, D)), Z.T @ force, probe @ Z)


@pytest.fixture
def varied(tmp_path: Path) -> tuple[Path, Dense]:
    for body in (arm(), panel()):
        write_body(tmp_path, body)
    tension = string_stiffness(arm(), 0.8)
    ballast, drag = np.zeros((36, 36)), np.zeros((30, 30))
    ballast[30:33, 30:33] = np.eye(3)
    # Between the second and the fourth node, along x: a damper that no element is beside.
    e = np.zeros(30)
    e[6], e[18] = 1, -1
    drag += np.outer(e, e)
    op4.write(str(tmp_path / "kg.op4"), {"KG": 1e3 * tension})
    op4.write(str(tmp_path / "lump.op4"), {"MP": ballast, "DP": drag})
    path = tmp_path / "study.yaml"
    text = PIPELINE.replace("  actuators:\n", VARIED + "  actuators:\n", 1)
    path.write_text(text.format(output=tmp_path / "out"))
    return path, Dense(tension, ballast, drag)


def test_angles_and_parameters_of_every_kind_against_dense_algebra(varied: tuple[Path, Dense]) -> None:
    """Tension of one body, a mass and a damper in others, a joint's spring: products with the angles of a hinge."""
    path, dense = varied
    run = open_run(path)
    assert len(run.scene.configurations) == 2 * 2 * 2 * 2
    for each in (run.scene.configurations[0], run.scene.configurations[7], run.scene.configurations[-1]):
        K, M, D, b, c = dense.matrices(each.angles["hinge", 4], dict(each.parameters))
        squares = la.eigh(K, M, eigvals_only=True)
        rigid = int(np.sum(squares < 1e-9 * squares.max()))
        # Tension of a fixed direction holds the rotations across it.
        assert rigid == (6 if each.parameters["tension"] == 0 else 4)
        assert run.comparison.reference.assembled.system(each).rigid.shape[1] == rigid
        expected = np.sqrt(squares[rigid : rigid + 6])
        model = run.comparison.reference.assembled
        np.testing.assert_allclose(model.every_mode(each)[0][:6], expected, rtol=1e-7)
        # The reduced bodies, up to the band: one basis for all corners.
        np.testing.assert_allclose(run.model.assembled.every_mode(each)[0][:4], expected[:4], rtol=1e-5)
        omega = 2 * np.pi * np.array([3.0, 17.0, 41.0])
        wanted = np.array([c @ np.linalg.solve(K + 1j * w * D - w**2 * M, b.astype(complex)) for w in omega])
        found = model.response(each, omega)[:, -1, 0]
        np.testing.assert_allclose(found, wanted, rtol=1e-6)
        reduced = run.model.assembled.response(each, omega)[:, -1, 0]
        np.testing.assert_allclose(reduced, wanted, rtol=2e-2)


def test_a_search_measures_every_configuration(string: Path) -> None:
    """What is kept holds the limit with the preload, which it does not when chosen without."""
    asked = ["reduce.cutoff=6", "balance.keep={frf_error: 0.02}", "verify.limits.frf_error=0.02", "verify.between=0"]
    run = open_run(string, asked)
    result = execute(run, string, report=False)
    assert result is not None and result.search is not None
    assert result.search.modes < result.search.of
    errors = [each.errors["reduced"].frf_error for each in result.configurations]
    assert len(errors) == 2 and max(errors) <= 0.02
    # The cost of this choice, for searches that trade a mode for a step.
    price = selection_cost(run.ranked, run.joined)
    assert price(run.selection) == result.speed.simulation.reduced.operations
    every = keep_all(run.ranked)
    assert price(run.selection) < price(every)


def test_units_of_the_files_do_not_matter(string: Path) -> None:
    """The same body and matrix in millimetres and tonnes; the preload in the scene's units."""
    body = line("string", [0, 0, 0], [1, 0, 0], ELEMENTS, interfaces={"left": 1, "right": ELEMENTS + 1})
    found = []
    for scale, units in (((1.0, 1.0), "m-kg-s"), ((1e3, 1e-3), "mm-t-s")):
        length, mass = scale
        write_body(string.parent, body, length=length, mass=mass)
        per_row = np.where(body.dofs.component <= 3, 1 / length, 1.0)
        K = mass * length**2 * string_stiffness(body, 1.0) * np.outer(per_row, per_row)
        op4.write(str(string.parent / "kg.op4"), {"KG": 500.0 * K})
        run = open_run(
            string, [f"components.string.units={units}", "scene.parameters.preload.unit=0.5 kN", "verify=null"]
        )
        found.append(run.model.assembled.resonances(run.scene.configurations[1]).omega)
    np.testing.assert_allclose(found[1], found[0], rtol=1e-7)


def test_a_spin_stiffens_with_its_square(string: Path) -> None:
    matrix = f"{{file: {string.parent / 'kg.op4'}, matrix: KG, power: 2}}"
    keys = f"scene.parameters={{spin: {{values: [0, 600 rpm], stiffness: {{string: {matrix}}}}}}}"
    run = open_run(string, [keys, "verify=null"])
    rate = 600 * 2 * np.pi / 60
    found = run.model.assembled.resonances(run.scene.configurations[1]).omega[:5] / (2 * np.pi)
    np.testing.assert_allclose(found, pinned_hz(rate**2, 5), rtol=3e-4)


def test_a_file_of_the_whole_stiffness_under_preload(string: Path) -> None:
    """As CalculiX writes it in a perturbation step; the closed form, without a note on what the file holds."""
    body = line("string", [0, 0, 0], [1, 0, 0], ELEMENTS, interfaces={"left": 1, "right": ELEMENTS + 1})
    op4.write(str(string.parent / "whole.op4"), {"KT": body.K.toarray() + PRELOAD * string_stiffness(body, 1.0)})
    given = "unit: 20 kN, stiffness: {string: {file: whole.op4, matrix: KT, whole: true}}"
    string.write_text(string.read_text().replace("stiffness: {string: {file: kg.op4, matrix: KG}}", given))
    run = open_run(string)
    for tension in (PRELOAD, 0.3 * PRELOAD):
        there = Configuration("preloaded", parameters={"preload": tension})
        found = run.model.assembled.resonances(there).omega[:5] / (2 * np.pi)
        np.testing.assert_allclose(found, pinned_hz(tension, 5), rtol=3e-4)
    assert not any("preload" in note for note in run.bodies["string"].notes)


CASES = {
    "other rows": ("K", r"couples \d+ pairs of nodes|a translation of the whole body costs"),
    "a support": ("support", r"say `grounded: true` under the parameter"),
    "zero": ("zero", r"is zero: the parameter would change nothing"),
    "a lopsided mass": ("mass", r"a mass is the same in every direction"),
    "not symmetric": ("skew", r"is not symmetric"),
    "mass as stiffness": ("M", r"'KG' of .* is the mass of the body"),
    "stiffness as damping": ("D", r"is the stiffness of the body"),
    "stress as mass": ("moved", r"translations of the body give it no momentum"),
    "more mass than there is": ("less", r"1 times it leaves the body a negative mass"),
}


@pytest.mark.parametrize(("kind", "message"), CASES.values(), ids=CASES)
def test_a_matrix_that_does_not_fit_is_refused(string: Path, kind: str, message: str) -> None:
    body = line("string", [0, 0, 0], [1, 0, 0], ELEMENTS, interfaces={"left": 1, "right": ELEMENTS + 1})
    K = string_stiffness(body, 1.0)
    order = np.random.default_rng(5).permutation(body.n)
    support, lopsided = np.zeros_like(K), np.zeros_like(K)
    support[50, 50], lopsided[12, 12] = 1e3, 2.0
    skew = K.copy()
    skew[7, 1] *= 2
    A = {"K": K[np.ix_(order, order)], "support": support, "zero": 0 * K, "mass": lopsided, "skew": skew}
    A |= {"M": body.M.toarray(), "D": body.K.toarray(), "moved": K, "less": np.diag(support.diagonal()) * 0}
    A["less"][range(12, 15), range(12, 15)] = -50.0
    op4.write(str(string.parent / "kg.op4"), {"KG": A[kind]})
    what = {"mass": "mass", "moved": "mass", "less": "mass", "D": "damping"}.get(kind, "stiffness")
    file = string.parent / "kg.op4"
    keys = f"scene.parameters={{p: {{values: [0, 1], {what}: {{string: {{file: {file}, matrix: KG}}}}}}}}"
    with pytest.raises(CmsReduceError, match=message):
        _ = open_run(string, [keys]).bodies


def axes_sizes(turns: float) -> np.ndarray:
    """Factors of a node's rows by which a matrix in another unit of length differs."""
    return np.tile([1, 1, 1, turns, turns, turns], ELEMENTS + 1)


def test_a_matrix_that_may_hold_something_else_has_a_note(string: Path) -> None:
    """Sound: a string's or beam's tension, a softer modulus. Doubtful: the whole matrix, other axes, other lengths."""
    body = line("string", [0, 0, 0], [1, 0, 0], ELEMENTS, interfaces={"left": 1, "right": ELEMENTS + 1})
    KG, K0, M0 = string_stiffness(body, 1.0), body.K.toarray(), body.M.toarray()
    axes = np.arange(body.n).reshape(-1, 6)
    exchanged, turned = axes[:, [1, 0, 2, 3, 4, 5]].ravel(), axes[:, [3, 4, 5, 0, 1, 2]].ravel()
    rod = np.zeros_like(KG)
    for k in range(ELEMENTS):
        rod[np.ix_([6 * k, 6 * k + 6], [6 * k, 6 * k + 6])] += [[1, -1], [-1, 1]]
    # Tension of a bar of length h: Przemieniecki, Theory of Matrix Structural Analysis, 15.2; in x-y and x-z.
    h, bent = 1 / ELEMENTS, np.zeros_like(KG)
    upper = [[36, 3 * h, -36, 3 * h], [0, 4 * h**2, -3 * h, -(h**2)], [0, 0, 36, -3 * h], [0, 0, 0, 4 * h**2]]
    bar = (np.triu(upper) + np.triu(upper, 1).T) / (30 * h)
    for k in range(ELEMENTS):
        for own, turns in (([1, 5, 7, 11], 1), ([2, 4, 8, 10], -1)):
            rows = 6 * k + np.array(own)
            bent[np.ix_(rows, rows)] += bar * np.outer([1, turns, 1, turns], [1, turns, 1, turns])
    in_mm, in_km = (bent * np.outer(size, size) for size in (axes_sizes(1e3), axes_sizes(1e-3)))
    for what, A, said in (
        ("stiffness", KG, ""),
        ("stiffness", bent, ""),
        ("stiffness", in_mm, "order of its axes is not proven"),
        ("stiffness", in_km, "order of its axes is not proven"),
        ("stiffness", -0.2 * K0, ""),
        ("mass", 0.1 * M0, ""),
        ("stiffness", KG[np.ix_(exchanged, exchanged)], "order of its axes is not proven"),
        ("stiffness", rod[np.ix_(turned, turned)], "acts on rotations alone"),
        ("stiffness", K0 + 1e3 * KG, "is the stiffness of the body times 1"),
        ("mass", M0 + np.diag(np.tile([1e-3] * 3 + [0] * 3, ELEMENTS + 1)), "is the mass of the body times 1"),
    ):
        op4.write(str(string.parent / "kg.op4"), {"KG": A})
        file = string.parent / "kg.op4"
        keys = f"scene.parameters={{p: {{values: [0, 1], {what}: {{string: {{file: {file}, matrix: KG}}}}}}}}"
        run = open_run(string, [keys])
        _ = run.bodies
        notes = [note for note in run.stages.notes if "parameter 'p'" in note]
        assert len(notes) == bool(said) and all(said in note for note in notes), (said, notes)


def test_a_parameter_of_sparse_dofs_is_exact(string: Path) -> None:
    """Without modal damping the reference is the sparse body, K0 + p K1, held by the ground."""
    run = open_run(string, ["components.string.damping={structural: 0.02}"])
    assert run.references["string"].label == "sparse dofs"
    each = run.scene.configurations[1]
    body = run.bodies["string"].body
    K = body.K.toarray() + PRELOAD * sp.csc_array(body.terms[0].matrix).toarray()
    free = np.setdiff1d(np.arange(body.n), [0, 1, 2, 3, body.n - 5, body.n - 4])
    omega = 2 * np.pi * np.array([50.0, 90.0, 230.0])
    b, c = np.zeros(body.n), np.zeros(body.n)
    b[[25, 26]], c[67] = [1, 0.5], 1
    loss = 0.02 * body.K.toarray()
    for w, found in zip(omega, run.comparison.reference.assembled.response(each, omega)[:, 0, 0], strict=True):
        Z = (K + 1j * loss - w**2 * body.M.toarray())[np.ix_(free, free)]
        assert found == pytest.approx(c[free] @ np.linalg.solve(Z, b[free]), rel=1e-6)


HEAT = """\
  parameters:
    heat: {{values: [0, 40], unit: 100, stiffness: {{arm: {{file: soft.op4, matrix: KT}}}}}}
    tension: {{values: [0, 2 kN], unit: 1 kN, stiffness: {{panel: {{file: soft.op4, matrix: KG}}}}}}
"""


def test_a_simulation_takes_the_values_of_its_configuration(tmp_path: Path) -> None:
    """A modulus that falls with temperature, K (1 - 0.3 p / 100); a tension that turns with nothing is refused."""
    for body in (arm(), panel()):
        write_body(tmp_path, body)
    tension = np.zeros((36, 36))
    # A string between the first two nodes of the panel, 0.3 m apart.
    tension[np.ix_([1, 7], [1, 7])] = np.array([[1, -1], [-1, 1]]) / 0.3
    op4.write(str(tmp_path / "soft.op4"), {"KT": -0.3 * arm().K.toarray(), "KG": 1e3 * tension})
    path = tmp_path / "study.yaml"
    path.write_text(PIPELINE.replace("  actuators:\n", HEAT + "  actuators:\n", 1).format(output=tmp_path / "out"))
    run = open_run(path, ["scene.articulation=null", "reduce.cutoff=6", "verify=null"])
    execute(run, path, report=False)
    for name, values in (("heat=0 tension=0", {}), ("heat=40 tension=0", {"heat": 40.0})):
        scene = multibody_scene(run.folder, name)
        system = scene_system(scene, floating_bodies(scene))
        squares, _ = system.linear(system.start({}, None, {}))
        found = np.sqrt(squares[squares > 1.0])
        expected = run.model.assembled.every_mode(scene.configuration)[0]
        np.testing.assert_allclose(found, expected, rtol=1e-7)
        assert scene.configuration.parameters.get("heat", 0.0) == values.get("heat", 0.0)
    softer = run.model.assembled.every_mode(run.scene.configurations[2])[0][0]
    assert softer < 0.999 * run.model.assembled.every_mode(run.scene.configurations[0])[0][0]
    scene = multibody_scene(run.folder, "heat=0 tension=2000")
    with pytest.raises(CmsReduceError, match="the parameter 'tension' changes the rigid motion of the body"):
        floating_bodies(scene)
    with pytest.raises(CmsReduceError, match="a scene for exudyn holds one body, and this one is changed by tension"):
        export_scene(scene, "exudyn", tmp_path / "scene")


def test_a_joint_without_its_spring_is_free(varied: tuple[Path, Dense]) -> None:
    """The same joint at stiffness zero, and in a pipeline without the parameter."""
    path, _ = varied
    quiet = ["scene.parameters.latch.values=[0, 800]", "scene.articulation=null", "verify=null"]
    run = open_run(path, quiet)
    each = next(
        one for one in run.scene.configurations if not any(value for value in one.parameters.values() if value != 20)
    )
    assert each.parameters["latch"] == 0.0
    assert run.model.assembled.system(each).rigid.shape[1] == 7
    text = path.read_text()
    path.write_text("\n".join(line for line in text.splitlines() if "latch" not in line) + "\n")
    plain = open_run(path, quiet[1:])
    omega = 2 * np.pi * np.array([4.0, 30.0])
    other = next(
        one for one in plain.scene.configurations if one.parameters["tension"] == one.parameters["ballast"] == 0
    )
    np.testing.assert_allclose(
        run.model.assembled.response(each, omega), plain.model.assembled.response(other, omega), rtol=1e-9
    )


def test_values_that_agree_in_their_names_are_refused(string: Path) -> None:
    with pytest.raises(CmsReduceError, match="two configurations are named 'preload=20000'"):
        open_run(string, ["scene.parameters.preload.values=[20000.001, 20000.002]"])


@pytest.mark.parametrize(
    ("preload", "message"),
    [
        ("-200", r"with preload=-200000 body 'string' buckles: .*Check the sign"),
        ("-2000", r"with preload=-2e\+06: body"),
    ],
)
def test_a_compression_that_buckles_the_body_is_named(string: Path, preload: str, message: str) -> None:
    run = open_run(string, [f"scene.parameters.preload.values=[0, {preload} kN]"])
    with pytest.raises(CmsReduceError, match=message):
        _ = run.model
