"""Radioss: the matrices of /FXBODY, read by the rules of its reader, are the finite elements' condensed ones."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cmsreduce.errors import WriteError
from cmsreduce.model import Damping, DofTable, FEModel, Nodes, Units, in_units
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.reduce import CraigBampton
from cmsreduce.write import convert, write_component
from cmsreduce.write.targets import conversion
from tests.frames import frame, line, rotation

XYZ = [[0.0, 0.0, 0.0], [0.4, 0.0, 0.1], [0.8, 0.1, 0.1], [1.2, 0.1, 0.0]]
BARS = [(1, 2), (2, 3), (3, 4)]
FACES = {"left": 1, "right": 4, "knee": 2}


def body(axes: np.ndarray | None = None, held: tuple[int, ...] = (), **faces: object) -> FEModel:
    return frame("bent", XYZ, BARS, faces or FACES, axes=axes, held=held, damping=Damping(modal=(0.01,)))


def component(folder: Path, model: FEModel) -> Path:
    rows = np.unique(np.concatenate([model.interface_rows(face) for face in model.interfaces]))
    modes = orthogonalise(CraigBampton(1e9).reduce(model, rows))
    path = folder / "bent.h5"
    write_component(path, modes, nodes=(), inputs={}, outputs={}, checks=(), provenance={})
    return path


def read(path: Path) -> dict[str, dict[tuple[int, int, int, int], float]]:
    """READ_PCH_FILE: fields by columns; comments and empty lines are skipped; only KAAX and MAAX are known."""
    lines = [line for line in path.read_text(encoding="ascii").splitlines() if line.strip() and line[0] not in "#$"]
    assert path.name.endswith("pch") and all(len(line) <= 100 for line in lines)
    assert int(lines[0][24:32]) == 6 and int(lines[0][32:40]) < 3
    found: dict[str, dict[tuple[int, int, int, int], float]] = {}
    for text in lines:
        if text.startswith("DMIG "):
            continue
        if text.startswith("DMIG*"):
            name, node, part = text[8:24].strip(), int(text[24:40]), int(text[40:56])
        else:
            assert text[0] == "*" and name in ("KAAX", "MAAX")
            key = node, part, int(text[8:24]), int(text[24:40])
            found.setdefault(name, {})[key] = float(text[40:56].replace("D", "E"))
    return found


def test_the_condensed_finite_elements_come_back(tmp_path: Path) -> None:
    """Along the basic axes and in SI, whatever those of the file; nine digits of a card."""
    axes = np.array([rotation([1, k, 2], 0.3 * k + 0.2) for k in range(len(XYZ))])
    turned = in_units(body(axes), Units.parse("mm-t-s"))
    (path,) = convert(component(tmp_path, turned), tmp_path / "bent_fxb.pch")
    found = read(path)
    plain = body()
    K, M = plain.K.toarray(), plain.M.toarray()
    ends = np.flatnonzero(np.isin(plain.dofs.node, list(FACES.values())))
    inner = np.setdiff1d(np.arange(len(K)), ends)
    G = np.zeros((len(K), ends.size))
    G[ends], G[inner] = np.eye(ends.size), -np.linalg.solve(K[np.ix_(inner, inner)], K[np.ix_(inner, ends)])
    labels = [(plain.dofs.node[row], plain.dofs.component[row]) for row in ends]
    for name, whole in (("KAAX", K), ("MAAX", M)):
        read_back = np.zeros((ends.size, ends.size))
        for (node, part, other, also), value in found[name].items():
            a, b = labels.index((node, part)), labels.index((other, also))
            read_back[a, b] = read_back[b, a] = value
        expected = G.T @ whole @ G
        np.testing.assert_allclose(read_back, expected, rtol=0, atol=2e-9 * abs(expected).max(), err_msg=name)
    # Every dof has stiffness: Radioss counts its modes by these entries.
    assert {key[:2] for key in found["KAAX"]} == set(labels)
    for node, place in zip((1, 2, 4), (XYZ[0], XYZ[1], XYZ[3]), strict=True):
        (line,) = (line for line in path.read_text().splitlines() if line.split()[:2] == ["$", str(node)])
        np.testing.assert_allclose([float(word) for word in line.split()[2:]], place, atol=1e-12)


def test_the_modes_that_are_left_out_are_said(tmp_path: Path) -> None:
    made = conversion(component(tmp_path, body()), tmp_path / "bent_fxb.pch")
    plain = body()
    inner = np.flatnonzero(~np.isin(plain.dofs.node, list(FACES.values())))
    held = [A.toarray()[np.ix_(inner, inner)] for A in (plain.K, plain.M)]
    lowest = np.sqrt(np.linalg.eigvals(np.linalg.solve(held[1], held[0])).real.min()) / 2 / np.pi
    (note,) = made.notes
    found = re.search(rf"of {inner.size} modes with the interfaces held, the lowest at (\S+) Hz", note)
    assert found and float(found[1]) == pytest.approx(lowest, rel=1e-5)


@pytest.mark.parametrize(
    ("model", "message"),
    [
        (lambda: body(left=1), "three interface nodes that are not in one line, and this body has 1;"),
        (lambda: body(left=1, right=4), "three interface nodes that are not in one line, and this body has 2;"),
        (lambda: line("bent", [0.2, 0, 1], [1, 0.7, 2], 4, interfaces={"a": (1, 3, 5)}), "has 3 in a line; give it"),
        (
            lambda: body(held=(3,)),
            "as a free body, and this one has 0 of the six .* so that its supports would be lost",
        ),
        (
            lambda: renumbered(2**31),
            f"Radioss has no node numbers above {2**31 - 1}, and this body has node {2**31 + 4}",
        ),
    ],
    ids=["one", "two", "in a line", "held", "long number"],
)
def test_bodies_that_radioss_cannot_take_are_refused(
    tmp_path: Path, model: Callable[[], FEModel], message: str
) -> None:
    """It describes the turned body by the places of its nodes, projects supports away, and counts in 32 bits."""
    with pytest.raises(WriteError, match=message):
        convert(component(tmp_path, model()), tmp_path / "bent_fxb.pch")
    assert not (tmp_path / "bent_fxb.pch").exists()


def renumbered(by: int) -> FEModel:
    plain = body()
    assert plain.nodes is not None
    return replace(
        plain,
        dofs=DofTable(plain.dofs.node + by, plain.dofs.component),
        nodes=Nodes(plain.nodes.id + by, plain.nodes.xyz, plain.nodes.frame),
        interfaces={name: replace(face, node=face.node + by) for name, face in plain.interfaces.items()},
    )


def test_a_body_of_interface_nodes_alone_leaves_out_no_modes(tmp_path: Path) -> None:
    whole = component(tmp_path, frame("bent", XYZ[:3], BARS[:2], {"left": 1, "right": 2, "knee": 3}))
    (path,) = convert(whole, tmp_path / "bent_fxb.pch")
    assert "it leaves out the damping" in path.read_text() and set(read(path)) == {"KAAX", "MAAX"}
