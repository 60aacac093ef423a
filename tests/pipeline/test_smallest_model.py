"""`keep: limits`: a model passes its own limits with no more modes than any other choice, by independent algebra."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.config import load_pipeline
from cmsreduce.errors import ConfigError
from cmsreduce.model import SearchRecord
from cmsreduce.pipeline import Run, Silent, execute
from cmsreduce.pipeline.results import run_result
from cmsreduce.pipeline.system import selection_cost
from tests.pipeline.study import CANTILEVER

PIPELINES = Path(__file__).parents[2] / "pipelines"
# Channels of one unit, which need no scales.
TIPS = "scene.sensors={right_tip: {at: right.141, measure: y}, left_tip: {at: left.241, measure: y}}"
ZETA = 0.005


class Hub:
    """The plane hub of mass 5 and inertia 3 with two hinged beams in their modes, joined by hand."""

    def __init__(self, beams: Mapping[str, tuple[np.ndarray, np.ndarray, Mapping[str, int]]]) -> None:
        # For each beam: frequencies, shapes, rows of hinge y, hinge rz and tip y.
        omega = [np.zeros(2), *(w for w, _, _ in beams.values())]
        self.omega = np.concatenate(omega)
        self.owner = np.repeat(np.arange(3), [w.size for w in omega])
        mass = np.concatenate([[5.0, 3.0], *(np.ones(w.size) for w in omega[1:])])
        n, arms = self.omega.size, {"right": 0.6, "left": -0.5}
        self.joint, self.inputs, self.outputs = np.zeros((2, n)), np.zeros((n, 3)), np.zeros((2, n))
        self.inputs[1] = 1.0, -1.0, -1.0
        for k, (name, (_, Phi, rows)) in enumerate(beams.items()):
            own = self.owner == k + 1
            self.joint[k, :2], self.joint[k, own] = (1.0, arms[name]), -Phi[rows["y"]]
            self.inputs[own, 1 + k], self.outputs[k, own] = Phi[rows["rz"]], Phi[rows["tip"]]
        self.mass = mass

    def reduced(self, kept: np.ndarray) -> tuple[np.ndarray, ...]:
        """M, D, K, B, C with some coordinates, the hinges joined."""
        Z = la.null_space(self.joint[:, kept])
        w, m = self.omega[kept], self.mass[kept]
        M, D, K = (Z.T @ (diagonal[:, None] * Z) for diagonal in (m, 2 * ZETA * w, w**2))
        return M, D, K, Z.T @ self.inputs[kept], self.outputs[:, kept] @ Z

    def response(self, kept: np.ndarray, omega: np.ndarray) -> np.ndarray:
        M, D, K, B, C = self.reduced(kept)
        Z = K + 1j * omega[:, None, None] * D - omega[:, None, None] ** 2 * M
        return C @ np.linalg.solve(Z, B.astype(complex)[None])

    def frequencies(self, kept: np.ndarray) -> np.ndarray:
        M, _, K, _, _ = self.reduced(kept)
        return np.sqrt(np.maximum(la.eigvalsh(K, M), 0.0))[4:]


def hub_of(run: Run, modes: Callable[[str], tuple[np.ndarray, np.ndarray]]) -> Hub:
    beams = {}
    for name, tip in (("right", 141), ("left", 241)):
        body = run.bodies[name].body
        y, rz = (int(body.dofs.rows(tip - 40, np.array([k]))[0]) for k in (2, 6))
        beams[name] = (*modes(name), {"y": y, "rz": rz, "tip": int(body.dofs.rows(tip, np.array([2]))[0])})
    return Hub(beams)


def whole(run: Run, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Every mode of a beam, from its matrices; two are rigid."""
    lam, Phi = la.eigh(run.bodies[name].body.K.toarray(), run.bodies[name].body.M.toarray())
    return np.sqrt(np.concatenate([np.zeros(2), lam[2:]])), Phi


