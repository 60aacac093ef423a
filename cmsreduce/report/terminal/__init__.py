"""Terminal output: progress, summary, tables.

Everything that a command prints belongs here.
Files for continuous integration belong in `report.ci`.
"""

from cmsreduce.report.terminal.output import Output, opened_output, plain_data
from cmsreduce.report.terminal.run import print_summary
from cmsreduce.report.terminal.sweep import SWEEP_WIDTH, print_sweep, sweep_data
from cmsreduce.report.terminal.tables import (
    DIFFERENCE_WIDTH,
    RANKINGS_WIDTH,
    InspectedLine,
    check_line,
    figures,
    health_lines,
    print_difference,
    print_inspected,
    print_rankings,
    table,
    verdict,
    words,
)

__all__ = [
    "DIFFERENCE_WIDTH",
    "InspectedLine",
    "Output",
    "RANKINGS_WIDTH",
    "SWEEP_WIDTH",
    "check_line",
    "figures",
    "health_lines",
    "opened_output",
    "plain_data",
    "print_difference",
    "print_inspected",
    "print_rankings",
    "print_summary",
    "print_sweep",
    "sweep_data",
    "table",
    "verdict",
    "words",
]
