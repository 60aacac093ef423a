"""Bodies of CalculiX go from its files to a run; their frequencies are those that CalculiX prints."""

import json
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from click.testing import CliRunner

from cmsreduce.cli import main
from cmsreduce.config import load_pipeline
from cmsreduce.errors import CmsReduceError
from cmsreduce.linalg.eigen import rigid_body_modes
from cmsreduce.mechanics import Tie, places_by_stiffness, tie_nodes
from cmsreduce.model import FEModel, Proof, rigid_body_shapes
from cmsreduce.orthogonalise import ORTHOGONAL, orthogonality_errors
from cmsreduce.pipeline import Run, Silent
from cmsreduce.pipeline.drafts import draft_body
from cmsreduce.pipeline.evidence import mass_order_by_deck, nodes_times_deck
from cmsreduce.pipeline.evidence.deck_agreement import energy_ratios, statement_of
from cmsreduce.pipeline.evidence.nodal_stiffness import nodes_against_deck
from cmsreduce.read import (
    InterfaceSpec,
    MatrixSource,
    deck_statement,
    prove_row_order,
    read_body,
    read_geometry,
)
from tests.golden.calculix_bodies import BODIES, STEEL, Deck, arc, body, solve, stiffened
from tests.pipeline.proofs import proofs_of

pytestmark = pytest.mark.ccx

# Most motions of free C3D8R have no mass, and CalculiX prints zeros for all of them.
FREE = [name for name in BODIES if name != "C3D8R"]
# Free ones alone show the order of their nodes.
HELD = [name for name in BODIES if name not in ("C3D6", "C3D15", "S3", "S6", "pipe B32R", "box B32R", "turned axes")]
# Zero frequencies, free and held: the shell of the mixed body turns about the edge of the solid.
MOTIONS = {"mixed": (8, 2)}
AT_ZERO = 0.01  # Hz


def read(folder: Path, geometry: str = "bar.inp", **named):
    sources = {"stiffness": MatrixSource(folder / "bar.sti"), "mass": MatrixSource(folder / "bar.mas")}
    return read_body("bar", geometry=folder / geometry, **sources, **named)


def solved(folder: Path, text: str) -> np.ndarray:
    """Matrices of a body in files `bar`, a result in `whole`; its frequencies in Hz."""
    solve(folder, "bar", text, matrices=True)
    return np.array(solve(folder, "whole", text, matrices=False))


def frequencies(found) -> np.ndarray:
    """Elastic frequencies in Hz; motions without mass have none."""
    K, M = found.K.toarray(), found.M.toarray()
    shift = 1e-4 * K.diagonal().sum() / M.diagonal().sum()
    inverse = la.eigh(M, K + shift * M, eigvals_only=True)[::-1]
    hertz = np.sqrt(np.maximum(1 / inverse[inverse > 1e-9 * inverse[0]] - shift, 0)) / (2 * np.pi)
    return hertz[hertz > 10 * AT_ZERO]


def mass_proof(found: FEModel, deck: Path, factor: float) -> Proof:
    """Proof of the mass times a factor beside a deck."""
    return proofs_of(replace(found, M=sp.csc_array(found.M * factor)), deck)["mass"]


@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize("name", ["C3D4", "C3D8I", "C3D8R", "C3D10", "C3D6", "C3D15", "C3D20R"])
def test_the_deck_states_the_mass_of_its_solids(tmp_path, name, held):
    solve(tmp_path, "bar", body(name, held), matrices=True)
    found = read(tmp_path)
    right, stiff = mass_proof(found, tmp_path / "bar.inp", 1.0), statement_of(tmp_path / "bar.inp", found)[1]
    assert right.state == "proven" and "agree with the deck" in right.remark if not held else right.state != "refuted"
    for factor, words in ((0.5, "0.5 times that of the deck"), (1e3, "metres against millimetres")):
        wrong = mass_proof(found, tmp_path / "bar.inp", factor)
        assert wrong.state == "refuted" and words in wrong.remark
    assert stiff is not None
    np.testing.assert_allclose(energy_ratios(found, stiff), 1, rtol=1e-6)


