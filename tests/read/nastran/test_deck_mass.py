"""The mass that a deck states, by hand; none if some of its elements are not counted."""

from __future__ import annotations

from itertools import product
from pathlib import Path

import numpy as np
import pytest

from cmsreduce.model import Nodes
from cmsreduce.read.nastran.stated import deck_statement
from cmsreduce.read.nastran.stated.mass import grid_masses, solid_volumes

# A bent line, and the corners of a block of 2 x 1 x 3 with a corner aside.
BLOCK = [[x, y, z] for z in (0.0, 3.0) for x, y in ((0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (0.0, 1.0))]
NODES = Nodes.in_basic(range(1, 13), [[0.0, 0, 0], [3, 4, 0], [3, 4, 12], *BLOCK, [2.4, 1.2, 0]])
MATERIAL = "MAT1,1,7.+10,,0.3,2700."
ENDS = {"5 m": (5.0, [1.5, 2, 0]), "12 m": (12.0, [3, 4, 6])}


def stated(tmp_path: Path, *cards: str):
    path = tmp_path / "deck.bdf"
    path.write_text("\n".join(["BEGIN BULK", "GRID,1", *cards, "ENDDATA"]) + "\n")
    return deck_statement(path, NODES, np.ones(len(NODES), dtype=bool))[0]


@pytest.mark.parametrize(
    ("cards", "parts"),
    [
        ((MATERIAL, "PBAR,7,1,.01,1.,1.,1.", "CBAR,1,7,1,2,0.,0.,1."), [(2700 * 0.01 * 5, [1.5, 2, 0])]),
        ((MATERIAL, "PBAR,7,1,.01,1.,1.,1.,2.", "CBAR,1,7,1,2,0.,0.,1."), [(29 * 5, [1.5, 2, 0])]),
        ((MATERIAL, "PROD,7,1,.02,,,4.", "CROD,1,7,2,3"), [(58 * 12, [3, 4, 6])]),
        ((MATERIAL, "CONROD,1,1,2,1,.03,0.,0.,5."), [(86 * 5, [1.5, 2, 0])]),
        ((MATERIAL, "PBEAM,7,1,.01,1.,1.,0.,1.,3.", "CBEAM,1,7,2,3,0.,1.,0."), [(30 * 12, [3, 4, 6])]),
        (("CONM2,1,3,,6.5",), [(6.5, [3, 4, 12])]),
        (("CONM2,1,3,0,6.5,.1,.2,.3", "CONM2,2,1,-1,2.,1.,1.,1."), [(6.5, [3.1, 4.2, 12.3]), (2, [1, 1, 1])]),
        # Sections by shape: area times density, and what is no structure.
        ((MATERIAL, "PBARL,7,1,,BAR,,,,,", ",.1,.2,3.", "CBAR,1,7,1,2,0.,0.,1."), [(57 * 5, [1.5, 2, 0])]),
        ((MATERIAL, "PBARL,7,1,,BOX,,,,,", ",.4,.3,.05,.1", "CBAR,1,7,1,2,0.,0.,1."), [(216 * 5, [1.5, 2, 0])]),
        ((MATERIAL, "PBARL,7,1,,ROD,,,,,", ",.1", "CBAR,1,7,1,2,0.,0.,1."), [(27 * np.pi * 5, [1.5, 2, 0])]),
        ((MATERIAL, "PBEAML,7,1,,TUBE,,,,,", ",.2,.1", "CBEAM,1,7,2,3,0.,1.,0."), [(81 * np.pi * 12, [3, 4, 6])]),
        # Both ends one metre up; one end pulled in.
        ((MATERIAL, "PBAR,7,1,.01", "CBAR,1,7,1,2,0.,0.,1.", ",,,0.,0.,1.,0.,0.,1."), [(27 * 5, [1.5, 2, 1])]),
        ((MATERIAL, "PROD,7,1,.01", "PBAR,7,1,.01", "CBAR,1,7,2,3,1.,0.,0.", ",,,,,2."), [(27 * 10, [3, 4, 7])]),
        # Plates and solids on 3, 4, 6 and 8 corners.
        ((MATERIAL, "PSHELL,7,1,.1,,,,,5.", "CTRIA3,1,7,4,5,7"), [(275 * 1, [2 / 3, 1 / 3, 0])]),
        ((MATERIAL, "PSHELL,7,1,.1", "CQUAD4,1,7,4,5,6,7,30."), [(270 * 2, [1, 0.5, 0])]),
        ((MATERIAL, "PSOLID,7,1", "CTETRA,1,7,4,5,7,8"), [(2700, [0.5, 0.25, 0.75])]),
        ((MATERIAL, "PSOLID,7,1", "CPENTA,1,7,4,5,7,8,9,11"), [(2700 * 3, [2 / 3, 1 / 3, 1.5])]),
        ((MATERIAL, "PSOLID,7,1", "CHEXA,1,7,4,5,6,7,8,9", ",10,11"), [(2700 * 6, [1, 0.5, 1.5])]),
        (("CONM1,1,3,,4.,0.,4.,0.,0.", ",4.,0.,0.,0.,2."), [(4, [3, 4, 12])]),
        # Properties named like their elements by default, and a rod without density.
        (("MAT1,1,7.+10,,0.3", "CONM2,9,2,,1.", "PROD,4,1,.02", "CROD,4,,1,2"), [(1.0, [3, 4, 0]), (0, [0, 0, 0])]),
    ],
)
@pytest.mark.parametrize("weight", [1.0, 0.00259])
def test_bars_and_points_weigh_what_their_cards_say(tmp_path: Path, cards, parts, weight: float) -> None:
    found = stated(tmp_path, *cards, f"PARAM,WTMASS,{weight}")
    masses = np.array([mass for mass, _ in parts])
    assert found is not None and found[0] == pytest.approx(weight * masses.sum(), rel=1e-14)
    np.testing.assert_allclose(found[1], masses @ np.array([at for _, at in parts]) / masses.sum(), rtol=1e-14)


@pytest.mark.parametrize(
    "cards",
    [
        (),
        ("CONM2,1,3,,0.",),
        ("CONM2,1,3,,6.5", "CQUAD4,1,1,1,2,3,4"),
        ("CONM2,1,3,,6.5", "CMASS2,1,5.,1,1,2,1"),
        # A scalar point that takes part in the motion along an axis of its own; its component may be given as 1.
        ("CONM2,1,3,,6.5", "SPOINT,2", "CMASS2,1,5.,2,1"),
        ("CONM2,1,3,4,6.5,.1",),
        ("CONM2,1,99,,6.5",),
        ("CONM2,1,3,,six",),
        (MATERIAL, "CROD,1,7,2,3"),
        ("PROD,7,1,.02", "CROD,1,7,2,3", "CONM2,1,3,,6.5"),
        (MATERIAL, "PBARL,7,1,,HAT", ",.1,.1,.1,.1", "CBAR,1,7,1,2,0.,0.,1."),
        (MATERIAL, "PBEAML,7,1,,ROD", ",.1,,YES,1.,.2", "CBEAM,1,7,1,2,0.,0.,1."),
        (MATERIAL, "PBAR,7,1,.01", "CBAR,1,7,1,2,0.,0.,1.,GOO", ",,,.1"),
        (MATERIAL, "PSHELL,7,1,.1", "CQUAD4,1,7,4,5,12,7"),
        (MATERIAL, "PSHELL,7,1,.1", "CQUAD4,1,7,4,5,6,7,,.1"),
        (MATERIAL, "PSOLID,7,1", "CHEXA,1,7,4,5,12,7,8,9", ",10,11"),
        (MATERIAL, "PSOLID,7,1", "CTETRA,1,7,4,5,7,8,6,9", ",10,11,12"),
        ("CONM2,1,3,,6.5", "PCOMP,7", "CTRIA3,1,7,4,5,7"),
        ("CONM1,1,3,,4.,0.,5.",),
    ],
)
def test_a_deck_that_is_not_counted_whole_states_none(tmp_path: Path, cards) -> None:
    assert stated(tmp_path, *cards) is None


TETRAHEDRON = np.array([[0.0, 0, 0], [2, 0, 0], [0, 1, 0], [0.5, 0.5, 3]])
PAIRS = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))