class Judged:
    """Limits on the response, the decibels and the frequencies of the hub, by the formulas of the guide."""

    def __init__(self, full: Hub, limits: Mapping[str, float], band: float) -> None:
        self.limits, self.band = limits, band
        every = np.arange(full.omega.size)
        self.frequencies = full.frequencies(every)
        near = self.frequencies[self.frequencies < 1.3 * band]
        spread = np.concatenate([[0.0], np.geomspace(0.05, 100, 25)]) * ZETA
        peaks = np.concatenate([w * (1 + sign * spread) for w in near for sign in (-1, 1)])
        grid = np.unique(np.concatenate([np.geomspace(band / 1000, band, 150), peaks]))
        self.omega, self.bode = grid[(grid >= band / 1000) & (grid <= band)], np.geomspace(band / 1000, band, 1000)
        self.full, self.full_bode = full.response(every, self.omega), full.response(every, self.bode)
        # Rigid motion is the same in every choice: 1/w^2 of the response far below the first mode.
        low = np.array([1e-4 * band])
        rigid = full.response(every, low) * (low / self.omega)[:, None, None] ** 2
        power = np.sum(abs(self.full - rigid) ** 2, axis=(1, 2))
        step = np.diff(self.omega)
        self.weight = (np.r_[0, step] + np.r_[step, 0]) / 2 / np.trapezoid(power, self.omega)
        self.hardest = np.argsort(-self.weight * power)[:16]

    def frf_error(self, model: Hub, kept: np.ndarray, at: np.ndarray) -> float:
        """Response error; of some frequencies alone it is smaller, as no weight of the integral is negative."""
        miss = np.sum(abs(model.response(kept, self.omega[at]) - self.full[at]) ** 2, axis=(1, 2))
        return float(np.sqrt(np.sum(self.weight[at] * miss)))

    def ratio(self, model: Hub, kept: np.ndarray, enough: float = 1.0) -> float:
        """Largest error over its limit, or any lower bound above ``enough``."""
        w, w_full = model.frequencies(kept), self.frequencies
        count = int(np.sum(w_full <= self.band))
        if w.size < count and enough < np.inf:
            return np.inf
        # A mode that is missing is as far away as it can be.
        w = np.concatenate([w, np.full(count, 2 * self.band)])
        worst = float((abs(w[:count] - w_full[:count]) / w_full[:count]).max()) / self.limits["frequency_error"]
        for at in (self.hardest, np.arange(self.omega.size)):
            if worst > enough:
                return worst
            worst = max(worst, self.frf_error(model, kept, at) / self.limits["frf_error"])
        if worst > enough:
            return worst
        apart = abs(20 * np.log10(abs(model.response(kept, self.bode)) / abs(self.full_bode)))
        return max(worst, float(np.percentile(apart, 99, axis=0).max()) / self.limits["db_error"])


def searched_hub(folder: Path, limits: Mapping[str, float], cutoff: float) -> tuple[Hub, Judged, SearchRecord]:
    """The candidates of the hub by hand, their judge, and the search of a run, of whose measure the judge agrees."""
    written = ", ".join(f"{name}: {limit}" for name, limit in limits.items())
    keys = ["balance={keep: limits}", f"verify.limits={{{written}}}", TIPS, f"reduce.cutoff={cutoff}", "write=null"]
    run = Run(load_pipeline(PIPELINES / "hub_beams.yaml", keys), folder, Silent())
    search = run.choice.search
    assert search is not None and search.critical.ratio <= 1
    parts = {name: run.modal(name) for name in ("right", "left")}
    model = hub_of(run, lambda name: (parts[name].omega, np.asarray(parts[name].Phi)))
    judged = Judged(hub_of(run, lambda name: whole(run, name)), limits, 20.0)
    start = {"right": 2, "left": 2 + parts["right"].omega.size}
    found = [int(start[name] + k) for name, own in run.selection.items() for k in own]
    assert judged.ratio(model, with_rigid(model, found)) == pytest.approx(search.critical.ratio, rel=0.02)
    return model, judged, search


def with_rigid(model: Hub, chosen: Sequence[int]) -> np.ndarray:
    """Coordinates of a choice: rigid motion stays."""
    return np.sort(np.concatenate([np.flatnonzero(model.omega == 0), np.array(chosen, dtype=int)]))


@pytest.mark.parametrize(
    "limits",
    [
        {"frf_error": 0.1, "db_error": 1.0, "frequency_error": 2e-3},
        {"frf_error": 0.5, "db_error": 0.3, "frequency_error": 0.05},
        {"frf_error": 0.9, "db_error": 30.0, "frequency_error": 2e-4},
    ],
)
def test_no_smaller_set_of_modes_meets_the_limits(tmp_path: Path, limits: dict[str, float]) -> None:
    """Each limit decides once; every smaller set breaks one, by another assembly and other grids."""
    model, judged, search = searched_hub(tmp_path, limits, 4)
    elastic = np.flatnonzero(model.omega > 0).tolist()
    assert len(elastic) == search.of <= 13
    fewer = (chosen for size in range(search.modes) for chosen in combinations(elastic, size))
    assert all(judged.ratio(model, with_rigid(model, chosen)) > 1 for chosen in fewer)


