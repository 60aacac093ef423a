"""Results of finished runs: collected, compared with limits and baselines, exported.

Steps from a run to the data that files and reports show belong here.
Rendering belongs in `report`, file formats in `write`.
"""

from cmsreduce.pipeline.results.checking import (
    check_result,
    refuse_model_file,
    refuse_other_summary,
    write_junit,
    write_markdown,
)
from cmsreduce.pipeline.results.component_files import refuse_unwritable, write_body, write_system_file
from cmsreduce.pipeline.results.exports import (
    export_figures,
    export_pictures,
    export_shapes,
    export_tables,
    write_system_states,
)
from cmsreduce.pipeline.results.floating_bodies import floating_bodies, floating_body
from cmsreduce.pipeline.results.health import effective_mass_data, effective_mass_lines, health_table
from cmsreduce.pipeline.results.inspected_models import inspected_body, inspected_system
from cmsreduce.pipeline.results.limits import read_limits
from cmsreduce.pipeline.results.mass_and_frame import body_totals, file_totals, frame_lines, total_data, total_lines
from cmsreduce.pipeline.results.measured_costs import measured_costs
from cmsreduce.pipeline.results.multibody_scene import multibody_scene
from cmsreduce.pipeline.results.page import show_summary, write_report
from cmsreduce.pipeline.results.result import run_result, with_failures
from cmsreduce.pipeline.results.run_difference import run_difference
from cmsreduce.pipeline.results.step_advice import file_rounding
from cmsreduce.pipeline.results.units import convert_file, convert_system, unit_paths, without_binary

__all__ = [
    "inspected_body",
    "inspected_system",
    "body_totals",
    "check_result",
    "convert_file",
    "convert_system",
    "effective_mass_data",
    "effective_mass_lines",
    "export_figures",
    "export_pictures",
    "export_shapes",
    "export_tables",
    "file_rounding",
    "file_totals",
    "floating_bodies",
    "floating_body",
    "frame_lines",
    "health_table",
    "measured_costs",
    "multibody_scene",
    "read_limits",
    "refuse_model_file",
    "refuse_other_summary",
    "refuse_unwritable",
    "run_difference",
    "run_result",
    "show_summary",
    "total_data",
    "total_lines",
    "unit_paths",
    "with_failures",
    "without_binary",
    "write_body",
    "write_junit",
    "write_markdown",
    "write_report",
    "write_system_file",
    "write_system_states",
]
