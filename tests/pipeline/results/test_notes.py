"""A note is printed where it is true: of this model, of keys that are not set, of steps that get longer."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace

import pytest

from cmsreduce.model import CostlyMode, CostlyModes, CutoffChoice
from cmsreduce.pipeline import Run
from cmsreduce.pipeline.results.step_advice import advice_notes
from tests.pipeline.study import ARM


def test_notes_of_a_compared_model_name_it(opened: Callable[..., Run]) -> None:
    compared = "verify.compare={bare: {reduce: {method: benfield-hruda}}, low: {reduce: {cutoff: 1}}}"
    plain, run = opened("verify.frf.points=40"), opened("verify.frf.points=40", compared)
    for each in (plain, run):
        _ = each.verified
    own, more = plain.stages.notes, [note for note in run.stages.notes if note not in plain.stages.notes]
    assert set(own) <= set(run.stages.notes)
    assert any(note.startswith("compared model 'bare': arm: benfield-hruda loads it") for note in more)
    assert any(note.startswith("compared model 'low': panel: its basis has no static shape") for note in more)
    assert all(note.startswith("compared model '") for note in more)
    # A key of the run would change the run's own model.
    assert not any("to its `residuals`" in note for note in more)


def test_residuals_are_advised_by_the_key_that_adds_them_and_not_where_they_are(opened: Callable[..., Run]) -> None:
    bare, whole = opened("reduce={cutoff: 1}"), opened("reduce={cutoff: 1, residuals: [sensors]}")
    for run in (bare, whole):
        run.modal("panel")
    (note,) = (note for note in bare.stages.notes if "sensor 'probe'" in note)
    assert note.endswith("; add `sensors` to its `residuals`")
    assert not any("residuals" in note for note in whole.stages.notes)


GROUNDED = (
    """\
name: grounded
output: {output}
components:
"""
    + ARM
    + """\
scene:
  band: 60 Hz
  ground: arm.root
  actuators: {{push: {{at: arm.5, force: [0, 0, 1]}}}}
  sensors: {{probe: {{at: arm.5, measure: [z]}}}}
reduce: {{method: benfield-hruda, cutoff: 4}}
"""
)


def test_loaded_modes_of_a_held_body_need_nothing_at_its_support_and_have_no_neighbours(
    opened: Callable[..., Run],
) -> None:
    """The modes are at rest at the support already."""
    run = opened(text=GROUNDED)
    run.modal("arm")
    assert any("interface 'tip'" in note for note in run.stages.notes)
    assert not any("interface 'root'" in note or "loads it by its neighbours" in note for note in run.stages.notes)


@pytest.mark.parametrize(
    ("method", "residuals", "words"),
    [
        ("craig-bampton", "[]", "try method macneal-rubin, or `residuals: [sensors]`, or allow a larger error"),
        ("craig-bampton", "[sensors]", "try method macneal-rubin, or allow a larger error"),
        ("macneal-rubin", "[]", "try `residuals: [sensors]`, or allow a larger error"),
        ("macneal-rubin", "[sensors]", "state a higher cutoff, or allow a larger error"),
    ],
)
def test_a_search_for_a_cutoff_advises_what_is_not_set(
    opened: Callable[..., Run], method: str, residuals: str, words: str
) -> None:
    run = opened(f"reduce={{method: {method}, cutoff: auto, residuals: {residuals}}}")
    vain = CutoffChoice("panel", 8.0, 0.1, 0.01, ((1.5, 0.1),))
    assert vain.note(run.mode_sets.remedies("panel")).endswith(words)


def steps(highest: float, treated: float) -> str:
    """What a run says of static treatment that changes its highest frequency so."""
    costly = CostlyModes((CostlyMode(9, 438.0, "fixed", 1e-5),), 100.0, 2.0, 1e-3)
    part = SimpleNamespace(costly=costly, rounding=None)
    system = SimpleNamespace(highest_hz=highest, treated_hz=treated)
    return list(advice_notes({"panel": part}, (system,), 60.0))[-1]


@pytest.mark.parametrize(
    ("searched", "said"),
    [
        (None, "`balance: {keep: limits}` leaves out"),
        ("modes", "`balance: {keep: {limits: all, minimise: cost}}` may"),
        ("cost", "the search for the lowest cost found no model without them"),
    ],
)
def test_costly_modes_are_left_to_a_search_that_the_run_has_not_made(searched: str | None, said: str) -> None:
    costly = CostlyModes((CostlyMode(9, 438.0, "fixed", 1e-5),), 100.0, 2.0, 1e-3)
    (note,) = advice_notes({"panel": SimpleNamespace(costly=costly, rounding=None)}, (), 60.0, searched)
    assert note.startswith("modes 9 of panel (to 438 Hz) limit") and said in note


def test_static_treatment_is_advised_only_where_steps_get_longer() -> None:
    assert "lowers the assembly's highest frequency from 438 Hz to 100 Hz, for steps 4.38 times" in steps(438.0, 100.0)
    worse = steps(438.0, 9082.0)
    assert "would raise the assembly's highest frequency from 438 Hz to 9082 Hz" in worse
    assert "springs without mass" in worse and "longer" not in worse
    # Another body sets the highest frequency: it cannot fall, and no spring is to blame.
    same = steps(9082.0, 9082.0)
    assert "would hardly change" in same and "springs" not in same


def test_a_body_that_is_not_reduced_enters_as_the_note_says(opened: Callable[..., Run]) -> None:
    """In its modes where its damping is stated for them, and in its dofs where it is not."""
    for damping, words in (("{modal: 0.01}", "in all its modes"), ("{structural: 0.02}", "as it was read")):
        run = opened(
            "components.panel.reduce={cutoff: 15}", "reduce=null", "balance=null", f"components.arm.damping={damping}"
        )
        _ = run.model
        assert f"arm: not reduced; it enters the system {words}" in run.stages.notes
