"""Pictures of runs and sweeps, as files and in notebooks.

A chart is data (`chart`, `charts`); `still` draws it into a file, `live` in a notebook.
Plots that answer to choices belong in `report.page`.
"""

from cmsreduce.report.pictures.live import Plots
from cmsreduce.report.pictures.run import (
    FIGURE_NAMES,
    figure_pictures,
    response_picture,
    run_pictures,
    write_pictures,
)
from cmsreduce.report.pictures.sweep import sweep_page, sweep_picture

__all__ = [
    "FIGURE_NAMES",
    "Plots",
    "figure_pictures",
    "response_picture",
    "run_pictures",
    "sweep_page",
    "sweep_picture",
    "write_pictures",
]
