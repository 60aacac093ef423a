"""CalculiX decks as users write them: exponents of Fortran, other names of sections, plane elements."""

import re
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp
from click.testing import CliRunner

from cmsreduce.cli import main
from cmsreduce.config import load_pipeline
from cmsreduce.errors import CmsReduceError, ReadError, SceneError
from cmsreduce.mechanics import hold_undetermined
from cmsreduce.pipeline.drafts import draft_body
from cmsreduce.pipeline.evidence.deck_agreement import statement_of
from cmsreduce.read import MatrixSource, prove_row_order, read_geometry, read_parameter_matrix
from tests.golden.calculix_bodies import Deck, body, halves, solve
from tests.golden.test_calculix_bodies import frequencies, read

pytestmark = pytest.mark.ccx

LINE = [(x, 0.0, 0.0) for x in (0.0, 0.25, 0.5, 0.75, 1.0)]


def beam(section: str) -> str:
    deck = Deck(section)
    for at in (0, 2):
        deck.add("B32R", LINE[at : at + 3])
    return deck.text()


@pytest.mark.parametrize(
    ("section", "old", "new"),
    [
        ("RECT\n0.02, 0.03", "0.02, 0.03\n0.1, 1., 0.3", "2.d-2, .3D-1\n1.d-1, 1.d0, 3.d-1"),
        ("RECT\n0.02, 0.03", "SECTION=RECT", "SECTION=Rectangular"),
        ("RECT\n0.02, 0.03", "SECTION=RECT", "OFFSET1=0.d0, SECTION=RECT"),
        ("PIPE\n0.02, 0.002", "*BEAM SECTION", "*BEAM GENERAL SECTION"),
        ("BOX\n0.04, 0.03, 0.002, 0.002, 0.002, 0.002", "*BEAM SECTION", "*BEAM GENERAL SECTION"),
    ],
)
def test_sections(tmp_path, section, old, new):
    found = []
    for text in (beam(section), beam(section).replace(old, new)):
        solve(tmp_path, "bar", text, matrices=True)
        found.append(read(tmp_path))
        assert prove_row_order(found[-1]).status == "proven"
    assert new in text
    assert np.array_equal(found[0].nodes.xyz, found[1].nodes.xyz)
    assert abs(found[0].K - found[1].K).max() <= 1e-9 * abs(found[0].K).max()


@pytest.mark.parametrize(
    ("kind", "offset"),
    [("S4", ""), ("S4", "OFFSET"), ("S8R", "OFFSET"), ("B31", ""), ("B31", "OFFSET1"), ("B32R", "OFFSET1")],
)
@pytest.mark.parametrize("keyword", ["EQUATION", "CLOAD", "both", "MASS"])
def test_nodes_of_shells_and_beams_that_loads_masses_and_equations_name_keep_rows(tmp_path, kind, offset, keyword):
    """CalculiX keeps such a node beside those that it becomes, with rows of their mean motion."""
    if kind[0] == "S":
        deck = Deck().plate(kind, (4, 2), (0, 0, 0), (1, 0, 0), (0, 0.4, 0))
    else:
        deck = Deck().beam(kind, 4, lambda t: (t, 0, 0))
    root, middle, tip = (deck.node((x, 0, 0)) for x in (0, 0.5, 1))
    text = deck.text()
    if offset:
        text = re.sub(r"(\*(?:SHELL|BEAM) SECTION)", rf"\1, {offset}=0.5", text)
    if keyword == "MASS":
        text += f"*ELEMENT, TYPE=MASS, ELSET=LUMP\n9001, {middle}\n9002, {tip}\n*MASS, ELSET=LUMP\n0.7\n"
    if keyword in ("EQUATION", "both"):
        # In line, so that rigid motion satisfies it; over two lines.
        text += f"*EQUATION\n3\n{root}, 2, 1.d0, {middle}, 2, -2.,\n{tip}, 2, 1.\n"
    if keyword in ("CLOAD", "both"):
        text += f"*NSET, NSET=LOADED\n{tip},\n*STEP\n*STATIC\n*CLOAD\nLOADED, 3, 0.1\n{middle}, 1, 0.1\n*END STEP\n"
    solve(tmp_path, "bar", text, matrices=True)
    found = read(tmp_path)
    assert {middle, tip} <= set(found.dofs.node.tolist())
    proof = prove_row_order(found)
    assert (proof.status, proof.motions) == ("proven", 6)


