"""Program ``mesh_process.py MESH ARRAYS BYTES SECONDS``: meshio reads a mesh; points, cells and sets are saved.

It runs in a process of its own, because meshio believes the sizes in a file, prints, exits, and loops without end on
some damaged files. It imports nothing of cmsreduce, so that it starts quickly.
"""

import contextlib
import sys
import warnings
from typing import Any


def main(mesh: str, arrays: str, most_bytes: str, seconds: str) -> None:
    """Read a mesh in so many bytes and seconds of a processor at most; stderr has the reason of a failure."""
    with contextlib.suppress(ImportError, ValueError, OSError):
        # Windows has no such limits.
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (int(most_bytes), int(most_bytes)))
        resource.setrlimit(resource.RLIMIT_CPU, (int(seconds), int(seconds)))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    import meshio
    import numpy as np

    warnings.simplefilter("ignore")
    found = meshio.read(mesh)
    cells = {f"{number} {block.type}": np.asarray(block.data) for number, block in enumerate(found.cells)}
    named = named_points(found)
    sets = {f"set {number}": ids for number, ids in enumerate(named.values())}
    names = np.array(list(named), dtype=str)
    np.savez(arrays, points=np.asarray(found.points), names=names, **cells, **sets)  # type: ignore[arg-type]


def named_points(mesh: Any) -> dict[str, Any]:
    """Points by the name of their set, from 0: sets of points and of cells, physical groups, families of MED."""
    import numpy as np

    found: dict[str, list[Any]] = {}
    for name, ids in mesh.point_sets.items():
        found.setdefault(name, []).append(ids)
    for name, chosen in mesh.cell_sets.items():
        for block, cells in zip(mesh.cells, chosen, strict=False):
            if cells is not None and not name.startswith("gmsh:"):
                found.setdefault(name, []).append(block.data[np.asarray(cells, dtype=np.int64)])
    for number, block in enumerate(mesh.cells):
        for key, names in _cell_tags(mesh, block.dim):
            if key in mesh.cell_data:
                tags = np.asarray(mesh.cell_data[key][number])
                for tag, labels in names.items():
                    for label in labels:
                        found.setdefault(label, []).append(block.data[tags == tag])
    for tag, labels in getattr(mesh, "point_tags", {}).items():
        for label in labels:
            found.setdefault(label, []).append(np.flatnonzero(mesh.point_data["point_tags"] == tag))
    joined = {name: np.concatenate([np.ravel(part) for part in parts]) for name, parts in found.items()}
    return {name: np.unique(ids.astype(np.int64)) for name, ids in joined.items() if ids.size}


def _cell_tags(mesh: Any, dim: int) -> list[tuple[str, dict[int, list[str]]]]:
    """Keys of cell data that hold tags, with the names of each tag: of gmsh, by dimension, and of MED."""
    physical = {int(tag): [name] for name, (tag, of, *_) in mesh.field_data.items() if of == dim}
    return [("gmsh:physical", physical), ("cell_tags", getattr(mesh, "cell_tags", {}))]


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except Exception as error:
        said = " ".join(str(error).split()) or type(error).__name__
        sys.exit("the sizes in it need more memory than its bytes justify" if isinstance(error, MemoryError) else said)
