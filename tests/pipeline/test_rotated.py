"""Clusters rotated in a pipeline: ten equal whips on a hub that is turned, shaken and looked at."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cmsreduce.balance import DirectedComponent, elastic_norm, keep_directions_bound
from cmsreduce.config import load_pipeline
from cmsreduce.errors import DampingError
from cmsreduce.orthogonalise import ORTHOGONAL, orthogonality_errors
from cmsreduce.pipeline import Run, execute
from cmsreduce.pipeline.ranked import ranking_channels
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


@pytest.fixture(scope="module")
def whips_file(whips: Callable[..., Run]) -> Path:
    return whips().folder.parent / "whips.yaml"


@pytest.mark.parametrize(("error", "modes", "directions"), [(0.1, 4, 2), (0.02, 6, 4)])
def test_fewer_coordinates_at_equal_error(whips, whips_file, error, modes, directions):
    plain = whips(f"balance={{keep: {{frf_error: {error}}}}}")
    turned = whips(f"balance={{keep: {{frf_error: {error}}}, clusters: {{rotate: true}}}}")
    assert (plain.selection["rotor"].size, turned.selection["rotor"].size) == (modes, directions)
    result = execute(turned, whips_file)
    assert result is not None and result.worst()["frf_error"] <= error
    # What is kept is a body in orthonormal modes like any other.
    kept = turned.kept["rotor"]
    assert not isinstance(kept, DirectedComponent) and kept.elastic_count == directions
    assert max(orthogonality_errors(kept)) < ORTHOGONAL
    assert any(why.startswith("combination of close modes") for why in kept.why)
    summary = json.loads((turned.folder / "summary.json").read_text())
    assert summary["components"]["rotor"]["kept_modes"] == directions
    assert summary["components"]["rotor"]["elastic_modes"] == turned.modal("rotor").elastic_count


def test_clusters_are_numbered_from_their_lowest_mode(whips):
    found = whips().ranked["rotor"]
    number = found.cluster[found.elastic]
    assert not found.cluster[:6].any() and list(dict.fromkeys(number[number > 0])) == [*range(1, number.max() + 1)]
    # Seven first whip modes swing at the sensor, and one with the hub. Others are heard by nobody: they stand with none
    # but those of their own frequency.
    close = found.omega[found.elastic] < 2 * np.pi * 5.3
    assert np.bincount(number[close]).tolist() == [0, 8, 3, 2, 2, 2]


def test_all_candidates_give_the_same_model(whips):
    plain, turned = whips(), whips("balance.clusters={rotate: true}")
    assert isinstance(turned.ranked["rotor"], DirectedComponent)
    np.testing.assert_allclose(turned.kept["rotor"].omega, plain.kept["rotor"].omega, rtol=1e-9)
    for configuration in plain.scene.configurations:
        omega = 2 * np.pi * np.linspace(0.5, 20, 200)
        H, H_t = (run.model.assembled.response(configuration, omega) for run in (plain, turned))
        # As candidates, before they are cut down, they are coupled, and the same body.
        H_c = turned.joined(turned.ranked).assembled.response(configuration, omega)
        scale = abs(H).max(axis=(0, 2), keepdims=True)
        assert (abs(H_t - H) / scale).max() < 1e-8 and (abs(H_c - H) / scale).max() < 1e-8


def test_without_clusters_nothing_is_turned(whips):
    found = whips("balance.clusters={correlation: none, rotate: true}").ranked["rotor"]
    plain = whips("balance.clusters=none").ranked["rotor"]
    # Repeated modes are one cluster whatever the correlation.
    assert set(found.cluster[found.elastic]) == set(plain.cluster[plain.elastic])


def test_an_open_chain_of_isolated_modes_is_left_alone(opened):
    plain, turned = opened("balance.keep={modes: 5}"), opened("balance={keep: {modes: 5}, clusters: {rotate: true}}")
    for name, component in plain.kept.items():
        alone = not plain.ranked[name].cluster.any()
        assert isinstance(turned.ranked[name], DirectedComponent) != alone
        if alone:
            np.testing.assert_array_equal(turned.kept[name].Phi, component.Phi)


@pytest.mark.parametrize("rule", ["{modes: 7}", "{fraction: 1e-3}", "{bound: 0.05}", "{total: 9}"])
def test_every_rule_works_on_directions(whips, rule):
    rank = "system-cost" if "total" in rule else "gregory"
    run = whips(f"balance={{rank: {rank}, keep: {rule}, clusters: {{rotate: true}}}}")
    kept = run.kept["rotor"]
    assert 0 < kept.elastic_count < run.ranked["rotor"].elastic_count
    assert run.comparison.candidate_error(run.model) < 1


def test_the_bound_of_directions_is_the_runs(whips):
    run = whips("balance={keep: {bound: 0.05}, clusters: {rotate: true}}")
    found = run.choice.bounds["rotor"]
    assert 0 < found.error <= found.bound <= 0.05
    body = run.ranked["rotor"]
    channels = ranking_channels(body.modes, run.bodies["rotor"].ports, run.pipeline.balance, run.scene)
    kept, bound = keep_directions_bound(body, channels, 0.05)
    np.testing.assert_array_equal(run.selection["rotor"], 6 + kept)
    assert found.bound == pytest.approx(bound / elastic_norm(channels), rel=1e-12)


def test_an_undamped_body_cannot_be_rotated(whips):
    run = whips("balance={rank: modal-gain, clusters: {rotate: true}}", "components.rotor.damping=null")
    with pytest.raises(DampingError, match="needs positive damping"):
        _ = run.ranked
