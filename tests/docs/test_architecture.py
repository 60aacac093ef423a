"""The page on the architecture names halls, rooms, files and functions that are there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.docs.pages import ROOT

PACKAGE = ROOT / "cmsreduce"
TEXT = (ROOT / "docs" / "architecture.md").read_text()
STEPS = re.findall(r"^\| \d+ \| ([^|]*) \| `([\w/]+\.py)` \|$", TEXT, re.M)


@pytest.mark.parametrize(("functions", "file"), STEPS)
def test_a_step_of_a_walk_is_there(functions: str, file: str) -> None:
    code = (PACKAGE / file).read_text()
    for name in re.findall(r"`([\w.]+)`", functions.partition(":")[0].partition(" (")[0]):
        assert all(re.search(rf"\b(def|class) {part}\b|^ *{part}(:| =)", code, re.M) for part in name.split(".")), name


def test_the_walks_have_their_steps() -> None:
    assert len(STEPS) > 15


@pytest.mark.parametrize("room", sorted(path.parent for path in PACKAGE.rglob("__init__.py") if path.parent != PACKAGE))
def test_every_hall_and_room_is_named(room: Path) -> None:
    assert all(re.search(rf"\b{part}\b", TEXT) for part in room.relative_to(PACKAGE).parts)


@pytest.mark.parametrize("path", sorted(set(re.findall(r"`([\w]+(?:/[\w]+)*(?:\.py|/))`|`(\w+/\w+)`", TEXT))))
def test_every_file_is_there(path: tuple[str, str]) -> None:
    name = "".join(path).rstrip("/")
    assert (PACKAGE / name).exists() or (ROOT / name).exists(), name
