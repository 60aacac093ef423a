"""A small good file for every reader, and everything that a command does with such a file."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable
from functools import cache
from pathlib import Path

import h5py
import meshio
import numpy as np

import cmsreduce
from cmsreduce.config import load_pipeline
from cmsreduce.pipeline import inspected
from cmsreduce.pipeline.drafts import draft_body
from cmsreduce.pipeline.results import check_result, read_limits
from cmsreduce.read import (
    deck_statement,
    matrix_names,
    read_bars,
    read_cells,
    read_controller,
    read_followers,
    read_geometry,
    read_matrix,
    read_members,
)
from cmsreduce.read.calculix_abaqus import read_dof_list
from cmsreduce.write import TARGETS, convert, read_component
from tests.read.matrices.test_petsc_binary import content
from tests.read.mutations import samples

__all__ = ["NAMES", "actions", "good_files"]

NAMES = (
    *("deck.bdf", "bars.bdf", "dmig.pch", "abaqus.mtx", "calculix.sti", "calculix.dof", "mesh.inp", "mesh.frd"),
    *("mesh.asm", "binary.op2", "wide.op2", "dense.op4", "bigmat.op4", "nonbigmat.op4", "printed.op4", "sparse.op4"),
    *("market.mtx", "array.mtx", "harwell.hb", "level4.mat", "level5.mat", "struct.mat", "packed.mat", "level73.mat"),
    *("dense.npy", "arrays.npz", "nodes.txt"),
    *("sparse.npz", "mesh.msh", "mesh2.msh", "mesh.vtk", "mesh.vtu", "mesh.xdmf", "mesh.med", "mesh.mesh", "mesh.stl"),
    *("mesh.off", "mesh.ply", "mesh.obj", "mesh.su2", "controller.txt", "controller.csv", "component_beam.h5"),
    *("summary.json", "pipeline.yaml", "model.inp", "petsc.bin", "modal.fem", "modal.sid"),
)
"""Names of the files, which say what is in them."""

ROOT = Path(__file__).resolve().parents[2]
_BODY = ROOT / "sample_models" / "rotating_beam"
_DECK = """SOL 103
CEND
BEGIN BULK
PARAM,GRDPNT,0
PARAM,WTMASS,1.0
CORD2C,5,,0.,0.,0.,0.,0.,1.
,1.,0.,0.
GRDSET,,,,,,,456
GRID,1,,0.,0.,0.
GRID,2,5,1.,90.,0.
GRID,3,,2.,0.,0.
GRID,4,,2.,1.,0.
MAT1,1,2.1+11,,.3,7850.
PBAR,1,1,.01,1.-5,1.-5,2.-5
PBARL,2,1,,ROD
,.05
PSHELL,3,1,.01,1
CBAR,1,1,1,2,0.,0.,1.
CBEAM,2,1,2,3,0.,0.,1.
CQUAD4,3,3,1,2,3,4
CTRIA3,4,3,1,2,3
CONM2,10,4,,1.5,.1,0.,0.
,1.,0.,1.,0.,0.,1.
CELAS2,11,1000.,3,1,4,1
RBE2,20,1,123456,3,4
RBE3,21,,4,123456,1.,123,1,2
,3
SPC1,1,123456,1
SPC,1,2,3,0.
ASET1,123,2,THRU,4
EIGRL,1,,,10
ENDDATA
"""
_BARS = """BEGIN BULK
GRID,1,,0.,0.,0.
GRID,2,,1.,0.,0.
GRID*,3,,2.0,0.0
*,0.0
MAT1,1,2.1+11,,.3,7850.
PBAR,1,1,.01,1.-5,1.-5,2.-5
PROD,2,1,.01,1.-5
CBAR,1,1,1,2,0.,0.,1.
CROD,2,2,2,3
CELAS2,11,1000.,3,1,2,1
CONM2,10,3,,1.5,.1,0.,0.
RBE2,20,1,123456,3
ENDDATA
"""
_SUPERELEMENT = """SECONCT,5,0,,NO
+,11,11,3,3,901,THRU,902
+,901,THRU,902
CORD2R,10,0,0.,0.,0.,1.,0.,0.
+,0.,1.,0.
EXTRN,11,246,3,1,901,THRU,902,0
GRID,3,,1.,2.,3.
GRID,11,,4.,5.,6.,10
SPOINT,901,902
"""
_MODEL = """*HEADING
*NODE, NSET=ALL
1, 0., 0., 0.
2, 1., 0., 0.
3, 1., 1., 0.
4, 0., 1., 0.
5, 0., 0., 1.
6, 1., 0., 1.
7, 1., 1., 1.
8, 0., 1., 1.
9, 2., 0., 0.
10, 3., 0., 0.
*NSET, NSET=SOME, GENERATE
1, 7, 2
*NSET, NSET=MORE
SOME, 8
*ELEMENT, TYPE=C3D8, ELSET=BODY
1, 1, 2, 3, 4, 5, 6, 7, 8
*ELEMENT, TYPE=MASS, ELSET=POINT
2, 9
*ELSET, ELSET=BOTH
BODY, POINT
*MATERIAL, NAME=STEEL
*ELASTIC
2.1E11, 0.3
*DENSITY
7850.
*SOLID SECTION, ELSET=BODY, MATERIAL=STEEL
*MASS, ELSET=POINT
1.5
*BOUNDARY
SOME, 2, 3
*EQUATION
2
2, 1, 1., 3, 1, -1.
*RIGID BODY, NSET=MORE, REF NODE=10, ROT NODE=9
*STEP
*FREQUENCY
10
*CLOAD
2, 1, 1.
*END STEP
"""
_CONTROLLER = "% gains\nA:\n-1.0 0.5\n0.0 -2.0\nB:\n1.0\n2.0\nC:\n1.0, 0.0\nD:\n0.0\n"
_MESHES = {
    "mesh.msh": "gmsh",
    "mesh2.msh": "gmsh22",
    "mesh.vtk": "vtk",
    "mesh.vtu": "vtu",
    "mesh.xdmf": "xdmf",
    "mesh.med": "med",
    "mesh.mesh": "medit",
    "mesh.stl": "stl",
    "mesh.off": "off",
    "mesh.ply": "ply",
    "mesh.obj": "obj",
    "mesh.su2": "su2",
}
_PIPELINE = """name: fuzz
output: build/fuzz
include: [part.yaml]
components:
  hub:
    rigid: {mass: 5.0, inertia: [0.02, 0.02, 0.04, 0, 0, 0]}
    interfaces:
      face: {position: [0, 0, 0]}
  beam: &beam
    stiffness: {file: beam.op4, matrix: KGG}
    mass: {file: beam.op4, matrix: MGG}
    geometry: {file: beam.bdf}
    interfaces: {root: {node: 1}, tip: {node: 41}}
    damping: &steel {modal: 0.005}
  second:
    <<: *beam
    damping: *steel
    place: {at: [1, 0, 0], rotate: {axis: z, angle: 30 deg}}
