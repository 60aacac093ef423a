"""Nodes, rows and elements of decks and of meshes of other programs."""

from __future__ import annotations

from pathlib import Path

import h5py
import meshio
import numpy as np
import pytest

from cmsreduce.errors import ReadError
from cmsreduce.read import detect_format, read_cells, read_geometry
from cmsreduce.read.formats import CELL_CORNERS

FRD_LONG = """    1C
    1UPGM               CalculiX
    2C                             3                                     1
 -1         4 0.00000E+00 1.00000E+00 3.33333E-01
 -1        17 2.50000E-01-1.50000E+00 8.00000E+00
 -1         2 1.00000E+02 0.00000E+00-1.00000E-03
 -3
    3C                             0                                     1
 -3
"""
FRD_SHORT = """    1C
    2C                             1                                     0
 -1    4 0.00000E+00 1.00000E+00 2.00000E+00
 -3
"""


def write(tmp_path: Path, name: str, text: str) -> Path:
    path = tmp_path / name
    path.write_text(text)
    return path


def test_frd_nodes_in_long_and_short_format(tmp_path: Path) -> None:
    nodes = read_geometry(write(tmp_path, "a.frd", FRD_LONG)).nodes
    assert nodes.id.tolist() == [4, 17, 2]
    np.testing.assert_array_equal(nodes.xyz, [[0, 1, 0.333333], [0.25, -1.5, 8], [100, 0, -0.001]])
    # All coordinates have six digits, 100 as well.
    assert nodes.xyz_rounding == pytest.approx(5e-4)
    nodes = read_geometry(write(tmp_path, "b.frd", FRD_SHORT)).nodes
    assert (nodes.id.tolist(), nodes.xyz.tolist()) == ([4], [[0, 1, 2]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (FRD_LONG.replace("     3   ", "     4   ", 1), "4 nodes are announced and 3 are there"),
        (FRD_LONG.replace("8.00000E+00", "8.00x00E+00"), r"line 5: .* is no node"),
        ("    1C\n", "no node block"),
        (FRD_LONG.replace("     1\n", "     2\n", 1), "binary"),
    ],
)
def test_damaged_frd_is_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ReadError, match=message):
        read_geometry(write(tmp_path, "a.frd", text))


FLAT = """*HEADING
GRID of beams
*NODE, NSET=all
1, 0., 1.
** comment
 7 ,2.5d-1,,-3.
*ELEMENT, TYPE=B31
1, 1, 7
*node
9,1,1,1
"""
PARTS = """*Heading
*Part, name=arm
*Node
 1, 1., 0., 0.
 2, 2., 0., 0.
*End Part
*Assembly, name=Assembly
*Instance, name=arm-1, part=ARM
 0., 0., 5.
 0., 0., 5., 0., 0., 6., 90.
*End Instance
*Node
 50, 7., 7., 7.
*End Assembly
"""


