"""The pipeline file: its grammar, its messages, and the scene that it describes.

Reading YAML, validating it and building the scene belong here.
Nothing here opens a matrix or a mesh; `read` does.
"""

from cmsreduce.config.cluster import ClusterKeys, load_cluster
from cmsreduce.config.drafted import BodyDraft, body_pipeline, scene_pipeline
from cmsreduce.config.keys import (
    BASIC,
    CENTRE,
    CLOSED_LOOP,
    EXTSEOUT_NAMES,
    RELATIVE_ERRORS,
    SYSTEM_COST,
    CompareKeys,
    Component,
    GeometricStiffnessKeys,
    InterfaceKeys,
    LimitKeys,
    MatrixFile,
    ModeSetKeys,
    ParameterMatrix,
    Pipeline,
    ProjectKeys,
    RankingKeys,
    ReduceKeys,
    ScalingKeys,
    Size,
    SpinKeys,
    VerifyKeys,
    WheelKeys,
    WriteKeys,
    channel_kind,
    check_name,
    json_schema,
    key_names,
    parse_decibels,
    parse_ratio,
    place_in,
)
from cmsreduce.config.load import load_pipeline, pipeline_from_keys
from cmsreduce.config.located import Entry, parse
from cmsreduce.config.places import naming_the_line
from cmsreduce.config.scene import build_scene
from cmsreduce.config.starter import starter_pipeline

__all__ = [
    "CLOSED_LOOP",
    "SYSTEM_COST",
    "EXTSEOUT_NAMES",
    "BASIC",
    "BodyDraft",
    "CENTRE",
    "ClusterKeys",
    "Component",
    "Entry",
    "GeometricStiffnessKeys",
    "InterfaceKeys",
    "MatrixFile",
    "ModeSetKeys",
    "ParameterMatrix",
    "Pipeline",
    "ProjectKeys",
    "RankingKeys",
    "ReduceKeys",
    "ScalingKeys",
    "Size",
    "SpinKeys",
    "CompareKeys",
    "RELATIVE_ERRORS",
    "LimitKeys",
    "VerifyKeys",
    "WheelKeys",
    "WriteKeys",
    "body_pipeline",
    "build_scene",
    "channel_kind",
    "check_name",
    "json_schema",
    "key_names",
    "load_cluster",
    "load_pipeline",
    "naming_the_line",
    "parse",
    "parse_decibels",
    "parse_ratio",
    "place_in",
    "pipeline_from_keys",
    "scene_pipeline",
    "starter_pipeline",
]