def test_no_greedy_search_finds_a_smaller_model(tmp_path: Path) -> None:
    """Too many modes for every set: one mode more or less at a time, always the best one, by the other assembly."""
    limits = {"frf_error": 0.2, "db_error": 0.5, "frequency_error": 0.05}
    model, judged, search = searched_hub(tmp_path, limits, 24)
    elastic = np.flatnonzero(model.omega > 0).tolist()
    assert len(elastic) == search.of == 20

    def error(chosen: list[int], enough: float = 1.0) -> float:
        return judged.ratio(model, with_rigid(model, chosen), enough)

    def best(choices: list[list[int]], most: float) -> list[int] | None:
        """The choice with the smallest error of those up to ``most``: each is followed up to the best before it."""
        found = None
        for chosen in choices:
            if (reached := error(chosen, most)) <= most:
                found, most = chosen, reached
        return found

    fewest = list(elastic)
    while (fewer := best([[each for each in fewest if each != k] for k in fewest], 1.0)) is not None:
        fewest = fewer
    grown: list[int] = []
    while error(grown) > 1 and len(grown) < len(fewest):
        grown = best([[*grown, k] for k in elastic if k not in grown], np.inf) or list(elastic)
    assert search.modes <= min(len(fewest), len(grown))


def test_the_run_passes_and_says_what_stood_in_the_way(opened: Callable[..., Run], study: Path) -> None:
    """The verdict is the measure of the search; the limit in the way is broken without one mode more."""
    run = opened(
        "balance.keep=limits", "verify.limits={frf_error: 0.01, db_error: 3.0, static_lack: 90 %}", text=CANTILEVER
    )
    result = execute(run, study, report=False)
    assert result is not None and result.passed
    search, critical = result.search, result.critical
    assert search is not None and critical == search.critical and 0 < critical.ratio <= 1
    assert search.obstacle is not None and search.obstacle.ratio > 1 and search.obstacle.note
    (note,) = (note for note in result.notes if note.startswith("search"))
    assert f"fewer would break {search.obstacle.name}" in note and search.obstacle.note in note
    assert search.modes < search.of
    # The limits are a part of what the choice depends on: others are another choice.
    looser = opened("balance.keep=limits", "verify.limits={frf_error: 60 %}", text=CANTILEVER)
    assert sum(own.size for own in looser.selection.values()) < search.modes


def test_midpoint_configurations_count(opened: Callable[..., Run]) -> None:
    keys = ("balance.keep=limits", "verify.limits={frf_error: 0.02}")
    result = run_result(opened(*keys))
    between = next(each for each in result.judged if "between" in each.name)
    assert result.passed and between.ratio <= 1


@pytest.mark.parametrize(
    ("limits", "words"),
    [
        (
            "{frf_error: 1e-9}",
            r"keep: frf_error 1e-09 cannot be met: all \d+ modes below the cutoff leave .* in as built",
        ),
        ("{controller_ratio: 0.5}", "keep: controller_ratio cannot be judged .*the scene has no controller"),
        ("{}", "`limits` keeps the smallest model that meets verify.limits: state one there"),
    ],
)
def test_limits_that_no_choice_meets_are_named(opened: Callable[..., Run], limits: str, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        _ = opened("balance.keep=limits", f"verify.limits={limits}", text=CANTILEVER).selection


def test_a_limit_on_the_highest_frequency_leaves_out_fast_modes(opened: Callable[..., Run]) -> None:
    """Without the fastest mode of all the highest frequency of the assembled system falls below the limit."""
    every = run_result(opened("balance.keep=all", text=CANTILEVER))
    top = max(each.highest_hz or 0.0 for each in every.systems)
    limits = f"verify.limits={{frf_error: 300 %, highest_frequency: {0.99 * top}}}"
    run = opened("balance.keep=limits", limits, text=CANTILEVER)
    result = run_result(run)
    highest = max(each.highest_hz or 0.0 for each in result.systems)
    assert result.passed and highest <= 0.99 * top
    assert run.ranked["arm"].elastic.stop - 1 not in run.selection["arm"]
    with pytest.raises(ConfigError, match=r"frf_error 0\.001 cannot be met: all \d+ modes that other limits allow"):
        _ = opened(
            "balance.keep=limits",
            f"verify.limits={{frf_error: 0.001, highest_frequency: {0.1 * top}}}",
            text=CANTILEVER,
        ).selection


def test_the_cost_of_a_simulation_is_minimised_under_the_limits(opened: Callable[..., Run]) -> None:
    """As many operations as the run itself finds, and never more than with the fewest modes."""
    limits = "verify.limits={frf_error: 0.3}"
    fewest = opened("balance.keep=limits", limits, text=CANTILEVER)
    cheapest = opened("balance.keep={limits: all, minimise: cost}", limits, text=CANTILEVER)
    result = run_result(cheapest)
    search, speed = result.search, result.speed
    assert result.passed and search is not None and speed.simulation is not None
    assert search.operations == speed.simulation.reduced.operations
    assert f"{search.operations:.3g} operations" in search.words
    price = selection_cost(fewest.ranked, fewest.joined)
    assert price(cheapest.selection) == search.operations <= price(fewest.selection)
    with pytest.raises(ConfigError, match="minimise: cost searches among models that meet the limits"):
        opened("balance.keep={frf_error: 0.1, minimise: cost}", text=CANTILEVER)
