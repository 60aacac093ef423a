"""Bodies that other programs made, through a pipeline file each, against those programs' own figures."""

import json
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pytest

from cmsreduce.config import load_pipeline
from cmsreduce.errors import WriteError
from cmsreduce.mechanics import rigid_mass
from cmsreduce.model import rigid_body_shapes
from cmsreduce.pipeline import Run, Silent, execute, inspected
from cmsreduce.pipeline.drafts import draft_body
from cmsreduce.verify import rigid_mass_properties
from cmsreduce.write import convert, read_component

pytestmark = pytest.mark.shared

SUPERELEMENTS = """\
components:
  inboard: {{extseout: {data}/inboard, interfaces: {faces}, damping: {{modal: 0.01}}}}
  outboard: {{extseout: {data}/outboard, interfaces: {faces}, damping: {{modal: 0.01}}}}
scene:
  band: 10 Hz
  joints: {joints}
  actuators: {{thruster: {{at: outboard.3, force: [1, 0, 0]}}}}
  sensors: {{probe: {{at: inboard.11, measure: [x, y, z]}}}}
"""
WELD = {"faces": "{boundary: {set: b}}", "joints": "{seam: {connect: [inboard.boundary, outboard.boundary]}}"}
WELD_OF_23 = {
    "faces": "{corners: {nodes: [3, 11, 27]}, last: {node: 19, dofs: 12345}}",
    "joints": "{seam: {connect: [inboard.corners, outboard.corners]}, "
    "rest: {connect: [inboard.last, outboard.last], free: [rz]}}",
}
# full.out, the model that was never cut.
UNCUT_HZ = [1.698800, 1.767487, 1.857720, 3.419612, 7.024210]

Opened = Callable[..., Run]


@pytest.fixture
def opened(tmp_path: Path) -> Opened:
    """Open a pipeline of the text given."""

    def make(text: str, **fields: object) -> Run:
        file = tmp_path / "study.yaml"
        file.write_text("name: study\n" + text.format(**fields))
        return Run(load_pipeline(file), tmp_path / "out", Silent())

    return make


def elastic_hz(component) -> np.ndarray:
    return component.omega[component.elastic] / (2 * np.pi)


def test_nas2cam_bodies(shared_data: Path, opened: Opened) -> None:
    run = opened(SUPERELEMENTS + "reduce: {{cutoff: 30}}\n", data=shared_data / "nas2cam", **WELD)
    for name, q in (("inboard", 8), ("outboard", 22)):
        body = run.bodies[name].body
        assert (body.sets["b"].size, body.sets["q"].size, run.bodies[name].rigid.shape[1]) == (24, q, 6)
        R = rigid_body_shapes(body.dofs, body.nodes)
        assert abs(body.K @ (R / np.linalg.norm(R, axis=0))).max() < 1e-14 * abs(body.K).max()
    inboard = run.bodies["inboard"].body
    np.testing.assert_allclose(rigid_mass_properties(rigid_mass(inboard)).mass, 1.755052, atol=5e-7)
    assert np.linalg.matrix_rank(inboard.M.toarray()) == 31
    modes = run.reduced("inboard").modes
    fixed = [hz for hz, kind in zip(modes.source_hz, modes.kind, strict=True) if kind == "fixed"]
    np.testing.assert_allclose(fixed[:3], [6.12934551, 6.1301342, 23.6318766], rtol=1e-8)
    assert len(fixed) == 8


def test_nas2cam_assembled_unreduced(shared_data: Path, opened: Opened) -> None:
    text = SUPERELEMENTS.replace("modal: 0.01", "structural: 0.02")
    run = opened(text, data=shared_data / "nas2cam", **WELD)
    (configuration,) = run.scene.configurations
    full = run.comparison.reference.assembled
    assert set(run.comparison.reference.shapes.values()) == {None}
    # 32 + 46 dofs, 24 of which are shared.
    assert (full.system(configuration).N, full.system(configuration).rigid.shape[1]) == (54, 6)
    hertz = full.resonances(configuration).omega / (2 * np.pi)
    np.testing.assert_allclose(hertz[:5], UNCUT_HZ, atol=2e-6)


