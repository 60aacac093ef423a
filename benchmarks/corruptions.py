"""Corruptions of bodies and scenes, each run from its recipe: what finds it, or what a user compares.

Prints the table; ``--write`` puts it into benchmarks/corruptions.md. Exit code 1 if a corruption that has to be found
passes.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
# The recipes live with the tests, which are not installed.
sys.path.insert(0, str(ROOT))

from tests.hard.corruptions.rows import ROWS, Row  # noqa: E402
from tests.hard.corruptions.study import Outcome, Study, outcome  # noqa: E402

PAGE = ROOT / "benchmarks/corruptions.md"
INTRODUCTION = """\
# Corruptions of bodies and scenes

A sound study (two frames of bars, a rigid hub, a hinge at two angles, limits on errors) is spoiled in {count} ways, and
run. `python benchmarks/corruptions.py --write` prints this page and fails if a corruption that has to be found gives
PASS: {found} are found, {unseen} cannot be seen. For these the table says why, with the figures that every run prints
and that a user compares with the finite-element code; the sound study has {sound}.

Exit code 2: the run is refused. Exit code 1: the verdict is FAIL.
"""
HEADER = "| what was done | found by | exit code | first line, or figures to compare |\n|---|---|---|---|"
_LONGEST = 170


def run(row: Row) -> Outcome:
    """Outcome of one corruption."""
    study = Study(deck=row.deck)
    row.change(study)
    with tempfile.TemporaryDirectory() as folder:
        return outcome(study, Path(folder))


def line(row: Row, found: Outcome) -> str:
    """Line of the table."""
    finder, text = row.finder, found.line
    if row.unseen:
        finder, text = f"nothing: {row.unseen}", f"{found.line}; {found.figures}"
    if len(text) > _LONGEST:
        text = text[:_LONGEST].rsplit(" ", 1)[0] + " ..."
    cells = (cell.replace("|", "\\|") for cell in (row.what, finder, str(found.code), text))
    return f"| {' | '.join(cells)} |"


def main() -> int:
    """Run all rows; the exit code."""
    with tempfile.TemporaryDirectory() as folder:
        sound = outcome(Study(deck=True), Path(folder))
    if (sound.code, sound.line) != (0, "PASS"):
        print(f"the sound study does not pass: {sound.line}", file=sys.stderr)
        return 1
    table, wrong = [], []
    for row in ROWS:
        found = run(row)
        table.append(line(row, found))
        if found.found == bool(row.unseen) or found.code not in (0, 1, 2):
            wrong.append(f"{row.what}: exit code {found.code}, {found.line}")
    unseen = sum(bool(row.unseen) for row in ROWS)
    introduction = INTRODUCTION.format(count=len(ROWS), found=len(ROWS) - unseen, unseen=unseen, sound=sound.figures)
    page = "\n".join([introduction, HEADER, *table]) + "\n"
    if "--write" in sys.argv:
        PAGE.write_text(page, encoding="utf-8")
    else:
        print(page)
    for text in wrong:
        print(f"NOT AS EXPECTED: {text}", file=sys.stderr)
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
