"""Stiffness and mass proven against the deck and by themselves; each proof is reported with its state."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from click.testing import CliRunner

from cmsreduce.cli import main
from cmsreduce.config import build_scene, load_pipeline
from cmsreduce.errors import DofMapError
from cmsreduce.linalg.eigen import elastic_pairs, rigid_body_modes
from cmsreduce.model import DofTable, FEModel, Nodes, rigid_body_shapes
from cmsreduce.pipeline.bodies import FlexibleBody, read_flexible
from cmsreduce.pipeline.bodies.free_motions import held_turning, mechanisms
from cmsreduce.pipeline.bodies.mass_proof import negative_mass, prove_mass
from cmsreduce.pipeline.evidence import Evidence
from cmsreduce.read import prove_mass_order, prove_row_order
from cmsreduce.read.nastran.stated import deck_statement
from cmsreduce.verify import free_mass, negative_directions
from tests.frames import BAR, beam_matrices, frame, rotation
from tests.pipeline.bodies.decks import bar_cards, brick_cards, write_deck_body
from tests.read.row_order.test_held_body import held_in_a_plane
from tests.solids import block

CELLS = (6, 2, 3)
BRICK = block("part", [1.5, 0.5, 0.75], CELLS)
XYZ = [[0, 0, 0], [0.5, 0, 0], [1, 0.2, 0], [1.2, 0.7, 0.3], [0.6, 0.9, 0.5], [0.1, 0.5, 0.8], [1.6, 0.3, 0.2]]
BARS = [(1, 2), (2, 3), (3, 4), (4, 5), (5, 6), (6, 1), (3, 7), (4, 7)]
FRAME = frame("part", XYZ, BARS)


def opened(folder: Path, body: FEModel, cards: list[str], keys: str = "") -> FlexibleBody:
    folder.mkdir(exist_ok=True)
    pipeline = load_pipeline(write_deck_body(folder, body, cards, keys))
    return read_flexible(pipeline, "part", build_scene(pipeline))


def proof_of(found: FlexibleBody, what: str):
    return next(proof for proof in found.proofs if proof.what == what)


def permuted(A: sp.csc_array, body: FEModel, to: dict[int, int]) -> sp.csc_array:
    order = np.arange(body.n)
    for here, there in to.items():
        order[body.dofs.node == here] = np.flatnonzero(body.dofs.node == there)
    return A[order][:, order]


@pytest.mark.parametrize(
    ("body", "cards", "digits"),
    [(BRICK, brick_cards(CELLS), 3.0), (FRAME, bar_cards(BARS, XYZ), 3.0)],
    ids=["bricks", "bars"],
)
def test_a_body_that_agrees_with_its_deck(tmp_path: Path, body: FEModel, cards: list[str], digits: float) -> None:
    found = opened(tmp_path, body, cards)
    assert all(check.passed for check in found.checks)
    assert {(proof.what, proof.state) for proof in found.proofs} >= {
        ("row order", "proven"),
        ("stiffness", "proven"),
        ("mass", "proven"),
    }
    assert proof_of(found, "stiffness").digits == pytest.approx(digits)
    assert proof_of(found, "mass").digits == pytest.approx(6.0)
    against = {check.name: check.value for check in found.checks}
    assert against["mass of each node against the deck"] < 1e-9
    if body is BRICK:
        assert against["stiffness against the deck, uniform strain"] < 1e-9


@pytest.mark.parametrize(
    ("body", "cards"), [(BRICK, brick_cards(CELLS)), (FRAME, bar_cards(BARS, XYZ))], ids=["bricks", "bars"]
)
@pytest.mark.parametrize(
    ("factor", "said"),
    [
        (1e3, "GPa against MPa"),
        (1e-3, "MPa against GPa"),
        (1e6, "MPa against Pa"),
        (9.80665, "kilograms force"),
        (175.12684, "N/m against lbf/in"),
        (2.1e11 / 7e10, ""),
    ],
)
def test_a_stiffness_in_other_units_or_of_another_material(
    tmp_path: Path, body: FEModel, cards: list[str], factor: float, said: str
) -> None:
    found = opened(tmp_path, replace(body, K=body.K * factor), cards)
    proof = proof_of(found, "stiffness")
    assert proof.state == "refuted" and said in proof.remark
    assert [check.name for check in found.checks if not check.passed] == ["stiffness against the deck, uniform strain"]


def test_a_held_body_is_compared_under_the_strains_that_its_supports_allow(tmp_path: Path) -> None:
    body = block("part", [1.5, 0.5, 0.75], CELLS, held=range(1, 13))
    fixed = "SPC1,1,123456,1,THRU,12"
    for factor, state in ((1.0, "proven"), (1e3, "refuted")):
        folder = tmp_path / state
        folder.mkdir()
        found = opened(folder, replace(body, K=body.K * factor, grounded=False), [*brick_cards(CELLS), fixed])
        assert proof_of(found, "stiffness").state == state
        assert proof_of(found, "row order").state == "proven"


def test_a_tetrahedron_with_nodes_between_its_corners_and_a_plate(tmp_path: Path) -> None:
    corners = np.array([[0, 0, 0], [2, 0, 0], [0, 3, 0], [0, 0, 4.0]])
    edges = [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)]
    nodes = Nodes.in_basic(range(1, 11), np.vstack([corners, [corners[list(e)].mean(axis=0) for e in edges]]))
    path = tmp_path / "deck.bdf"
    solid = ["CTETRA,1,1,1,2,3,4,5,6", ",7,8,9,10", "PSOLID,1,1", "MAT1,1,10.,,.25"]
    path.write_text("\n".join(["BEGIN BULK", *solid, "ENDDATA"]))
    _, found = deck_statement(path, nodes, np.ones(len(nodes), dtype=bool))
    assert found is not None and found.exact and found.nodes.size == 10
    # V = 4, lambda = 4, G = 4: V (lambda + 2 G) by stretching, 4 V G by an entry of G off the diagonal.
    np.testing.assert_allclose(found.low.diagonal(), [48, 48, 48, 64, 64, 64])
    np.testing.assert_allclose(found.low[0, 1], 16)
    plate = ["CTRIA3,1,1,1,2,3", "PSHELL,1,1,.1,1,,1", "MAT1,1,10.,,.25"]
    path.write_text("\n".join(["BEGIN BULK", *plate, "ENDDATA"]))
    _, found = deck_statement(path, nodes, np.ones(len(nodes), dtype=bool))
    assert found is not None and found.high is not None
    # A t E / (1 - nu^2) along x, 4 A t G by shear in the plane, 5/6 A t G across it.
    np.testing.assert_allclose(found.low.diagonal(), [3.2, 3.2, 0, 4.8, 0, 0], atol=1e-12)
    np.testing.assert_allclose(found.high.diagonal()[4:], 5 / 6 * 3 * 0.1 * 4, rtol=1e-6)


@pytest.mark.parametrize("bent", [0.0, 0.01])
def test_plates_with_nodes_between_corners_have_the_energy_of_plates(tmp_path: Path, bent: float) -> None:
    """Their mass, too. What they give to single nodes depends on the program."""
    corners = np.array([[0, 0, 0], [2, 0, 0], [2, 3, 0], [0, 3, 0.0]])
    around = np.array([corners[[k, (k + 1) % 4]].mean(axis=0) for k in range(4)])
    around[1, 0] += bent
    third = np.array([4.0, 0, 0])
    middle = np.array([(corners[1] + third) / 2, (corners[2] + third) / 2])
    nodes = Nodes.in_basic(range(1, 12), np.vstack([corners, around, third, middle]))
    path = tmp_path / "deck.bdf"
    cards = ["CQUAD8,1,1,1,2,3,4,5,6", ",7,8", "CTRIA6,2,1,2,9,3,10,11,6", "PSHELL,1,1,.1,1,,1", "MAT1,1,10.,,.25,7."]
    path.write_text("\n".join(["BEGIN BULK", *cards, "ENDDATA"]))
    mass, energy = deck_statement(path, nodes, np.ones(len(nodes), dtype=bool))
    assert (energy is None) == (mass is None) == (bent > 0)
    if energy is not None and mass is not None:
        # A t = 0.9: A t E / (1 - nu^2) along x and y, 4 A t G in the plane, 5/6 A t G across it.
        np.testing.assert_allclose(energy.low.diagonal(), [9.6, 9.6, 0, 14.4, 0, 0], atol=1e-12)
        assert energy.high is not None and energy.turning.size == 11 and energy.at_nodes is None
        np.testing.assert_allclose(energy.high.diagonal()[4:], 5 / 6 * 0.9 * 4, rtol=1e-6)
        assert mass.mass == pytest.approx(6.3) and not mass.nodal_known
        np.testing.assert_allclose(mass.centre, [(0.6 * 1 + 0.3 * 8 / 3) / 0.9, (0.6 * 1.5 + 0.3 * 1) / 0.9, 0])


def test_a_short_bar_of_a_stated_shape_is_softer_by_its_shear(tmp_path: Path) -> None:
    # A listing of MSC Nastran 2013 has such bars, and the program gave them 5/6 of their area in shear.
    nodes = Nodes.in_basic([1, 2], np.array([[0, 0, 0], [0.9, 0, 0]]))
    path = tmp_path / "deck.bdf"
    made = ["CBAR,1,1,1,2,0.,0.,1.", "PBARL,1,1,,BAR", ",.5,1.68", "MAT1,1,2.01E9,,.25"]
    path.write_text("\n".join(["BEGIN BULK", *made, "ENDDATA"]))
    _, found = deck_statement(path, nodes, np.ones(len(nodes), dtype=bool))
    assert found is not None and found.high is not None
    area, moments, G = 0.84, (1.68 * 0.5**3 / 12, 0.5 * 1.68**3 / 12), 2.01e9 / 2.5
    bending = [12 * 2.01e9 * moment / 0.9**3 for moment in moments]
    low = 1 / (1 / bending[0] + 0.9 / (5 / 6 * G * area))
    np.testing.assert_allclose(found.low.diagonal()[[3, 5]], low * 0.9**2)
    np.testing.assert_allclose(found.high.diagonal()[[3, 5]], bending[1] * 0.9**2)


STRAIGHT = f"{BAR.A:.6E},{BAR.Iz:.6E},{BAR.Iy:.6E},,{BAR.J:.6E}"


@pytest.mark.parametrize(
    ("more", "label"),
    [
        ([",,,,,,,,", ",0.,0."], "stiffness"),
        # Without the line of points for stresses; then with it at every station, and blank values at the last.
        ([f",NO,.3,{STRAIGHT},", f",NO,1.,{STRAIGHT},", ",0.,0."], "stiffness"),
        ([",0.,1.,2.,3.,4.,5.,6.,7.", f",YES,.5,{STRAIGHT},", ",1.,,,,,,,", ",NO,1.", ",0.,0."], "stiffness"),
        ([",,,,,,,,", f",NO,1.,{2 * BAR.A:.6E}"], "stiffness (stretch alone)"),
        ([",,,,,,,,", f",NO,1.,,{2 * BAR.Iz:.6E}"], "stiffness (stretch alone)"),
        ([",,,,,,,,", ",0.,0.", ",,,,,.01,.01"], "stiffness (stretch alone)"),
    ],
    ids=["plain", "stations", "points", "area", "moment", "neutral axis"],
)
def test_beams_with_stations_are_straight_or_not_counted(tmp_path: Path, more: list[str], label: str) -> None:
    """The last bar of the frame is a beam; K1 and K2 of 0 leave its shear out, as in the matrix."""
    cards = [card.replace("CBAR,8,1,", "CBEAM,8,8,") for card in bar_cards(BARS, XYZ)]
    cards += [f"PBEAM,8,1,{STRAIGHT},", *more]
    proof = proof_of(opened(tmp_path / "one", FRAME, cards), "stiffness")
    assert (proof.state, proof.label) == ("proven", label), proof
    assert ("1 CBAR, CBEAM of another section" in proof.remark) == ("alone" in label)
    # A beam that is not counted leaves the mass unknown, not that of the rest.
    mass = proof_of(opened(tmp_path / "mass", FRAME, cards), "mass")
    assert mass.state == "proven" and ("no deck states its amount" in mass.remark) == ("alone" in label)
    # Its material makes every counted beam four times as stiff.
    steel = [
        *(card.replace("PBEAM,8,1,", "PBEAM,8,2,") for card in cards),
        f"MAT1,2,{4 * BAR.E},{4 * BAR.G},,{BAR.rho}",
    ]
    proof = proof_of(opened(tmp_path / "steel", FRAME, steel), "stiffness")
    assert proof.state == ("proven" if "alone" in label else "refuted")


@pytest.mark.parametrize(
    ("card", "label"),
    [
        ("MATT1,1,5", "stiffness (definiteness alone)"),
        ("MATT1,1,,,,5", "stiffness (uniform strain alone)"),
    ],
)
def test_a_material_that_varies_with_temperature_has_no_modulus(tmp_path: Path, card: str, label: str) -> None:
    """The modulus on its card is one at another temperature; its density is known unless that varies."""
    warm = replace(BRICK, K=0.8 * BRICK.K) if "definiteness" in label else BRICK
    found = opened(tmp_path, warm, [*brick_cards(CELLS), card, "TABLEM1,5,,,,,,,", ",0.,7.+10,100.,5.6+10,ENDT"])
    proof = proof_of(found, "stiffness")
    assert (proof.state, proof.label) == ("proven", label) and not [c for c in found.checks if not c.passed]
    amount = [check for check in found.checks if check.name == "mass against the deck"]
    assert bool(amount) == ("definiteness" in label)


def test_solids_under_stress_by_a_static_subcase(tmp_path: Path) -> None:
    """A stress of 2e-3 of the modulus adds as much to the energy of a strain."""
    cards = [*brick_cards(CELLS), "FORCE,1,7,,9.,1.,0.,0."]
    for factor, state in ((1.002, "proven"), (1.2, "refuted"), (1e3, "refuted")):
        proof = proof_of(opened(tmp_path / str(factor), replace(BRICK, K=factor * BRICK.K), cards), "stiffness")
        assert proof.state == state
        assert state == "refuted" or "to a tenth, as stress by a load may add" in proof.remark


def test_solids_of_another_material_leave_the_others_compared(tmp_path: Path) -> None:
    """The last twelve bricks are of an anisotropic material: no number of the deck has their stiffness here."""
    cards, seen = brick_cards(CELLS), 0
    for k, card in enumerate(cards):
        if card.startswith("CHEXA"):
            seen += 1
            name, number, _, rest = card.split(",", 3)
            cards[k] = f"{name},{number},{1 if seen <= 24 else 2},{rest}"
    cards += ["PSOLID,2,2", "MAT9,2," + ",".join(["7.+10"] * 6)]
    for factor, state in ((1.0, "proven"), (1.01, "refuted"), (1e3, "refuted")):
        proof = proof_of(opened(tmp_path / str(factor), replace(BRICK, K=factor * BRICK.K), cards), "stiffness")
        assert proof.state == state
        assert state == "refuted" or proof.label == "stiffness (some nodes alone)"


def test_a_body_with_elements_whose_nodes_are_unknown_is_proven_from_below(tmp_path: Path) -> None:
    cards = [*brick_cards(CELLS), "CWELD,99,9,1,,PARTPAT", ",1,2", "PWELD,9,1,.01"]
    proof = proof_of(opened(tmp_path, replace(BRICK, K=1e3 * BRICK.K), cards), "stiffness")
    assert (proof.state, proof.label) == ("proven", "stiffness (lower bound alone)")


def test_a_pyramid_has_the_energy_of_its_volume(tmp_path: Path) -> None:
    base = np.array([[0, 0, 0], [2, 0, 0], [2, 3, 0], [0, 3, 0]])
    nodes = Nodes.in_basic(range(1, 6), np.vstack([base, [0.3, 0.2, 2.0]]))
    path = tmp_path / "deck.bdf"
    path.write_text("\n".join(["BEGIN BULK", "CPYRAM,1,1,1,2,3,4,5", "PSOLID,1,1", "MAT1,1,10.,,.25", "ENDDATA"]))
    _, found = deck_statement(path, nodes, np.ones(len(nodes), dtype=bool))
    # V = 4, lambda = 4, G = 4, as of the tetrahedron.
    assert found is not None and found.exact
    np.testing.assert_allclose(found.low.diagonal(), [48, 48, 48, 64, 64, 64])


@pytest.mark.parametrize("kind", ["spring", "bar"])
def test_what_hangs_on_a_rigid_element_does_not_count_as_strained_by_the_deck(tmp_path: Path, kind: str) -> None:
    """Node 8 follows node 1, beside node 7: it does not move as a uniform strain moves its place."""
    away = np.array([0.0, 0.0, 0.05 if kind == "bar" else 0.0])
    at = np.asarray(XYZ[6]) + away
    section = bar_cards([(7, 8)], [*XYZ, at]) if kind == "bar" else []
    rigid = [f"GRID,8,,{at[0]},{at[1]},{at[2]}", "RBE2,90,1,123456,8"]
    more = section[:1] if kind == "bar" else ["CBUSH,50,50,7,8,,,,0", "PBUSH,50,K,1.+8,1.+8,1.+8"]
    more = [line.replace("CBAR,1,", "CBAR,99,") for line in more]
    arm = rigid_body_shapes(DofTable(np.full(6, 8), np.arange(1, 7)), Nodes.in_basic([8], at[None]), np.asarray(XYZ[0]))
    B = np.zeros((12, FRAME.n))
    B[:6, FRAME.dofs.node == 7], B[6:, FRAME.dofs.node == 1] = np.eye(6), arm
    if kind == "bar":
        k = beam_matrices(np.asarray(XYZ[6]), at, BAR)[0]
    else:
        # The grids are at one place, joined along three axes.
        k = 1e8 * np.kron([[1, -1], [-1, 1]], np.diag([1.0, 1, 1, 0, 0, 0]))
    found = opened(
        tmp_path, replace(FRAME, K=FRAME.K + sp.csc_array(B.T @ k @ B)), [*bar_cards(BARS, XYZ), *rigid, *more]
    )
    proof = proof_of(found, "stiffness")
    assert proof.state == "proven", proof
    named = "1 CBAR on points without rows" if kind == "bar" else "CBUSH"
    assert f"only a lower bound is known, because these are not counted: {named}" in proof.remark


def test_lumped_masses_exchanged_between_nodes_are_found_by_the_deck(tmp_path: Path) -> None:
    lumped = np.asarray(BRICK.M.sum(axis=0)).ravel()
    body = replace(BRICK, M=sp.diags_array(lumped, format="csc"))
    assert proof_of(opened(tmp_path, body, brick_cards(CELLS)), "mass").state == "proven"
    wrong = replace(body, M=permuted(body.M, body, {1: 30, 30: 1}))
    proof = proof_of(opened(tmp_path, wrong, brick_cards(CELLS)), "mass")
    assert proof.state == "refuted" and "node 1 has that of node" in proof.remark
    # Without materials nobody can see it: the figures are there to compare.
    proof = proof_of(opened(tmp_path, wrong, []), "mass")
    assert proof.state == "unproven" and "lumped" in proof.remark and "compare mass 1518.75, centre" in proof.remark


def test_a_consistent_mass_in_another_order_stops_the_run(tmp_path: Path) -> None:
    wrong = replace(FRAME, M=permuted(FRAME.M, FRAME, {2: 5, 5: 2}))
    path = write_deck_body(tmp_path, wrong, [])
    found = CliRunner().invoke(main, ["run", str(path), "--quiet"])
    said = " ".join(found.output.split())
    assert found.exit_code == 2 and "the rows labelled node 2 are those of node 5" in said


@pytest.mark.parametrize("tie", ["rigid", "average"])
def test_a_tied_face_hides_no_mass_that_is_larger_along_one_axis(tmp_path: Path, tie: str) -> None:
    """An average tie takes single translations of nodes, which move with the body all the same."""
    keys = f"    interfaces: {{face: {{nodes: {[*range(1, 13)]}, tie: {tie}}}}}\n"
    name, heavier = "mass matrix: the same mass along x, y, z", BRICK.M.diagonal()
    heavier[1:] = 0.0
    for more, passed in ((0.0, True), (0.5, False)):
        body = replace(BRICK, M=sp.csc_array(BRICK.M + more * sp.diags_array(heavier)))
        found = opened(tmp_path, body, [], keys)
        assert {check.name: check.passed for check in found.checks}[name] is passed
        assert proof_of(found, "mass").state == ("proven" if passed else "refuted")


def test_a_condensed_mass_in_another_order_has_no_centre(tmp_path: Path) -> None:
    i = np.flatnonzero(np.isin(FRAME.dofs.node, [2, 5, 7]))
    j = np.setdiff1d(np.arange(FRAME.n), i)
    K, M = FRAME.K.toarray(), FRAME.M.toarray()
    T = np.vstack([np.eye(i.size), -np.linalg.solve(K[np.ix_(j, j)], K[np.ix_(j, i)])])
    order = np.concatenate([i, j])
    K, M = (sp.csc_array(T.T @ A[np.ix_(order, order)] @ T) for A in (K, M))
    K, M = (sp.csc_array((A + A.T) / 2) for A in (K, M))
    small = FEModel("part", K, M, FRAME.dofs[i], FRAME.nodes)
    proof = proof_of(opened(tmp_path, small, []), "mass")
    assert proof.state == "proven" and "an exchange of any two nodes" in proof.remark
    wrong = opened(tmp_path, replace(small, M=permuted(M, small, {2: 7, 7: 2})), [])
    assert proof_of(wrong, "mass").state == "refuted"


SOLID_CELLS = brick_cards(CELLS)[:-1]


@pytest.mark.parametrize(
    ("mass", "stiffness", "cards", "density", "note"),
    [
        (1.0, 1.0, [], "2700 kg/m^3 or more if it is solid", ""),
        (1.0, 1.0, SOLID_CELLS, "2700 kg/m^3 by the volume of its elements", ""),
        (1e-3, 1.0, [], "2.7 kg/m^3 or more if it is solid", "waves of 1.61e+05 m/s"),
        (1e3, 1.0, [], "2.7e+06 kg/m^3 or more if it is solid", "have 2.7e+06 kg/m^3 and waves of 161 m/s"),
        (1.0, 1e-3, [], "2700 kg/m^3 or more if it is solid", "have 2.7e+03 kg/m^3 and waves of 161 m/s"),
        (1e-3, 1e-3, [], "2.7 kg/m^3 or more if it is solid", ""),
        (1e-3, 1e-3, SOLID_CELLS, "2.7 kg/m^3 by the volume of its elements", "have 2.7 kg/m^3 and waves of 5.09e+03"),
    ],
)
def test_the_amount_of_a_mass_without_materials_is_a_figure_to_compare(
    tmp_path: Path, mass: float, stiffness: float, cards: list[str], density: str, note: str
) -> None:
    """Aluminium, in tonnes or grams, or with K in N/mm, beside grids in metres."""
    found = opened(tmp_path, replace(BRICK, M=BRICK.M * mass, K=BRICK.K * stiffness), cards)
    proof = proof_of(found, "mass")
    assert (proof.state, proof.only, proof.label) == ("proven", "order", "mass (order alone)")
    assert proof_of(found, "stiffness").label == "stiffness (definiteness alone)"
    assert f"no deck states its amount, which is not proven: compare {density}, mass {1518.75 * mass:g}" in proof.remark
    said = [each for each in found.notes if "as no material has" in each]
    assert len(said) == bool(note) and all(note in each for each in said)


@pytest.mark.parametrize(("alike", "state", "only"), [(2, "proven", "order of most nodes"), (3, "unproven", "")])
def test_a_few_nodes_that_couple_alike_leave_the_order_of_most(alike: int, state: str, only: str) -> None:
    """As in quadratic meshes, where the middle nodes of an element at a corner are no other element's; of 250 nodes."""
    body = block("part", [0.9, 0.4, 0.4], (9, 4, 4))
    order = prove_mass_order(body)
    assert (order.status, order.nodes) == ("proven", 250)
    few = replace(order, status="alike", alike=alike, remark=f"{order.remark}; {alike} of 250 nodes couple alike")
    evidence = Evidence(prove_row_order(body), few)
    proof = prove_mass(body, body, evidence, 0)[1]
    assert (proof.state, proof.only) == (state, only)
    assert f"{alike} of 250 nodes couple alike; " in proof.remark and "compare mass 388.8" in proof.remark
    assert prove_mass(body, body, evidence, 1)[1].state == "refuted"