@pytest.mark.parametrize("bent", [0.0, 0.01])
def test_solids_with_nodes_between_corners(tmp_path: Path, bent: float) -> None:
    """A straight tetrahedron: int x x dV = V / 20 (sum of x x + 16 c c); how its nodes share it is not stated."""
    middle = np.array([TETRAHEDRON[list(pair)].mean(axis=0) for pair in PAIRS])
    middle[2, 0] -= bent
    path = tmp_path / "deck.bdf"
    cards = ["BEGIN BULK", "GRID,1", MATERIAL, "PSOLID,7,1", "CTETRA,1,7,1,2,3,4,5,6", ",7,8,9,10", "ENDDATA"]
    path.write_text("\n".join(cards) + "\n")
    nodes = Nodes.in_basic(range(1, 11), np.vstack([TETRAHEDRON, middle]))
    found, _ = deck_statement(path, nodes, np.ones(len(nodes), dtype=bool))
    assert (found is None) == (bent > 0)
    if found is not None:
        c = TETRAHEDRON.mean(axis=0)
        second = 2700 * 1.0 / 20 * (TETRAHEDRON.T @ TETRAHEDRON - 4 * np.outer(c, c))
        assert found.mass == pytest.approx(2700 * 1.0, rel=1e-14) and not found.nodal_known
        np.testing.assert_allclose(found.centre, c, rtol=1e-14)
        np.testing.assert_allclose(found.inertia, np.trace(second) * np.eye(3) - second, rtol=1e-13)
        # No lumping leaves the hull of an element.
        assert (found.lumping >= 2700 * np.square(TETRAHEDRON - c).sum(axis=1).max() * (1 - 1e-12)).all()
        assert grid_masses(path, nodes) is None


