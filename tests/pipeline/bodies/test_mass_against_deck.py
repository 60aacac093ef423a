"""The mass of solids against their deck: at each node away from supports, and the same along x, y and z."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.model import FEModel, Nodes, Proof
from cmsreduce.pipeline.bodies import FlexibleBody
from cmsreduce.pipeline.bodies.mass_proof import negative_mass
from tests.frames import Section, frame
from tests.pipeline.bodies.decks import bar_cards, brick_cards
from tests.pipeline.bodies.test_body_proofs import opened, proof_of
from tests.solids import block

Array = np.ndarray[Any, np.dtype[np.float64]]

CELLS, SIDES = (6, 2, 2), [1.5, 0.5, 0.75]
ROOT = range(1, 10)


def body_of(held: bool) -> FEModel:
    return block("part", SIDES, CELLS, held=ROOT if held else ())


def read(folder: Path, M: sp.csc_array, held: bool) -> FlexibleBody:
    body = replace(body_of(held), M=M, grounded=False)
    return opened(folder, body, [*brick_cards(CELLS), *(["SPC1,1,123456,1,THRU,9"] if held else [])])


@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize("lumped", [False, True])
def test_a_sound_mass_is_proven(tmp_path: Path, held: bool, lumped: bool) -> None:
    M = body_of(held).M
    if lumped:
        free = body_of(False).M
        M = sp.csc_array(sp.diags_array(np.asarray(free.sum(axis=1)).ravel()[-M.shape[0] :]))
    proof = proof_of(read(tmp_path, M, held), "mass")
    assert (proof.state, proof.label) == ("proven", "mass")


@pytest.mark.parametrize("cell", [0, 3, 20])
@pytest.mark.parametrize("factor", [10.0, 1.1])
def test_another_density_beside_supports_is_found(tmp_path: Path, cell: int, factor: float) -> None:
    """Nodes there share mass with nodes without rows: their own entries are compared."""
    densities = [factor if each == cell else 1.0 for each in range(24)]
    held = [*ROOT, *range(55, 64)]
    body = replace(block("part", SIDES, CELLS, held=held, densities=densities), grounded=False)
    cards = [*brick_cards(CELLS), "SPC1,1,123,1,THRU,9", "SPC1,1,123,55,THRU,63"]
    proof = proof_of(opened(tmp_path, body, cards), "mass")
    assert proof.state == "refuted" and "times that of the deck" in proof.remark


@pytest.mark.parametrize(("more", "label"), [("CONM2,99,14,,5.", "nodes away from supports"), ("", "")])
def test_nodes_beside_supports_with_other_elements_are_left_out(tmp_path: Path, more: str, label: str) -> None:
    body = replace(body_of(True), grounded=False)
    rows = body.dofs.rows(14, [1, 2, 3]) if more else np.zeros(0, np.int64)
    M = body.M + sp.csc_array((np.full(rows.size, 5.0), (rows, rows)), shape=body.M.shape)
    deck = [*brick_cards(CELLS), *([more] if more else []), "SPC1,1,123456,1,THRU,9"]
    proof = proof_of(opened(tmp_path, replace(body, M=sp.csc_array(M)), deck), "mass")
    assert (proof.state, proof.only) == ("proven", label)


def test_a_few_heavier_nodes_of_a_held_body_are_named(tmp_path: Path) -> None:
    """Most nodes have the mass of the deck; those at the tip have 3.4 % more."""
    body = body_of(True)
    assert body.nodes is not None
    tip = body.dofs.node > 54
    S = sp.diags_array(np.where(tip, 1.02, 1.0))
    proof = proof_of(read(tmp_path, sp.csc_array(S @ body.M @ S), True), "mass")
    assert proof.state == "refuted" and "away from supports" in proof.remark
    assert "1.034 times that of the deck" in proof.remark


@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize("share", [1e-4, 0.1])
def test_stiffness_in_the_mass_is_found(tmp_path: Path, held: bool, share: float) -> None:
    """A solver adds it for its steps in time. It leaves mass, centre, inertia and the mass of each node."""
    body = body_of(held)
    added = share * body.M.diagonal().max() / body.K.diagonal().max()
    proof = proof_of(read(tmp_path, sp.csc_array(body.M + added * body.K), held), "mass")
    assert proof.state == "refuted" and "coupling of x, y and z" in proof.remark


def test_two_axes_of_a_node_exchanged_in_the_mass_of_a_held_body_are_found(tmp_path: Path) -> None:
    body = body_of(True)
    order = np.arange(body.n)
    rows = body.dofs.rows(32, [1, 2])
    order[rows] = rows[::-1]
    proof = proof_of(read(tmp_path, sp.csc_array(body.M[order][:, order]), True), "mass")
    assert proof.state == "refuted" and "node 32" in proof.remark


@pytest.mark.parametrize("held", [False, True])
@pytest.mark.parametrize("more", [0.0, 0.1])
def test_coupled_mass_of_a_rod_on_solids_is_sound(tmp_path: Path, held: bool, more: float) -> None:
    """MSC's rod has 5/12 and 1/12 of its mass along it, and halves across it; nodes beside it are still compared."""
    body, ends, area = body_of(held), (19, 41), 1e-4
    assert body.nodes is not None
    along = np.subtract(*(body.nodes.xyz[end - 1] for end in ends))
    length = float(np.linalg.norm(along))
    e = np.outer(along, along) / length**2
    rows = np.concatenate([body.dofs.rows(end, [1, 2, 3]) for end in ends])
    K, M = body.K.tolil(), sp.csc_array(body.M + more * body.M.diagonal().max() / body.K.diagonal().max() * body.K)
    K[np.ix_(rows, rows)] += 2e11 * area / length * np.kron([[1, -1], [-1, 1]], e)
    M = M.tolil()
    M[np.ix_(rows, rows)] += 7850 * area * length * (np.eye(6) / 2 + np.kron([[-1, 1], [1, -1]], e) / 12)
    body = replace(body, K=sp.csc_array(K), M=sp.csc_array(M), grounded=False)
    deck = [*brick_cards(CELLS), f"CONROD,99,{ends[0]},{ends[1]},2,{area}", "MAT1,2,2.E11,,.3,7850."]
    found = opened(tmp_path, body, [*deck, *(["SPC1,1,123456,1,THRU,9"] if held else [])])
    proof = proof_of(found, "mass")
    assert proof.state == ("refuted" if more else "proven")
    assert not more or "coupling of x, y and z" in proof.remark


