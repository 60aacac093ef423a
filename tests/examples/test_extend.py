"""The examples of docs/extend.md: each file has tests of its own, which run here."""

from __future__ import annotations

import inspect
import runpy
from collections.abc import Iterator
from pathlib import Path

import pytest

from cmsreduce.balance import RANKINGS
from cmsreduce.read import FORMATS, GEOMETRY_FORMATS
from cmsreduce.reduce import METHODS
from cmsreduce.write import TARGETS

EXAMPLES = sorted((Path(__file__).parents[2] / "examples" / "extend").glob("*.py"))


@pytest.fixture
def own_tables() -> Iterator[None]:
    """Tables of formats, mode sets, rankings and targets without what an example registers in them."""
    tables: tuple[dict[str, object], ...] = (FORMATS, GEOMETRY_FORMATS, METHODS, RANKINGS, TARGETS)
    before = [dict(table) for table in tables]
    yield
    for table, entries in zip(tables, before, strict=True):
        table.clear()
        table.update(entries)


@pytest.mark.usefixtures("own_tables")
@pytest.mark.parametrize("example", EXAMPLES, ids=lambda path: path.stem)
def test_an_extension_passes_its_tests(example: Path, tmp_path: Path) -> None:
    tests = [found for name, found in runpy.run_path(str(example)).items() if name.startswith("test_")]
    assert tests
    for test in tests:
        test(*[tmp_path] * len(inspect.signature(test).parameters))
