"""A superelement that hangs on one grid: condensation leaves round-off in the rows of this grid, and no stiffness."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.errors import DofMapError
from cmsreduce.read import MatrixSource, prove_row_order, read_body
from tests.pipeline.study import panel

ROOT, KEPT = 6, 20
DECK = "EXTRN,1,123456,901,THRU,920,0\nGRID,1,,.8,0.,0.\nSPOINT,901,THRU,920\n"


def condensed() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Matrices of the panel by Craig and Bampton with its first node as boundary, and its elastic frequencies."""
    body = panel()
    K, M = body.K.toarray(), body.M.toarray()
    # Round-off of condensation depends on the solver; here it is that of a larger model.
    K += 1e-15 * abs(K).max() * np.random.default_rng(1).normal(size=K.shape)
    K = (K + K.T) / 2
    static = -la.solve(K[ROOT:, ROOT:], K[ROOT:, :ROOT])
    modes = la.eigh(K[ROOT:, ROOT:], M[ROOT:, ROOT:])[1][:, :KEPT]
    T = np.block([[np.eye(ROOT), np.zeros((ROOT, KEPT))], [static, modes]])
    exact = np.sqrt(la.eigh(T.T @ body.K @ T, T.T @ M @ T, eigvals_only=True)[ROOT:])
    return T.T @ K @ T, T.T @ M @ T, exact


def read(folder: Path, K: np.ndarray, M: np.ndarray, **keys: bool):
    for name, A in (("K", K), ("M", M)):
        sp.save_npz(folder / f"{name}.npz", sp.csc_array((A + A.T) / 2))
    (folder / "panel.pch").write_text("BEGIN SUPER 5\n" + DECK)
    source = {"stiffness": MatrixSource(folder / "K.npz"), "mass": MatrixSource(folder / "M.npz")}
    return read_body("panel", **source, geometry=folder / "panel.pch", **keys)


def test_round_off_at_the_boundary_is_no_stiffness(tmp_path: Path) -> None:
    K, M, exact = condensed()
    assert abs(K[:ROOT]).max() > 1e-9
    body = read(tmp_path, K, M)
    assert prove_row_order(body).status == "proven" and abs(body.K[:ROOT]).max() == 0
    (remark,) = body.remarks
    assert f"up to {max(abs(K[:ROOT]).max(), abs(K[:, :ROOT]).max()):.2g} (" in remark and "rounding" in remark
    found = np.sqrt(abs(la.eigh(body.K.toarray(), body.M.toarray(), eigvals_only=True)))
    np.testing.assert_allclose(found[ROOT : ROOT + 4], exact[:4], rtol=1e-7)


@pytest.mark.parametrize("share", [1e-5, 1e-3])
def test_a_spring_to_ground_at_the_boundary_is_one(tmp_path: Path, share: float) -> None:
    """It lets the body sway at three thousandths of the first frequency, or more."""
    K, M, _ = condensed()
    K[0, 0] += share * K[ROOT, ROOT] * M[0, 0]
    with pytest.raises(DofMapError, match=r"rigid motion must cost no force, .* the worst are 1 "):
        read(tmp_path, K, M)


def test_a_held_body_keeps_its_stiffness(tmp_path: Path) -> None:
    K, M, _ = condensed()
    K[:ROOT, :ROOT] += np.diag(np.full(ROOT, 1e3))
    body = read(tmp_path, K, M, grounded=True)
    assert body.K[0, 0] == pytest.approx(1e3) and not body.remarks
