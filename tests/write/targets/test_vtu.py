"""Mode shapes as meshio reads them back."""

from pathlib import Path

import meshio
import numpy as np
import pytest

from cmsreduce.errors import WriteError
from cmsreduce.write import write_vtu

NODE = np.array([3, 5, 9, 12])
XYZ = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
SHAPES = np.random.default_rng(2).normal(size=(4, 3, 2))


@pytest.mark.parametrize(
    ("cells", "kinds"),
    [({"quad": np.array([[0, 1, 2, 3]]), "line": np.array([[0, 2]])}, ["quad", "line"]), ({}, ["vertex"])],
)
def test_round_trip(tmp_path: Path, cells: dict[str, np.ndarray], kinds: list[str]) -> None:
    path = tmp_path / "shapes" / "plate.vtu"
    write_vtu(path, NODE, XYZ, cells, ["mode 7", "mode 8"], SHAPES)
    found = meshio.read(path)
    np.testing.assert_array_equal(found.points, XYZ)
    np.testing.assert_array_equal(found.point_data["node"], NODE)
    np.testing.assert_array_equal(found.point_data["mode 8"], SHAPES[:, :, 1])
    assert [block.type for block in found.cells] == kinds


def test_wedges_have_the_orientation_of_vtk(tmp_path: Path) -> None:
    """The normal of the first triangle points away from the second one, or VTK gives the cell a negative volume."""
    xyz = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 3], [1, 0, 3], [0, 1, 3]])
    write_vtu(tmp_path / "x.vtu", np.arange(1, 7), xyz, {"wedge": np.arange(6)[None]}, ["1"], np.zeros((6, 3, 1)))
    (block,) = meshio.read(tmp_path / "x.vtu").cells
    a, b, c, d, e, f = xyz[block.data[0]]
    assert np.cross(b - a, c - a) @ (d - a) == -3.0
    np.testing.assert_array_equal([d - a, e - b, f - c], np.tile([0, 0, 3.0], (3, 1)))


def test_sizes_that_do_not_fit(tmp_path: Path) -> None:
    with pytest.raises(WriteError, match="4 points and 1 names"):
        write_vtu(tmp_path / "x.vtu", NODE, XYZ, {}, ["mode 7"], SHAPES)
