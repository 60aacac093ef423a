"""Program ``program.py KIND FILE ARRAYS BYTES SECONDS``: a library reads a file, and its arrays are saved.

It runs in a process of its own, because libraries believe the sizes in a file, print, exit, and loop without end on
some damaged files. It imports nothing of cmsreduce, so that it starts quickly.
"""

import contextlib
import runpy
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

Arrays = dict[str, Any]

# Corner nodes by VTK's numbers of linear and quadratic elements.
_VTK_KINDS = {
    **dict.fromkeys((3, 21), "line"),
    **dict.fromkeys((5, 22), "triangle"),
    **dict.fromkeys((9, 23, 28), "quad"),
    **dict.fromkeys((10, 24), "tetra"),
    **dict.fromkeys((12, 25, 29), "hexahedron"),
    **dict.fromkeys((13, 26), "wedge"),
    **dict.fromkeys((14, 27), "pyramid"),
}
# Numbers for each node, above which a lack of memory is due to the numbers.
_SPARSE = 100
# Cells of any order, corners first, as meshio names them.
_LAGRANGE = {
    f"VTK_LAGRANGE_{name}": kind
    for name, kind in (
        ("CURVE", "line"),
        ("TRIANGLE", "triangle"),
        ("QUADRILATERAL", "quad"),
        ("TETRAHEDRON", "tetra"),
        ("HEXAHEDRON", "hexahedron"),
        ("WEDGE", "wedge"),
        ("PYRAMID", "pyramid"),
    )
}

# Ends of names of elements of Kratos, which meshio knows by the names of geometries alone; the first that fits counts.
_KRATOS_LINES = ("Condition2D3N", "LineCondition3D3N", "LineLoadCondition3D3N")
_KRATOS_BARS = tuple(f"{name}Element{dim}D3N" for name in ("Truss", "Beam") for dim in (2, 3))
_KRATOS_SHEETS = tuple(f"{name}Element" for name in ("Thin", "Thick", "Membrane", "Surface"))
_KRATOS_KINDS = {
    **dict.fromkeys((*_KRATOS_LINES, *_KRATOS_BARS), "line3"),
    **dict.fromkeys(
        (*(f"{name}3D4N" for name in ("Condition", "Corotational", "Face", *_KRATOS_SHEETS)), "2D4N"), "quad"
    ),
    **dict.fromkeys(("Condition3D8N", "2D8N"), "quad8"),
    **dict.fromkeys(("Condition3D6N", "2D6N"), "triangle6"),
    **dict.fromkeys(("3D3N", "2D3N"), "triangle"),
    **dict.fromkeys(("3D2N", "2D2N"), "line"),
    **{"3D4N": "tetra", "3D10N": "tetra10", "3D6N": "wedge", "3D8N": "hexahedron", "3D20N": "hexahedron20"},
}


def mesh(path: str, format: str | None = None) -> Arrays:
    """Points, their numbers if the file has such, and cells by number and kind, of a mesh that meshio reads."""
    import meshio
    import numpy as np

    numbers: list[Any] = []
    try:
        numbers = keep_numbers()
    except (ImportError, AttributeError) as error:
        if path.lower().endswith((".msh", ".mdpa")):
            raise ValueError(
                f"meshio {meshio.__version__} does not give the numbers of nodes ({error}): "
                "pip install meshio==5.3.5, or write the mesh as MED"
            ) from error
    if path.lower().endswith(".vtu"):
        take_any_vtu(path)
    try:
        found = meshio.read(path, format)
    except IndexError:
        # The number of a node beyond the largest.
        if numbers and path.lower().endswith(".msh"):
            refuse_missing_node(path, numbers[0])
        raise
    except MemoryError:
        if numbers and (last := int(np.max(numbers[0], initial=0))) > _SPARSE * len(numbers[0]):
            raise ValueError(
                f"its {len(numbers[0])} nodes have numbers up to {last}, and reading takes memory for each number "
                "between: number its nodes anew (RenumberMeshNodes in gmsh), in `rows:`, too"
            ) from None
        raise
    if numbers and path.lower().endswith(".msh"):
        ends = [(np.min(block.data, initial=0), np.max(block.data, initial=0)) for block in found.cells]
        if any(first < 0 or last >= numbers[0].size for first, last in ends) or has_negative(path):
            refuse_missing_node(path, numbers[0])
    if len(numbers) > 1:
        raise ValueError(f"it has {len(numbers)} blocks of nodes, and one is read: write all nodes in one")
    if numbers and path.lower().endswith(".mdpa"):
        # meshio takes the number of a point for its place.
        for block in found.cells:
            number = block.data + 1
            if (missing := number[~np.isin(number, numbers[0])]).size:
                raise ValueError(f"a {block.type} names node {missing[0]}, which is not in the file: write it again")
            block.data[...] = np.searchsorted(numbers[0], number)
    cells = {
        f"{n} {_LAGRANGE.get(block.type, block.type)}": np.asarray(block.data) for n, block in enumerate(found.cells)
    }
    named = named_points(found)
    sets = {f"set {number}": ids for number, ids in enumerate(named.values())}
    own = {"number": numbers[0]} if numbers else {}
    return {"points": np.asarray(found.points), "names": np.array(list(named), dtype=str), **own, **cells, **sets}


