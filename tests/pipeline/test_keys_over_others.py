"""Keys of one body, or of a compared mode set, stand over others: one that is left out is not its default."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from cmsreduce.pipeline import Run, execute
from cmsreduce.report.next_steps import next_steps

COMPARED = "verify.compare.other.reduce={{method: craig-bampton{}}}"


def kept(run: Run, study: Path) -> int:
    result = execute(run, study, report=False)
    assert result is not None
    return result.components["arm"].kept_modes


def test_a_default_that_is_written_is_not_one_that_is_left_out(opened: Callable[..., Run], study: Path) -> None:
    """The second run must not reuse the modes of the first."""
    few = kept(opened("balance.keep={modes: 1}", "components.arm.balance={rank: gregory}"), study)
    every = kept(opened("balance.keep={modes: 1}", "components.arm.balance={rank: gregory, keep: all}"), study)
    assert few == 1 < every


@pytest.mark.parametrize(
    ("common", "left_out", "written"),
    [
        ("balance.keep={modes: 1}", "components.arm.balance={rank: gregory}", "{rank: gregory, keep: all}"),
        ("reduce.cutoff=8", COMPARED.format(""), "{method: craig-bampton, cutoff: 2.0}"),
    ],
)
def test_both_have_keys_of_their_own(opened: Callable[..., Run], common: str, left_out: str, written: str) -> None:
    runs = [opened(common, each) for each in (left_out, f"{left_out.partition('=')[0]}={written}")]
    assert runs[0]._system_key("verify") != runs[1]._system_key("verify")


def test_a_body_with_keys_of_its_own_is_read_for_those_of_the_pipeline(opened: Callable[..., Run]) -> None:
    own = "components.arm.reduce={cutoff: 4}"
    one, other = (opened(own, f"reduce.residuals={each}").keyed for each in ("[]", "[sensors]"))
    assert [keys.reduce_of("arm").residuals for keys in (one, other)] == [(), ("sensors",)]


def test_the_advice_on_a_cutoff_starts_from_that_of_the_run(opened: Callable[..., Run], study: Path) -> None:
    own = [f"components.{name}.reduce={{residuals: [sensors]}}" for name in ("arm", "panel")]
    limit = "verify.limits.frf_error=1e-12"
    result = execute(opened("reduce.cutoff=3", *own, "balance.keep=all", limit), study, report=False)
    assert result is not None
    assert any("raise `reduce.cutoff` from 3 to 6" in step for step in next_steps(result))
