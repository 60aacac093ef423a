"""Modes that a run keeps: by number, by fraction, by error, and by a rule of a single body."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la
from pyyeti.nastran import op4

from cmsreduce.assemble import rigid_substructure
from cmsreduce.balance import elastic_norm, keep_bound, mode_bounds
from cmsreduce.errors import ConfigError, DampingError
from cmsreduce.pipeline import Run, execute
from cmsreduce.pipeline.choose.ranked import ranking_channels
from cmsreduce.pipeline.choose.selection import truncate
from cmsreduce.pipeline.system import AssembledModel, ReducedModel
from tests.pipeline.study import CANTILEVER, arm


def model(run: Run, selection: Mapping[str, np.ndarray]) -> ReducedModel:
    """The run's system with other modes kept."""
    components = truncate(run.ranked, dict(selection), dict.fromkeys(run.ranked, "trial"))
    subs = {name: run.bodies[name].substructure(run.scene, c) for name, c in components.items()}
    every = {**subs, **{name: rigid_substructure(body) for name, body in run.rigid_bodies.items()}}
    return ReducedModel(AssembledModel({name: every[name] for name in run.pipeline.components}, run.scene), components)


def test_modes_by_number_are_the_first_by_influence(opened: Callable[..., Run]) -> None:
    run = opened("balance.keep={modes: {arm: 4}}")
    sigma = run.ranked["arm"].sigma[6:]
    np.testing.assert_array_equal(run.selection["arm"], 6 + np.sort(np.argsort(-sigma)[:4]))
    # A body that is not named keeps all of its modes.
    assert run.selection["panel"].size == run.ranked["panel"].elastic_count == 13
    assert set(run.kept["arm"].why[:6]) == {"rigid body"}
    assert set(run.kept["arm"].why[6:]) == {"among the first by gregory"}
    assert set(run.kept["panel"].why[6:]) == {"all modes kept"}


def test_modes_by_number_and_frequency(opened: Callable[..., Run]) -> None:
    run = opened("balance={rank: frequency, keep: {modes: 3}}")
    for name in ("arm", "panel"):
        np.testing.assert_array_equal(run.selection[name], [6, 7, 8])
        assert (np.diff(run.ranked[name].omega[6:]) > 0).all()


def test_no_elastic_modes_leave_rigid_bodies(opened: Callable[..., Run]) -> None:
    run = opened("balance.keep={modes: 0}")
    (system, _) = (run.model.assembled.system(c) for c in run.scene.configurations)
    # Three rigid bodies of six motions, eleven of them locked.
    assert system.N == system.rigid.shape[1] == 7
    w = 2 * np.pi * np.array([0.5, 5.0])
    for configuration in run.scene.configurations:
        rigid = run.comparison.reference.assembled.rigid_response(configuration, w)
        np.testing.assert_allclose(run.model.assembled.response(configuration, w), rigid, rtol=1e-8)


def test_no_elastic_modes_leave_a_whole_page(opened: Callable[..., Run], study: Path) -> None:
    """The gains of no modes had no size."""
    result = execute(opened("balance.keep={modes: 0}"), study)
    assert result is not None and not result.failures
    assert (study.parent / "out" / "report.html").is_file()


def test_modes_by_fraction(opened: Callable[..., Run]) -> None:
    run = opened("balance.keep={fraction: 0.01}")
    for name, ranked in run.ranked.items():
        sigma = ranked.sigma[6:]
        kept = np.flatnonzero(sigma >= 0.01 * sigma.max())
        np.testing.assert_array_equal(run.selection[name], 6 + kept)
        assert 0 < kept.size < sigma.size


def test_modes_by_error_are_as_few_as_meet_it(opened: Callable[..., Run], study: Path) -> None:
    run = opened("verify.limits={frf_error: 0.01}", text=CANTILEVER)
    result = execute(run, study, report=False)
    assert result is not None and result.passed and 0 < result.worst()["frf_error"] <= 0.01
    (kept,) = run.selection.values()
    assert 0 < kept.size < run.ranked["arm"].elastic_count
    # What was left out was not needed, and what was kept is: without any one of them the error is too large.
    for mode in kept:
        assert run.comparison.candidate_error(model(run, {"arm": kept[kept != mode]})) > 0.01
    assert set(run.kept["arm"].why[6:]) == {"needed for frf_error 0.01, gregory"}


def test_the_chosen_model_meets_the_error_on_a_finer_grid(opened: Callable[..., Run]) -> None:
    coarse = opened("verify.frf.points=20", text=CANTILEVER)
    selection = coarse.selection
    fine = opened("verify.frf.points=5000", text=CANTILEVER)
    results = fine.comparison.errors({"reduced": model(fine, selection)}, fine.stages.progress)
    assert max(result.errors["reduced"].frf_error for result in results) <= 0.01 * 1.05


