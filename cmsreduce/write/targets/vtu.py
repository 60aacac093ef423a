"""ParaView: mode shapes of a body on its mesh, as a VTU file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import WriteError
from cmsreduce.write.files import atomic_path

__all__ = ["write_vtu"]

# Decks turn the first triangle of a wedge towards the second one, VTK away from it; meshio writes nodes as they come.
_IN_VTK = {"wedge": [0, 2, 1, 3, 5, 4]}


def write_vtu(
    path: Path,
    node: NDArray[np.int64],
    xyz: NDArray[np.float64],
    cells: Mapping[str, NDArray[np.int64]],
    names: Sequence[str],
    shapes: NDArray[np.float64],
) -> None:
    """Write mode shapes as point vectors of a VTU file.

    Parameters
    ----------
    path : Path
        Name of the file, which is complete or absent.
    node : (p,) int64
        Node ids, stored as ``node``.
    xyz : (p, 3) float64
        Coordinates.
    cells : mapping of meshio cell kind to (k, corners) int64
        Positions in ``node``, in the order of NASTRAN and Abaqus; without cells, every point is a vertex.
    names : sequence of str
        One for each mode, unique.
    shapes : (p, 3, m) float64
        Displacement of each point in each mode.

    Raises
    ------
    WriteError
        If sizes disagree or the file cannot be written.
    """
    import meshio

    if shapes.shape != (len(node), 3, len(names)) or xyz.shape != (len(node), 3):
        raise WriteError(f"{path}: {len(node)} points and {len(names)} names do not fit shapes of {shapes.shape}")
    blocks = [(kind, corners[:, _IN_VTK.get(kind, slice(None))]) for kind, corners in cells.items() if len(corners)]
    if not blocks:
        blocks = [("vertex", np.arange(len(node))[:, None])]
    data = {"node": np.asarray(node, dtype=np.int64)}
    data |= {name: np.ascontiguousarray(shapes[:, :, k]) for k, name in enumerate(names)}
    mesh = meshio.Mesh(np.asarray(xyz, dtype=np.float64), blocks, point_data=data)
    with atomic_path(path) as temporary:
        meshio.write(temporary, mesh, file_format="vtu")
