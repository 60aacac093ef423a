"""Stiffness of layered plates, and of plates beside their nodes, at their nodes against the deck."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations_with_replacement
from pathlib import Path

import numpy as np
import pytest

from tests.pipeline.evidence.test_nodal_plates import BY_NODE, KINDS, NU, E, Mesh, mesh, plane, tapered_box
from tests.pipeline.evidence.test_nodal_stiffness import stiffness
from tests.plates import isotropic_laminate, plate_body

E1, E2, NU12, G12 = 140e9, 9e9, 0.3, 5e9
MAT8 = f"MAT8,8,{E1:.3E},{E2:.3E},{NU12},{G12:.3E},,,1600."
PLIES = ((0.002, 0.0), (0.003, 45.0), (0.001, 90.0))


def energy(strain: np.ndarray, degrees: float) -> float:
    """Twice the energy of a plane strain (3,) with the angle xy, in a ply turned by an angle: by compliances."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    tensor = np.array([[strain[0], strain[2] / 2], [strain[2] / 2, strain[1]]])
    R = np.array([[c, s], [-s, c]])
    turned = R @ tensor @ R.T
    e = np.array([turned[0, 0], turned[1, 1], 2 * turned[0, 1]])
    S = np.array([[1 / E1, -NU12 / E1, 0], [-NU12 / E1, 1 / E2, 0], [0, 0, 1 / G12]])
    return float(e @ np.linalg.solve(S, e))


def laminate(plies: Sequence[tuple[float, float]], angle: float, bottom: float | None = None) -> np.ndarray:
    """Laminate (6, 6) of plies from the bottom, turned as a whole, by Gauss points over each ply."""
    z, found = -sum(t for t, _ in plies) / 2 if bottom is None else bottom, np.zeros((6, 6))
    for t, turn in plies:
        Q = np.zeros((3, 3))
        for i, j in combinations_with_replacement(range(3), 2):
            a, b = np.eye(3)[[i, j]]
            Q[i, j] = Q[j, i] = (energy(a + b, turn + angle) - energy(a - b, turn + angle)) / 4
        for point in (-1, 1):
            here = z + t / 2 * (1 + point / np.sqrt(3))
            found += t / 2 * np.kron([[1, here], [here, here**2]], Q)
        z += t
    return found


def layered(
    made: Mesh, angle: str = "", *, kind: str = "", bottom: str = "", plies: Sequence[object] = PLIES
) -> list[str]:
    plates = [
        f"{'CTRIA3' if len(cell) == 3 else 'CQUAD4'},{k},1," + ",".join(str(node) for node in cell) + f",{angle}"
        for k, cell in enumerate(made.cells, 1)
    ]
    rows = [f",8,{t},{turn}" for t, turn in plies]
    return [*plates, f"PCOMP,1,{bottom},,,,,,{kind}", *rows, MAT8]


EVEN = plane(0.0)
SHAPES = {"plane": EVEN, "box, triangles": tapered_box(triangles=True)}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", SHAPES)
def test_layers(tmp_path: Path, name: str, kind: str) -> None:
    made = SHAPES[name]
    whole = laminate(PLIES, 30.0)
    wrong = {
        "sound": (layered(made, "30."), whole),
        "half": (layered(made, "30.", kind="SYM"), laminate([*PLIES, *PLIES[::-1]], 30.0)),
        "bottom": (layered(made, "", bottom=".001"), laminate(PLIES, 0.0, 0.001)),
        "turned": (layered(made, "60."), whole),
        "upside down": (layered(made, "30.", plies=PLIES[::-1]), whole),
        "other bottom": (layered(made, "30.", bottom="-.002"), whole),
        "bending of one": (layered(made, "30."), whole * np.kron([[1, 1], [1, 1.1]], np.ones((3, 3)))),
    }
    for k, (case, (cards, matrix)) in enumerate(wrong.items()):
        folder = tmp_path / str(k)
        folder.mkdir()
        body = plate_body("part", made.xyz, made.cells, lambda e, matrix=matrix: matrix, kind)
        proof, failed = stiffness(folder, body, cards)
        if k < 3:
            assert (proof.state, proof.label) == ("proven", "stiffness"), (case, proof)
            assert f"at {len(made.xyz)} of {len(made.xyz)} nodes" in proof.remark
        else:
            assert proof.state == "refuted", case
            assert [check.name for check in failed if "stiffness" in check.name] == [BY_NODE], case


@pytest.mark.parametrize("kind", KINDS)
def test_plates_beside_their_nodes(tmp_path: Path, kind: str) -> None:
    made = tapered_box()
    for offset, state in ((0.01, "proven"), (-0.01, "refuted"), (0.012, "refuted"), (0.0, "refuted")):
        folder = tmp_path / str(offset)
        folder.mkdir()
        body = plate_body(
            "part", made.xyz, made.cells, lambda e, offset=offset: isotropic_laminate(E, NU, 0.02, offset=offset), kind
        )
        cards = [
            f"CQUAD4,{k},1," + ",".join(str(node) for node in cell) + ",,.01" for k, cell in enumerate(made.cells, 1)
        ]
        proof, _ = stiffness(folder, body, [*cards, "PSHELL,1,1,.02,1,,1", f"MAT1,1,{E:.4E},,{NU},2700."])
        assert proof.state == state, (offset, proof)
        assert state == "refuted" or proof.label == "stiffness"


@pytest.mark.parametrize(
    ("card", "angle"),
    [
        ("CQUAD4,1,3,{},,,,.02,.03,.02,.02", "thicknesses"),
        ("CQUAD4,1,1,{},3", "a frame"),
        ("CQUAD4,1,2,{}", "other layers"),
    ],
)
def test_plates_that_are_not_read_are_not_compared(tmp_path: Path, card: str, angle: str) -> None:
    """One plate of the deck has what is not read: thicknesses at its corners, a frame, or plies in a smear."""
    made = EVEN
    body = plate_body("part", made.xyz, made.cells, lambda e: (1.0 + (e == 0)) * laminate(PLIES, 0.0))
    cards = layered(made)
    cards[0] = card.format(",".join(str(node) for node in made.cells[0]))
    if angle == "thicknesses":
        cards[0] = cards[0].replace(",,,,", ",,,\n,,,")
    cards += ["PCOMP,2,,,,,,,SMEAR", ",8,.002,0.", "PSHELL,3,8,.01,8"]
    proof, failed = stiffness(tmp_path, body, cards)
    assert proof.state == "proven" and not [check for check in failed if "stiffness" in check.name], angle
    assert proof.label == "stiffness (stretch alone)"


def test_angles_in_skew_quadrilaterals_are_not_compared(tmp_path: Path) -> None:
    """Programs measure them from the first edge, or from the line that halves the angle of the diagonals."""
    made = mesh(([[0, 0, 0], [1.2, 0, 0], [1.6, 0.8, 0], [0.4, 0.8, 0]], 5, 4, 1))
    body = plate_body("part", made.xyz, made.cells, lambda e: laminate(PLIES, 20.0))
    proof, failed = stiffness(tmp_path, body, layered(made, "30."))
    assert proof.state == "proven" and not [check for check in failed if "stiffness" in check.name]
    assert proof.only