@pytest.mark.parametrize(
    ("text", "ids", "xyz"),
    [
        (FLAT, [1, 7, 9], [[0, 1, 0], [0.25, 0, -3], [1, 1, 1]]),
        (PARTS, [1, 2, 50], [[0, 1, 5], [0, 2, 5], [7, 7, 7]]),
        ("*INCLUDE, INPUT=other.msh\n*NODE\n3,3.\n", [8, 3], [[8, 0, 0], [3, 0, 0]]),
        # On two lines, and a file in a folder that names one beside the deck.
        ("*INCLUDE,\n INPUT=sub/first.inp\n", [8, 3], [[8, 0, 0], [3, 0, 0]]),
        ("*NODE, INPUT=nodes.txt\n*STEP\n", [5, 6], [[5, 1, 0], [6, 2, 0]]),
        ("*INCLUDE, INPUT=sub/second.inp\n", [5, 6], [[5, 1, 0], [6, 2, 0]]),
    ],
)
def test_abaqus_and_calculix_input(tmp_path: Path, text: str, ids: list[int], xyz: list[list[float]]) -> None:
    write(tmp_path, "other.msh", "*NODE\n8,8.\n")
    (tmp_path / "sub").mkdir()
    write(tmp_path, "sub/first.inp", "*INCLUDE, INPUT=other.msh\n*NODE\n3,3.\n")
    write(tmp_path, "sub/second.inp", "*NODE, INPUT=nodes.txt\n")
    write(tmp_path, "nodes.txt", "5,5.,1.\n** comment\n6,6.,2.\n")
    nodes = read_geometry(write(tmp_path, "model.inp", text)).nodes
    assert nodes.id.tolist() == ids
    np.testing.assert_allclose(nodes.xyz, xyz, atol=1e-14)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (PARTS.replace(" 50, 7.", " 2, 7."), r"node 2 has two places"),
        (
            PARTS.replace("0., 0., 6., 90.", "0., 0., 5., 90."),
            r"line 8: \*Instance: .* axis of rotation are at one place",
        ),
        ("*NODE\n1,0.,x\n", r"line 2: '1,0.,x' is no node"),
        ("*NODE\n2305843009213693952,0.,0.\n", r"line 2: '2305843009213693952,0.,0.' is no node"),
        ("*NODE\n1,0.\n*NGEN\n1,5,1\n", "line 3: \\*NGEN: generated nodes are not read"),
        (
            "*NODE\n1,0.\n*TRANSFORM, NSET=1, TYPE=C\n*BOUNDARY\n1, 2\n",
            r"line 3: \*TRANSFORM: its line needs two points, 6 numbers",
        ),
        (
            "*NODE\n1,0.\n*TRANSFORM, NSET=1\n1.,0.,0.,2.,0.,0.\n*BOUNDARY\n1, 2\n",
            "line 3: .* its two points give no axes",
        ),
        (
            "*NODE\n1,0.,0.,3.\n*TRANSFORM, NSET=1, TYPE=C\n0.,0.,0.,0.,0.,1.\n*BOUNDARY\n1, 2\n",
            "node 1 lies on the axis of the cylinder, .* hold it along axes of TYPE=R",
        ),
        (
            "*NODE\n1,0.\n*ELEMENT, TYPE=DCOUP3D, ELSET=D\n7,1\n*DISTRIBUTING COUPLING, ELSET=D\n9,1.\n",
            r"line 5: \*DISTRIBUTING COUPLING: a line needs a node or a set of nodes of the deck, and a weight",
        ),
        (
            "*NODE\n1,0.\n*CYCLIC SYMMETRY MODEL, N=4, TIE=T1\n0.,0.,0.,0.,0.,1.\n",
            r"line 3: \*CYCLIC SYMMETRY MODEL: the matrices are those of one sector.* mesh the whole body",
        ),
        ("*NODE, SYSTEM=C\n1,0.\n", "write rectangular ones"),
        ("*HEADING\n*STEP\n", "there are no nodes in it"),
        ("*HEADING\n*INCLUDE, INPUT=gone.inp\n", r"line 2: \*INCLUDE: the file 'gone.inp' is missing: there is no"),
        (f"*INCLUDE, INPUT={300 * 'a'}.inp\n", r"line 1: \*INCLUDE: the file 'aaa"),
        ("*INCLUDE,\nINPUT=sub/one.inp\n", r"one.inp, line 2: \*INCLUDE: the file 'gone.inp' is missing: .* or "),
        ("*NODE\n1,0.\n*INCLUDE\n", r"line 3: \*INCLUDE names no file; write \*INCLUDE, INPUT=FILE"),
        ("*NODE, INPUT=gone.txt\n*STEP\n", r"line 1: \*NODE: the file 'gone.txt' is missing: there is no"),
        ("*INCLUDE, INPUT=model.inp\n", "includes itself"),
    ],
)
def test_input_that_would_give_wrong_nodes_is_refused(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "sub").mkdir()
    write(tmp_path, "sub/one.inp", "*HEADING\n*INCLUDE, INPUT=gone.inp\n")
    with pytest.raises(ReadError, match=message):
        read_geometry(write(tmp_path, "model.inp", text))


def test_a_node_held_along_all_axes_of_its_own_is_held(tmp_path: Path) -> None:
    text = "*NODE\n1,0.\n2,1.\n*NSET, NSET=E\n1, 2\n*TRANSFORM, NSET=E, TYPE=C\n0.,0.,0.,0.,0.,1.\n*BOUNDARY\n1, 1, 3\n"
    constrained = read_geometry(write(tmp_path, "model.inp", text)).constrained
    assert constrained is not None
    assert constrained.labels == ["1.1", "1.2", "1.3"]