@pytest.mark.parametrize("kind", ["C3D4", "C3D6", "C3D8R", "C3D10", "C3D15", "C3D20R"])
def test_solids_beside_supports(tmp_path, kind):
    """Forces of supports on nodes of wedges of second order cancel; elements with another density are found."""
    deck = Deck().solid(kind, (4, 2, 2), (1, 0.1, 0.15))
    deck.nset("ROOT", root := deck.at(0))
    deck.keywords += "*BOUNDARY\nROOT, 1, 3\n"
    solve(tmp_path, "bar", deck.text(), matrices=True)
    found = read(tmp_path)
    stiff, right = (proofs_of(found, tmp_path / "bar.inp")[name] for name in ("stiffness", "mass"))
    assert stiff.state == "proven" and f"at {len(deck.nodes) - len(root)} of" in stiff.remark
    assert right.state != "refuted"
    beside = [k + 1 for k, (_, nodes) in enumerate(deck.elements) if set(nodes) & set(root)]
    lead = STEEL.replace("STEEL", "LEAD").replace("7850", "8240") + "*SOLID SECTION, ELSET=HEAVY, MATERIAL=LEAD\n"
    heavy = "*ELSET, ELSET=HEAVY\n" + "".join(f"{k},\n" for k in beside[:2]) + lead
    solve(tmp_path, "other", deck.text() + heavy, matrices=True)
    for kind_of in ("mas", "dof"):
        (tmp_path / f"other.{kind_of}").replace(tmp_path / f"bar.{kind_of}")
    wrong = proofs_of(read(tmp_path), tmp_path / "bar.inp")["mass"]
    assert wrong.state == "refuted" and "times that of the deck" in wrong.remark


@pytest.mark.parametrize(("kind", "ends", "heavy"), [("C3D15", 2, False), ("C3D6", 1, True), ("C3D20R", 1, True)])
def test_sound_masses_beside_supports(tmp_path, kind, ends, heavy):
    """Away from both ends of three wedges all nodes have one share, and the others another; so has a point mass."""
    deck = Deck().solid(kind, (2, 2, 3), (0.1, 0.15, 0.6))
    held = (0.0, 0.6)[:ends]
    deck.nset("ROOT", [n for key, n in deck.nodes.items() if key[3] in held])
    deck.keywords += "*BOUNDARY\nROOT, 1, 3\n"
    if heavy:
        at = deck.node((0.1, 0.15, 0.2 if kind == "C3D6" else 0.1))
        deck.keywords += f"*ELEMENT, TYPE=MASS, ELSET=LUMP\n9001, {at}\n*MASS, ELSET=LUMP\n5.\n"
    solve(tmp_path, "bar", deck.text(), matrices=True)
    found = read(tmp_path)
    right, wrong = (mass_proof(found, tmp_path / "bar.inp", factor) for factor in (1.0, 1.1))
    assert right.state != "refuted" and wrong.state == "refuted"


@pytest.mark.parametrize("name", ["turned axes", "rigid", "rigid C3D8I", "equation", "tie"])
def test_the_deck_states_the_mass_of_solids_on_constraints(tmp_path, name):
    solve(tmp_path, "bar", body(name, held=False), matrices=True)
    found = read(tmp_path)
    assert mass_proof(found, tmp_path / "bar.inp", 1.0).state != "refuted"
    assert "0.5 times that of the deck" in mass_proof(found, tmp_path / "bar.inp", 0.5).remark


