"""Elements between nodes, out of decks and meshes."""

from pathlib import Path

import meshio
import numpy as np
import pytest

from cmsreduce.errors import ReadError
from cmsreduce.read import read_cells

SHARED = Path(__file__).parents[3] / "shared" / "data"
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


def test_a_deck(tmp_path: Path) -> None:
    path = tmp_path / "deck.bdf"
    path.write_text(DECK)
    found = listed(path)
    assert sorted(found["line"]) == [[1, 2], [1, 2], [1, 2], [1, 3]]
    assert (found["quad"], found["tetra"]) == ([[1, 2, 3, 4]], [[1, 2, 3, 4]])


def test_an_input_file(tmp_path: Path) -> None:
    path = tmp_path / "body.inp"
    path.write_text(INPUT)
    assert listed(path) == {"tetra": [[1, 2, 3, 4], [11, 12, 13, 14]], "line": [[1, 3]]}


def test_a_mesh_that_meshio_knows(tmp_path: Path) -> None:
    path = tmp_path / "body.vtu"
    meshio.Mesh(np.eye(4)[:, :3], [("tetra", np.array([[0, 1, 2, 3]]))]).write(path)
    assert listed(path) == {"tetra": [[1, 2, 3, 4]]}


def test_files_without_elements(tmp_path: Path) -> None:
    path = tmp_path / "grids.bdf"
    path.write_text("GRID,1,,0.,0.,0.\n")
    assert read_cells(path) == {}
    with pytest.raises(ReadError, match="cannot be read"):
        read_cells(tmp_path / "absent.bdf")


@pytest.mark.shared
@pytest.mark.skipif(not SHARED.is_dir(), reason="the reference bodies are not beside the project")
def test_the_body_of_another_program() -> None:
    path = next((SHARED / "calculix_body").glob("*.frd"))
    (kind, cells), *_ = read_cells(path).items()
    assert kind in ("hexahedron", "tetra", "wedge")
    assert len(cells) > 10
    assert (np.diff(np.sort(cells, axis=1), axis=1) > 0).all()
