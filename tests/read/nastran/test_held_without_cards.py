"""Rotations that nothing resists have no rows: NASTRAN and MYSTRAN hold them without a card."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.read import MatrixSource, prove_row_order, read_body, read_geometry
from tests.plates import isotropic_laminate, plate_body
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


def plates(
    *, triangles: bool = False, wave: float = 0.0, turn: bool = False, held: bool = False, tied: bool = True
) -> str:
    """Eight by four plates of 0.1 m, flat or with a wave along x, about the axes or not."""
    a, b = np.radians(30), np.radians(20)
    R = np.array([[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]])
    R = R @ [[1, 0, 0], [0, np.cos(b), -np.sin(b)], [0, np.sin(b), np.cos(b)]] if turn else np.eye(3)
    number = {place: k for k, place in enumerate(product(range(9), range(5)), start=1)}
    x = np.array([[0.1 * i, 0.1 * j, wave * np.sin(0.5 * i)] for i, j in number] + [[0.9, 0.2, 0]]) @ R.T
    lines = ["SOL 103", "CEND", *(["SPC = 1"] if held else []), "BEGIN BULK"]
    lines += [card("GRID", k, "", *map(float, at)) for k, at in enumerate(x.round(7)[: 45 + tied], start=1)]
    for k, (i, j) in enumerate(product(range(8), range(4)), start=1):
        q = [number[i, j], number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]]
        if triangles:
            lines += [card("CTRIA3", 2 * k, 1, *q[:3]), card("CTRIA3", 2 * k + 1, 1, q[0], *q[2:])]
        else:
            lines.append(card("CQUAD4", k, 1, *q))
    if tied:
        lines.append(card("RBE2", 900, 46, 123456, *range(41, 46)))
    if held:
        lines.append(card("SPC1", 1, 123456, *range(1, 6)))
    return "\n".join([*lines, "ENDDATA", ""])


@pytest.mark.parametrize(
    ("options", "rows"),
    [
        ({"tied": False}, 225),
        ({"tied": False, "held": True}, 200),
        ({"tied": False, "turn": True}, 225),
        ({}, 206),
        ({"held": True}, 181),
        ({"triangles": True}, 206),
        ({"turn": True}, 206),
        # At the free end the plates of a grid lie in one plane.
        ({"wave": 0.02}, 241),
        ({"wave": 0.02, "held": True}, 216),
    ],
)
def test_rotations_about_normals_of_flat_plates_have_no_rows(
    tmp_path: Path, options: dict[str, bool], rows: int
) -> None:
    """MYSTRAN 17.0 writes KAA with so many rows for these decks, with PARAM,AUTOSPC,Y and K6ROT of zero."""
    deck = tmp_path / "plate.bdf"
    deck.write_text(plates(**options))
    assert len(read_geometry(deck).rows["autospc-flat"]) == rows


def test_plates_of_eight_nodes_are_flat_with_their_middles(tmp_path: Path) -> None:
    """Grid 6 is a middle; raised, it makes the plate a curved one, which resists every rotation."""
    at = [(0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1)]
    for height, lost in ((0.0, 8), (0.1, 0)):
        lines = ["CEND", "BEGIN BULK", card("CQUAD8", 1, 1, *range(1, 9))]
        lines += [card("GRID", k, "", *p, height * (k == 6)) for k, p in enumerate(at, start=1)]
        deck = tmp_path / "plate.bdf"
        deck.write_text("\n".join([*lines, "ENDDATA", ""]))
        assert len(read_geometry(deck).rows["autospc-flat"]) == 48 - lost


@pytest.mark.parametrize("turn", [False, True], ids=["along an axis", "skew"])
def test_a_flat_plate_without_its_drilling_rotations_is_read(tmp_path: Path, turn: bool) -> None:
    """Where the normal is none of the axes of a grid, the whole matrix comes back, in which it turns freely."""
    deck = tmp_path / "plate.bdf"
    deck.write_text(plates(tied=False, turn=turn))
    shape = read_geometry(deck)
    cells = [[5 * i + j + 1, 5 * i + j + 6, 5 * i + j + 7, 5 * i + j + 2] for i in range(8) for j in range(4)]
    made = plate_body("plate", shape.nodes.xyz, cells, lambda _: isotropic_laminate(7e10, 0.3, 0.003), drilling=0.0)
    table = shape.rows["autospc-flat"]
    kept = made.dofs.rows(table.node, table.component)
    M = sp.diags_array(np.where(made.dofs.component > 3, 0.0, made.M.diagonal())).tocsr()
    for name, A in (("K", sp.csr_array(made.K)), ("M", M)):
        sp.save_npz(tmp_path / name, A[kept][:, kept])
    files = {kind: MatrixSource(tmp_path / f"{name}.npz") for kind, name in (("stiffness", "K"), ("mass", "M"))}
    found = read_body("plate", geometry=deck, **files)
    proof = prove_row_order(found)
    assert (proof.status, proof.motions) == ("proven", 6)
    rows = made.dofs.rows(found.dofs.node, found.dofs.component)
    assert rows.size == (made.n if turn else kept.size)
    # Coordinates of seven decimals turn the normals of the plates of a grid by a millionth.
    assert abs(found.K - made.K[rows][:, rows]).max() <= 1e-5 * abs(made.K).max()
    assert abs(found.M - M[rows][:, rows]).max() == 0
