"""Meshes in the XML files of VTK, by the format that VTK documents, of versions that meshio does not know."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from cmsreduce.errors import ReadError
from cmsreduce.read import file_kind, read_geometry
from cmsreduce.read.geometry import read_cells

XYZ = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3], [1, 2, 3]])
ARRAYS = {
    "Points": {"Points": XYZ},
    "Cells": {
        "connectivity": np.array([2, 1, 0, 3, 1, 2, 3, 4]),
        "offsets": np.array([4, 8]),
        "types": np.array([10, 71], np.uint8),
    },
}


FIELDS = {
    "time": '<DataArray type="Float64" Name="TimeValue" NumberOfTuples="1" format="ascii">0.5</DataArray>',
    "pair": '<DataArray type="Int64" Name="CYCLE" NumberOfTuples="2" format="ascii">7 3</DataArray>',
    "text": '<Array type="String" Name="Title" NumberOfTuples="1" format="ascii">98 97 114 0</Array>',
    "tensor": '<DataArray type="Float32" Name="T" NumberOfComponents="9" NumberOfTuples="1" format="ascii">'
    "1 2 3 4 5 6 7 8 9</DataArray>",
}


def written(version: str, raw: bool) -> bytes:
    """Two tetrahedra, the second a Lagrange cell, as text between tags or as raw bytes behind them."""
    body, behind = "", b""
    for group, arrays in ARRAYS.items():
        body += f"<{group}>\n"
        for name, values in arrays.items():
            kind = {"f": "Float64", "i": "Int64", "u": "UInt8"}[values.dtype.kind]
            tag = f'<DataArray type="{kind}" Name="{name}" NumberOfComponents="{values.shape[1:] or (1,)}"'
            tag = tag.replace('"(', '"').replace(',)"', '"')
            if raw:
                body += f'{tag} format="appended" offset="{len(behind)}"/>\n'
                behind += np.uint32(values.nbytes).tobytes() + values.tobytes()
            else:
                body += f'{tag} format="ascii">{" ".join(map(str, values.ravel().tolist()))}</DataArray>\n'
        body += f"</{group}>\n"
    text = (
        f'<?xml version="1.0"?>\n<VTKFile type="UnstructuredGrid" version="{version}" byte_order="LittleEndian" '
        'header_type="UInt32">\n<UnstructuredGrid>\n<Piece NumberOfPoints="5" NumberOfCells="2">\n'
        f"{body}</Piece>\n</UnstructuredGrid>\n"
    ).encode()
    if raw:
        text += b'<AppendedData encoding="raw">\n_' + behind + b"\n</AppendedData>\n"
    return text + b"</VTKFile>\n"


@pytest.mark.parametrize("raw", [False, True])
@pytest.mark.parametrize("version", ["1.0", "2.2", "2.3"])
def test_later_versions_are_read(tmp_path: Path, version: str, raw: bool) -> None:
    """VTK 9.7 writes version 2.3, DOLFINx 2.2 with Lagrange cells: refused with the advice to write .vtu."""
    path = tmp_path / "body.vtu"
    path.write_bytes(written(version, raw))
    assert np.array_equal(read_geometry(path).nodes.xyz, XYZ)
    assert {kind: cells.tolist() for kind, cells in read_cells(path).items()} == {"tetra": [[3, 2, 1, 4], [2, 3, 4, 5]]}


@pytest.mark.parametrize("raw", [False, True])
@pytest.mark.parametrize("field", [*FIELDS, "all"])
def test_times_and_texts_are_no_names_of_cells(tmp_path: Path, field: str, raw: bool) -> None:
    """A file of one time step, as ParaView writes it, ended in "not enough values to unpack"."""
    said = "".join(FIELDS.values()) if field == "all" else FIELDS[field]
    text = written("1.0", raw).replace(b"\n<Piece", f"\n<FieldData>{said}</FieldData>\n<Piece".encode())
    (tmp_path / "body.vtu").write_bytes(text)
    shape = read_geometry(tmp_path / "body.vtu")
    assert np.array_equal(shape.nodes.xyz, XYZ) and not shape.node_sets


@pytest.mark.parametrize("raw", [False, True])
def test_a_compressor_that_is_not_read_is_named(tmp_path: Path, raw: bool) -> None:
    """It was "AssertionError", or the name of the compressor alone."""
    text = written("1.0", raw).replace(b' header_type="', b' compressor="vtkLZ4DataCompressor" header_type="')
    (tmp_path / "body.vtu").write_bytes(text)
    with pytest.raises(ReadError, match="it is compressed with LZ4: write it with ZLib"):
        read_geometry(tmp_path / "body.vtu")


def test_a_version_to_come_is_refused_by_its_number(tmp_path: Path) -> None:
    (tmp_path / "body.vtu").write_bytes(written("3.0", raw=False))
    with pytest.raises(ReadError, match=r"Unknown VTU file version '3\.0'"):
        read_geometry(tmp_path / "body.vtu")


HEADS = {
    "declared": '<?xml version="1.0"?>\n<VTKFile type="{}" version="0.1">',
    "single quotes": "<VTKFile type='{}' version='0.1'>",
    "spaces": '<VTKFile version="2.2" header_type="UInt32"\n type = "{}">',
    "comment": '<?xml version="1.0"?>\n<!-- made <by> hand -->\n<!-- -->\n<VTKFile type="{}">',
    "byte order mark": '\ufeff<?xml version="1.0" encoding="utf-8"?>\n<VTKFile type="{}">',
}
LISTS = ("Collection", "PUnstructuredGrid", "PPolyData", "PImageData", "vtkMultiBlockDataSet", "vtkPartitionedDataSet")
GRIDS = ("PolyData", "ImageData", "RectilinearGrid", "StructuredGrid")


@pytest.mark.parametrize("head", HEADS)
@pytest.mark.parametrize("kind", [*LISTS, *GRIDS])
def test_files_of_vtk_that_are_not_read_say_what_to_name(tmp_path: Path, kind: str, head: str) -> None:
    """Lists of pieces were said to have no known format, and surfaces to hold no nodes."""
    path = tmp_path / "body.pvd"
    path.write_text(f"{HEADS[head].format(kind)}\n</VTKFile>\n", encoding="utf-8")
    listed = kind in LISTS
    assert file_kind(path).name == ("vtk-list" if listed else "vtk-grid")
    said = "lists others, which holds no nodes: name the .vtu" if listed else "whose nodes are not read: write the mesh"
    with pytest.raises(ReadError, match=said):
        read_geometry(path)


@pytest.mark.parametrize("head", HEADS)
def test_the_head_of_a_mesh_of_vtk_may_be_any_xml(tmp_path: Path, head: str) -> None:
    path = tmp_path / "body.vtu"
    text = written("1.0", raw=False).decode()
    text = HEADS[head].format("UnstructuredGrid") + text[text.index("\n<UnstructuredGrid>") :]
    path.write_text(text, encoding="utf-8")
    assert file_kind(path).name == "mesh"
    assert np.array_equal(read_geometry(path).nodes.xyz, XYZ)


def test_many_comments_take_no_time(tmp_path: Path) -> None:
    path = tmp_path / "body.pvd"
    path.write_text(500 * "<!---->" + "<a>\n")
    assert file_kind(path).name == "unknown"