def hinged(M: sp.csc_array, body: FEModel, components: tuple[int, ...]) -> FEModel:
    """A frame held at node 1 whose node 10 takes some of its motions from node 9, at the same place."""
    T = sp.eye_array(body.n, format="lil")
    follow, lead = (body.dofs.rows(node, components) for node in (10, 9))
    T[follow, follow], T[follow, lead] = 0.0, 1.0
    left = np.setdiff1d(np.flatnonzero(body.dofs.node != 1), follow)
    T = sp.csc_array(T)[:, left]
    K, M = (sp.csc_array(T.T @ A @ T) for A in (body.K, M))
    return replace(body, K=K, M=M, dofs=body.dofs[left], interfaces={}, grounded=False)


HINGE_XYZ = [[0.1 * min(i, 8), 0.1 * max(i - 8, 0), 0] for i in [*range(9), *range(8, 17)]]
HINGE_BARS = [(i, i + 1) for i in range(1, 18) if i != 9]


def hinge_proof(
    folder: Path, body: FEModel, M: sp.csc_array, components: tuple[int, ...]
) -> tuple[FlexibleBody, Proof]:
    """Proof of two rows of bars with a hinge between nodes 9 and 10, held at node 1."""
    deck = [*bar_cards(HINGE_BARS, HINGE_XYZ), "SPC1,1,123456,1", f"RBE2,90,9,{''.join(map(str, components))},10"]
    found = opened(folder, hinged(M, body, components), deck)
    return found, proof_of(found, "mass")


def lumped_mass(body: FEModel) -> Array:
    moving = body.dofs.component <= 3
    return np.where(moving, body.M @ (body.rigid_shapes[:, :3].sum(axis=1) * moving), 1e-9)


@pytest.mark.parametrize("components", [(1, 2, 3), (1, 2, 3, 4, 5), (2, 3, 4, 5, 6)])
@pytest.mark.parametrize("lumped", [False, True])
@pytest.mark.parametrize("wrong", [(), (14,), (4, 14)])
def test_nodes_beside_a_hinge_are_compared(
    tmp_path: Path, components: tuple[int, ...], lumped: bool, wrong: tuple[int, ...]
) -> None:
    """The node that follows keeps some of its rows, without its mass; the mass of its hinge is compared as a whole."""
    body = frame("part", HINGE_XYZ, HINGE_BARS)
    # Two nodes exchange a part of their mass, one has more.
    factor = np.ones(body.n)
    for node, more in zip(wrong, (0.04, -0.04), strict=False):
        factor[body.dofs.node == node] += more
    S = sp.diags_array(np.sqrt(factor))
    M = sp.csc_array(S @ (sp.diags_array(lumped_mass(body)) if lumped else body.M) @ S)
    found, proof = hinge_proof(tmp_path, body, M, components)
    assert proof.state == ("refuted" if wrong else "proven")
    if not wrong:
        assert not [check for check in found.checks if not check.passed]
        assert "as a whole at nodes that constraints join: 9" in proof.remark
        assert "not proven" not in proof.remark


