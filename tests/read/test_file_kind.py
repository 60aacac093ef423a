"""Every file is named by what it is, whatever its name says; refusals and commands use the same look."""

from __future__ import annotations

import gzip
import io
import pickle
import zipfile
from pathlib import Path

import h5py
import meshio
import numpy as np
import pytest
import scipy.io
import scipy.sparse as sp
from click.testing import CliRunner
from pyyeti.nastran import op4

from cmsreduce.cli import main
from cmsreduce.errors import ReadError
from cmsreduce.read import expect_kind, file_kind, matrix_names, read_geometry
from cmsreduce.read.files import read_head
from cmsreduce.read.marks import UNREAD_MESHES
from tests.read.matrices.test_freefem import printed

K = np.array([[2.0, -1.0], [-1.0, 2.0]])
# Harwell-Boeing by the specification: a title and a key, counts of lines, type and size, formats.
HARWELL_BOEING = (
    f"{'stiffness of a bracket':<72}KEY00001\n{4:14d}{1:14d}{1:14d}{2:14d}{0:14d}\n"
    f"{'RSA':<14}{2:14d}{2:14d}{3:14d}{0:14d}\n"
    "(8I10)          (8I10)          (4E20.12)\n"
)


def binary(write: object) -> bytes:
    held = io.BytesIO()
    write(held)  # type: ignore[operator]
    return held.getvalue()


def zipped(name: str) -> bytes:
    held = io.BytesIO()
    with zipfile.ZipFile(held, "w") as archive:
        archive.writestr(name, "content")
    return held.getvalue()


def hdf5(path: Path, attributes: dict[str, object], items: tuple[str, ...]) -> None:
    with h5py.File(path, "w") as file:
        file.attrs.update(attributes)
        for name in items:
            file.create_group(name)


CONTENT = {
    "mat": binary(lambda file: scipy.io.savemat(file, {"K": K})),
    "npy": binary(lambda file: np.save(file, K)),
    "npz": binary(lambda file: sp.save_npz(file, sp.csc_array(K))),
    "matrix-market": b"%%MatrixMarket matrix array real general\n2 2\n2\n-1\n-1\n2\n",
    "calculix": b"1 1 2.0\n1 2 -1.0\n2 2 2.0\n",
    "dmig": b"DMIG    KAA     0       6       1       0\nDMIG*   KAA                            1               1\n",
    "bulk": b"SOL 103\nCEND\nBEGIN BULK\nGRID,1,,0.,0.,0.\nENDDATA\n",
    "superelement": b"SECONCT,5,0,,NO\nEXTRN,11,246\nGRID,11,,4.,5.,6.\n",
    "frd": b"    1C\n    1UUSER\n    2C                             1                                     1\n",
    "inp": b"*HEADING\na bracket\n*NODE\n1, 0., 0., 0.\n",
    "freefem": printed(K).encode(),
    "freefem-mesh": b"4 2 4\n0 0 4\n1 0 1\n0 0.125 1\n1 0.125 3\n1 2 4 0\n1 4 3 0\n1 2 1\n",
    "femap": b"   -1\n   100\n<NULL>\n9.3,\n   -1\n   -1\n   403\n1,0,0,1,46,0,0,0,0,0,0,0.,0.,0.,0,\n   -1\n",
    "radioss": b"#RADIOSS STARTER\n/BEGIN\nbracket\n/NODE\n         1       0.0       0.0       0.0\n",
    "gmsh-1": b"$NOD\n3\n1 0 0 0\n2 1 0 0\n3 0 1 0\n$ENDNOD\n$ELM\n1\n1 2 0 1 3 1 2 3\n$ENDELM\n",
    "ls-dyna": b"*KEYWORD\n*ELEMENT_DIRECT_MATRIX_INPUT\n         1         0         0\ndmig.dat\n",
    "mfem-mesh": b"MFEM mesh v1.0\n\n#\n# MFEM Geometry Types (see fem/geom.hpp):\n",
    "mfem": b"[row 0]\n (1,-1.5) (0,4486419753.086419)\n[row 1]\n (0,-1.5) (1,3)\n",
    "f06": b"1\n \n      * * *  N A S T R A N  * * *\nGRID     1     0.   0.   0.\n",
    "gzip": gzip.compress(b"BEGIN BULK\nGRID,1,,0.,0.,0.\n"),
    "zip": zipped("body.bdf"),
    "octave": b"# Created by Octave 7.3.0, Sun Nov 29 08:07:24 2026 UTC <a@b>\n# name: K\n# type: matrix\n# rows: 2\n"
    b"# columns: 2\n 2 -1\n -1 2\n",
    "pickle": pickle.dumps({"K": K}),
    "workbook": zipped("[Content_Types].xml"),
    "petsc-text": b"Mat Object: 1 MPI process\n  type: seqaij\nrow 0: (0, 2.) (1, -1.)\n",
    "utf-16": "1 1 2.0\n1 2 -1.0\n".encode("utf-16"),
    "git-lfs": b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n",
    "picture": b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR",
    "petsc": np.array([1211216, 2, 2, 3], dtype=">i4").tobytes(),
    "harwell-boeing": HARWELL_BOEING.encode(),
    "ansys-full": np.array([100, -(2**31), 4], dtype="<i4").tobytes() + bytes(400),
    "universal": b"    -1\n  2411\n         1         1         1        11\n",
    "substructure": b"**\n** GENERATION OF SUBSTRUCTURE\n*USER ELEMENT,NODES=         2,LINEAR\n** ELEMENT NODES\n",
    "dofs": b"1.1\n1.2\n1.3\n",
    "pipeline": b"# a study\nname: bracket\ncomponents:\n",
    "yaml": b"colour: blue\n",
    "decimal-commas": b"1,1, 1,1, 1,507692e+11\n1,2, 1,1, 3,2692e+10\n",
    "table": b"1.5e3;-2,5;0\n-2,5;3;1\n",
    "empty": b"",
    "unknown": b"once upon a time",
}
HDF5 = {
    "component": ({"format": "cmsreduce-component", "format_version": 3}, ("modes",)),
    "system": ({"format": "cmsreduce-system", "format_version": 2}, ()),
    "sweep": ({"format": "cmsreduce sweep", "format_version": 1}, ("points",)),
    "mesh": ({}, ("ENS_MAA", "INFOS_GENERALES")),
    "nastran-hdf5": ({}, ("INDEX", "NASTRAN")),
    "hdf5": ({}, ("stiffness", "mass")),
}


