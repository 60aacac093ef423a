"""Listings that NASTRAN printed, against the decks that they echo."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cmsreduce.errors import ReadError
from cmsreduce.read import read_geometry
from cmsreduce.read.nastran.cards import read_cards


@pytest.mark.shared
@pytest.mark.parametrize("stem", ["full", "inboard"])
def test_the_echo_is_the_deck(shared_data: Path, stem: str) -> None:
    listed, deck = (read_geometry(shared_data / "nas2cam" / f"{stem}.{kind}") for kind in ("out", "dat"))
    order = deck.nodes.index(listed.nodes.id)
    assert len(listed.nodes) == len(deck.nodes) == len(set(order.tolist()))
    np.testing.assert_array_equal(listed.nodes.xyz, deck.nodes.xyz[order])
    np.testing.assert_array_equal(listed.nodes.frame, deck.nodes.frame[order])
    for mine, theirs in ((listed.rows, deck.rows), (listed.sets, deck.sets)):
        assert {name: table.labels for name, table in mine.items()} == {n: table.labels for n, table in theirs.items()}


def test_pages_case_control_and_superelements(tmp_path: Path) -> None:
    """A card may go on over a page; messages name the line of the listing."""
    title = "1    TITLE      PAGE     2\n0\n0           S O R T E D   B U L K   D A T A   E C H O"
    cards = ("CORD2R  3               0.      0.      0.      0.      0.      1.      +", "+       1.      0.      0.")
    cards += ("GRID    4               1.      2.      3.      3", "GRID    8               1.      x.      3.")
    first, rest, grid, other = (f"{count:19d}-        {card}\n" for count, card in enumerate(cards, 1))
    path = tmp_path / "body.f06"
    path.write_text(
        "0      C A S E    C O N T R O L    E C H O\n          COUNT\n                  1        SPC = 7\n"
        f"{title}\n{first}{title}\n{rest}{grid}{title}          SUPER    =       9\n{other}"
        "                             ENDDATA\n0  GRID POINT SINGULARITY TABLE\n      4-        5\n"
    )
    found = read_cards(path, {"GRID", "CORD2R"})
    assert found.case_control == ("SPC = 7",)
    assert [card.fields[-3:] for card in found.sections[0]["CORD2R"]] == [("1.", "0.", "0.")]
    assert [card.line for card in found.sections[9]["GRID"]] == [16]
    assert read_geometry(path).nodes.id.tolist() == [4]
    path.write_text(path.read_text().replace("2.      3.", "y.      3."))
    with pytest.raises(ReadError, match="line 12"):
        read_geometry(path)


@pytest.mark.parametrize("left", [1, 2, 4])
def test_a_listing_that_was_cut_is_no_deck_with_fewer_nodes(tmp_path: Path, left: int) -> None:
    cards = "".join(f"{k:19d}-        GRID    {k:<8d}        {k}.0     0.      0.\n" for k in range(1, 5))
    listing = f"1  A  PAGE  1\n0      S O R T E D   B U L K   D A T A   E C H O\n  ENTRY\n{cards}"
    path = tmp_path / "body.f06"
    path.write_text(f"{listing}                       ENDDATA\n0  TOTAL COUNT=   5\n1  A  PAGE  2\n0  RESULTS\n")
    assert read_geometry(path).nodes.id.tolist() == [1, 2, 3, 4]
    path.write_text("".join(listing.splitlines(keepends=True)[: 3 + left]))
    with pytest.raises(ReadError, match=r"body\.f06: the listing is truncated: .* has no ENDDATA"):
        read_geometry(path)