@pytest.mark.parametrize(
    ("components", "wrong"),
    [
        *(((1, 2, 3, 4, 5), {(10, c): (node, c) for c in (1, 2, 3)}) for node in (3, 8, 11, 14, 17)),
        # The half of a bar along one axis at another axis, and along a free axis at the node that leads.
        ((1, 2, 3, 4, 5), {(10, 2): (9, 1)}),
        ((2, 3, 4, 5, 6), {(10, 1): (9, 1)}),
        ((1, 3, 4, 5, 6), {(10, 2): (9, 2)}),
    ],
)
def test_mass_of_a_hinge_at_a_wrong_place_is_not_proven(
    tmp_path: Path, components: tuple[int, ...], wrong: dict[tuple[int, int], tuple[int, int]]
) -> None:
    """The mass of the node that follows, at another node than the one that leads it or along another axis."""
    body = frame("part", HINGE_XYZ, HINGE_BARS)
    mass = lumped_mass(body)
    for (node, c), (other, d) in wrong.items():
        row, to = body.dofs.rows(node, [c]), body.dofs.rows(other, [d])
        mass[to] += mass[row]
        mass[row] = 0.0
    _, proof = hinge_proof(tmp_path, body, sp.csc_array(sp.diags_array(mass)), components)
    assert proof.state != "proven"
    assert "masses that constraints move to other nodes are not proven: node 10" in proof.remark


@pytest.mark.parametrize("place", [10, 3, 14])
def test_mass_that_an_equation_moves_to_another_place_is_not_proven(tmp_path: Path, place: int) -> None:
    """Node 10, 5 cm beside node 9, follows it by equations: nothing in the matrices tells node 9 from others."""
    xyz = [[x + 0.05 * (k > 8), y, z] for k, (x, y, z) in enumerate(HINGE_XYZ)]
    body = frame("part", xyz, HINGE_BARS)
    mass = lumped_mass(body)
    if place != 10:
        row = body.dofs.rows(10, [1, 2, 3])
        mass[body.dofs.rows(place, [1, 2, 3])] += mass[row]
        mass[row] = 0.0
    deck = [*bar_cards(HINGE_BARS, xyz), "SPC1,1,123456,1", *(f"MPC,1,10,{c},1.,9,{c},-1." for c in (1, 2, 3))]
    found = opened(tmp_path, hinged(sp.csc_array(sp.diags_array(mass)), body, (1, 2, 3)), deck)
    proof = proof_of(found, "mass")
    assert proof.state == "unproven" and "to other nodes are not proven: node 10" in proof.remark


@pytest.mark.parametrize("other", [False, True])
def test_a_third_node_at_the_place_of_a_hinge_does_not_lead(tmp_path: Path, other: bool) -> None:
    """Nodes 9, 10 and 19 are at one place; the mass of node 10 is at 19 if ``other``."""
    xyz, bars = [*HINGE_XYZ, HINGE_XYZ[8], [0.8, 0, 0.1]], [*HINGE_BARS, (19, 20), (3, 20)]
    body = frame("part", xyz, bars)
    mass = lumped_mass(body)
    row, to = body.dofs.rows(10, [1, 2, 3]), body.dofs.rows(19, [1, 2, 3])
    if other:
        mass[to] += mass[row]
        mass[row] = 0.0
    deck = [*bar_cards(bars, xyz), "SPC1,1,123456,1", "RBE2,90,9,12345,10"]
    found = opened(tmp_path, hinged(sp.csc_array(sp.diags_array(mass)), body, (1, 2, 3, 4, 5)), deck)
    assert proof_of(found, "mass").state == ("unproven" if other else "proven")


@pytest.mark.parametrize(("heavy", "far"), [(1e5, 0.0), (100.0, 2e3)])
def test_negative_inertia_of_thin_bars_counts_beside_heavy_masses_and_far_grids(heavy: float, far: float) -> None:
    """Twist of a wire of 3 mm has 1e-12 of the mass of a hundred tonnes, which sits at another node."""
    wire = Section(A=7e-6, Iy=4e-12, Iz=4e-12, J=8e-12)
    xyz, bars = [[2.5 * i, 0, 0] for i in range(13)], [(i, i + 1) for i in range(1, 13)]
    body = frame("part", xyz, bars, section=wire, masses={1: heavy})
    assert body.nodes is not None
    body = replace(body, nodes=Nodes.in_basic([*body.nodes.id, 999], [*xyz, [0, 0, far]]))
    assert negative_mass(body) == 0
    M = body.M.tolil()
    r, s = (int(body.dofs.rows(node, [4])[0]) for node in (6, 7))
    M[r, s] = M[s, r] = 8 * M[r, s]
    assert negative_mass(replace(body, M=sp.csc_array(M))) == 1
