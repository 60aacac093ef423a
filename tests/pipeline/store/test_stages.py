"""A stage is done once: in memory, on disk, under the one stage allowed, and among runs that share work."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.errors import MatrixError, StageError
from cmsreduce.linalg.sparse import factorise
from cmsreduce.model import Configuration
from cmsreduce.pipeline.store import CommonWork, Stages, once, stage, stage_key
from tests.pipeline.study import Log

NAMES = ("arm", "panel")


class Bodies:
    """A run of three stages, which counts what is done."""

    def __init__(self, folder: Path, only: str | None = None, common: CommonWork | None = None, scale: float = 1.0):
        self.stages, self.scale, self.calls = Stages(folder, Log(), only, common=common), scale, []
        self.given: dict[str, Any] = {}

    def _notes(self, found: dict[str, Any], name: str) -> Iterator[str]:
        yield f"{name}: {found['shapes'].size} shapes"

    @stage("reduce", key=lambda run, name: stage_key("reduce", name, run.scale), notes=_notes)
    def reduced(self, name: str) -> dict[str, Any]:
        self.calls.append(f"reduced {name}")
        factorise(sp.csc_array(np.eye(3)))
        return {"shapes": np.full(3, self.scale), "order": (name, 1)}

    @property
    @stage("verify", key=lambda run: stage_key("verify", run.scale) if run.scale else None, needs=["every"])
    def verified(self) -> float:
        self.calls.append("verified")
        return float(sum(self.reduced(name)["shapes"].sum() for name in NAMES))

    @property
    def every(self) -> list[dict[str, Any]]:
        return [self.reduced(name) for name in NAMES]

    @stage("read", key=lambda run, name: name, stored="never", common=1)
    def read(self, name: str) -> list[str]:
        self.calls.append(f"read {name}")
        return [name]

    @stage("assemble")
    def assembled(self) -> float:
        return float(factorise(sp.csc_array(-np.eye(3)))(np.ones(3)).sum())


def test_a_stage_is_done_once_and_read_back_by_the_next_run(tmp_path: Path) -> None:
    first, again = Bodies(tmp_path), Bodies(tmp_path)
    assert first.verified == first.verified == 6.0
    assert first.calls == ["reduced arm", "reduced panel", "verified"]
    assert again.verified == 6.0 and again.calls == []
    # What a finished stage made needless is not read, unless somebody asks for it.
    assert again.stages.progress.reused_ == ["verify system"]
    assert again.reduced("arm")["order"] == ("arm", 1)
    np.testing.assert_array_equal(again.reduced("arm")["shapes"], np.ones(3))
    assert again.stages.notes == ["arm: 3 shapes"]
    assert again.stages.seconds["arm"] == first.stages.seconds["arm"]
    assert again.stages.factorised["arm"] == first.stages.factorised["arm"]
    assert [each.rows for each in first.stages.factorised["arm"]["reduce"]] == [3]


def test_earlier_stages_are_announced_and_timed_before_the_one_that_needs_them(tmp_path: Path) -> None:
    run = Bodies(tmp_path)
    _ = run.verified
    assert run.stages.progress.done == ["reduce arm", "reduce panel", "verify system"]
    assert not run.stages.factorised["system"]["verify"]


def test_another_key_is_another_result(tmp_path: Path) -> None:
    assert Bodies(tmp_path).verified == 6.0
    other = Bodies(tmp_path, scale=2.0)
    assert other.verified == 12.0 and len(other.calls) == 3


def test_the_only_stage_is_done_again_and_no_other(tmp_path: Path) -> None:
    with pytest.raises(StageError, match=r"stage 'reduce' of 'arm' is not finished .*run --until verify"):
        _ = Bodies(tmp_path, "verify").verified
    _ = Bodies(tmp_path).verified
    run = Bodies(tmp_path, "verify")
    assert run.verified == 6.0 and run.calls == ["verified"]


def test_a_stage_that_nobody_asks_for_leaves_nothing(tmp_path: Path) -> None:
    run = Bodies(tmp_path, scale=0.0)
    assert run.verified == 0.0
    assert not (tmp_path / "stages" / "system.verify.h5").exists() and "system" not in run.stages.seconds


def test_runs_that_share_work_hold_the_last_results_in_common(tmp_path: Path) -> None:
    common = CommonWork()
    first, second = (Bodies(tmp_path / name, common=common) for name in "ab")
    assert first.read("arm") is second.read("arm")
    assert (first.calls, second.calls) == (["read arm"], []) and second.stages.seconds["arm"] == {"read": 0.0}
    second.read("panel")
    # One result is held: the body before it has gone.
    third = Bodies(tmp_path / "c", common=common)
    assert third.read("panel") == ["panel"] and third.read("arm") == ["arm"] and third.calls == ["read arm"]


def test_linear_algebra_that_fails_is_named_after_its_stage(tmp_path: Path) -> None:
    with pytest.raises(MatrixError, match=r"^assemble of 'system': "):
        Bodies(tmp_path).assembled()


def test_a_result_is_computed_once_for_each_name() -> None:
    class Model:
        calls = 0

        @once
        def of(self, configuration: Configuration) -> int:
            self.calls += 1
            return self.calls

    model, other = Model(), Model()
    assert [model.of(Configuration(name)) for name in ("a", "b", "a")] == [1, 2, 1]
    assert other.of(Configuration("b")) == 1