def test_lumps_on_a_solid_are_no_density(tmp_path: Path) -> None:
    lump = np.zeros(BRICK.n)
    lump[BRICK.dofs.rows(17, [1, 2, 3])] = 1e5
    found = opened(tmp_path, replace(BRICK, M=sp.csc_array(BRICK.M + sp.diags_array(lump))), SOLID_CELLS)
    assert "compare 3" in proof_of(found, "mass").remark and "kg/m^3 by the volume" in proof_of(found, "mass").remark
    assert not any("as no material has" in each for each in found.notes)
    agreed = proof_of(opened(tmp_path, BRICK, brick_cards(CELLS)), "mass")
    assert agreed.only == "" and "agree with the deck" in agreed.remark


@pytest.mark.parametrize("consistent", [True, False])
def test_a_mass_with_negative_energy_is_refuted(tmp_path: Path, consistent: bool) -> None:
    M = BRICK.M if consistent else sp.diags_array(np.asarray(BRICK.M.sum(axis=0)).ravel(), format="csc")
    rows = BRICK.dofs.rows(17, [1, 2])
    extra = sp.csc_array(([3.0 * M[rows[0], rows[0]]] * 2, (rows, rows[::-1])), shape=M.shape)
    found = opened(tmp_path, replace(BRICK, M=sp.csc_array(M + extra)), [])
    proof = proof_of(found, "mass")
    assert proof.state == "refuted" and "negative energy" in proof.remark


