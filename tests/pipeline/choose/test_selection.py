"""A search for modes whose models are measured again on grids of their own."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from cmsreduce.balance import Selection
from cmsreduce.config import RankingKeys
from cmsreduce.errors import ConfigError
from cmsreduce.model import Finding
from cmsreduce.pipeline.choose.selection import Choice, select
from tests.balance.test_search import Vectors
from tests.balance.test_truncation import component

LIMIT = 0.5
Kept = tuple[int, ...]


class Factor(dict[Kept, float]):
    """Ratios of all sets by a rule."""

    def __init__(self, rule: Callable[[Kept], float]) -> None:
        self.rule = rule

    def get(self, kept: Kept, default: float | None = None) -> float:  # type: ignore[override]
        return self.rule(kept)


class Grids(Vectors):
    """Six modes alike, of which any three meet the limit by a tenth on these grids; some sets miss it on their own."""

    own: Mapping[Kept, float]

    def __init__(self, own: Mapping[Kept, float]) -> None:
        super().__init__({("bar", k): 0.9 * LIMIT / np.sqrt(3) * np.eye(6)[k] for k in range(6)})
        self.own, self.limit = own, LIMIT
        self.refused: dict[Kept, float] = {}
        self.tightened = self.exact_calls = 0
        self.error_of: Callable[[Kept], float] = lambda kept: 0.9 * float(np.sqrt((6 - len(kept)) / 3))

    def error(self, selection: Mapping[str, np.ndarray], limit: float = np.inf) -> float:
        kept = tuple(selection["bar"].tolist())
        return self.refused.get(kept, self.error_of(kept) * LIMIT / self.limit)

    def below_highest(self) -> None:
        return None

    def refuse(self, selection: Selection, missed: Finding) -> None:
        self.refused[tuple(selection["bar"].tolist())] = missed.ratio

    def tighten(self, name: str, factor: float) -> None:
        self.limit *= factor
        self.tightened += 1

    def relax(self) -> bool:
        lower, self.limit = self.limit < LIMIT, LIMIT
        return lower

    def exact(self, selection: Selection) -> SimpleNamespace:
        kept = tuple(selection["bar"].tolist())
        self.exact_calls += 1
        value = LIMIT * self.own.get(kept, self.error_of(kept))
        critical = Finding("frf_error", value, LIMIT, "as built")
        return SimpleNamespace(critical=critical, findings={}, limits={"frf_error": LIMIT})

    def chosen(self) -> Choice:
        bodies = {"bar": component("bar", 0, [6.0, 5.0, 4.0, 3.0, 2.0, 1.0])}
        keys = RankingKeys.model_validate({"keep": "limits"})
        return select(bodies, keys, {}, lambda: (self, self.exact))  # type: ignore[arg-type, return-value]


THREE = [(0, 1, 2), (0, 1, 3), (0, 1, 4), (0, 1, 5), (0, 2, 3), (0, 2, 4), (0, 2, 5)]


@pytest.mark.parametrize("ratio", [1.7, np.inf])
def test_a_model_that_misses_a_limit_on_its_own_grid_gives_way_to_one_of_as_few_modes(ratio: float) -> None:
    """The limit stays: at 0.5 / 1.7 all modes together would be needed."""
    judge = Grids(dict.fromkeys(THREE, ratio))
    found = judge.chosen().selection["bar"]
    assert found.size == 3 and tuple(found.tolist()) not in judge.own
    assert not judge.tightened


def test_models_that_all_miss_a_limit_by_little_lower_it() -> None:
    """Errors on own grids are 1.13 times as large: four modes are needed, and not all 20 sets of three are tried."""
    judge = Grids({})
    judge.own = Factor(lambda kept: 1.13 * 0.9 * np.sqrt((6 - len(kept)) / 3))
    found = judge.chosen().selection["bar"]
    assert found.size == 4 and judge.tightened and judge.exact_calls < 20


def test_a_limit_that_no_model_meets_any_more_is_restored() -> None:
    """All sets of three modes or more have 0.985 of the limit on these grids, those of three 1.01 on their own."""
    judge = Grids({})
    judge.error_of = lambda kept: 0.985 if len(kept) >= 3 else 2.0
    judge.own = Factor(lambda kept: 1.01 if len(kept) == 3 else judge.error_of(kept))
    found = judge.chosen().selection["bar"]
    assert found.size == 4 and judge.tightened and judge.limit == LIMIT


def test_without_a_model_that_meets_it_the_message_has_the_stated_limit() -> None:
    judge = Grids({})
    judge.exact = lambda selection: SimpleNamespace(  # type: ignore[method-assign]
        critical=Finding("frf_error", 1.3 * LIMIT, LIMIT, "as built"), findings={}, limits={}
    )
    with pytest.raises(ConfigError, match=r"no model was found that meets frf_error 0\.5 .* reached 0\.65"):
        judge.chosen()


@pytest.mark.parametrize(
    ("keep", "said"),
    [
        ({"total": 1}, ("6 modes are kept where `total: 1` asks for fewer",)),
        ({"total": 6}, ()),
        ({"modes": 1}, ()),
        ({"modes": {"leg3": 3}}, ("leg3: 4 modes are kept where 3 are asked for",)),
        ({"modes": {"leg3": 4}}, ()),
    ],
)
def test_more_modes_than_the_number_asked_for_are_named(keep: dict[str, object], said: tuple[str, ...]) -> None:
    """Six equal legs: a mode of one, then one of four frequencies of which two are equal."""
    legs = {f"leg{k}": component(f"leg{k}", 0, [9.0, 3.0, 2.0, 2.0]) for k in range(6)}
    for name, leg in legs.items():
        legs[name] = replace(leg, omega=np.array([1.0, 2.0, 3.0, 3.0]))
    keys = RankingKeys.model_validate({"rank": "system-cost", "keep": keep})
    found = select(legs, keys, {}).notes
    assert len(found) == len(said)
    for note, start in zip(found, said, strict=True):
        assert note.startswith(start)
        assert "stay together" in note
