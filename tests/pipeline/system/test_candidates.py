"""Candidates of a search, measured fast, against models built and compared one by one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from cmsreduce.model import Finding, ModalComponent
from cmsreduce.pipeline import Run
from cmsreduce.pipeline.choose.selection import truncate
from cmsreduce.pipeline.system.candidates import Candidates
from cmsreduce.verify import frf_error

Components = dict[str, ModalComponent]


class Trials:
    """The study's candidates, and their errors the long way, on the same grids."""

    def __init__(self, run: Run, components: Components) -> None:
        self.run, self.components = run, components
        pool = run.joined(components)
        self.targets = run.comparison.targets(run.scene.configurations, pool)
        self.fast = self.limited({"frf_error": 1.0})

    def limited(self, limits: dict[str, float]) -> Candidates:
        pool = self.run.joined(self.components)
        return Candidates(self.run.measure, limits, self.components, list(self.components), pool, self.targets)

    def slow(self, selection: dict[str, np.ndarray]) -> float:
        kept = truncate(self.components, selection, dict.fromkeys(self.components, "trial"))
        model = self.run.joined(kept).assembled
        return max(
            frf_error(t.omega, t.elastic, model.response(t.configuration, t.omega) - t.rigid, t.row, t.column)
            for t in self.targets
        )

    def random(self, seed: int, share: float) -> dict[str, np.ndarray]:
        rng = np.random.default_rng(seed)
        elastic = {name: np.arange(c.elastic.start, c.elastic.stop) for name, c in self.components.items()}
        return {name: columns[rng.random(columns.size) < share] for name, columns in elastic.items()}


def coupled(components: Components) -> Components:
    """The arm with damping that couples its modes: a share of each, and dashpots between its dofs and the ground."""
    arm = components["arm"]
    e = arm.elastic
    omega, dashpots = arm.omega[e], np.random.default_rng(2).standard_normal((4, arm.Phi.shape[0])) @ arm.Phi[:, e]
    D = np.zeros((arm.omega.size, arm.omega.size))
    coupling = dashpots.T @ dashpots
    D[e, e] = np.diag(0.014 * omega) + 0.003 * omega.sum() / np.trace(coupling) * coupling
    return {**components, "arm": replace(arm, D=D)}


@pytest.fixture(params=["diagonal", "coupled"])
def trials(request: pytest.FixtureRequest, opened: Callable[..., Run]) -> Trials:
    run = opened()
    return Trials(run, dict(run.ranked) if request.param == "diagonal" else coupled(dict(run.ranked)))


def test_errors_are_those_of_the_models(trials: Trials) -> None:
    for seed, share in enumerate([1.0, 0.8, 0.5, 0.0]):
        selection = trials.random(seed, share)
        assert trials.fast.error(selection) == pytest.approx(trials.slow(selection), rel=1e-9, abs=1e-12)


def test_a_refusal_refines_the_grid_for_selections_like_the_refused_one(trials: Trials) -> None:
    """On every ninth frequency the errors are 30 % off; after a refusal that of a neighbour is right."""
    compared, pool, apart = trials.run.comparison, trials.run.joined(trials.components), []
    coarse = [compared.target(each.configuration, each.omega[::9], pool) for each in trials.targets]
    trials.targets = tuple(coarse)
    fast, full = trials.limited({"frf_error": 1.0}), trials.random(0, 1.0)
    # The lowest mode of the arm misses the most.
    refused = {**full, "arm": full["arm"][1:]}
    for other in (None, full["arm"][-1]):
        selection = refused if other is None else {**refused, "arm": refused["arm"][refused["arm"] != other]}
        kept = truncate(trials.components, selection, dict.fromkeys(trials.components, "trial"))
        model, places = trials.run.joined(kept), [each.configuration for each in coarse]
        own = {place.name: compared.error_at(place, model) for place in places}
        apart.append((own, fast.error(selection)))
        if other is None:
            for name, error in own.items():
                fast.refuse(selection, Finding("frf_error", error, 1.0, name))
            assert fast.error(selection) == pytest.approx(list(own.values())[-1])
    (refused_own, before), (own, after) = apart
    assert abs(before / max(refused_own.values()) - 1) > 0.1
    assert after == pytest.approx(max(own.values()), rel=5e-3)