def test_a_search_says_what_it_did(opened: Callable[..., Run], study: Path) -> None:
    run = opened(text=CANTILEVER)
    result = execute(run, study, report=False)
    found = result.search
    assert found is not None and found.asked == 0.01 and 0 < found.frf_error <= 0.01
    assert found.modes == run.selection["arm"].size and found.of == run.ranked["arm"].elastic_count
    assert found.candidates > found.modes and found.seconds > 0
    # No ranking cut off by itself needs fewer.
    assert all(found.modes <= count for count in found.truncated.values()) and "gregory" in found.truncated
    (note,) = (note for note in result.notes if note.startswith("search"))
    assert f"{found.modes} of {found.of} elastic modes" in note and f"{found.candidates} candidates" in note
    summary = json.loads((run.folder / "summary.json").read_text())
    assert summary["search"]["modes"] == found.modes and summary["search"]["seconds"] == found.seconds
    # A run that goes on from a finished search says the same.
    again = opened(text=CANTILEVER)
    assert again.choice.search == found and "balance system" in again.stages.progress.reused_
    assert note in again.stages.notes


def test_modes_by_the_bound_of_their_body(opened: Callable[..., Run], study: Path) -> None:
    run = opened("balance.keep={bound: 0.2}", "components.panel.balance={keep: {bound: 0.01}}")
    result = execute(run, study, report=False)
    for name, asked in (("arm", 0.2), ("panel", 0.01)):
        body, keys = run.ranked[name], run.pipeline.balance_of(name)
        channels = ranking_channels(body, run.bodies[name].ports, keys, run.scene)
        np.testing.assert_array_equal(run.selection[name], 6 + keep_bound(channels, asked))
        assert 0 < run.selection[name].size < body.elastic_count
        found = result.components[name].bound
        assert found.asked == asked and 0 < found.error <= found.bound * (1 + 1e-12) <= asked
        left_out = channels.only(np.setdiff1d(np.arange(body.elastic_count), run.selection[name] - 6))
        assert found.tightness == pytest.approx(elastic_norm(left_out) / sum(mode_bounds(left_out)[1]), rel=1e-12)
        (note,) = (note for note in result.notes if note.startswith(f"{name}: the error of this body by itself"))
        assert "the assembled system inherits no such bound" in note
    assert set(run.kept["arm"].why[6:]) == {"needed for a bound of 0.2"}
    summary = json.loads((run.folder / "summary.json").read_text())
    assert summary["components"]["arm"]["bound"]["asked"] == 0.2 and summary["search"] is None
    # What the bound does not cover is measured.
    assert result.worst()["frf_error"] > 0


def test_no_bound_is_proven_of_modes_that_damping_couples(opened: Callable[..., Run], study: Path) -> None:
    """A damper at an angle between two bending modes of nearly one frequency leaves another motion of them undamped."""
    body = arm()
    K, M = body.K.toarray(), body.M.toarray()
    lam, Phi = la.eigh(K, M)
    w, MPhi = np.sqrt(lam[6:]), M @ Phi[:, 6:]
    damper = MPhi @ np.where(np.arange(w.size) < 2, np.sqrt(0.2 * w), 0.0)
    proportional = 1e-6 * K
    op4.write(str(study.parent / "damping.op4"), {"DAA": proportional, "DBB": proportional + np.outer(damper, damper)})
    with_matrix = CANTILEVER.replace("{{modal: 0.01}}", "{{matrix: {{file: damping.op4, matrix: DAA}}}}")
    assert opened("balance.keep={bound: 0.1}", text=with_matrix).selection["arm"].size > 0
    # The error was said to be proven to be below 0.098 of the largest response of such a body, and was 0.69.
    with pytest.raises(DampingError, match=r"body 'arm': balance\.keep\.bound .* its damping matrix couples them"):
        _ = opened("balance.keep={bound: 0.1}", text=with_matrix.replace("DAA", "DBB")).selection
    wheel = "    wheels: {{spin: {{at: 3, axis: x, momentum: 0.2 N*m*s}}}}\n    damping"
    with pytest.raises(DampingError, match="gyroscopic forces or parameters couple them"):
        _ = opened("balance.keep={bound: 0.1}", text=CANTILEVER.replace("    damping", wheel)).selection