def test_nas2cam_shape_without_mass_is_a_static_mode(shared_data: Path, opened: Opened, tmp_path: Path) -> None:
    """The inboard body's boundary grids can warp without moving any mass: 31 of 32 shapes have a frequency."""
    stages = "reduce: {{cutoff: 30}}\nverify: {{}}\nwrite: {{}}\n"
    run = opened(SUPERELEMENTS + stages, data=shared_data / "nas2cam", **WELD)
    result = execute(run, tmp_path / "study.yaml")
    assert result is not None
    modal = run.modal("inboard")
    assert (modal.rigid_count, modal.elastic_count, modal.static_count) == (6, 25, 1)
    assert modal.kind[-1] == "constraint" and modal.why[-1] == "static: carries no mass"
    assert all(check.passed for part in result.components.values() for check in part.checks)
    (configuration,) = run.scene.configurations
    hertz = run.model.assembled.resonances(configuration).omega / (2 * np.pi)
    np.testing.assert_allclose(hertz[:5], UNCUT_HZ, atol=2e-6)
    # The unreduced body has as many modes, the warping among them.
    assert result.reference["inboard"] == "all modes" and run.references["inboard"].modes.static_count == 1
    assert result.worst()["frequency_error"] < 1e-8 and result.worst()["frf_error"] < 1e-6
    facts = json.loads((tmp_path / "out" / "summary.json").read_text())["components"]["inboard"]
    assert (facts["elastic_modes"], facts["static_modes"], facts["kept_modes"]) == (25, 1, 25)
    assert len(facts["frequencies_hz"]) == 25 and facts["frequencies_hz"][-1] == pytest.approx(
        modal.omega[-2] / 2 / np.pi
    )
    # What is said of it holds no infinity.
    lines = inspected(tmp_path / "out" / "inboard.h5").lines
    assert any("1 static mode" in line for line in lines)
    assert not [line for line in lines if "inf" in line or "nan" in line]
    page = (tmp_path / "out" / "report.html").read_text()
    assert "25 elastic and 1 static modes" in page and "infinite" not in page.partition("<script")[0]


def test_nas2cam_integrals_that_the_superelement_does_not_determine(
    shared_data: Path, opened: Opened, tmp_path: Path
) -> None:
    """Sums over its six boundary grids had a trace of int phi_i phi_j of 48, where the modal mass is 1."""
    run = opened(SUPERELEMENTS + "reduce: {{cutoff: 30}}\nwrite: {{}}\n", data=shared_data / "nas2cam", **WELD)
    assert execute(run, tmp_path / "study.yaml", report=False) is not None
    assert any("outboard: int r_i phi_j dm and int phi_i phi_j dm are not" in note for note in run.stages.notes)
    file = read_component(tmp_path / "out" / "outboard.h5")
    assert not {"integrals/r_phi", "integrals/phi_phi", "integrals/rigid_mass_row_sum"} & file.arrays.keys()
    # assemble.out has the mass.
    assert float(file.arrays["integrals/mass"]) == pytest.approx(1.590384, rel=1e-6)
    with pytest.raises(WriteError, match=r"outboard.*not determined"):
        convert(tmp_path / "out" / "outboard.h5", tmp_path / "outboard.42.txt")
    with np.load(*convert(tmp_path / "out" / "outboard.h5", tmp_path / "outboard.npz"), allow_pickle=True) as made:
        np.testing.assert_allclose(made["massMatrixReduced"], file.arrays["modes/mass"][6:, 6:], atol=1e-12)
        np.testing.assert_array_equal(made["mPhitTPsi"], file.arrays["integrals/phi"])