def test_a_tie_hides_no_mass_with_negative_energy(tmp_path: Path) -> None:
    """The node of negative energy is in a face that follows a point: no motion that is left shows it."""
    end = np.flatnonzero(BRICK.nodes.xyz[:, 0] == 1.5)
    at = int(BRICK.nodes.id[end[0]])
    rows = BRICK.dofs.rows(at, [1, 2])
    extra = sp.csc_array(([3.0 * BRICK.M[rows[0], rows[0]]] * 2, (rows, rows[::-1])), shape=BRICK.M.shape)
    tie = f"    interfaces: {{end: {{nodes: {BRICK.nodes.id[end].tolist()}, tie: rigid}}}}\n"
    found = opened(tmp_path, replace(BRICK, M=sp.csc_array(BRICK.M + extra)), [], tie)
    assert np.linalg.eigvalsh(found.body.M.toarray())[0] > 0
    proof = proof_of(found, "mass")
    assert proof.state == "refuted" and "negative energy" in proof.remark


def test_a_planar_body_is_compared_along_its_rows_only(tmp_path: Path) -> None:
    xyz = [[0, 0, 0], [0.5, 0, 0], [1, 0.2, 0], [1.2, 0.7, 0], [0.6, 0.9, 0]]
    whole = frame("part", xyz, [(1, 2), (2, 3), (3, 4), (4, 5), (5, 1)])
    kept = np.flatnonzero(np.isin(whole.dofs.component, [1, 2, 6]))
    body = FEModel("part", whole.K[kept][:, kept], whole.M[kept][:, kept], whole.dofs[kept], whole.nodes)
    path = write_deck_body(tmp_path, body, [])
    text = path.read_text().replace("force: [0, 0, 1]", "force: [0, 1, 0]").replace("[z]", "[y]")
    path.write_text(text)
    pipeline = load_pipeline(path)
    found = read_flexible(pipeline, "part", build_scene(pipeline))
    check = next(check for check in found.checks if "same mass" in check.name)
    assert check.passed and check.value < 1e-12 and check.note == "only x and y move"
    motions = next(proof for proof in found.proofs if proof.what == "rigid motions")
    assert motions.state == "proven" and motions.remark.startswith("3 rigid motions by geometry")
    # Other rows in the mass still show.
    wrong = replace(body, M=permuted(body.M, body, {1: 4, 4: 1}))
    write_deck_body(tmp_path, wrong, [])
    path.write_text(text)
    with pytest.raises(DofMapError):
        read_flexible(pipeline, "part", build_scene(pipeline))


