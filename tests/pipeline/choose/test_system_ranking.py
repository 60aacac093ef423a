"""Modes ranked by what they cost in the assembled system."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.assemble import elastic_states
from cmsreduce.errors import ConfigError, DampingError
from cmsreduce.model import Configuration
from cmsreduce.pipeline import Run
from cmsreduce.pipeline.choose import system_ranking
from cmsreduce.pipeline.choose.system_ranking import with_system_cost
from cmsreduce.pipeline.system import closed_loop
from cmsreduce.project import system_cost

BY_COST = "balance={rank: system-cost, keep: all}"


def test_coefficients_are_shares_of_the_mean_square(opened: Callable[..., Run]) -> None:
    """With one sensor and one actuator the scales cancel, and unit noise gives the same; the mean square is scipy's."""
    run = opened(
        BY_COST,
        "scene.sensors={probe: {at: panel.6, measure: z}}",
        "scene.actuators={motor: {joint: hinge, dof: ry}}",
        "scene.articulation={hinge: [50 deg]}",
    )
    (configuration,) = run.scene.configurations
    model = run.joined(run.ranked).assembled
    states = elastic_states(model.system(configuration))
    X = la.solve_continuous_lyapunov(states.A, -states.B @ states.B.T)
    V = float((states.C @ X @ states.C.T).trace())
    parts = system_cost(model.system(configuration), model.substructures).coordinates
    for name, component in run.ranked.items():
        e = component.elastic
        np.testing.assert_array_equal(component.sigma, component.rankings["system-cost"])
        assert np.isnan(component.sigma[:6]).all()
        np.testing.assert_allclose(component.sigma[e], abs(parts[name][e]) / V, rtol=1e-6, atol=1e-12)
    assert set(run.ranked["arm"].rankings) >= {"gregory", "hankel", "system-cost"}


def test_units_do_not_decide(opened: Callable[..., Run]) -> None:
    """A sensor in degrees is a sensor in radians."""
    plain = opened(BY_COST, "scene.sensors={a: {rows: {panel.6.z: 1}}, b: {rows: {panel.4.ry: 1}}}")
    scaled = opened(BY_COST, "scene.sensors={a: {rows: {panel.6.z: 1}}, b: {rows: {panel.4.ry: 57.3}}}")
    for name, component in plain.ranked.items():
        e = component.elastic
        np.testing.assert_allclose(scaled.ranked[name].sigma[e], component.sigma[e], rtol=1e-6, atol=1e-12)


def test_a_total_is_shared_out_by_cost(opened: Callable[..., Run]) -> None:
    run = opened("balance={rank: system-cost, keep: {total: 9}}")
    kept = {(name, k) for name, columns in run.selection.items() for k in columns}
    assert len(kept) == 9
    every = [
        (component.sigma[k], (name, k))
        for name, component in run.ranked.items()
        for k in range(component.elastic.start, component.elastic.stop)
    ]
    assert kept == {mode for _, mode in sorted(every, reverse=True)[:9]}
    assert set(run.kept["arm"].why[6:]) == {"among the first by system-cost"}
    with pytest.raises(ConfigError, match="50 modes in total are asked for, but the bodies have 24"):
        _ = opened("balance={rank: system-cost, keep: {total: 50}}").selection


def test_modes_of_each_body_and_errors_follow_it(opened: Callable[..., Run]) -> None:
    run = opened("balance={rank: system-cost, keep: {modes: {arm: 4}}}")
    sigma = run.ranked["arm"].sigma[6:]
    np.testing.assert_array_equal(run.selection["arm"], 6 + np.sort(np.argsort(-sigma)[:4]))
    run = opened("balance={rank: system-cost, keep: {frf_error: 0.05}}")
    assert next(iter(run.choice.search.truncated)) == "system-cost" and run.choice.search.frf_error <= 0.05


def test_a_search_follows_it_beside_the_ranking_asked_for(opened: Callable[..., Run]) -> None:
    run = opened("balance={rank: gregory, keep: {frf_error: 0.05}}")
    for component in run.ranked.values():
        np.testing.assert_array_equal(component.sigma, component.rankings["gregory"])
        assert "system-cost" in component.rankings
    # Structural damping has no mean square: the search goes on without.
    run = opened("balance={rank: gregory, keep: {frf_error: 0.05}}", "components.arm.damping={structural: 0.02}")
    assert "system-cost" not in run.ranked["arm"].rankings and run.choice.search.frf_error <= 0.05


@pytest.mark.parametrize(
    ("setting", "error", "words"),
    [
        ("scene.sensors={}", ConfigError, "system-cost needs a response"),
        ("components.arm.damping=null", DampingError, "needs positive damping"),
    ],
)
def test_what_cannot_be_ranked_so(opened: Callable[..., Run], setting: str, error: type, words: str) -> None:
    extra = ("components.panel.damping=null",) if "damping" in setting else ()
    with pytest.raises(error, match=words):
        _ = opened(BY_COST, setting, *extra).ranked


def test_a_column_is_added_and_nothing_else_changes(opened: Callable[..., Run]) -> None:
    run = opened()
    found = with_system_cost(run.ranked, run.joined(run.ranked).assembled)
    for name, component in run.ranked.items():
        np.testing.assert_array_equal(found[name].sigma, component.sigma)
        assert set(found[name].rankings) - set(component.rankings) == {"system-cost"}


