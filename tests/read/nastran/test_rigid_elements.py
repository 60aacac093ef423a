"""Rigid elements of decks: for every card, the dependent dofs move as one piece with the independent dofs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cmsreduce.errors import ReadError
from cmsreduce.model import Recovery, rigid_body_shapes
from cmsreduce.read import read_bulk, read_followers

GRIDS = """\
BEGIN BULK
CORD2C,7,,0.3,0.,0.,0.3,0.2,1.
+,1.,0.,0.1
GRID,1,,0.,0.,0.
GRID,2,7,1.2,30.,0.4,7
GRID,3,,0.5,1.,-0.7,7
GRID,4,,1.,2.,0.5
"""


def followers(folder: Path, cards: str, case: str = "") -> tuple[Recovery, np.ndarray, np.ndarray]:
    """The followers, and the six rigid motions of the dependent and of the independent dofs."""
    path = folder / "body.bdf"
    path.write_text(case + GRIDS + cards + "ENDDATA\n")
    nodes = read_bulk(path).nodes
    found = read_followers(path, nodes)
    return found, *(rigid_body_shapes(dofs, nodes) for dofs in (found.dofs, found.leads))


RIGID = {
    "RBE2": ("RBE2,1,1,123456,2,3\n", 12, 6),
    "RBE2 in part": ("RBE2,1,2,1246,3,4\n", 8, 6),
    "RBE2 with expansion": ("RBE2,1,1,123,2,THRU,3,1.2-5\n", 6, 6),
    "RBAR": ("RBAR,1,2,3,123456\n", 6, 6),
    "RBAR with three dofs at each end": ("RBAR,1,2,4,1234,25,,\n", 6, 6),
    "RBAR1": ("RBAR1,1,2,3,123\n", 3, 6),
    "RJOINT": ("RJOINT,1,2,3,12356\n", 5, 6),
    "RBE1": ("RBE1,1,1,123,2,3,3,13\n+,UM,4,123456,2,45\n", 8, 6),
    "RBE1 over six grids": ("RBE1,1,1,123456\n+,UM,4,123,3,456\n", 6, 6),
    "a rod": ("RROD,1,1,4,1\n", 1, 5),
    "a chain of three": ("RBE2,1,1,123456,2\nRBAR,2,2,3,123456\nRBE2,3,3,123,4\n", 15, 6),
    "a constraint": ("MPC,5,1,4,1.,2,4,-1.,\n+,,4,4,0.\n", 1, 2),
}


@pytest.mark.parametrize("cards, followed, leads", RIGID.values(), ids=RIGID.keys())
def test_followers_move_rigidly_with_the_body(tmp_path: Path, cards: str, followed: int, leads: int) -> None:
    found, follow, lead = followers(tmp_path, cards)
    assert (len(found.dofs), len(found.leads)) == (followed, leads if "MPC" not in cards else 2)
    if "MPC" not in cards:
        np.testing.assert_allclose(found.T @ lead, follow, atol=1e-12)


def test_a_constraint_is_solved_for_its_first_dof(tmp_path: Path) -> None:
    """2 x_1.2 - 3 x_4.1 + 5 x_4.3 = 0, of the set in force."""
    case = "CEND\nMPC = 8\n"
    cards = "MPC,8,1,2,2.,4,1,-3.\n+,,4,3,5.\nMPC,9,1,1,1.,4,1,-1.\n"
    found, _, _ = followers(tmp_path, cards, case)
    assert found.dofs.labels == ["1.2"] and found.leads.labels == ["4.1", "4.3"]
    np.testing.assert_allclose(found.T.toarray(), [[1.5, -2.5]])


WRONG = {
    "no way to be stiff": ("RBAR,1,2,3,1235,4\n", "do not fix a stiff body"),
    "too few": ("RBE1,1,1,123\n+,UM,2,123\n", "do not fix"),
    "a circle": ("RBE2,1,1,1,2\nRBE2,2,2,1,1\n", "follow themselves"),
    "two masters": ("RBE2,1,1,123,3\nRBE2,2,2,123,3\n", "3.1 depends on two"),
    "no such grid": ("RBE2,1,9,123,3\n", "no such GRID"),
    "nothing dependent": ("RROD,1,1,4\n", "one translation"),
}


@pytest.mark.parametrize("cards, message", WRONG.values(), ids=WRONG.keys())
def test_a_card_without_an_equation_is_refused(tmp_path: Path, cards: str, message: str) -> None:
    with pytest.raises(ReadError, match=message):
        followers(tmp_path, cards)


def test_a_deck_without_rigid_elements_has_no_followers(tmp_path: Path) -> None:
    found, _, _ = followers(tmp_path, "")
    assert len(found.dofs) == 0
