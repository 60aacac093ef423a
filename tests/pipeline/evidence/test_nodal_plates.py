"""Stiffness of plates at their nodes against the deck, by two formulations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.spatial.transform import Rotation

from cmsreduce.model import FEModel, Nodes, cross_matrix
from cmsreduce.pipeline.evidence.deck_agreement import statement_of
from cmsreduce.pipeline.evidence.nodal_stiffness import nodes_against_deck
from tests.pipeline.bodies.decks import write_deck_body
from tests.pipeline.evidence.test_nodal_stiffness import BY_NODE, stiffness
from tests.plates import isotropic_laminate, plate_body

E, NU = 7e10, 0.3
THICK = {1: 0.02, 2: 0.008, 3: 0.03}
KINDS = ("mindlin", "kirchhoff")
TURN = Rotation.from_euler("xyz", [20, 30, 40], degrees=True).as_matrix()


@dataclass(frozen=True)
class Mesh:
    """Places of the nodes, from 1, corners of each plate, and its property."""

    xyz: np.ndarray
    cells: list[list[int]]
    property: list[int]


def mesh(*panels: tuple[Sequence[Sequence[float]], int, int, int], triangles: bool = False, uneven: float = 0) -> Mesh:
    """Panels by their corners, cells each way and property; nodes inside moved in the plane by a share of a cell."""
    random, numbers = np.random.default_rng(1), {}
    cells, properties = [], []
    for corners, across, along, number in panels:
        c = np.array(corners, dtype=float)
        ids = np.zeros((across + 1, along + 1), dtype=int)
        for i, j in np.ndindex(ids.shape):
            a, b = np.array([i / across, j / along])
            if 0 < i < across and 0 < j < along:
                a, b = np.array([a, b]) + uneven * random.uniform(-1, 1, 2) / [across, along]
            at = (1 - a) * (1 - b) * c[0] + a * (1 - b) * c[1] + a * b * c[2] + (1 - a) * b * c[3]
            # As the deck prints them.
            ids[i, j] = numbers.setdefault(tuple(np.round(at, 7) + 0.0), len(numbers) + 1)
        for i, j in np.ndindex(across, along):
            q = [int(ids[k]) for k in ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1))]
            made = [[q[0], q[1], q[2]], [q[0], q[2], q[3]]] if triangles else [q]
            cells += made
            properties += [number] * len(made)
    return Mesh(np.array(list(numbers)), cells, properties)


def plane(uneven: float = 0.3, **options: object) -> Mesh:
    """A plate of three widths."""
    widths = [[[0, y, 0], [1.2, y, 0], [1.2, y + 0.4, 0], [0, y + 0.4, 0]] for y in (0.0, 0.4, 0.8)]
    return mesh(*((corners, 5, 3, k + 1) for k, corners in enumerate(widths)), uneven=uneven, **options)


def tapered_box(**options: object) -> Mesh:
    """Four panels, along no axis, whose free ends are open."""
    near = np.array([[0, 0, 0], [0, 0.6, 0], [0, 0.6, 0.4], [0, 0, 0.4]])
    far = near * 0.7 + [1.5, 0, 0]
    sides = [[near[k], far[k], far[(k + 1) % 4], near[(k + 1) % 4]] for k in range(4)]
    found = mesh(*((corners, 5, 3, (1, 2, 3, 2)[k]) for k, corners in enumerate(sides)), **options)
    return replace(found, xyz=found.xyz @ TURN.T)


def stiffened() -> Mesh:
    """A plate with a rib, at a line of edges."""
    return mesh(
        ([[0, 0, 0], [1, 0, 0], [1, 0.8, 0], [0, 0.8, 0]], 4, 4, 1),
        ([[0, 0.4, 0], [1, 0.4, 0], [1, 0.4, 0.3], [0, 0.4, 0.3]], 4, 2, 2),
    )


def tube() -> Mesh:
    """Twelve strips around a circle; their folds are blunt."""
    angle = np.arange(13) * np.pi / 6
    ring = 0.5 * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    up = np.array([0, 0, 1.0])
    return mesh(*(([ring[k], ring[k + 1], ring[k + 1] + up, ring[k] + up], 1, 4, 1) for k in range(12)))


def dome() -> Mesh:
    found = mesh(([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], 4, 4, 1), triangles=True)
    x, y, _ = found.xyz.T
    return replace(found, xyz=np.stack([x, y, 0.3 - 0.5 * (x - 0.5) ** 2 - 0.3 * (y - 0.4) ** 2], axis=1))


def cards(made: Mesh, ratios: dict[int, float] | None = None, thick: dict[int, float] = THICK) -> list[str]:
    plates = [
        f"{'CTRIA3' if len(cell) == 3 else 'CQUAD4'},{k},{number}," + ",".join(str(node) for node in cell)
        for k, (cell, number) in enumerate(zip(made.cells, made.property, strict=True), 1)
    ]
    shells = [f"PSHELL,{k},1,{t},1,{(ratios or {}).get(k, '')},1" for k, t in thick.items()]
    return [*plates, *shells, f"MAT1,1,{E:.4E},,{NU},2700."]


def body(made: Mesh, kind: str, bending: Callable[[int], float] = lambda e: 1.0, **options: float) -> FEModel:
    return plate_body(
        "part",
        made.xyz,
        made.cells,
        lambda e: isotropic_laminate(E, NU, THICK[made.property[e]], bending=bending(e)),
        kind,
        **options,
    )


SOUND = {
    "plane": plane(),
    "plane, triangles": plane(triangles=True),
    "box": tapered_box(),
    "box, triangles": tapered_box(triangles=True, uneven=0.2),
    "rib": stiffened(),
    "tube": tube(),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", SOUND)
def test_plates_in_any_formulation(tmp_path: Path, name: str, kind: str) -> None:
    made = SOUND[name]
    proof, failed = stiffness(tmp_path, body(made, kind), cards(made))
    assert (proof.state, proof.label) == ("proven", "stiffness"), proof
    assert f"at {len(made.xyz)} of {len(made.xyz)} nodes" in proof.remark
    assert not [check for check in failed if "stiffness" in check.name]


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", SOUND)
def test_bending_of_one_panel_or_plate(tmp_path: Path, name: str, kind: str) -> None:
    made = SOUND[name]
    last = max(made.property)
    changes: tuple[Callable[[int], float], ...] = (
        lambda e: 4.0 if made.property[e] == last else 1.0,
        lambda e: 0.98 if made.property[e] == last else 1.0,
        lambda e: 2.0 if e == len(made.cells) // 2 else 1.0,
    )
    for k, change in enumerate(changes):
        folder = tmp_path / str(k)
        folder.mkdir()
        proof, failed = stiffness(folder, body(made, kind, change), cards(made))
        assert proof.state == "refuted", (k, proof)
        # The whole body keeps the energy of its strains.
        (check,) = (check for check in failed if "stiffness" in check.name)
        assert check.name == BY_NODE
        assert "times that of the deck" in check.note or "forces that the deck has not" in check.note


def test_thickness_and_bending_ratio_of_the_deck(tmp_path: Path) -> None:
    made = tapered_box()
    sound = body(made, "mindlin")
    for name, deck in (
        ("ratio", cards(made, {1: 1.5, 2: 1.5, 3: 1.5})),
        # Twice as thick at half the modulus: the stretch is the same, the bending four times that.
        ("thickness", [*(line.replace("PSHELL,2,1,0.008,1", "PSHELL,2,2,.016,2") for line in cards(made)), SOFT]),
    ):
        folder = tmp_path / name
        folder.mkdir()
        proof, failed = stiffness(folder, sound, deck)
        assert proof.state == "refuted" and [c.name for c in failed if "stiffness" in c.name] == [BY_NODE], name


@pytest.mark.parametrize("share", [False, True])
@pytest.mark.parametrize("triangles", [False, True])
def test_thickness_of_single_plates(tmp_path: Path, share: bool, triangles: bool) -> None:
    """The same at all corners, as programs for meshes write it; or a share of that of the property."""
    made = plane(triangles=triangles)
    deck = ["PSHELL,1,1,.5,1,,1", f"MAT1,1,{E:.4E},,{NU},2700."]
    for k, (cell, number) in enumerate(zip(made.cells, made.property, strict=True), 1):
        thick = f"{THICK[number] / 0.5 if share else THICK[number]}"
        name = "CTRIA3" if len(cell) == 3 else "CQUAD4"
        corners = [*map(str, cell), "", "", ""][:6]
        deck += [f"{name},{k},1," + ",".join(corners), f",,{'1' if share else ''}," + ",".join([thick] * len(cell))]
    for factor, state in ((1.0, "proven"), (1.02, "refuted")):
        folder = tmp_path / str(factor)
        folder.mkdir()
        proof, _ = stiffness(folder, body(made, "mindlin", lambda e, by=factor: by if e == 7 else 1.0), deck)
        assert proof.state == state and proof.label == "stiffness", proof
        assert state == "refuted" or f"at {len(made.xyz)} of {len(made.xyz)} nodes" in proof.remark


SOFT = f"MAT1,2,{E / 2:.4E},,{NU},2700."


@pytest.mark.parametrize("uneven", [0.0, 0.3])
def test_elements_that_fail_the_patch_test_in_uneven_shapes_are_not_compared(tmp_path: Path, uneven: float) -> None:
    made = plane(uneven)
    proof, failed = stiffness(tmp_path, body(made, "no patch test"), cards(made))
    assert proof.state == "proven" and not [check for check in failed if "stiffness" in check.name]
    assert proof.label == ("stiffness (stretch alone)" if uneven else "stiffness")


def test_plates_without_area_add_nothing(tmp_path: Path) -> None:
    made = plane()
    extra = ["CQUAD4,900,1,1,2,2,1", "CQUAD4,901,1,5,5,5,5", "CTRIA3,902,1,3,4,4"]
    for shear in ("1", ""):
        folder = tmp_path / f"shear{shear}"
        folder.mkdir()
        given = [card.removesuffix(",1") + f",{shear}" if card.startswith("PSHELL") else card for card in cards(made)]
        proof, _ = stiffness(folder, body(made, "kirchhoff"), [*given, *extra])
        assert proof.state == "proven", proof


def test_bending_of_curved_panels_is_not_compared(tmp_path: Path) -> None:
    made = dome()
    proof, failed = stiffness(tmp_path, body(made, "kirchhoff"), cards(made))
    assert proof.state == "proven" and not [check for check in failed if "stiffness" in check.name]
    assert proof.label == "stiffness (stretch alone)"


@pytest.mark.parametrize("kind", KINDS)
def test_panels_that_are_nearly_flat(tmp_path: Path, kind: str) -> None:
    """Plates a thousand times wider than thick stretch by a turn of 1e-4."""
    made = dome()
    made = replace(made, xyz=made.xyz * [1, 1, 3e-4])
    thin = dict.fromkeys(THICK, 2e-4)
    sound = plate_body("part", made.xyz, made.cells, lambda e: isotropic_laminate(E, NU, 2e-4), kind)
    path = write_deck_body(tmp_path, sound, cards(made, thick=thin)).parent / "deck.bdf"
    energy = statement_of(path, sound)[1]
    assert energy is not None and energy.at_nodes is not None
    found = nodes_against_deck(sound, energy.at_nodes)
    assert found is not None and found.check.passed and found.compared == len(made.xyz), found


@pytest.mark.parametrize("kind", KINDS)
def test_nodes_without_rows_for_turns_about_the_normal(tmp_path: Path, kind: str) -> None:
    made = plane()
    free = body(made, kind, drilling=0.0)
    rows = np.flatnonzero(free.dofs.component != 6)
    cut = replace(free, K=free.K[rows][:, rows], M=free.M[rows][:, rows], dofs=free.dofs[rows])
    proof, _ = stiffness(tmp_path, cut, cards(made))
    assert (proof.state, proof.label) == ("proven", "stiffness"), proof


@pytest.mark.parametrize("kind", KINDS)
def test_held_edges(tmp_path: Path, kind: str) -> None:
    made = plane()
    free = body(made, kind)
    held = np.flatnonzero(made.xyz[:, 0] == 0) + 1
    supports = [f"SPC1,1,123456,{node}" for node in held]
    for name, change, state in (
        ("sound", lambda e: 1.0, "proven"),
        ("wrong", lambda e: 1.0 + (made.property[e] == 2), "refuted"),
    ):
        folder = tmp_path / name
        folder.mkdir()
        free = body(made, kind, change)
        rows = np.flatnonzero(~np.isin(free.dofs.node, held))
        cut = replace(free, K=free.K[rows][:, rows], M=free.M[rows][:, rows], dofs=free.dofs[rows])
        proof, failed = stiffness(folder, cut, [*cards(made), *supports])
        assert proof.state == state, (name, proof, failed)
        assert state == "refuted" or f"at {len(made.xyz) - held.size} of" in proof.remark, proof


def test_coordinates_of_few_digits_refute_no_thin_plate(tmp_path: Path) -> None:
    """The matrix is of better coordinates than the deck prints: plates a hundred times wider than thick shear."""
    made = plane(0.0)
    turned = made.xyz @ TURN.T
    thin = dict.fromkeys(THICK, 0.002)
    sound = plate_body("part", turned, made.cells, lambda e: isotropic_laminate(E, NU, 0.002), "mindlin")
    assert sound.nodes is not None
    coarse = Nodes.in_basic(sound.nodes.id, turned)
    path = write_deck_body(tmp_path, replace(sound, nodes=coarse), cards(made, thick=thin)).parent / "deck.bdf"
    printed = Nodes.in_basic(coarse.id, np.round(turned, 6), 5e-7)
    energy = statement_of(path, replace(sound, nodes=printed))[1]
    assert energy is not None and energy.at_nodes is not None
    found = nodes_against_deck(replace(sound, nodes=printed), energy.at_nodes)
    assert found is None or found.check.passed


@pytest.mark.parametrize("kind", KINDS)
def test_displacement_frames(tmp_path: Path, kind: str) -> None:
    """Rows along other axes at each node."""
    made = tapered_box()
    for change, passed in ((lambda e: 1.0, True), (lambda e: 1.0 + 0.1 * (e == 7), False)):
        free = body(made, kind, change)
        assert free.nodes is not None
        frames = Rotation.random(len(made.xyz), random_state=3).as_matrix()
        nodes = Nodes(free.nodes.id, free.nodes.xyz, frames)
        F = sp.block_diag([frame for frame in frames for _ in range(2)], format="csc")
        placed = replace(free, K=sp.csc_array(F @ free.K @ F.T), nodes=nodes)
        path = write_deck_body(tmp_path, free, cards(made)).parent / "deck.bdf"
        energy = statement_of(path, placed)[1]
        assert energy is not None and energy.at_nodes is not None
        found = nodes_against_deck(placed, energy.at_nodes)
        assert found is not None and found.check.passed == passed
        assert found.compared == len(made.xyz) and found.bending.all()


@pytest.mark.parametrize("kind", KINDS)
def test_nodes_without_rows_make_those_beside_them_unknown(tmp_path: Path, kind: str) -> None:
    """Two nodes follow a third, or are condensed; panels away from them are compared."""
    made = tapered_box()
    lost = np.array([30, 31])
    for change, passed in ((lambda e: 1.0, True), (lambda e: 1.0 + (made.property[e] == 3), False)):
        free = body(made, kind, change)
        out = np.isin(free.dofs.node, lost)
        a, o = np.flatnonzero(~out), np.flatnonzero(out)
        K = free.K.toarray()
        T = np.zeros((free.n, a.size))
        T[a, np.arange(a.size)] = 1.0
        for how in ("condensed", "led"):
            if how == "condensed":
                T[o] = -np.linalg.solve(K[np.ix_(o, o)], K[np.ix_(o, a)])
            else:
                first = free.dofs[a].rows([1] * 6, range(1, 7))
                T[o] = 0.0
                for node in lost:
                    arm = cross_matrix(made.xyz[node - 1] - made.xyz[0])
                    rows = free.dofs.rows([node] * 6, range(1, 7))
                    T[np.ix_(rows, first)] = np.block([[np.eye(3), -arm], [np.zeros((3, 3)), np.eye(3)]])
            reduced = T.T @ K @ T
            left = replace(
                free, K=sp.csc_array((reduced + reduced.T) / 2), M=sp.eye_array(a.size, format="csc"), dofs=free.dofs[a]
            )
            led = [] if how == "condensed" else ["RBE2,900,1,123456,30,31"]
            path = write_deck_body(tmp_path, free, [*cards(made), *led]).parent / "deck.bdf"
            energy = statement_of(path, left)[1]
            assert energy is not None and energy.at_nodes is not None
            found = nodes_against_deck(left, energy.at_nodes)
            assert found is not None and found.check.passed == passed, (how, found)
            assert 20 < found.compared < found.nodes
