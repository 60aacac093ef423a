"""The plain data that flows between stages: frozen, with stated shapes and units, no I/O."""

from cmsreduce.model.body import FEModel, RigidBody, Source
from cmsreduce.model.certificate import ModeCertificate
from cmsreduce.model.check import Check
from cmsreduce.model.completeness import AxisCompleteness
from cmsreduce.model.damping import Damping
from cmsreduce.model.dofs import SCALAR, DofTable, components_from_digits
from cmsreduce.model.factorisation import Factorisation
from cmsreduce.model.interface import Interface
from cmsreduce.model.joint_element import JointElement
from cmsreduce.model.loading import InterfaceLoading
from cmsreduce.model.modal_channels import ModalChannels
from cmsreduce.model.modal_integrals import Lumping, ModalIntegrals
from cmsreduce.model.mode_set import ModeBlock, ModeKind, ModeSet
from cmsreduce.model.model_errors import ERRORS, DampedPairs, ModelErrors
from cmsreduce.model.nodes import Nodes, cross_matrix, rigid_body_shapes
from cmsreduce.model.projection_record import ExtraneousMode, ModeShare, ProjectionRecord, SampledModes
from cmsreduce.model.recovery import Recovery
from cmsreduce.model.reduced import ModalComponent, ReducedComponent
from cmsreduce.model.run import ComponentResult, ConfigurationResult, Response, RunResult, Speed, SystemModes
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
from cmsreduce.model.selection_record import BoundRecord, CutoffRecord, SearchRecord
from cmsreduce.model.system import Matrix, Substructure, System
from cmsreduce.model.unit_conversion import in_units, rigid_in_units
from cmsreduce.model.units import SI, Units

__all__ = [
    "Speed",
    "RunResult",
    "Response",
    "ModelErrors",
    "ConfigurationResult",
    "ComponentResult",
    "Check",
    "DOF_NAMES",
    "ERRORS",
    "SCALAR",
    "SI",
    "AxisCompleteness",
    "BoundRecord",
    "CutoffRecord",
    "Channel",
    "Configuration",
    "DampedPairs",
    "Damping",
    "DofTable",
    "FEModel",
    "Factorisation",
    "Interface",
    "InterfaceLoading",
    "Joint",
    "JointElement",
    "JointTerm",
    "Matrix",
    "ExtraneousMode",
    "ModeShare",
    "ProjectionRecord",
    "SampledModes",
    "Lumping",
    "ModalChannels",
    "ModalIntegrals",
    "ModalComponent",
    "ModeBlock",
    "ModeCertificate",
    "ModeKind",
    "ModeSet",
    "Nodes",
    "Placement",
    "Point",
    "PointTerm",
    "Recovery",
    "ReducedComponent",
    "RigidBody",
    "Scene",
    "SearchRecord",
    "Source",
    "StrutTerm",
    "Substructure",
    "System",
    "SystemModes",
    "Units",
    "components_from_digits",
    "cross_matrix",
    "dof_index",
    "in_units",
    "rigid_body_shapes",
    "rigid_in_units",
]
