"""Clusters of close modes in a pipeline: ten equal whips on a hub, and a pair that nearly cancels at a sensor."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.config import load_pipeline
from cmsreduce.model import Damping
from cmsreduce.pipeline import Run
from tests.frames import frame
from tests.hard.multiplicity import ten_appendages
from tests.pipeline.study import Log, write_body

WHIPS = """\
name: whips
output: {output}
components:
  rotor:
    stiffness: {{file: rotor.op4, matrix: KAA}}
    mass: {{file: rotor.op4, matrix: MAA}}
    geometry: rotor.bdf
    interfaces: {{face: {{node: 2}}}}
    damping: {{modal: 0.005}}
  base:
    rigid: {{mass: 200.0, cg: [0, 0, -0.6], inertia: [20, 20, 30, 0, 0, 0]}}
    interfaces: {{face: {{position: [0, 0, -0.5]}}}}
scene:
  band: 20 Hz
  joints: {{spin: {{connect: [base.face, rotor.face], free: [rz]}}}}
  actuators: {{motor: {{joint: spin, dof: rz}}, wheel: {{at: base.cg, torque: [0, 1, 0]}}}}
  sensors: {{gyro: {{at: base.cg, measure: [ry, rz]}}, tip: {{at: rotor.33, measure: [z]}}}}
reduce: {{method: craig-bampton, cutoff: 3}}
balance: {{keep: all}}
verify: {{frf: {{points: 60}}}}
"""


@pytest.fixture(scope="module")
def whips(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Run]:
    folder = tmp_path_factory.mktemp("whips")
    write_body(folder, ten_appendages().body)
    path = folder / "whips.yaml"
    path.write_text(WHIPS.format(output=folder / "out"))

    def make(*overrides: str) -> Run:
        return Run(load_pipeline(path, overrides), folder / "out", Log())

    return make


@pytest.mark.parametrize(("error", "modes"), [(0.1, 4), (0.02, 6)])
def test_few_modes_of_many_equal_whips_meet_an_error(whips, error, modes):
    run = whips(f"balance={{keep: {{frf_error: {error}}}}}")
    assert run.selection["rotor"].size == modes
    assert run.comparison.candidate_error(run.model) <= error


def test_clusters_are_numbered_from_their_lowest_mode(whips):
    found = whips().ranked["rotor"]
    number = found.cluster[found.elastic]
    assert not found.cluster[:6].any() and list(dict.fromkeys(number[number > 0])) == [*range(1, number.max() + 1)]
    # Seven first whip modes swing at the sensor, and one with the hub. No sensor measures the others: they stand
    # with none but those of their own frequency.
    close = found.omega[found.elastic] < 2 * np.pi * 5.3
    assert np.bincount(number[close]).tolist() == [0, 8, 3, 2, 2, 2]


# Two whips from one root, of lengths that differ by half a thousandth: frequencies a thousandth apart in each plane.
FORK = """\
name: fork
output: {output}
components:
  fork:
    stiffness: {{file: fork.op4, matrix: KAA}}
    mass: {{file: fork.op4, matrix: MAA}}
    geometry: fork.bdf
    interfaces: {{root: {{node: 1}}}}
    damping: {{modal: 0.005}}
  base:
    rigid: {{mass: 2000.0, cg: [0, 0, 0], inertia: [200, 200, 300, 0, 0, 0]}}
    interfaces: {{face: {{position: [0, 0, 0]}}}}
scene:
  band: 8 Hz
  joints: {{weld: {{connect: [base.face, fork.root]}}}}
  actuators: {{shaker: {{at: base.cg, force: [0, 0, 1]}}}}
  sensors: {{split: {{rows: {{fork.2.z: 1.0, fork.3.z: -0.9}}, rate: true}}}}
reduce: {{method: craig-bampton, cutoff: 1}}
balance: {{keep: all}}
verify: {{frf: {{points: 60}}}}
"""


@pytest.fixture(scope="module")
def fork(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Run]:
    folder = tmp_path_factory.mktemp("fork")
    body = frame(
        "fork",
        [[0, 0, 0], [1.5, 0, 0], [-1.50075, 0, 0]],
        [(1, 2), (1, 3)],
        {"root": 1},
        damping=Damping(modal=0.005),
    )
    # A root so heavy that both whips are as if clamped.
    heavy = np.zeros(body.n)
    heavy[:6] = 1e4
    write_body(folder, replace(body, M=sp.csc_array(body.M + sp.diags_array(heavy))))
    path = folder / "fork.yaml"
    path.write_text(FORK.format(output=folder / "out"))

    def make(balance: str) -> Run:
        return Run(load_pipeline(path, [f"balance={balance}"]), folder / "out", Log())

    return make


def measured(run: Run, whole: Run, bare: Run) -> float:
    """The frf_error of one input and one output, by a grid of its own; the bare model is the rigid part."""
    w = 2 * np.pi * np.unique(np.concatenate([np.linspace(0.01, 8, 2000), np.linspace(6.1, 6.6, 8000)]))
    (configuration,) = whole.scene.configurations
    H, kept, rigid = (each.model.assembled.response(configuration, w)[:, 0, 0] for each in (whole, run, bare))
    return float(np.sqrt(np.trapezoid(abs(H - kept) ** 2, w) / np.trapezoid(abs(H - rigid) ** 2, w)))


@pytest.mark.parametrize(
    ("keep", "modes"),
    [
        ("{modes: 1}", 1),
        # One mode errs by 5.4, none by 1: anything less takes both.
        ("{frf_error: 110 %}", 0),
        ("{frf_error: 0.9}", 2),
    ],
)
def test_the_error_of_a_pair_that_is_reported_is_the_one_that_is_measured(
    fork: Callable[[str], Run], keep: str, modes: int
) -> None:
    whole, bare = fork("{keep: all}"), fork("{keep: {modes: 0}}")
    run = fork(f"{{keep: {keep}}}")
    assert run.selection["fork"].size == modes
    (result,) = run.verified.configurations
    reported = result.errors["reduced"].frf_error
    # All modes themselves miss 2.7e-4 of the body in its matrices.
    assert reported == pytest.approx(measured(run, whole, bare), rel=5e-3, abs=5e-4)
    if run.choice.search is not None:
        assert run.choice.search.frf_error == pytest.approx(reported, rel=1e-2, abs=1e-5)