@pytest.mark.parametrize("kind", ["C3D10", "C3D15", "C3D20", "C3D20R"])
def test_the_deck_states_solids_with_curved_edges(tmp_path, kind):
    """By the points at which CalculiX integrates them: mass, energy, and the forces of each node."""
    deck = Deck().solid(kind, (3, 2, 2), (0.4, 0.1, 0.15))
    # A parabola through three nodes is no line.
    deck.nodes = {(k, x, y + x * x, z + 2 * x * y): n for (k, x, y, z), n in deck.nodes.items()}
    solve(tmp_path, "bar", deck.text(), matrices=True)
    found = read(tmp_path)
    energy = statement_of(tmp_path / "bar.inp", found)[1]
    assert energy is not None and energy.exact and not energy.uncounted and energy.at_nodes is not None
    np.testing.assert_allclose(energy_ratios(found, energy), 1, rtol=1e-9)
    local = nodes_against_deck(found, energy.at_nodes)
    assert local is not None and local.check.passed and local.compared == local.nodes == len(deck.nodes)
    local = nodes_against_deck(replace(found, K=sp.csc_array(1.02 * found.K)), energy.at_nodes)
    assert local is not None and not local.check.passed and "1.02 times" in local.check.note
    assert mass_proof(found, tmp_path / "bar.inp", 1.0).state == "proven"
    assert "0.5 times that of the deck" in mass_proof(found, tmp_path / "bar.inp", 0.5).remark


@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize("kind", ["C3D10", "C3D15"])
def test_masses_of_solids_with_curved_edges_follow_the_rule_of_the_program(tmp_path, kind, held):
    """CalculiX integrates N rho dV by the points of its stiffness; the exact integral differs at curved edges."""
    deck = Deck().solid(kind, (4, 2, 2), (1, 0.4, 0.15))
    if held:
        deck.nset("ROOT", deck.at(0))
        deck.keywords += "*BOUNDARY\nROOT, 1, 3\n"
    deck.nodes = {(k, x + y * y / 5, y + 0.3 * x * x, z + x * y / 5): n for (k, x, y, z), n in deck.nodes.items()}
    solve(tmp_path, "bar", deck.text(), matrices=True)
    found = read(tmp_path)
    stated = deck_statement(tmp_path / "bar.inp", found.nodes, np.ones(len(found.nodes), dtype=bool))[0]
    assert stated is not None and stated.by_rule is not None
    assert abs(stated.by_rule / stated.nodal - 1).max() > 1e-3
    # Mass of the node farthest from the supports, 2 % more.
    far = found.nodes.id[found.nodes.xyz[:, 0].argmax()]
    more = sp.diags_array(np.where(found.dofs.node == far, np.sqrt(1.02), 1.0))
    for M, limits in ((found.M, (0, 1e-9)), (sp.csc_array(more @ found.M @ more), (5e-3, 1))):
        other = replace(found, M=M)
        mass = statement_of(tmp_path / "bar.inp", other)[0]
        check = nodes_times_deck(other, mass) if held else mass_order_by_deck(other, mass.nodal, True)
        # Without an exchange that explains it, a difference leaves a free body unproven.
        assert (check is None and not held and M is not found.M) or limits[0] <= check.value < limits[1]


SHELLS = ("S3", "S4", "S6", "S8R")


@pytest.mark.parametrize("name", SHELLS)
def test_the_deck_states_shells_as_the_solids_that_they_became(tmp_path, name):
    solve(tmp_path, "bar", body(name, held=False), matrices=True)
    found = read(tmp_path)
    mass, energy = statement_of(tmp_path / "bar.inp", found)
    assert mass is not None and energy is not None and energy.exact and energy.at_nodes is not None
    assert mass.mass == pytest.approx(7850 * 0.4 * 0.01, rel=1e-12)
    np.testing.assert_allclose(energy_ratios(found, energy), 1, rtol=1e-5)
    assert mass_proof(found, tmp_path / "bar.inp", 1.0).state != "refuted"
    assert "1.02 times that of the deck" in mass_proof(found, tmp_path / "bar.inp", 1.02).remark
    local = nodes_against_deck(found, energy.at_nodes)
    assert local is not None and local.check.passed and local.compared == local.nodes
    stiffer = replace(found, K=sp.csc_array(1.02 * found.K))
    local = nodes_against_deck(stiffer, energy.at_nodes)
    assert local is not None and not local.check.passed and "1.02 times" in local.check.note


