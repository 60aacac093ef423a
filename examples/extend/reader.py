"""Readers of your own: a matrix as text of triplets, and nodes as text of points (docs/extend.md).

The place of the first would be cmsreduce/read/triplets/__init__.py.
"""

from pathlib import Path

import numpy as np
import pytest

import cmsreduce as cms
from cmsreduce.model import Nodes
from cmsreduce.read import FORMATS, GEOMETRY_FORMATS, Geometry, GeometryFormat
from cmsreduce.read.files import reading
from cmsreduce.read.formats import MatrixFormat, StoredMatrix
from cmsreduce.read.labelled_matrix import LabelledMatrix, canonical


def stored(path: Path) -> list[StoredMatrix]:
    """The one matrix of a file; its entries are read when it is loaded."""
    with path.open() as file, reading(path, "the size"):
        n = int(file.readline().split()[1])

    def load() -> LabelledMatrix:
        with reading(path, "the entries"):
            row, col, value = np.loadtxt(path, skiprows=1, unpack=True, ndmin=2)
        A = canonical(row.astype(int) - 1, col.astype(int) - 1, value, (n, n))
        return LabelledMatrix(A, path.stem, path, TRIPLETS.name)

    return [StoredMatrix(path.stem, "real double, as text", "square", (n, n, None), load)]


TRIPLETS = MatrixFormat(
    "triplets", "text 'size n', then 'i j value'", lambda path, head: head.startswith(b"size "), stored, named=False
)
FORMATS[TRIPLETS.name] = TRIPLETS


def points(path: Path) -> Geometry:
    """Nodes of a file, numbered from 1."""
    with reading(path, "the points"):
        xyz = np.loadtxt(path, skiprows=1, ndmin=2)
    return Geometry.of_mesh(path, Nodes.in_basic(np.arange(1, len(xyz) + 1), xyz))


POINTS = GeometryFormat(
    "points", "text 'points', then x y z", lambda head: head.startswith("points"), points, lambda path: {}
)
GEOMETRY_FORMATS[POINTS.name] = POINTS


def test_two_masses_on_a_spring(tmp_path: Path) -> None:
    """They have a closed form; a cut file is refused by its name."""
    stiffness, mass, places = (tmp_path / name for name in ("K.txt", "M.txt", "places.txt"))
    stiffness.write_text("size 2\n1 1 200\n1 2 -200\n2 1 -200\n2 2 200\n")
    mass.write_text("size 2\n1 1 2\n2 2 3\n")
    body = cms.read_body("bar", stiffness=stiffness, mass=mass, rows=["1.1", "2.1"], interfaces={"end": 2})
    bar = cms.orthogonalise(cms.MacNealRubin(cutoff_hz=10).reduce(body))
    assert bar.rigid_count == 1
    assert abs(bar.frequencies_hz[1] - np.sqrt(200 * (1 / 2 + 1 / 3)) / (2 * np.pi)) < 1e-9

    places.write_text("points\n0 0 0\n2 0 0\n")
    placed = cms.read_body("bar", stiffness=stiffness, mass=mass, rows=["1.1", "2.1"], geometry=places)
    assert placed.nodes is not None
    assert placed.nodes.xyz[1].tolist() == [2, 0, 0]

    stiffness.write_text("size 2\n1 1 200\n1 2")
    with pytest.raises(cms.CmsReduceError, match=r"K\.txt"):
        cms.read_body("bar", stiffness=stiffness, mass=mass, rows=["1.1", "2.1"])
