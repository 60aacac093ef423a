"""A summary.json that was edited or damaged: `check` and `diff` refuse it, also where no figure contradicts another."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from cmsreduce.cli import main
from tests.sealed import resealed_summary


@pytest.fixture
def copied(finished_study: Path, tmp_path: Path) -> Path:
    """Results of a run."""
    shutil.copytree(finished_study / "out", tmp_path / "run", ignore=lambda *_: ["stages"])
    return tmp_path / "run"


def call(*args: Any) -> Result:
    return CliRunner().invoke(main, [str(arg) for arg in args])


def test_an_edited_summary_is_refused_whatever_was_edited(copied: Path) -> None:
    """A body, a check or a limit that is gone: what is left passes, and no figure contradicts another."""
    path = copied / "summary.json"
    whole = path.read_text()
    edits: dict[str, Callable[[dict[str, Any]], Any]] = {
        "components": lambda facts: facts["components"].pop("panel"),
        "figures": lambda facts: facts["figures"].pop("db_error"),
        "limits": lambda facts: facts["limits"].update(frf_error=1.0),
        "verdict": lambda facts: facts["verdict"]["proofs"].clear(),
        "notes": lambda facts: facts.pop("notes"),
        "mine": lambda facts: facts.update(mine=1),
    }
    for key, edit in edits.items():
        facts = json.loads(whole)
        edit(facts)
        path.write_text(json.dumps(facts))
        for command in (("check", copied), ("diff", copied, copied)):
            said = call(*command)
            assert (said.exit_code, said.stderr.count("error: ")) == (2, 1)
            assert re.search(rf"summary\.json: its content is not what was written \(\w+: {key}\)", said.stderr)


def test_another_layout_of_a_summary_is_no_edit(copied: Path) -> None:
    """As other programs write JSON: without spaces, keys sorted, whole numbers without a point."""
    path = copied / "summary.json"
    facts = json.loads(path.read_text(), parse_float=lambda text: int(float(text)) if float(text) == 0 else float(text))
    path.write_text(json.dumps(facts, sort_keys=True, separators=(",", ":")))
    assert call("check", copied).exit_code == 0


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"passed": False, "word": "FAIL"}, "states FAIL, but its figures give PASS"),
        ({"passed": True, "word": "FAIL"}, "states FAIL, but `passed` is True"),
        ({"passed": False, "word": "PASS"}, "states PASS, but `passed` is False"),
    ],
)
def test_figures_that_contradict_the_verdict_are_refused(copied: Path, change, says: str) -> None:
    with resealed_summary(copied / "summary.json") as facts:
        facts["passed"], facts["verdict"]["word"] = change["passed"], change["word"]
    result = call("check", copied)
    assert result.exit_code == 2 and says in result.stderr


def without_seal(run: Path) -> dict[str, Any]:
    """Content of a summary as earlier versions wrote it."""
    facts: dict[str, Any] = json.loads((run / "summary.json").read_text())
    del facts["seal"]
    return {**facts, "version": "0.1.0"}


@pytest.mark.parametrize("version", ["0.2.0.dev0", "0.2.0", "1.0"])
def test_a_removed_seal_is_an_edit(copied: Path, version: str) -> None:
    facts = {**without_seal(copied), "version": version}
    facts["limits"]["frf_error"] = 1.0
    (copied / "summary.json").write_text(json.dumps(facts))
    for command in (("check", copied), ("diff", copied, copied)):
        said = call(*command)
        assert (said.exit_code, said.stderr.count("error: ")) == (2, 1)
        assert "summary.json: its content is not what was written (removed: seal); run the pipeline" in said.stderr


@pytest.mark.parametrize("damage", ['"speed": [[]]', '"deep": ' + "[" * 5000])
def test_a_damaged_summary_is_one_message(copied: Path, damage: str) -> None:
    facts = without_seal(copied)
    del facts["speed"]
    (copied / "summary.json").write_text(json.dumps(facts).removesuffix("}") + f", {damage}}}")
    for command in (("check", copied), ("diff", copied, copied)):
        done = call(*command)
        assert (done.exit_code, done.stderr.count("error: ")) == (2, 1) and "run the pipeline again" in done.stderr


def test_a_check_without_its_value_is_a_damaged_summary(copied: Path) -> None:
    facts = without_seal(copied)
    del facts["components"]["arm"]["checks"][0]["value"]
    (copied / "summary.json").write_text(json.dumps(facts))
    result = call("check", copied)
    assert result.exit_code == 2 and "its summary.json is damaged" in result.stderr


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (("components",), []),
        (("components", "arm", "frequencies_hz"), None),
        (("components", "arm", "frequencies_hz", 0), {}),
        (("components", "arm", "seconds"), None),
        (("components", "arm", "static_lack", 0), "x"),
        (("components", "arm", "kept_modes"), []),
    ],
)
def test_a_summary_of_an_earlier_version_with_another_kind_of_value_is_damaged(
    copied: Path, place: tuple[Any, ...], value: Any
) -> None:
    facts = part = without_seal(copied)
    for key in place[:-1]:
        part = part[key]
    part[place[-1]] = value
    (copied / "summary.json").write_text(json.dumps(facts))
    result = call("check", copied)
    assert result.exit_code == 2 and "summary.json" in result.stderr and "run the pipeline again" in result.stderr