@pytest.mark.parametrize(
    ("deck", "old", "offset"),
    [
        (Deck().plate("S4", (3, 2), (0, 0, 0), (1, 0, 0.2), (0, 0.4, 0)), "*SHELL SECTION", ", OFFSET=0.5"),
        (Deck().plate("S8R", (3, 2), (0, 0, 0), (1, 0, 0.2), (0, 0.4, 0)), "*SHELL SECTION", ", OFFSET=-0.3"),
        (Deck().beam("B32R", 3, lambda t: (t, 0, 0.1 * t)), "*BEAM SECTION", ", OFFSET1=0.4, OFFSET2=-0.25"),
        (Deck().beam("B31", 3, lambda t: (t, 0, 0.1 * t)), "*BEAM SECTION", ", OFFSET1=0.4"),
        (Deck("CIRC\n0.02, 0.02").beam("B32", 3, lambda t: (t, 0, 0.1 * t)), "*BEAM SECTION", ", OFFSET1=0.4"),
    ],
    ids=["S4", "S8R", "B32R", "B31", "round"],
)
def test_offset_sections_lie_where_calculix_puts_them(tmp_path, deck, old, offset):
    text = deck.text().replace(old, old + offset)
    solve(tmp_path, "bar", text, matrices=True)
    solve(tmp_path, "solid", text, matrices=False, modes=1, output=", OUTPUT=3D")
    ours, theirs = (read_geometry(tmp_path / name).nodes for name in ("bar.inp", "solid.frd"))
    assert abs(ours.xyz[ours.index(theirs.id)] - theirs.xyz).max() <= theirs.xyz_rounding <= 5e-6


@pytest.mark.parametrize(("kind", "words"), [("CPS4", "a plane stress element"), ("CAX4", "an axisymmetric element")])
def test_elements_in_a_plane_are_refused_by_name(tmp_path, kind, words):
    text = Deck().plate("S4", (3, 2), (1, 0, 0), (1, 0, 0), (0, 0.4, 0)).text()
    text = text.replace("TYPE=S4", f"TYPE={kind}").replace("*SHELL SECTION", "*SOLID SECTION")
    solve(tmp_path, "bar", text, matrices=True)
    with pytest.raises(ReadError, match=rf"bar\.12d: element 1 is {words} \({kind}.*mesh the"):
        read_geometry(tmp_path / "bar.inp")


def test_a_bolt_with_pre_tension_is_no_statement_of_stiffness(tmp_path):
    deck = Deck().solid("C3D8", (4, 1, 1), (1, 0.1, 0.15))
    deck.keywords = (
        "*NODE\n99, 0., 0., 0.\n*SURFACE, NAME=CUT\n2, S4\n*PRE-TENSION SECTION, SURFACE=CUT, NODE=99\n1., 0., 0.\n"
        "*BOUNDARY\n99, 1, 1\n"
    )
    solve(tmp_path, "bar", deck.text(), matrices=True)
    assert statement_of(tmp_path / "bar.inp", read(tmp_path)) == (None, None)


def test_a_result_file_without_the_nodes_of_knots_is_named(tmp_path, monkeypatch):
    """A result of another name has no list of the expansion beside it; the draft names a node with rows."""
    text = body("folded S8R", held=False)
    solve(tmp_path, "bar", text, matrices=True)
    solve(tmp_path, "whole", text, matrices=False)
    (tmp_path / "whole.12d").unlink()
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(main, ["new", "fold", "bar.sti", "bar.mas", "whole.frd"])
    assert done.exit_code == 0
    assert re.search(r"whole\.frd: \d+ nodes .* \(bar\.12d\), .* Give the \.inp file of this job", done.stderr)
    rows = {int(line.split(".")[0]) for line in (tmp_path / "bar.dof").read_text().split()}
    assert load_pipeline(tmp_path / "fold.yaml").components["fold"].interfaces["mount"].node in rows