def test_beyond_a_limit_an_error_is_a_lower_bound(trials: Trials) -> None:
    for seed in range(12):
        selection = trials.random(seed, 0.85)
        exact = trials.slow(selection)
        for limit in (0.5 * exact, 0.999 * exact, 1.001 * exact):
            found = trials.fast.error(selection, limit)
            assert (found > limit) == (exact > limit) and found <= exact * (1 + 1e-9)


def test_effects_of_single_modes_foretell_errors(trials: Trials) -> None:
    selection = trials.random(0, 1.0)
    changes = [
        (name, np.array([k])) for name, c in trials.components.items() for k in range(c.elastic.start, c.elastic.stop)
    ]
    effects = trials.fast.effects(selection, changes)
    foretold = effects.predicted(np.arange(len(changes))[:, None])
    small = 0
    for (name, columns), error in zip(changes, foretold, strict=True):
        exact = trials.fast.error({**selection, name: np.setxor1d(selection[name], columns)})
        if exact < 0.5:
            # The grid of effects is coarser.
            assert error == pytest.approx(exact, rel=0.1)
            small += 1
    assert small > 3


def test_heights_of_peaks_are_those_on_grids_of_their_own(opened: Callable[..., Run]) -> None:
    """The grids of the search have no points at the peaks of a model that lacks some modes."""
    run = opened("verify.frf.points=20")
    trials = Trials(run, dict(run.ranked))
    limits, shifted = {"peak_error": 1.0}, 0
    judge = trials.limited(limits)
    for seed in range(6):
        selection = trials.random(seed, 0.6)
        kept = truncate(trials.components, selection, dict.fromkeys(trials.components, "trial"))
        exact = run.measure.measured(kept, run.joined(kept), limits).findings["peak_error"].value
        assert judge.error(selection) == pytest.approx(exact, rel=1e-3, abs=1e-3)
        shifted += exact > 0.1
    assert shifted > 2


def test_rounding_of_the_rigid_motions_of_a_held_body_is_no_error(opened: Callable[..., Run]) -> None:
    """The motor of a balanced payload on a held frame hardly moves it along the hinge at the lower end of the band."""
    text = """\
name: held
output: {output}
components:
  panel:
    stiffness: {{file: panel.op4, matrix: KAA}}
    mass: {{file: panel.op4, matrix: MAA}}
    geometry: panel.bdf
    interfaces: {{root: {{node: 1}}, tip: {{node: 6}}}}
    damping: {{modal: 0.01}}
  payload:
    rigid: {{mass: 0.5, cg: [1.75, 0.125, 0.08], inertia: [1e-4, 1e-4, 1e-4, 0, 0, 0]}}
    interfaces: {{plate: {{position: [1.75, 0.125, 0.05]}}}}
scene:
  band: 60 Hz
  ground: panel.root
  joints: {{wrist: {{connect: [panel.tip, payload.plate], free: [rz], stiffness: {{rz: 100}}}}}}
  actuators: {{motor: {{joint: wrist, dof: rz}}}}
  sensors: {{along: {{at: payload.cg, measure: [z]}}}}
reduce: {{method: macneal-rubin, cutoff: 4}}
balance: {{keep: limits}}
verify: {{limits: {{db_error: 1}}}}
"""
    run = opened(text=text)
    trials = Trials(run, dict(run.ranked))
    every = trials.random(0, 1.0)
    exact = run.measure.measured(trials.components, run.joined(trials.components), {"db_error": 1.0})
    assert exact.findings["db_error"].value < 0.05
    assert trials.limited({"db_error": 1.0}).error(every) < 0.05
