"""What a finished run says of its static loads, gains and zeros, against its own full system."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from cmsreduce.cli import main
from cmsreduce.linalg.dense import dense
from cmsreduce.pipeline import Run
from cmsreduce.pipeline.reduction_health import channel_gains, static_lack, zeros_apart


def test_interfaces_are_complete_until_modes_are_dropped(opened: Callable[..., Run]) -> None:
    lack = {each.load: each.lack for each in static_lack(opened(), "arm")}
    assert set(lack) == {"interface 'root'", "interface 'tip'"}
    assert max(lack.values()) < 1e-9
    fewer = {each.load: each.lack for each in static_lack(opened("balance.keep={modes: {arm: 4}}"), "arm")}
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
    pairs = zeros_apart(run.comparison.full, run.model.assembled, configuration)
    assert [(pair.output, pair.input) for pair in pairs] == [(y, u) for y in range(3) for u in range(2)]
    shifts = np.concatenate([pair.shift for pair in pairs])
    assert shifts.size > 10 and shifts.max() < 1e-4
    # The undamped response of the unreduced system, solved from its matrices, vanishes there.
    system = run.comparison.full.system(configuration)
    K, M = dense(system.K), dense(system.M)
    zero = next(z for z in pairs[0].full if abs(z.real) < 1e-9 * abs(z) and abs(z) > 2 * np.pi).imag
    at, beside = (
        abs((system.C1 + system.C2)[0] @ np.linalg.solve(K - w**2 * M, system.B[:, 0])) for w in (zero, 1.001 * zero)
    )
    assert at < 1e-4 * beside


@pytest.mark.parametrize("bad", ["", "stages"])
def test_inspect_of_a_run_directory(finished_study: Path, bad: str) -> None:
    said = CliRunner().invoke(main, ["inspect", str(finished_study / ("out" if not bad else "nowhere"))])
    if bad:
        assert said.exit_code == 2 and "no such file" in said.stderr
        return
    assert said.exit_code == 0, said.stderr
    assert "interface 'tip': " in said.stdout
    assert "zeros in the band from motor to " in said.stdout