def test_shells_that_nothing_expanded_are_not_counted(tmp_path):
    solve(tmp_path, "bar", body("S4", held=False), matrices=True)
    found = read(tmp_path)
    (tmp_path / "bar.12d").unlink()
    assert statement_of(tmp_path / "bar.inp", found) == (None, None)


@pytest.mark.parametrize("name", [name for name in BODIES if name[0] in "Bbmp"])
def test_a_deck_of_beams_says_nothing(tmp_path, name):
    solve(tmp_path, "bar", body(name, held=False), matrices=True)
    assert statement_of(tmp_path / "bar.inp", read(tmp_path)) == (None, None)


def digits(name: str) -> float:
    """CalculiX prints seven digits; those of a thin shell of bricks are five, because its stiffness cancels."""
    return 5e-6 if "S" in name else 1e-6


@pytest.mark.parametrize(("name", "held"), [(name, False) for name in FREE] + [(name, True) for name in HELD])
def test_frequencies(tmp_path, name, held):
    hertz = solved(tmp_path, body(name, held))
    elastic = hertz[hertz > AT_ZERO]
    assert hertz.size - elastic.size == MOTIONS.get(name, (6, 0))[held]
    draft = draft_body("bar", [tmp_path / file for file in ("bar.sti", "bar.mas", "bar.inp")])
    assert (draft.remark, draft.grounded) == ("", False)
    np.testing.assert_allclose(draft.elastic_hz, elastic[0], rtol=digits(name))
    found = read(tmp_path)
    assert held or prove_row_order(found).status == "proven"
    np.testing.assert_allclose(frequencies(found)[:4], elastic[:4], rtol=digits(name))


def test_a_free_body_of_reduced_integration_has_six_rigid_motions(tmp_path):
    """One point an element leaves most motions without mass; CalculiX holds hourglasses by stiffness."""
    solve(tmp_path, "bar", body("C3D8R", held=False), matrices=True)
    found = read(tmp_path)
    assert prove_row_order(found).status == "proven"
    R = rigid_body_shapes(found.dofs, found.nodes)
    rigid = rigid_body_modes(found.K, found.M, R, found.stiffness_rounding, "bar")
    stiffness, mass = (la.eigvalsh(A.toarray()) for A in (found.K, found.M))
    assert rigid.shape[1] == 6 == (stiffness < 1e-9 * stiffness[-1]).sum() < (mass < 1e-9 * mass[-1]).sum()


@pytest.mark.parametrize("name", ["S8R", "folded S8R", "B31", "bent B32R", "mixed", "C3D8I", "tie"])
def test_result_file_as_geometry(tmp_path, name):
    """The .frd has the nodes that shells and beams became at the same places as the input file."""
    hertz = solved(tmp_path, body(name, held=False))
    found, other = read(tmp_path), read(tmp_path, "whole.frd")
    at = found.nodes.index(np.intersect1d(found.dofs.node[found.dofs.component > 0], other.nodes.id))
    there = other.nodes.index(found.nodes.id[at])
    np.testing.assert_allclose(found.nodes.xyz[at], other.nodes.xyz[there], atol=2 * other.nodes.xyz_rounding)
    assert prove_row_order(other).status == "proven"
    np.testing.assert_allclose(frequencies(other)[:3], hertz[hertz > AT_ZERO][:3], rtol=digits(name))