def has_negative(path: str) -> bool:
    """True if a negative number stands in the elements of a file of gmsh: meshio counts such nodes from the end."""
    return b"-" in Path(path).read_bytes().rpartition(b"$Elements")[2].partition(b"$EndElements")[0]


def refuse_missing_node(path: str, numbers: Any) -> None:
    """Name the first element of a text of gmsh with a node that is not there; nothing for a binary file."""
    known = {int(number) for number in numbers}
    with open(path, encoding="latin-1") as file:  # noqa: PTH123
        lines = iter(file.read().split("\n"))
    # Comments may stand before it.
    while next(lines).strip() != "$MeshFormat":
        pass
    version, binary, _ = next(lines).split()
    if binary != "0":
        return
    while next(lines).strip() != "$Elements":
        pass
    # Elements of later versions come in blocks, each under a line with their count at its end.
    blocks = int(next(lines).split()[0])
    for _ in range(blocks if version.startswith("4") else 1):
        count = int(next(lines).split()[-1]) if version.startswith("4") else blocks
        for _ in range(count):
            words = [int(word) for word in next(lines).split()]
            first = 1 if version.startswith("4") else 3 + words[2]
            for node in words[first:]:
                if node not in known:
                    raise ValueError(f"element {words[0]} names node {node}, which is not in the file: write it again")


def take_any_vtu(path: str) -> None:
    """Make meshio read what VTK, ParaView and DOLFINx write: versions 2.x, for meshes version 1, and data of a field.

    Raises ValueError for a compressor without a library.
    """
    from xml.etree import ElementTree

    from meshio.vtu import _vtu

    with open(path, "rb") as file:  # noqa: PTH123
        if b"vtkLZ4DataCompressor" in file.read(4096):
            raise ValueError("it is compressed with LZ4: write it with ZLib")

    def mesh_alone(root: Any) -> Any:
        if root.get("version", "").startswith("2."):
            del root.attrib["version"]
        # Times, which are no names of groups, and texts, at which meshio stops.
        for grid in root:
            for data in grid.findall("FieldData"):
                grid.remove(data)
        return root

    trees: Any = ElementTree
    parse, parse_binary = trees.parse, _vtu._parse_raw_binary

    def parsed(*told: Any) -> Any:
        tree = parse(*told)
        mesh_alone(tree.getroot())
        return tree

    trees.parse = parsed
    _vtu._parse_raw_binary = lambda path: mesh_alone(parse_binary(path))


def keep_numbers() -> list[Any]:
    """Make meshio keep the numbers of points in files of gmsh and Kratos, which it drops; they come in this list."""
    import numpy as np
    from meshio.gmsh import _gmsh22, _gmsh40, _gmsh41
    from meshio.mdpa import _mdpa

    kept: list[Any] = []
    for version, first in ((_gmsh22, 0), (_gmsh40, 0), (_gmsh41, 1)):

        def numbered(*told: Any, read: Callable[..., Any] = version._read_nodes, first: int = first) -> Any:
            points, tags, *rest = read(*told)
            kept.append(np.asarray(tags, dtype=np.int64) + first)
            # meshio counts node 0 and negative ones from the end, where these tags lead to no point. Its table has
            # as many rows as the last number, and these are few beside it.
            last = int(np.max(tags, initial=0))
            return points, np.append(tags, np.arange(last + 1, last + 2 + len(tags))), *rest

        version._read_nodes = numbered
    points_of = _mdpa._read_nodes
    _mdpa._mdpa_to_meshio_type |= _KRATOS_KINDS

    def sorted_points(file: Any, *told: Any) -> Any:
        # Rows of Kratos are in order of the numbers.
        start = file.tell()
        points = points_of(file, *told)
        end = file.tell()
        file.seek(start)
        number = np.fromfile(file, count=4 * len(points), sep=" ")[::4].astype(np.int64)
        file.seek(end)
        kept.append(np.sort(number))
        return points[np.argsort(number)]

    _mdpa._read_nodes = sorted_points
    return kept


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


