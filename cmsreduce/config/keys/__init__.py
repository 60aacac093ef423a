"""Keys of the pipeline file: one pydantic model for each mapping.

Key names, units, defaults and checks of single values belong here.
References between parts of the file are checked in `config.references`.
"""

from cmsreduce.config.keys.balance import CLOSED_LOOP, SYSTEM_COST, RankingKeys, ScalingKeys
from cmsreduce.config.keys.channels import ActuatorKeys, SensorKeys, Size, channel_kind, parse_row
from cmsreduce.config.keys.component import EXTSEOUT_NAMES, FLEXIBLE_ONLY, Component
from cmsreduce.config.keys.files import MatrixFile
from cmsreduce.config.keys.interface import InterfaceKeys
from cmsreduce.config.keys.joints import Articulation
from cmsreduce.config.keys.keep import KeepKeys
from cmsreduce.config.keys.mapping import Count, Keys, check_name, parse_decibels, parse_point, place_in
from cmsreduce.config.keys.parameters import ParameterKeys, ParameterMatrix, parse_value
from cmsreduce.config.keys.pipeline import Memory, Pipeline, json_schema, key_names
from cmsreduce.config.keys.project import ProjectKeys
from cmsreduce.config.keys.quantities import Compound, Quantity, figure_powers, parse_ratio, powers_of
from cmsreduce.config.keys.reduce import ModeSetKeys, ReduceKeys
from cmsreduce.config.keys.scene import SceneKeys
from cmsreduce.config.keys.stiffening import GeometricStiffnessKeys, SpinKeys
from cmsreduce.config.keys.verify import RELATIVE_ERRORS, CompareKeys, LimitKeys, VerifyKeys
from cmsreduce.config.keys.wheels import MOMENTUM, WheelKeys
from cmsreduce.config.keys.write import BASIC, CENTRE, WriteKeys

__all__ = [
    "CLOSED_LOOP",
    "SYSTEM_COST",
    "RELATIVE_ERRORS",
    "CompareKeys",
    "LimitKeys",
    "ActuatorKeys",
    "Articulation",
    "BASIC",
    "CENTRE",
    "Component",
    "Compound",
    "Count",
    "EXTSEOUT_NAMES",
    "FLEXIBLE_ONLY",
    "GeometricStiffnessKeys",
    "InterfaceKeys",
    "KeepKeys",
    "Keys",
    "MatrixFile",
    "MOMENTUM",
    "Memory",
    "ModeSetKeys",
    "ParameterKeys",
    "ParameterMatrix",
    "Pipeline",
    "ProjectKeys",
    "Quantity",
    "RankingKeys",
    "ReduceKeys",
    "ScalingKeys",
    "SceneKeys",
    "SensorKeys",
    "Size",
    "SpinKeys",
    "VerifyKeys",
    "WheelKeys",
    "WriteKeys",
    "channel_kind",
    "check_name",
    "figure_powers",
    "json_schema",
    "key_names",
    "parse_decibels",
    "parse_point",
    "parse_ratio",
    "place_in",
    "parse_row",
    "parse_value",
    "powers_of",
]