def test_a_body_that_supports_hold_in_a_plane_has_no_note_on_its_turning(tmp_path: Path) -> None:
    """It floats in the plane; supports across it resist rotation out of it, and no spring joins points apart."""
    body = replace(held_in_a_plane(stated=False, ground=False), name="part")
    found = opened(tmp_path, body, [], "    grounded: true\n")
    assert not any("as no support does" in each for each in found.notes)
    assert proof_of(found, "row order").state == "proven"


def test_a_held_node_that_is_not_in_the_geometry_took_some_of_the_mass(tmp_path: Path) -> None:
    """A consistent mass shares some of the mass of its neighbours: a bent cantilever FAILED with 0.3 % more along z."""
    bend = np.array([[x, 0.1 * x * x, 0.02 * x] for x in np.linspace(0, 3, 11)])
    whole = frame("part", bend, [(k, k + 1) for k in range(1, 11)], held=[1])
    body = replace(whole, nodes=Nodes(whole.nodes.id[1:], whole.nodes.xyz[1:], whole.nodes.frame[1:]))
    assert free_mass(body).disorder > 1e-3
    found = opened(tmp_path, body, [], "    grounded: true\n")
    assert all(check.passed for check in found.checks)
    assert proof_of(found, "mass").state == "proven" and proof_of(found, "mass").only == "order"
    wrong = replace(body, M=permuted(body.M, body, {4: 7, 7: 4}))
    with pytest.raises(DofMapError, match="the rows labelled node 4 are those of node 7"):
        opened(tmp_path / "wrong", wrong, [], "    grounded: true\n")
    # Springs to ground of nodes take no mass: masses are compared along all axes.
    free = frame("part", bend, [(k, k + 1) for k in range(1, 11)])
    spring = np.isin(free.dofs.node, [1, 11]) * 1e4
    sprung = replace(free, K=sp.csc_array(free.K + sp.diags_array(spring)))
    found = opened(tmp_path / "sprung", sprung, [], "    grounded: true\n")
    assert any("same mass" in check.name for check in found.checks)


