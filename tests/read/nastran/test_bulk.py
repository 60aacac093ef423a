"""Decks: grid defaults, scalar points, dof sets."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cmsreduce.errors import DofMapError, ReadError
from cmsreduce.read import BulkDeck, read_bulk


def deck(tmp_path: Path, *lines: str) -> BulkDeck:
    path = tmp_path / "deck.bdf"
    path.write_text("\n".join(lines) + "\n")
    return read_bulk(path)


def labels(found: BulkDeck, name: str) -> str:
    return " ".join(found.dof_table(name).labels)


FRAMES = (
    "CORD2R,1,0,10.,0.,0.,10.,0.,1.",
    "+,11.,0.,0.",
    "CORD2R,2,0,0.,0.,0.,1.,0.,0.",
    "+,0.,1.,0.",
)


def test_grdset_fills_blank_fields_only(tmp_path: Path) -> None:
    found = deck(
        tmp_path,
        "GRDSET,,1,,,,2,126",
        *FRAMES,
        "GRID,1,,1.,2.,3.",
        "GRID,2,0,1.,2.,3.,0,0",
        "GRID    3               1.      2.      3.              3",
    )
    np.testing.assert_allclose(found.nodes.xyz, [[11, 2, 3], [1, 2, 3], [11, 2, 3]])
    turned = [[0, 1, 0], [0, 0, 1], [1, 0, 0]]
    np.testing.assert_allclose(found.nodes.frame, [turned, np.eye(3), turned], atol=1e-15)
    assert labels(found, "s") == "1.1 1.2 1.6 3.3"
    assert found.sizes() == {"a": 14, "f": 14, "n": 18, "g": 18, "s": 4}


def test_grids_keep_their_order_of_appearance_and_sets_are_sorted(tmp_path: Path) -> None:
    found = deck(tmp_path, "GRID,20", "GRID,3", "SPOINT,7,100", "GRID,11,,,,,,12456")
    assert found.nodes.id.tolist() == [20, 3, 11]
    assert labels(found, "f") == ("3.1 3.2 3.3 3.4 3.5 3.6 7.0 11.3 20.1 20.2 20.3 20.4 20.5 20.6 100.0")


def test_the_displacement_frame_of_a_cylindrical_system_follows_the_grid(tmp_path: Path) -> None:
    found = deck(
        tmp_path,
        "CORD1C,5,1,2,3",
        "GRID,1,,0.,0.,0.",
        "GRID,2,,0.,0.,1.",
        "GRID,3,,1.,0.,0.",
        "GRID,4,5,2.,90.,4.,5",
        "GRID,6,,0.,0.,9.,5",
    )
    np.testing.assert_allclose(found.nodes.xyz[3], [0, 2, 4], atol=1e-15)
    np.testing.assert_allclose(found.nodes.frame[3], [[0, 1, 0], [-1, 0, 0], [0, 0, 1]], atol=1e-15)
    np.testing.assert_allclose(found.nodes.frame[4], np.eye(3), atol=1e-15)


POINTS = ("GRID,1", "GRID,2", "GRID,3", "GRID,5", "SPOINT,11,THRU,14")


@pytest.mark.parametrize(
    ("cards", "name", "expected"),
    [
        (["ASET1,12,1,THRU,5"], "a", "1.1 1.2 2.1 2.2 3.1 3.2 5.1 5.2"),
        (["ASET1,3,1,THRU,5,EXCEPT,3"], "a", "1.3 2.3 5.3"),
        (["ASET1,3,1,THRU,5,BY,2"], "a", "1.3 3.3 5.3"),
        (["ASET1,3,1,THRU,5,EXCEPT,2,3,11"], "a", "1.3 5.3 11.0"),
        (["ASET1,3,1,THRU,2,5"], "a", "1.3 2.3 5.3"),
        (["ASET1,3,1,THRU,99999999"], "a", "1.3 2.3 3.3 5.3 11.0 12.0 13.0 14.0"),
        (["ASET1,3,1,2,3,5,11,12,13", "+,14"], "a", "1.3 2.3 3.3 5.3 11.0 12.0 13.0 14.0"),
        (["ASET,5,31,11,,2,6"], "a", "2.6 5.1 5.3 11.0"),
        (["BSET1,1,1,2", "QSET1,,11,THRU,12"], "a", "1.1 2.1 11.0 12.0"),
        (["BSET1,1,1,2", "QSET1,0,11,THRU,12"], "b", "1.1 2.1"),
        (["BSET,1,1", "QSET,13,0,12"], "q", "12.0 13.0"),
        (["ASET1,1,1,THRU,5", "QSET1,,11"], "b", "1.1 2.1 3.1 5.1"),
        (["ASET1,1,1", "SUPORT,2,3"], "a", "1.1 2.3"),
        (["BNDFIX1,1,1,2", "QSET1,,11"], "b", "1.1 2.1"),
        (["CSET1,1,1,2", "BSET1,2,3"], "a", "1.1 2.1 3.2"),
        (["SPC1,9,123456,1,THRU,3", "SPC1,9,,11,THRU,14"], "a", "5.1 5.2 5.3 5.4 5.5 5.6"),
        (["OMIT1,123456,1,THRU,3", "OMIT1,,11,THRU,14"], "a", "5.1 5.2 5.3 5.4 5.5 5.6"),
        (["SPC,9,1,12,0.,2,3", "SPC,9,11"], "s", "1.1 1.2 2.3 11.0"),
        (["SUPORT,1,35"], "r", "1.3 1.5"),
    ],
)
def test_dof_sets(tmp_path: Path, cards: list[str], name: str, expected: str) -> None:
    assert labels(deck(tmp_path, *POINTS, *cards), name) == expected


def test_supports_alone_omit_nothing(tmp_path: Path) -> None:
    assert deck(tmp_path, *POINTS, "SUPORT,1,35").sizes()["a"] == 28


@pytest.mark.parametrize(
    ("case", "constrained", "remark"),
    [
        ([], "1.1 2.2 3.3", None),
        (["CEND", "SPC = 1"], "1.1", None),
        (["CEND", "TITLE = none selected"], "", None),
        (["CEND", "SPC=2", "SUBCASE 1", "SPC = 1", "SUBCASE 2"], "1.1", "subcases select different SPC sets (1, 2)"),
        (["CEND", "SPC = 4"], "1.1 2.2", None),
        (["CEND", "SPC = 77"], "", "case control selects SPC = 77, which the deck does not have"),
    ],
)
def test_case_control_selects_constraints(
    tmp_path: Path, case: list[str], constrained: str, remark: str | None
) -> None:
    bulk = ["BEGIN BULK"] if case else []
    cards = ["SPC1,1,1,1", "SPC,2,2,2", "SPC1,3,3,3", "SPCADD,4,1,2"]
    found = deck(tmp_path, *case, *bulk, *POINTS, *cards)
    assert labels(found, "s") == constrained
    assert [text for text in found.remarks if remark and text.startswith(remark)] == list(found.remarks)


@pytest.mark.parametrize(
    ("cards", "expected"),
    [
        (["RBE2,9,1,123,2,3"], "2.1 2.2 2.3 3.1 3.2 3.3"),
        (["RBE2,9,1,3,2,THRU,5,6.5-6"], "2.3 3.3 5.3"),
        (["RBAR,9,1,2,123456"], "2.1 2.2 2.3 2.4 2.5 2.6"),
        (["RBAR,9,1,2,1235,6,4,3"], "1.4 2.3"),
        (["RBE3,9,,5,123,1.0,123,1,2", "+,3"], "5.1 5.2 5.3"),
        (["RBE3,9,,5,123,1.0,123,1,2", "+,3,UM,1,1,2,23", "+,ALPHA,1.-6"], "1.1 2.2 2.3"),
        (["RBE1,9,1,123456", "+,UM,2,123,3,12"], "2.1 2.2 2.3 3.1 3.2"),
        (["RROD,9,1,2,,3"], "2.3"),
        (["RBAR1,9,1,2,12"], "2.1 2.2"),
        (["MPC,4,3,5,1.,1,5,-1."], "3.5"),
        (["MPC,4,12,,1.,1,5,-1."], "12.0"),
    ],
)
def test_dependent_dofs(tmp_path: Path, cards: list[str], expected: str) -> None:
    found = deck(tmp_path, *POINTS, *cards)
    assert labels(found, "m") == expected
    assert found.sizes()["n"] == found.sizes()["f"] == 28 - len(expected.split())


@pytest.mark.parametrize(
    ("chosen", "dependent", "n"), [("YES", "3.1 3.2 3.3", 25), ("NO", "2.1 2.2 2.3 3.1 3.2 3.3", 22)]
)
def test_dofs_that_the_run_keeps_are_not_dependent(tmp_path: Path, chosen: str, dependent: str, n: int) -> None:
    """With PARAM,AUTOMSET,YES the run makes others dependent; matrices of an aircraft on RBE3 were refused."""
    found = deck(tmp_path, *POINTS, f"param,automset,{chosen.lower()}", "RBE2,9,1,123,2,3", "ASET1,123456,1,2")
    assert labels(found, "m") == dependent and found.sizes()["n"] == n
    assert labels(found, "a") == " ".join(f"{node}.{component}" for node in (1, 2) for component in range(1, 7))
    assert [text[:15] for text in found.remarks] == (["PARAM,AUTOMSET,"] if chosen == "YES" else [])


def test_rigid_elements_that_are_not_read_are_told(tmp_path: Path) -> None:
    assert deck(tmp_path, *POINTS, "RSPLINE,9,.1,1,2,123456,3").remarks == (
        "1 RSPLINE cards are not understood: their dependent dofs stay in the sets n, f and a",
    )


def test_springs_may_make_scalar_points(tmp_path: Path) -> None:
    found = deck(tmp_path, "GRID,1", "CELAS2,1,5.,1,3,77", "CELAS4,2,5.,78,0", "CMASS2,3,1.,77")
    assert found.spoints.tolist() == [77, 78]


def test_a_deck_of_scalar_points_has_no_nodes(tmp_path: Path) -> None:
    found = deck(tmp_path, "SPOINT,7,8", "CELAS2,1,5.,7,,8")
    assert found.spoints.tolist() == [7, 8] and not len(found.nodes)


def test_the_main_part_is_read_or_else_the_only_superelement(tmp_path: Path) -> None:
    supers = ["BEGIN SUPER=3", "GRID,30", "BEGIN SUPER=4", "GRID,40"]
    assert deck(tmp_path, "GRID,1", *supers).nodes.id.tolist() == [1]
    assert deck(tmp_path, *supers[:2]).nodes.id.tolist() == [30]
    with pytest.raises(ReadError, match="holds superelements 3, 4 and no main bulk data"):
        deck(tmp_path, *supers)
    assert read_bulk(tmp_path / "deck.bdf", superelement=4).nodes.id.tolist() == [40]
    with pytest.raises(ReadError, match=r"superelement 5 has no points \(those that have: 3, 4\)"):
        read_bulk(tmp_path / "deck.bdf", superelement=5)


def test_equal_duplicates_are_allowed(tmp_path: Path) -> None:
    found = deck(tmp_path, "GRID,1,,1.5", "GRID,1,0,1.50,0.,,,", *FRAMES, *FRAMES)
    assert len(found.nodes) == 1


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (["GRID,1,,1.5", "GRID,1,,1.6"], r"line 2: GRID: grid 1 differs from .*line 1: GRID 1"),
        (["GRID,1,,,,,,12", "GRID,1,,,,,,123"], "grid 1 differs"),
        (["GRID,1,9"], r"line 1: GRID 1 refers to coordinate system 9"),
        (["GRID,1,,,,,-1"], "fluid point"),
        (["GRID,1,,,,,,178"], "'178' in field 8 of grid 1"),
        (["GRID,0"], "0 is no grid id"),
        (["GRID,1", "SPOINT,1"], "1 is a GRID as well"),
        (["GRID,1", "GRDSET,,,,,,,12", "GRDSET,,,,,,,13"], "differs from the GRDSET before it"),
        ([*FRAMES, "CORD2R,1,0,0.,0.,0.,0.,0.,1.", "+,1.", "GRID,1"], "coordinate system 1 differs"),
        (["GRID,1", "ASET1,3,1,2"], "names node 2, but the deck has no such GRID or SPOINT"),
        (["GRID,1", "ASET1,,1"], "'' names no components of grid 1"),
        (["GRID,1", "ASET1,7,1"], "'7' names no components"),
        (["GRID,1", "SPC1,1,3,5,THRU,2"], "'5 THRU 2' runs backwards"),
        (["GRID,1", "SPC1,1,3,5,THRU"], "nothing follows 'THRU'"),
        (["GRID,1", "SPC1,1,3,ALL"], "field 4 should be an integer, it is 'ALL'"),
        (["GRID,1", "RBE1,9,1,123456"], "no UM field"),
        (["$ nothing"], "there is no GRID and no SPOINT"),
    ],
)
def test_bad_decks_are_refused(tmp_path: Path, lines: list[str], message: str) -> None:
    with pytest.raises(ReadError, match=message):
        deck(tmp_path, *lines)


def test_sets_that_no_card_names_are_refused_with_those_there_are(tmp_path: Path) -> None:
    found = deck(tmp_path, *POINTS)
    with pytest.raises(DofMapError, match=r"has no b-set \(fixed interface\).*a \(28\), f \(28\), n \(28\), g \(28\)"):
        found.dof_table("b")
    with pytest.raises(DofMapError, match="'z' is no dof set"):
        found.dof_table("z")


@pytest.mark.shared
@pytest.mark.parametrize(
    ("file", "sizes"),
    [
        ("block_a/block_a.bdf", {"a": 1575, "f": 3150, "n": 3150, "g": 3150, "o": 1575}),
        ("swept_plane/sol103_swept_plane.bdf", {"a": 45, "f": 45, "n": 90, "g": 90, "r": 3, "s": 45}),
        ("nas2cam/inboard.dat", {"a": 32, "f": 164, "n": 164, "g": 164, "b": 24, "q": 8, "o": 132}),
        # An RBE2 component, two of an RBE3 and one MPC are dependent: outboard.dat.
        ("nas2cam/outboard.dat", {"a": 46, "f": 180, "n": 180, "g": 184, "b": 24, "q": 22, "o": 134, "m": 4}),
    ],
)
def test_sets_of_real_decks(shared_data: Path, file: str, sizes: dict[str, int]) -> None:
    assert read_bulk(shared_data / file).sizes() == sizes


def test_a_field_of_thousands_of_digits_hides_no_message(tmp_path: Path) -> None:
    path = tmp_path / "deck.bdf"
    path.write_text(f"BEGIN BULK\nGRID,1,,0.,0.,0.\nASET1,{'9' * 5000},1\nENDDATA\n")
    with pytest.raises(ReadError, match=r"line 3: ASET1: '9{39}\.\.\. names no components of grid 1; use") as caught:
        read_bulk(path)
    assert len(str(caught.value)) < 200 + len(str(path))