@pytest.mark.parametrize("suffix", ["", ".op4", ".h5", ".yaml"])
@pytest.mark.parametrize("name", [*CONTENT, *HDF5])
def test_a_file_is_what_its_content_says(tmp_path: Path, name: str, suffix: str) -> None:
    path = tmp_path / f"file{suffix}"
    if name in CONTENT:
        path.write_bytes(CONTENT[name])
    else:
        hdf5(path, *HDF5[name])
    kind = file_kind(path)
    assert kind.name == name
    if name == "mesh":
        return
    for read, held in ((matrix_names, kind.matrices), (read_geometry, kind.geometry)):
        if held or name in ("frd",):
            continue
        with pytest.raises(ReadError) as refused:
            read(path)
        said = str(refused.value)
        assert str(path) in said and "\n" not in said
        if name not in ("empty", "unknown"):
            lack = "whose nodes are not read" if read is read_geometry and name in UNREAD_MESHES else "which holds no "
            assert f"this is {kind.words}, {lack}" in said


def test_a_medit_mesh_that_meshio_cannot_read_is_a_mesh(tmp_path: Path) -> None:
    """FreeFEM's meshes in a plane have sections of their own; the message spoke of matrices."""
    path = tmp_path / "plate.mesh"
    path.write_text("MeshVersionFormatted 1\n\nDimension\n2\n\nSubDomainFromGeom\n1\n2 1 1 0\n\nEnd\n")
    assert file_kind(path).geometry == "mesh"
    with pytest.raises(ReadError, match=r"Unknown keyword 'SubDomainFromGeom'.*If it is a mesh, write it as \.vtu"):
        read_geometry(path)


@pytest.mark.parametrize(
    "text",
    [
        "1.0,2.0\n3.0,4.0\n",
        "row,col,value\n1,1,2.5\n2,2,3.5\n",
        " 1e0 2e0\n 3e0 4e0\n",
        "1 1 1,5\n1 2 -2,5e3\n",
        " -1.5e10" * 9000,
    ],
)
def test_tables_of_numbers_are_refused_with_what_to_write(tmp_path: Path, text: str) -> None:
    """A spreadsheet's matrix was refused as a mesh whose format could not be deduced."""
    (tmp_path / "K.csv").write_text(text)
    for read in (matrix_names, read_geometry):
        with pytest.raises(ReadError, match=r"a table of numbers .*: `scipy\.io\.savemat\(.*GRID cards"):
            read(tmp_path / "K.csv")


