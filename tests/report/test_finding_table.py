"""Findings and inspections on a terminal, and as lines where there is none."""

from __future__ import annotations

import io
import math
import re

import pytest
from rich.console import Console

from cmsreduce.model import Finding, judge
from cmsreduce.report import InspectedLine, Output, print_findings, print_inspected

FINDINGS = (
    Finding("frf_error", 0.02, 0.01, "at spin=0 [x]"),
    Finding("kept_modes", 19, 25, subject="rotor"),
    Finding("float32: change", 1e-5, math.inf, subject="rotor"),
)
VERDICT = judge(FINDINGS, (), limited=True)
ROWS = [
    InspectedLine("study.yaml:"),
    InspectedLine("30 dofs", "arm", depth=1),
    InspectedLine("mass 1.164, centre of mass 0.4 0 0", depth=2),
    InspectedLine("    x      y      z", "effective mass, per cent", depth=2, in_columns=True),
    InspectedLine("  0.0    2.0  100.0", "mode 1, 2.5 Hz", depth=3, in_columns=True),
    InspectedLine("0 (limit 1)", "rows: same mass", "pass", depth=2),
]
LINES = [
    "study.yaml:",
    "  arm: 30 dofs",
    "    mass 1.164, centre of mass 0.4 0 0",
    "    effective mass, per cent                     x      y      z",
    "      mode 1, 2.5 Hz                           0.0    2.0  100.0",
    "    pass  rows: same mass: 0 (limit 1)",
]


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def terminal_of(monkeypatch: pytest.MonkeyPatch, width: int = 120) -> Terminal:
    stream = Terminal()
    monkeypatch.setattr("sys.stdout", stream)
    monkeypatch.setattr("rich.console.Console", lambda **_: Console(file=stream, force_terminal=True, width=width))
    return stream


def plain(text: str) -> str:
    return re.sub(r"\x1b\[[\d;]*m", "", text)


def test_a_terminal_has_a_table_with_the_failed_last(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = terminal_of(monkeypatch)
    log = io.StringIO()
    print_findings(FINDINGS, VERDICT, Output(log=log))
    rows = [line.split() for line in plain(terminal.getvalue()).splitlines() if line.split()]
    rows = [row for row in rows if row[0] in ("pass", "info", "FAIL")]
    assert [row[:5] for row in rows] == [
        ["pass", "rotor", "kept_modes", "19", "25"],
        ["info", "rotor", "float32:", "change", "1e-05"],
        ["FAIL", "run", "frf_error", "0.02", "0.01"],
    ]
    # Brackets in a name are no markup.
    assert rows[-1][5:] == ["at", "spin=0", "[x]"]
    assert log.getvalue().splitlines()[0] == "FAIL  frf_error: 0.02 (limit 0.01) - at spin=0 [x]"


def test_no_terminal_has_a_line_for_each(capsys: pytest.CaptureFixture[str]) -> None:
    print_findings(FINDINGS, VERDICT, Output())
    assert [line[:4] for line in capsys.readouterr().out.splitlines()] == ["FAIL", "pass", "info"]
    print_findings(FINDINGS, VERDICT, Output(quiet=True))
    assert capsys.readouterr().out == "FAIL  frf_error: 0.02 (limit 0.01) - at spin=0 [x]\n"
    print_findings(FINDINGS, VERDICT, Output(as_json=True))
    assert capsys.readouterr().out == ""


def test_quietly_a_terminal_has_the_failed_lines_only(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = terminal_of(monkeypatch)
    print_findings(FINDINGS, VERDICT, Output(quiet=True))
    assert terminal.getvalue() == "FAIL  frf_error: 0.02 (limit 0.01) - at spin=0 [x]\n"


def test_what_is_in_a_file_is_a_table_on_a_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = terminal_of(monkeypatch)
    print_inspected(ROWS, Output())
    said = plain(terminal.getvalue())
    assert "study.yaml" in said and not re.search(r"study\.yaml:", said)
    assert re.search(r"^ +arm +30 dofs *$", said, re.M)
    assert re.search(r"^ *pass +rows: same mass +0 \(limit 1\) *$", said, re.M)
    heads, figures = (
        next(line.rstrip() for line in said.splitlines() if word in line) for word in ("per cent", "2.5 Hz")
    )
    assert len(heads) == len(figures) and figures.endswith("  0.0    2.0  100.0")


def test_rows_of_figures_stand_in_one_line_on_a_narrow_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    """The last of six columns was folded to a line of its own."""
    terminal = terminal_of(monkeypatch, 80)
    shares = "  ".join(["100.0"] * 6)
    long = InspectedLine("differs by 2.2e-07, relative; " * 3, "mass by the rigid motions of the stiffness", depth=2)
    print_inspected([*ROWS, long, InspectedLine(shares, "mode 1, 0.564214 Hz", depth=3, in_columns=True)], Output())
    assert re.search(rf"mode 1, 0\.564214 Hz +{shares} *$", plain(terminal.getvalue()), re.M)


def test_what_is_in_a_file_is_lines_in_a_log(capsys: pytest.CaptureFixture[str]) -> None:
    print_inspected(ROWS, Output())
    assert capsys.readouterr().out.splitlines() == LINES
