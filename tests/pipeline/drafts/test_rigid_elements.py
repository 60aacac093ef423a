"""Matrices from before rigid elements act: NASTRAN writes KGG beside KAA, and KGG lacks every RBE2 of the deck."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.errors import DofMapError
from cmsreduce.model import FEModel, cross_matrix
from cmsreduce.pipeline.drafts import draft_body
from cmsreduce.read import MatrixSource, read_body
from tests.frames import frame

XYZ = [[0.0, 0, 0], [0.5, 0, 0], [1, 0.2, 0], [1.2, 0.7, 0.3]]
BODY = frame("part", XYZ, [(1, 2), (2, 3), (3, 4)])


def write(folder: Path, *, springs: bool = False) -> FEModel:
    """Matrices of the g-set, and of the a-set in which node 3 follows node 2, beside a deck with that RBE2."""
    arm = np.array(XYZ[2]) - XYZ[1]
    follows = np.eye(6)
    follows[:3, 3:] = -cross_matrix(arm)
    kept = np.setdiff1d(np.arange(BODY.n), BODY.dofs.rows(3, [1, 2, 3, 4, 5, 6]))
    T = np.eye(BODY.n)[:, kept]
    T[np.ix_(np.arange(12, 18), np.arange(6, 12))] = follows
    K, M = BODY.K.toarray(), BODY.M.toarray()
    for name, A in (("KGG", K), ("MGG", M), ("KAA", T.T @ K @ T), ("MAA", T.T @ M @ T)):
        sp.save_npz(folder / f"{name}.npz", sp.csc_array((A + A.T) / 2))
    rigid = "" if springs else "RBE2,9,2,123456,3\n"
    grids = "".join(f"GRID,{k},,{x},{y},{z}\n" for k, (x, y, z) in enumerate(XYZ, 1))
    (folder / "part.bdf").write_text(f"BEGIN BULK\n{grids}{rigid}ENDDATA\n")
    return BODY


def test_matrices_without_the_rigid_elements_are_refused(tmp_path: Path) -> None:
    def read(letters: str) -> FEModel:
        files = {"stiffness": f"K{letters}.npz", "mass": f"M{letters}.npz"}
        sources = {key: MatrixSource(tmp_path / file) for key, file in files.items()}
        return read_body("part", geometry=tmp_path / "part.bdf", **sources)

    write(tmp_path)
    assert read("AA").n == 18
    with pytest.raises(DofMapError, match=r"KGG\.npz has rows of 6 dofs that rigid elements .* first is 3\.1: .*KAA"):
        read("GG")
    write(tmp_path, springs=True)
    assert read("GG").n == 24


def test_a_draft_takes_the_matrices_in_which_they_act(tmp_path: Path) -> None:
    write(tmp_path)
    draft = draft_body(
        "part", [tmp_path / f"{name}.npz" for name in ("KGG", "MGG", "KAA", "MAA")] + [tmp_path / "part.bdf"]
    )
    assert (draft.stiffness[0].stem, draft.mass[0].stem, draft.remark) == ("KAA", "MAA", "")
