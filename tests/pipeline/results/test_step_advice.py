"""Advice of a run: its figures against scipy and textbooks, and whether what it offers does what it says."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import h5py
import numpy as np
import pytest
import scipy.linalg as la
from click.testing import CliRunner

import cmsreduce as cms
from cmsreduce.cli import main
from cmsreduce.config import load_pipeline
from cmsreduce.errors import MatrixError
from cmsreduce.model import Configuration, RoundingEffect
from cmsreduce.pipeline import Run, Silent, execute
from cmsreduce.pipeline.results import result
from cmsreduce.pipeline.results.step_advice import advice_notes, treated_model
from cmsreduce.pipeline.system import AssembledModel
from cmsreduce.write import TARGETS, convert
from tests.pipeline.study import PANEL, write_study

FREE = (
    """\
name: free
output: {output}
components:
"""
    + PANEL
    + """\
scene:
  band: 60 Hz
  actuators: {{push: {{at: panel.5, force: [0, 0, 1]}}}}
  sensors: {{probe: {{at: panel.6, measure: [z]}}}}
reduce: {{method: craig-bampton, cutoff: 30}}
verify: {{frf: {{points: 60}}, limits: {{frf_error: 0.01, frequency_error: 1e-3}}}}
write: {{formats: [hdf5]}}
"""
)


def run(folder: Path, *overrides: str) -> dict:
    path = write_study(folder, FREE)
    pipeline = load_pipeline(path, overrides)
    execute(Run(pipeline, pipeline.output, Silent()), path, report=False)
    return json.loads((folder / "out" / "summary.json").read_text())


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> dict:
    return run(tmp_path_factory.mktemp("plain"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("treated")


@pytest.fixture(scope="module")
def treated(plain: dict, folder: Path) -> dict:
    """The same run with the keys that its note names."""
    (note,) = (note for note in plain["notes"] if note.startswith("static treatment"))
    keys = re.findall(r"(components\S+): ([0-9.e+]+)[,)]", note)
    assert [key for key, _ in keys] == ["components.panel.reduce.static_above"]
    return run(folder, *(f"{key}={value}" for key, value in keys))


def test_steps_are_those_of_the_highest_frequency(plain: dict) -> None:
    """Central differences stand 2 / w; 1 % of modified Euler and of the trapezoidal rule is 0.483 and 0.350 / w."""
    for facts in (plain["components"]["panel"]["integration"], plain["system"][0]["integration"]):
        w = 2 * np.pi * facts["highest_hz"]
        assert facts["highest_hz"] == pytest.approx(max(plain["components"]["panel"]["frequencies_hz"]), rel=1e-9)
        assert facts["steps"]["central_difference"]["stable"] * w == pytest.approx(2.0)
        for name, expected in (("modified_euler", 0.49), ("trapezoidal", 0.346), ("ab2", 0.155)):
            assert facts["steps"][name]["1_percent"] * w == pytest.approx(expected, rel=0.02)
        assert facts["steps"]["ab2"]["stable"] == 0.0 and facts["steps"]["trapezoidal"]["stable"] is None


def test_highest_frequency_of_the_assembly(finished_study: Path) -> None:
    """By scipy from the assembled matrices in system.h5."""
    facts = json.loads((finished_study / "out" / "summary.json").read_text())
    with h5py.File(finished_study / "out" / "system.h5") as file:
        for number, setting in enumerate(facts["system"]):
            K, M = (file[f"configuration_{number}/{letter}"][()] for letter in "KM")
            expected = np.sqrt(la.eigh(K, M, eigvals_only=True)[-1]) / (2 * np.pi)
            assert setting["integration"]["highest_hz"] == pytest.approx(expected, rel=1e-9)


def test_costly_modes_are_named_and_nothing_is_dropped(plain: dict) -> None:
    part = plain["components"]["panel"]
    costly = part["integration"]["costly"]
    assert part["kept_modes"] == part["elastic_modes"]
    above = [hz for hz in part["frequencies_hz"] if hz > costly["serving_hz"] * (1 + 1e-12)]
    np.testing.assert_allclose([each["hz"] for each in costly["modes"]], above)
    note = next(note for note in plain["notes"] if " of panel (to " in note)
    assert f"{above[-1]:.4g} Hz" in note


def test_static_treatment_gives_the_step_that_was_promised(plain: dict, treated: dict) -> None:
    promised = plain["system"][0]["integration"]["static_highest_hz"]
    assert treated["system"][0]["integration"]["highest_hz"] == pytest.approx(promised, rel=1e-9)
    assert promised < plain["system"][0]["integration"]["highest_hz"] / 4
    assert treated["components"]["panel"]["static_modes"] == len(
        plain["components"]["panel"]["integration"]["costly"]["modes"]
    )
    # And the run that measures it passes with the same error.
    assert treated["passed"]
    assert treated["worst"]["frf_error"] == pytest.approx(plain["worst"]["frf_error"], rel=0.05)


def test_static_treatment_keeps_the_static_response(plain: dict, treated: dict, folder: Path, tmp_path: Path) -> None:
    """The root's flexibility, from the file, is that of all modes."""
    run(tmp_path)

    def flexibility(path: Path) -> np.ndarray:
        with h5py.File(path) as file:
            stiffness, r = np.diag(file["modes/stiffness"][()]), file["modes"].attrs["rigid_count"]
            S = file["interfaces/root/shapes"][()]
            return S[:, r:] / stiffness[r:] @ S[:, r:].T

    expected = flexibility(tmp_path / "out" / "panel.h5")
    found = flexibility(folder / "out" / "panel.h5")
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * abs(expected).max())


