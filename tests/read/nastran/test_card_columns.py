"""Many cards at once: fields of every format, and numbers to the last bit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cmsreduce.errors import ReadError
from cmsreduce.read.nastran import read_bulk
from cmsreduce.read.nastran.cards import read_cards
from cmsreduce.read.numbers_at_once import integers_of, reals_of
from cmsreduce.read.printed_numbers import real_number

COUNT = 200


def columns(texts: list[str]) -> np.ndarray:
    return np.array([list(text.ljust(16).encode()) for text in texts], dtype=np.uint8)


def printed(value: float, width: int) -> str:
    """A number in one of the forms that NASTRAN takes, at most so wide; the digits choose the form."""
    texts = [f"{value:.{d}E}" for d in range(width, 0, -1)] + [f"{value:.{d}f}" for d in range(width, 0, -1)]
    short = [text.replace("E+0", "+").replace("E-0", "-").replace("E+", "+").replace("E-", "-") for text in texts]
    fitting = [text for text in [*texts, *short, *(text.replace("E", "D") for text in texts)] if len(text) <= width]
    return fitting[int(abs(value) * 1e6) % len(fitting)]


def test_reals_are_those_of_python() -> None:
    rng = np.random.default_rng(4)
    values = rng.uniform(-10, 10, 1500) * 10.0 ** rng.integers(-30, 30, 1500)
    texts = [printed(value, 16) for value in values]
    found, sure = reals_of(columns(texts))
    expected = np.array([real_number(text) for text in texts])
    assert sure.mean() > 0.6 and (found[sure] == expected[sure]).all()
    small = (abs(values) < 1e12) & (abs(values) > 1e-8)
    assert sure[small].all()


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("-0.0", -0.0), ("+.5", 0.5), ("1.", 1.0), ("  12  ", 12.0), ("1.5-3", 1.5e-3), ("-1.+2", -100.0),
        ("9007199254740991", 9007199254740991.0), ("9.99999999D-7", 9.99999999e-7), ("7", 7.0),
    ],
)  # fmt: skip
def test_forms_of_a_real(text: str, value: float) -> None:
    (found,), (sure,) = reals_of(columns([text]))
    assert sure and np.float64(found).tobytes() == np.float64(value).tobytes()


@pytest.mark.parametrize("text", ["", ".", "-", "1.5.", "1 2", "E5", "1E", "1E+", "1_0", "--1", "1.5-3-", "1+", "THRU"])
def test_what_is_no_number_is_not_sure(text: str) -> None:
    assert real_number(text) is None
    assert not reals_of(columns([text]))[1][0] and not integers_of(columns([text]))[1][0]


def test_integers_have_no_point() -> None:
    texts = ["12", "-7", "+3", "007", "1.", "1E2", "123456789012345", "1234567890123456", ""]
    values, sure = integers_of(columns(texts))
    assert sure.tolist() == [True, True, True, True, False, False, True, False, False]
    assert values[sure].tolist() == [12, -7, 3, 7, 123456789012345]


def small(name: str, fields: list[str]) -> list[str]:
    rows = [fields[k : k + 8] for k in range(0, len(fields), 8)]
    return [f"{name if not k else '+':<8}" + "".join(f"{text:>8}" for text in row) for k, row in enumerate(rows)]


def wide(name: str, fields: list[str]) -> list[str]:
    rows = [fields[k : k + 4] for k in range(0, len(fields), 4)]
    return [f"{f'{name}*' if not k else '*':<8}" + "".join(f"{text:<16}" for text in row) for k, row in enumerate(rows)]


def free(name: str, fields: list[str]) -> list[str]:
    rows = [fields[k : k + 8] for k in range(0, len(fields), 8)]
    return [",".join([name if not k else "", *row]) for k, row in enumerate(rows)]


def tabbed(name: str, fields: list[str]) -> list[str]:
    return [line.replace(",", "\t") for line in free(name, fields)]


@pytest.mark.parametrize("control", ["", "SOL 103\nCEND\nSPC = 1\nBEGIN BULK\n"])
def test_every_format_in_one_deck(tmp_path: Path, control: str) -> None:
    """Cards in random formats among comments, blank lines and other cards, half of them in an included file."""
    rng = np.random.default_rng(7)
    between = ["$ GRID, a comment, with commas", "", "  ", "PARAM,POST,-1", "CBUSH   1       2\n+       3", "$ END?"]
    expected, lines = [], []
    for k in range(COUNT):
        name, count = [("GRID", 7), ("CHEXA", 10), ("CORD2R", 11), ("SPC1", 30)][rng.integers(4)]
        form = [small, wide, free, tabbed][rng.integers(4)]
        fields = [str(k + 1), *(printed(rng.normal(), 7) if rng.random() < 0.8 else "" for _ in range(count - 2)), "9"]
        begin = len(lines) + 1
        card = form(name if rng.random() < 0.7 else name.lower(), fields)
        if len(card) > 1 and rng.random() < 0.3:
            card.insert(1, "$ between the lines of a card")
        lines += card
        expected.append((name, tuple(fields), begin))
        lines += "\n".join(between[i] for i in rng.integers(len(between), size=rng.integers(3))).splitlines()
    half = expected[COUNT // 2][2] - 1
    path = tmp_path / "deck.bdf"
    path.write_text(control + "\n".join([*lines[:half], "INCLUDE 'more.bdf'"]) + "\nENDDATA\nGRID,1\n", newline="\r\n")
    (tmp_path / "more.bdf").write_text("\n".join(lines[half:]))
    sections = read_cards(path, {"GRID", "CHEXA", "CORD2R", "SPC1"}).sections
    found = [(card.name, card.fields, card.line) for cards in sections[0].values() for card in cards]
    ahead = control.count("\n")
    placed = [(name, fields, line - half if line > half else line + ahead) for name, fields, line in expected]
    assert sorted(found, key=lambda card: int(card[1][0])) == placed
    for cards in sections[0].values():
        for index in range(cards.width + 1):
            assert cards.reals(index).tolist() == [card.real(index) for card in cards]
            texts, which = cards.texts(index)
            assert [texts[k] for k in which] == [card.text(index) for card in cards]
            assert cards.blank(index).tolist() == [not card.text(index) for card in cards]
        assert cards.integers(0).tolist() == [card.integer(0) for card in cards]


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("GRID    x               1.0", "line 301: GRID: field 2 should be an integer, it is 'X'"),
        ("GRID    -4              1.0", "line 301: GRID: -4 is no grid id"),
        ("GRID    901             1.0.", "line 301: GRID: field 4 should be a number, it is '1.0.'"),
        ("GRID    901             1.0+70", "line 301: GRID: field 4 is '1.0+70', more than any length"),
        ("GRID    901             1.0     0.      0.      -1", "line 301: GRID: grid 901 is a fluid point"),
        ("GRID    901             1.0     0.      0.              17", "line 301: GRID: '17' in field 8 of grid 901"),
        ("GRID    12              7.0", "line 301: GRID: grid 12 differs from"),
        ("GRID    901     44      7.0", "line 301: GRID 901 refers to coordinate system 44"),
        ("GRID,901,0,1.,2.,3.,0,12,,7.", "line 301: more than 8 data fields on one line of GRID"),
    ],
)
def test_one_bad_card_among_many_is_named(tmp_path: Path, line: str, said: str) -> None:
    """It is the first in the deck, whatever is wrong further down."""
    cards = [f"GRID    {k + 1:8d}        {k * 0.25:8.3f}" for k in range(600)]
    path = tmp_path / "deck.bdf"
    path.write_text("\n".join([*cards[:300], line, *cards[300:], "GRID    bad" if "refers" not in said else ""]))
    with pytest.raises(ReadError) as refused:
        read_bulk(path)
    assert f"{path}, {said}" in str(refused.value)


def test_a_grid_that_is_repeated_alike_counts_once(tmp_path: Path) -> None:
    path = tmp_path / "deck.bdf"
    path.write_text("GRID    3               1.0\nGRID    1               2.0\nGRID    3               1.0\n")
    nodes = read_bulk(path).nodes
    assert nodes.id.tolist() == [3, 1] and nodes.xyz[:, 0].tolist() == [1.0, 2.0]


@pytest.mark.parametrize(
    ("lines", "found"),
    [
        (["GRID,9001,,9.", "=,*1,=,*0.5,=="], {9001: 9.0, 9002: 9.5}),
        (["GRID    9001            9.", "=       *1      =       *0.5", "=2"], {9001: 9.0, 9004: 10.5}),
        (["GRID\t9001\t\t9.", "GRID\t*1\t=\t="], {9001: 9.0, 9002: 9.0}),
    ],
)
def test_cards_that_repeat_others_among_many(tmp_path: Path, lines: list[str], found: dict[int, float]) -> None:
    cards = [f"GRID    {k + 1:8d}        {k * 0.25:8.3f}" for k in range(300)]
    path = tmp_path / "deck.bdf"
    path.write_text("\n".join([*cards[:150], *lines, *cards[150:]]))
    nodes = read_bulk(path).nodes
    at = nodes.index(list(found))
    assert len(nodes) == 301 + max(found) - 9001 and nodes.xyz[at, 0].tolist() == list(found.values())


HEXAHEDRON = "CHEXA   9       1       1       2       3       4       5       6       +A1"


@pytest.mark.parametrize(
    "lines",
    [
        [HEXAHEDRON, "GRID,9001,,9.", "+A1     7       8"],
        ["CHEXA,9,1,1,2,3,4,5,6,+A1", "GRID,9001,,9.", "+A1,7,8"],
        [HEXAHEDRON, "$", "", "+A1     7       8"],
    ],
)
def test_a_card_that_goes_on_elsewhere_among_many(tmp_path: Path, lines: list[str]) -> None:
    cards = [f"GRID    {k + 1:8d}        {k * 0.25:8.3f}" for k in range(300)]
    path = tmp_path / "deck.bdf"
    path.write_text("\n".join([*cards[:150], *lines[:1], *cards[150:], *lines[1:]]))
    ((hexahedron,), grids) = (read_cards(path, {"GRID", "CHEXA"}).sections[0][name] for name in ("CHEXA", "GRID"))
    assert hexahedron.fields == ("9", "1", "1", "2", "3", "4", "5", "6", "7", "8")
    assert len(grids) == 300 + any("9001" in line for line in lines)
