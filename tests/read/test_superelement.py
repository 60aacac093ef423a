"""Files of external superelements by every medium and family of names, made from one that NASTRAN wrote."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from pyyeti.nastran import bulk, op4

from cmsreduce.config import Component
from cmsreduce.errors import CmsReduceError, DampingError
from cmsreduce.linalg.eigen import rigid_body_modes
from cmsreduce.mechanics import Tie, rigid_mass, tie_nodes
from cmsreduce.model import rigid_body_shapes
from cmsreduce.pipeline.drafts import draft_body
from cmsreduce.read import InterfaceSpec, read_body, superelement_damping, superelement_matrices

pytestmark = pytest.mark.shared

# inboard.out: modes with the boundary held.
HELD_HZ = [6.12934551, 6.1301342, 23.6318766]


@pytest.fixture
def theirs(shared_data: Path) -> dict[str, np.ndarray]:
    found: dict[str, np.ndarray] = op4.read(str(shared_data / "nas2cam" / "inboard.op4"))
    return found


def save(path: Path, matrices: Mapping[str, np.ndarray]) -> Path:
    op4.write(str(path), list(matrices), list(matrices.values()))
    return path


def held_hz(path: Path, geometry: Path) -> np.ndarray:
    found = superelement_matrices(path)
    body = read_body("x", stiffness=found.stiffness, mass=found.mass, geometry=geometry)
    q = body.dofs.component == 0
    return np.sqrt(body.K.toarray()[q][:, q].diagonal() / body.M.toarray()[q][:, q].diagonal())[:3] / (2 * np.pi)


def test_every_family_of_names(shared_data: Path, theirs: dict[str, np.ndarray], tmp_path: Path) -> None:
    """KXX of NX, KAA of MSC, KAAX of punch files, and a suffix of the user's own; place holders are no matrices."""
    K, M, none = theirs["kxx"], theirs["mxx"], np.zeros((1, 1))
    for end in ("XX", "AA", "_101"):
        matrices = {"KASMX": none, "MASMX": none, f"K4{end}": none, f"K{end}": K, f"M{end}": M, f"B{end}": none}
        path = save(tmp_path / f"{end}.op4", matrices)
        np.testing.assert_allclose(held_hz(path, shared_data / "nas2cam" / "inboard.asm"), HELD_HZ, rtol=1e-8)
        found = superelement_matrices(path)
        assert found.damping is found.structural is None
    # Rows in the order of the assembly file, each with its grid and component.
    labels = [(grid, dof) for grid in (3, 11, 19, 27) for dof in range(1, 7)] + [(2995001 + k, 0) for k in range(8)]
    index = pd.MultiIndex.from_tuples(labels, names=["id", "dof"])
    with (tmp_path / "inboard.pch").open("w") as file:
        bulk.wtdmig(file, {name: pd.DataFrame(A, index, index) for name, A in (("KAAX", K), ("MAAX", M))})
    shutil.copy(shared_data / "nas2cam" / "inboard.asm", tmp_path / "inboard.asm")
    assert held_hz(tmp_path / "inboard.pch", tmp_path / "inboard.asm") == pytest.approx(HELD_HZ, rel=1e-8)
    draft = draft_body("inboard", [tmp_path / "inboard.asm"])
    assert (draft.remark, draft.stiffness) == ("", (tmp_path / "inboard.pch", "KAAX"))
    assert draft.interfaces[0][1] == "{set: b}"
    assert Component.model_validate({"extseout": tmp_path / "inboard"}).geometry.file == tmp_path / "inboard.asm"


def test_damping_that_comes_with_a_superelement(theirs: dict[str, np.ndarray], tmp_path: Path) -> None:
    K, M = theirs["kxx"], theirs["mxx"]
    uneven = 0.02 * K.copy()
    uneven[30, 30] *= 2
    none = np.zeros((1, 1))

    def damping(B: np.ndarray, K4: np.ndarray) -> tuple[float | None, str | None]:
        path = save(tmp_path / "x.op4", {"KAA": K, "MAA": M, "BAA": B, "K4AA": K4})
        law, matrix = superelement_damping("x", superelement_matrices(path))
        return law and law.structural, matrix and matrix.matrix

    assert damping(none, none) == damping(0 * K, 0 * K) == (None, None)
    assert damping(1e-4 * K, none) == (None, "BAA")
    assert damping(none, 0.02 * K) == (0.02, None)
    for B, K4, message in ((1e-4 * K, 0.02 * K, "viscous damping BAA and structural"), (none, uneven, "no multiple")):
        with pytest.raises(DampingError, match=message):
            damping(B, K4)


@pytest.mark.parametrize("stem", ["inboard", "outboard"])
def test_one_point_may_move_the_whole_boundary(shared_data: Path, stem: str) -> None:
    """The boundary resists no rigid motion: what cancels in its stiffness is noise that would hold the body."""
    files = shared_data / "nas2cam" / stem
    found = superelement_matrices(files.with_suffix(".op4"))
    faces = {"hub": InterfaceSpec((3, 11, 19, 27))}
    geometry = files.with_suffix(".asm")
    body = read_body("x", stiffness=found.stiffness, mass=found.mass, geometry=geometry, interfaces=faces)
    tied = tie_nodes(body, "hub", Tie("rigid"))
    assert tied.nodes is not None
    shapes = rigid_body_shapes(tied.dofs, tied.nodes)
    assert rigid_body_modes(tied.K, tied.M, shapes, tied.stiffness_rounding, "x").shape[1] == 6
    np.testing.assert_allclose(rigid_mass(tied), rigid_mass(body), rtol=1e-9, atol=1e-6)


def test_a_file_without_a_pair_names_what_it_holds(theirs: dict[str, np.ndarray], tmp_path: Path) -> None:
    path = save(tmp_path / "x.op4", {"KAA": theirs["kxx"], "MXX": theirs["mxx"]})
    with pytest.raises(CmsReduceError, match=r"no stiffness and mass of a superelement.*: KAA, MXX\. Name both"):
        superelement_matrices(path)
