"""The picture of a sweep, still and to point at, and its table on the terminal."""

from __future__ import annotations

import io
import json
import re
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import pytest
from rich.console import Console

from cmsreduce.errors import WriteError
from cmsreduce.report import print_sweep, sweep_page, sweep_picture
from tests.report.sweeps import HOSTILE, made_sweep

SVG = "{http://www.w3.org/2000/svg}"


def test_the_svg_has_a_mark_for_every_point_in_every_panel(tmp_path: Path) -> None:
    path = tmp_path / "sweep.svg"
    sweep_picture(made_sweep(), path)
    root = ElementTree.parse(path).getroot()
    collections = [group for group in root.iter(f"{SVG}g") if group.get("id", "").startswith("PathCollection")]
    # A lone mark is drawn where it stands, others are copies of one.
    marks = sum(len(list(group.iter(f"{SVG}use"))) or len(group.findall(f"{SVG}path")) for group in collections)
    # Four points with figures in four panels, and a mark for each of two methods in the legend.
    assert marks == 4 * 4 + 2
    # Equal input gives an equal file, which a repository can hold.
    again = tmp_path / "again.svg"
    sweep_picture(made_sweep(), again)
    assert again.read_bytes() == path.read_bytes()


def test_the_page_is_self_contained_and_names_its_points() -> None:
    page = sweep_page(made_sweep())
    assert not re.findall(r"<(?:script|link|img)[^>]+(?:src|href)=[\"']?(?:https?:)?//", page)
    data = re.search(r'id="report-data">(.*?)</script>', page, re.S)
    assert data is not None
    facts = json.loads(data[1])
    # The library of 4.7 MB is packed as in the report.
    assert len(page) < 2.2e6
    planes = {(plane["error"], plane["cost"]): plane for plane in facts["planes"]}
    assert len(planes) == 4 * 6
    by_size = planes["frf_error", "n_reduced"]
    assert by_size["points"] == [1, 2, 3, 4]
    assert [by_size["x"][k] for k in by_size["steps"]] == [10, 20]
    # In per cent, as the axis says.
    assert by_size["y"] == pytest.approx([10, 10, 0.1, 20])
    by_time = planes["frf_error", "reduce_s"]
    assert [by_time["x"][k] for k in by_time["steps"]] == [0.5, 1.0, 3.0]
    assert set(re.findall(r'<option value="(\w+)"', page)) == {name for pair in planes for name in pair}
    said = facts["said"]
    assert "reduce.cutoff = 1.5" in said["1"] and "point 1:" in said["1"]
    assert HOSTILE not in page


def test_no_errors_no_picture(tmp_path: Path) -> None:
    sweep = made_sweep()
    failed = replace(sweep, rows=sweep.rows[-1:])
    with pytest.raises(WriteError, match="verify"):
        sweep_picture(failed, tmp_path / "sweep.svg")
    with pytest.raises(WriteError, match="verify"):
        sweep_page(failed)


def test_figures_of_the_table_are_whole_on_a_narrow_screen() -> None:
    said = io.StringIO()
    print_sweep(made_sweep(), [], Console(file=said, width=100))
    rows = [line for line in said.getvalue().splitlines() if re.match(r"\s*\*? *\d ", line)]
    assert rows[2].split()[1:] == ["3", "craig-bampton", "4", "14", "20", "0.1", "%", "0.01", "dB", "4000000", "PASS"]
    assert "…" not in said.getvalue() and max(map(len, rows)) <= 100


def test_the_table_says_what_came_of_every_point(tmp_path: Path) -> None:
    said = io.StringIO()
    print_sweep(made_sweep(), [tmp_path / "sweep.csv"], Console(file=said, width=160))
    lines = said.getvalue().splitlines()
    rows = [line.split() for line in lines if re.match(r"\s*\*? *\d ", line)]
    assert [row[0] == "*" for row in rows] == [True, False, True, True, False]
    assert [row[-1] for row in rows] == ["FAIL", "FAIL", "PASS", "FAIL", "failed"]
    assert rows[2][1:5] == ["3", "craig-bampton", "4", "14"] and "0.1" in rows[2]
    text = said.getvalue()
    assert "failed  5: no such method, says, 1" in text
    assert "study: 5 points in 12.5 s: 1 passed, 3 broke a limit, 1 failed" in text
    assert str(tmp_path / "sweep.csv") in text
