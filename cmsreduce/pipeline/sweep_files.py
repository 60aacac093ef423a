"""What a sweep leaves in its folder: tables and the picture of error against speed."""

from __future__ import annotations

from pathlib import Path

from cmsreduce.model.sweep_result import SweepResult
from cmsreduce.report.pareto import trades
from cmsreduce.report.sweep_picture import sweep_page, sweep_picture
from cmsreduce.write import atomic_path
from cmsreduce.write.sweep_table import write_sweep_csv, write_sweep_table

__all__ = ["write_sweep"]


def write_sweep(sweep: SweepResult, folder: Path) -> tuple[Path, ...]:
    """Write sweep.csv and sweep.h5, and sweep.svg and sweep.html where there are errors to draw; return the files."""
    table, store = folder / "sweep.csv", folder / "sweep.h5"
    write_sweep_csv(table, sweep)
    write_sweep_table(store, sweep)
    picture, page = folder / "sweep.svg", folder / "sweep.html"
    if not trades(sweep):
        # Those of an earlier sweep would show what this one did not find.
        picture.unlink(missing_ok=True)
        page.unlink(missing_ok=True)
        return table, store
    with atomic_path(picture) as temporary:
        # The suffix of the temporary name says no format.
        drawn = temporary.with_suffix(".svg")
        sweep_picture(sweep, drawn)
        drawn.replace(temporary)
    with atomic_path(page) as temporary:
        temporary.write_text(sweep_page(sweep), encoding="utf-8")
    return table, store, picture, page
