"""Channels of a size that the user states: their unit decides nothing, their size does."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from cmsreduce.cli import main
from cmsreduce.model import ModalChannels
from cmsreduce.pipeline import Run
from cmsreduce.pipeline.choose.ranked import ranking_channels

RANK = "balance={rank: component-cost, keep: all, scaling: %s}"


def coefficients(run: Run) -> np.ndarray:
    """Coefficients of both bodies in every ranking."""
    found = [
        np.concatenate([values[c.elastic] for values in c.rankings.values()]) for c in run.balancing.ranked.values()
    ]
    return np.concatenate(found)


# A force along a slope and a sum of motions, stated anew in other units, with the size that fits.
PLAIN = (
    "scene.actuators.jet={at: panel.6, force: [0, 3, 4]}",
    "scene.sensors.los={rows: {panel.6.z: 1.0, arm.3.ry: -2.0}}",
    "scene.sensors.rate={at: arm.3, measure: [ry, z], rate: true}",
)
SIZES = "{inputs: {jet: %s, motor: %s}, outputs: {los: %s, gyro: %s, rate.ry: %s}}"


@pytest.mark.parametrize(
    ("channels", "sizes"),
    [
        # The jet in thousands of newtons, the line of sight in thousandths.
        (
            (
                "scene.actuators.jet={at: panel.6, force: [0, 3000, 4000]}",
                "scene.sensors.los={rows: {panel.6.z: 1000.0, arm.3.ry: -2000.0}}",
                PLAIN[2],
            ),
            (0.002, 4.0, 3000.0, 0.01, 0.5),
        ),
        # With a unit, a size is what the vector makes of it: 10 N are an input of 2.
        (PLAIN, ("10 N", "4000 mNm", 3.0, "0.01 rad/s", "0.5 rad/s")),
        (PLAIN, ("1e-2 kN", "4 N m", 3.0, f"{np.degrees(0.01)} deg/s", f"{np.degrees(0.5)} deg/s")),
    ],
)
def test_a_unit_with_the_size_that_fits_changes_nothing(
    opened: Callable[..., Run], channels: tuple[str, ...], sizes: tuple[object, ...]
) -> None:
    own = coefficients(opened(RANK % (SIZES % (2.0, 4.0, 3.0, 0.01, 0.5)), *PLAIN))
    other = coefficients(opened(RANK % (SIZES % sizes), *channels))
    np.testing.assert_allclose(other, own, rtol=1e-9, atol=1e-12 * own.max())


def channels(run: Run, body: str) -> ModalChannels:
    keys = run.pipeline.balance
    rows = run.balancing._sized(body, keys, {name: run.modal(name) for name in run.reduced_names})
    return ranking_channels(run.modal(body), run.bodies[body].ports, keys, run.scene, rows)


def test_only_the_direction_of_a_channel_is_sized(opened: Callable[..., Run]) -> None:
    """B B^T is the sum over directions: with a size of s along d it changes by (s^2 - 1) b b^T."""
    text = "scene.actuators.jet={at: panel.6, force: [0, 3, 4]}"
    bare = channels(opened("balance.keep=all", text), "panel")
    run = opened("balance.keep=all", text, "balance.scaling={inputs: {jet: 10 N}}")
    sized = channels(run, "panel")
    body, component = run.bodies["panel"].body, run.modal("panel")
    at = body.dofs.rows(6, np.array([2, 3]))
    b = component.Phi[at][:, component.elastic].T @ [0.6, 0.8]
    expected = bare.B @ bare.B.T + (10.0**2 - 1) * np.outer(b, b)
    np.testing.assert_allclose(sized.B @ sized.B.T, expected, rtol=1e-10, atol=1e-12 * abs(expected).max())
    np.testing.assert_array_equal(sized.C1, bare.C1)


def test_a_motor_sizes_both_sides_of_its_joint(opened: Callable[..., Run]) -> None:
    """The hinge turns about y: the moment there of either body counts 5 instead of one at the arm's length."""
    for body, node in (("arm", 5), ("panel", 1)):
        bare = channels(opened("balance.keep=all"), body)
        run = opened("balance.keep=all", "balance.scaling={length: 1 m, inputs: {motor: 5 Nm}}")
        plain = channels(opened("balance={keep: all, scaling: 1 m}"), body)
        component = run.modal(body)
        (row,) = run.bodies[body].body.dofs.rows(node, np.array([5]))
        b = component.Phi[row, component.elastic]
        found, expected = channels(run, body).B, plain.B @ plain.B.T + 24 * np.outer(b, b)
        np.testing.assert_allclose(found @ found.T, expected, rtol=1e-10, atol=1e-12 * abs(expected).max())
        assert bare.B.shape[0] == found.shape[0]


