"""The grammar of the pipeline file, and how a file becomes a pipeline and a scene."""

from cmsreduce.config.balance_keys import RankingKeys
from cmsreduce.config.body_starter import BodyDraft, body_pipeline
from cmsreduce.config.channel_sizes import Size, channel_kind
from cmsreduce.config.component import Component
from cmsreduce.config.files import MatrixFile
from cmsreduce.config.grammar import Pipeline, json_schema
from cmsreduce.config.interface import InterfaceKeys
from cmsreduce.config.load import load_pipeline
from cmsreduce.config.project_keys import ProjectKeys
from cmsreduce.config.ranking_options import ScalingKeys
from cmsreduce.config.scene import build_scene
from cmsreduce.config.stages import (
    ModeSetKeys,
    ReduceKeys,
    VerifyKeys,
)
from cmsreduce.config.starter import starter_pipeline

__all__ = [
    "BodyDraft",
    "Component",
    "InterfaceKeys",
    "MatrixFile",
    "ModeSetKeys",
    "Pipeline",
    "ProjectKeys",
    "RankingKeys",
    "ReduceKeys",
    "ScalingKeys",
    "Size",
    "VerifyKeys",
    "body_pipeline",
    "build_scene",
    "channel_kind",
    "json_schema",
    "load_pipeline",
    "starter_pipeline",
]
