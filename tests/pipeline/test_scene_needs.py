"""A run computes only what the scene needs: no bodies off every path, less with one channel less."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cmsreduce.config import load_pipeline
from cmsreduce.pipeline import Run, Silent, execute
from cmsreduce.pipeline.bodies import probing_loads
from tests.pipeline.study import PIPELINE

GALILEO = Path(__file__).parents[2] / "pipelines" / "galileo.yaml"

# The panel leaves the arm for the wall beside it: what the ground holds passes nothing on.
CUT = (
    PIPELINE.replace("    hinge: {{connect: [arm.tip, panel.root], free: [ry]}}\n", "")
    .replace("  articulation:\n    hinge: [0, 50 deg]\n", "  ground: panel.root\n")
    .replace("    motor: {{joint: hinge, dof: ry}}\n", "")
    .replace("    probe: {{at: panel.6, measure: [z]}}\n", "")
)


def test_a_body_off_every_path_stays_rigid_at_no_cost(opened: Callable[..., Run], study: Path) -> None:
    run = opened(text=CUT)
    execute(run, study, report=False)
    assert run.modal("panel").elastic_count == 0 and run.modal("panel").rigid_count == 6
    assert run.modal("arm").elastic_count > 0
    (note,) = [note for note in run.stages.notes if note.startswith("panel: no chain of joints leads from it")]
    assert "an actuator or a sensor; it is kept rigid" in note and "error 0" in note
    # No eigenproblem, no factor: nothing is factorised to reduce it.
    assert not run.stages.factorised["panel"]["reduce"] and run.stages.factorised["arm"]["reduce"]
    # The mass properties are the body's own: its rigid modes are all of its momentum.
    part = json.loads((run.folder / "summary.json").read_text())["components"]["panel"]
    assert (part["kept_modes"], part["rigid_modes"]) == (0, 6)
    # The error shown is that of the others: the full model with the panel flexible answers the same.
    flexible = opened("balance.keep={modes: {panel: 5}}", text=CUT)
    assert flexible.modal("panel").elastic_count > 0
    omega = 2 * np.pi * np.linspace(1, 60, 50)
    (configuration,) = run.scene.configurations
    one, other = (each.model.assembled.response(configuration, omega) for each in (run, flexible))
    np.testing.assert_allclose(one, other, rtol=0, atol=1e-9 * abs(other).max())


def test_a_scene_without_a_response_keeps_every_body(opened: Callable[..., Run]) -> None:
    run = opened("scene.actuators={}", text=CUT)
    assert not run.mode_sets.unneeded
    assert run.modal("panel").elastic_count > 0


# A second experiment on Galileo: a thruster and an accelerometer on the science boom of the rotor.
BOOM = (
    "scene.actuators.thruster={at: rotor.%d, force: [0, 0, 1]}",
    "scene.sensors.tip={at: rotor.%d, measure: [z]}",
)
ONE = ("scene.articulation={spin: [45 deg], cone: [30 deg]}", "balance.keep={frf_error: 0.05}", "verify=null")


@pytest.fixture(scope="module")
def boom(tmp_path_factory: pytest.TempPathFactory) -> int:
    """A node of the rotor far from its bearing."""
    run = Run(load_pipeline(GALILEO), tmp_path_factory.mktemp("boom"), Silent())
    nodes = run.bodies["rotor"].body.nodes
    assert nodes is not None
    inside = np.isin(nodes.id, run.bodies["rotor"].body.dofs.node)
    return int(nodes.id[inside][np.argmax(np.linalg.norm(nodes.xyz[inside][:, :2], axis=1))])


@pytest.fixture(scope="module")
def rich(boom: int, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Galileo with all of its channels."""
    return galileo(tmp_path_factory.mktemp("rich"), [text % boom for text in BOOM])


def galileo(folder: Path, channels: list[str]) -> Run:
    run = Run(load_pipeline(GALILEO, [*ONE, *channels]), folder, Silent())
    execute(run, GALILEO, report=False)
    return run


@pytest.mark.parametrize("without", [0, 1], ids=["no thruster", "no accelerometer"])
def test_a_channel_less_makes_galileo_smaller(tmp_path: Path, boom: int, rich: Run, without: int) -> None:
    poor = galileo(tmp_path, [BOOM[1 - without] % boom])
    runs = (rich, poor)

    def modes(run: Run) -> int:
        return sum(kept.elastic_count for kept in run.kept.values())

    def size(run: Run) -> int:
        return sum(path.stat().st_size for path in run.folder.glob("*.h5"))

    assert modes(poor) < modes(rich)
    assert size(poor) < size(rich)
    # An actuator's dof is a constraint mode; a sensor's row is a solve for the flexibility its basis may lack.
    static = [run.reduced("rotor").modes.kind.count("constraint") for run in runs]
    probed = [probing_loads(run.bodies["rotor"], run.scene, joints=False)[1].shape[1] for run in runs]
    less = (static[0] - static[1], probed[0] - probed[1])
    assert less == ((1, 0) if without == 0 else (0, 1))


def test_what_nobody_asked_for_is_not_formed(
    opened: Callable[..., Run], study: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without component files no modal integrals; without verify no full system; only the settings of the scene."""

    def refuse(*_: object, **__: object) -> None:
        raise AssertionError("formed, although nothing asks for it")

    monkeypatch.setattr("cmsreduce.write.component.integrals.modal_integrals", refuse)
    monkeypatch.setattr("cmsreduce.pipeline.run.run.Run.reference", refuse)
    settings = ("balance.keep={modes: 3}", "verify=null", "scene.articulation={hinge: [50 deg]}")
    run = opened("write=null", *settings)
    execute(run, study, report=False)
    assert (run.folder / "summary.json").is_file() and not list(run.folder.glob("*.h5"))
    assert [names for method, names in run.model.assembled._results if method == "system"] == [("hinge=50",)]
    # Shapes are those of the points that the scene names, and of no other node.
    assert set(run.model.assembled.substructures["arm"].motion) == {"1", "5"}
    assert set(run.model.assembled.substructures["panel"].motion) == {"1", "6"}
