"""The fewest modes that meet an error, found by search."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import chain, combinations

import numpy as np
import pytest

from cmsreduce.balance import ChangedResponse, Effects, keep_cheapest, keep_error
from cmsreduce.balance.effects import unreachable
from cmsreduce.errors import ConfigError
from cmsreduce.model import Finding
from tests.balance.test_truncation import BODIES, GROUPED, as_lists, component


def effects_of(columns: Sequence[np.ndarray]) -> Effects:
    """Effects that add up, on a response whose error is a norm: the present error, and the effect of each change."""
    error, *changes = (column.astype(complex) for column in columns)
    added = np.array(changes).reshape(len(changes), -1).T
    responses = (lambda: (error, added), lambda H: np.linalg.norm(H, axis=0), error.size)
    return Effects([ChangedResponse(*responses)])


class Vectors:
    """A judge for which every mode is a vector of a response, and the error what is missing of their sum."""

    def __init__(self, terms: Mapping[tuple[str, int], Sequence[float]]) -> None:
        self.terms = {key: np.asarray(value, dtype=float) for key, value in terms.items()}
        self.calls: list[dict[str, list[int]]] = []

    def missed(self, selection: Mapping[str, np.ndarray]) -> np.ndarray:
        return sum(v for (name, k), v in self.terms.items() if k not in selection[name])  # type: ignore[return-value]

    def error(self, selection: Mapping[str, np.ndarray], limit: float = np.inf) -> float:
        self.calls.append(as_lists(selection))
        exact = float(np.linalg.norm(self.missed(selection)))
        # Beyond the limit as little as may be said.
        return exact if exact <= limit else float(np.nextafter(limit, np.inf))

    def critical(self, selection: Mapping[str, np.ndarray]) -> Finding:
        return Finding("frf_error", self.error(selection), 0.01, "as built")

    def effects(self, selection: Mapping[str, np.ndarray], changes: Sequence[tuple[str, np.ndarray]]) -> Effects:
        columns = [np.zeros_like(next(iter(self.terms.values()))) + self.missed(selection)]
        for name, group in changes:
            sign = 1.0 if np.isin(group, selection[name]).all() else -1.0
            columns.append(sign * sum(self.terms.get((name, int(k)), 0.0) for k in group) + 0 * columns[0])
        return effects_of(columns)


def apart(costs: Mapping[str, Mapping[int, float]]) -> Vectors:
    """Modes whose costs add up as squares."""
    keys = [(name, k) for name, row in costs.items() for k in row]
    return Vectors({key: costs[key[0]][key[1]] * np.eye(len(keys))[number] for number, key in enumerate(keys)})


def ranked(components) -> dict[str, dict[str, np.ndarray]]:
    return {"own": {name: c.sigma for name, c in components.items()}}


COSTS = {"rotor": {2: 0.5, 3: 3.0, 4: 0.1, 5: 2.0}, "stator": {0: 1.0, 1: 0.01}}


@pytest.mark.parametrize(
    ("limit", "expected"),
    [
        (10.0, {"rotor": [], "stator": []}),
        (3.0, {"rotor": [3], "stator": []}),
        (1.2, {"rotor": [3, 5], "stator": []}),
        (0.6, {"rotor": [3, 5], "stator": [0]}),
        (0.2, {"rotor": [2, 3, 5], "stator": [0]}),
        (0.05, {"rotor": [2, 3, 4, 5], "stator": [0]}),
        (0.0, {"rotor": [2, 3, 4, 5], "stator": [0, 1]}),
    ],
)
def test_the_fewest_that_meet_an_error(limit, expected):
    found = keep_error(BODIES, ranked(BODIES), apart(COSTS), limit)
    assert as_lists(found.selection) == expected
    assert found.modes == sum(map(len, expected.values())) and found.error <= limit


def test_modes_ranked_high_but_idle_are_left_out():
    judge = apart({"rotor": {2: 0.5, 3: 0.0, 4: 2.0, 5: 0.0}, "stator": {0: 0.0, 1: 0.0}})
    assert as_lists(keep_error(BODIES, ranked(BODIES), judge, 0.1).selection) == {"rotor": [2, 4], "stator": []}


def test_bodies_without_elastic_modes_keep_none():
    """A cutoff below the first frequency leaves static shapes alone, which are kept in any case."""
    body = {"bar": component("bar", 6, []), "plate": component("plate", 0, [])}
    found = keep_error(body, ranked(body), apart({"bar": {}, "plate": {}}), 0.1)
    assert as_lists(found.selection) == {"bar": [], "plate": []}
    assert (found.modes, found.nearest, found.error) == (0, None, 0.0)


def test_two_modes_are_exchanged_for_one_that_stands_for_both():
    """Mode 0 answers what 1 and 2 do not, and is worth more than both; each of these is worth more than nothing."""
    body = {"bar": component("bar", 0, [1.0, 3.0, 2.0])}
    # Without 0 the rest misses 0.99; without 1 and 2 it misses nothing, without either alone it misses much.
    judge = Vectors({("bar", 0): [0.99, 0.0], ("bar", 1): [0.0, 2.0], ("bar", 2): [0.0, -2.0]})
    assert as_lists(keep_error(body, ranked(body), judge, 0.5).selection) == {"bar": [0]}
    assert as_lists(keep_error(body, ranked(body), judge, 0.995).selection) == {"bar": []}


def test_never_more_than_any_ranking_cut_off_and_as_few_as_there_can_be():
    """Against every set there is, for random responses; and two runs go the same way."""
    rng = np.random.default_rng(3)
    for _ in range(20):
        n = 9
        body = {"bar": component("bar", 0, rng.random(n).tolist())}
        terms = {("bar", k): rng.standard_normal(12) * rng.choice([0.06, 0.6]) for k in range(n)}
        rankings = {name: {"bar": rng.random(n)} for name in ("a", "b", "c")}
        judge = Vectors(terms)
        limit = 0.6
        found, again = (keep_error(body, rankings, Vectors(terms), limit) for _ in range(2))
        assert as_lists(found.selection) == as_lists(again.selection) and found.tried == again.tried
        assert judge.error(found.selection) == found.error <= limit
        for coefficients in rankings.values():
            order = np.argsort(-coefficients["bar"])
            cut = next(k for k in range(n + 1) if judge.error({"bar": order[:k]}) <= limit)
            assert found.modes <= cut
        every = chain.from_iterable(combinations(range(n), k) for k in range(n + 1))
        fewest = next(len(s) for s in every if judge.error({"bar": np.array(s, dtype=int)}) <= limit)
        assert found.modes == fewest


def test_after_a_refusal_the_search_goes_on_to_as_few_as_there_can_be():
    """A result that its judge refuses, again and again; against every set there is, with fewer predictions."""
    rng, predictions = np.random.default_rng(17), {"on": 0, "anew": 0}
    for _ in range(5):
        body = {"bar": component("bar", 0, rng.random(9).tolist())}
        terms = {("bar", k): rng.standard_normal(12) * rng.choice([0.06, 0.6]) for k in range(9)}
        refused: set[tuple[int, ...]] = set()

        class Refusing(Vectors):
            def error(self, selection, limit=np.inf, refused=refused):
                return np.inf if tuple(selection["bar"].tolist()) in refused else super().error(selection, limit)

            def effects(self, selection, changes):
                predictions[self.kind] += 1
                return super().effects(selection, changes)

        judge, found = Refusing(terms), None
        for _ in range(4):
            for judge.kind, earlier in (("anew", None), ("on", found)):
                found = keep_error(body, ranked(body), judge, 0.6, after=earlier)
            sets = (s for k in range(10) for s in combinations(range(9), k))
            fewest = next(len(s) for s in sets if judge.error({"bar": np.array(s, dtype=int)}) <= 0.6)
            assert found.modes == fewest and judge.error(found.selection) == found.error <= 0.6
            refused.add(tuple(found.selection["bar"].tolist()))
    assert predictions["on"] < 0.8 * predictions["anew"]


@pytest.mark.parametrize("size", [2, 3])
def test_modes_that_cancel_together_are_left_out_together(size: int) -> None:
    """Any part of a group is missed far beyond the limit, the whole group is not; against every set there is."""
    rng = np.random.default_rng(size)
    for _ in range(8):
        terms = rng.standard_normal((10, 4))
        for last in range(size - 1, 10, size):
            terms[last] = 0.01 * rng.standard_normal(4) - terms[last - size + 1 : last].sum(axis=0)
        sigma, every = np.linalg.norm(terms, axis=1), (np.arange(2**10)[:, None] >> np.arange(10)) & 1
        passes = np.linalg.norm((1 - every) @ terms, axis=1) <= 0.3
        body = {"bar": component("bar", 0, sigma.tolist())}
        judge = Vectors({("bar", k): term for k, term in enumerate(terms)})
        assert keep_error(body, ranked(body), judge, 0.3).modes == every[passes].sum(axis=1).min()


def test_exchanges_follow_only_where_so_few_modes_are_of_use_that_they_may_reach_them():
    """Pruning leaves three modes of six; two of these cancel, and leave one."""
    terms = np.array([[1.0, 0.0], [-1.0, 0.02], [0.0, 1.0], [0.0, 0.4], [0.0, -0.4], [0.2, 0.0]])
    body = {"bar": component("bar", 0, np.linalg.norm(terms, axis=1).tolist())}

    def found(below: int | None):
        return keep_error(
            body, ranked(body), Vectors({("bar", k): term for k, term in enumerate(terms)}), 0.21, below=below
        )

    fewest, again, hopeless = found(None), found(3), found(1)
    assert (fewest.modes, again.modes) == (1, 1)
    assert hopeless.modes == 3 and hopeless.tried < fewest.tried and hopeless.error <= 0.21


def test_how_far_rankings_get_by_themselves_is_told():
    judge = apart(COSTS)
    costs = {name: np.full(c.omega.size, np.nan) for name, c in BODIES.items()}
    for name, row in COSTS.items():
        for k, cost in row.items():
            costs[name][k] = cost
    found = keep_error(BODIES, {**ranked(BODIES), "cost": costs}, judge, 0.2)
    # In the order 3, 5, stator 0, 2: the first by either; the second is followed only below the first.
    assert found.truncated == {"own": 4}
    worse = {name: 1 / sigma for name, sigma in ranked(BODIES)["own"].items()}
    found = keep_error(BODIES, {"worse": worse, "cost": costs}, judge, 0.2)
    assert found.truncated == {"worse": 6, "cost": 4}


def test_an_error_below_what_all_modes_reach_is_refused():
    judge = apart(COSTS)
    judge.missed = lambda _: np.array([0.3])  # type: ignore[method-assign]
    with pytest.raises(ConfigError, match=r"frf_error 0\.01 cannot be met: all 6 modes .* leave 0\.3 in as built"):
        keep_error(BODIES, ranked(BODIES), judge, 0.01)


@pytest.mark.parametrize(("kinds", "offered"), [(("fixed",), True), (("fixed", "residual"), False), (("free",), False)])
def test_inertia_shapes_are_offered_where_none_are_kept(kinds, offered):
    said = unreachable(Finding("frf_error", 0.3, 0.01), 6, all_of_them=True, kinds=set(kinds))
    assert ("{inertia: true}" in said) is offered and "Raise reduce.cutoff" in said


def test_a_long_list_is_bracketed_rather_than_tried():
    sigma = np.geomspace(1.0, 1e-3, 600)
    body = {"long": component("long", 0, sigma.tolist())}
    judge = apart({"long": {k: 1.0 if k < 37 else 0.0 for k in range(600)}})
    assert keep_error(body, ranked(body), judge, 0.5).selection["long"].tolist() == list(range(37))
    assert len(judge.calls) < 60


def test_an_error_never_splits_a_repeated_mode():
    """The mode at column 6 alone would do; its group comes, and the pair, ranked higher but idle, goes whole."""
    judge = apart({"frame": {6: 2.0}})
    assert as_lists(keep_error(GROUPED, ranked(GROUPED), judge, 0.1).selection) == {"frame": [5, 6, 7]}
    for call in judge.calls:
        assert len({2, 3} & set(call["frame"])) in (0, 2) and len({5, 6, 7} & set(call["frame"])) in (0, 3)


def test_effects_of_changes_together_are_summed_unless_they_are_known_together():
    effects = effects_of([np.array([1.0, 0.0]), np.array([0.0, 2.0]), np.array([-1.0, 0.5])])
    np.testing.assert_allclose(effects.predicted(np.array([[0], [1]])), [np.sqrt(5.0), 0.5])
    np.testing.assert_allclose(effects.predicted(np.array([[0, 1]])), [2.5])
    (own,) = effects.configurations
    known = replace(own, together=lambda sets: np.full((2, len(sets)), 3.0 + 4j), alone=np.array([True, True]))
    np.testing.assert_allclose(Effects([known]).predicted(np.array([[0, 1]])), [np.hypot(5.0, 5.0)])
    one = replace(known, alone=np.array([True, False]))
    np.testing.assert_allclose(Effects([one]).predicted(np.array([[0, 1]])), [2.5])
    # The largest of all configurations counts, and what is above a limit is not followed.
    assert Effects([own, known]).predicted(np.array([[0, 1]]))[0] == pytest.approx(np.hypot(5.0, 5.0))
    assert np.isinf(Effects([own, known]).predicted(np.array([[0, 1]]), 5.0)).all()


def test_the_cheapest_set_may_have_more_modes():
    """The fast mode 3 does what 0 and 1 do together; the price is the number of modes times the highest frequency."""
    body = {"bar": component("bar", 0, [1.0, 1.0, 0.1, 3.0], [1.0, 2.0, 3.0, 50.0])}
    judge = Vectors({("bar", 0): [1.0, 0.0], ("bar", 1): [0.0, 1.0], ("bar", 2): [0.01, 0.0], ("bar", 3): [1.0, 1.0]})
    judge.missed = lambda selection: np.clip(  # type: ignore[method-assign]
        [1.0, 1.0] - sum((judge.terms[("bar", int(k))] for k in selection["bar"]), np.zeros(2)), 0, None
    )

    def price(selection: Mapping[str, np.ndarray]) -> float:
        omega = body["bar"].omega[selection["bar"]]
        return omega.size * float(omega.max(initial=0.0))

    assert as_lists(keep_error(body, ranked(body), judge, 0.5).selection) == {"bar": [3]}
    assert as_lists(keep_cheapest(body, ranked(body), judge, 0.5, price).selection) == {"bar": [0, 1]}
    # Where a step costs nothing, the fewest stay.
    assert as_lists(keep_cheapest(body, ranked(body), judge, 0.5, lambda s: s["bar"].size).selection) == {"bar": [3]}


class Unforeseen(Vectors):
    """A judge with a second figure that no prediction shows and that more modes may worsen, as of peaks and zeros."""

    def __init__(self, terms: Mapping[tuple[str, int], Sequence[float]], seed: int) -> None:
        super().__init__(terms)
        self.seed = seed

    def error(self, selection: Mapping[str, np.ndarray], limit: float = np.inf) -> float:
        members = sorted((name, int(k)) for name, columns in selection.items() for k in columns)
        if len(members) == len(self.terms):
            return super().error(selection, limit)
        number = sum(2 ** list(self.terms).index(member) for member in members)
        return max(super().error(selection, limit), 20 * float(np.random.default_rng([self.seed, number]).random()))


@pytest.mark.parametrize(("n", "seed"), [(8, 0), (8, 2), (8, 7), (8, 11), (12, 1), (12, 16), (12, 19), (12, 32)])
def test_as_few_as_there_can_be_where_errors_cannot_be_predicted(n: int, seed: int):
    """All smaller sets of eight modes are tried; of twelve, exchanges reach them."""
    rng = np.random.default_rng(seed)
    body = {"bar": component("bar", 0, rng.random(n).tolist())}
    judge = Unforeseen({("bar", k): (0.3 if n == 8 else 0.25) * rng.standard_normal(6) for k in range(n)}, seed)
    found = keep_error(body, ranked(body), judge, 1.0)
    sets = chain.from_iterable(combinations(range(n), count) for count in range(found.modes))
    assert judge.error(found.selection) <= 1.0 and found.modes > 1
    assert all(judge.error({"bar": np.array(some, dtype=np.int64)}) > 1.0 for some in sets)
