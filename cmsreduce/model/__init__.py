"""Plain data that flows between stages: frozen, with shapes and units.

Bodies, mode sets, reduced bodies, scenes and systems belong here; findings of a run belong in `model.results`.
Nothing here reads a file, solves or prints, except for arrays that are mapped because they outgrow memory, and for the
check of HDF5 files that every reader of them needs.
"""

from cmsreduce.model import results
from cmsreduce.model.body import FEModel, Interface, Recovery, Source, UntiedMass
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
    UNDETERMINED,
    FloatingFrame,
    FrameCondition,
    FrameKind,
    IntegralFrame,
    Lumping,
    ModalIntegrals,
    SecondOrder,
)
from cmsreduce.model.joint import DOF_NAMES, FIRST_ROTATION, Joint, JointElement, Point, dof_index
from cmsreduce.model.mapped_array import (
    CHECKSUM,
    add_dataset,
    checksum,
    chosen_columns,
    map_dataset,
    mapped_array,
    mapped_in,
    mapped_values,
    shapes_beside,
)
from cmsreduce.model.mode_set import REPEATED, ModeBlock, ModeCertificate, ModeKind, ModeSet, repeated_groups
from cmsreduce.model.multibody_scene import MultibodyScene, SceneBody, SceneJoint
from cmsreduce.model.parameters import (
    Letter,
    ParameterTerm,
    Values,
    parameter_label,
    unresisted,
    varied,
    with_gyroscopic,
)
from cmsreduce.model.reduced import ModalComponent, ReducedComponent
from cmsreduce.model.results import *  # noqa: F403 - its own face names what it offers
from cmsreduce.model.rigid_body import RigidBody
from cmsreduce.model.rounding import (
    ARITHMETIC,
    CONDENSATION,
    DOUBLE,
    PRINTED,
    SINGLE,
    entry_errors,
    error_of_sum,
    last_digits,
    rounding_of_values,
    spread_noise,
)
from cmsreduce.model.scene import Channel, Configuration, JointTerm, Placement, PointTerm, Scene, StrutTerm
from cmsreduce.model.substructure import InterfaceLoading, Matrix, OutboardMass, Substructure
from cmsreduce.model.system import Controller, ModalChannels, System, is_gyroscopic
from cmsreduce.model.unit_conversion import (
    damping_in_units,
    in_units,
    load_stiffness_in_units,
    matrix_in_units,
    recovery_in_units,
    rigid_in_units,
)
from cmsreduce.model.units import SI, UNITS, UnitKind, Units, units_of

__all__ = [
    "ARITHMETIC",
    "Bars",
    "CHECKSUM",
    "CONDENSATION",
    "Channel",
    "Configuration",
    "Controller",
    "DOF_NAMES",
    "FIRST_ROTATION",
    "DOUBLE",
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
    "Letter",
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
    "MultibodyScene",
    "Nodes",
    "OutboardMass",
    "PRINTED",
    "ParameterTerm",
    "Placement",
    "Point",
    "PointTerm",
    "Recovery",
    "ReducedComponent",
    "RigidBody",
    "REPEATED",
    "SCALAR",
    "SI",
    "SINGLE",
    "SQUARES",
    "Scene",
    "SceneBody",
    "SceneJoint",
    "SecondOrder",
    "Source",
    "StrutTerm",
    "Substructure",
    "System",
    "UNDETERMINED",
    "UNITS",
    "UnitKind",
    "UnitLoad",
    "Units",
    "UntiedMass",
    "Values",
    "add_dataset",
    "checksum",
    "chosen_columns",
    "components_from_digits",
    "check_dataset",
    "cross_matrix",
    "damping_in_units",
    "dof_index",
    "entry_errors",
    "error_of_sum",
    "hdf5_items",
    "in_units",
    "is_gyroscopic",
    "load_stiffness_in_units",
    "loads_in_words",
    "map_dataset",
    "mapped_array",
    "mapped_in",
    "mapped_values",
    "matrix_in_units",
    "parameter_label",
    "last_digits",
    "recovery_in_units",
    "repeated_groups",
    "rigid_body_shapes",
    "rigid_in_units",
    "rounding_of_values",
    "shapes_beside",
    "spread_noise",
    "units_of",
    "unresisted",
    "varied",
    "with_gyroscopic",
]
__all__ += results.__all__
