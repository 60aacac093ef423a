"""Nodes of meshes have the numbers of their file, which meshio drops."""

from __future__ import annotations

import os
from itertools import combinations
from pathlib import Path

import meshio
import numpy as np
import pytest

from cmsreduce.errors import ReadError
from cmsreduce.read import MatrixSource, file_kind, prove_row_order, read_body, read_geometry
from cmsreduce.read.geometry import read_cells
from cmsreduce.read.libraries import program

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


def refusal(path: Path) -> str:
    """What `program.mesh` says of a file, in a fork of this process: it changes meshio, and a start takes long."""
    reader, writer = os.pipe()
    child = os.fork()
    if not child:
        said = ""
        try:
            program.mesh(str(path))
        except BaseException as error:
            said = str(error) or repr(error)
        os.write(writer, said.encode())
        os._exit(0)
    os.close(writer)
    with os.fdopen(reader, "rb") as pipe:
        said = pipe.read().decode()
    assert os.waitpid(child, 0)[1] == 0
    return said


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
    ("name", "kind"),
    [
        ("SmallDisplacementElement3D4N", "tetra"),
        ("ShellThickElementCorotational3D4N", "quad"),
        ("MembraneElement3D4N", "quad"),
        ("ThermalFace3D4N", "quad"),
    ],
)
def test_elements_of_kratos_are_those_of_their_names(tmp_path: Path, name: str, kind: str) -> None:
    """Only by the number of nodes, bricks were lines, so that no face was proposed as a mount."""
    path = tmp_path / "a.mdpa"
    path.write_text(FILES["a.mdpa"].replace("Tetrahedra3D4", name))
    assert {key: cells.tolist() for key, cells in read_cells(path).items()} == {kind: [[20, 40, 30, 70]]}


@pytest.mark.parametrize(("name", "kind"), [("LineLoadCondition2D3N", "line"), ("MembraneElement3D3N", "triangle")])
def test_lines_of_three_nodes_are_no_triangles(tmp_path: Path, name: str, kind: str) -> None:
    (tmp_path / "a.mdpa").write_text(FILES["a.mdpa"].replace("Tetrahedra3D4", name).replace("30 70\nEnd", "30\nEnd"))
    assert {key: cells.tolist() for key, cells in read_cells(tmp_path / "a.mdpa").items()} == {
        kind: [[20, 40, 30][: 2 if kind == "line" else 3]]
    }


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("20 40 30 70\nEnd", "20 40 25 70\nEnd", "a tetra names node 25, which is not in the file"),
        ("20 40 30 70\nEnd", "20 40 30 71\nEnd", "a tetra names node 71, which is not in the file"),
        ("\n30 ", "\nEnd Nodes\nBegin Nodes\n30 ", "it has 2 blocks of nodes"),
    ],
)
def test_elements_of_kratos_keep_to_the_nodes_of_the_file(tmp_path: Path, old: str, new: str, said: str) -> None:
    """A missing node was replaced by the next one, and those of a second block by others of their places."""
    (tmp_path / "a.mdpa").write_text(FILES["a.mdpa"].replace(old, new))
    with pytest.raises(ReadError, match=said):
        read_geometry(tmp_path / "a.mdpa")


def without_node(name: str, missing: int) -> str:
    """A file of gmsh, in which an element of number 17 names this node."""
    text = FILES.get(name, FILES["a22.msh"])
    if name == "a40.msh":
        head = f"$MeshFormat\n4.0 0 8\n$EndMeshFormat\n$Nodes\n1 4\n1 3 0 4\n{NODES}$EndNodes\n"
        text = f"{head}$Elements\n1 1\n1 3 4 1\n1 20 40 30 70\n$EndElements\n"
    text = text.replace(" 40 30 70\n$End", f" 40 {missing} 70\n$End").replace("\n1 4 2 0", "\n17 4 2 0")
    return text.replace("\n1 20", "\n17 20")


@pytest.mark.parametrize("missing", [0, 25, 71, -1, -5, -50, -70, -71, -72, -140])
@pytest.mark.parametrize("comment", ["", "$Comments\nmade by hand\n$EndComments\n"])
@pytest.mark.parametrize("name", ["a22.msh", "a41.msh", "a40.msh"])
def test_an_element_of_gmsh_with_a_missing_node_is_named(tmp_path: Path, name: str, comment: str, missing: int) -> None:
    """It was "index 70 is out of bounds", or point 0 of the wrong number of points."""
    (tmp_path / name).write_text(comment + without_node(name, missing))
    assert refusal(tmp_path / name).startswith(f"element 17 names node {missing}, which is not in the file")


