"""Cards in every field format, continuations, comments, sections, INCLUDE."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cmsreduce.errors import ReadError
from cmsreduce.read import read_geometry
from cmsreduce.read.nastran.cards import read_cards, texts_kept
from cmsreduce.read.printed_numbers import real_number

GRID = {
    "small": "GRID    7       2       1.5     -2.5-1  3.+1    4       126",
    "wide": "GRID*                  7               2             1.5          -2.5-1*\n"
    "*                   3.+1               4             126",
    "wide, named": "GRID*   7               2               1.5             -.25            *G7\n"
    "*G7     30.             4               126",
    "free": "GRID,7,2,1.5,-.25,30.,4,126",
    "free, spaced, lower": "grid , 7, 2 ,1.5,-2.5e-1, 3.d1,4,126",
    "free, broken": "GRID,7,2,1.5,-.25,30.,4,126,,+\n+,",
    "free, wide": "GRID*,7,2,1.5,-.25,*\n*,30.,4,126",
    "tabs": "GRID\t7\t2\t1.5\t-.25\t30.\t4\t126",
    "comment behind": "GRID    7       2       1.5     -.25    30.     4       126     $ the hub",
    "comment between": "GRID*   7               2               1.5             -.25\n"
    "$ a comment\n\n*       30.             4               126",
    "mixed case": "Grid    7       2       1.5     -.25    30.     4       126",
}


def cards_of(tmp_path: Path, text: str, names: set[str], file: str = "deck.bdf") -> list[tuple[str, ...]]:
    path = tmp_path / file
    path.write_text(text + "\n")
    found = read_cards(path, names)
    return [card.fields for section in found.sections.values() for cards in section.values() for card in cards]


@pytest.mark.parametrize("text", GRID.values(), ids=list(GRID))
def test_one_grid_in_every_format(tmp_path: Path, text: str) -> None:
    (fields,) = cards_of(tmp_path, text, {"GRID"})
    assert [real_number(f) for f in fields] == [7, 2, 1.5, -0.25, 30, 4, 126]


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1.5-3", 1.5e-3),
        ("1.+7", 1e7),
        ("-1.-2", -0.01),
        ("+.5", 0.5),
        ("7", 7.0),
        ("1.0D+02", 100.0),
        ("2.e3", 2000.0),
        (" 3.25 ", 3.25),
        ("", None),
        ("THRU", None),
        ("1.5 3", None),
        ("nan", None),
        ("1_0", None),
        ("-", None),
        ("1.5e", None),
        ("15-3", 0.015),
        # As long as one would try for hours to divide it.
        ("9" * 50_000 + "X", None),
        ("1." + "9" * 50_000 + "E+", None),
    ],
)
def test_real_numbers(text: str, value: float | None) -> None:
    assert real_number(text) == value


def test_short_continuation_of_a_wide_card_starts_at_the_next_line_of_eight(tmp_path: Path) -> None:
    text = (
        "PBAR*    1               1              .002            1.66667-6\n"
        "*       6.66667-8       2.33071-7\n"
        "        .05     .01     -.05    .01"
    )
    (fields,) = cards_of(tmp_path, text, {"PBAR"})
    assert fields == ("1", "1", ".002", "1.66667-6", "6.66667-8", "2.33071-7", "", "", ".05", ".01", "-.05", ".01")


def test_bulk_data_ends_and_case_control_is_kept_apart(tmp_path: Path) -> None:
    path = tmp_path / "run.dat"
    path.write_text(
        "SOL 103\nCEND\nSPC = 1\nTITLE = GRID,9\nBEGIN BULK\nSPC,1,5,3\n"
        "BEGIN SUPER = 4\nSPC,1,6,3\nENDDATA\nSPC,1,8,3\n"
    )
    found = read_cards(path, {"SPC", "GRID"})
    assert found.case_control == ("SPC = 1", "TITLE = GRID,9")
    assert {k: [c.fields for c in v["SPC"]] for k, v in found.sections.items()} == {
        0: [("1", "5", "3")],
        4: [("1", "6", "3")],
    }
    assert found.sections[0]["SPC"][0].line == 6


@pytest.mark.parametrize(
    "include",
    [
        "INCLUDE 'sub/a.bdf'",
        'include "sub/a.bdf" $ quoted twice',
        "INCLUDE sub/a.bdf",
        "INCLUDE 'sub/\n        a.bdf'",
        r"INCLUDE 'sub\a.bdf'",
        "INCLUDE='sub/a.bdf'",
    ],
)
def test_include_is_relative_to_the_including_file_then_to_the_deck(tmp_path: Path, include: str) -> None:
    (tmp_path / "sub" / "deep").mkdir(parents=True)
    (tmp_path / "sub" / "a.bdf").write_text("GRID,1\nINCLUDE 'deep/b.bdf'\nGRID,2\n")
    (tmp_path / "sub" / "deep" / "b.bdf").write_text("GRID,3\nINCLUDE 'top.bdf'\n")
    (tmp_path / "top.bdf").write_text("GRID,4\n")
    assert cards_of(tmp_path, f"GRID,0\n{include}\nGRID,5", {"GRID"}) == [(k,) for k in "013425"]


def test_missing_include_is_refused_in_bulk_data_only(tmp_path: Path) -> None:
    head = "INCLUDE '/dmap/alter.v9'\nSOL 103\nCEND\nBEGIN BULK\nGRID,1\n"
    assert cards_of(tmp_path, head, {"GRID"}) == [("1",)]
    with pytest.raises(ReadError, match=r"deck.bdf, line 6: INCLUDE file 'gone.bdf' is missing"):
        cards_of(tmp_path, head + "INCLUDE 'gone.bdf'", {"GRID"})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("INCLUDE 'deck.bdf'", r"includes itself: .*deck.bdf -> .*deck.bdf"),
        ("INCLUDE 'a", "line 1: INCLUDE has no closing quote"),
        ("+,1,2", "line 1: a continuation line with no card before it"),
        (f"{'GRID    1':72}+A1\n+B2     0.", r"names '\+A1'"),
        ("GRID,1,,x\n=,*1,=,*0.5", r"'\*0.5' steps from the field above it, which is 'X'"),
        ("GRID,1\n=9999999", "=9999999 makes more than 1000000 cards"),
        ("GRID,1,2,3.,4.,5.,6,,,+\n+,7\n=,*1,==", "GRID above it has several lines"),
        ("GRID,=,2", "no card stands above it"),
        ("GRID,1,2,3,4,5,6,7,8,9,10", "more than 8 data fields"),
        ("GRID*,1,2,3.,4.,5.", "more than 4 data fields"),
    ],
)
def test_what_cannot_be_read_is_refused_with_its_line(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ReadError, match=message):
        cards_of(tmp_path, text, {"GRID"})


def test_cards_not_asked_for_cannot_stop_the_reader(tmp_path: Path) -> None:
    text = f"CQUAD4,1,2,3,4,5,6,7,8,9,10\n{'PLOAD   1':72}+A1\n+B2\nGRID,1"
    assert cards_of(tmp_path, text, {"GRID"}) == [("1",)]


def test_whole_numbers_of_a_card(tmp_path: Path) -> None:
    path = tmp_path / "deck.bdf"
    path.write_text(f"$\nGRID,1,x,1.0,7,{'7' * 5000},\u00b2,0008\n")
    (card,) = read_cards(path, {"GRID"}).sections[0]["GRID"]
    assert (card.whole_numbers(), card.whole_numbers(4)) == ([1, 7, 8], [8])


def test_field_errors_name_file_line_and_field(tmp_path: Path) -> None:
    path = tmp_path / "deck.bdf"
    path.write_text("$\nGRID,1,x,1.0,abc,9+70\n")
    (card,) = read_cards(path, {"GRID"}).sections[0]["GRID"]
    with pytest.raises(ReadError, match=r"deck.bdf, line 2: GRID: field 3 should be an integer, it is 'X'"):
        card.integer(1)
    with pytest.raises(ReadError, match=r"field 5 should be a number, it is 'ABC'"):
        card.real(3)
    with pytest.raises(ReadError, match=r"field 6 is '9\+70', more than any length"):
        card.real(4)


def test_cards_that_repeat_the_card_above_are_written_out(tmp_path: Path) -> None:
    """The same five grids as typed, in fields of both kinds; steps of blank fields start at zero."""
    grids = [("7", "2", f"{x}", "0.5", "", cd) for x, cd in ((0.0, "4"), (0.1, "4"), (0.2, "4"), (0.3, "4"), (0.4, ""))]
    typed = [("7", *grids[0][1:]), *((str(7 + k), *each[1:]) for k, each in enumerate(grids[1:], start=1))]
    text = "GRID,7,2,0.0,.5,,4\n=,*1,=,*.1,==\n=2\n$ a comment\n=,11,=,.4,=,=,"
    found = cards_of(tmp_path, text, {"GRID"})
    assert [[real_number(f) for f in each] for each in found] == [
        [real_number(f) for f in each if f or k < 4] for k, each in enumerate(typed)
    ]
    small = "SPOINT  1\nGRID    7       2       0.0     .5              4\n=       *(1)    =       *(.1)   ==\n=(2)"
    assert cards_of(tmp_path, small, {"GRID"}) == found[:4]
    assert cards_of(tmp_path, "GRID,7\n=,*1,,,,,*(3)\n=,*1,==", {"GRID"})[2] == ("9", "", "", "", "", "3")


def test_a_continuation_may_stand_away_from_its_card(tmp_path: Path) -> None:
    """Programs sort bulk data by name; a line with the name of a continuation belongs to the card that names it."""
    rows = [f"{'RBE1    5       1       123':72}+R5", "GRID    9               1.", "+R5     UM      2       456"]
    found = read_cards(write(tmp_path, "\n".join(rows)), {"RBE1", "GRID"}).sections[0]
    assert found["RBE1"][0].fields == ("5", "1", "123", *[""] * 5, "UM", "2", "456")
    assert found["GRID"][0].fields == ("9", "", "1.")
    # The first character of both names is a mark of any kind.
    rows = [f"{'CORD2C  3       0       0.':72}CORD1", "+ORD1   4."]
    assert read_cards(write(tmp_path, "\n".join(rows)), {"CORD2C"}).sections[0]["CORD2C"][0].fields[8] == "4."


def write(folder: Path, text: str) -> Path:
    path = folder / "deck.bdf"
    path.write_text(text + "\n")
    return path


def test_texts_that_are_kept_give_other_cards_of_the_same_deck(tmp_path: Path) -> None:
    deck = "CEND\nBEGIN BULK\nGRID,1\nINCLUDE 'more.bdf'\nCROD,7,1,1,2\nENDDATA"
    (tmp_path / "more.bdf").write_text("GRID,2\nCROD,8,1,2,1\n")
    with texts_kept():
        assert cards_of(tmp_path, deck, {"GRID"}) == [("1",), ("2",)]
        (tmp_path / "more.bdf").write_text("GRID,3\n")
        assert [fields[0] for fields in cards_of(tmp_path, "GRID,4", {"CROD"})] == ["8", "7"]
    assert cards_of(tmp_path, deck, {"GRID"}) == [("1",), ("3",)]


@pytest.mark.parametrize(
    ("name", "first", "line"),
    [("a.bdf", "BEGIN BULK\nGRID,1\n", "INCLUDE '{}'\n"), ("a.inp", "*NODE\n1, 0, 0, 0\n", "*INCLUDE, INPUT={}\n")],
)
def test_files_that_include_one_another_too_deep_are_refused(tmp_path: Path, name: str, first: str, line: str) -> None:
    path = tmp_path / name
    path.write_text(first + line.format("0"))
    for k in range(60):
        (tmp_path / str(k)).write_text(line.format(k + 1))
    (tmp_path / "60").write_text("")
    with pytest.raises(ReadError, match="51 files deep; at most 50 are read"):
        read_geometry(path)


def test_coordinate_systems_in_one_another_too_deep_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.bdf"
    systems = "".join(f"CORD2R,{k},{k - 1},0.,0.,0.,0.,0.,1.\n,1.,0.,0.\n" for k in range(1, 121))
    path.write_text(f"BEGIN BULK\n{systems}GRID,1,100,1.,0.,0.\n")
    np.testing.assert_allclose(read_geometry(path).nodes.xyz, [[1, 0, 0]])
    path.write_text(f"BEGIN BULK\n{systems}GRID,1,120,1.,0.,0.\n")
    with pytest.raises(ReadError, match="more than 100 coordinate systems"):
        read_geometry(path)
