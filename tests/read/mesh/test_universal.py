"""Universal files, written by pyuff."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cmsreduce.errors import ReadError
from cmsreduce.read import read_geometry

pyuff: Any = pytest.importorskip("pyuff") if importlib.util.find_spec("pyuff") else None
pytestmark = pytest.mark.skipif(pyuff is None, reason="needs pyuff (pip install 'cmsreduce[uff]')")

XYZ = np.array([[0, 0, 0], [1, 0, 0], [1, 2, 0], [0, 2, 1 / 3]])


def write(path: Path, kind: int, axes: np.ndarray | None = None) -> Path:
    file = pyuff.UFF(str(path))
    nodes = {"type": kind, "node_nums": [7, 3, 5, 9], "def_cs": [1] * 4, "disp_cs": [1, 1, 4, 1], "color": [8] * 4}
    sets = [{**nodes, **dict(zip("xyz", XYZ.T, strict=True))}]
    if axes is not None:
        systems = {"CS_sys_labels": [4], "CS_types": [0], "CS_colors": [8], "CS_names": ["turned"]}
        matrices = {"CS_matrices": [np.vstack([axes, np.zeros(3)])]}
        sets.append({"type": 2420, "Part_UID": 1, "Part_Name": "part", **systems, **matrices})
    for each in sets:
        file.write_sets(each)
    return path


@pytest.mark.parametrize("kind", [15, 2411])
def test_nodes(tmp_path: Path, kind: int) -> None:
    nodes = read_geometry(write(tmp_path / "part.unv", kind)).nodes
    assert nodes.id.tolist() == [7, 3, 5, 9]
    np.testing.assert_allclose(nodes.xyz, XYZ, atol=1e-5 if kind == 15 else 1e-15)


def test_axes_of_a_node(tmp_path: Path) -> None:
    assert len(read_geometry(write(tmp_path / "basic.unv", 2411, np.eye(3))).nodes) == 4
    turned = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    with pytest.raises(ReadError, match=r"1 nodes are along turned axes .* node 5"):
        read_geometry(write(tmp_path / "turned.unv", 2411, turned))


def test_no_nodes(tmp_path: Path) -> None:
    path = tmp_path / "empty.unv"
    path.write_text("    -1\n   164\n         1SI: Meter\n    -1\n")
    with pytest.raises(ReadError, match=r"empty\.unv: .*(no nodes in it|cannot read)"):
        read_geometry(path)


@pytest.mark.parametrize("bytes_left_out", [8, 60])
def test_a_file_that_was_cut_loses_no_dataset(tmp_path: Path, bytes_left_out: int) -> None:
    """Nodes of the whole dataset before were all there was."""
    path = write(tmp_path / "part.unv", 2411)
    whole = path.read_bytes()
    path.write_bytes((whole + whole.replace(b"         7", b"        17"))[:-bytes_left_out])
    with pytest.raises(ReadError, match=r"part\.unv: the universal file is truncated"):
        read_geometry(path)


def test_a_line_of_numbers_that_ends_with_the_mark_of_a_dataset(tmp_path: Path) -> None:
    path = write(tmp_path / "part.unv", 2411)
    other = "    -1\n  2435\n         1         0        -1\n         2         0        -1\n    -1\n"
    path.write_text(other + path.read_text())
    with pytest.raises(ReadError, match="a line of numbers ends with -1, which pyuff takes for the end of a dataset"):
        read_geometry(path)