@pytest.mark.parametrize("geometry", ["bar.inp", "whole.frd"])
@pytest.mark.parametrize("name", ["C3D8I", "S8R", "B31"])
def test_tie_leaves_six_rigid_modes(tmp_path, name, geometry):
    """A node of a shell stands for the nodes that it became. A result file has coordinates of six digits."""
    deck = BODIES[name]()
    tip = [n for n in deck.nodes.values() if n in deck.at(0)]
    deck.nset("Hub", tip)
    solved(tmp_path, deck.text())
    spec = InterfaceSpec(set="hub") if geometry == "bar.inp" else InterfaceSpec(nodes=tuple(tip))
    found = tie_nodes(places_by_stiffness(read(tmp_path, geometry, interfaces={"hub": spec})), "hub", Tie("rigid"))
    shapes = rigid_body_shapes(found.dofs, found.nodes)
    assert rigid_body_modes(found.K, found.M, shapes, found.stiffness_rounding, "bar").shape[1] == 6


@pytest.mark.parametrize(("name", "held"), [("S4", True), ("rigid C3D8I", False)])
def test_from_new_to_run(tmp_path, monkeypatch, name, held):
    hertz = solved(tmp_path, body(name, held))
    monkeypatch.chdir(tmp_path)
    for command in (["new", "bar1", *(f"bar.{end}" for end in ("sti", "mas", "dof", "inp"))], ["run", "bar1.yaml"]):
        done = CliRunner().invoke(main, command)
        assert done.exit_code == 0, done.output
    found = json.loads((tmp_path / "build/bar1/summary.json").read_text())["components"]["bar1"]["frequencies_hz"]
    found = np.array(found)[np.array(found) > AT_ZERO]
    np.testing.assert_allclose(found[:2], hertz[hertz > AT_ZERO][:2], rtol=digits(name))


def test_motions_without_stiffness_of_little_mass_leave_orthogonal_modes(tmp_path, monkeypatch):
    """A thin shell turns about the edge of the solid, and the beam about its own axis: eight motions."""
    monkeypatch.chdir(tmp_path)
    solved(tmp_path, body("mixed", held=False).replace("\n0.01\n", "\n0.001\n"))
    assert CliRunner().invoke(main, ["new", "bar1", "bar.sti", "bar.mas", "bar.inp"]).exit_code == 0
    run = Run(load_pipeline(tmp_path / "bar1.yaml"), tmp_path / "out", Silent())
    modes = run.modal("bar1")
    assert modes.rigid_count == 8
    assert max(orthogonality_errors(modes)) < ORTHOGONAL


def test_new_proposes_a_set_of_a_shell_or_else_the_middle_of_its_thickness(tmp_path):
    deck = BODIES["S8R"]()
    solve(tmp_path, "bar", deck.text(), matrices=True)
    files = [tmp_path / f"bar.{end}" for end in ("sti", "mas", "inp")]
    ((_, mount, words),) = draft_body("bar", files).interfaces
    assert (mount, words) == ("{node: 39}", "node 39, at [0, 0, 0], one of 3 that node 1 of the deck became")
    deck.nset("HUB", deck.at(0))
    (tmp_path / "bar.inp").write_text(deck.text())
    draft = draft_body("bar", files)
    assert draft.interfaces[0][1:] == ("{set: HUB, tie: rigid}", "set, 5 nodes")
    assert "cmsreduce new bar2" in (said := draft_body("bar", files[:2]).remark) and said.endswith("bar.inp")


def test_held_body_by_its_mesh_alone(tmp_path):
    """A result file has no supports: the draft says that the ground holds the body."""
    hertz = solved(tmp_path, body("C3D20R", held=True))
    draft = draft_body("bar", [tmp_path / file for file in ("bar.sti", "bar.mas", "whole.frd")])
    assert (draft.remark, draft.grounded) == ("", True)
    np.testing.assert_allclose(draft.elastic_hz, hertz[0], rtol=1e-6)


def test_expansion_of_an_earlier_job(tmp_path):
    """CalculiX leaves the .12d of shells in the folder of a later job without any."""
    solved(tmp_path, body("S8R", held=False))
    alone = tmp_path / "alone"
    alone.mkdir()
    hertz = solved(alone, body("C3D8I", held=False))
    shutil.copy(alone / "bar.inp", tmp_path)
    subprocess.run(["ccx", "bar"], cwd=tmp_path, capture_output=True, timeout=120, check=False)
    assert (tmp_path / "bar.12d").stat().st_size
    np.testing.assert_allclose(frequencies(read(tmp_path))[:4], hertz[6:10], rtol=1e-6)