def test_the_file_of_a_treated_body_is_whole(treated: dict, folder: Path, tmp_path: Path) -> None:
    """It passes its checks, and codes that solve implicitly take it."""
    file = folder / "out" / "panel.h5"
    result = CliRunner().invoke(main, ["check", str(file)])
    assert result.exit_code == 0, result.output
    for name in ("nastran", "exudyn", "mbdyn", "treetops"):
        assert convert(file, tmp_path / f"panel{TARGETS[name].suffix}", name)


@pytest.mark.parametrize(
    ("effect", "said"),
    [
        (RoundingEffect(3e-8, 5e-8, 0.0, 1e-5, 1e-3, 20.0), []),
        (RoundingEffect(3e-8, 5e-8, 0.0, 1e-5, 0.3, 20.0), ["a rigid motion would get 0.3 Hz"]),
        (RoundingEffect(3e-8, 2e-3, 0.0, float("inf"), 0.0, 20.0), ["frequencies change by 2.0e-03", "change by inf"]),
    ],
    ids=["none", "as a superelement", "both"],
)
def test_a_body_that_seven_digits_do_not_hold_is_named(effect: RoundingEffect, said: list[str]) -> None:
    part = SimpleNamespace(costly=None, rounding=effect)
    notes = list(advice_notes({"strip": part}, (), 10.0))
    assert len(notes) == len(said)
    assert all(note.startswith("strip: ") and words in note for note, words in zip(notes, said, strict=True))


def test_where_joints_take_the_gain_away_the_run_says_so(finished_study: Path) -> None:
    facts = json.loads((finished_study / "out" / "summary.json").read_text())
    (note,) = (note for note in facts["notes"] if note.startswith("static treatment"))
    assert "springs without mass" in note
    assert max(each["integration"]["static_highest_hz"] for each in facts["system"]) > max(
        each["integration"]["highest_hz"] for each in facts["system"]
    )


def test_a_proposal_that_cannot_be_solved_blames_no_matrix(study: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Static treatment of a long chain leaves combinations without mass, which rounding hides or shows."""

    def unsolvable(run: Run, costly: object) -> AssembledModel:
        model = treated_model(run, costly)
        assert model is not None

        def every_mode(self: AssembledModel, configuration: Configuration) -> None:
            raise MatrixError("8 modes cannot be told apart: a combination of them has no mass")

        model.__class__ = type("Unsolvable", (AssembledModel,), {"every_mode": every_mode})
        return model

    monkeypatch.setattr(result, "treated_model", unsolvable)
    facts = cms.run(study, out=study.parent / "out").summary
    assert facts["failures"] == [] and facts["passed"]
    assert [each["integration"]["static_highest_hz"] for each in facts["system"]] == [None, None]
    (note,) = (note for note in facts["notes"] if note.startswith("static treatment"))
    assert "Hz without bound, as joints would act on springs without mass" in note


def test_single_precision_is_reported_and_can_be_limited(finished_study: Path, opened: Callable[..., Run]) -> None:
    facts = json.loads((finished_study / "out" / "summary.json").read_text())
    effect = facts["components"]["arm"]["single_precision"]
    assert 0 < effect["free"] <= 2**-25 * (1 + 1e-6)
    file = str(finished_study / "out" / "arm.h5")
    shown = CliRunner().invoke(main, ["check", file])
    assert "float32: change of frequencies" in shown.output and shown.exit_code == 0
    strict = CliRunner().invoke(main, ["check", file, "--max", "float32: change of frequencies=1e-12"])
    assert strict.exit_code == 1
    inspected = CliRunner().invoke(main, ["inspect", file])
    assert "in single precision: frequencies change by" in inspected.output
