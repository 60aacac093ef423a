"""Files that another program writes while a run reads them: nothing is kept that is not of its key's content."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import cmsreduce as cms
from cmsreduce import steps
from cmsreduce.errors import ReadError
from cmsreduce.pipeline import Run
from cmsreduce.pipeline.bodies import parameters, proven_bodies
from cmsreduce.pipeline.run import choice
from cmsreduce.pipeline.store import CommonWork
from cmsreduce.read.files import read_head


@pytest.fixture
def part(study: Path) -> Path:
    """A file that the deck of the arm includes, which no key names."""
    deck, part = study.parent / "arm.bdf", study.parent / "grids.bdf"
    part.write_text(deck.read_text().replace("BEGIN BULK\n", "").replace("ENDDATA\n", ""))
    deck.write_text("BEGIN BULK\nINCLUDE 'grids.bdf'\nENDDATA\n")
    return part


def rewrite(path: Path) -> None:
    """Other bytes that mean the same to the reader."""
    path.write_bytes(path.read_bytes() + (b"" if path.suffix == ".op4" else b"$ again\n"))
    if path.suffix == ".op4":
        content = bytearray(path.read_bytes())
        # A digit beyond those that matter.
        content[len(content) // 2] ^= 1
        path.write_bytes(content)


@pytest.mark.parametrize("name", ["arm.op4", "arm.bdf", "grids.bdf"])
def test_a_file_that_changes_while_it_is_read_is_refused(
    opened: Callable[..., Run], part: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    prove = proven_bodies.prove_row_order

    def slow(*args: Any) -> Any:
        rewrite(part.parent / name)
        return prove(*args)

    monkeypatch.setattr(proven_bodies, "prove_row_order", slow)
    with pytest.raises(ReadError, match=rf"{name}: changed while this run read it"):
        opened().flexible("arm")
    monkeypatch.undo()
    assert not [*(part.parent / "out").rglob("arm.read*")]


def test_a_file_that_changes_after_its_key_was_made_is_refused(opened: Callable[..., Run], part: Path) -> None:
    run = opened()
    run.proof_key("arm")
    rewrite(part.parent / "arm.bdf")
    with pytest.raises(ReadError, match=r"arm\.bdf: changed while this run read it"):
        run.flexible("arm")
    assert not [*(part.parent / "out").rglob("arm.read*")]


def test_unit_loads_of_another_included_file_are_others(opened: Callable[..., Run], part: Path) -> None:
    def made() -> list[str]:
        run = opened("components.arm.rows={set: a, trusted: true}")
        run.stages.common = CommonWork()
        run.unit_loads("arm")
        return [entry for entry in run.stages.progress.done if entry == "reference arm.static"]

    assert made()
    assert not made()
    part.write_text(part.read_text().replace("6.000000000E-01", "6.100000000E-01"))
    assert made()


def rewriting(path: Path, read: Callable[..., Any]) -> Callable[..., Any]:
    """A reader whose file has other bytes before it has returned."""

    def slow(*args: Any, **keys: Any) -> Any:
        found = read(*args, **keys)
        rewrite(path)
        return found

    return slow


def test_matrices_of_parameters_and_controllers_that_change_are_refused(
    opened: Callable[..., Run], study: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    heavy, loop = (study.parent / name for name in ("heavy.op4", "loop.op4"))
    for path in (heavy, loop):
        path.write_bytes((study.parent / "arm.op4").read_bytes())
    slow = rewriting(heavy, parameters.read_parameter_matrix)
    monkeypatch.setattr(parameters, "read_parameter_matrix", slow)
    with pytest.raises(ReadError, match=r"heavy\.op4: changed while this run read it"):
        opened(f"scene.parameters={{p: {{values: [0, 1], mass: {{arm: {{file: {heavy}, matrix: MAA}}}}}}}}").flexible(
            "arm"
        )
    monkeypatch.setattr(choice, "read_controller", rewriting(loop, lambda path, *_: read_head(path, 1)))
    with pytest.raises(ReadError, match=r"loop\.op4: changed while this run read it"):
        opened(f"scene.controller={{file: {loop}}}")


@pytest.mark.parametrize("name", ["arm.op4", "grids.bdf"])
def test_files_of_a_body_read_from_python_that_change_are_refused(
    part: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setattr(steps, "read_from_files", rewriting(part.parent / name, steps.read_from_files))
    file, deck = part.parent / "arm.op4", part.parent / "arm.bdf"
    with pytest.raises(ReadError, match=rf"{name}: changed while this run read it"):
        cms.read_body("arm", stiffness=(file, "KAA"), mass=(file, "MAA"), geometry=deck)
