"""Offsets and inertias of point masses: what the mass, centre and masses of nodes of a body do not show."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.config import build_scene, load_pipeline
from cmsreduce.model import FEModel, Finding, Proof, cross_matrix
from cmsreduce.pipeline.bodies import read_flexible
from tests.frames import frame, rotation
from tests.pipeline.bodies.decks import bar_cards, write_deck_body

XYZ = [[0, 0, 0], [0.5, 0, 0], [1, 0.2, 0], [1.2, 0.7, 0.3], [0.6, 0.9, 0.5], [0.1, 0.5, 0.8], [1.6, 0.3, 0.2]]
BARS = [(1, 2), (2, 3), (3, 4), (4, 5), (5, 6), (6, 1), (3, 7), (4, 7)]
BODY = frame("part", XYZ, BARS)
# Node, mass, offset, inertia about the centre of the mass.
POINTS = [
    (2, 1.5, [0.05, -0.03, 0.08], [[0.06, 0.012, -0.008], [0.012, 0.05, 0.004], [-0.008, 0.004, 0.03]]),
    (7, 1.5, [0.0, 0.06, -0.02], [[0.05, -0.02, 0.0], [-0.02, 0.09, 0.01], [0.0, 0.01, 0.07]]),
]
CHECK = "inertia of each point mass against the deck"


def cards() -> list[str]:
    made = []
    for k, (node, mass, w, J) in enumerate(POINTS):
        own = [J[0][0], -J[1][0], J[1][1], -J[2][0], -J[2][1], J[2][2]]
        made += [f"CONM2,{90 + k},{node},,{mass},{w[0]},{w[1]},{w[2]}", "," + ",".join(str(v) for v in own)]
    return made


def mass_proof(
    folder: Path, points: list, *, lumped: bool = False, made: list[str] | None = None, held: int = 0
) -> tuple[Proof, list[Finding]]:
    M = BODY.M.toarray()
    if lumped:
        M[:] = 0
        for a, b in BARS:
            half = 2700 * 4e-4 * np.linalg.norm(np.subtract(XYZ[a - 1], XYZ[b - 1])) / 2
            for node in (a, b):
                M[range(6 * node - 6, 6 * node - 3), range(6 * node - 6, 6 * node - 3)] += half
    for node, mass, w, J in points:
        S, rows = cross_matrix(np.asarray(w)), slice(6 * node - 6, 6 * node)
        M[rows, rows] += np.block([[mass * np.eye(3), -mass * S], [mass * S, np.asarray(J) - mass * S @ S]])
    body, deck, keys = replace(BODY, M=sp.csc_array(M)), [*bar_cards(BARS, XYZ), *(made or cards())], ""
    if held:
        left = np.flatnonzero(body.dofs.node != held)
        body = FEModel("part", body.K[left][:, left], body.M[left][:, left], body.dofs[left], nodes=body.nodes)
        deck, keys = [*deck, f"SPC1,1,123456,{held}"], "    grounded: true\n"
    pipeline = load_pipeline(write_deck_body(folder, body, deck, keys))
    found = read_flexible(pipeline, "part", build_scene(pipeline))
    proof = next(proof for proof in found.proofs if proof.what == "mass")
    return proof, [check for check in found.checks if not check.passed]


@pytest.mark.parametrize("lumped", [False, True])
@pytest.mark.parametrize("held", [0, 5])
def test_masses_as_the_deck_states_them_are_proven(tmp_path: Path, lumped: bool, held: int) -> None:
    proof, failed = mass_proof(tmp_path, POINTS, lumped=lumped, held=held)
    # A consistent mass loses what it has in common with the node that is held, and with it the evidence of its order.
    assert proof.state == ("unproven" if held and not lumped else "proven") and not failed


@pytest.mark.parametrize(("sign", "state"), [(1.0, "proven"), (-1.0, "refuted")])
def test_masses_along_a_coordinate_system(tmp_path: Path, sign: float, state: str) -> None:
    """Offset and inertia of the first mass, along axes that are turned; or turned the other way."""
    node, mass, w, J = POINTS[0]
    axes = rotation([1.0, -0.5, 2.0], sign * 0.8)
    system = ["CORD2R,5,,1.,2.,3.," + ",".join(f"{v:.9f}" for v in axes[2] + [1, 2, 3])]
    system += ["," + ",".join(f"{v:.9f}" for v in axes[0] + [1, 2, 3])]
    turned = rotation([1.0, -0.5, 2.0], 0.8)
    offset, own = turned @ w, turned @ np.array(J) @ turned.T
    products = [own[0, 0], -own[1, 0], own[1, 1], -own[2, 0], -own[2, 1], own[2, 2]]
    made = [f"CONM2,90,{node},5,{mass}," + ",".join(f"{v:.9f}" for v in offset)]
    made += ["," + ",".join(f"{v:.9f}" for v in products), *cards()[2:], *system]
    proof, failed = mass_proof(tmp_path, POINTS, made=made)
    assert proof.state == state
    assert any(check.name == CHECK for check in failed) == (state == "refuted")


@pytest.mark.parametrize(
    ("wrong", "nodes"),
    [
        ([(n, m, w, 0 * np.array(J)) for n, m, w, J in POINTS], "2, 7"),
        ([(n, m, w, 2 * np.diag(np.diag(J)) - np.array(J)) for n, m, w, J in POINTS], "2, 7"),
        ([(n, m, w, np.array(J) * (4 if n == 7 else 1)) for n, m, w, J in POINTS], "7"),
        ([(*POINTS[0][:3], POINTS[1][3]), (*POINTS[1][:3], POINTS[0][3])], "2, 7"),
        # The same mass at both: exchanged offsets leave mass and centre.
        ([(2, 1.5, *POINTS[1][2:]), (7, 1.5, *POINTS[0][2:])], "2, 7"),
    ],
    ids=["lost", "sign of products", "four times", "inertias exchanged", "offsets exchanged"],
)
@pytest.mark.parametrize("lumped", [False, True])
@pytest.mark.parametrize("held", [0, 5])
def test_inertias_and_offsets_of_other_masses(tmp_path: Path, wrong: list, nodes: str, lumped: bool, held: int) -> None:
    proof, failed = mass_proof(tmp_path, wrong, lumped=lumped, held=held)
    assert proof.state == "refuted"
    (check,) = (check for check in failed if check.name == CHECK)
    assert set(check.note.removeprefix("at node ").split(", ")) == set(nodes.split(", "))
    assert not any(check.name in ("mass against the deck", "centre of mass against the deck") for check in failed)


def test_inertia_that_an_equation_moves_to_another_node_is_sound(tmp_path: Path) -> None:
    """Node 7 turns with node 2: its inertia is at that one's rotations."""
    M = BODY.M.toarray()
    for node, mass, w, J in POINTS:
        S, at = cross_matrix(np.asarray(w)), slice(6 * node - 6, 6 * node)
        M[at, at] += np.block([[mass * np.eye(3), -mass * S], [mass * S, np.asarray(J) - mass * S @ S]])
    T = np.eye(BODY.n)
    T[39:42, 39:42], T[39:42, 9:12] = 0.0, np.eye(3)
    left = np.r_[:39]
    K, M = (sp.csc_array(T[:, left].T @ A @ T[:, left]) for A in (BODY.K, M))
    body = FEModel("part", K, M, BODY.dofs[left], nodes=BODY.nodes)
    pipeline = load_pipeline(write_deck_body(tmp_path, body, [*bar_cards(BARS, XYZ), *cards(), "RBE2,95,2,456,7"]))
    found = read_flexible(pipeline, "part", build_scene(pipeline))
    assert not [check for check in found.checks if not check.passed]
    assert next(proof.state for proof in found.proofs if proof.what == "mass") == "proven"