def test_grounded_does_not_hide_shuffled_rows_of_a_free_body(tmp_path: Path) -> None:
    order = np.lexsort((FRAME.dofs.node % 3, FRAME.dofs.component % 4))
    wrong = replace(FRAME, K=FRAME.K[order][:, order], M=FRAME.M[order][:, order])
    with pytest.raises(DofMapError):
        opened(tmp_path, wrong, [], "    grounded: true\n")


def test_trusted_rows_go_on_and_every_other_check_stays(tmp_path: Path) -> None:
    # The order of K and M is one order, but not that of the geometry.
    wrong = replace(FRAME, K=permuted(FRAME.K, FRAME, {2: 5, 5: 2}), M=permuted(FRAME.M, FRAME, {2: 5, 5: 2}))
    with pytest.raises(DofMapError) as refused:
        opened(tmp_path, wrong, [])
    assert "`grounded" not in str(refused.value) and "trusted:" not in str(refused.value)
    path = write_deck_body(tmp_path, wrong, [])
    for rows in ("{file: rows.txt, trusted: true}",):
        path.write_text(path.read_text().replace("{file: rows.txt}", rows))
        pipeline = load_pipeline(path)
        found = read_flexible(pipeline, "part", build_scene(pipeline))
        proof = proof_of(found, "row order")
        assert proof.state == "trusted" and "nodes resist" in proof.remark
        assert proof_of(found, "stiffness").state == "proven"
        assert any("same mass" in check.name for check in found.checks)
    # Trust in the rows is no trust in the order of the mass.
    sp.save_npz(tmp_path / "M.npz", sp.csc_array(FRAME.M))
    with pytest.raises(DofMapError, match="the rows of the mass matrix"):
        read_flexible(pipeline, "part", build_scene(pipeline))