def test_nas2cam_one_body_reduced(shared_data: Path, opened: Opened, tmp_path: Path) -> None:
    """The inboard body joins as it was read, massless warping and all; the outboard one is reduced."""
    text = SUPERELEMENTS.replace("modal: 0.01}}", "structural: 0.02}}")
    text = text.replace("structural: 0.02}}}}\nscene", "structural: 0.02}}, reduce: {{cutoff: 30}}}}\nscene")
    text += "verify: {{limits: {{frf_error: 1e-6, db_error: 1e-3, frequency_error: 1e-8}}}}\nwrite: {{}}\n"
    run = opened(text, data=shared_data / "nas2cam", **WELD)
    result = execute(run, tmp_path / "study.yaml", report=False)
    assert result is not None and result.passed
    (configuration,) = run.scene.configurations
    hertz = run.model.assembled.resonances(configuration).omega / (2 * np.pi)
    np.testing.assert_allclose(hertz[:5], UNCUT_HZ, atol=2e-6)
    assert all((tmp_path / "out" / f"{name}.h5").is_file() for name in ("outboard", "inboard"))


def test_nas2cam_both_bodies_reduced(shared_data: Path, opened: Opened, tmp_path: Path) -> None:
    """A dof left out of the joint, which has 23 of the 24, and the last of the generalised coordinates cut off.

    The basis then holds no shape without mass.
    """
    stages = "reduce: {{cutoff: 20}}\nverify: {{limits: {{frf_error: 1e-5, db_error: 1e-3}}}}\nwrite: {{}}\n"
    run = opened(SUPERELEMENTS + stages, data=shared_data / "nas2cam", **WELD_OF_23)
    result = execute(run, tmp_path / "study.yaml")
    assert result is not None and result.passed
    (configuration,) = run.scene.configurations
    hertz = run.model.assembled.resonances(configuration).omega / (2 * np.pi)
    np.testing.assert_allclose(hertz[:5], UNCUT_HZ, rtol=5e-6)
    assert run.modal("inboard").static_count == 0
    assert {path.name for path in (tmp_path / "out").glob("*.*")} == {
        "inboard.h5",
        "outboard.h5",
        "system.h5",
        "summary.json",
        "report.html",
    }


BLOCK = """\
components:
  block:
    stiffness: {{file: {data}/block_a.op4, matrix: KAA}}
    mass: {{file: {data}/block_a.op4, matrix: MAA}}
    geometry: {data}/block_a.bdf
    interfaces: {faces}
scene: {{band: {band} Hz}}
reduce: {{cutoff: 1}}
"""


def test_block_a_is_sierra_s_superelement(shared_data: Path, opened: Opened) -> None:
    sierra = np.load(shared_data / "block_a" / "reference.npz")
    nodes = list(dict.fromkeys(sierra["boundary"][:, 0].tolist()))
    run = opened(BLOCK, data=shared_data / "block_a", band=20029.5, faces=f"{{boundary: {{nodes: {nodes}}}}}")
    assert run.bodies["block"].rigid.shape[1] == 6
    reduced = run.reduced("block")
    assert list(reduced.modes.label[:75]) == [f"{node}.{part}" for node, part in sierra["boundary"]]
    # Sierra cut a pair of modes in two; its other half comes too.
    assert reduced.modes.kind == ("constraint",) * 75 + ("fixed",) * 31
    eigenvalues = (2 * np.pi * reduced.modes.source_hz[75:]) ** 2
    np.testing.assert_allclose(eigenvalues[:30], sierra["fixed_interface_eigenvalues"], rtol=1e-11)
    assert eigenvalues[30] == pytest.approx(eigenvalues[29], rel=1e-9)
    for letter in ("K", "M"):
        expected = sierra[f"{letter}bb"]
        np.testing.assert_allclose(getattr(reduced, letter)[:75, :75], expected, atol=1e-11 * abs(expected).max())
    # Modes 1-2 are a pair, so any rotation of the two is as good: what they couple to the boundary is compared.
    mine, theirs = reduced.M[75:, :75], sierra["Mqb"]
    np.testing.assert_allclose(mine[:2].T @ mine[:2], theirs[:2].T @ theirs[:2], atol=1e-9)
    np.testing.assert_allclose(abs(mine[2]), abs(theirs[2]), atol=1e-8)


