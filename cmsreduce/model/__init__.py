"""The plain data that flows between stages: frozen, with shapes and units; no I/O but for what outgrows memory."""

from cmsreduce.model.bars import Bars
from cmsreduce.model.body import FEModel, RigidBody, Source
from cmsreduce.model.certificate import ModeCertificate
from cmsreduce.model.check import Check
from cmsreduce.model.completeness import AxisCompleteness
from cmsreduce.model.controller import Controller
from cmsreduce.model.costly_modes import CostlyMode, CostlyModes
from cmsreduce.model.damping import Damping
from cmsreduce.model.dofs import SCALAR, DofTable, components_from_digits
from cmsreduce.model.drawing import BodyDrawing, JointDrawing, PortDrawing, SceneDrawing, SystemShapes
from cmsreduce.model.factorisation import Factorisation
from cmsreduce.model.floating_frame import FloatingFrame, FrameCondition, IntegralFrame
from cmsreduce.model.followers import Followers
from cmsreduce.model.gain_sum import GainSum, HighGain
from cmsreduce.model.geometric_stiffness import INERTIA_LOADS, SQUARES, GeometricStiffness, ModalStiffening, UnitLoad
from cmsreduce.model.interface import Interface
from cmsreduce.model.joint_element import JointElement
from cmsreduce.model.loading import InterfaceLoading
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
from cmsreduce.model.members import Members
from cmsreduce.model.modal_channels import ModalChannels
from cmsreduce.model.modal_integrals import Lumping, ModalIntegrals
from cmsreduce.model.mode_set import ModeBlock, ModeKind, ModeSet
from cmsreduce.model.mode_views import EffectiveMassCurve, GainCurve, ModeLikeness
from cmsreduce.model.model_errors import ERRORS, DampedPairs, ModelErrors
from cmsreduce.model.nodes import Nodes, cross_matrix, rigid_body_shapes
from cmsreduce.model.outboard_mass import OutboardMass
from cmsreduce.model.projection_record import ExtraneousMode, ModeShare, ProjectionRecord, SampledModes
from cmsreduce.model.recovery import Recovery
from cmsreduce.model.reduced import ModalComponent, ReducedComponent
from cmsreduce.model.rounding_effect import RoundingEffect
from cmsreduce.model.run import ComponentResult, ConfigurationResult, Response, RunResult, Speed, SystemModes
from cmsreduce.model.run_figure import RunFigure
from cmsreduce.model.scene import (
    DOF_NAMES,
    Channel,
    Configuration,
    Joint,
    JointTerm,
    Placement,
    Point,
    PointTerm,
    Scene,
    StrutTerm,
    dof_index,
)
from cmsreduce.model.selection_record import (
    BoundRecord,
    CutoffRecord,
    SearchRecord,
    SensitivityCase,
    SensitivityRecord,
)
from cmsreduce.model.system import Matrix, Substructure, System
from cmsreduce.model.system_checks import (
    CHECKS,
    ChannelZeros,
    ControllerMargin,
    ReductionChecks,
    StaticLack,
    StepErrors,
    SystemChecks,
)
from cmsreduce.model.unit_conversion import in_units, load_stiffness_in_units, recovery_in_units, rigid_in_units
from cmsreduce.model.units import SI, Units
from cmsreduce.model.untied import UntiedMass

__all__ = [
    "CHECKSUM",
    "Speed",
    "RunFigure",
    "RunResult",
    "Response",
    "ModelErrors",
    "ConfigurationResult",
    "ComponentResult",
    "Check",
    "CHECKS",
    "ChannelZeros",
    "Controller",
    "ControllerMargin",
    "GainSum",
    "HighGain",
    "ReductionChecks",
    "StaticLack",
    "StepErrors",
    "SystemChecks",
    "DOF_NAMES",
    "ERRORS",
    "SCALAR",
    "SI",
    "SQUARES",
    "AxisCompleteness",
    "Bars",
    "BodyDrawing",
    "BoundRecord",
    "CutoffRecord",
    "Channel",
    "Configuration",
    "CostlyMode",
    "CostlyModes",
    "DampedPairs",
    "Damping",
    "DofTable",
    "FEModel",
    "FloatingFrame",
    "Followers",
    "FrameCondition",
    "IntegralFrame",
    "EffectiveMassCurve",
    "Factorisation",
    "GainCurve",
    "GeometricStiffness",
    "INERTIA_LOADS",
    "Interface",
    "InterfaceLoading",
    "Joint",
    "JointDrawing",
    "JointElement",
    "JointTerm",
    "Matrix",
    "ExtraneousMode",
    "ModeShare",
    "ProjectionRecord",
    "SampledModes",
    "Lumping",
    "Members",
    "ModalChannels",
    "ModalIntegrals",
    "ModalComponent",
    "ModeBlock",
    "ModeCertificate",
    "ModeKind",
    "ModeLikeness",
    "ModalStiffening",
    "ModeSet",
    "Nodes",
    "OutboardMass",
    "Placement",
    "Point",
    "PointTerm",
    "PortDrawing",
    "Recovery",
    "ReducedComponent",
    "RigidBody",
    "RoundingEffect",
    "Scene",
    "SceneDrawing",
    "SearchRecord",
    "SensitivityCase",
    "SensitivityRecord",
    "Source",
    "StrutTerm",
    "Substructure",
    "System",
    "SystemModes",
    "SystemShapes",
    "UnitLoad",
    "Units",
    "UntiedMass",
    "add_dataset",
    "checksum",
    "chosen_columns",
    "components_from_digits",
    "cross_matrix",
    "dof_index",
    "in_units",
    "load_stiffness_in_units",
    "map_dataset",
    "mapped_array",
    "mapped_in",
    "recovery_in_units",
    "rigid_body_shapes",
    "rigid_in_units",
    "shapes_beside",
]
