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
from tests.frames import frame, rotation
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


def saved(folder: Path, body: FEModel, cards: list[str]) -> list[Path]:
    """Matrices, rows and deck of a body."""
    stiffness, mass, rows, deck = (folder / f"{body.name}.{end}" for end in ("K.npz", "M.npz", "txt", "bdf"))
    sp.save_npz(stiffness, sp.csc_array(body.K))
    sp.save_npz(mass, sp.csc_array(body.M))
    rows.write_text("\n".join(body.dofs.labels))
    grids = [f"GRID,{k},,{x:.6f},{y:.6f},{z:.6f}" for k, (x, y, z) in zip(body.nodes.id, body.nodes.xyz, strict=True)]
    deck.write_text("\n".join(["BEGIN BULK", *grids, *cards, "ENDDATA\n"]))
    return [stiffness, mass, rows, deck]


def drafted(folder: Path, files: list[Path]) -> Run:
    draft = draft_pipeline("beam", files)
    assert draft.warnings == ()
    path = folder / "beam.yaml"
    path.write_text(draft.text)
    return Run(load_pipeline(path), folder / "out", Silent())


def test_the_draft_of_two_meshes_is_a_scene_that_runs(tmp_path: Path) -> None:
    """Halves of a beam, whose meshes have the corners of the face in common: welded there alone it is 15 % softer."""
    run = drafted(tmp_path, [*saved(tmp_path, NEAR, brick_cards(COARSE)), *saved(tmp_path, FAR, brick_cards(FINE))])
    system = run.in_dofs.system(run.scene.configurations[0])
    # Bricks that are as long as they are on average.
    whole = block("whole", (2 * SIDES[0], *SIDES[1:]), (9, 2, 2))
    w, expected = (
        np.sqrt(la.eigvalsh(A.toarray(), B.toarray(), subset_by_index=[6, 6])[0])
        for A, B in ((system.K, system.M), (whole.K, whole.M))
    )
    assert w == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize(
    ("starts", "welded", "rigid"),
    [
        ([(0.4, 0.03, 0.05)], True, 6),
        ([(0.16, 0.03, 0.05)], False, 9),
        ([(0.4, 0, 0), (0.4, 0.06, 0.1)], False, 7),
        ([(0.4, 0, 0), (0.4, 0.06, 0), (0.4, 0, 0.1)], False, 6),
    ],
    ids=["face", "inside", "line", "corners"],
)
def test_bars_that_meet_a_solid_make_a_scene_that_runs(tmp_path: Path, starts: list, welded: bool, rigid: int) -> None:
    """The draft locked rotations that nodes of a solid have not, and its run was refused; the dense system is known."""
    m = len(starts)
    xyz = np.array([*starts, (0.7, 0.03, 0.05), (0.9, 0.1, 0.1), (0.8, -0.1, 0.02)])
    boom = frame("boom", xyz, [*((k, m + 1) for k in range(1, m + 1)), (m + 1, m + 2), (m + 1, m + 3)])
    run = drafted(tmp_path, [*saved(tmp_path, NEAR, brick_cards(COARSE)), *saved(tmp_path, boom, [])])
    assert run.pipeline.reduce.method == ("craig-bampton" if rigid == 6 else "macneal-rubin")
    system = run.in_dofs.system(run.scene.configurations[0])
    # Each start moves as the node of the solid does; a weld takes the whole face with it.
    n, follows = NEAR.n, np.eye(NEAR.n + boom.n)
    own = np.zeros(n + boom.n, dtype=bool)
    for k, start in enumerate(starts):
        at = int(np.flatnonzero(np.isclose(NEAR.nodes.xyz, start).all(axis=1))[0])
        if welded:
            for node in np.flatnonzero(np.isclose(NEAR.nodes.xyz[:, 0], 0.4)):
                rows, arm = slice(3 * node, 3 * node + 3), NEAR.nodes.xyz[node] - start
                follows[rows], own[rows] = 0.0, True
                follows[rows, n : n + 6] = np.hstack([np.eye(3), np.cross(np.eye(3), arm).T])
        else:
            rows = slice(n + 6 * k, n + 6 * k + 3)
            follows[rows], own[rows] = 0.0, True
            follows[rows, 3 * at : 3 * at + 3] = np.eye(3)
    T = follows[:, ~own]
    K, M = (T.T @ la.block_diag(*(A.toarray() for A in pair)) @ T for pair in ((NEAR.K, boom.K), (NEAR.M, boom.M)))
    expected = la.eigvalsh(K, M)[rigid : rigid + 3]
    found = la.eigvalsh(system.K.toarray(), system.M.toarray())
    assert found[rigid : rigid + 3] == pytest.approx(expected, rel=1e-6) and found[rigid - 1] < 1e-6 * expected[0]