def test_axes_of_a_support_are_those_of_transform(tmp_path: Path) -> None:
    """The radius, the way around, and the axis of a cylinder through (1, 0, 0) along y; and axes of two points."""
    text = "*NODE\n1,1.,5.,2.\n2,0.\n*TRANSFORM, NSET=1, TYPE=C\n1.,0.,0.,1.,3.,0.\n"
    text += "*TRANSFORM, NSET=2\n0.,2.,0.,3.,1.,0.\n"
    turned = read_geometry(write(tmp_path, "model.inp", f"{text}*BOUNDARY\n1, 1\n2, 2, 3\n")).turned
    np.testing.assert_allclose(turned[1], [[0, 0, 1], [1, 0, 0], [0, 1, 0]], atol=1e-15)
    np.testing.assert_allclose(turned[2], [[0, 1, 0], [1, 0, 0], [0, 0, -1]], atol=1e-15)


def test_other_meshes_are_numbered_from_one(tmp_path: Path) -> None:
    path = tmp_path / "mesh.vtk"
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1 / 3, 0]])
    meshio.Mesh(points, [("triangle", [[0, 1, 2]])]).write(path)
    nodes = read_geometry(path).nodes
    assert nodes.id.tolist() == [1, 2, 3]
    np.testing.assert_array_equal(nodes.xyz, points)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("a.vtk", "rubbish", "no geometry in a format that is known"),
        ("a.what", "rubbish", "no geometry in a format that is known"),
        ("a.bdf", "CQUAD4,1\n", "neither a NASTRAN deck"),
    ],
)
def test_unknown_files_are_refused_without_a_word_on_the_terminal(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], name: str, text: str, message: str
) -> None:
    with pytest.raises(ReadError, match=message):
        read_geometry(write(tmp_path, name, text))
    assert capfd.readouterr() == ("", "")


def test_nodes_that_count_from_zero_are_refused(tmp_path: Path) -> None:
    (tmp_path / "nodes.txt").write_text("Node\tX\tY\tZ\n0\t0.0\t0.0\t0.0\n1\t1.0\t0.0\t0.0\n")
    with pytest.raises(ReadError, match=r"there is a node 0, but nodes count from 1"):
        read_geometry(tmp_path / "nodes.txt")


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ReadError, match=r"gone.bdf: there is no such file"):
        read_geometry(tmp_path / "gone.bdf")


@pytest.mark.parametrize(
    ("name", "text", "rows"),
    [
        ("mesh.inp", FLAT, {"translations": 9, "six": 18}),
        (
            "deck.inp",
            "SOL 103\nCEND\nBEGIN BULK\nGRID,1\nGRID,2,,,,,,3\n",
            {"a": 11, "f": 11, "n": 12, "g": 12, "translations": 5},
        ),
        ("noname", FRD_SHORT, {"translations": 3, "six": 6}),
        ("x.dat", "BEGIN SUPER 4\nEXTRN,1,12\nGRID,1\n", {"a": 2}),
    ],
)
def test_geometry_is_found_by_content(tmp_path: Path, name: str, text: str, rows: dict[str, int]) -> None:
    found = read_geometry(write(tmp_path, name, text))
    assert {key: len(table) for key, table in found.rows.items()} == rows


@pytest.mark.shared
def test_real_meshes(shared_data: Path) -> None:
    beam = read_geometry(shared_data / "calculix_body" / "calculix.frd").nodes
    assert len(beam) == 261
    np.testing.assert_array_equal(np.ptp(beam.xyz, axis=0), [1.0, 1.5, 8.0])
    block = read_geometry(shared_data / "abaqus_c3d10" / "blockC3D10.inp").nodes
    assert len(block) == 257
    np.testing.assert_array_equal(np.ptp(block.xyz, axis=0), [4.0, 1.0, 1.0])


