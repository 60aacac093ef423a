"""A hub with two hinged beams: frequencies converge at once, what a hinge feels does not (theory section 7)."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cmsreduce.assemble import assemble, rigid_substructure, system_modes
from cmsreduce.config import load_pipeline
from cmsreduce.pipeline import Run, Silent, execute
from cmsreduce.verify import articulation_inertia, articulation_sensors, free_index, hinges_locked, locked_index
from tests.samples import assert_made_again

ROOT = Path(__file__).parents[2]
PIPELINE = ROOT / "pipelines" / "hub_beams.yaml"
FREE, LOCKED = [6.33409, 8.84374, 19.98946], [1.92610, 3.88151, 9.88190]
AFTER = [2, 4, 8, 16]
E = [[0.27826, 0.20174], [0.09923, 0.06652], [0.02294, 0.01480], [0.00287, 0.00360]]
C = [[0.85175, 0.90120], [0.97220, 0.98227], [0.99620, 0.99760], [0.99966, 0.99955]]
DIGITS = {"rtol": 0, "atol": 0.5e-5 * (1 + 1e-9)}


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return Run(load_pipeline(PIPELINE), tmp_path_factory.mktemp("hub_beams"), Silent())


@pytest.fixture(scope="module")
def systems(run):
    """Hinges free and locked, unreduced, with all their elastic modes."""
    subs = {"hub": rigid_substructure(run.rigid_bodies["hub"])}
    for name, flexible in run.bodies.items():
        subs[name] = replace(flexible, body=flexible.undamped).substructure(run.scene)
    scene = replace(run.scene, actuators=(), sensors=articulation_sensors(run.scene))
    found = [assemble(subs, each, scene.configurations[0]) for each in (scene, hinges_locked(scene))]
    return [(system, *system_modes(system, np.inf)) for system in found]


def test_frequencies(systems):
    # Four motions that the beams do not have are the hub's alone; two more are the hinges'.
    for (system, omega, _), printed, rigid in zip(systems, (FREE, LOCKED), (8, 6), strict=True):
        assert system.rigid.shape[1] == rigid
        np.testing.assert_allclose(omega[:3], printed, **DIGITS)


def test_completeness_of_both_hinges(systems):
    (free, _, Phi), (locked, _, Phi_locked) = systems
    after = np.array(AFTER) - 1
    np.testing.assert_allclose(free_index(free, Phi)[after], E, **DIGITS)
    np.testing.assert_allclose(locked_index(free, locked, Phi_locked)[after], C, **DIGITS)


def test_both_indices_meet_in_what_the_mesh_leaves_at_the_hinges(systems):
    """Of all modes e is 1 - C, the inertia of the hinge nodes themselves, which falls with the element's length."""
    (free, _, Phi), (locked, _, Phi_locked) = systems
    left = free_index(free, Phi)[-1]
    np.testing.assert_allclose(left, 1 - locked_index(free, locked, Phi_locked)[-1], rtol=1e-6)
    assert (left > 0).all() and (left < 2e-6).all()


def test_articulation_inertia_is_that_of_rigid_beams_on_a_free_hub(systems):
    """By hand: hub y and turn, two rigid beams about their hinges, the hub's motions condensed out."""
    beams = [(0.6, 1.0, 0.5, 4.0), (-0.5, -1.0, 0.6, 3.0)]
    M = np.diag([5.0, 3.0, 0.0, 0.0])
    for k, (at, side, mass, length) in enumerate(beams):
        x, weight = np.polynomial.legendre.leggauss(3)
        arm, dm = side * length * (x + 1) / 2, mass * length * weight / 2
        for r, part in zip(arm, dm, strict=True):
            row = np.array([1.0, at + r, 0.0, 0.0])
            row[2 + k] = r
            M += part * np.outer(row, row)
    inertia = M[2:, 2:] - M[2:, :2] @ np.linalg.solve(M[:2, :2], M[:2, 2:])
    np.testing.assert_allclose(articulation_inertia(systems[0][0]), inertia, rtol=1e-10, atol=1e-12)


@pytest.fixture(scope="module")
def result(run):
    return execute(run, PIPELINE, report=False)


def test_the_reduced_system_has_the_frequencies_to_all_digits(result):
    (found,) = result.systems
    np.testing.assert_allclose(2 * np.pi * found.frequencies_hz, FREE, **DIGITS)
    assert sum(part.kept_modes for part in result.components.values()) == 19
    assert result.passed


def test_the_sample_is_what_its_script_makes(tmp_path):
    assert_made_again(ROOT / "sample_models" / "hub_beams", tmp_path)