@pytest.mark.parametrize("binary", [False, True], ids=["text", "binary"])
def test_what_octave_saves_by_default_has_its_remedy(tmp_path: Path, binary: bool) -> None:
    """Two sparse variables were read as one matrix that names each place twice."""
    head, lines = "# name: {}\n# type: sparse matrix\n# nnz: 2\n# rows: 2\n# columns: 2\n", "1 1 2\n2 2 2\n\n\n"
    text = "# Created by Octave 7.3.0\n" + "".join(head.format(name) + lines for name in "KM")
    (tmp_path / "body.mat").write_bytes(b"Octave-1-L\0\1\0\0\0K" if binary else text.encode())
    done = CliRunner().invoke(main, ["inspect", str(tmp_path / "body.mat")])
    assert done.exit_code == 2 and "`save -v7 body.mat K M` in Octave" in done.stderr
    # One variable is entries under comments.
    (tmp_path / "K.txt").write_text("# Created by Octave 7.3.0\n" + head.format("K") + lines)
    assert file_kind(tmp_path / "K.txt").name == "calculix" and matrix_names(tmp_path / "K.txt")[0].rows == 2


@pytest.mark.parametrize(("name", "step"), [("job.odb", "*MATRIX GENERATE"), ("a.H3D", "DMIGPCH"), ("b.db", "HBMAT")])
def test_files_of_programs_that_are_not_read_name_what_to_write(tmp_path: Path, name: str, step: str) -> None:
    (tmp_path / name).write_bytes(b"HKSRD0\0\1\2")
    assert file_kind(tmp_path / name).name == "unknown"
    done = CliRunner().invoke(main, ["inspect", str(tmp_path / name)])
    assert done.exit_code == 2 and step in done.stderr


def test_meshes_of_numbers_alone_are_meshes(tmp_path: Path) -> None:
    """TetGen's nodes and elements look like tables; meshio finds them by their names."""
    (tmp_path / "a.node").write_text("4 3 0 0\n1 0. 0. 0.\n2 1. 0. 0.\n3 0. 1. 0.\n4 0. 0. 2.\n")
    (tmp_path / "a.ele").write_text("1 4 0\n1 1 2 3 4\n")
    assert len(read_geometry(tmp_path / "a.node").nodes) == 4


@pytest.mark.parametrize("dofs", ["1, 2, 3", "1, 1, 3", "1, 2, 3, 4, 5, 6"])
@pytest.mark.parametrize("start", ["", "\n** ABAQUS\n", "**\r\n"])
def test_the_dofs_of_a_substructure_are_no_entries(tmp_path: Path, dofs: str, start: str) -> None:
    """Three dofs of a node read like an entry 'i j value'."""
    path = tmp_path / "job.mtx"
    path.write_text(f"{start}*USER ELEMENT, NODES=2, LINEAR\n{dofs}\n*MATRIX,TYPE=STIFFNESS\n 1.0,\n -1.0, 1.0\n")
    with pytest.raises(ReadError, match="the nodes of the substructure are not there"):
        matrix_names(path)


def test_nastran_and_hdf5_files_of_programs(tmp_path: Path) -> None:
    op4.write(str(tmp_path / "a"), {"KAA": K})
    assert file_kind(tmp_path / "a").matrices == "op4"
    meshio.Mesh(np.eye(3), [("triangle", [[0, 1, 2]])]).write(tmp_path / "b", "med")
    assert file_kind(tmp_path / "b").words == "a MED file (code_aster, Salome)"
    with h5py.File(tmp_path / "c", "w") as file:
        file.create_dataset("K", data=K).attrs["MATLAB_class"] = np.bytes_("double")
    assert file_kind(tmp_path / "c").matrices == "mat"
    # A punch file may have both: the grids and the matrices of a superelement.
    (tmp_path / "d").write_bytes(CONTENT["bulk"] + CONTENT["dmig"])
    assert (file_kind(tmp_path / "d").matrices, file_kind(tmp_path / "d").geometry) == ("dmig", "bulk")


def test_a_compressed_file_is_named_with_the_command_that_unpacks_it(tmp_path: Path) -> None:
    (tmp_path / "a.mtx.gz").write_bytes(gzip.compress(b"%%MatrixMarket matrix array real general\n1 1\n1\n"))
    with pytest.raises(ReadError, match=r"holds no matrix: `gunzip -k .*a\.mtx\.gz`, and name that file"):
        matrix_names(tmp_path / "a.mtx.gz")


