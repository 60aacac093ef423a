"""Findings of a run for people: terminal, HTML page, pictures, files for continuous integration.

Words, tables and plots belong here.
Numbers are computed in `verify` and collected in `pipeline.results`.
"""

from cmsreduce.report.cards import html_card, run_card
from cmsreduce.report.ci import finding_data, junit_xml, markdown_summary, print_findings
from cmsreduce.report.csv_tables import csv_tables
from cmsreduce.report.page import render_report, start_packing
from cmsreduce.report.pareto import trades
from cmsreduce.report.pictures import (
    FIGURE_NAMES,
    Plots,
    figure_pictures,
    response_picture,
    run_pictures,
    sweep_page,
    sweep_picture,
    write_pictures,
)
from cmsreduce.report.terminal import (
    DIFFERENCE_WIDTH,
    RANKINGS_WIDTH,
    SWEEP_WIDTH,
    InspectedLine,
    Output,
    check_line,
    health_lines,
    opened_output,
    plain_data,
    print_difference,
    print_inspected,
    print_rankings,
    print_summary,
    print_sweep,
    sweep_data,
)
from cmsreduce.report.verdict import meaning
from cmsreduce.report.wording import number, numbers, place, rigid_words, worst_error

__all__ = [
    "DIFFERENCE_WIDTH",
    "FIGURE_NAMES",
    "InspectedLine",
    "Output",
    "Plots",
    "RANKINGS_WIDTH",
    "SWEEP_WIDTH",
    "check_line",
    "csv_tables",
    "figure_pictures",
    "finding_data",
    "health_lines",
    "html_card",
    "junit_xml",
    "markdown_summary",
    "meaning",
    "number",
    "numbers",
    "opened_output",
    "plain_data",
    "place",
    "print_difference",
    "print_findings",
    "print_inspected",
    "print_rankings",
    "print_summary",
    "print_sweep",
    "render_report",
    "response_picture",
    "rigid_words",
    "run_card",
    "run_pictures",
    "start_packing",
    "sweep_data",
    "sweep_page",
    "sweep_picture",
    "trades",
    "worst_error",
    "write_pictures",
]
