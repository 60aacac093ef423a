"""A sweep as CSV and as HDF5, read by other programs."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import h5py
import numpy as np
import pandas as pd

from cmsreduce.write import write_sweep_csv, write_sweep_table
from tests.report.sweeps import HOSTILE, made_sweep


def test_csv(tmp_path: Path) -> None:
    path = tmp_path / "sweep.csv"
    write_sweep_csv(path, made_sweep())
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["reduce.method"] for row in rows] == ["craig-bampton"] * 3 + [HOSTILE] * 2
    assert [row["frf_error"] for row in rows] == ["0.1", "0.1", "0.001", "0.2", ""]
    assert rows[4]["message"] == "no such method, says, 1"
    assert pd.read_csv(path)["n_reduced"].tolist() == [10, 12, 20, 20, 0]


def test_hdf5_is_a_table_of_pandas(tmp_path: Path) -> None:
    path = tmp_path / "sweep.h5"
    write_sweep_table(path, made_sweep())
    with h5py.File(path) as file:
        table = pd.DataFrame(file["points"][()])
        facts = json.loads(file["provenance"][0])
        assert (file.attrs["format"], file.attrs["format_version"]) == ("cmsreduce sweep", 1)
    assert table["point"].tolist() == [1, 2, 3, 4, 5]
    # A key whose values are numbers is a column of numbers.
    np.testing.assert_array_equal(table["reduce.cutoff"], [1.5, 2.0, 4.0, 1.5, 2.0])
    assert table["reduce.method"].str.decode("utf-8").tolist() == ["craig-bampton"] * 3 + [HOSTILE] * 2
    np.testing.assert_array_equal(table["frf_error"], [0.1, 0.1, 0.001, 0.2, np.nan])
    assert table["passed"].tolist() == [False, False, True, False, False]
    assert facts["program"] == "cmsreduce 0" and facts["jobs"] == 2 and facts["seconds"] == 12.5
    assert facts["axes"]["reduce.cutoff"] == ["1.5", "2", "4"]
