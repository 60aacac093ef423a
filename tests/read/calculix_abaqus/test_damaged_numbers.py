"""Numbers of CalculiX and Abaqus decks that are damaged: too many digits, signs, ranges that would fill the memory."""

from pathlib import Path

import pytest

from cmsreduce.errors import ReadError
from cmsreduce.read import read_geometry
from cmsreduce.read.calculix_abaqus.constraints import nodes_with_own_rows, rotation_nodes, supports
from cmsreduce.read.calculix_abaqus.decks import blocks, deck_sets

LONG = "7" * 5000
NODES = "*NODE, NSET=ALL\n1, 0., 0., 0.\n2, 1., 0., 0.\n3, 2., 0., 0.\n"


def deck(path: Path, text: str):
    path.write_text(NODES + text)
    found = list(blocks(path))
    return found, deck_sets(found, {"B31": 2})


def test_text_that_is_no_number_of_a_node_is_passed_over(tmp_path: Path) -> None:
    text = f"{LONG}, 9., 9., 9.\n\u00b2, 1., 1., 1.\n"
    text += f"*NSET, NSET=SOME\n1, {LONG}, 3\n*CLOAD\n{LONG}, 1, 1.\n\u00b2, 1, 1.\n"
    text += f"*ELEMENT, TYPE=B31\n1, 1, {LONG}, 2\n"
    found, sets = deck(tmp_path / "deck.inp", text)
    assert sets.nodes == {"ALL": (1, 2, 3), "SOME": (1, 3)}
    assert sets.topology == {1: (1, 2)}
    assert nodes_with_own_rows(found, sets) == set()


@pytest.mark.parametrize(
    ("deck_text", "file_text", "said"),
    [
        ("*NODE, INPUT=n.txt\n9,5,5,x\n", "1,0,0,0\n2,1,0,0\n", "m.inp, line 2: '9,5,5,x'"),
        ("*NODE, INPUT=n.txt\n9,5,5,5\n", "1,0,0,0\n2,1,0,x\n", "n.txt, line 2: '2,1,0,x'"),
        ("*NODE\n9,5,5,5\n*NODE, INPUT=n.txt\n** none\n8,5,5,x\n*STEP\n", "1,0,0,0\n", "m.inp, line 5: '8,5,5,x'"),
        ("*NODE, INPUT=n.txt\n*NODE\n9,5,5,x\n", "1,0,0,0\n", "m.inp, line 3: '9,5,5,x'"),
    ],
)
def test_a_damaged_node_is_blamed_on_its_file(tmp_path: Path, deck_text: str, file_text: str, said: str) -> None:
    """Lines of the deck may follow those of a file; the file was named for both, with a line of the deck."""
    (tmp_path / "m.inp").write_text(deck_text)
    (tmp_path / "n.txt").write_text(file_text)
    with pytest.raises(ReadError, match=f"/{said} is no node"):
        read_geometry(tmp_path / "m.inp")


def test_equations_name_their_nodes_whatever_their_lines(tmp_path: Path) -> None:
    text = "*EQUATION\n2\n1, 1, 1., 2,\n1, -1.\n1\n3, 2, 1.\n"
    assert nodes_with_own_rows(*deck(tmp_path / "deck.inp", text)) == {1, 2, 3}
    # A damaged number of terms: all that follows is taken for one equation, or it has none.
    assert nodes_with_own_rows(*deck(tmp_path / "long.inp", text.replace("N\n2\n", f"N\n{LONG}\n"))) == {1, 2}
    assert nodes_with_own_rows(*deck(tmp_path / "sign.inp", text.replace("N\n2\n", "N\n-2\n"))) == {1}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("*NSET, NSET=SOME, GENERATE\n1, 99999999999999\n", "more than 10000000 ids"),
        (f"*NSET, NSET=SOME, GENERATE\n1, {LONG}\n", "is no range"),
        (f"*BOUNDARY\nALL, 1, {LONG}\n", "is no support"),
        ("*RIGID BODY, NSET=ALL, REF NODE=1, ROT NODE=one\n", "ROT NODE is 'ONE', which is no node"),
    ],
)
def test_what_cannot_be_meant_is_refused(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(ReadError, match=said):
        found, sets = deck(tmp_path / "deck.inp", text)
        turning = rotation_nodes(found, sets, 3)
        supports(found, sets, turning)


def test_a_support_of_all_components_has_six(tmp_path: Path) -> None:
    found, sets = deck(tmp_path / "deck.inp", "*BOUNDARY\n2, -5, 999999999999\n")
    assert sorted(supports(found, sets, {})) == [(2, component) for component in range(1, 7)]