scene:
  band: 80 Hz
  joints:
    hinge: {connect: [hub.face, beam.root], free: [rz]}
    other: {connect: [hub.face, second.root], free: []}
  articulation: {hinge: [0, 45, 90 deg]}
  actuators: {push: {at: beam.tip, force: [0, 1, 1]}}
  sensors:
    tip: {at: beam.tip, measure: [y, z]}
reduce: {method: craig-bampton, cutoff: 15.0}
balance: {rank: gregory, keep: {frf_error: 0.01}}
verify: {frf: {points: 200}, limits: {frf_error: 0.01}}
write: {formats: [hdf5]}
"""


def _mesh(path: Path, kind: str) -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]], dtype=float)
    flat = kind in ("stl", "off", "ply", "obj")
    cells = {"triangle": [[0, 1, 2], [1, 2, 3]]} if flat else {"tetra": [[0, 1, 2, 3], [1, 2, 3, 4]]}
    # meshio prints remarks.
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        meshio.Mesh(points, {name: np.array(corners) for name, corners in cells.items()}).write(path, kind)


def _mat73(path: Path, A: np.ndarray) -> None:
    """A level 7.3 file as MATLAB writes it: one full and one sparse matrix."""
    with h5py.File(path, "w", userblock_size=512) as file:
        full = file.create_dataset("K", data=A, compression="gzip", chunks=A.shape)
        full.attrs["MATLAB_class"] = np.bytes_("double")
        group = file.create_group("M")
        group.attrs["MATLAB_class"] = np.bytes_("double")
        group.attrs["MATLAB_sparse"] = np.uint64(len(A))
        group["data"], group["ir"] = np.ones(len(A)), np.arange(len(A), dtype=np.uint64)
        group["jc"] = np.arange(len(A) + 1, dtype=np.uint64)
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")


def _run(folder: Path) -> Path:
    """Run of a small body, with a floating frame and geometric stiffness in its component file."""
    for file in ("beam.op4", "beam.bdf"):
        (folder / file).write_bytes((_BODY / file).read_bytes())
    text = (ROOT / "pipelines" / "rotating_beam.yaml").read_text().replace("../sample_models/rotating_beam/", "")
    (folder / "beam.yaml").write_text(text)
    # One mode and a coarse grid: the file is what matters here.
    changes = {"reduce.cutoff": 1.0, "verify": None}
    cmsreduce.run(folder / "beam.yaml", set=changes, out=folder / "run")
    return folder / "run"


def good_files(folder: Path) -> dict[str, bytes]:
    """Contents of a good file for every reader, by name; pipelines need the files of the folder beside them."""
    good = {name: content for name, content in samples(folder).items() if name != "deck.bdf"}
    A = np.diag(np.arange(1.0, 9.0))
    for name, kind in _MESHES.items():
        _mesh(folder / name, kind)
        good[name] = (folder / name).read_bytes()
    _mat73(folder / "level73.mat", A)
    good["level73.mat"] = (folder / "level73.mat").read_bytes()
    good["deck.bdf"] = _DECK.encode()
    good["bars.bdf"] = _BARS.encode()
    good["mesh.asm"] = _SUPERELEMENT.encode()
    good["controller.txt"] = _CONTROLLER.encode()
    good["controller.csv"] = _CONTROLLER.replace(" ", ",").encode()
    run = _run(folder)
    good["component_beam.h5"] = (run / "beam.h5").read_bytes()
    good["summary.json"] = (run / "summary.json").read_bytes()
    (folder / "part.yaml").write_text("solver: {threads: 1}\nverify: {frf: {points: 100}}\n")
    good["pipeline.yaml"] = _PIPELINE.encode()
    good["model.inp"] = _MODEL.encode()
    good["petsc.bin"] = content(A)
    for name, target in (("modal.fem", "mbdyn"), ("modal.sid", "sid")):
        convert(run / "beam.h5", folder / name, target)
        good[name] = (folder / name).read_bytes()
    return good


def actions(path: Path) -> list[Callable[[], object]]:
    """What commands do with a file of this name: each succeeds or raises a CmsReduceError."""
    name = path.name
    if name.startswith("component_"):
        return [
            lambda: read_component(path),
            lambda: inspected(path),
            lambda: check_result(path, read_limits(None, (), ())),
            *(
                lambda target=target: convert(path, path.with_name(f"out{TARGETS[target].suffix}"), target)
                for target in ("nastran", "42", "sid", "mbdyn", "exudyn", "matlab")
            ),
        ]
    if name == "summary.json":
        return [lambda: check_result(path, read_limits(None, (), ()))]
    if path.suffix == ".yaml":
        return [lambda: load_pipeline(path)]
    if name.startswith("controller"):
        return [lambda: read_controller(path, ("gyro",), ("motor",))]
    found: list[Callable[[], object]] = [lambda: inspected(path)]
    if path.suffix == ".dof":
        return [lambda: read_dof_list(path)]
    if path.stem == "modal":
        return found
    if path.stem == "model":
        nodes = cache(lambda: read_geometry(path).nodes)
        return [*found, lambda: read_cells(path), lambda: deck_statement(path, nodes(), np.ones(len(nodes()), bool))]
    if path.suffix == ".bdf":
        body = (path.with_name("beam.op4"), path)
        found += [
            *(lambda read=read: read(path) for read in (read_cells, read_bars)),
            *(lambda read=read: read(path, read_geometry(path).nodes) for read in (read_members, read_followers)),
            lambda: deck_statement(path, (nodes := read_geometry(path).nodes), np.ones(len(nodes), dtype=bool)),
            lambda: draft_body("body", body),
        ]
        return found
    if path.stem.startswith(("mesh", "nodes")):
        return [*found, lambda: read_cells(path)]
    return [*found, lambda: _every_matrix(path)]


def _every_matrix(path: Path) -> None:
    for info in matrix_names(path):
        read_matrix(path, info.name)
