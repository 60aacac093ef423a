"""Mass and strain energy that input files of solids state, against closed forms."""

from pathlib import Path

import numpy as np
import pytest

from cmsreduce.read import StatedEnergy, StatedMass, deck_statement, read_geometry
from cmsreduce.read.stated import SOLIDS, integrals
from tests.golden.calculix_bodies import STEEL, Deck

SIDES = np.array([1.0, 0.1, 0.15])
MASS = 7850.0 * SIDES.prod()
INERTIA = MASS / 12 * np.diag((SIDES**2).sum() - SIDES**2)


def stated(tmp_path: Path, text: str) -> tuple[StatedMass | None, StatedEnergy | None]:
    path = tmp_path / "bar.inp"
    path.write_text(text)
    nodes = read_geometry(path).nodes
    return deck_statement(path, nodes, np.ones(len(nodes), dtype=bool))


def bar(kind: str = "C3D8") -> str:
    return Deck().solid(kind, (2, 1, 1), SIDES).text()


@pytest.mark.parametrize("kind", [*SOLIDS, "C3D8R", "C3D8I", "C3D20R"])
def test_a_bar_of_solids(tmp_path, kind):
    mass, energy = stated(tmp_path, bar(kind))
    assert mass is not None and energy is not None and energy.exact
    np.testing.assert_allclose(mass.mass, MASS)
    np.testing.assert_allclose(mass.centre, SIDES / 2)
    np.testing.assert_allclose(mass.inertia, INERTIA, atol=1e-9 * MASS)
    np.testing.assert_allclose(mass.nodal.sum(), MASS)
    # V (lambda + 2 G) by stretching, V lambda across, 4 V G by an entry of G off the diagonal.
    G, lame = 2.1e11 / 2.6, 2.1e11 * 0.3 / 1.3 / 0.4
    np.testing.assert_allclose(np.diag(energy.low) / SIDES.prod(), 3 * [lame + 2 * G] + 3 * [4 * G])
    np.testing.assert_allclose(energy.low[0, 1] / SIDES.prod(), lame)


def test_two_materials_and_a_point_mass(tmp_path):
    deck = Deck().solid("C3D8", (2, 1, 1), SIDES)
    deck.keywords = (
        "*ELSET, ELSET=INNER\n1\n*ELSET, ELSET=OUTER\n2\n*MATERIAL, NAME=LIGHT\n*DENSITY\n100.\n"
        "*SOLID SECTION, ELSET=OUTER, MATERIAL=light\n"
        f"*ELEMENT, TYPE=MASS, ELSET=LUMP\n9001, {deck.at(1)[0]}\n*MASS, ELSET=LUMP\n0.7\n"
    )
    # A second section of an element leaves the mass open.
    assert stated(tmp_path, deck.text())[0] is None
    mass, energy = stated(tmp_path, deck.text().replace("ELSET=EC, MATERIAL", "ELSET=INNER, MATERIAL"))
    assert mass is not None and energy is not None
    halves = SIDES.prod() / 2 * np.array([7850.0, 100.0])
    np.testing.assert_allclose(mass.mass, halves.sum() + 0.7)
    np.testing.assert_allclose(mass.centre[0], (halves @ [0.25, 0.75] + 0.7) / mass.mass)
    # Without moduli the second half has an unknown energy.
    assert energy.high is None and energy.uncounted == ("C3D8",)


def test_a_skew_brick_lumps_beside_its_centre(tmp_path):
    text = bar().replace("1, 0.1, 0.15\n", "1.2, 0.1, 0.15\n")
    mass, energy = stated(tmp_path, text)
    assert mass is not None and energy is not None and energy.exact and mass.shift > 1e-4
    whole = integrals(SOLIDS["C3D8"], _corners(text), 2)
    np.testing.assert_allclose(mass.mass, 7850 * whole.volume.sum())
    assert mass.unsure == 0
    # One point of integration gives another mass.
    once = stated(tmp_path, text.replace("TYPE=C3D8", "TYPE=C3D8R"))[0]
    other = 7850 * integrals(SOLIDS["C3D8"], _corners(text), 1).volume.sum()
    assert once is not None and once.mass == mass.mass and 0 < abs(other - mass.mass) < once.unsure < 1e-2 * mass.mass


def _corners(text: str) -> np.ndarray:
    lines = [line for line in text.splitlines() if not line.startswith("*")]
    nodes = {line.split(",")[0]: [float(x) for x in line.split(",")[1:]] for line in lines if line.count(",") == 3}
    cells = [line.replace(" ", "").split(",")[1:] for line in lines if line.count(",") == 8]
    return np.array([[nodes[node] for node in cell] for cell in cells])


