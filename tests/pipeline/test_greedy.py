"""`keep: limits` never keeps more modes than a greedy search in which nothing is shared but bodies and joints."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from cmsreduce.config import load_pipeline
from cmsreduce.pipeline import Run, Silent
from tests.pipeline.greedy import Greedy

PIPELINES = Path(__file__).parents[2] / "pipelines"
ONLY_RESPONSES = ["balance={keep: limits}", "verify.compare={}", "verify.between=0", "write=null"]
ISS = """\
name: iss
components:
  iss: {states: iss.mat, rows: iss.dof, geometry: iss.bdf, grounded: true, damping: {modal: 0.005}}
scene:
  band: 2 Hz
  actuators:
    x: {at: iss.1, force: [1, 0, 0]}
    y: {at: iss.1, force: [0, 1, 0]}
    z: {at: iss.1, force: [0, 0, 1]}
  sensors: {rates: {at: iss.1, measure: [x, y, z], rate: true}}
reduce: {method: craig-bampton, cutoff: 3.0}
"""


def iss(folder: Path, shared_data: Path) -> Path:
    """ISS-1R driven where it is measured."""
    data = loadmat(shared_data / "slicot" / "iss.mat")
    A, C = (np.asarray(data[name].toarray(), dtype=float) for name in "AC")
    n = A.shape[0] // 2
    savemat(folder / "iss.mat", {"M": np.eye(n), "K": -A[n:, :n], "B": C[:, n:].T, "C": C[:, n:]})
    (folder / "iss.bdf").write_text("BEGIN BULK\nGRID,1,,0.,0.,0.\nENDDATA\n")
    (folder / "iss.dof").write_text("1.1\n1.2\n1.3\n")
    path = folder / "iss.yaml"
    path.write_text(ISS)
    return path


@pytest.mark.parametrize(
    ("system", "frf_error", "db_error"),
    [
        ("rotating_beam", 0.1, 3.0),
        ("hub_beams", 0.1, 1.0),
        pytest.param("iss", 0.05, 6.0, marks=pytest.mark.shared),
    ],
)
def test_no_greedy_search_keeps_fewer_modes(
    tmp_path: Path, shared_data: Path, system: str, frf_error: float, db_error: float
) -> None:
    path = iss(tmp_path, shared_data) if system == "iss" else PIPELINES / f"{system}.yaml"
    limits = f"verify.limits={{frf_error: {frf_error}, db_error: {db_error}}}"
    run = Run(load_pipeline(path, [*ONLY_RESPONSES, limits]), tmp_path, Silent())
    search = run.choice.search
    assert search is not None and search.modes < search.of
    greedy = Greedy(run, frf_error, db_error)
    # Both measure the same: on the grid of all candidates here, on one of its own there.
    kept = [number for number, (name, k) in enumerate(greedy.modes) if k in run.selection[name]]
    assert greedy.error(kept) == pytest.approx(search.critical.ratio, rel=0.05)
    assert search.modes <= greedy.fewest()


def test_galileo_needs_at_most_thirty_modes(tmp_path: Path) -> None:
    """2 % and 1 dB at its eight angles and between them, by the greedy search's own algebra, too."""
    free_modes = ["reduce.method=macneal-rubin", "reduce.cutoff=1.05"]
    limits = ["balance={keep: limits}", "verify.limits={frf_error: 0.02, db_error: 1.0}", "verify.compare={}"]
    run = Run(load_pipeline(PIPELINES / "galileo.yaml", [*limits, *free_modes, "write=null"]), tmp_path, Silent())
    search = run.choice.search
    assert search is not None and search.modes <= 30 and search.critical.ratio <= 1.0
    greedy = Greedy(run, 0.02, 1.0)
    assert greedy.error([k for k, (name, mode) in enumerate(greedy.modes) if mode in run.selection[name]]) <= 1.0
