"""Stiffness of plates on solids, and of the solids below them, against the deck."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.spatial.transform import Rotation

from cmsreduce.model import DofTable, FEModel, Nodes
from cmsreduce.pipeline.evidence.deck_agreement import statement_of
from cmsreduce.pipeline.evidence.nodal_stiffness import nodes_against_deck
from tests.pipeline.bodies.decks import brick_cards, write_deck_body
from tests.pipeline.evidence.test_nodal_plates import BY_NODE, KINDS, NU, TURN, E
from tests.pipeline.evidence.test_nodal_stiffness import stiffness
from tests.plates import isotropic_laminate, plate_body
from tests.solids import block

CELLS, SIDES, THICK = (5, 3, 2), (1.0, 0.6, 0.2), 0.01
# Cells of a skin on the upper side of the block, and of a fin that stands on it.
PLACES: dict[str, Callable[[int, int], tuple[float, float, float]]] = {
    "skin": lambda i, j: (0.2 * i, 0.2 * j, 0.2),
    "fin": lambda i, j: (0.2 * i, 0.2, 0.2 + 0.1 * j),
}


def plated_block(
    where: str,
    kind: str,
    laminate: Callable[[int], np.ndarray] = lambda e: isotropic_laminate(E, NU, THICK),
    moduli: Sequence[float] = (),
    triangles: bool = False,
) -> tuple[FEModel, list[str]]:
    """A block of bricks with 15 plates, or 30 triangles; the nodes of the plates alone have rotations."""
    solid, place = block("part", SIDES, CELLS, moduli=moduli), PLACES[where]
    assert solid.nodes is not None
    numbers = {tuple(np.round(at, 7) + 0.0): k for k, at in enumerate(solid.nodes.xyz, 1)}
    cells = []
    for i, j in np.ndindex(5, 3):
        ids = []
        for a, b in ((0, 0), (1, 0), (1, 1), (0, 1)):
            ids.append(numbers.setdefault(tuple(np.round(place(i + a, j + b), 7) + 0.0), len(numbers) + 1))
        cells += [[ids[0], ids[1], ids[2]], [ids[0], ids[2], ids[3]]] if triangles else [ids]
    xyz, used = np.array(list(numbers)), np.unique(np.concatenate(cells))
    made = [(np.searchsorted(used, cell) + 1).tolist() for cell in cells]
    plates = plate_body("part", xyz[used - 1], made, laminate, kind, per_area=2700 * THICK)
    components = [range(1, 7) if node in used else range(1, 4) for node in range(1, len(xyz) + 1)]
    table = DofTable(
        np.repeat(np.arange(1, len(xyz) + 1), [len(each) for each in components]), np.concatenate(components)
    )
    K, M = (sp.lil_array((len(table), len(table))) for _ in range(2))
    for part, node in ((solid, solid.dofs.node), (plates, used[plates.dofs.node - 1])):
        rows = table.rows(node, part.dofs.component)
        K[np.ix_(rows, rows)] += part.K.toarray()
        M[np.ix_(rows, rows)] += part.M.toarray()
    name = "CTRIA3" if triangles else "CQUAD4"
    shells = [f"{name},{500 + e},5," + ",".join(map(str, cell)) for e, cell in enumerate(cells)]
    deck = [*brick_cards(CELLS), *shells, f"PSHELL,5,5,{THICK},5,,5", f"MAT1,5,{E:.4E},,{NU},2700."]
    return FEModel("part", sp.csc_array(K), sp.csc_array(M), table, Nodes.in_basic(range(1, len(xyz) + 1), xyz)), deck


@pytest.mark.parametrize("triangles", [False, True])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("where", PLACES)
def test_plates_on_solids_in_any_formulation(tmp_path: Path, where: str, kind: str, triangles: bool) -> None:
    body, deck = plated_block(where, kind, triangles=triangles)
    proof, failed = stiffness(tmp_path, body, deck)
    assert (proof.state, proof.label) == ("proven", "stiffness (uniform strain alone)"), proof
    assert f"at {len(body.nodes.id)} of {len(body.nodes.id)} nodes" in proof.remark  # type: ignore[union-attr]
    assert not [check for check in failed if "stiffness" in check.name]


@pytest.mark.parametrize("where", PLACES)
def test_plates_that_the_energy_of_the_whole_hides(tmp_path: Path, where: str) -> None:
    """The plate 7 of 15, or all of them, stretched or bent by another stiffness; and a plate beside its nodes."""
    changes: dict[str, Callable[[int], np.ndarray]] = {
        "one stiff plate": lambda e: isotropic_laminate(E * (1.1 if e == 7 else 1.0), NU, THICK),
        "all plates": lambda e: isotropic_laminate(1.02 * E, NU, THICK),
        "bending": lambda e: isotropic_laminate(E, NU, THICK, bending=1.02),
        "bending of one": lambda e: isotropic_laminate(E, NU, THICK, bending=4.0 if e == 7 else 1.0),
        "offset": lambda e: isotropic_laminate(E, NU, THICK, offset=1e-4),
    }
    for name, change in changes.items():
        folder = tmp_path / name
        folder.mkdir()
        proof, failed = stiffness(folder, *plated_block(where, "mindlin", change))
        assert proof.state == "refuted" and [c.name for c in failed if "stiffness" in c.name] == [BY_NODE], name


def test_a_brick_below_plates(tmp_path: Path) -> None:
    """Its nodes on the side of the skin show it, too, and are named once."""
    body, deck = plated_block("skin", "mindlin", moduli=[1.1 if k == 29 else 1.0 for k in range(30)])
    proof, failed = stiffness(tmp_path, body, deck)
    assert proof.state == "refuted"
    (check,) = (check for check in failed if check.name == BY_NODE)
    named = check.note.partition(";")[0].removeprefix("at node ").replace(" and ", ", ").split(", ")
    # The brick has eight nodes; the block's corner of largest number is one of them.
    assert "72" in named and len(set(named)) == len(named) == 6 and named[-1] == "3 more"


@pytest.mark.parametrize("where", PLACES)
def test_displacement_frames_and_places(tmp_path: Path, where: str) -> None:
    """A body that is turned, with rows along other axes at each node."""
    for factor, passed in ((1.0, True), (1.02, False)):
        body, deck = plated_block(
            where, "kirchhoff", lambda e, by=factor: isotropic_laminate(E * (by if e == 7 else 1.0), NU, THICK)
        )
        assert body.nodes is not None
        frames = Rotation.random(len(body.nodes.id), random_state=3).as_matrix()
        nodes = Nodes(body.nodes.id, body.nodes.xyz @ TURN.T, frames)
        count = [int((body.dofs.node == node).sum()) // 3 for node in body.nodes.id]
        triads = [frame @ TURN for frame in np.repeat(frames, count, axis=0)]
        F = sp.block_diag(triads, format="csc")
        placed = replace(body, K=sp.csc_array(F @ body.K @ F.T), nodes=nodes)
        path = write_deck_body(tmp_path, replace(body, nodes=nodes), deck).parent / "deck.bdf"
        energy = statement_of(path, placed)[1]
        assert energy is not None and energy.at_nodes is not None
        found = nodes_against_deck(placed, energy.at_nodes)
        assert found is not None and found.check.passed == passed, found
        assert found.compared == found.nodes and found.bending[energy.turning].all()
