"""A target of your own: frequencies and damping ratios as comma-separated values (docs/extend.md).

Its place would be cmsreduce/write/targets/modes_csv.py.
"""

from pathlib import Path

import numpy as np

import cmsreduce as cms
from cmsreduce.write import TARGETS, Target
from cmsreduce.write.component import ComponentFile
from cmsreduce.write.files import atomic_path


def write_modes_csv(path: Path, component: ComponentFile) -> None:
    """Write frequency in Hz and damping ratio of each mode; static modes have no frequency."""
    columns = [component.arrays["modes/frequency_hz"], component.arrays["modes/zeta"]]
    with atomic_path(path) as temporary:
        np.savetxt(temporary, np.column_stack(columns), delimiter=",", header="frequency_hz,damping_ratio", comments="")


TARGETS["modes-csv"] = Target(".modes.csv", write_modes_csv, integrals=False)
SAMPLE = Path(__file__).parents[2] / "sample_models" / "galileo"


def test_convert_knows_the_ending(tmp_path: Path) -> None:
    """Read as another program would, and compared with the component file."""
    body = cms.read_body(
        "stator",
        stiffness=(f"{SAMPLE}/stator.op4", "KAA"),
        mass=(f"{SAMPLE}/stator.op4", "MAA"),
        geometry=f"{SAMPLE}/stator.bdf",
        interfaces={"bearing": 2001},
    )
    cms.write_component(cms.orthogonalise(cms.CraigBampton(cutoff_hz=20).reduce(body)), tmp_path / "stator.h5")
    (written,) = cms.convert(tmp_path / "stator.h5", tmp_path / "stator.modes.csv")
    table, stored = np.genfromtxt(written, delimiter=",", names=True), cms.read_component(tmp_path / "stator.h5")
    assert np.allclose(2 * np.pi * table["frequency_hz"], stored.omega, equal_nan=True)
    assert (table["damping_ratio"][: stored.rigid_count] == 0).all()