def test_the_word_trusted_alone(tmp_path: Path) -> None:
    from cmsreduce.config.keys.files import RowOrder

    keys = RowOrder.model_validate("trusted")
    assert keys.trusted and keys.file is None and keys.set is None
    assert RowOrder.model_validate({"set": "a", "trusted": True}).trusted
    with pytest.raises(ValueError, match="rows takes one of"):
        RowOrder.model_validate({"trusted": False})


def test_motions_without_energy_beyond_the_rigid_ones_are_a_note(tmp_path: Path) -> None:
    body = frame("part", XYZ, BARS)
    K = body.K.tolil()
    # The outer node turns on its bars as on ball joints: its rotations are condensed out, and left without stiffness.
    turn = np.flatnonzero((body.dofs.node == 7) & (body.dofs.component > 3))
    dense = K.toarray()
    rest = np.setdiff1d(np.arange(body.n), turn)
    pinned = np.zeros_like(dense)
    pinned[np.ix_(rest, rest)] = dense[np.ix_(rest, rest)] - dense[np.ix_(rest, turn)] @ np.linalg.solve(
        dense[np.ix_(turn, turn)], dense[np.ix_(turn, rest)]
    )
    found = opened(tmp_path, replace(body, K=sp.csc_array(pinned)), [])
    (note,) = (each for each in found.notes if "without energy" in each)
    assert note.startswith("part: K leaves 3 motions without energy beyond the 6 rigid ones")
    assert not any("without energy" in each for each in opened(tmp_path, body, []).notes)