def ansys_nodes(path: str) -> Arrays:
    """Node numbers, coordinates, angles in degrees, and cells by number and kind, of an ANSYS .rst or .cdb file."""
    import numpy as np
    from ansys.mapdl import reader

    with open(path, "rb") as file:  # noqa: PTH123
        binary = b"\0" in file.read(64)
    found: Any = reader.read_binary(path) if binary else reader.Archive(path)
    part = found.mesh if binary else found
    # A file of nodes alone has none.
    grid, cells = found.grid, {}
    if grid is not None:
        number = np.asarray(grid.point_data["ansys_node_num"])
        cells = {
            f"{at} {_VTK_KINDS[int(kind)]}": number[nodes]
            for at, (kind, nodes) in enumerate(grid.cells_dict.items())
            if int(kind) in _VTK_KINDS
        }
    return {
        "number": np.asarray(part.nnum),
        "points": np.asarray(part.nodes),
        "angles": np.asarray(part.node_angles),
        **cells,
    }


def ansys_full(path: str) -> Arrays:
    """Entries of one triangle of K and M of an ANSYS .full file, with node and place of the dof of each row."""
    import numpy as np
    from ansys.mapdl import reader

    found = reader.read_binary(path)
    row_dofs, K, M = found.load_km(sort=True)
    arrays = {"row_dofs": row_dofs, "held": np.asarray(found.const)}
    for name, A in (("K", K), ("M", M)):
        if A is not None:
            entries = A.tocoo()
            arrays |= {f"{name} row": entries.row, f"{name} col": entries.col, f"{name} data": entries.data}
    return arrays


_MED_SOLIDS = ("hexahedron27", "pyramid13", "wedge15", "wedge18")
_MED_KINDS = {"H27": "hexahedron27", "P18": "wedge18", "QU9": "quad9", "SE4": "line4", "TR7": "triangle7"}


def med(path: str) -> Arrays:
    """Arrays of ``mesh`` for a MED file, and the numbers of its points if it has them."""
    import h5py
    from meshio._mesh import topological_dimension
    from meshio.med import _med

    # Results are not asked for, and meshio stops at those of elements, and at a field of one component.
    _med._read_data = lambda *told: None
    # Elements of second order that meshio knows in other formats.
    _med.med_to_meshio_type |= _MED_KINDS
    topological_dimension.update({"quad9": 2, "triangle7": 2, **dict.fromkeys(_MED_SOLIDS, 3)})
    with h5py.File(path, "r") as file:
        if any("ESP" not in each.attrs for each in file["ENS_MAA"].values()):
            raise ValueError("it is of MED 2: open it in Salome or code_aster, and write it again as MED 3 or later")
    # gmsh writes families without groups, at which meshio stops.
    families = _med._read_families
    _med._read_families = lambda found: families({name: one for name, one in found.items() if "GRO" in one})
    arrays = mesh(path, "med")
    with h5py.File(path, "r") as file:
        number = file["ENS_MAA"].visititems(lambda name, item: item[()] if name.endswith("NOE/NUM") else None)
    return arrays if number is None else {**arrays, "number": number}


def universal(path: str) -> Arrays:
    """Nodes, frames, cells and modes of a universal file; no folder is searched for this module (see `libraries`)."""
    found: Arrays = runpy.run_path(str(Path(__file__).with_name("universal.py")))["universal"](path)
    return found


_READERS: dict[str, Callable[[str], Arrays]] = {
    "mesh": mesh,
    "med": med,
    "universal": universal,
    "ansys-nodes": ansys_nodes,
    "ansys-full": ansys_full,
}


def main(kind: str, path: str, arrays: str, most_bytes: str, seconds: str) -> None:
    """Read a file in so many bytes and seconds of a processor at most; stderr has the reason of a failure."""
    with contextlib.suppress(ImportError, ValueError, OSError):
        # Windows has no such limits.
        import resource

        resource.setrlimit(resource.RLIMIT_AS, (int(most_bytes), int(most_bytes)))
        resource.setrlimit(resource.RLIMIT_CPU, (int(seconds), int(seconds)))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    import numpy as np

    warnings.simplefilter("ignore")
    np.savez(arrays, **_READERS[kind](path))


if __name__ == "__main__":
    try:
        main(*sys.argv[1:])
    except Exception as error:
        # Libraries fail on damaged files with errors of any class, and the message is all that this process has to say.
        said = " ".join(str(error).split()) or type(error).__name__
        sys.exit("the sizes in it need more memory than its bytes justify" if isinstance(error, MemoryError) else said)
