"""What a finished run says of its static loads, gains, zeros and steps, against its own full system."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from cmsreduce.assemble import elastic_states
from cmsreduce.cli import main
from cmsreduce.linalg.blocks import dense
from cmsreduce.model import Configuration, ReductionChecks
from cmsreduce.pipeline import Run, inspected
from cmsreduce.pipeline.store import decode, encode
from cmsreduce.pipeline.system import AssembledModel, channel_gains
from cmsreduce.pipeline.system.reduction_health import all_modes, step_compared, unit_loads, zeros_apart
from tests.golden.test_hinge import joined


def lack_of(run: Run, name: str) -> dict[str, float]:
    return unit_loads(run.bodies[name], run.scene).probes(run.final[name]).lack()


def test_interfaces_are_complete_until_modes_are_dropped(opened: Callable[..., Run]) -> None:
    lack = lack_of(opened(), "arm")
    assert set(lack) == {"interface 'root'", "interface 'tip'"}
    assert max(lack.values()) < 1e-9
    fewer = lack_of(opened("balance.keep={modes: {arm: 4}}"), "arm")
    # The arm is straight: among the static shapes is its stretch, which no bending mode can replace.
    assert fewer["interface 'tip'"] > 0.1


def test_gains_sum_to_the_static_response(opened: Callable[..., Run]) -> None:
    run = opened()
    configuration = run.scene.configurations[1]
    found = channel_gains(run.model.assembled, configuration)
    w = np.array([2 * np.pi * 0.02])
    H = run.model.assembled.response(configuration, w) - run.model.assembled.rigid_response(configuration, w)
    rates = run.model.assembled.system(configuration).C2.any(axis=1)
    expected = H[0] / np.where(rates, 1j * w[0], 1.0)[:, None]
    # Dynamics of the first mode at 8 Hz add (0.02 / 8)^2; damping turns the phase by less.
    np.testing.assert_allclose(found.total, expected.real, rtol=1e-4, atol=1e-4 * abs(expected).max())


def test_zeros_are_off_by_no_more_than_the_poles(opened: Callable[..., Run]) -> None:
    run = opened()
    configuration = run.scene.configurations[0]
    both = [all_modes(model, configuration) for model in (run.comparison.reference.assembled, run.model.assembled)]
    pairs = zeros_apart(*both, run.model.assembled, configuration)
    assert [(pair.output, pair.input) for pair in pairs] == [(y, u) for y in range(3) for u in range(2)]
    shifts = np.concatenate([pair.shift for pair in pairs])
    assert shifts.size > 10 and shifts.max() < 1e-4
    # The undamped response of the unreduced system, solved from its matrices, vanishes there.
    system = run.comparison.reference.assembled.system(configuration)
    K, M = dense(system.K), dense(system.M)
    zero = next(z for z in pairs[0].full if abs(z.real) < 1e-9 * abs(z) and abs(z) > 2 * np.pi).imag
    at, beside = (
        abs((system.C1 + system.C2)[0] @ np.linalg.solve(K - w**2 * M, system.B[:, 0])) for w in (zero, 1.001 * zero)
    )
    assert at < 1e-4 * beside


def test_the_hinge_of_a_run() -> None:
    """Theory section 7: the stiff mode is flagged in the full system; without it the lowest zero moves most."""
    subs, scene = joined(1e-7, "modes")
    scene = replace(scene, band=(0.0, 20.0))
    configuration = Configuration("as built")
    model = AssembledModel(subs, scene)
    full = all_modes(model, configuration)
    (high,) = full.gains.high_gain_modes(scene.band[1])
    assert (high.hz, high.gain) == (pytest.approx(645.85, abs=5e-3), pytest.approx(0.603266, abs=5e-7))
    others = np.arange(full.omega.size) != np.argmin(abs(full.omega - 2 * np.pi * 645.85))
    without = replace(full, omega=full.omega[others], B=full.B[others], C=full.C[:, others])
    (pair,) = zeros_apart(full, without, model, configuration)
    hz = [zeros.imag[:4] / (2 * np.pi) for zeros in (pair.full, pair.reduced)]
    np.testing.assert_allclose(hz[0], [0.324460, 3.110220, 6.032206, 15.098271], rtol=1e-5)
    np.testing.assert_allclose(hz[1], [0.79687, 3.12769, 8.00668, 17.3283], rtol=3e-5)
    assert pair.shift.argmax() == 0 and pair.worst == pytest.approx(0.7968808 / 0.324460 - 1, rel=1e-4)


def test_a_step_is_a_sum_over_complex_modes(opened: Callable[..., Run]) -> None:
    run = opened("balance.keep={modes: {arm: 8, panel: 8}}")
    configuration = run.scene.configurations[0]
    found = step_compared(run.comparison.reference.assembled, run.model.assembled, configuration)
    for model, steps in ((run.comparison.reference.assembled, found.full), (run.model.assembled, found.reduced)):
        states = elastic_states(model.system(configuration))
        s, V = np.linalg.eig(states.A)
        modal = np.linalg.solve(V, states.B)
        for k in (0, 7, -1):
            grown = (np.exp(s * found.time[k]) - 1) / s
            expected = (states.C @ V @ (grown[:, None] * modal)).real + states.D
            size = abs(steps).max(axis=(0, 2))[:, None]
            np.testing.assert_allclose(steps[k] / size, expected / size, atol=1e-8)
    miss = found.reduced - found.full
    assert (abs(miss).max(axis=0) <= found.peak * abs(found.full).max(axis=0) * 1.5 + 1e-15).all()
    assert np.nanmin(found.rms) > 0


def test_a_step_lasts_eight_periods_of_the_lowest_mode_in_any_band(opened: Callable[..., Run]) -> None:
    """Against the superposition of complex modes at random instants."""
    run = opened("scene.band=[1 Hz, 2 kHz]", "balance.keep={modes: {arm: 8, panel: 8}}")
    configuration = run.scene.configurations[0]
    models = run.comparison.reference.assembled, run.model.assembled
    found = step_compared(*models, configuration)
    lowest = models[0].resonances(configuration).omega.min() / (2 * np.pi)
    assert 8 * 16 * 2000 / lowest > 4000
    assert found.time[-1] == pytest.approx(8 / lowest)
    time = np.sort(np.random.default_rng(4).uniform(0, 8 / lowest, 20_000))
    steps = []
    for model in models:
        states = elastic_states(model.system(configuration))
        s, V = np.linalg.eig(states.A)
        modal = np.linalg.solve(V, states.B)
        grown = (np.exp(np.outer(time, s)) - 1) / s
        steps.append(np.einsum("yk,tk,ku->tyu", states.C @ V, grown, modal).real + states.D)
    miss = abs(steps[1] - steps[0])
    size = abs(steps[0]).max(axis=0)
    sure = ~np.isnan(found.peak)
    np.testing.assert_allclose(found.peak[sure], (miss.max(axis=0) / size)[sure], rtol=0.1)
    rms = np.sqrt(np.mean(miss**2, axis=0) / np.mean(steps[0] ** 2, axis=0))
    np.testing.assert_allclose(found.rms[sure], rms[sure], rtol=0.1)


def test_checks_are_stored_whole(opened: Callable[..., Run]) -> None:
    run = opened("verify.checks=[static, gains, zeros, step]")
    checks = run.checks
    again = run_again(checks)
    assert again.figures(("a", "b"), ("x", "y", "z")) == checks.figures(("a", "b"), ("x", "y", "z"))
    for old, new in zip(checks.systems, again.systems, strict=True):
        np.testing.assert_array_equal(old.step.full, new.step.full)
        np.testing.assert_array_equal(old.full_gains.running, new.full_gains.running)
        assert [pair.full.tolist() for pair in old.zeros] == [pair.full.tolist() for pair in new.zeros]


def run_again(checks: ReductionChecks) -> ReductionChecks:
    arrays, facts = encode(checks)
    return decode(arrays, json.loads(json.dumps(facts)), {})


ASKED = {
    "the usual": ((), {"static_lack", "gain_error", "zero_error", "zeros_lost"}),
    "statics alone": (("verify.checks=[static]",), {"static_lack"}),
    "none": (("verify.checks=[]",), set()),
    "by a limit": (("verify.checks=[]", "verify.limits={step_error: 0.5}"), {"step_error"}),
    "in time, too": (("verify.checks=[step, zeros]",), {"zero_error", "zeros_lost", "step_error"}),
}


@pytest.mark.parametrize(("overrides", "found"), ASKED.values(), ids=ASKED)
def test_what_is_asked_for_is_done(opened: Callable[..., Run], overrides: tuple[str, ...], found: set[str]) -> None:
    figures = opened(*overrides).checks.figures(("a", "b"), ("x", "y", "z"))
    assert set(figures) == found


def test_what_cannot_be_had_is_said(opened: Callable[..., Run]) -> None:
    law = "{structural: 0.02}"
    run = opened(f"components.arm.damping={law}", f"components.panel.damping={law}", "verify.checks=[step]")
    assert run.checks.systems[0].step is None
    (why,) = run.checks.left_out
    assert why.startswith("step: structural damping is a complex stiffness")


def test_channels_and_modes_of_the_summary(finished_study: Path) -> None:
    facts = json.loads((finished_study / "out" / "summary.json").read_text())
    for row in facts["configurations"]:
        assert max(pair["nrfd"] for pair in row["modes"]) == pytest.approx(row["frequency_error"])
        assert len(row["channels"]) == 6 and row["checks"]["step"] is None
        # The whole is a mean of the channels, weighted.
        errors = [each["frf_error"] for each in row["channels"] if each["frf_error"] is not None]
        assert min(errors) <= row["frf_error"] <= max(errors)
        for pair in row["checks"]["gains"]:
            assert pair["running"]["full"]["sum"][-1] == pytest.approx(pair["full"], rel=1e-12)
    for name, part in facts["components"].items():
        assert part["basis"]["rank"] == part["basis"]["columns"] and 1 <= part["basis"]["condition"] < 1e6
        assert part["health"]["negative_motions"] == {"stiffness": 0, "mass": 0}, name
        assert part["health"]["mass_properties"]["stiffness"]["mass"] == pytest.approx(
            part["health"]["mass_properties"]["geometry"]["mass"]
        )
    assert facts["figures"]["frf_error"]["value"] == facts["worst"]["frf_error"]
    assert facts["figures"]["static_lack"]["passed"] is None and facts["controller"] is None


@pytest.mark.parametrize("bad", ["", "stages"])
def test_inspect_of_a_run_directory(finished_study: Path, bad: str) -> None:
    said = CliRunner().invoke(main, ["inspect", str(finished_study / ("out" if not bad else "nowhere"))])
    if bad:
        assert said.exit_code == 2 and "no such file" in said.stderr
        return
    assert said.exit_code == 0, said.stderr
    assert "interface 'tip': " in said.stdout
    assert "zeros in the band from motor to " in said.stdout


def test_inspect_of_many_channels_has_the_worst(finished_study: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cmsreduce.pipeline.inspection._MOST", 3)
    facts = json.loads((finished_study / "out" / "summary.json").read_text())
    pairs = [pair for row in facts["configurations"] for pair in row["checks"]["zeros"]]
    assert not any(pair["lost"] for pair in pairs)
    lines = inspected(finished_study / "out").lines
    shown = [float(line.rpartition(" ")[2]) for line in lines if " zeros in the band from " in line]
    assert shown == [float(f"{error:.1e}") for error in sorted((pair["error"] for pair in pairs), reverse=True)[:3]]
    assert any(f"and {len(pairs) - 3} with smaller figures" in line for line in lines)