DECK = """\
GRID,1,,0.,0.,0.
GRID,2,,1.,0.,0.
CBAR,10,1,1,2,0.,0.,1.
CQUAD4  11      1       1       2       3       4
CTETRA  12      1       1       2       3       4       5       6       +
+       7       8       9       10
RBE2,13,1,123456,2,3
CELAS2,14,1.0,1,1,2,1
CELAS2,15,1.0,1,1
CBUSH,16,1,4
ENDDATA
"""
INPUT = """\
*NODE
1, 0., 0., 0.
*ELEMENT, TYPE=C3D10, ELSET=A
1, 1, 2, 3, 4, 5, 6, 7,
8, 9, 10
2, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20
*ELEMENT, TYPE=B32
3, 1, 2, 3
*ELEMENT, TYPE=MASS
4, 1
"""


def listed(path: Path) -> dict[str, list[list[int]]]:
    return {kind: nodes.tolist() for kind, nodes in read_cells(path).items()}


def test_elements_of_a_deck(tmp_path: Path) -> None:
    path = tmp_path / "deck.bdf"
    path.write_text(DECK)
    found = listed(path)
    assert sorted(found["line"]) == [[1, 2], [1, 2], [1, 2], [1, 3]]
    assert (found["quad"], found["tetra"]) == ([[1, 2, 3, 4]], [[1, 2, 3, 4]])


def test_elements_of_an_input_file(tmp_path: Path) -> None:
    path = tmp_path / "body.inp"
    path.write_text(INPUT)
    assert listed(path) == {"tetra": [[1, 2, 3, 4], [11, 12, 13, 14]], "line": [[1, 3]]}


def test_elements_of_a_mesh_that_meshio_reads(tmp_path: Path) -> None:
    path = tmp_path / "body.vtu"
    meshio.Mesh(np.eye(4)[:, :3], [("tetra", np.array([[0, 1, 2, 3]]))]).write(path)
    assert listed(path) == {"tetra": [[1, 2, 3, 4]]}


@pytest.mark.parametrize(
    ("point", "named"), [("3", "4"), ("-5", "-4"), ("4294967295", "4294967296"), ("9223372036854775807", "[0-9]+")]
)
def test_element_of_a_mesh_that_names_no_point(tmp_path: Path, point: str, named: str) -> None:
    path = tmp_path / "body.off"
    path.write_text(f"OFF\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 {point}\n")
    with pytest.raises(ReadError, match=f"a triangle names point {named} of 3; write the mesh again"):
        read_cells(path)


def test_files_without_elements(tmp_path: Path) -> None:
    path = tmp_path / "grids.bdf"
    path.write_text("GRID,1,,0.,0.,0.\n")
    assert read_cells(path) == {}
    with pytest.raises(ReadError, match="no such file"):
        read_cells(tmp_path / "absent.bdf")


@pytest.mark.shared
def test_elements_of_the_body_of_another_program(shared_data: Path) -> None:
    path = next((shared_data / "calculix_body").glob("*.frd"))
    (kind, cells), *_ = read_cells(path).items()
    assert kind in ("hexahedron", "tetra", "wedge")
    assert len(cells) > 10
    assert (np.diff(np.sort(cells, axis=1), axis=1) > 0).all()


@pytest.mark.parametrize("suffix", [".med", ".rmed"])
def test_med_is_a_mesh_and_no_file_of_matlab(tmp_path: Path, suffix: str) -> None:
    """Salome writes .med and code_aster .rmed; both are HDF5."""
    points, found = np.array([[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3.0]]), list[str]()
    meshio.write(tmp_path / "part.med", meshio.Mesh(points, [("tetra", np.arange(4)[None])]))
    path = (tmp_path / "part.med").rename(tmp_path / f"part{suffix}")
    if suffix == ".rmed":
        # gmsh writes numbers of nodes, and families without groups.
        with h5py.File(path, "r+") as file:
            file["FAS/mesh"].create_group("ELEME/FAM_-1").attrs["NUM"] = -1
            file["ENS_MAA/mesh"].visit(lambda name: found.append(name) if name.endswith("NOE") else None)
            file[f"ENS_MAA/mesh/{found[0]}/NUM"] = [7, 3, 5, 9]
    np.testing.assert_array_equal(read_geometry(path).nodes.xyz, points)
    assert read_cells(path)["tetra"].tolist() == [[7, 3, 5, 9] if suffix == ".rmed" else [1, 2, 3, 4]]
    with pytest.raises(ReadError, match="this is a MED file"):
        detect_format(path)