def skewed(held: bool) -> str:
    """Two materials of C3D8R whose opposite faces are not parallel."""
    deck = Deck().solid("C3D8R", (6, 2, 2), (1, 0.8, 0.6))
    shift = np.random.default_rng(1).uniform(-0.02, 0.02, (len(deck.nodes), 3))
    deck.nodes = {
        (key[0], *(np.array(key[1:]) + by * (key[1] > 0))): n
        for (key, n), by in zip(deck.nodes.items(), shift, strict=True)
    }
    if held:
        deck.nset("ROOT", deck.at(0))
        deck.keywords += "*BOUNDARY\nROOT, 1, 3\n"
    soft = STEEL.replace("STEEL", "SOFT").replace("2.1e11", "0.7e11")
    two = "*ELSET, ELSET=LEFT, GENERATE\n1, 12\n*ELSET, ELSET=RIGHT, GENERATE\n13, 24\n" + soft
    section = "*SOLID SECTION, ELSET={}, MATERIAL={}\n"
    return deck.text().replace(
        section.format("EC", "STEEL"), two + section.format("LEFT", "STEEL") + section.format("RIGHT", "SOFT")
    )


@pytest.mark.parametrize("held", [False, True])
def test_hourglass_stiffness_that_resists_rotation_is_named(tmp_path, held):
    """The order of its rows is right; of one with two nodes exchanged something else is said."""
    solve(tmp_path, "bar", skewed(held), matrices=True)
    with pytest.raises(CmsReduceError, match=r"the 24 C3D8R of .*bar\.inp make these forces.* with C3D8I or C3D8"):
        read(tmp_path)
    (tmp_path / "bar.inp").write_text(skewed(held).replace("C3D8R", "C3D8"))
    with pytest.raises(CmsReduceError, match="not proven") as without:
        read(tmp_path)
    assert "C3D8" not in str(without.value)
    solve(tmp_path, "bar", skewed(held), matrices=True)
    listed = (tmp_path / "bar.dof").read_text().split()
    first, other = listed[30].split(".")[0], listed[60].split(".")[0]
    new = {first: other, other: first}
    lines = (".".join((new.get(node, node), dof)) for node, dof in (line.split(".") for line in listed))
    (tmp_path / "bar.dof").write_text("\n".join(lines) + "\n")
    with pytest.raises(CmsReduceError, match="rows are shuffled among nodes"):
        read(tmp_path)


def bent_out_of_plane(kind: str) -> str:
    """A shell that is no plane, or a beam along an arc: opposite faces of their solids are not parallel."""
    if kind.startswith("B"):
        return Deck().beam(kind, 6, arc).text()
    deck = Deck().plate(kind, (4, 3), (0, 0, 0), (1, 0, 0), (0, 0.6, 0))
    deck.nodes = {(layer, x, y, 0.1 * x * y): n for (layer, x, y, _), n in deck.nodes.items()}
    return deck.text()


@pytest.mark.parametrize(("kind", "other"), [("S4R", "S4"), ("S4R", "S8R"), ("B31R", "B32R")])
def test_hourglass_stiffness_of_shells_and_beams_is_named(tmp_path, kind, other):
    """CalculiX solves elements of one point as C3D8R. The elements that the message proposes have no such forces."""
    solve(tmp_path, "bar", bent_out_of_plane(kind), matrices=True)
    with pytest.raises(CmsReduceError, match=rf"the \d+ {kind} of .* \(CalculiX makes C3D8R of them\).*with .*{other}"):
        read(tmp_path)
    solve(tmp_path, "bar", bent_out_of_plane(other), matrices=True)
    assert prove_row_order(read(tmp_path)).motions == 6


