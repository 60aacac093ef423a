"""Dof sets of the superelements of a main deck, against the tables that NX wrote in the runs of these decks."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import pyyeti

from cmsreduce.pipeline.drafts import draft_body
from cmsreduce.read import MatrixSource, prove_row_order, read_body, read_geometry

THEIRS = Path(pyyeti.__file__).parent / "tests"
theirs = pytest.mark.skipif(not THEIRS.is_dir(), reason="pyYeti is installed without its test data")

# Four bars in a line: two superelements and the residual structure.
DECK = """SOL 103
CEND
SET 7 = 1, 2 THRU 4 EXCEPT 3,
 5
SET 8 = 1,2
SET 9 = 0.5, 1.
SET 10 = 2,9
DISP = 7
FORCE(PLOT) = 8
BEGIN BULK
GRID,1
=,*1,,*1.,==
=3
CBAR,101,1,1,2,0.,1.,0.
=,*1,=,*1,*1,==
=2
SPOINT,91,THRU,94
SET1,3,1,THRU,99
SET1,4,ALL
SET3,5,GRID,4,5
SET3,6,ELEM,1,2
"""


def rows_of(folder: Path, cards: str) -> dict[str, list[str]]:
    path = folder / "deck.bdf"
    path.write_text(DECK + cards)
    found = read_geometry(path)
    return {name: table.labels for name, table in {**found.rows, **found.sets}.items() if "." in name}


def six(*grids: int) -> list[str]:
    return [f"{grid}.{component}" for grid in grids for component in range(1, 7)]


@theirs
@pytest.mark.parametrize(
    ("deck", "tables", "names"),
    [
        # A tree of four, of which two go through a third; q-sets on scalar points and on grids; b-sets and c-sets.
        (
            "nas2cam/with_se.dat",
            "nas2cam/with_se_nas2cam.op2",
            [f"{n}.{s}" for n in (100, 200, 300, 400) for s in "aq"],
        ),
        ("nas2cam/with_se_convemap.dat", "nas2cam/with_se_convemap_nas2cam.op2", ["100.b", "100.c", "200.c", "300.b"]),
        # Elements by SEELT.
        ("nastran_drm12/inboard.dat", "nastran_drm12/inboard_nas2cam.op2", ["102.a", "102.b", "102.q"]),
        ("nas2cam_csuper/outboard.dat", "nas2cam_csuper/nas2cam.op2", ["101.a", "101.b", "101.q"]),
        # CSUPER in the deck of the assembly.
        ("nas2cam_csuper/assemble.dat", "nas2cam_csuper/nas2cam.op2", ["101.a", "101.b", "101.q"]),
    ],
)
def test_sets_are_those_that_nastran_made(deck: str, tables: str, names: list[str]) -> None:
    ours, their = (read_geometry(THEIRS / name) for name in (deck, tables))
    for name in names:
        known = {**their.sets, **their.rows}[name]
        np.testing.assert_array_equal({**ours.sets, **ours.rows}[name].keys, known.keys, err_msg=name)


@theirs
@pytest.mark.parametrize(
    ("deck", "rows"),
    [("assemble.dat", 46), ("outboard.dat", 46), ("inboard_xtmatrix.dat", 32)],
)
def test_a_deck_of_superelements_proves_their_matrices(deck: str, rows: int) -> None:
    """The last deck has its q-set on components of grids, and a c-set on those that stand for no mode."""
    folder = THEIRS / "nas2cam_csuper"
    draft = draft_body("x", [folder / ("nas2cam.op4" if rows == 46 else "inboard_mk.op4"), folder / deck])
    assert draft.remark == ""
    stiffness, mass = (MatrixSource(path, matrix) for path, matrix in (draft.stiffness, draft.mass))
    body = read_body("x", stiffness=stiffness, mass=mass, geometry=draft.geometry)
    proof = prove_row_order(body)
    assert (body.n, proof.status, proof.motions) == (rows, "proven", 6)


@theirs
@pytest.mark.parametrize("stem", ["nas2cam_extseout", "nas2cam_csuper"])
def test_stiffness_and_mass_of_one_superelement_are_taken(stem: str) -> None:
    """Of three pairs of matrices in a file the mass is that of the stiffness; the other pairs are named."""
    draft = draft_body("x", [THEIRS / stem / f"nas2cam.{kind}" for kind in ("op4", "op2")])
    assert [name for _, name in (draft.stiffness, draft.mass)] == ["KAA#1", "MAA#1"]
    assert draft.remark == ""
    assert "KAA#2" in " ".join(draft.notes)


def test_the_boundary_of_a_superelement_follows_from_its_elements(tmp_path: Path) -> None:
    found = rows_of(tmp_path, "SESET,20,1,2\nSEQSET1,20,0,91,92\nSESET,30,5\nSECSET,30,4,12\nSEQSET,30,93,0\n")
    assert found["20.b"] == six(3)
    assert found["20.a"] == [*six(3), "91.0", "92.0"]
    assert found["30.c"] == ["4.1", "4.2"]
    assert found["30.b"] == six(4)[2:]
    # The coordinates of 20 go through 30, in which its boundary lies.
    found = rows_of(tmp_path, "SESET,20,1,2\nSEBSET1,20,123456,3\nSEQSET1,20,0,91,92\nSESET,30,3,4\n")
    assert found["30.b"] == [*six(5), "91.0", "92.0"]
    # Elements 101 and 102 have grid 3 in common with others.
    found = rows_of(tmp_path, "SEELT,40,101,THRU,102\n")
    assert found["40.a"] == six(3)
    found = rows_of(tmp_path, "CSUPER,50,0,4,2,92,91\n")
    assert found["50.a"] == [*six(2, 4), "91.0", "92.0"]


def test_grids_of_sets_by_name(tmp_path: Path) -> None:
    """Sets of elements, of times, of all and with ids of no grid are no sets of grids; ranges name those that exist."""
    path = tmp_path / "deck.bdf"
    path.write_text(DECK)
    found = {name: ids.tolist() for name, ids in read_geometry(path).node_sets.items()}
    assert found == {"set_7": [1, 2, 4, 5], "set1_3": [1, 2, 3, 4, 5], "set3_5": [4, 5]}
    path.write_text("GRID,1\n=,*1,,*1.,==\n=3\nSET,12,GRID,LIST\n+,2,THRU,4\n")
    assert read_geometry(path).node_sets["set_12"].tolist() == [2, 3, 4]
