"""Nodes of meshes have the numbers of their file, which meshio drops."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import meshio
import numpy as np
import pytest

from cmsreduce.read import MatrixSource, file_kind, prove_row_order, read_body, read_geometry
from cmsreduce.read.geometry import read_cells

PLACES = {20: (0.0, 0.0, 0.0), 40: (1.0, 0.0, 0.0), 30: (0.0, 2.0, 0.0), 70: (0.0, 0.0, 3.0)}
NODES = "".join(f"{id} {x} {y} {z}\n" for id, (x, y, z) in PLACES.items())
# By the manual of gmsh, and by Kratos' wiki.
FILES = {
    "a22.msh": f"$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n4\n{NODES}$EndNodes\n"
    "$Elements\n1\n1 4 2 0 1 20 40 30 70\n$EndElements\n",
    "a41.msh": "$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n1 4 20 70\n3 1 0 4\n"
    + "".join(f"{id}\n" for id in PLACES)
    + "".join("{} {} {}\n".format(*place) for place in PLACES.values())
    + "$EndNodes\n$Elements\n1 1 1 1\n3 1 4 1\n1 20 40 30 70\n$EndElements\n",
    "a.mdpa": f"Begin Nodes\n{NODES}End Nodes\nBegin Elements Tetrahedra3D4\n1 0 20 40 30 70\nEnd Elements\n",
}


@pytest.mark.parametrize("name", FILES)
def test_numbers_with_gaps_are_those_of_the_file(tmp_path: Path, name: str) -> None:
    """Nodes were counted in order of the file: node 3 of a pipeline was another one than that of gmsh's window."""
    path = tmp_path / name
    path.write_text(FILES[name])
    shape = read_geometry(path)
    nodes = shape.nodes
    # Rows of Kratos are in order of the numbers, those of other programs in order of the file.
    order = sorted(PLACES) if name == "a.mdpa" else list(PLACES)
    assert nodes.id.tolist() == order and shape.rows["translations"].node[::3].tolist() == order
    assert np.array_equal(nodes.xyz, [PLACES[id] for id in nodes.id])
    assert read_cells(path)["tetra"].tolist() == [[20, 40, 30, 70]]


@pytest.mark.parametrize(
    ("name", "kind"), [("SmallDisplacementElement3D4N", "tetra"), ("ShellThickElementCorotational3D4N", "quad")]
)
def test_elements_of_kratos_are_those_of_their_names(tmp_path: Path, name: str, kind: str) -> None:
    """Only by the number of nodes, bricks were lines, so that no face was proposed as a mount."""
    path = tmp_path / "a.mdpa"
    path.write_text(FILES["a.mdpa"].replace("Tetrahedra3D4", name))
    assert {key: cells.tolist() for key, cells in read_cells(path).items()} == {kind: [[20, 40, 30, 70]]}


def test_a_plane_body_has_two_rows_for_each_node(tmp_path: Path) -> None:
    """Programs for plane problems have no row along z; it took a list of all rows."""
    xyz = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 2, 0]])
    meshio.Mesh(xyz, [("quad", [[0, 1, 2, 3]])]).write(tmp_path / "plate.vtu")
    # Six springs of a braced quadrangle, which resist no plane motion of the whole.
    K = np.zeros((8, 8))
    for a, b in combinations(range(4), 2):
        pull = np.zeros((4, 2))
        pull[a] = (xyz[a] - xyz[b])[:2] / np.linalg.norm(xyz[a] - xyz[b])
        pull[b] = -pull[a]
        K += np.outer(pull.ravel(), pull.ravel())
    np.savez(tmp_path / "plate.npz", K=K, M=np.eye(8))
    K_and_M = {what: MatrixSource(tmp_path / "plate.npz", name) for what, name in (("stiffness", "K"), ("mass", "M"))}
    body = read_body("plate", **K_and_M, geometry=tmp_path / "plate.vtu")
    assert list(body.dofs.labels)[:3] == ["1.1", "1.2", "2.1"]
    assert prove_row_order(body).status == "proven"
    xyz[2, 2] = 0.1
    meshio.Mesh(xyz, [("quad", [[0, 1, 2, 3]])]).write(tmp_path / "warped.vtu")
    assert {*read_geometry(tmp_path / "warped.vtu").rows} == {"translations", "six"}


def test_the_version_of_a_gmsh_file_is_no_entry_of_a_matrix(tmp_path: Path) -> None:
    (tmp_path / "a.msh").write_text("$MeshFormat\n4 0 8\n$EndMeshFormat\n$Entities\n0 0 0 0\n$EndEntities\n")
    assert file_kind(tmp_path / "a.msh").name == "mesh"
