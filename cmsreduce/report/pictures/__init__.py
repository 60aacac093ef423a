"""Static pictures of runs and sweeps.

SVG and PNG files belong here.
Interactive plots belong in `report.page`.
"""

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
    "figure_pictures",
    "response_picture",
    "run_pictures",
    "sweep_page",
    "sweep_picture",
    "write_pictures",
]