WATER = np.diag([1.0, 2.5, 6.0, 0.02, 0.05, 0.01])


@pytest.mark.parametrize(
    ("made", "state"),
    [
        (["CONM1,95,5,,1.,0.,2.5,0.,0.", ",6.,0.,0.,0.,.02", ",0.,.05,0.,0.,0.,0.,0.,.01"], "proven"),
        (["PMASS,9,6.,8,2.5", "CMASS1,1003,9,5,3", "CMASS1,1002,8,5,2", "CMASS2,1001,1.,,,5,1"], "proven"),
        (["CONM1,95,5,,1.,0.,6.,0.,0.", ",2.5,0.,0.,0.,.02", ",0.,.05,0.,0.,0.,0.,0.,.01"], "refuted"),
        (["CMASS2,1001,1.,5,1", "CMASS2,1002,2.5,5,2"], "refuted"),
        (["PMASS,9,6.", "CMASS1,1003,9,5,3,1,3"], "refuted"),
    ],
    ids=["CONM1", "CMASS", "axes exchanged", "one left out", "two points"],
)
def test_masses_that_differ_by_direction_are_those_of_the_deck(tmp_path: Path, made: list[str], state: str) -> None:
    """As water around a hull: the mass of the body is another one along each axis, which no mass alone has."""
    if made[0].startswith("PMASS") and state == "proven":
        made = [*made, *(f"CMASS2,{1010 + c},{WATER[c - 1, c - 1]},5,{c}" for c in (4, 5, 6))]
    at = slice(24, 30)
    M = BODY.M.toarray()
    M[at, at] += WATER
    pipeline = load_pipeline(
        write_deck_body(tmp_path, replace(BODY, M=sp.csc_array(M)), [*bar_cards(BARS, XYZ), *made])
    )
    found = read_flexible(pipeline, "part", build_scene(pipeline))
    proof = next(proof for proof in found.proofs if proof.what == "mass")
    assert proof.state == state, proof
    amount = [check for check in found.checks if check.name == "mass against the deck"]
    if state == "proven":
        assert "taken out" in proof.remark and not proof.only and amount[0].passed
    else:
        assert any(not check.passed for check in found.checks)
