"""A station of 1062 dofs in two bodies, sized as the MB-1 chain (theory section 9): 89 modes, 15 + 50, 41 dofs."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cmsreduce.assemble import assemble, system_modes
from cmsreduce.balance import keep_total, whole_groups
from cmsreduce.config import load_pipeline
from cmsreduce.pipeline import MODEL, Run, Silent, execute
from cmsreduce.pipeline.system import AssembledModel, ReducedModel
from cmsreduce.project import largest_shares, system_cost
from cmsreduce.verify import articulation_inertia, articulation_sensors, free_index, hinges_locked, locked_index
from tests.samples import assert_made_again

ROOT = Path(__file__).parents[2]
PIPELINE = ROOT / "pipelines" / "station.yaml"
KEPT = {"inboard": 15, "outboard": 50}
WHOLE, FEWER, COSTED, NAIVE = "89 modes of each body", "12 + 22", "34 by cost", "15 + 50 by frequency"


def substructures(run, components):
    return {name: run.bodies[name].substructure(run.scene, c) for name, c in components.items()}


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return Run(load_pipeline(PIPELINE), tmp_path_factory.mktemp("station"), Silent())


@pytest.fixture(scope="module")
def result(run):
    return execute(run, PIPELINE, report=False)


def test_sizes_are_those_of_the_chain(result):
    parts = result.components
    assert sum(part.full_dofs for part in parts.values()) == 1062
    assert {name: part.modes.basis_size for name, part in parts.items()} == dict.fromkeys(KEPT, 89)
    assert {name: part.kept_modes for name, part in parts.items()} == KEPT
    assert all(check.passed for part in parts.values() for check in part.checks)
    # 65 modes, six motions of the whole and the turn of the joint.
    assert {(found.n_full, found.n_reduced) for found in result.configurations} == {(1062 - 5, 72)}
    assert {found.rigid_count for found in result.systems} == {7}


@pytest.mark.parametrize(("label", "limit"), [(WHOLE, 0.002), (MODEL, 0.005), (FEWER, 0.04), (COSTED, 0.05)])
def test_errors_at_every_angle(result, label, limit):
    assert len(result.configurations) == 4
    assert result.worst(label)["frf_error"] < limit
    assert result.passed


def test_the_first_by_frequency_fail(result):
    assert result.worst(NAIVE)["frf_error"] > 0.5


def by_cost(costs, components):
    """The bodies with the cost of their modes in the system as coefficients."""
    found = {}
    for name, component in components.items():
        groups, sigma = whole_groups(component), np.full(component.omega.size, np.nan)
        for columns, share in zip(groups, largest_shares(costs, name, groups), strict=True):
            sigma[columns] = share
        found[name] = replace(component, sigma=sigma)
    return found


@pytest.fixture(scope="module")
def costs(run):
    """Of the 65 modes in every configuration."""
    subs, scene = substructures(run, run.kept), run.scene
    return [system_cost(assemble(subs, scene, each), subs) for each in scene.configurations]


@pytest.mark.parametrize(("count", "split", "limit"), [(41, (14, 27), 0.006), (34, (12, 22), 0.05)])
def test_the_costliest_of_both_bodies_together(run, costs, count, split, limit):
    """34 modes and 7 rigid motions are the published 41 dofs; no number is given for each body."""
    kept = keep_total(by_cost(costs, run.kept), count)
    assert tuple(kept[name].size for name in KEPT) == split
    small = {name: component.truncated(kept[name]) for name, component in run.kept.items()}
    model = ReducedModel(AssembledModel(substructures(run, small), run.scene), small)
    size = model.assembled.system(run.scene.configurations[0]).N
    assert size == count + 7
    assert run.comparison.candidate_error(model) < limit


def test_all_modes_leave_the_joint_the_inertia_of_its_two_grids(run):
    """By hand: 140 kg m^2 on one side of the alpha joint and 60000 on the other, against what the joint feels."""
    subs, turned = run.comparison.reference.assembled.substructures, run.scene.configurations[1]
    scene = replace(run.scene, actuators=(), sensors=articulation_sensors(run.scene))
    free, locked = (assemble(subs, each, turned) for each in (scene, hinges_locked(scene)))
    left = 1 / (1 / 140 + 1 / 60000) / articulation_inertia(free)[0, 0]
    assert free_index(free, system_modes(free, np.inf)[1])[-1, 0] == pytest.approx(left, rel=1e-5)
    assert 1 - locked_index(free, locked, system_modes(locked, np.inf)[1])[-1, 0] == pytest.approx(left, rel=1e-5)


def test_the_sample_is_what_its_script_makes(tmp_path):
    assert_made_again(ROOT / "sample_models" / "station", tmp_path)