def test_block_a_free_modes(shared_data: Path, opened: Opened) -> None:
    sierra = np.load(shared_data / "block_a" / "reference.npz")["frequencies_hz"]
    run = opened(BLOCK, data=shared_data / "block_a", band=22810, faces="{}")
    modal = run.modal("block")
    assert modal.rigid_count == 6
    hertz = elastic_hz(modal)
    np.testing.assert_allclose(hertz, sierra[6:], rtol=1e-9)
    assert hertz[1] == pytest.approx(hertz[0], rel=1e-9)


def test_swept_plane_with_massless_dofs(shared_data: Path, opened: Opened) -> None:
    """Ten printed digits leave a mass matrix of rank 31 with 14 small eigenvalues of either sign; none is a mode."""
    folder = shared_data / "swept_plane"
    run = opened(
        "components:\n  plane:\n"
        "    stiffness: {{file: {punch}, matrix: KAAX}}\n    mass: {{file: {punch}, matrix: MAAX}}\n"
        "    geometry: {deck}\n    damping: {{structural: 0.01}}\n"
        "scene: {{band: 1e6 Hz}}\nreduce: {{cutoff: 1}}\n",
        punch=folder / "sol103_swept_plane.pch1",
        deck=folder / "sol103_swept_plane.bdf",
    )
    assert run.bodies["plane"].body.n == 45
    modal = run.modal("plane")
    f06 = [1.339207, 3.406026, 5.610046, 10.88232, 11.05762, 16.00409, 23.21605]
    assert (modal.rigid_count, modal.elastic_count) == (3, 28)
    np.testing.assert_allclose(elastic_hz(modal)[:7], f06, rtol=5e-7)
    assert elastic_hz(modal)[-1] < 1000
    full = run.comparison.reference.assembled.resonances(run.scene.configurations[0])
    np.testing.assert_allclose(full.omega / (2 * np.pi), elastic_hz(modal), rtol=1e-9)
    # Held but for motion out of its plane, the body still has a centre of mass in it.
    found = rigid_mass_properties(rigid_mass(run.bodies["plane"].body))
    np.testing.assert_allclose(found.mass[:2], 0.0)
    R = rigid_body_shapes(run.bodies["plane"].body.dofs, run.bodies["plane"].body.nodes, found.cg)
    about_cg = R.T @ (run.bodies["plane"].body.M @ R)
    np.testing.assert_allclose(about_cg[2, 3:5], 0.0, atol=1e-9 * about_cg.max())
    np.testing.assert_allclose(found.inertia[:2, :2], about_cg[3:5, 3:5], rtol=1e-9, atol=1e-9 * about_cg.max())


def test_chain15_has_one_rigid_mode(shared_data: Path, opened: Opened) -> None:
    run = opened(
        "components:\n  chain:\n    stiffness: {{file: {punch}, matrix: KAAX}}\n"
        "    mass: {{file: {punch}, matrix: MAAX}}\nscene: {{band: 1.2 Hz}}\nreduce: {{}}\n",
        punch=shared_data / "chain15" / "dmig.pch",
    )
    modal = run.modal("chain")
    assert (modal.body.n, modal.rigid_count) == (15, 1)
    np.testing.assert_allclose(elastic_hz(modal), [1.0335, 2.1307], atol=5e-5)