@pytest.mark.parametrize(("kind", "known"), [("C3D20", True), ("C3D20R", True), ("C3D20H", False)])
def test_a_curved_element_has_a_mass_and_an_energy_by_a_known_rule(tmp_path, kind, known):
    """A middle node moved into a cube by h takes h/3 of it: the mean of its shape function over the side."""
    deck = Deck().solid("C3D20", (1, 1, 1), (1, 1, 1))
    text = deck.text().replace("0.5, 0, 0\n", "0.5, 0.01, 0\n")
    mass, energy = stated(tmp_path, text.replace("TYPE=C3D20", f"TYPE={kind}"))
    assert mass is not None and (energy is not None and energy.exact) is known
    np.testing.assert_allclose(mass.mass, 7850 * (1 - 0.01 / 3))


def test_one_part_of_an_assembly(tmp_path):
    part = bar().partition("*MATERIAL")[0] + "*SOLID SECTION, ELSET=EC, MATERIAL=STEEL\n"
    instance = (
        f"*PART, NAME=P\n*END PART\n*ASSEMBLY, NAME=A\n*INSTANCE, NAME=P-1, PART=P\n1., 0., 0.\n{part}*END INSTANCE\n"
    )
    text = instance + "*END ASSEMBLY\n" + STEEL
    mass, energy = stated(tmp_path, text)
    assert mass is not None and energy is not None and energy.exact
    np.testing.assert_allclose(mass.centre, SIDES / 2 + [1, 0, 0])
    twice = text.replace("*END ASSEMBLY", "*ELSET, ELSET=EC\n1, 2\n*ELSET, ELSET=ED\n1\n*END ASSEMBLY")
    assert stated(tmp_path, twice + "*SOLID SECTION, ELSET=ED, MATERIAL=STEEL\n")[0] is None


def test_elements_and_nodes_in_other_files_are_those_of_the_deck(tmp_path):
    """Elements in a file of their own were left out, and such a deck proved nothing."""
    whole = bar()
    start = whole.index("*ELEMENT, TYPE=C3D8")
    first, after = whole.index("\n", start) + 1, whole.index("*", start + 1)
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts" / "more.inp").write_text(whole[first:after])
    own = whole[: first - 1] + ", INPUT=parts/more.inp\n" + whole[after:]
    (mass, energy), (same, like) = stated(tmp_path, whole), stated(tmp_path, own)
    assert mass is not None and same is not None and same.mass == mass.mass > 0
    assert energy is not None and like is not None and like.exact == energy.exact


WITHOUT_A_MASS = {
    "no density": bar().replace("*DENSITY\n7850.\n", ""),
    "density by temperature": bar().replace("7850.\n", "7850., 0.\n7800., 500.\n"),
    "no section": bar().replace("ELSET=EC, MATERIAL", "ELSET=NONE, MATERIAL"),
    "a composite": bar().replace("*SOLID SECTION,", "*SOLID SECTION, COMPOSITE,"),
    "shells": Deck().plate("S4", (2, 1), (0, 0, 0), (1, 0, 0), (0, 1, 0)).text(),
    "plane elements": bar().replace(
        "*ELEMENT, TYPE=C3D8", "*ELEMENT, TYPE=CPE4\n99, 1, 2, 3, 4\n*ELEMENT, TYPE=C3D8", 1
    ),
    "mass that is no structure": bar() + "*NONSTRUCTURAL MASS, ELSET=EC, UNITS=TOTAL MASS\n3.\n",
    "a mass without a value": bar() + "*ELEMENT, TYPE=MASS, ELSET=LUMP\n99, 1\n",
    "a number that is none": bar().replace("7850.", "<rho>"),
    "no material": bar().replace(STEEL, ""),
}


@pytest.mark.parametrize("case", WITHOUT_A_MASS)
def test_a_deck_that_does_not_state_its_mass_says_nothing(tmp_path, case):
    assert stated(tmp_path, WITHOUT_A_MASS[case])[0] is None


def test_springs_leave_a_lower_bound_and_preloads_nothing(tmp_path):
    spring = "*ELEMENT, TYPE=SPRINGA, ELSET=TIES\n99, 1, 2\n*SPRING, ELSET=TIES\n\n1.e5\n"
    mass, energy = stated(tmp_path, bar() + spring)
    assert mass is not None and energy is not None and energy.high is None and energy.uncounted == ("*SPRING",)
    mass, energy = stated(
        tmp_path, bar() + "*STEP\n*STATIC\n*END STEP\n*STEP, PERTURBATION\n*FREQUENCY\n1\n*END STEP\n"
    )
    assert mass is not None and energy is None
