import io
import re
from dataclasses import replace
from pathlib import Path

import pytest
from rich.console import Console

from cmsreduce.model import Failure, RunResult
from cmsreduce.report import print_summary


def printed(run: RunResult, folder: Path, width: int = 100, *, verbose: bool = True) -> str:
    stream = io.StringIO()
    print_summary(run, folder, Console(file=stream, width=width), verbose=verbose)
    return stream.getvalue()


def words(text: str) -> str:
    return re.sub(r"\s+", " ", text)


def test_figures_and_verdict(make_run, tmp_path: Path) -> None:
    text = words(printed(make_run(), tmp_path))
    assert text.startswith(
        "oscillators: PASS: all 3 limits, of errors and of checks, were measured and are met 2 elastic"
    )
    assert "2 elastic modes -> 1 kept; worst response error 2 % at spin=45 cone=30 " in text
    for figures in (
        "rotor craig-bampton 3 3 2 1 1 PASS 1.76",
        "reduced response error 2 % 5 % PASS spin=45 cone=30",
        "reduced decibel error 0.125 dB 1 dB PASS spin=0",
        "reduced frequency error 0.1 % spin=0",
        "first by frequency response error 75 % spin=0",
        "responses: full 2.000 s, reduced 0.100 s; reductions 1.750 s",
        "note: units were taken as SI",
    ):
        assert figures in text


def test_compared_models_are_not_judged(make_run, tmp_path: Path) -> None:
    lines = printed(make_run(), tmp_path).splitlines()
    assert not [line for line in lines if "first by frequency" in line and re.search("PASS|FAIL", line)]


def test_broken_limits_are_named(make_run, tmp_path: Path) -> None:
    text = words(printed(make_run(limits={"db_error": 0.1}), tmp_path))
    assert "oscillators: FAIL" in text
    assert "reduced decibel error 0.125 dB 0.1 dB FAIL spin=0" in text
    assert "FAIL decibel error 0.125 dB at spin=0 is above its limit 0.1 dB" in text


def test_nothing_verified(make_run, tmp_path: Path) -> None:
    text = printed(make_run(configurations=(), speed=None, limits={}), tmp_path)
    assert "no response was verified" in text
    assert "responses:" not in text
    assert text.startswith("oscillators: not checked: no limit is set")
    assert "PASS:" not in text


def test_files_are_named_in_one_piece(make_run, tmp_path: Path) -> None:
    folder = tmp_path / ("a long [bold]folder name " * 5).strip()
    folder.mkdir()
    for name in ("summary.json", "report.html", "system.h5", "rotor.h5", "else.txt"):
        (folder / name).touch()
    lines = printed(make_run(), folder).splitlines()
    named = [line for line in lines if line.startswith(str(folder))]
    assert named == [
        str(folder / name) for name in ("summary.json", "report.html", "rotor.h5", "system.h5", "report.html")
    ]


def test_names_in_brackets_are_no_markup(make_run, tmp_path: Path) -> None:
    text = printed(make_run(name="[red]x", bodies=("[b]",), configurations=("[/]",)), tmp_path)
    assert "[red]x: PASS" in text
    assert "[b]" in text
    assert "at [/]" in text


def test_plain_where_there_is_no_terminal(make_run, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    print_summary(make_run(), tmp_path)
    text = capsys.readouterr().out
    assert "\x1b" not in text
    assert max(map(len, text.splitlines())) <= 100


def test_the_screen_has_verdict_bodies_errors_and_three_notes(make_run, tmp_path: Path) -> None:
    (tmp_path / "report.html").touch()
    notes = ("units were taken as SI", "'first by frequency' is short", *(f"set `key.{k}`" for k in range(4)))
    lines = printed(make_run(notes=notes), tmp_path, verbose=False).splitlines()
    assert len(lines) <= 25 and lines[-1] == str(tmp_path / "report.html")
    # Notes that name a key come first; those on compared models are in the report.
    assert [line for line in lines if line.startswith("note: ")] == [f"note: set `key.{k}`" for k in range(3)]
    assert "3 more notes in the report, and with --verbose" in lines
    text = words("\n".join(lines))
    assert "rotor craig-bampton 3 1 of 2" in text
    assert "response error 2 % 5 % PASS spin=45 cone=30" in text
    assert "first by frequency" not in text and "responses:" not in text


def test_a_failure_beside_no_note_leaves_no_further_notes(make_run, tmp_path: Path) -> None:
    run = replace(make_run(), failures=(Failure("the picture 'bode'", "no space left"),))
    text = printed(run, tmp_path, verbose=False)
    assert "the picture 'bode'" in text and "more note" not in text


def test_everything_comes_before_the_screen(make_run, tmp_path: Path) -> None:
    whole, screen = (printed(make_run(), tmp_path, verbose=verbose) for verbose in (True, False))
    assert whole.endswith(screen) and len(whole) > 2 * len(screen)


def test_a_broken_limit_ends_with_what_to_try(make_run, tmp_path: Path) -> None:
    text = printed(make_run(limits={"db_error": 0.1}), tmp_path, verbose=False)
    assert "next: 1 mode of the mode sets was left out: `balance: {keep: limits}`" in text
    assert "next:" not in printed(make_run(), tmp_path, verbose=False)


@pytest.mark.parametrize(("width", "heads"), [(75, 6), (95, 7), (120, 8)])
def test_names_and_figures_of_bodies_are_whole_on_narrow_screens(
    make_run, tmp_path: Path, width: int, heads: int
) -> None:
    text = printed(make_run(bodies=("boom_of_the_antenna",)), tmp_path, width=width, verbose=False)
    head, _, row = text[text.index("\nbody ") + 1 :].splitlines()[:3]
    assert len(re.split(r"  +", head.strip())) == heads
    assert row.startswith("boom_of_the_antenna ") and row.endswith("PASS") and len(row) <= width
    assert "…" not in head + row
