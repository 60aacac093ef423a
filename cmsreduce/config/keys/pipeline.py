"""The grammar of the pipeline file: every key, with its meaning."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, Field, WithJsonSchema

from cmsreduce.config.keys.balance import BalanceKeys, KeepKeys
from cmsreduce.config.keys.component import Component
from cmsreduce.config.keys.frame import BodyWriteKeys
from cmsreduce.config.keys.mapping import DataPath, Keys, Name, OneOrMore
from cmsreduce.config.keys.project import ProjectKeys
from cmsreduce.config.keys.scene import SceneKeys
from cmsreduce.config.keys.solver import SolverKeys
from cmsreduce.config.keys.stages import ReduceKeys, VerifyKeys, WriteKeys
from cmsreduce.model import Units

__all__ = ["Pipeline", "json_schema"]


def _check_component_name(name: str) -> str:
    if name.lower() == "system":
        raise ValueError("a component cannot be named 'system': that is the file of the assembled system")
    return name


class Pipeline(Keys):
    """A pipeline: the bodies, the scene they act in, and the stages to run; a stage that is absent is not run."""

    name: Name = Field(description="Name of the study.", examples=["galileo"])
    output: Annotated[Path, WithJsonSchema({"type": "string"})] = Field(
        default=Path("build"),
        description="Folder the results are written to, relative to where the command is run (unlike every other file "
        "name, which is relative to the file it is written in); by default build/NAME.",
        examples=["build/galileo"],
    )
    include: Annotated[tuple[DataPath, ...], OneOrMore()] = Field(
        default=(),
        description="File or files with keys to start from, merged in order; this file wins over them. Names are "
        "relative to this file.",
        examples=[["../configs/default.yaml"]],
    )
    components: dict[Annotated[Name, AfterValidator(_check_component_name)], Component] = Field(
        min_length=1, description="The bodies by name.", examples=[{"rotor": {"extseout": "rotor"}}]
    )
    scene: SceneKeys = Field(description="What the bodies are for.", examples=[{"band": "10 Hz"}])
    reduce: ReduceKeys | None = Field(
        default=None,
        description="Reduce each body to a mode set.",
        examples=[{"method": "craig-bampton", "cutoff": 2.0}],
    )
    balance: BalanceKeys | None = Field(
        default=None,
        description="Rank the modes by their influence and keep those that matter.",
        examples=[{"rank": "gregory", "keep": {"frf_error": 0.01}}],
    )
    project: ProjectKeys | None = Field(
        default=None,
        description="Project modes of the whole system on the bodies, and join these again.",
        examples=[{"modes": "auto", "configurations": "all"}],
    )
    verify: VerifyKeys | None = Field(
        default=None,
        description="Compare reduced and full system, with limits.",
        examples=[{"frf": {"points": 400}, "limits": {"frf_error": 0.05}}],
    )
    write: WriteKeys | None = Field(
        default=None, description="Write component files.", examples=[{"formats": ["hdf5"]}]
    )
    solver: SolverKeys = Field(
        default=SolverKeys(),
        description="Sparse solver, threads and memory. Results do not depend on them beyond round-off.",
        examples=[{"threads": 2}],
    )

    @classmethod
    def written_out(cls, value: object) -> object:
        """Name the output folder after the study."""
        if isinstance(value, dict) and "output" not in value and isinstance(value.get("name"), str):
            return {**value, "output": f"build/{value['name']}"}
        return value

    @property
    def units(self) -> Units:
        """Unit system of the scene."""
        return Units.parse(self.scene.units)

    def reduce_of(self, component: str) -> ReduceKeys | None:
        """Keys of the stage for one body: its own over the pipeline's; None where it is not reduced."""
        own = self.components[component].reduce
        if own is None or self.reduce is None:
            return own or self.reduce
        return self.reduce.model_copy(update={key: getattr(own, key) for key in own.model_fields_set})

    def balance_of(self, component: str) -> BalanceKeys | None:
        """Keys of the stage for one body: its own over the pipeline's; None where it is not ranked."""
        own = self.components[component].balance
        if own is None:
            return self.balance
        base = self.balance or BalanceKeys()
        return base.model_copy(update={key: getattr(own, key) for key in own.model_fields_set})

    def write_of(self, component: str) -> BodyWriteKeys:
        """In which frame one body is written: its own keys over the pipeline's."""
        base = BodyWriteKeys() if self.write is None else self.write
        own = self.components[component].write
        if own is None:
            return base
        return base.model_copy(update={key: getattr(own, key) for key in own.model_fields_set})

    def keep_of(self, component: str) -> KeepKeys:
        """Rule by which modes of one body are kept."""
        ranking = self.balance_of(component)
        return KeepKeys() if ranking is None else ranking.keep


def json_schema() -> dict[str, Any]:
    """JSON Schema of the pipeline file, for editors and as its reference."""
    schema = Pipeline.model_json_schema(by_alias=True, mode="validation")
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "cmsreduce pipeline", **schema}
