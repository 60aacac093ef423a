"""A sweep as tables: CSV for spreadsheets, HDF5 with provenance for programs."""

from __future__ import annotations

import csv
import io
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import SweepResult, SweepRow
from cmsreduce.write.files import atomic_path, fixed_texts, hdf5_file, put, put_texts

__all__ = ["write_sweep_csv", "write_sweep_table"]

SWEEP_FORMAT, SWEEP_FORMAT_VERSION = "cmsreduce sweep", 1

_COUNTS = ("kept_modes", "basis_size", "n_reduced", "n_full")
_FIGURES = ("frf_error", "db_error", "frequency_error", "damping_error", "channel_error")
_COSTS = ("steps_per_second", "operations", "simulation_s", "simulation_noise")
_TIMES = ("reduce_s", "full_frf_s", "reduced_frf_s", *_COSTS, "point_s")
_ABOUT = "one row for each point of the sweep; errors are the worst over all configurations, times in seconds"


def write_sweep_csv(path: Path, sweep: SweepResult) -> None:
    """Write one line for each point, the swept keys as columns; a missing value is an empty field."""
    text = io.StringIO()
    lines = csv.writer(text, lineterminator="\n")
    lines.writerow(["point", *sweep.axes, "status", *_COUNTS, *_FIGURES, *_TIMES, "folder", "message"])
    for row in sweep.rows:
        counts = [getattr(row, name) for name in _COUNTS]
        figures = [_number(getattr(row, name)) for name in (*_FIGURES, *_TIMES)]
        swept = [row.overrides[key] for key in sweep.axes]
        lines.writerow([row.point, *swept, row.status, *counts, *figures, row.folder, row.message])
    with atomic_path(path) as temporary:
        temporary.write_text(text.getvalue(), encoding="utf-8")


def write_sweep_table(path: Path, sweep: SweepResult) -> None:
    """Write the table ``points``, a compound dataset, and the provenance.

    Parameters
    ----------
    path : Path
        HDF5 file.
    sweep : SweepResult

    Notes
    -----
    ``pandas.DataFrame(h5py.File(path)["points"][()])`` reads it. A swept key is a column of numbers where all its
    values are numbers, and of UTF-8 texts otherwise.
    """
    columns: dict[str, NDArray[Any]] = {"point": np.array([row.point for row in sweep.rows], dtype=np.int64)}
    for key in sweep.axes:
        columns[key] = _column([row.overrides[key] for row in sweep.rows])
    columns |= {
        "status": fixed_texts(row.status for row in sweep.rows),
        "passed": np.array([row.status == "passed" for row in sweep.rows]),
        **{name: _gathered(sweep.rows, name, np.int64) for name in _COUNTS},
        **{name: _gathered(sweep.rows, name, np.float64) for name in (*_FIGURES, *_TIMES)},
        "folder": fixed_texts(row.folder for row in sweep.rows),
        "message": fixed_texts(row.message for row in sweep.rows),
    }
    table = np.zeros(len(sweep.rows), dtype=[(name, column.dtype) for name, column in columns.items()])
    for name, column in columns.items():
        table[name] = column
    with hdf5_file(path) as file:
        file.attrs["format"], file.attrs["format_version"] = SWEEP_FORMAT, SWEEP_FORMAT_VERSION
        file.attrs["name"] = sweep.name
        put(file, "points", table, about=_ABOUT)
        facts = {**sweep.provenance, "axes": dict(sweep.axes), "seconds": sweep.seconds}
        put_texts(file, "provenance", [json.dumps(facts, sort_keys=True)], about="JSON")


def _number(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.9g}"


def _gathered(rows: tuple[SweepRow, ...], name: str, kind: type[np.generic]) -> NDArray[Any]:
    return np.array([getattr(row, name) for row in rows], dtype=kind)


def _column(values: list[str]) -> NDArray[Any]:
    try:
        return np.array([float(value) for value in values])
    except ValueError:
        return fixed_texts(values)