@pytest.mark.parametrize("order", [("KINEMATIC", "DISTRIBUTING"), ("DISTRIBUTING", "KINEMATIC"), ("DISTRIBUTING",)])
@pytest.mark.parametrize("kind", ["C3D8", "C3D8I"])
def test_the_reference_node_of_a_distributing_coupling_has_no_rotations(tmp_path, kind, order):
    """Numbers after the last node are the rotations of kinematic couplings, and dofs inside C3D8I."""
    deck, faces = Deck().solid(kind, (4, 2, 2), (1, 0.1, 0.15)), {0: "S6", 1: "S4"}
    for x, coupling in enumerate(order):
        end = set(deck.at(x, layer=0))
        deck.keywords += f"*SURFACE, NAME=END{x}\n"
        deck.keywords += "".join(f"{k}, {faces[x]}\n" for k, (_, own) in enumerate(deck.elements, 1) if end & set(own))
        lead = deck.node((1.2 * x - 0.1, 0.05, 0.075), layer=1)
        deck.keywords += f"*COUPLING, REF NODE={lead}, SURFACE=END{x}, CONSTRAINT NAME=C{x}\n*{coupling}\n1, 3\n"
    solve(tmp_path, "bar", deck.text(), matrices=True)
    expected = np.array(solve(tmp_path, "whole", deck.text(), matrices=False))
    found = read(tmp_path)
    assert prove_row_order(found).status == "proven"
    turning = {int(node) for node in found.dofs.node[(found.dofs.component > 3) & (found.dofs.component <= 6)]}
    assert len(turning) == order.count("KINEMATIC")
    np.testing.assert_allclose(frequencies(found)[:6], expected[6:12], rtol=1e-6)


@pytest.mark.parametrize("held", [False, True])
def test_the_node_of_a_coupling_with_weights_lies_at_their_mean(tmp_path, held):
    """CalculiX moves the node of a mass by the weighted mean of the motions of the tip, wherever it lies."""
    deck = Deck().solid("C3D8", (4, 2, 1), (1, 0.3, 0.15))
    tip, lead = deck.at(1), deck.node((1.1, 0.1, 0.05), layer=1)
    weights = np.arange(1.0, 1 + len(tip))
    deck.keywords = f"*ELEMENT, TYPE=DCOUP3D, ELSET=DC\n9500, {lead}\n*DISTRIBUTING COUPLING, ELSET=DC\n"
    deck.keywords += "".join(f"{node}, {weight}\n" for node, weight in zip(tip, weights, strict=True))
    deck.keywords += f"*ELEMENT, TYPE=MASS, ELSET=LUMP\n9001, {lead}\n*MASS, ELSET=LUMP\n30.\n"
    if held:
        deck.keywords += "*BOUNDARY\n" + "".join(f"{node}, 1, 3\n" for node in deck.at(0))
    solve(tmp_path, "bar", deck.text(), matrices=True)
    expected = np.array(solve(tmp_path, "whole", deck.text(), matrices=False))
    found = read(tmp_path)
    assert prove_row_order(found).status == "proven"
    np.testing.assert_allclose(frequencies(found)[:6], expected[expected > 0.1][:6], rtol=1e-6)
    place = {number: at[1:] for at, number in deck.nodes.items()}
    mean = weights @ [place[node] for node in tip] / weights.sum()
    np.testing.assert_allclose(found.nodes.xyz[found.nodes.index(lead)][0], mean, rtol=1e-8)
    assert re.search(rf"moves node {lead} of a \*DISTRIBUTING COUPLING with the mean", "".join(found.remarks))


