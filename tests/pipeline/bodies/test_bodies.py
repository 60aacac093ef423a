"""Bodies of every kind in a run: damped by a law or a matrix, held, a single point, rigid, and not reduced."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.errors import ConfigError, DofMapError
from cmsreduce.model import DofTable, FEModel, Nodes
from cmsreduce.pipeline import Run, execute
from cmsreduce.write import read_component
from tests.pipeline.study import ARM_FILES, CANTILEVER, PIPELINE, arm, write_body

BETA = 1e-5


def errors(run: Run) -> dict[str, float]:
    result = max(run.verified.configurations, key=lambda c: c.errors["reduced"].frf_error).errors["reduced"]
    return {"frf_error": result.frf_error, "db_error": result.db_error, "frequency_error": result.frequency_error}


def test_a_damping_matrix_acts_as_the_law_it_was_made_of(opened: Callable[..., Run], study: Path) -> None:
    from pyyeti.nastran import op4

    op4.write(str(study.parent / "viscous.op4"), {"DAA": BETA * arm().K.toarray()})
    law = opened(f"components.arm.damping={{rayleigh: {{alpha: 0, beta: {BETA}}}}}")
    matrix = opened(f"components.arm.damping={{matrix: {{file: {study.parent}/viscous.op4, matrix: DAA}}}}")
    assert matrix.bodies["arm"].body.damping.law == "none"
    np.testing.assert_allclose(matrix.modal("arm").zeta[6:], BETA * matrix.modal("arm").omega[6:] / 2, rtol=1e-8)
    np.testing.assert_allclose(matrix.ranked["arm"].sigma[6:], law.ranked["arm"].sigma[6:], rtol=1e-8)
    for name, value in errors(matrix).items():
        assert value == pytest.approx(errors(law)[name], rel=1e-5)
    # Where the same modes are asked for, a matrix cannot be told from its law.
    w = 2 * np.pi * np.array([7.0, 33.0, 58.0])
    for number, configuration in enumerate(matrix.scene.configurations):
        ours = matrix.model.assembled.response(configuration, w)
        theirs = law.model.assembled.response(law.scene.configurations[number], w)
        np.testing.assert_allclose(ours, theirs, rtol=1e-6, atol=1e-9 * abs(theirs).max())


@pytest.mark.parametrize(
    ("damping", "ratio"),
    [
        ("{modal: 0.02}", lambda w: np.full(w.size, 0.02)),
        ("{structural: 0.03}", lambda w: np.full(w.size, 0.015)),
        ("{rayleigh: {alpha: 2.0, beta: 1e-5}}", lambda w: 1 / w + 5e-6 * w),
        ("{per_mode: [0.01, 0.02]}", lambda w: np.where(np.arange(w.size) == 0, 0.01, 0.02)),
        ("{table: [[0, 0.01], [1000, 0.03]]}", lambda w: np.interp(w / 2 / np.pi, [0, 1000], [0.01, 0.03])),
    ],
)
def test_damping_laws(opened: Callable[..., Run], damping: str, ratio: Callable[[np.ndarray], np.ndarray]) -> None:
    run = opened(f"components.arm.damping={damping}")
    arm_modes = run.modal("arm")
    np.testing.assert_allclose(arm_modes.zeta[6:], ratio(arm_modes.omega[6:]), rtol=1e-12)
    # The unreduced body is damped by the same law.
    assert errors(run)["frf_error"] < 0.03 and errors(run)["frequency_error"] < 1e-3


def test_alpha_that_leaves_rigid_motions_alone_is_noted(opened: Callable[..., Run]) -> None:
    """A cantilever has a hundredth of alpha / 2 w: its first mode is nearly a rigid motion of the free body."""
    run = opened("components.arm.damping={rayleigh: {alpha: 2.0}}", "balance=null", text=CANTILEVER)
    first = run.model.assembled.resonances(run.scene.configurations[0])
    assert 0 < first.zeta[0] < 0.02 / first.omega[0]
    (note,) = (note for note in run.flexible("arm").notes if "alpha" in note)
    assert "on its elastic modes alone" in note and "(`grounded`)" in note
    stiff = opened("components.arm.damping={rayleigh: {beta: 1e-5}}", text=CANTILEVER)
    assert not any("alpha" in note for note in stiff.flexible("arm").notes)


def test_units_in_which_no_material_has_such_waves_are_noted(opened: Callable[..., Run]) -> None:
    """The files are in m and s: seconds read as milliseconds make waves a thousand times as fast."""
    (note,) = (note for note in opened("components.arm.units=m-kg-ms").flexible("arm").notes if "units" in note)
    assert note.startswith("arm: in m-kg-ms the matrices have waves of ") and "as no material has; in m-kg-s" in note
    assert not any("units" in note for note in opened().flexible("arm").notes)


def test_a_body_said_to_be_held_that_floats_is_refused(opened: Callable[..., Run]) -> None:
    with pytest.raises(DofMapError, match="`grounded: true` says that the ground holds the body, but"):
        _ = opened("components.arm.grounded=true").bodies


def test_a_body_that_is_held_has_no_rigid_modes(opened: Callable[..., Run], study: Path) -> None:
    body = arm()
    K = body.K.toarray()
    # Springs to the ground along and about x leave four motions.
    K[[0, 3], [0, 3]] += 1e6
    write_body(study.parent, FEModel("arm", sp.csc_array(K), body.M, body.dofs, body.nodes))
    run = opened("components.arm.grounded=true", "scene.articulation=null")
    assert run.bodies["arm"].rigid.shape[1] == 4
    system = run.model.assembled.system(run.scene.configurations[0])
    assert system.rigid.shape[1] == 5


def test_a_single_point_is_a_body(opened: Callable[..., Run], study: Path) -> None:
    """A lump with six dofs and no stiffness is all rigid motion, and reduces to that."""
    at = Nodes.in_basic([1], [[0.8, 0, 0]])
    mass = sp.csc_array(np.diag([2, 2, 2, 0.1, 0.1, 0.1]))
    dofs = DofTable(np.ones(6, dtype=int), np.arange(1, 7))
    write_body(study.parent, FEModel("panel", sp.csc_array((6, 6)), mass, dofs, at))
    run = opened("scene.sensors.probe={at: panel.1, measure: z}")
    result = execute(run, study, report=False)
    assert result is not None and result.passed
    assert (run.modal("panel").rigid_count, run.modal("panel").elastic_count) == (6, 0)
    # The same as a rigid body of this mass.
    rigid = opened(
        "scene.sensors.probe={at: lump.cg, measure: z}",
        "scene.joints.hinge.connect=[arm.tip, lump.end]",
        text=PIPELINE.partition("  panel:")[0]
        + "  lump:\n    rigid: {{mass: 2, cg: [0.8, 0, 0], inertia: [0.1, 0.1, 0.1, 0, 0, 0]}}\n"
        + "    interfaces: {{end: {{position: [0.8, 0, 0]}}}}\n  hub:"
        + PIPELINE.partition("  hub:")[2].replace("panel.root", "lump.end").replace("panel.6", "lump.cg"),
    )
    w = 2 * np.pi * np.array([3.0, 21.0, 55.0])
    for ours, theirs in zip(run.scene.configurations, rigid.scene.configurations, strict=True):
        expected = rigid.comparison.reference.assembled.response(theirs, w)
        np.testing.assert_allclose(run.comparison.reference.assembled.response(ours, w), expected, rtol=1e-8)


def test_rigid_bodies_alone_are_a_system(opened: Callable[..., Run], study: Path) -> None:
    text = (
        "name: pair\noutput: {output}\ncomponents:\n"
        "  a: {{rigid: {{mass: 1, inertia: [1, 1, 1, 0, 0, 0]}}, interfaces: {{x: {{position: [1, 0, 0]}}}}}}\n"
        "  b: {{rigid: {{mass: 1, cg: [2, 0, 0], inertia: [1, 1, 1, 0, 0, 0]}}, "
        "interfaces: {{x: {{position: [1, 0, 0]}}}}}}\n"
        "scene:\n  band: 1 Hz\n  joints: {{h: {{connect: [a.x, b.x], free: [rz]}}}}\n"
        "  actuators: {{m: {{joint: h}}}}\n  sensors: {{turn: {{joint: h}}}}\nverify: {{}}\nwrite: {{}}\n"
    )
    run = opened(text=text)
    result = execute(run, study, report=False)
    assert result is not None and result.verdict.word == "not checked"
    w = np.array([1.0, 3.0])
    H = run.comparison.reference.assembled.response(run.scene.configurations[0], w)[:, 0, 0]
    # The pair is its own mirror image: both centres of mass stay, and each body turns with its inertia about its own.
    np.testing.assert_allclose(H, -2 / w**2, rtol=1e-10)


def test_bodies_that_are_not_reduced_join_as_they_are(opened: Callable[..., Run], study: Path) -> None:
    run = opened("reduce=null", "balance=null", "components.panel.reduce={cutoff: 15}")
    result = execute(run, study, report=False)
    assert result is not None and set(result.components) == {"panel"}
    assert any(note.startswith("arm: not reduced") for note in result.notes)
    assert 0 < result.worst()["frf_error"] < 0.03
    assert sorted(path.name for path in (study.parent / "out").glob("*.h5")) == ["arm.h5", "panel.h5", "system.h5"]
    none = opened("reduce=null", "balance=null")
    assert errors(none) == {"frf_error": 0.0, "db_error": 0.0, "frequency_error": 0.0}


@pytest.mark.parametrize("damping", ["{modal: 0.01}", "{structural: 0.02}"])
def test_the_files_of_a_body_that_is_not_reduced_hold_all_its_modes(
    opened: Callable[..., Run], study: Path, damping: str
) -> None:
    """Its frequencies and the motions of its points are those of its matrices."""
    run = opened(
        "reduce=null", "balance=null", f"components.arm.damping={damping}", "write.formats=[hdf5]", "verify=null"
    )
    result = execute(run, study, report=False)
    assert result is not None and any("arm: not reduced; its files hold all its 30 modes" in n for n in result.notes)
    body, file = run.bodies["arm"].body, read_component(study.parent / "out" / "arm.h5")
    exact = np.sqrt(la.eigh(body.K.toarray(), body.M.toarray(), eigvals_only=True)[6:])
    np.testing.assert_allclose(file.omega[6:], exact, rtol=1e-6)
    assert file.omega.size == body.n and file.rigid_count == 6
    # Flexibility at the tip under a load that leaves the centre of mass alone: what M^-1 leaves of it.
    shapes = file.arrays["interfaces/tip/shapes"]
    np.testing.assert_allclose(
        shapes @ shapes.T,
        np.linalg.inv(body.M.toarray())[-6:, -6:],
        rtol=1e-6,
        atol=1e-6 * abs(shapes @ shapes.T).max(),
    )


def test_files_of_a_large_body_that_is_not_reduced_are_refused(
    opened: Callable[..., Run], study: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cmsreduce.pipeline.run.reading.WRITTEN_LIMIT", 29)
    run = opened("reduce=null", "balance=null", "components.panel.reduce={cutoff: 15}")
    with pytest.raises(ConfigError, match=r"'arm': `write.formats` asks for its files.*30 dofs.*components.arm.reduce"):
        execute(run, study, report=False)
    assert not list((study.parent / "out").glob("*.h5"))
    assert execute(opened("reduce=null", "balance=null", "write=null"), study, report=False) is not None


FREE_ARM = (
    """\