LOADED = ("FORCE,1,2,,1.,0.,0.,1.", "GRAV,1,,9.81,0.,0.,1.")


@pytest.mark.parametrize(
    ("before", "load", "stressed"),
    [
        ((), None, False),
        ((), LOADED[0], True),
        ((), LOADED[1], True),
        (("SOL 103", "CEND", "METHOD = 1"), LOADED[0], False),
        (("ASSIGN OUTPUT4='k.op4',UNIT=11",), LOADED[0], True),
        (("SOL 103", "CEND", "SUBCASE 2", "  statsub(preload) = 1"), LOADED[0], True),
        (("SOL 103", "CEND", "SUBCASE 2", "  STATSUB = 1"), None, True),
    ],
)
@pytest.mark.parametrize("apart", [False, True])
def test_what_is_included_is_stated_too(tmp_path: Path, before, load, stressed: bool, apart: bool) -> None:
    cards = [MATERIAL, "PROD,7,1,.02", "CROD,1,7,1,2", *([load] if load else [])]
    if apart:
        (tmp_path / "model.bdf").write_text("\n".join(cards) + "\n")
        cards = ["INCLUDE 'model.bdf'"]
    path = tmp_path / "deck.bdf"
    path.write_text("\n".join([*before, "BEGIN BULK", "GRID,1", *cards, "ENDDATA"]) + "\n")
    mass, energy = deck_statement(path, NODES, np.ones(len(NODES), dtype=bool))
    assert mass is not None and mass.mass == pytest.approx(2700 * 0.02 * 5, rel=1e-14)
    assert energy is not None and energy.stressed is stressed


def test_a_file_that_is_no_deck_states_none(tmp_path: Path) -> None:
    path = tmp_path / "mesh.frd"
    path.write_bytes(bytes(range(256)))
    every = np.ones(len(NODES), dtype=bool)
    assert deck_statement(path, NODES, every) == (None, None)
    assert deck_statement(tmp_path / "none.bdf", NODES, every) == (None, None)


def by_four_points(corners: np.ndarray, rule: tuple[np.ndarray, np.ndarray]) -> tuple[float, np.ndarray]:
    """Volume and second moment of a hexahedron, by the gradients of its trilinear map at 64 points."""
    signs, volume, second = 2.0 * (np.array(BLOCK) > 0) - 1, 0.0, np.zeros((3, 3))
    for (a, wa), (b, wb), (c, wc) in product(zip(*rule, strict=True), repeat=3):
        terms = 1 + signs * [a, b, c]
        slopes = [signs[:, k] * terms[:, k - 2] * terms[:, k - 1] / 8 for k in range(3)]
        x, size = terms.prod(axis=1) @ corners / 8, wa * wb * wc * np.linalg.det(np.array(slopes) @ corners)
        volume, second = volume + size, second + size * np.outer(x, x)
    return volume, second


@pytest.mark.parametrize(("lift", "points"), [(0.0, 2), (1e-8, 2), (0.2, 3)])
def test_the_inertia_of_a_parallelepiped_takes_two_points(monkeypatch, lift: float, points: int) -> None:
    """Sheared block: int x x dV = V (c c + E E / 12), E its edges as columns; with a lifted corner, four points."""
    corners = np.array(BLOCK) @ np.array([[1.0, 0.2, 0.1], [0.3, 1.0, 0.0], [0.4, -0.2, 1.0]]).T
    corners[6, 2] += lift
    taken, rule = [], np.polynomial.legendre.leggauss
    monkeypatch.setattr(np.polynomial.legendre, "leggauss", lambda number: taken.append(number) or rule(number))
    volume, centre, second = (part[0] for part in solid_volumes(corners[None]))
    assert taken == [points]
    # The Jacobian of a parallelepiped is constant, that of another one a square in each coordinate.
    assert solid_volumes(corners[None], whole=False)[0] == pytest.approx(volume, rel=1e-14 + lift * (points == 2))
    assert taken == [points, points - 1]
    edges = (corners[[1, 3, 4]] - corners[0]).T
    expected = abs(np.linalg.det(edges)) * (np.outer(centre, centre) + edges @ edges.T / 12)
    if points == 3:
        assert abs(second - expected).max() > 1e-3 * abs(expected).max()
        finer, expected = by_four_points(corners, rule(4))
        assert volume == pytest.approx(finer, rel=1e-14)
    np.testing.assert_allclose(second, expected, rtol=0, atol=max(lift if points == 2 else 0.0, 1e-14) * 100)
