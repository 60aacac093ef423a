"""Files that a run leaves: component files, system files, summaries, and files and whole scenes of other programs.

Every file is written whole under a temporary name and renamed.
The choice of what to write belongs in `pipeline`.
"""

from cmsreduce.write.component import (
    SAME_MASS,
    ComponentFile,
    basic_shapes,
    read_component,
    stored_integrals,
    write_component,
)
from cmsreduce.write.export import EXPORTS, export_scene
from cmsreduce.write.files import atomic_path, hdf5_file, put_texts
from cmsreduce.write.own_files import LOG_MARK, record_outputs, refuse_changed, refuse_foreign, refuse_shared_names
from cmsreduce.write.seal import is_sealed, verify_seal
from cmsreduce.write.summary import read_summary, summary, write_summary, write_sweep_csv, write_sweep_table
from cmsreduce.write.system import write_system
from cmsreduce.write.system_file import SystemFile, read_system, stated_settings, system_settings
from cmsreduce.write.targets import (
    PROFILES,
    TARGETS,
    JoinedNodes,
    LinearModel,
    Port,
    Profile,
    StateSpace,
    Target,
    TargetFiles,
    component_states,
    conversion,
    convert,
    profile_files,
    refuse_other_file,
    unit_binary,
    write_matlab,
    write_unit,
    write_vtu,
)

__all__ = [
    "ComponentFile",
    "EXPORTS",
    "JoinedNodes",
    "LOG_MARK",
    "LinearModel",
    "PROFILES",
    "Port",
    "Profile",
    "SAME_MASS",
    "StateSpace",
    "SystemFile",
    "TARGETS",
    "Target",
    "TargetFiles",
    "atomic_path",
    "basic_shapes",
    "component_states",
    "conversion",
    "convert",
    "export_scene",
    "hdf5_file",
    "is_sealed",
    "profile_files",
    "put_texts",
    "read_component",
    "read_summary",
    "read_system",
    "record_outputs",
    "refuse_changed",
    "refuse_foreign",
    "refuse_other_file",
    "refuse_shared_names",
    "stored_integrals",
    "summary",
    "stated_settings",
    "system_settings",
    "unit_binary",
    "verify_seal",
    "write_component",
    "write_matlab",
    "write_summary",
    "write_sweep_csv",
    "write_sweep_table",
    "write_system",
    "write_unit",
    "write_vtu",
]