@pytest.mark.parametrize("suffix", ["gmsh22", "inp", "med"])
def test_sets_of_nodes_in_meshes(tmp_path: Path, suffix: str) -> None:
    """Physical groups of gmsh, node sets of Abaqus and families of MED."""
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    cells = [("tetra", np.array([[0, 1, 2, 3]])), ("triangle", np.array([[0, 2, 1]]))]
    path = tmp_path / f"mesh.{suffix.replace('gmsh22', 'msh')}"
    if suffix == "gmsh22":
        tags = {key: [np.array([1]), np.array([7])] for key in ("gmsh:physical", "gmsh:geometrical")}
        # A volume and a surface may have one number.
        named = {"BODY": np.array([1, 3]), "HUB": np.array([7, 2]), "OTHER": np.array([7, 3])}
        meshio.write(path, meshio.Mesh(points, cells, cell_data=tags, field_data=named), file_format="gmsh22")
    elif suffix == "inp":
        meshio.write(path, meshio.Mesh(points, cells[:1], point_sets={"HUB": np.array([0, 1, 2])}))
    else:
        mesh = meshio.Mesh(points, cells, cell_data={"cell_tags": [np.array([-1]), np.array([-2])]})
        mesh.point_tags, mesh.cell_tags = {}, {-1: ["BODY"], -2: ["HUB"]}
        meshio.write(path, mesh)
    sets = read_geometry(path).node_sets
    assert sets["HUB"].tolist() == [1, 2, 3]
    assert suffix == "inp" or sets["BODY"].tolist() == [1, 2, 3, 4]
    assert "OTHER" not in sets


@pytest.mark.parametrize(
    ("kind", "corners"),
    [("TR7", 3), ("QU9", 4), ("H27", 8), ("P18", 6), ("P15", 6), ("P13", 5), ("SE4", 2), ("TR6", 3)],
)
def test_elements_of_second_order_in_med_files(tmp_path: Path, kind: str, corners: int) -> None:
    """code_aster's meshes of such elements were refused by the name of the element alone."""
    path, count = tmp_path / "mesh.med", int(kind[-1]) if kind[0] in "TQS" else int(kind[1:])
    points = np.random.default_rng(1).normal(size=(count, 3))
    meshio.Mesh(points, [("line", [[0, 1]])]).write(path)
    with h5py.File(path, "r+") as file:
        cells = file["ENS_MAA"].visititems(lambda name, item: item if name.endswith("MAI") else None)
        del cells["SE2"]
        nodes = cells.create_group(kind).create_dataset("NOD", data=np.arange(1, count + 1))
        nodes.attrs.update({"CGT": 1, "NBR": 1})
    assert read_geometry(path).nodes.xyz.shape == (count, 3)
    ((name, found),) = read_cells(path).items()
    assert found.tolist() == [list(range(1, corners + 1))] and corners == CELL_CORNERS[name]


@pytest.mark.parametrize("components", [1, 3])
def test_results_in_a_med_file_are_left_out(tmp_path: Path, components: int) -> None:
    """code_aster's .rmed have fields; one of a single component was "not enough values to unpack"."""
    path = tmp_path / "mesh.rmed"
    field = np.ones((3, components)) if components > 1 else np.ones(3)
    made = meshio.Mesh(np.eye(3), [("triangle", [[0, 1, 2]])], point_data={"DEPL": field})
    made.write(tmp_path / "mesh.med")
    (tmp_path / "mesh.med").rename(path)
    with h5py.File(path, "r+") as file:
        for each in file["CHA"].values():
            each.attrs["NOM"] = np.bytes_("".join(name.ljust(16) for name in ("DX", "DY", "DZ")[:components]))
    assert np.array_equal(read_geometry(path).nodes.xyz, np.eye(3))


def test_a_med_file_of_version_2_says_so(tmp_path: Path) -> None:
    path = tmp_path / "mesh.med"
    meshio.Mesh(np.eye(3), [("triangle", [[0, 1, 2]])]).write(path)
    with h5py.File(path, "r+") as file:
        del next(iter(file["ENS_MAA"].values())).attrs["ESP"]
    with pytest.raises(ReadError, match="it is of MED 2: open it in Salome or code_aster, and write it again as MED 3"):
        read_geometry(path)