@pytest.mark.parametrize("name", ["a22.msh", "a41.msh", "a40.msh"])
def test_a_file_of_gmsh_with_a_missing_node_is_refused(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text(without_node(name, 25))
    for read in (read_geometry, lambda path: read_cells(path) or read_geometry(path)):
        with pytest.raises(ReadError, match="element 17 names node 25, which is not in the file"):
            read(tmp_path / name)


@pytest.mark.parametrize("missing", [-1, -4, -5, -6, -7, -8, -9, -12])
@pytest.mark.parametrize("name", ["a22.msh", "a41.msh"])
def test_a_negative_node_of_gmsh_is_no_other_one(tmp_path: Path, name: str, missing: int) -> None:
    """Of nodes 1 to 4, -8 was node 2, as meshio counts from the end of its table."""
    text = FILES[name].replace("4 20 70", "4 1 4")
    for new, old in enumerate(PLACES, start=1):
        text = text.replace(f"\n{old} ", f"\n{new} ").replace(f"\n{old}\n", f"\n{new}\n")
    (tmp_path / name).write_text(text.replace(" 20 40 30 70\n$End", f" 1 2 3 {missing}\n$End"))
    assert refusal(tmp_path / name).startswith(f"element 1 names node {missing}, which is not in the file")


@pytest.mark.parametrize("tags", ["2 0 1", "5 0 1 3 2 -3"])
def test_a_ghost_of_gmsh_has_a_negative_partition(tmp_path: Path, tags: str) -> None:
    (tmp_path / "a.msh").write_text(FILES["a22.msh"].replace("1 4 2 0 1", f"1 4 {tags}"))
    assert read_cells(tmp_path / "a.msh")["tetra"].tolist() == [[20, 40, 30, 70]]


@pytest.mark.parametrize("name", ["a22.msh", "a41.msh"])
def test_large_numbers_need_no_more_than_the_table_of_meshio(tmp_path: Path, name: str) -> None:
    """A table of twice the last number was refused as "more memory than its bytes justify", 4.1 from 5e7."""
    text = FILES[name]
    for id in PLACES:
        text = text.replace(f"\n{id} ", f"\n{10**8 + id} ").replace(f" {id}", f" {10**8 + id}")
        text = text.replace(f"\n{id}\n", f"\n{10**8 + id}\n")
    (tmp_path / name).write_text(text)
    assert read_geometry(tmp_path / name).nodes.id.tolist() == [10**8 + id for id in PLACES]
    assert read_cells(tmp_path / name)["tetra"].tolist() == [[10**8 + id for id in (20, 40, 30, 70)]]


@pytest.mark.parametrize("name", ["a22.msh", "a.vtu"])
def test_a_meshio_without_numbers_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """Where the numbers of nodes are those of the file, places are no substitute; other meshes need none."""
    points = np.array(list(PLACES.values()))
    meshio.Mesh(points, [("tetra", [[0, 1, 2, 3]])]).write(tmp_path / "a.vtu")
    (tmp_path / "a22.msh").write_text(FILES["a22.msh"])

    def renamed() -> list[object]:
        raise AttributeError("module 'meshio.mdpa._mdpa' has no attribute '_read_nodes'")

    monkeypatch.setattr(program, "keep_numbers", renamed)
    if name == "a.vtu":
        assert np.array_equal(program.mesh(str(tmp_path / name))["points"], points)
    else:
        with pytest.raises(ValueError, match=r"does not give the numbers of nodes \(.*_read_nodes.*pip install meshio"):
            program.mesh(str(tmp_path / name))


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


def test_node_numbers_too_large_to_read_are_named(tmp_path: Path) -> None:
    """The message was that of a file of no known format."""
    text = FILES["a41.msh"].replace("70", "2000000070")
    (tmp_path / "a.msh").write_text(text)
    with pytest.raises(ReadError, match=r"its 4 nodes have numbers up to 2000000070, .*RenumberMeshNodes"):
        read_geometry(tmp_path / "a.msh")