@pytest.mark.parametrize(("cells", "warp", "offset"), [((2, 2), 0.281, 0.117), ((2, 3), 0.22, -0.5)])
def test_hourglass_stiffness_between_knots_is_named(tmp_path, cells, warp, offset):
    """A shell so warped that CalculiX joins its solids by a knot at every node, which brings forces to others."""
    deck = Deck().plate("S4R", cells, (0, 0, 0), (1, 0, 0), (0, 0.4, 0))
    deck.nodes = {(k, x, y, warp * (x * y + np.sin(3 * x) / 2)): n for (k, x, y, _), n in deck.nodes.items()}
    text = deck.text().replace("*SHELL SECTION,", f"*SHELL SECTION, OFFSET={offset},")
    solve(tmp_path, "bar", text, matrices=True)
    with pytest.raises(CmsReduceError, match=r"\d S4R .* probably make these forces.*again with S8R or S4 in"):
        read(tmp_path)


@pytest.mark.parametrize("bound", ["mass", "rigid"])
def test_hourglass_stiffness_beside_constraints_is_named(tmp_path, bound):
    """A mass on a shell, or a rigid edge, brings forces of the elements to further rows; shuffled rows are none."""
    text, tip = bent_out_of_plane("S4R"), Deck().plate("S4R", (4, 3), (0, 0, 0), (1, 0, 0), (0, 0.6, 0)).at(1)
    if bound == "mass":
        text += f"*ELEMENT, TYPE=MASS, ELSET=LUMP\n9001, {tip[1]}\n*MASS, ELSET=LUMP\n0.7\n"
    else:
        text = text.replace("*ELEMENT", "900, 1.2, 0.3, 0.\n*ELEMENT", 1)
        text += "*NSET, NSET=TIP\n" + "".join(f"{n},\n" for n in tip) + "*RIGID BODY, NSET=TIP, REF NODE=900\n"
    solve(tmp_path, "bar", text, matrices=True)
    with pytest.raises(CmsReduceError, match=r"the 12 S4R of .* make these forces.*with S8R or S4") as named:
        read(tmp_path)
    assert "geometry must be the .inp" not in str(named.value)
    listed = (tmp_path / "bar.dof").read_text().split()
    # Rows of two nodes inside, each of two nodes of a solid.
    first, other = sorted({label.split(".")[0] for label in listed}, key=int)[:2]
    new = {first: other, other: first}
    lines = (".".join((new.get(node, node), dof)) for node, dof in (line.split(".") for line in listed))
    (tmp_path / "bar.dof").write_text("\n".join(lines) + "\n")
    with pytest.raises(CmsReduceError, match="not proven") as shuffled:
        read(tmp_path)
    assert "S4R" not in str(shuffled.value)


POINTS = """\
name: bar1
output: out
components:
  bar:
    stiffness: {file: bar.sti}
    mass: {file: bar.mas}
    geometry: {file: bar.inp}
    interfaces: {}
    damping: {modal: 0.01}
scene:
  band: 20 Hz
  actuators: {push: {at: bar.1, force: [0, 0, 1]}}
  sensors: {seen: {at: bar.1, measure: z}}
reduce: {method: craig-bampton, cutoff: 2}
"""


