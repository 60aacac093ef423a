"""`cutoff: auto`: raised where a body needs it, no further; and notes of what a basis lacks."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

from cmsreduce.errors import ConfigError
from cmsreduce.pipeline import Run, execute
from cmsreduce.pipeline.choose.cutoff import MOST, START, choose_cutoffs


def falling(**strength: float) -> Callable[[Mapping[str, float]], Mapping[str, float]]:
    """Errors that fall with the fourth power of the cutoff."""
    return lambda cutoffs: {name: strength[name] / cutoff**4 for name, cutoff in cutoffs.items()}


def test_only_the_body_in_need_is_raised() -> None:
    found = choose_cutoffs(["soft", "stiff"], 0.02, falling(soft=0.4, stiff=1e-3))
    assert found["stiff"].cutoff_bands == START and found["stiff"].tried == ()
    # Half of 0.02 is for both bodies: 0.4 / c^4 = 0.005 at c = 2.99.
    assert 2.99 <= found["soft"].cutoff_bands < 1.25 * 2.99
    assert found["soft"].error <= found["soft"].limit == pytest.approx(0.005)
    assert found["soft"].tried[0] == (START, 0.4 / START**4)
    assert "soft: cutoff auto raised from 1.5 to" in found["soft"].note()
    assert "stiff: cutoff auto stays at 1.5 x the band" in found["stiff"].note()


@pytest.mark.parametrize(
    ("errors", "words"),
    [(lambda cutoffs: dict.fromkeys(cutoffs, 0.1), "macneal-rubin"), (falling(arm=1e4), "state a higher cutoff")],
)
def test_the_search_ends_with_a_clear_note(errors: Callable[..., Mapping[str, float]], words: str) -> None:
    found = choose_cutoffs(["arm"], 0.01, errors)["arm"]
    assert found.cutoff_bands == MOST and found.error > found.limit
    note = found.note()
    assert "stopped at 8 x the band" in note and words in note


AUTO = ("reduce={cutoff: auto}", "scene.articulation={hinge: [50 deg]}")


def true_error(run: Run) -> float:
    return max(result.errors["reduced"].frf_error for result in run.verified.configurations)


@pytest.mark.parametrize("method", ["craig-bampton", "macneal-rubin"])
def test_the_chosen_cutoffs_meet_the_error_asked_for(opened: Callable[..., Run], method: str) -> None:
    run = opened(*AUTO, f"reduce.method={method}", "verify.limits.frf_error=0.1")
    assert true_error(run) < 0.1
    for name, choice in run.cutoffs.items():
        assert choice.error <= choice.limit == pytest.approx(0.1 / 2 / 2)
        assert choice.note(run.mode_sets.remedies(name)) in run.stages.notes
        assert run.modal(name).certificate is None or run.modal(name).certificate.cutoff_hz == pytest.approx(
            60 * choice.cutoff_bands
        )


def test_less_is_asked_where_more_error_is_allowed(opened: Callable[..., Run]) -> None:
    loose, tight = (opened(*AUTO, "reduce.method=macneal-rubin", f"verify.limits.frf_error={e}") for e in (0.2, 1e-4))
    sizes = [sum(run.modal(name).basis_size for name in run.bodies) for run in (loose, tight)]
    assert sizes[0] < sizes[1]


def test_the_choice_is_kept_and_found_again(opened: Callable[..., Run]) -> None:
    first, again = opened(*AUTO), opened(*AUTO)
    cutoffs = first.cutoffs
    first.modal("arm")
    again.modal("arm")
    assert again.cutoffs == cutoffs
    assert {"reduce auto.cutoff", "orthogonalise arm"} <= set(again.stages.progress.reused_)
    # The same cutoff, stated, is the same reduction.
    stated = opened(f"reduce={{cutoff: {cutoffs['arm'].cutoff_bands}}}", AUTO[1])
    assert stated.mode_sets.reduce_key("arm") == first.mode_sets.reduce_key("arm")
    asked = opened(*AUTO, "verify.limits.frf_error=0.2")
    assert asked.cutoffs != cutoffs


def test_a_stated_cutoff_is_left_alone(opened: Callable[..., Run]) -> None:
    run = opened(*AUTO, "components.arm.reduce={cutoff: 2.0}")
    assert run.cutoffs.keys() == {"panel"}
    assert run.modal("arm").certificate is None or run.modal("arm").certificate.cutoff_hz == 120.0


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (("scene.actuators={}",), "needs a response to measure"),
        (("components.arm.damping=null", "components.panel.damping=null"), "resonances are infinite"),
        (("reduce.method=guyan",), "no normal modes"),
        (("verify.compare={other: {reduce: {cutoff: auto}}}",), "the run's own model"),
    ],
)
def test_where_there_is_nothing_to_look_for(opened: Callable[..., Run], settings: tuple[str, ...], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        run = opened(*AUTO, *settings)
        run.modal("arm")
        _ = run.verified


def test_a_missing_static_shape_is_named_with_its_share(opened: Callable[..., Run]) -> None:
    bare, whole = opened("reduce={cutoff: 1}"), opened("reduce={cutoff: 1, residuals: [sensors]}")
    for run in (bare, whole):
        run.modal("panel")
    lacking = [note for note in bare.stages.notes if "no static shape for sensor 'probe'" in note]
    assert len(lacking) == 1 and "lacks 4% of the static flexibility there" in lacking[0]
    assert not any("no static shape" in note for note in whole.stages.notes)
    # A run that goes on from there says it again.
    again = opened("reduce={cutoff: 1}")
    again.modal("panel")
    assert lacking[0] in again.stages.notes


def test_loaded_modes_lack_static_shapes_at_their_joints(opened: Callable[..., Run]) -> None:
    run = opened("reduce={method: augmented, cutoff: 4}")
    run.modal("arm")
    assert any("arm: its basis has no static shape for interface 'root'" in note for note in run.stages.notes)


def test_the_summary_has_the_choice_under_keys_of_its_own(opened: Callable[..., Run], study: Path) -> None:
    run = opened(
        *AUTO, "reduce.method=macneal-rubin", "verify.limits={frf_error: 1e-4}", "components.arm.reduce.cutoff=4"
    )
    execute(run, study, report=False)
    parts = json.loads((run.folder / "summary.json").read_text())["components"]
    found, choice = parts["panel"]["cutoff"], run.cutoffs["panel"]
    expected = choice.cutoff_bands, choice.error, choice.limit
    assert (found["multiple"], found["estimate"], found["allowed"]) == expected
    assert found["tried"] == [list(each) for each in choice.tried] and found["tried"][0][0] == START
    assert parts["panel"]["certificate"]["cutoff_hz"] == pytest.approx(60 * found["multiple"])
    assert parts["arm"]["cutoff"] is None
