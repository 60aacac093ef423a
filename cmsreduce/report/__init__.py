"""Findings of a run for people: terminal, HTML page, pictures, files for continuous integration.

Words, tables and plots belong here.
Numbers are computed in `verify` and collected in `pipeline.results`.
"""

from cmsreduce.report.ci import finding_data, junit_xml, markdown_summary, print_findings
from cmsreduce.report.csv_tables import csv_tables
from cmsreduce.report.page import render_report, start_packing
from cmsreduce.report.pareto import trades
from cmsreduce.report.pictures import response_picture, sweep_page, sweep_picture, write_pictures
from cmsreduce.report.terminal import (
    DIFFERENCE_WIDTH,
    RANKINGS_WIDTH,
    SWEEP_WIDTH,
    Output,
    opened_output,
    print_difference,
    print_inspected,
    print_rankings,
    print_summary,
    print_sweep,
    sweep_data,
    worst_error,
)

__all__ = [
    "DIFFERENCE_WIDTH",
    "Output",
    "RANKINGS_WIDTH",
    "SWEEP_WIDTH",
    "csv_tables",
    "finding_data",
    "junit_xml",
    "markdown_summary",
    "opened_output",
    "print_difference",
    "print_findings",
    "print_inspected",
    "print_rankings",
    "print_summary",
    "print_sweep",
    "render_report",
    "response_picture",
    "start_packing",
    "sweep_data",
    "sweep_page",
    "sweep_picture",
    "trades",
    "worst_error",
    "write_pictures",
]
