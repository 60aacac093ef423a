"""The page on the architecture names halls, rooms, files and functions that are there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.docs.pages import ROOT

PACKAGE = ROOT / "cmsreduce"
TEXT = (ROOT / "docs" / "architecture.md").read_text()
STEPS = re.findall(r"^\| `([\w/]+\.py)` \| `(\w+)` \|", TEXT, re.M)


@pytest.mark.parametrize(("file", "name"), STEPS)
def test_a_step_of_a_walk_is_there(file: str, name: str) -> None:
    assert re.search(rf"(def|class) {name}\b|^    {name}: ", (PACKAGE / file).read_text(), re.M)


def test_the_walks_have_their_steps() -> None:
    assert len(STEPS) > 20


@pytest.mark.parametrize("room", sorted(path.parent for path in PACKAGE.rglob("__init__.py") if path.parent != PACKAGE))
def test_every_hall_and_room_is_named(room: Path) -> None:
    (row,) = re.findall(rf"^\| `{room.relative_to(PACKAGE).parts[0]}` \|.*$", TEXT, re.M)
    assert all(f"`{part}`" in row for part in room.relative_to(PACKAGE).parts)
