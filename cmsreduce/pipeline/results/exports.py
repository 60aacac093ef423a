"""What a run found, as files for other programs: pictures, tables, mode shapes."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np

from cmsreduce.model import RunResult
from cmsreduce.pipeline.bodies import cells_of
from cmsreduce.pipeline.run import Run
from cmsreduce.report import csv_tables, write_pictures
from cmsreduce.write import atomic_path, basic_shapes, write_vtu

__all__ = ["export_pictures", "export_shapes", "export_tables"]


def export_pictures(result: RunResult, folder: Path, suffix: str = ".png") -> list[Path]:
    """Pictures of a run in ``folder/pictures``."""
    return write_pictures(result, folder / "pictures", suffix)


def export_tables(result: RunResult, folder: Path) -> list[Path]:
    """Tables of a run in ``folder/tables``, comma separated, numbers in full."""
    made = []
    for table in csv_tables(result):
        text = io.StringIO()
        lines = csv.writer(text, lineterminator="\n")
        lines.writerow(table.heads)
        lines.writerows(table.rows)
        path = folder / "tables" / f"{table.name}.csv"
        with atomic_path(path) as temporary:
            temporary.write_text(text.getvalue(), encoding="utf-8")
        made.append(path)
    return made


def export_shapes(run: Run, result: RunResult, folder: Path) -> list[Path]:
    """Kept modes of every body with a geometry in ``folder/shapes``, on all its nodes, one VTU file each.

    Parameters
    ----------
    run : Run
        Its bodies.
    result : RunResult
        What it found: the numbers of the modes are those of its tables.
    folder : Path
        Run directory.
    """
    made = []
    for name in run.reduced_names:
        body, modes = run.bodies[name].body, run.final[name]
        if body.nodes is None or not len(body.nodes):
            continue
        cells = cells_of(body)
        moving = np.unique(body.recovery.dofs.node[body.recovery.dofs.component > 0])
        node = np.union1d(moving, np.concatenate([moving[:0], *(corners.ravel() for corners in cells.values())]))
        node = node[body.nodes.index(node) >= 0]
        shapes = np.nan_to_num(basic_shapes(body, body.nodes, modes.Phi, node, "translation"), nan=0.0)
        number = np.sort(result.components[name].kept) + 1
        labels = [
            f"mode {k:03d}, {'static' if np.isinf(w) else f'{w / (2 * np.pi):.5g} Hz'}, {kind}"
            for k, w, kind in zip(number, modes.omega, modes.kind, strict=True)
        ]
        path = folder / "shapes" / f"{name}.vtu"
        placed = {kind: np.searchsorted(node, corners) for kind, corners in cells.items()}
        write_vtu(path, node, body.nodes.xyz[body.nodes.index(node)], placed, labels, shapes)
        made.append(path)
    return made