def test_a_mass_that_calculix_leaves_out_is_named(tmp_path):
    """Its modes are those without the mass; at a node of the surface, it counts."""
    deck = Deck().solid("C3D8", (4, 2, 2), (1, 0.1, 0.15))
    tip = set(deck.at(1))
    facing = [k for k, (_, own) in enumerate(deck.elements, 1) if tip & set(own)]
    lead = deck.node((1.1, 0.05, 0.075), layer=1)
    deck.keywords = "*SURFACE, NAME=TIP\n" + "".join(f"{k}, S4\n" for k in facing)
    deck.keywords += f"*COUPLING, REF NODE={lead}, SURFACE=TIP, CONSTRAINT NAME=C\n*DISTRIBUTING\n1, 3\n"
    bare, found = np.array(solve(tmp_path, "bare", deck.text(), matrices=False)), {}
    for node in (lead, min(tip)):
        lump = f"*ELEMENT, TYPE=MASS, ELSET=LUMP\n9001, {node}\n*MASS, ELSET=LUMP\n30.\n"
        modes = np.array(solve(tmp_path, "whole", deck.text() + lump, matrices=False))
        assert np.allclose(modes[6:9], bare[6:9], rtol=1e-6) == (node == lead)
        solve(tmp_path, "bar", deck.text() + lump, matrices=True)
        body = found[node] = read(tmp_path)
        np.testing.assert_allclose(frequencies(body)[:3], modes[6:9], rtol=1e-6)
    assert found[min(tip)].remarks == ()
    assert re.search(rf"leaves the mass at node {lead} out of its matrices", "".join(found[lead].remarks))


@pytest.mark.parametrize("held", [False, True])
def test_equations_between_nodes_apart_are_named(tmp_path, held):
    """Halves that equations join across a gap of 0.02 resist rotation; shuffled rows beside such a deck are no gap."""
    deck = halves("equation")
    deck.nodes = {(layer, x + 0.02 * layer, y, z): n for (layer, x, y, z), n in deck.nodes.items()}
    deck.nset("ROOT", deck.at(0))
    text = deck.text() + held * "*BOUNDARY\nROOT, 1, 3\n"
    solve(tmp_path, "bar", text, matrices=True)
    with pytest.raises(
        CmsReduceError, match=r"\*EQUATION of nodes \d+, \d+, which lie 0\.02 apart, and 17 more do not"
    ):
        read(tmp_path)
    first, second = (f"{node}." for node in deck.at(0.5 / 3, layer=0)[-2:])
    labels = (tmp_path / "bar.dof").read_text().replace(first, "x.").replace(second, first).replace("x.", second)
    (tmp_path / "bar.dof").write_text(labels)
    with pytest.raises(CmsReduceError, match="not proven") as shuffled:
        read(tmp_path)
    assert "EQUATION" not in str(shuffled.value)


def test_a_row_of_single_solids_of_reduced_integration_is_named(tmp_path):
    """Its hourglasses have neither stiffness nor mass, and no node is at rest in them."""
    deck = Deck().solid("C3D20R", (4, 1, 1), (1, 0.1, 0.15))
    deck.nset("ROOT", deck.at(0))
    solve(tmp_path, "bar", deck.text() + "*BOUNDARY\nROOT, 1, 3\n", matrices=True)
    found = hold_undetermined(read(tmp_path))
    rows = sp.csr_array(([1.0], ([0], [found.body.dofs.rows(deck.at(0.5)[0], 2)[0]])), shape=(1, found.body.n))
    with pytest.raises(
        SceneError,
        match=r"no node beside its interfaces is at rest in it\. Solids of reduced integration.*: mesh two across",
    ):
        found.check_untouched(rows, "sensor 'motion'")


