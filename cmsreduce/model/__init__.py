"""Plain data that flows between stages: frozen, with shapes and units.

Bodies, mode sets, reduced bodies, scenes and systems belong here; findings of a run belong in `model.results`.
Nothing here reads a file, solves or prints, except for arrays that are mapped because they outgrow memory, and for the
check of HDF5 files that every reader of them needs.
"""

from cmsreduce.model import results
from cmsreduce.model.body import FEModel, Interface, Recovery, RigidBody, Source, UntiedMass
from cmsreduce.model.damping import Damping
from cmsreduce.model.dofs import (
    KEY_STEP,
    SCALAR,
    DofTable,
    Nodes,
    components_from_digits,
    cross_matrix,
    rigid_body_shapes,
)
from cmsreduce.model.geometric_stiffness import (
    INERTIA_LOADS,
    SQUARES,
    Bars,
    GeometricStiffness,
    Members,
    ModalStiffening,
    UnitLoad,
    loads_in_words,
)
from cmsreduce.model.hdf5_items import HARMLESS_BYTES, LARGEST_GROWTH, check_dataset, hdf5_items
from cmsreduce.model.integrals import (
    LUMPINGS,
    FloatingFrame,
    FrameCondition,
    FrameKind,
    IntegralFrame,
    Lumping,
    ModalIntegrals,
)
from cmsreduce.model.mapped_array import (
    CHECKSUM,
    add_dataset,
    checksum,
    chosen_columns,
    map_dataset,
    mapped_array,
    mapped_in,
    shapes_beside,
)
from cmsreduce.model.mode_set import ModeBlock, ModeCertificate, ModeKind, ModeSet
from cmsreduce.model.reduced import ModalComponent, ReducedComponent
from cmsreduce.model.results import *  # noqa: F403 - its own face names what it offers
from cmsreduce.model.scene import (
    DOF_NAMES,
    Channel,
    Configuration,
    Joint,
    JointElement,
    JointTerm,
    Placement,
    Point,
    PointTerm,
    Scene,
    StrutTerm,
    dof_index,
)
from cmsreduce.model.system import (
    Controller,
    InterfaceLoading,
    Matrix,
    ModalChannels,
    OutboardMass,
    Substructure,
    System,
)
from cmsreduce.model.unit_conversion import in_units, load_stiffness_in_units, recovery_in_units, rigid_in_units
from cmsreduce.model.units import SI, UNITS, UnitKind, Units, units_of

__all__ = [
    "Bars",
    "CHECKSUM",
    "Channel",
    "Configuration",
    "Controller",
    "DOF_NAMES",
    "Damping",
    "DofTable",
    "FEModel",
    "FloatingFrame",
    "FrameCondition",
    "FrameKind",
    "GeometricStiffness",
    "HARMLESS_BYTES",
    "INERTIA_LOADS",
    "IntegralFrame",
    "Interface",
    "InterfaceLoading",
    "Joint",
    "JointElement",
    "JointTerm",
    "KEY_STEP",
    "LARGEST_GROWTH",
    "LUMPINGS",
    "Lumping",
    "Matrix",
    "Members",
    "ModalChannels",
    "ModalComponent",
    "ModalIntegrals",
    "ModalStiffening",
    "ModeBlock",
    "ModeCertificate",
    "ModeKind",
    "ModeSet",
    "Nodes",
    "OutboardMass",
    "Placement",
    "Point",
    "PointTerm",
    "Recovery",
    "ReducedComponent",
    "RigidBody",
    "SCALAR",
    "SI",
    "SQUARES",
    "Scene",
    "Source",
    "StrutTerm",
    "Substructure",
    "System",
    "UNITS",
    "UnitKind",
    "UnitLoad",
    "Units",
    "UntiedMass",
    "add_dataset",
    "checksum",
    "chosen_columns",
    "components_from_digits",
    "check_dataset",
    "cross_matrix",
    "dof_index",
    "hdf5_items",
    "in_units",
    "load_stiffness_in_units",
    "loads_in_words",
    "map_dataset",
    "mapped_array",
    "mapped_in",
    "recovery_in_units",
    "rigid_body_shapes",
    "rigid_in_units",
    "shapes_beside",
    "units_of",
]
__all__ += results.__all__
