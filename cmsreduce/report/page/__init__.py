"""The HTML report.

Data of its plots, rows of its tables and the page itself belong here.
Static pictures belong in `report.pictures`.
"""

from cmsreduce.report.page.curves import decibels, phase_degrees
from cmsreduce.report.page.page import embedded, packed_plotly, part, render_report, start_packing

__all__ = ["decibels", "embedded", "packed_plotly", "part", "phase_degrees", "render_report", "start_packing"]
