"""Bars of decks: forces along them from sections and materials, in all forms of the cards."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from cmsreduce.errors import ReadError
from cmsreduce.model import Units
from cmsreduce.read import bars_in_units, read_bars, read_geometry, read_members

GRIDS = "GRID,1,,0.,0.,0.\nGRID,2,,1.,0.,0.\nGRID,3,,1.,1.,0.\n"
STEEL = "MAT1,9,2.1+11,,0.3,7850.\n"
BAR = "PBAR,4,9,2.-4,3.-9,5.-9,1.-9\n"

READ = {
    "a bar": ("CBAR,11,4,1,2,0.,1.,0.\n" + BAR + STEEL, (11, 1, 2, 4.2e7, 4e-5, True)),
    "a bar named after its property": ("CBAR,4,,1,2,0.,1.,0.\n" + BAR + STEEL, (4, 1, 2, 4.2e7, 4e-5, True)),
    "a modulus of shear alone": (
        "CBAR,11,4,1,2,0.,1.,0.\n" + BAR + "MAT1,9,,8.+10,0.25\n",
        (11, 1, 2, 4e7, 4e-5, True),
    ),
    "a beam with a second station": (
        "CBEAM,11,4,2,3,0.,0.,1.\nPBEAM,4,9,2.-4,3.-9,5.-9,,1.-9\n+,,,,,,,,\n+,YESA,1.,2.-4\n" + STEEL,
        (11, 2, 3, 4.2e7, 4e-5, True),
    ),
    "a bar hinged at both ends": (
        "CBAR,11,4,1,2,0.,1.,0.\n+,456,56\n" + BAR + STEEL,
        (11, 1, 2, 4.2e7, 0.0, False),
    ),
    "a rod": ("CROD,11,4,1,3\nPROD,4,9,1.-4\n" + STEEL, (11, 1, 3, 2.1e7, 0.0, False)),
    "a rod with its own section": ("CONROD,11,1,3,9,1.-4\n" + STEEL, (11, 1, 3, 2.1e7, 0.0, False)),
    "springs and rigid elements beside it": (
        "CELAS2,5,10.,1,1,2,1\nRBE2,6,1,123,3\nCONROD,11,1,3,9,1.-4\n" + STEEL,
        (11, 1, 3, 2.1e7, 0.0, False),
    ),
}


def deck(folder: Path, cards: str) -> Path:
    path = folder / "body.bdf"
    path.write_text("BEGIN BULK\n" + GRIDS + cards + "ENDDATA\n")
    return path


@pytest.mark.parametrize("cards, expected", READ.values(), ids=READ.keys())
def test_a_bar_is_read(tmp_path: Path, cards: str, expected: tuple) -> None:
    found = read_bars(deck(tmp_path, cards))
    assert len(found) == 1
    assert (found.id[0], *found.node[0], found.bends[0]) == (*expected[:3], expected[5])
    np.testing.assert_allclose([found.EA[0], found.radius_squared[0]], expected[3:5], rtol=1e-12)


REFUSED = {
    "no bars": ("", "no CBAR"),
    "a plate": ("CQUAD4,1,1,1,2,3,3\nCONROD,11,1,3,9,1.-4\n" + STEEL, "line 5: CQUAD4.*bars only"),
    "offsets along the bar": (
        "CBAR,11,4,1,2,0.,1.,0.,GOO\n+,,,0.,0.,.1\n" + BAR + STEEL,
        "line 5: CBAR 11.*offset",
    ),
    "a pin in one plane": ("CBAR,11,4,1,2,0.,1.,0.\n+,,46\n" + BAR + STEEL, "released"),
    "a slide": ("CBAR,11,4,1,2,0.,1.,0.\n+,156,156\n" + BAR + STEEL, "released"),
    "a taper": (
        "CBEAM,11,4,2,3,0.,0.,1.\nPBEAM,4,9,2.-4,3.-9,5.-9,,1.-9\n+,NO,1.,1.-4\n" + STEEL,
        "line 6: PBEAM 4.*area changes",
    ),
    "a shape": ("CBAR,11,4,1,2,0.,1.,0.\nPBARL,4,9,,BAR\n+,.1,.2\n" + STEEL, "PBARL.*PBAR"),
    "no property": ("CBAR,11,5,1,2,0.,1.,0.\n" + BAR + STEEL, "no PBAR 5"),
    "no material": ("CONROD,11,1,3,8,1.-4\n" + STEEL, "no MAT1 8"),
    "no area": ("CONROD,11,1,3,9,0.\n" + STEEL, "must be positive"),
    "defaults": ("BAROR,,4,,,0.,1.,0.\nCBAR,11,,1,2\n" + BAR + STEEL, "BAROR"),
}


@pytest.mark.parametrize("cards, message", REFUSED.values(), ids=REFUSED.keys())
def test_an_unsupported_card_is_refused_by_its_line(tmp_path: Path, cards: str, message: str) -> None:
    with pytest.raises(ReadError, match=message):
        read_bars(deck(tmp_path, cards))


def test_offsets_and_hinges_of_ends_are_read(tmp_path: Path) -> None:
    cards = "CBAR,11,4,1,2,0.,1.,0.,GOG\n+,,456,,,,.1,.2,.3\n" + BAR + STEEL
    found = read_bars(deck(tmp_path, cards))
    assert found.hinged is not None and found.offset is not None
    assert found.hinged.tolist() == [[False, True]] and found.bends.tolist() == [True]
    assert found.offset.tolist() == [[[0, 0, 0], [0.1, 0.2, 0.3]]]
    short = bars_in_units(found, Units.parse("m-kg-s"), Units.parse("mm-t-s")).offset
    assert short is not None
    np.testing.assert_allclose(short[0, 1], [100, 200, 300], rtol=1e-12)


def test_bars_change_units(tmp_path: Path) -> None:
    """210 GPa is 2.1e5 MPa; 2e-4 m^2 is 200 mm^2; the force stays a force."""
    found = read_bars(deck(tmp_path, READ["a bar"][0]))
    small = bars_in_units(found, Units.parse("m-kg-s"), Units.parse("mm-t-s"))
    np.testing.assert_allclose([small.EA[0], small.radius_squared[0]], [2.1e5 * 200, 40.0], rtol=1e-12)


def test_the_time_for_members_grows_as_their_number(tmp_path: Path) -> None:
    """Every bar has a property of its own."""
    count = 1000
    cards = ["BEGIN BULK", "MAT1,1,2.+11,,.3,7850.", "GRID,1"]
    cards += [f"GRID,{k + 1},,{k}.,0.,0." for k in range(1, count + 1)]
    cards += [f"PBAR,{k},1,{k}.,1.,1.,1.\nCBAR,{k},{k},{k},{k + 1},0.,0.,1." for k in range(1, count + 1)]
    path = tmp_path / "body.bdf"
    path.write_text("\n".join(cards) + "\n")
    nodes = read_geometry(path).nodes
    started = time.process_time()
    members = read_members(path, nodes)
    assert time.process_time() - started < 2.0
    np.testing.assert_allclose(members.EA, 2e11 * np.arange(1, count + 1))
