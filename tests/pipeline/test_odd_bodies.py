"""Bodies that rankings could trip over, through whole runs: no outputs, rigid, undamped and idle modes."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from cmsreduce.cli import main
from cmsreduce.pipeline import Run, execute
from tests.pipeline.study import CANTILEVER, PIPELINE

DAMPED = ("gregory", "hankel", "component-cost", "system-cost")
ALL = (*DAMPED, "modal-gain", "frequency")

# The panel flies by itself, and a jet on it is all that it has to do with the scene.
ALONE = (
    PIPELINE.replace("    hinge: {{connect: [arm.tip, panel.root], free: [ry]}}\n", "")
    .replace("  articulation:\n    hinge: [0, 50 deg]\n", "  floating: [panel]\n")
    .replace("    motor: {{joint: hinge, dof: ry}}\n", "    jet: {{at: panel.6, force: [0, 0, 1]}}\n")
    .replace("    probe: {{at: panel.6, measure: [z]}}\n", "")
    .replace("    interfaces: {{root: {{node: 1}}}}\n", "")
)

# The arm flies free, moved and measured in one plane.
IN_PLANE = (
    CANTILEVER.replace("  ground: arm.root\n", "")
    .replace("    interfaces: {{root: {{node: 1}}}}\n", "")
    .replace("    push: {{at: arm.5, force: [0, 1, 0]}}\n", "")
    .replace("    across: {{at: arm.4, measure: y}}\n", "")
)


@pytest.mark.parametrize("rank", ALL)
def test_a_body_with_an_input_and_no_output(opened: Callable[..., Run], rank: str) -> None:
    """It stays rigid by any rule that asks for what is needed, and is ranked where modes are asked for by number."""
    run = opened(f"balance={{rank: {rank}, keep: {{fraction: 0.1}}}}", text=ALONE)
    assert run.kept["panel"].elastic_count == 0 and run.kept["panel"].rigid_count == 6
    assert any("panel: no chain of joints leads from it to a sensor" in note for note in run.stages.notes)
    run = opened(f"balance={{rank: {rank}, keep: {{modes: {{panel: 3}}}}}}", text=ALONE)
    sigma = run.ranked["panel"].sigma[6:]
    assert np.isfinite(sigma).all() and run.kept["panel"].elastic_count == 3
    if rank == "system-cost":
        # No response depends on it, so that its modes cost nothing.
        assert sigma.max() < 1e-20 * np.nanmax(run.ranked["arm"].sigma)


@pytest.mark.parametrize("rank", ALL)
def test_rigid_modes_have_no_coefficient_and_are_always_kept(opened: Callable[..., Run], rank: str) -> None:
    run = opened(f"balance={{rank: {rank}, keep: {{modes: 2}}}}")
    for component in (*run.ranked.values(), *run.kept.values()):
        assert component.rigid_count == 6
        assert np.isnan(component.sigma[:6]).all() and np.isfinite(component.sigma[component.elastic]).all()
        for values in component.rankings.values():
            assert np.isnan(values[:6]).all() and np.isfinite(values[component.elastic]).all()
    assert set(run.kept["arm"].why[:6]) == {"rigid body"} and run.kept["arm"].elastic_count == 2


@pytest.mark.parametrize("rank", DAMPED)
def test_an_undamped_body_has_no_gramian_and_the_run_says_so(study: Path, rank: str) -> None:
    text = study.read_text().replace("    damping: {modal: 0.01}\n", "", 1)
    study.write_text(text.replace("balance: {rank: gregory,", f"balance: {{rank: {rank},"))
    found = CliRunner().invoke(main, ["run", str(study), "--quiet"])
    said = " ".join(found.output.split())
    assert found.exit_code == 2 and "Traceback" not in said
    assert "arm" in said and "damping" in said and "modal-gain" in said, said
    if rank != DAMPED[0]:
        return
    # What was finished before is kept: another ranking goes on from there.
    asked = ["run", str(study), "--set", "balance.rank=modal-gain", "--set", "verify=null", "--verbose"]
    found = CliRunner().invoke(main, asked)
    assert found.exit_code == 0, found.output
    assert "finished before, reused" in found.output and "arm: no damping is given" in found.output


def test_an_undamped_body_beside_damped_ones(opened: Callable[..., Run], study: Path) -> None:
    """A body with a ranking of its own that needs no damping; the others are ranked as ever."""
    own = "components.arm.balance={rank: modal-gain, keep: {modes: 3}}"
    run = opened("components.arm.damping=null", own, "write=null", "scene.articulation={hinge: [0 deg]}")
    execute(run, study, report=False)
    assert run.kept["arm"].elastic_count == 3 and set(run.ranked["arm"].rankings) == {"modal-gain", "frequency"}
    assert np.isfinite(run.ranked["panel"].sigma[6:]).all() and "hankel" in run.ranked["panel"].rankings
    assert (run.ranked["arm"].zeta == 0).all()
    assert json.loads((run.folder / "summary.json").read_text())["worst"]["frf_error"] > 0


@pytest.mark.parametrize("rank", [rank for rank in ALL if rank != "frequency"])
def test_modes_that_take_no_part_are_worth_nothing(opened: Callable[..., Run], rank: str) -> None:
    """Modes of the other plane, of stretching and of twisting: zero to rounding, and left out by any fraction."""
    run = opened(f"balance={{rank: {rank}, keep: {{fraction: 1e-12}}}}", text=IN_PLANE)
    component = run.ranked["arm"]
    e, axis = component.elastic, component.body.dofs.component
    idle = abs(component.Phi[np.isin(axis, [3, 5])][:, e]).max(axis=0) < 1e-6 * abs(component.Phi[:, e]).max(axis=0)
    sigma = component.sigma[e]
    assert 0 < np.count_nonzero(idle) < idle.size
    assert np.isfinite(sigma).all() and sigma[idle].max() < 1e-12 * sigma[~idle].max()
    np.testing.assert_array_equal(run.selection["arm"], e.start + np.flatnonzero(~idle))