@pytest.mark.parametrize("deck", [False, True], ids=["grids", "deck"])
@pytest.mark.parametrize("letters", ["reversed", "sign of rotations", "frame", "exchanged", "askew"])
def test_a_mass_whose_moments_point_away_from_the_neighbours_is_not_proven(
    tmp_path: Path, deck: bool, letters: str
) -> None:
    body = frame("part", [[0.4 * k, 0.1 * k * k, 0] for k in range(4)], [(1, 2), (2, 3), (3, 4)])
    straight = frame("part", [[0.4 * k, 0, 0] for k in range(4)], [(1, 2), (2, 3), (3, 4)])
    turn = sp.kron(sp.eye_array(2 * 4), np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]), format="csc")
    sign = sp.diags_array(np.where(body.dofs.component > 3, -1.0, 1.0), format="csc")
    # Bars at 45 degrees to x and y leave no moment that turns about an axis, and some for each if they are bent.
    askew = frame("part", [[0.4 * k, 0.4 * k, 0] for k in range(4)], [(1, 2), (2, 3), (3, 4)])
    swap = sp.kron(sp.eye_array(4), np.eye(6)[[1, 0, 2, 3, 4, 5]], format="csc")
    body, M = {
        "exchanged": (body, sp.csc_array(swap @ body.M @ swap.T)),
        "askew": (askew, sp.csc_array(swap @ askew.M @ swap.T)),
        "reversed": (straight, permuted(straight.M, straight, {1: 4, 2: 3, 3: 2, 4: 1})),
        "sign of rotations": (straight, sp.csc_array(sign @ straight.M @ sign)),
        "frame": (body, sp.csc_array(turn @ body.M @ turn.T)),
    }[letters]
    assert body.nodes is not None
    cards = bar_cards([(1, 2), (2, 3), (3, 4)], body.nodes.xyz.tolist()) if deck else []
    assert proof_of(opened(tmp_path, body, cards), "mass").state == "proven"
    wrong = proof_of(opened(tmp_path, replace(body, M=M), cards), "mass")
    assert wrong.state in ("unproven", "refuted")
    assert wrong.state == "refuted" or "first moments point" in wrong.remark