def test_own_files_are_named_with_their_version(tmp_path: Path) -> None:
    hdf5(tmp_path / "a", *HDF5["system"])
    with pytest.raises(ReadError, match=r"assembled reduced system that cmsreduce wrote \(format version 2\)"):
        matrix_names(tmp_path / "a")


def test_words_of_a_calculix_body_are_those_of_calculix(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(CONTENT["inp"])
    with pytest.raises(ReadError, match="CalculiX writes them as") as refused:
        matrix_names(tmp_path / "a")
    assert "NASTRAN" not in str(refused.value)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("run", "a"), "this is numpy .npy, not a pipeline file: `cmsreduce inspect a` shows what is in it"),
        (("sweep", "a", "--over", "reduce.cutoff=1,2"), "this is numpy .npy, not a pipeline file"),
        (
            ("check", "b"),
            "this is the assembled reduced system that cmsreduce wrote (format version 2), not a component",
        ),
        (("convert", "c", "x.op4"), "this is a pipeline of cmsreduce (YAML), not a component file, which a run writes"),
        (("inspect", "d"), "this is a picture, which holds no nodes: name the matrices and the deck or mesh"),
    ],
)
def test_commands_say_what_they_were_given(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    for name, kind in (("a", "npy"), ("c", "pipeline"), ("d", "picture")):
        Path(name).write_bytes(CONTENT[kind])
    hdf5(Path("b"), *HDF5["system"])
    done = CliRunner().invoke(main, words)
    assert (done.exit_code, done.output.count("error: ")) == (2, 1)
    assert message in done.output


@pytest.mark.parametrize("command", [("inspect",), ("new", "body")])
def test_a_file_of_unknown_kind_may_be_a_matrix(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: tuple[str, ...]
) -> None:
    """It was refused as a mesh alone, here one row by row."""
    monkeypatch.chdir(tmp_path)
    Path("K.txt").write_text("row 0:\n(0,2) (1,-1)\nrow 1:\n(0,-1) (1,2)\n")
    done = CliRunner().invoke(main, [*command, "K.txt"])
    assert done.exit_code == 2
    assert "no geometry in a format" in done.output and "If it holds matrices: `scipy.io.savemat(" in done.output


@pytest.mark.shared
@pytest.mark.parametrize(
    ("file", "name"),
    [
        ("nas2cam/inboard.out", "bulk"),
        ("swept_plane/sol103_swept_plane.f06", "f06"),
        ("swept_plane/sol103_swept_plane.pch1", "dmig"),
        ("abaqus_c3d10/blockC3D10.inp", "inp"),
        ("abaqus_c3d10/blockC3D10_STIF1.mtx", "abaqus"),
        ("calculix_body/calculix.dof", "dofs"),
        ("formats/five_node_model.sid_fem", "sid"),
        ("formats/mbdyn_beam.fem", "mbdyn"),
        ("slicot/iss.mat", "mat"),
    ],
)
def test_files_of_other_programs(shared_data: Path, tmp_path: Path, file: str, name: str) -> None:
    (tmp_path / "copy").write_bytes(read_head(shared_data / file, 1 << 24))
    assert file_kind(tmp_path / "copy").name == name
    expect_kind(tmp_path / "nothing", "pipeline")


@pytest.mark.parametrize(
    "text", ['{"name": "bracket", "components": {}}', '{\n "components": {"a": {}},\n "scene": {}\n}']
)
def test_a_pipeline_in_json_is_a_pipeline(tmp_path: Path, text: str) -> None:
    path, summary = tmp_path / "study.json", tmp_path / "summary.json"
    path.write_text(text)
    summary.write_text('{\n  "name": "bracket",\n  "version": "0.2",\n  "components": {}\n}')
    expect_kind(path, "pipeline")
    with pytest.raises(ReadError, match="this is the summary of a run, not a pipeline"):
        expect_kind(summary, "pipeline")


def test_a_finished_stage_has_no_version_to_name(tmp_path: Path) -> None:
    path = tmp_path / "beam.read.h5"
    with h5py.File(path, "w") as file:
        file.attrs["format"] = "cmsreduce stage"
    with pytest.raises(ReadError, match=r"this is a finished stage of a run of cmsreduce, which holds no nodes"):
        read_geometry(path)