@pytest.mark.parametrize("held", [True, False])
def test_a_drafted_row_of_single_solids_is_seen_far_from_its_mount(tmp_path, monkeypatch, held):
    monkeypatch.chdir(tmp_path)
    deck = Deck().solid("C3D20R", (4, 1, 1), (1, 0.1, 0.15))
    deck.nset("ROOT", deck.at(0))
    solve(tmp_path, "bar", deck.text() + held * "*BOUNDARY\nROOT, 1, 3\n", matrices=True)
    files = ["bar.sti", "bar.mas", "bar.inp"]
    draft = draft_body("bar", [tmp_path / name for name in files])
    # A body that is held is mounted at its tip, and has no rows at its root.
    assert draft.far in deck.at(0.125 if held else 1)
    assert CliRunner().invoke(main, ["new", "bar", *files]).exit_code == 0
    done = CliRunner().invoke(main, ["run", "bar.yaml"])
    assert done.exit_code == 2 and "mesh two across" in " ".join(done.output.split())


@pytest.mark.parametrize("kind", ["C3D8I", "S8R"])
def test_the_whole_stiffness_of_a_perturbation_step_is_that_of_a_parameter(tmp_path, kind):
    """With rows of dofs inside elements, and of the nodes that a shell becomes."""
    shell = kind[0] == "S"
    deck = (
        Deck().plate(kind, (8, 2), (0, 0, 0), (1, 0, 0), (0, 0.05, 0))
        if shell
        else Deck().solid(kind, (10, 2, 1), (1, 0.05, 0.01))
    )
    deck.nset("ROOT", deck.at(0))
    text = deck.text() + f"*BOUNDARY\nROOT, 1, {6 if shell else 3}\n"
    pull = f"*STEP\n*STATIC\n*DLOAD\nE{kind[0]}, GRAV, 9000., 1., 0., 0.\n*END STEP\n"
    solve(tmp_path, "bar", text, matrices=True)
    solve(tmp_path, "stress", text, matrices=True, preload=pull)
    rest = np.array(solve(tmp_path, "rest", text, matrices=False))
    expected = np.array(solve(tmp_path, "whole", text, matrices=False, preload=pull))
    assert (expected[:3] > 1.02 * rest[:3]).any()
    found = read(tmp_path)
    source = MatrixSource(tmp_path / "stress.sti")
    A, _ = read_parameter_matrix(source, found, "K", "parameter 'pull'", grounded=True, whole=True)
    np.testing.assert_allclose(frequencies(replace(found, K=found.K + A))[:6], expected[:6], rtol=1e-5)
    assert abs(A.data).max() < 0.1 * abs(found.K.data).max()


@pytest.mark.parametrize("kind", ["C3D8I", "S8R"])
@pytest.mark.parametrize(
    ("axes", "line", "components"),
    [
        ("R", ".7, .5, .2, -.3, .8, .1", (1, 3)),
        ("C", "-.2, .1, .3, -.2, .1, 1.3", (2,)),
        ("C", "0, 0, 0, 1, 0, 0", (3,)),
    ],
    ids=["two components", "across the radius", "along a cylinder, with nodes on its axis"],
)
def test_supports_in_turned_axes(tmp_path, kind, axes, line, components):
    deck = Deck()
    if kind == "S8R":
        deck.plate(kind, (3, 2), (0, 0, 0), (1, 0, 0.2), (0, 0.4, 0))
    else:
        deck.solid(kind, (3, 2, 2), (1, 0.3, 0.2), origin=(0, -0.15, -0.1))
    deck.nset("END", deck.at(0))
    deck.keywords += f"*TRANSFORM, NSET=END, TYPE={axes}\n{line}\n*BOUNDARY\n"
    deck.keywords += "".join(f"END, {component}\n" for component in components)
    solve(tmp_path, "bar", deck.text(), matrices=True)
    expected = np.array(solve(tmp_path, "whole", deck.text(), matrices=False))
    elastic = expected[expected > 0.1]
    found = read(tmp_path)
    proof = prove_row_order(found)
    # CalculiX has a zero frequency for each rigid motion that the supports leave.
    assert (proof.status, proof.motions) == ("proven", expected.size - elastic.size)
    np.testing.assert_allclose(frequencies(found)[:6], elastic[:6], rtol=2e-6)