def test_a_hinge_with_drag_alone_is_ranked(opened: Callable[..., Run]) -> None:
    """A little drag is none; much of it is a weld."""
    by_drag = [
        opened(
            BY_COST, "scene.articulation={hinge: [50 deg]}", "scene.sensors={probe: {at: panel.6, measure: z}}", *more
        )
        for more in (
            (),
            ("scene.joints.hinge.damping={ry: 1e-9 N*m*s/rad}",),
            ("scene.joints.hinge.damping={ry: 0.05 N*m*s/rad}",),
        )
    ]
    for name in ("arm", "panel"):
        none, little, some = (run.ranked[name].sigma[6:] for run in by_drag)
        np.testing.assert_allclose(little, none, rtol=0, atol=1e-3 * none.max())
        assert np.isfinite(some).all() and abs(some - none).max() > 1e-2 * none.max()


def controlled(opened: Callable[..., Run], study: Path, gain: float, *overrides: str) -> Run:
    """The hub's rate in yaw drives the thruster over a lag of second order at 60 rad/s."""
    lag = f"A\n0 1\n-3600 -84\nB\n0 0 0\n0 3600 0\nC\n0 0\n{gain} 0\n"
    (study.parent / "k.txt").write_text(lag)
    return opened(f"scene.controller={study.parent / 'k.txt'}", *overrides)


def test_modes_are_ranked_by_the_loop_of_the_controller(opened: Callable[..., Run], study: Path) -> None:
    """The weights are those of the loop around the responses; 20 of 24 modes hold it better than those by cost."""
    full = controlled(opened, study, -2.0, "balance={rank: closed-loop, keep: all}")
    model, k, s = full.joined(full.ranked).assembled, full.controller, 2j * np.pi * np.geomspace(0.3, 200, 300)
    assert k is not None
    K = k.C @ np.linalg.solve(s[:, None, None] * np.eye(2) - k.A, k.B[None])

    def closed(run: Run, configuration: Configuration) -> np.ndarray:
        (G,) = run.model.assembled.responses([configuration], [abs(s)])
        return np.linalg.solve(np.eye(3) + G @ K, G @ K)[:, :2]

    loop = closed_loop(model, full.scene.configurations[0], k)
    assert loop is not None
    T = loop.C @ np.linalg.solve(s[:, None, None] * np.eye(loop.A.shape[0]) - loop.A, loop.B[None])
    np.testing.assert_allclose(-T[:, :2], closed(full, full.scene.configurations[0]), rtol=0, atol=1e-7 * abs(T).max())
    errors = []
    for rank in ("closed-loop", "system-cost"):
        run = controlled(opened, study, -2.0, f"balance={{rank: {rank}, keep: {{total: 20}}}}")
        assert sum(columns.size for columns in run.selection.values()) == 20
        pairs = [(closed(full, each), closed(run, each)) for each in run.scene.configurations]
        errors.append(max(np.linalg.norm(a - b) / np.linalg.norm(a) for a, b in pairs))
    assert errors[0] < 0.8 * errors[1]


def test_another_controller_ranks_anew(opened: Callable[..., Run], study: Path) -> None:
    by_loop, keys, rank = "balance={rank: closed-loop, keep: {total: 20}}", [], []
    for gain in (-0.2, -10.0):
        run = controlled(opened, study, gain, by_loop)
        keys.append(run._system_key("balance"))
        rank.append(run.ranked["arm"].sigma[6:])
    assert keys[0] != keys[1] and abs(rank[0] - rank[1]).max() > 1e-3
    searched = controlled(opened, study, -2.0, "balance={rank: gregory, keep: {frf_error: 0.05}}")
    assert "closed-loop" in searched.ranked["arm"].rankings and searched.choice.search.frf_error <= 0.05


def test_a_loop_without_its_parts_is_refused(opened: Callable[..., Run], study: Path) -> None:
    with pytest.raises(ConfigError, match=r"'balance.rank': closed-loop weighs modes .*name one in scene.controller"):
        opened("balance={rank: closed-loop, keep: all}")
    with pytest.raises(ConfigError, match="no figure without a sensor of its controller"):
        controlled(opened, study, -2.0, "balance={rank: closed-loop, keep: all, sensitivity: true}")
    with pytest.raises(DampingError, match=r"a root at .* that does not decay"):
        _ = controlled(opened, study, 2.0, "balance={rank: closed-loop, keep: all}").ranked


def test_the_nutation_of_rigid_bodies_gives_no_scale(opened: Callable[..., Run]) -> None:
    """At a point of the grid it made the sensors' scales a million times too small; flexible bodies nutate below it."""

    def wheeled(momentum: float) -> Run:
        return opened(
            "scene.joints.hinge.free=[]",
            "scene.articulation=null",
            "scene.actuators={pitch: {at: hub.cg, torque: [0, 1, 1]}}",
            "scene.sensors={gyro: {at: hub.cg, measure: [ry, rz], rate: true}, probe: {at: panel.6, measure: z}}",
            f"components.hub.wheels={{roll: {{axis: x, momentum: {momentum!r} N*m*s}}}}",
        )

    def scales(momentum: float) -> np.ndarray:
        run = wheeled(momentum)
        return system_ranking._scales(run.joined(run.ranked).assembled)[0][0]

    model = (run := wheeled(30.0)).joined(run.ranked).assembled
    one = run.scene.configurations[0]
    rigid = model.system(one)
    nutation = abs(la.eigvals(rigid.rigid.T @ rigid.D @ rigid.rigid)).max()
    grid = system_ranking.frequency_grid(run.scene.band, system_ranking._POINTS, *system_ranking.peaks(model, one))
    at = 30.0 * grid[abs(grid - nutation).argmin()] / nutation
    np.testing.assert_allclose(scales(at), scales(1.003 * at), rtol=0.02)
