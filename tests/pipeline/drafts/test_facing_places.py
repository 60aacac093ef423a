"""Faces of bodies that lie against each other make a joint, although their meshes have no node in common."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.config import load_pipeline
from cmsreduce.model import FEModel, Nodes
from cmsreduce.pipeline import Run, Silent
from cmsreduce.pipeline.drafts import draft_pipeline
from cmsreduce.pipeline.drafts.facing_places import facing_places
from cmsreduce.pipeline.drafts.proposed_interfaces import Place, proposed_interfaces
from tests.frames import rotation
from tests.pipeline.bodies.decks import brick_cards
from tests.solids import block

SIDES, COARSE, FINE = (0.4, 0.06, 0.1), (5, 2, 2), (4, 3, 3)
# Around the lower face of a brick, then around the upper one.
AROUND = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
NEAR = block("near", SIDES, COARSE)
FAR = block("far", SIDES, FINE, origin=(SIDES[0], 0, 0))


def places_of(body: FEModel, cells: tuple[int, int, int]) -> list[Place]:
    index = 1 + np.arange(np.prod(np.array(cells) + 1)).reshape(np.array(cells) + 1)
    bricks = [[index[tuple(np.array(at) + c)] for c in AROUND] for at in product(*(range(n) for n in cells))]
    return proposed_interfaces(body, {"hexahedron": np.array(bricks)})


def moved(body: FEModel, by: tuple[float, float, float], turned: float = 0.0) -> FEModel:
    R = rotation([0, 0, 1], np.radians(turned))
    xyz = (body.nodes.xyz - [SIDES[0], 0, 0]) @ R.T + [SIDES[0], 0, 0] + np.array(by)
    return replace(body, nodes=Nodes.in_basic(body.nodes.id, xyz))


def facing(far: FEModel, lengths: tuple[float, float] = (1.0, 1.0)) -> tuple[Place, ...]:
    bodies = {"near": NEAR, "far": far}
    places = {"near": places_of(NEAR, COARSE), "far": places_of(far, FINE)}
    found = facing_places(bodies, places, dict(zip(bodies, lengths, strict=True)))
    return found.get(("near", "far"), ())


def test_two_faces_with_different_meshes_make_one_point() -> None:
    mine, theirs = facing(FAR)
    assert (mine.name, theirs.name) == ("to_far", "to_near")
    for place, body in ((mine, NEAR), (theirs, FAR)):
        assert np.unique(body.nodes.xyz[body.nodes.index(place.nodes), 0]) == pytest.approx(SIDES[0])
        assert place.tied and place.interface.endswith("tie: rigid, position: [0.4, 0.03, 0.05]}")


def test_the_point_is_in_the_units_of_each_body() -> None:
    far = replace(FAR, nodes=Nodes.in_basic(FAR.nodes.id, 1e3 * FAR.nodes.xyz))
    mine, theirs = facing(far, (1.0, 1e-3))
    assert mine.interface.endswith("[0.4, 0.03, 0.05]}") and theirs.interface.endswith("[400, 30, 50]}")


@pytest.mark.parametrize(
    "far",
    [moved(FAR, (0, 0.02, 0)), moved(FAR, (0, 0, 0), 2.0), moved(FAR, (-SIDES[0], 0, 0)), moved(FAR, (1e-3, 0, 0))],
    ids=["beside it", "at an angle", "in one place", "apart"],
)
def test_faces_that_do_not_lie_against_each_other_make_none(far: FEModel) -> None:
    assert facing(far) == ()


def test_the_draft_of_two_meshes_is_a_scene_that_runs(tmp_path: Path) -> None:
    """Halves of a beam, whose meshes have the corners of the face in common: welded there alone it is 15 % softer."""
    files = []
    for body, cells in ((NEAR, COARSE), (FAR, FINE)):
        stiffness, mass, rows, deck = (tmp_path / f"{body.name}.{end}" for end in ("K.npz", "M.npz", "txt", "bdf"))
        sp.save_npz(stiffness, sp.csc_array(body.K))
        sp.save_npz(mass, sp.csc_array(body.M))
        rows.write_text("\n".join(body.dofs.labels))
        grids = [
            f"GRID,{k},,{x:.6f},{y:.6f},{z:.6f}" for k, (x, y, z) in zip(body.nodes.id, body.nodes.xyz, strict=True)
        ]
        deck.write_text("\n".join(["BEGIN BULK", *grids, *brick_cards(cells), "ENDDATA\n"]))
        files += [stiffness, mass, rows, deck]
    draft = draft_pipeline("beam", files)
    assert draft.warnings == ()
    path = tmp_path / "beam.yaml"
    path.write_text(draft.text)
    run = Run(load_pipeline(path), tmp_path / "out", Silent())
    system = run.in_dofs.system(run.scene.configurations[0])
    # Bricks that are as long as they are on average.
    whole = block("whole", (2 * SIDES[0], *SIDES[1:]), (9, 2, 2))
    w, expected = (
        np.sqrt(la.eigvalsh(A.toarray(), B.toarray(), subset_by_index=[6, 6])[0])
        for A, B in ((system.K, system.M), (whole.K, whole.M))
    )
    assert w == pytest.approx(expected, rel=0.03)