def test_a_held_plate_whose_file_has_too_few_digits_is_named():
    """Its bending is softer than the last digit of the stretch through its thickness: it passed for a rigid motion."""
    made = block("plate", (1.0, 0.2, 0.0005), (12, 2, 1), held=range(1, 7))
    K = made.K.copy()
    K.data = np.array([float(f"{x:.8e}") for x in K.data])
    coarse = replace(made, K=sp.csc_array((K + K.T) / 2), rounding=5e-10, grounded=False)
    rigid = rigid_body_modes(coarse.K, coarse.M, rigid_body_shapes(made.dofs, made.nodes), 5e-10, "plate")
    assert 0 < rigid.shape[1] <= 6
    (note,) = mechanisms(coarse, rigid)
    assert note.startswith(f"plate: K leaves {rigid.shape[1]} motions without energy that are no rigid motions")
    assert "too few digits" in note
    assert mechanisms(made, np.zeros((made.n, 0))) == []


@pytest.mark.parametrize("kept", [[1, 2, 6], [1, 2, 3, 4, 5, 6], [1, 3, 5]])
@pytest.mark.parametrize("turned", [False, True])
def test_a_spring_between_points_apart_is_named_as_what_keeps_a_body_from_turning(kept: list[int], turned: bool):
    """In space, and in the plane of a body without rows across it, whose axes may be turned."""
    draw = np.random.default_rng(5)
    xyz = np.zeros((12, 3))
    xyz[:, [0, 2 if 3 in kept else 1]] = [(i % 4, i // 4) + 0.1 * draw.random(2) for i in range(12)]
    bars = [(i, i + 1) for i in range(1, 12) if i % 4] + [(i, i + 4) for i in range(1, 9)]
    bars += [(i, i + 5) for i in range(1, 8) if i % 4]
    whole = frame("flat", xyz, bars)
    rows = np.flatnonzero(np.isin(whole.dofs.component, kept))
    body = replace(whole, K=whole.K[rows][:, rows], M=whole.M[rows][:, rows], dofs=whole.dofs[rows], grounded=True)
    across = body.dofs.rows([1, 11], [2 if 2 in kept else 3] * 2)
    K = body.K.tolil()
    K[np.ix_(across, across)] += K[across[0], across[0]] * np.array([[1, -1], [-1, 1]])
    assert body.nodes is not None
    if turned:
        Q = rotation([1.0, 2.0, -0.5], 0.7)
        body = replace(body, nodes=Nodes(body.nodes.id, body.nodes.xyz @ Q.T, body.nodes.frame @ Q.T))
    for A in (body.K, sp.csc_array(K)):
        rigid = la.null_space(A.toarray(), rcond=1e-9)
        rigid = rigid @ np.linalg.inv(np.linalg.cholesky(rigid.T @ (body.M @ rigid)).T)
        notes = held_turning(replace(body, K=A), rigid)
        assert bool(notes) == (A is not body.K)
    assert "joins points that do not coincide" in notes[0]


def test_supports_across_a_plane_keep_a_body_in_space_from_turning_without_a_note():
    body = held_in_a_plane(stated=True, ground=False)
    rigid = rigid_body_modes(body.K, body.M, rigid_body_shapes(body.dofs, body.nodes), 2.0**-53, "flat")
    assert rigid.shape[1] == 3 and held_turning(body, rigid) == []


@pytest.mark.parametrize(("digits", "seed"), [(6, 2), (8, 9)])
def test_rods_that_turn_about_one_axis_have_no_negative_mass_in_few_digits(digits: int, seed: int) -> None:
    """Inertia about one skew axis has two eigenvalues of zero, which rounding makes negative."""
    axes = np.random.default_rng(seed).standard_normal((len(XYZ), 3))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    M = np.kron(np.eye(len(XYZ)), np.diag([2.0, 2.0, 2.0, 0.0, 0.0, 0.0]))
    for k, axis in enumerate(axes):
        M[6 * k + 3 : 6 * k + 6, 6 * k + 3 : 6 * k + 6] = 0.01 * np.outer(axis, axis)
    printed = sp.csc_array([[float(f"{value:.{digits - 1}e}") for value in row] for row in M])
    rods = replace(FRAME, M=printed, rounding=0.5 * 10.0**-digits)
    assert negative_mass(rods) == negative_directions(printed, rods.rounding) == 0
    assert elastic_pairs(rods.K.toarray() + np.eye(rods.n), printed.toarray(), np.empty((rods.n, 0)), rods.rounding)
    wrong = printed - sp.csc_array(([1e-6], ([3], [3])), shape=printed.shape)
    assert negative_mass(replace(rods, M=wrong)) == 1