def test_calculix_body_and_its_integrals(shared_data: Path, opened: Opened, tmp_path: Path) -> None:
    """A brick 1 x 1.5 x 8, density 7800: its integrals have closed forms, which the consistent mass meets."""
    run = opened(
        "components:\n  brick:\n    stiffness: {data}/calculix.sti\n    mass: {data}/calculix.mas\n"
        "    geometry: {data}/calculix.frd\n    damping: {{modal: 0.01}}\n"
        "scene: {{band: 100 Hz}}\nreduce: {{}}\nwrite: {{}}\n",
        data=shared_data / "calculix_body",
    )
    body = run.bodies["brick"].body
    assert (body.n, run.bodies["brick"].rigid.shape[1]) == (783, 6)
    assert run.bodies["brick"].checks[0].passed
    execute(run, tmp_path / "study.yaml", report=False)
    mass, a, b, c = 7800 * 12.0, 1.0, 1.5, 8.0
    with h5py.File(tmp_path / "out" / "brick.h5") as file:
        integrals = file["integrals"]
        assert integrals["mass"][()] == pytest.approx(mass, rel=1e-12)
        np.testing.assert_allclose(integrals["first_moment"], mass / 2 * np.array([a, b, c]), rtol=1e-12)
        J = integrals["inertia"][()]
        xx, yy, zz = np.trace(J) / 2 - J.diagonal()
        # Lumping gives 33540 for the first; the consistent mass, which is stated, gives what the solid has.
        np.testing.assert_allclose([xx, yy, zz], mass / 3 * np.array([a, b, c]) ** 2, rtol=1e-11)
        assert xx == pytest.approx(31200, rel=1e-11)
        np.testing.assert_allclose(-J[[0, 0, 1], [1, 2, 2]], mass / 4 * np.array([a * b, a * c, b * c]), rtol=1e-11)
        assert integrals.attrs["mass_matrix"].startswith("consistent")
        # Elastic modes of a free body carry no momentum.
        elastic = slice(file["modes"].attrs["rigid_count"], None)
        for name in ("int_phi", "int_r_x_phi"):
            assert abs(integrals[name][:, elastic]).max() < 1e-7 * abs(integrals[name][()]).max()


def test_abaqus_files_by_their_own_names(shared_data: Path) -> None:
    files = [shared_data / "abaqus_c3d10" / f"blockC3D10{end}" for end in (".inp", "_MASS1.mtx", "_STIF1.mtx")]
    draft = draft_body("block", files)
    assert (draft.stiffness[0], draft.mass[0], draft.remark) == (files[2], files[1], "")


def test_abaqus_c3d10_is_free(shared_data: Path, opened: Opened) -> None:
    run = opened(
        "components:\n  block:\n    stiffness: {data}/blockC3D10_STIF1.mtx\n    mass: {data}/blockC3D10_MASS1.mtx\n"
        "    geometry: {data}/blockC3D10.inp\nscene: {{band: 250 Hz}}\nreduce: {{}}\n",
        data=shared_data / "abaqus_c3d10",
    )
    flexible = run.bodies["block"]
    assert (flexible.body.n, flexible.rigid.shape[1]) == (771, 6)
    assert flexible.checks[0].passed
    # A block 4 x 1 x 1 of density 2900, its axis along x.
    found = rigid_mass_properties(rigid_mass(flexible.body))
    np.testing.assert_allclose(found.mass, 11600, rtol=1e-9)
    np.testing.assert_allclose(found.cg, [2, 0.5, 0.5], rtol=1e-9)
    np.testing.assert_allclose(found.inertia.diagonal(), 11600 / 12 * np.array([2, 17, 17]), rtol=1e-9)
    modal = run.modal("block")
    assert modal.rigid_count == 6
    np.testing.assert_array_equal(modal.omega[:6], 0.0)
    # Bending in the two planes of a square section is a pair, up to the mesh's lack of symmetry.
    hertz = elastic_hz(modal)
    assert hertz[1] == pytest.approx(hertz[0], rel=2e-3)
