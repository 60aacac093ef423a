"""Rotations that nothing resists have no rows: NASTRAN and MYSTRAN hold them without a card."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.read import MatrixSource, prove_row_order, read_body, read_geometry
from tests.solids import block

CELLS, SIDES, REFERENCE = (6, 2, 2), (0.6, 0.1, 0.08), 64
PLACES = list(product(*(range(n + 1) for n in CELLS)))
GRID = {place: k for k, place in enumerate(PLACES, start=1)}
CORNERS = ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1))


def card(*fields: object) -> str:
    """A card in free fields, eight on each line after its name."""
    name, *rest = map(str, fields)
    return "\n".join(",".join([name if not k else "", *rest[k : k + 8]]) for k in range(0, len(rest), 8))


def bricks(*more: str, held: bool = False) -> str:
    x = np.array(PLACES) / CELLS * SIDES
    lines = ["SOL 103", "CEND", *(["SPC = 1"] if held else []), "BEGIN BULK"]
    lines += [card("GRID", k, "", *map(float, at)) for k, at in enumerate(x.round(6), start=1)]
    for k, cell in enumerate(product(*map(range, CELLS)), start=1):
        lines.append(card("CHEXA", k, 3, *(GRID[tuple(np.add(cell, corner))] for corner in CORNERS)))
    lines += [f"GRID,{REFERENCE},,0.7,0.05,0.04", *more]
    if held:
        lines.append(card("SPC1", 1, 123, *(GRID[place] for place in PLACES if not place[0])))
    return "\n".join([*lines, "ENDDATA", ""])


FACE = [GRID[place] for place in PLACES if place[0] == CELLS[0]]
TIES = {
    "RBE2": card("RBE2", 900, REFERENCE, 123456, *FACE),
    "RBE3": card("RBE3", 900, "", REFERENCE, 123456, 1.0, 123, *FACE),
}
BARS = [f"GRID,{65 + k},,{0.8 + 0.1 * k:.1f},0.05,0.04\nCBAR,{910 + k},2,{64 + k},{65 + k},0.,1.,0." for k in range(3)]


@pytest.mark.parametrize(
    ("tie", "bars", "held", "rows"),
    [
        ("RBE2", False, False, 168),
        ("RBE2", False, True, 141),
        ("RBE2", True, False, 186),
        ("RBE3", False, False, 189),
        ("RBE3", True, False, 207),
        ("RBE3", True, True, 180),
    ],
)
def test_the_set_has_the_rows_that_mystran_writes(tmp_path: Path, tie: str, bars: bool, held: bool, rows: int) -> None:
    """MYSTRAN 17.0 writes KAA with so many rows for these decks, with PARAM,AUTOSPC,Y."""
    deck = tmp_path / "bar.bdf"
    deck.write_text(bricks(TIES[tie], *(BARS if bars else ()), held=held))
    assert len(read_geometry(deck).rows["autospc"]) == rows


def test_elements_and_constraints_that_resist_rotations(tmp_path: Path) -> None:
    deck = tmp_path / "bar.bdf"
    deck.write_text(
        bricks(
            "GRID,70,,2.,0.,0.\nGRID,71,,3.,0.,0.\nGRID,72,,9.,9.,9.\nGRID,73,,9.,8.,9.\nGRID,74,,9.,8.,7.\nSPOINT,80",
            "CELAS2,1000,1.+6,1,5,2,4",
            f"RBE3,1001,,{REFERENCE},123456,1.0,123,3,4\n,1.0,1234,5,6",
            "CROD,1002,1,70,71\nCQUAD4,1003,1,7,8,9,10",
            "MPC,1,11,1,1.,12,6,-1.\nRROD,1004,72,73,1",
        )
    )
    found = read_geometry(deck).rows["autospc"]
    turning = [label for label in found.labels if int(label[-1]) > 3]
    six = [f"{node}.{c}" for node in (7, 8, 9, 10) for c in (4, 5, 6)]
    # Without case control the MPC would act; the deck selects none.
    assert turning == ["1.5", "2.4", "5.4", "6.4", *six]
    assert [label for label in found.labels if 70 <= int(label.partition(".")[0]) <= 80] == [
        *("70.1", "70.2", "70.3", "71.1", "71.2", "71.3", "72.2", "72.3", "73.1", "73.2", "73.3", "80.0")
    ]


def test_a_body_of_solids_with_a_mean_point_is_read(tmp_path: Path) -> None:
    """The point of an RBE3 has no rows, and the solids have three at each grid: no set by cards has this size."""
    deck = tmp_path / "bar.bdf"
    deck.write_text(bricks(TIES["RBE3"]))
    made = block("bar", SIDES, CELLS)
    for name, A in (("K", made.K), ("M", made.M)):
        sp.save_npz(tmp_path / name, sp.csr_array(A))
    found = read_body(
        "bar",
        stiffness=MatrixSource(tmp_path / "K.npz"),
        mass=MatrixSource(tmp_path / "M.npz"),
        geometry=deck,
    )
    assert prove_row_order(found).status == "proven"
    assert found.n == 3 * len(PLACES)


@pytest.mark.parametrize(
    "line", ["CHEXA", "CHEXA,7,3,A", "CBAR,7,2,1.5,2", "CELAS2,7,1.,1,A", "RBE3,7,,64,123,1.,-1,2,3"]
)
def test_elements_that_cannot_be_read_leave_the_sets_of_cards(tmp_path: Path, line: str) -> None:
    deck = tmp_path / "bar.bdf"
    deck.write_text(bricks(line))
    assert len(read_geometry(deck).rows["a"]) == 6 * REFERENCE - 3 * line.startswith("RBE3")
