"""A controller that a scene names, against the poles of both closed loops."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la
from click.testing import CliRunner

from cmsreduce.assemble import state_space
from cmsreduce.cli import main
from cmsreduce.pipeline import Run
from cmsreduce.pipeline.system import system_roots

CONTROLLER = """\
# The rate of the hub in yaw drives the thruster, over a lag of second order.
A
0 1
{w2} {lag}
B
0 0 0
0 {b} 0
C
0 0
{gain} 0
"""


def controller(gain: float, w: float = 60.0) -> str:
    return CONTROLLER.format(w2=-(w**2), lag=-1.4 * w, b=w**2, gain=gain)


@pytest.fixture
def controlled(study: Path, opened: Callable[..., Run]) -> Callable[..., Run]:
    def make(gain: float, *overrides: str) -> Run:
        (study.parent / "k.txt").write_text(controller(gain))
        return opened(f"scene.controller={study.parent / 'k.txt'}", *overrides)

    return make


def loops(run: Run, full: bool) -> np.ndarray:
    """Roots of the loop closed around either system in the first configuration."""
    model = run.comparison.reference.assembled if full else run.model.assembled
    plant, k = state_space(model.system(run.scene.configurations[0])), run.controller
    closed = np.block([[plant.A, -plant.B @ k.C], [k.B @ plant.C, k.A]])
    return la.eigvals(closed)


@pytest.mark.parametrize("gain", [-20.0, -2.0, -0.2, 0.2, 2.0, 20.0, 200.0])
def test_what_is_proven_is_so(controlled: Callable[..., Run], gain: float) -> None:
    run = controlled(gain)
    margin = run.margins[0]
    growing = int(np.count_nonzero(loops(run, full=False).real > 1e-5 * 2 * np.pi * 60))
    assert margin.unstable == growing
    if margin.ratio < 1 and not growing:
        assert loops(run, full=True).real.max() <= 1e-5 * 2 * np.pi * 60
    assert 0 < margin.worst_hz <= 60 * (1 + 1e-9)
    at = margin.frequency_hz == margin.worst_hz
    assert margin.ratio == pytest.approx((margin.spillover / margin.borne)[at][0])


def test_a_mode_above_the_band_that_the_controller_makes_unstable_fails_the_run(study: Path) -> None:
    """Over the band nothing is wrong: the reduced loop is stable, and the ratio is 0.04."""
    (study.parent / "k.txt").write_text("D\n0 0 -10\n0 0 0\n")
    keys = [f"scene.controller={study.parent / 'k.txt'}", "scene.band=12 Hz", "reduce.cutoff=1"]
    said = CliRunner().invoke(main, ["run", str(study), "--quiet", *(w for key in keys for w in ("--set", key))])
    facts = json.loads((study.parent / "out" / "summary.json").read_text())
    ratio, roots = (facts["figures"][name] for name in ("controller_ratio", "controller_unstable"))
    assert ratio["passed"] is True and roots["passed"] is False, facts["controller"]
    assert "the loop with the reference model" in roots["where"]
    assert said.exit_code == 1 and facts["verdict"]["word"] == "FAIL"
    assert all(row["unstable_roots"] == 0 for row in facts["controller"])
    assert any(row["unstable_roots_full"] for row in facts["controller"])
    assert not any(row["proven"] for row in facts["controller"] if row["unstable_roots_full"])


def test_a_motor_between_two_bodies_moves_no_free_system(study: Path, opened: Callable[..., Run]) -> None:
    """It leaves centre of mass and angular momentum, whatever it follows: twelve roots at zero, none of which grows."""
    (study.parent / "k.txt").write_text("D\n0 0 2\n0 0 0\n")
    spring = "scene.joints.hinge.stiffness={ry: 300}"
    run = opened(f"scene.controller={study.parent / 'k.txt'}", spring)
    assert [(margin.unstable, margin.unstable_full) for margin in run.margins] == [(0, 0), (0, 0)]
    # Of a sensor in the hinge, too.
    run = opened(f"scene.controller={study.parent / 'k.txt'}", spring, "scene.sensors.probe={joint: hinge, dof: ry}")
    found = system_roots(run.model.assembled, run.scene.configurations[0], run.controller)
    assert found is not None and np.count_nonzero(abs(found.s) < 1e-12) == 12


def test_the_ratio_of_one_channel_by_hand(controlled: Callable[..., Run]) -> None:
    """One signal, one effort: |dG k| / |1 + G_r k| with the response between them alone."""
    run = controlled(2.0)
    margin, result = run.margins[0], run.verified.configurations[0]
    s = 2j * np.pi * result.response.frequency_hz
    k = 2.0 * 60.0**2 / (s**2 + 1.4 * 60.0 * s + 60.0**2)
    G, G_r = (H[:, 1, 1] for H in (result.response.full, result.response.reduced["reduced"]))
    np.testing.assert_allclose(margin.spillover, abs((G - G_r) * k), rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(margin.borne, abs(1 + G_r * k), rtol=1e-9)


def test_a_controller_that_is_not_safe_fails_the_run(study: Path) -> None:
    (study.parent / "k.txt").write_text(controller(-200.0))
    out = study.parent / "out"
    said = CliRunner().invoke(
        main, ["run", str(study), "--set", f"scene.controller={study.parent / 'k.txt'}", "--quiet"]
    )
    facts = json.loads((out / "summary.json").read_text())
    assert said.exit_code == 1 and not facts["passed"]
    assert facts["figures"]["controller_unstable"]["passed"] is False
    assert [row["configuration"] for row in facts["controller"]] == ["hinge=0", "hinge=50"]
    assert all(row["unstable_roots"] and row["proven"] is False for row in facts["controller"])
    checked = CliRunner().invoke(main, ["check", str(out)])
    assert checked.exit_code == 1 and "FAIL  controller_unstable" in checked.stdout
    inspected = CliRunner().invoke(main, ["inspect", str(out)])
    assert "does not prove the full loop stable; the reduced loop has" in inspected.stdout
    # Nothing is computed anew for another controller.
    (study.parent / "k.txt").write_text(controller(-0.002))
    asked = ["run", str(study), "--set", f"scene.controller={study.parent / 'k.txt'}", "--verbose"]
    again = CliRunner().invoke(main, asked)
    assert again.exit_code == 0, again.output
    assert "verify        system (finished before, reused)" in again.stderr
    assert "controller spillover" in again.stdout


def test_a_loop_whose_roots_are_not_known_fails_the_run(study: Path) -> None:
    """Structural damping has no state space: nothing shows that the reduced loop is stable, whatever the ratio is."""
    (study.parent / "k.txt").write_text(controller(-2e-6))
    keys = [f"scene.controller={study.parent / 'k.txt'}", "components.panel.damping={structural: 0.01}"]
    said = CliRunner().invoke(main, ["run", str(study), *(word for key in keys for word in ("--set", key))])
    facts = json.loads((study.parent / "out" / "summary.json").read_text())
    ratio, roots = (facts["figures"][name] for name in ("controller_ratio", "controller_unstable"))
    assert ratio["passed"] is True and roots["passed"] is False and roots["value"] is None
    assert said.exit_code == 1 and facts["verdict"]["word"] == "FAIL", said.output
    assert "unstable loop roots: hinge=0: not measured: the roots of the reduced loop are not known" in said.stdout
    assert "unproven  stability of the system: the controller may give energy" in said.stdout
    assert "compare mass" not in said.stdout


def test_a_root_that_grows_slowly_fails_the_run(study: Path) -> None:
    """A gain of the wrong sign, however small, accelerates the hub: its time constant is an hour."""
    (study.parent / "k.txt").write_text(controller(0.002))
    said = CliRunner().invoke(
        main, ["run", str(study), "--set", f"scene.controller={study.parent / 'k.txt'}", "--quiet"]
    )
    facts = json.loads((study.parent / "out" / "summary.json").read_text())
    assert said.exit_code == 1 and facts["verdict"]["word"] == "FAIL"
    (found,) = (proof for proof in facts["verdict"]["proofs"] if proof["what"] == "stability")
    assert found["state"] == "refuted" and "grows" in found["remark"] and "'hinge=" in found["remark"]


BAD = {
    "no file": ("none.txt", "none.txt", "no such file"),
    "wrong size": ("{folder}/small.txt", "D is 1 x 1, but must be 2 x 3", "gyro.ry, gyro.rz, probe"),
    "unknown key": ("{{path: small.txt}}", "scene.controller.path", "file"),
}


@pytest.mark.parametrize(("value", "first", "second"), BAD.values(), ids=BAD)
def test_a_wrong_controller_is_refused_at_once(study: Path, value: str, first: str, second: str) -> None:
    (study.parent / "small.txt").write_text("D\n1\n")
    said = CliRunner().invoke(
        main, ["run", str(study), "--set", f"scene.controller={value.format(folder=study.parent)}", "--quiet"]
    )
    assert said.exit_code == 2 and said.stderr.startswith("error: "), said.output
    assert first in said.stderr and second in said.stderr, said.stderr
    assert not (study.parent / "out" / "summary.json").exists()