@pytest.mark.parametrize("arm", ["", "length: none, "])
def test_the_units_of_the_scene_decide_nothing_beside_a_size(opened: Callable[..., Run], arm: str) -> None:
    """Interfaces have no size. The same scene in millimetres gave another order: its interfaces counted as 1 mm."""
    sizes = RANK % f"{{{arm}inputs: {{motor: 4 Nm}}, outputs: {{probe: 1 mm}}}}"
    bodies = [f"components.{name}.units=m-kg-s" for name in ("arm", "panel", "hub")]
    metres, millimetres = (
        opened(sizes, f"scene.units={units}", *bodies).balancing.ranked for units in ("m-kg-s", "mm-t-s")
    )
    for name, found in metres.items():
        for ranking in ("gregory", "hankel", "component-cost", "modal-gain"):
            own, other = (c.rankings[ranking][c.elastic] for c in (found, millimetres[name]))
            # Shapes are per root of kilogram or tonne, which is one factor.
            np.testing.assert_allclose(other / other.max(), own / own.max(), rtol=1e-7)


def test_a_sensor_of_small_size_decides(opened: Callable[..., Run]) -> None:
    """Where a micrometre at the tip counts as one, modes are ranked by what they do there."""
    run = opened("balance={rank: modal-gain, scaling: {outputs: {probe: 1 um}}, keep: all}")
    component = run.ranked["panel"]
    (row,) = component.body.dofs.rows(6, np.array([3]))
    ch = channels(run, "panel")
    by_hand = np.linalg.norm(ch.B, axis=1) * abs(component.Phi[row, component.elastic]) / 1e-6
    np.testing.assert_allclose(component.sigma[component.elastic][:6], by_hand[:6], rtol=1e-3)


@pytest.mark.parametrize(
    ("scaling", "words"),
    [
        ("{inputs: {moter: 2.0}}", "there is no actuator 'moter', did you mean 'motor'"),
        ("{outputs: {gyro.rx: 2.0}}", "there is no sensor 'gyro.rx'"),
        ("{inputs: {motor: 0}}", "above zero"),
        ("{outputs: {probe: -1 mm}}", "above zero"),
        ("{inputs: {motor: 2 N}}", "no torque, as the channel needs: write e.g. 2 Nm"),
        ("{outputs: {gyro: 1 arcsec}}", "no angular velocity, as the channel needs"),
        ("{outputs: {probe: 1 kg}}", "unknown unit 'kg'"),
        ("{lenght: 1 m}", "did you mean 'length'"),
    ],
)
def test_what_is_no_size_is_refused_with_its_line(study: Path, scaling: str, words: str) -> None:
    text = study.read_text().replace("keep: all}", f"keep: all, scaling: {scaling}}}")
    study.write_text(text)
    found = CliRunner().invoke(main, ["run", str(study), "--quiet"])
    line = next(k for k, each in enumerate(text.splitlines(), start=1) if each.startswith("balance:"))
    said = " ".join(found.output.split())
    assert found.exit_code == 2 and words in said and f"study.yaml:{line}" in said.replace(", line ", ":"), found.output


def test_costs_in_the_system_take_the_sizes_of_all(opened: Callable[..., Run]) -> None:
    """Where all have one: a sensor of no weight beside another is none, and a factor on all changes no share."""
    probe, gyro = "probe: {at: panel.6, measure: z}", "gyro: {at: hub.cg, measure: ry, rate: true}"
    one = "scene.articulation={hinge: [0 deg]}"

    def costs(sensors: str, outputs: str, inputs: str = "{motor: 3 Nm, thruster: 0.2}") -> np.ndarray:
        scaling = f"scaling: {{inputs: {inputs}, outputs: {outputs}}}"
        run = opened(f"balance={{rank: system-cost, keep: all, {scaling}}}", f"scene.sensors={{{sensors}}}", one)
        return np.concatenate([c.sigma[c.elastic] for c in run.ranked.values()])

    both, alone = f"{probe}, {gyro}", costs(probe, "{probe: 0.01}")
    np.testing.assert_allclose(costs(both, "{probe: 0.01, gyro: 1.0e+9}"), alone, rtol=1e-6)
    mixed = costs(both, "{probe: 10 mm, gyro: 0.5}")
    assert abs(mixed - alone).max() > 1e-2 * alone.max()
    np.testing.assert_allclose(costs(both, "{probe: 0.02, gyro: 1 rad/s}"), mixed, rtol=1e-9)
    np.testing.assert_allclose(
        costs(both, "{probe: 0.01, gyro: 0.5}", "{motor: 6 Nm, thruster: 0.4}"), mixed, rtol=1e-9
    )
    # With a size for some inputs only there is no telling what the others are worth beside them: the response says.
    np.testing.assert_allclose(
        costs(both, "{probe: 0.01, gyro: 0.5}", "{motor: 6 Nm}"), costs(both, "{probe: 0.01, gyro: 0.5}", "{}")
    )
