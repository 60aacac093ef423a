"""Component files of tied bodies: shapes at nodes that have no rows, of rigid motion among them."""

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np

from cmsreduce.pipeline import Run, execute
from tests.pipeline.test_ties import tied

__all__ = ["tied"]


def test_shapes_of_tied_nodes(tied: Callable[..., Run], study: Path) -> None:
    execute(tied("write={all_nodes: true}"), study, report=False)
    for name in ("near", "far"):
        with h5py.File(study.parent / "out" / f"{name}.h5") as file:
            ids, xyz = file["nodes/id"][:], file["nodes/xyz"][:]
            shapes = file["nodes/translation"][:, :, :6]
            assert ids.tolist() == list(range(1, 56))
            assert len(file["dofs/label"]) == 54 * 3 + 6
        assert np.isfinite(shapes).all()
        # Each of the first six modes is a rigid motion, of tied nodes too: a + b x r.
        A = np.zeros((55, 3, 6))
        A[:, range(3), range(3)] = 1.0
        A[:, 0, 4], A[:, 0, 5], A[:, 1, 3] = xyz[:, 2], -xyz[:, 1], -xyz[:, 2]
        A[:, 1, 5], A[:, 2, 3], A[:, 2, 4] = xyz[:, 0], xyz[:, 1], -xyz[:, 0]
        found, *_ = np.linalg.lstsq(A.reshape(-1, 6), shapes.reshape(-1, 6), rcond=None)
        np.testing.assert_allclose(A.reshape(-1, 6) @ found, shapes.reshape(-1, 6), atol=1e-8 * abs(shapes).max())
