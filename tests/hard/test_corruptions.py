"""Some of the corruptions of docs/health.md; `python benchmarks/corruptions.py` makes all of them."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.hard.corruptions.plated import plated
from tests.hard.corruptions.rows import ROWS, Row
from tests.hard.corruptions.study import Study, outcome

# Rows that are refused before anything is reduced take no time; of those that run to their end, a few.
_SOME = (
    "two nodes exchanged in M",
    "x and y of a node exchanged in M",
    "all nodes of M in reverse",
    "rows of both shuffled, body said to be grounded",
    "floating body said to be grounded",
    "two nodes exchanged in D",
    "K and M exchanged",
    "K x 1000, deck",
    "weight for mass (M x 9.81), deck",
    "dashpot to ground",
    "negative damping of one mode",
    "modal damping of 500 % for 5 %",
    "bending of a panel of plates four times, deck",
    "soft spring to ground",
    "sensors missing",
    "limits missing",
    "Guyan",
    "matrix file cut in half",
    "NaN in K",
)


def test_the_study_itself_passes(tmp_path: Path) -> None:
    found = outcome(Study(deck=True), tmp_path)
    assert (found.code, found.line) == (0, "PASS")


def test_the_study_passes_with_plates(tmp_path: Path) -> None:
    study = Study(deck=False)
    plated()(study)
    found = outcome(study, tmp_path)
    assert (found.code, found.line) == (0, "PASS")


@pytest.mark.parametrize("row", [row for row in ROWS if row.what in _SOME], ids=lambda row: row.what)
def test_corruption_is_found(row: Row, tmp_path: Path) -> None:
    study = Study(deck=row.deck)
    row.change(study)
    found = outcome(study, tmp_path)
    assert found.found != bool(row.unseen), f"{row.what}: exit code {found.code}, {found.line}"
    assert found.line


def test_rows_are_of_the_table() -> None:
    names = [row.what for row in ROWS]
    assert len(names) == len(set(names)) >= 60
    assert set(_SOME) <= set(names)