name: free_arm
output: {output}
components:
"""
    + ARM_FILES
    + """\
    damping: {{modal: 0.01}}
scene:
  band: 60 Hz
  actuators: {{thruster: {{at: arm.5, force: [0, 0.6, 0.8]}}}}
  sensors: {{end: {{at: arm.5, measure: [y, z]}}}}
reduce: {{cutoff: 2}}
"""
)


def test_a_lone_free_body_answers_its_thruster(opened: Callable[..., Run]) -> None:
    """Nothing holds it, so it has free modes, and the thruster's static shapes beside them."""
    run = opened(text=FREE_ARM)
    modal = run.modal("arm")
    assert modal.rigid_count == 6
    assert run.reduced("arm").modes.kind.count("residual") == 2
    # Far below its first mode, at 139 Hz, the elastic answer is the static one, and that is held exactly; what lags is
    # the damping of modes that are cut off.
    w = 2 * np.pi * np.array([0.5, 1.0])
    (configuration,) = run.scene.configurations
    elastic = [
        model.response(configuration, w) - model.rigid_response(configuration, w)
        for model in (run.comparison.reference.assembled, run.model.assembled)
    ]
    np.testing.assert_allclose(elastic[1].real, elastic[0].real, rtol=1e-8)


def test_mass_proportional_damping_of_a_floating_body_acts_on_its_modes(opened: Callable[..., Run]) -> None:
    """alpha M without its action on rigid motion fills the matrix: the reference is in modes, whatever the size."""
    alpha = 2.0
    run = opened(f"components.arm.damping={{rayleigh: {{alpha: {alpha}, beta: {BETA}}}}}", text=FREE_ARM)
    reference = run.references["arm"]
    assert reference.label == "all modes"
    damping = run.bodies["arm"].substructure(run.scene, reference.modes).D.diagonal()
    np.testing.assert_allclose(damping[:6], 0, atol=0)
    np.testing.assert_allclose(damping[6:], alpha + BETA * reference.modes.omega[6:] ** 2, rtol=1e-12)
    assert (
        opened(f"components.arm.damping={{rayleigh: {{beta: {BETA}}}}}", text=FREE_ARM).references["arm"].modes is None
    )