@pytest.mark.parametrize(
    ("name", "node", "advice"),
    [
        ("S8R", 23, r"made nodes 104, 105, 106 of node 23 .*: write '(bar\.105)', the one in their middle"),
        ("S8R", 24, r"made nodes 107, 109 of node 24 .*: write `(rows: {bar\.107\.z: 0\.5, bar\.109\.z: 0\.5})`"),
        (
            "B32R",
            8,
            r"made nodes 68, 69, 70, 71 .* an interface of bar, `(n8: {node: 8, tie: average})`",
        ),
    ],
)
def test_a_point_of_a_shell_or_beam_is_refused_with_what_to_write(tmp_path, name, node, advice):
    """The pipeline runs with it, and the points lie where CalculiX says that the node moves under a static force."""
    solve(tmp_path, "bar", body(name, held=True), matrices=True)
    text = POINTS.replace("bar.1,", f"bar.{node},")
    (tmp_path / "p.yaml").write_text(text)
    with pytest.raises(CmsReduceError) as refused:
        opened = Run(load_pipeline(tmp_path / "p.yaml"), tmp_path / "out", Silent())
        _ = opened.bodies
    (words,) = re.search(advice, str(refused.value)).groups()
    (made,) = re.search(r"made nodes (\d+)", str(refused.value)).groups()
    own = f"interfaces: {{}}\n    reduce: {{residuals: ['{node}.z']}}"
    load = text.replace(f"bar.{node},", f"bar.{made},").replace("interfaces: {}", own)
    (tmp_path / "p.yaml").write_text(load)
    with pytest.raises(CmsReduceError, match=rf"of node {node} .*: (write 'bar\.105'|name one of them)"):
        _ = Run(load_pipeline(tmp_path / "p.yaml"), tmp_path / "out", Silent()).bodies
    if words.startswith("n8"):
        text = text.replace("{}", f"{{{words}}}").replace("bar.8", "bar.n8")
    elif words.startswith("rows"):
        text = text.replace("at: bar.24, force: [0, 0, 1]", words).replace("at: bar.24, measure: z", words)
    else:
        text = text.replace(f"bar.{node}", words)
    (tmp_path / "p.yaml").write_text(text)
    run = Run(load_pipeline(tmp_path / "p.yaml"), tmp_path / "out", Silent())
    still = abs(run.in_dofs.response(run.scene.configurations[0], np.array([1e-3])))[0, 0, 0]
    force = f"*STEP\n*STATIC\n*CLOAD\n{node}, 3, 1.\n*NODE PRINT, NSET=ALL\nU\n*END STEP\n"
    (tmp_path / "still.inp").write_text(body(name, held=True) + force)
    subprocess.run(["ccx", "still"], cwd=tmp_path, capture_output=True, timeout=120, check=True)
    printed = re.search(rf"^\s+{node}((?:\s+\S+E\S+){{3}})\s*$", (tmp_path / "still.dat").read_text(), re.M)
    assert still == pytest.approx(float(printed[1].split()[2]), rel=2e-5)


def test_a_rigid_body_beside_the_nodes_of_the_result_alone(tmp_path):
    """Its own rows have no place there; the stiffness shows how they take part in rigid motion."""
    solved(tmp_path, body("rigid", held=False))
    found = read(tmp_path, "whole.frd")
    assert prove_row_order(found).status == "proven"
    np.testing.assert_allclose(frequencies(found), frequencies(read(tmp_path)), rtol=1e-9)


def test_messages(tmp_path):
    solved(tmp_path, body("S8R", held=False))
    (tmp_path / "bar.12d").unlink()
    with pytest.raises(CmsReduceError, match="put that file beside the list"):
        read(tmp_path)
    solved(tmp_path, body("rigid", held=False))
    with pytest.raises(CmsReduceError, match=r"no set 'HUP' .* sets of nodes: ALL \(\d+\), TIP \(9\)"):
        read(tmp_path, interfaces={"hub": InterfaceSpec(set="HUP")})
    for kind, words in (("M3D4", "a membrane"), ("T3D2", "a truss")):
        solve(tmp_path, "bar", stiffened(kind).text(), matrices=True)
        with pytest.raises(CmsReduceError, match=rf"element \d+ is {words} \({kind}.*not read yet"):
            read(tmp_path)
    deck = Deck().plate("S4", (2, 2), (0, 0, 0), (1, 0, 0), (0, 1, 0))
    deck.keywords += "*NORMAL\n1, 1, 0., 0., 1.\n"
    solve(tmp_path, "bar", deck.text(), matrices=True)
    with pytest.raises(CmsReduceError, match=r"give the \.frd file"):
        read_geometry(tmp_path / "bar.inp")