def test_a_bound_is_relative_to_no_unit(opened: Callable[..., Run]) -> None:
    """Rotations against translations are scaled as in the ranking."""
    same = [opened("balance.keep={bound: 0.1}", f"balance.scaling={how}").selection for how in ("auto", "auto")]
    other = opened("balance.keep={bound: 0.1}", "balance.scaling=none").selection
    assert all(np.array_equal(same[0][name], same[1][name]) for name in same[0])
    assert any(not np.array_equal(same[0][name], other[name]) for name in other)


def test_a_sensor_less_makes_the_model_smaller(opened: Callable[..., Run]) -> None:
    """Modes of the other plane, of stretching and of twisting are then of no use."""
    both = opened(text=CANTILEVER)
    one = opened("scene.sensors={up: {at: arm.5, measure: z}}", text=CANTILEVER)
    assert 0 < one.selection["arm"].size < both.selection["arm"].size < both.ranked["arm"].elastic_count
    component = one.bodies["arm"].body.dofs.component
    in_plane = np.isin(component, [3, 5])
    shapes = one.kept["arm"].Phi[:, 6:]
    assert abs(shapes[~in_plane]).max() < 1e-9 * abs(shapes).max()


def test_a_body_with_a_rule_of_its_own(opened: Callable[..., Run], study: Path) -> None:
    run = opened("components.panel.balance={keep: {modes: 12}}", "balance.keep={frf_error: 0.7}")
    execute(run, study, report=False)
    sigma = run.ranked["panel"].sigma[6:]
    np.testing.assert_array_equal(run.selection["panel"], 6 + np.sort(np.argsort(-sigma)[:12]))
    # The other body is chosen with the panel as it is.
    assert run.comparison.candidate_error(model(run, run.selection)) <= 0.7
    assert run.selection["arm"].size < run.ranked["arm"].elastic_count
    assert set(run.kept["panel"].why[6:]) == {"among the first by gregory"}
    assert set(run.kept["arm"].why[6:]) == {"needed for frf_error 0.7, gregory"}


def test_a_body_with_a_reduction_of_its_own(opened: Callable[..., Run]) -> None:
    run = opened("components.arm.reduce={method: guyan}", "components.panel.reduce={cutoff: 1}")
    arm, panel = run.modal("arm"), run.modal("panel")
    assert (arm.method, panel.method) == ("guyan", "craig-bampton")
    assert (arm.basis_size, arm.elastic_count) == (12, 6)
    fixed = run.reduced("panel").modes
    top = max(hz for hz, kind in zip(fixed.source_hz, fixed.kind, strict=True) if kind == "fixed")
    assert top <= 60 and panel.basis_size < 19


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (("balance.keep={modes: {arm: 12}}",), "12 modes of 'arm' .* has 11"),
        (("balance.keep={frf_error: 1e-12}",), "frf_error 1e-12 cannot be met: all 24 modes"),
        (
            ("balance.keep={frf_error: 1e-12}", "reduce.method=guyan"),
            r"Raise .*, take `reduce: \{method: macneal-rubin\}`",
        ),
        (("balance.keep={frf_error: 0.1}", "scene.sensors={}"), "needs a response"),
    ],
)
def test_rules_that_cannot_be_met(opened: Callable[..., Run], settings: tuple[str, ...], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        _ = opened(*settings).selection


def test_modes_by_hand_are_those_named(opened: Callable[..., Run]) -> None:
    run = opened("balance.keep={arm: [2, 5, 7-9]}")
    np.testing.assert_array_equal(run.selection["arm"], 5 + np.array([2, 5, 7, 8, 9]))
    assert run.selection["panel"].size == run.ranked["panel"].elastic_count
    assert set(run.kept["arm"].why[6:]) == {"chosen by number"} and set(run.kept["panel"].why[6:]) == {"all modes kept"}


@pytest.mark.parametrize(
    ("keep", "words"),
    [
        ("{arm: [99]}", r"mode 99 of 'arm' is asked for, but it has \d+ elastic modes below the cutoff"),
        ("{arm: [0, 2]}", "modes are numbered from 1"),
        ("{arm: [5-3]}", "the range 5-3 ends below its start: write 3-5"),
        ("{arm: [2, 1-3]}", "mode 2 is named twice"),
        ("{arm: [first]}", r"numbers of modes are expected, e.g. \[1, 2, 5\] or \[1-4\], found 'first'"),
        ("{arms: [1]}", "there is no flexible component 'arms', did you mean 'arm'"),
        ("{arm: [1], frf_error: 0.01}", "frf_error and numbers are different rules: state one of them"),
    ],
)
def test_modes_by_hand_that_do_not_exist_are_refused(opened: Callable[..., Run], keep: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        _ = opened(f"balance.keep={keep}").selection
