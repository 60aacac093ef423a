"""Terminal output: progress, summary, tables.

Everything that a command prints belongs here.
Files for continuous integration belong in `report.ci`.
"""

from cmsreduce.report.terminal.output import Output, opened_output
from cmsreduce.report.terminal.rankings import RANKINGS_WIDTH, print_rankings
from cmsreduce.report.terminal.run import print_summary, worst_error
from cmsreduce.report.terminal.sweep import SWEEP_WIDTH, print_sweep, sweep_data
from cmsreduce.report.terminal.tables import DIFFERENCE_WIDTH, print_difference, print_inspected

__all__ = [
    "DIFFERENCE_WIDTH",
    "Output",
    "RANKINGS_WIDTH",
    "SWEEP_WIDTH",
    "opened_output",
    "print_difference",
    "print_inspected",
    "print_rankings",
    "print_summary",
    "print_sweep",
    "sweep_data",
    "worst_error",
]
