"""Stiffness at single nodes against the deck: errors that the energy of uniform strains does not show."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.config import build_scene, load_pipeline
from cmsreduce.model import DofTable, FEModel, Finding, Nodes, Proof, cross_matrix
from cmsreduce.pipeline.bodies import read_flexible
from cmsreduce.pipeline.evidence.mass_against_deck import away_from_supports
from cmsreduce.read.stated import (
    SOLIDS,
    Solids,
    affine_slope_integrals,
    slope_integrals,
    sum_at_nodes,
    uniform_forces,
)
from tests.frames import BAR, Section, beam_matrices, frame
from tests.pipeline.bodies.decks import bar_cards, brick_cards, write_deck_body
from tests.solids import E, block

XYZ = [[0, 0, 0], [0.5, 0, 0], [1, 0.2, 0], [1.2, 0.7, 0.3], [0.6, 0.9, 0.5], [0.1, 0.5, 0.8], [1.6, 0.3, 0.2]]
BARS = [(1, 2), (2, 3), (3, 4), (4, 5), (5, 6), (6, 1), (3, 7), (4, 7)]
SOUND, CARDS = frame("part", XYZ, BARS), bar_cards(BARS, XYZ)
CELLS, SIDES, HALF = (6, 2, 3), [1.5, 0.5, 0.75], 18
BY_NODE = "stiffness of each node against the deck"


def stiffness(folder: Path, body: FEModel, cards: list[str]) -> tuple[Proof, list[Finding]]:
    """The proof of the stiffness, and the checks that failed."""
    pipeline = load_pipeline(write_deck_body(folder, body, cards))
    found = read_flexible(pipeline, "part", build_scene(pipeline))
    proof = next(proof for proof in found.proofs if proof.what == "stiffness")
    return proof, [check for check in found.checks if not check.passed]


def two_materials(second: float, first: int) -> list[str]:
    """Deck of the bricks; those from number ``first`` on have another modulus."""
    cards, seen = brick_cards(CELLS), 0
    for k, card in enumerate(cards):
        if card.startswith("CHEXA"):
            seen += 1
            name, number, _, rest = card.split(",", 3)
            cards[k] = f"{name},{number},{1 if seen <= first else 2},{rest}"
    return [*cards, "PSOLID,2,2", f"MAT1,2,{second * E:.6E},,0.,2700."]


@pytest.mark.parametrize(
    ("section", "ratio"),
    [
        (replace(BAR, J=8 * BAR.J), "1 to 8 times"),
        (replace(BAR, J=BAR.J / 8), "0.125 to 1 times"),
        (replace(BAR, Iy=BAR.Iz, Iz=BAR.Iy), "0.5 to 2 times"),
        (replace(BAR, E=0.95 * BAR.E, G=0.95 * BAR.G), "0.95 times"),
    ],
    ids=["torsion", "soft torsion", "planes exchanged", "modulus"],
)
def test_bars_of_another_section(tmp_path: Path, section: Section, ratio: str) -> None:
    places, bars = [[0.4 * k, 0.0, 0.0] for k in range(4)], [(1, 2), (2, 3), (3, 4)]
    wrong = frame("part", places, bars, section=section)
    proof, (failed,) = stiffness(tmp_path, wrong, bar_cards(bars, places))
    assert proof.state == "refuted" and failed.name == BY_NODE
    assert ratio in failed.note


def test_a_bar_of_another_modulus_is_named_by_its_nodes(tmp_path: Path) -> None:
    cards = [card.replace("CBAR,8,1,", "CBAR,8,2,") for card in CARDS]
    second = [card.replace(",1,1,", ",2,2,") for card in cards if card.startswith("PBAR")]
    proof, (failed,) = stiffness(
        tmp_path, SOUND, [*cards, *second, f"MAT1,2,{0.95 * BAR.E:.6E},{0.95 * BAR.G:.6E},,{BAR.rho}"]
    )
    assert proof.state == "refuted" and failed.name == BY_NODE
    assert set(failed.note.partition(";")[0].removeprefix("at node ").split(", ")) == {"4", "7"}


def test_springs_of_the_deck(tmp_path: Path) -> None:
    a, b = (int(SOUND.dofs.rows([node], [4])[0]) for node in (2, 6))
    spring = sp.coo_array(([4e3, 4e3, -4e3, -4e3], ([a, b, a, b], [a, b, b, a])), shape=SOUND.K.shape)
    sprung = replace(SOUND, K=sp.csc_array(SOUND.K + spring))
    for name, cards, body, state in (
        ("both", ["CELAS1,91,9,2,4,6,4", "PELAS,9,4000."], sprung, "proven"),
        ("rate", ["CELAS2,91,400.,2,4,6,4"], sprung, "refuted"),
        ("matrix", [], sprung, "refuted"),
        ("deck", ["CELAS2,91,4000.,2,4,6,4"], SOUND, "refuted"),
        # A rigid element may give its leads the stiffness of other grids.
        ("nameless", ["RBE2,94,,123456"], SOUND, "proven"),
        ("led", ["GRID,8,,2.,0.,0.", "RBE2,92,2,123456,8", "RBE2,93,6,123456,8"], sprung, "proven"),
    ):
        folder = tmp_path / name
        folder.mkdir()
        proof, _ = stiffness(folder, body, [*CARDS, *cards])
        assert proof.state == state, name
        compared = {"both": "at 7 of 7 nodes", "led": "at 5 of 7 nodes"}.get(name, "")
        assert compared in proof.remark and ("not compared" in proof.remark) == (name == "led")


@pytest.mark.parametrize("component", [7, 4294967300])
def test_a_spring_at_no_component_leaves_the_nodes_uncompared(tmp_path: Path, component: int) -> None:
    proof, _ = stiffness(tmp_path, SOUND, [*CARDS, f"CELAS2,91,4000.,2,{component},6,4"])
    assert proof.state == "proven" and "at 7 of 7 nodes" not in proof.remark


def test_bars_beside_their_grids(tmp_path: Path) -> None:
    """The bar 7 from node 3 to node 7 has ends beside both, with offsets along the basic axes of the grids."""
    offsets = np.array([[0.02, -0.03, 0.05], [-0.01, 0.04, 0.02]])
    places = np.array(XYZ)[[2, 6]]
    kept, ends = frame("part", XYZ, BARS[:6] + BARS[7:]), places + offsets
    k, _ = beam_matrices(*ends, BAR)
    for end in (0, 1):
        arm = np.eye(12)
        arm[6 * end : 6 * end + 3, 6 * end + 3 : 6 * end + 6] = -cross_matrix(offsets[end])
        k = arm.T @ k @ arm
    rows = np.r_[12:18, 36:42]
    K = kept.K.toarray()
    K[np.ix_(rows, rows)] += k
    y = np.cross([0.0, 0.0, 1.0], ends[1] - ends[0])
    card = "CBAR,7,1,3,7," + ",".join(f"{v:.6f}" for v in y / np.linalg.norm(y))
    cards = [line for line in CARDS if not line.startswith("CBAR,7,")]
    cards += [f"{card},GGG", ",,," + ",".join(f"{w}" for w in offsets.ravel())]
    proof, failed = stiffness(tmp_path, replace(kept, K=sp.csc_array(K)), cards)
    assert (
        proof.state == "proven" and "at 7 of 7 nodes" in proof.remark and not [f for f in failed if f.name == BY_NODE]
    )


def test_stress_by_a_static_subcase_is_not_of_the_deck(tmp_path: Path) -> None:
    proof, failed = stiffness(
        tmp_path, frame("part", XYZ, BARS, section=replace(BAR, J=2 * BAR.J)), [*CARDS, "FORCE,1,7,,9.,1.,0.,0."]
    )
    assert proof.state == "proven" and not failed
    assert proof.remark.endswith("bending and torsion at the other nodes are not compared: compare its frequencies")
    assert (proof.state, proof.label) == ("proven", "stiffness (stretch alone)")


@pytest.mark.parametrize(
    ("deck", "matrix"),
    [((3.0, HALF), [3.0] * HALF + [1.0] * HALF), ((1e-3, 30), [1.0] * 30 + [4e-3] * 6)],
    ids=["exchanged halves", "soft end"],
)
def test_two_materials_of_solids(tmp_path: Path, deck: tuple[float, int], matrix: list[float]) -> None:
    cards = two_materials(*deck)
    for name, moduli in (("sound", [1.0] * deck[1] + [deck[0]] * (36 - deck[1])), ("wrong", matrix)):
        folder = tmp_path / name
        folder.mkdir()
        proof, failed = stiffness(folder, block("part", SIDES, CELLS, moduli=moduli), cards)
        if name == "sound":
            assert proof.state == "proven" and f"at {block('part', SIDES, CELLS).n // 3} of" in proof.remark
        else:
            # The energy of the whole body is that of the deck to 1e-3.
            assert proof.state == "refuted" and [check.name for check in failed] == [BY_NODE]


@pytest.mark.parametrize("kind", SOLIDS)
def test_forces_of_a_solid_balance_and_do_the_work_of_its_stress(kind: str) -> None:
    solid, turn = SOLIDS[kind], np.array([[1.0, 0.2, -0.1], [0.3, 1.4, 0.2], [-0.2, 0.1, 0.8]])
    nodes = solid.places[None] @ turn
    volume = (
        np.linalg.det(turn)
        * {"C3D4": 1 / 6, "C3D6": 1.0, "C3D8": 8.0}[{4: "C3D4", 6: "C3D6", 8: "C3D8"}[solid.corners]]
    )
    slopes = slope_integrals(solid, nodes, 3)[0]
    np.testing.assert_allclose(affine_slope_integrals(solid, nodes)[0], slopes, atol=1e-12)
    found = uniform_forces(2.0 * slopes, 5.0 * slopes)
    np.testing.assert_allclose(found.sum(axis=0), 0, atol=1e-12)
    moments = np.einsum("kis,kj->ijs", found, nodes[0])
    # Stretch along x: lambda + 2 G along it and lambda across; shear in x and y with G_xy = G_yx = 1: 2 G.
    np.testing.assert_allclose(moments[:, :, 0], volume * np.diag([9.0, 5, 5]), atol=1e-12)
    np.testing.assert_allclose(moments[:, :, 3], volume * 4 * np.array([[0, 1.0, 0], [1, 0, 0], [0, 0, 0]]), atol=1e-12)


def test_forces_at_nodes_are_those_of_their_solids() -> None:
    """Sums of the slopes give the forces of all solids at a node, and the largest of each solid."""
    rng = np.random.default_rng(2)
    nodes, slopes = np.array([[0, 1, 2, 3], [3, 2, 1, 4]]), rng.standard_normal((2, 4, 3))
    G, lame = np.array([2.0, 7.0]), np.array([5.0, 0.5])
    found = sum_at_nodes(6, [Solids(nodes, slopes, G, lame)], None, nodes[0, :0], nodes[0, :0])
    assert found is not None
    each, force, terms = (
        uniform_forces(G[:, None, None] * slopes, lame[:, None, None] * slopes),
        np.zeros((6, 3, 6)),
        np.zeros(6),
    )
    for at, own in zip(nodes, each, strict=True):
        force[at] += own
        terms[at] += np.linalg.norm(own, axis=(1, 2)).max()
    np.testing.assert_allclose(found.force, force, atol=1e-13)
    np.testing.assert_allclose(found.terms, terms, rtol=1e-13)
    assert found.known.tolist() == [True] * 5 + [False]


def quadratic_tetrahedra(second: float) -> tuple[FEModel, list[str]]:
    """Bar of tetrahedra with nodes between corners, by scikit-fem; its second half has another modulus."""
    skfem = pytest.importorskip("skfem")
    from skfem.models.elasticity import lame_parameters, linear_elasticity

    mesh = skfem.MeshTet.init_tensor(np.linspace(0, 1, 3), np.linspace(0, 0.3, 2), np.linspace(0, 0.2, 2))
    element = skfem.ElementVector(skfem.ElementTetP2())
    half = mesh.p[0, mesh.t].mean(axis=0) > 0.5
    basis = skfem.Basis(mesh, element)
    K = sp.csc_array((basis.N, basis.N))
    for modulus, cells in ((E, np.flatnonzero(~half)), (second * E, np.flatnonzero(half))):
        part = skfem.Basis(mesh, element, elements=cells)
        K = K + sp.csc_array(linear_elasticity(*lame_parameters(modulus, 0.3)).assemble(part))
    xyz = basis.doflocs[:, ::3].T
    M = sp.eye_array(basis.N, format="csc")
    n = basis.N // 3
    table = DofTable(np.repeat(np.arange(1, n + 1), 3), np.tile([1, 2, 3], n))
    body = FEModel("part", K, M, table, Nodes.in_basic(range(1, n + 1), xyz))
    node = basis.element_dofs[::3] // 3 + 1
    cards = []
    for k, ids in enumerate(node.T, 1):
        # scikit-fem sorts the nodes between corners by its own edges; the deck wants those of 12 23 31 14 24 34.
        corners, rest = list(ids[:4]), list(ids[4:])
        edges = ((0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3))
        middle = [xyz[[corners[a] - 1, corners[b] - 1]].mean(axis=0) for a, b in edges]
        rest = [min(rest, key=lambda node, at=at: float(np.linalg.norm(xyz[node - 1] - at))) for at in middle]
        made = [str(i) for i in [*corners, *rest]]
        cards += [f"CTETRA,{k},{2 if half[k - 1] else 1}," + ",".join(made[:6]), "," + ",".join(made[6:])]
    return body, [*cards, "PSOLID,1,1", "PSOLID,2,2", f"MAT1,1,{E:.6E},,.3,2700.", f"MAT1,2,{0.01 * E:.6E},,.3,2700."]


@pytest.mark.parametrize(("second", "state"), [(0.01, "proven"), (0.012, "refuted")])
def test_corners_of_quadratic_tetrahedra_have_no_force(tmp_path: Path, second: float, state: str) -> None:
    body, cards = quadratic_tetrahedra(second)
    proof, failed = stiffness(tmp_path, body, cards)
    assert proof.state == state, proof
    assert not [check for check in failed if "stiffness" in check.name] or state == "refuted"
    assert state == "refuted" or f"at {body.n // 3} of {body.n // 3} nodes" in proof.remark


def test_nodes_beside_a_plane_of_symmetry_are_beside_supports() -> None:
    """Supports across the plane take forces under uniform strain, which cancel at even meshes under translation."""
    body = block("part", SIDES, CELLS)
    assert body.nodes is not None
    depth = body.nodes.xyz[:, 2]
    held = body.dofs.rows(body.nodes.id[depth == depth.min()], [3])
    kept = np.setdiff1d(np.arange(body.n), held)
    half = replace(
        body, K=body.K[kept][:, kept], M=body.M[kept][:, kept], dofs=body.dofs[kept], constrained=body.dofs[held]
    )
    away = away_from_supports(half, body.nodes.id)
    layer = np.unique(depth)[1]
    assert set(body.nodes.id[away]) == set(body.nodes.id[depth > layer])
