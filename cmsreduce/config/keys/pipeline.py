"""The grammar of the pipeline file, and the keys of the solver."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, ClassVar

from pydantic import AfterValidator, BeforeValidator, Field, PrivateAttr, Strict, WithJsonSchema

from cmsreduce.config.keys.balance import BalanceKeys
from cmsreduce.config.keys.component import Component
from cmsreduce.config.keys.keep import KeepKeys
from cmsreduce.config.keys.mapping import Count, DataPath, Keys, Name, OneOrMore, Plain
from cmsreduce.config.keys.project import ProjectKeys
from cmsreduce.config.keys.reduce import NO_PARTS, ReduceKeys
from cmsreduce.config.keys.scene import SceneKeys
from cmsreduce.config.keys.verify import VerifyKeys
from cmsreduce.config.keys.write import BodyWriteKeys, WriteKeys
from cmsreduce.config.located import Entry
from cmsreduce.linalg.machine import Backend, Precision
from cmsreduce.model import Units

__all__ = ["Pipeline", "SolverKeys", "json_schema", "key_names"]

# More than any machine has: larger numbers overflow in the libraries that they are handed to.
_MOST_CORES = 4096
_BYTES = {"B": 1.0, "kB": 1e3, "MB": 1e6, "GB": 1e9, "TB": 1e12, "KiB": 2.0**10, "MiB": 2.0**20, "GiB": 2.0**30}
_BYTES["TiB"] = 2.0**40
_MEMORY = re.compile(r"([0-9]+(?:\.[0-9]*)?)\s*([kKMGT]?i?B)")


def _memory(value: object) -> object:
    """Bytes of an amount of memory such as ``8 GiB``."""
    if isinstance(value, (int, float)):
        raise ValueError(f"an amount of memory with its unit is expected, such as 8 GiB, found {value!r}")
    if not isinstance(value, str):
        return value
    found = _MEMORY.fullmatch(value.strip())
    if found is None or found[2] not in _BYTES:
        raise ValueError(f"{value!r} is no amount of memory; write a number and one of {', '.join(_BYTES)}")
    return float(found[1]) * _BYTES[found[2]]


Memory = Annotated[float, BeforeValidator(_memory), Field(gt=0), WithJsonSchema({"type": "string"})]
"""An amount of memory, in bytes."""


class SolverKeys(Keys):
    """Sparse solver, and the threads and memory that it may use."""

    removed: ClassVar[Mapping[str, str]] = NO_PARTS | {
        "replace_allocators": "No allocator is replaced any more. Take the key out: a factor that does not fit in "
        "memory lies in a file; `solver.scratch` names its folder"
    }

    backend: Backend = Field(
        default="auto",
        description="Sparse direct solver: pardiso (MKL), multifrontal (cmsreduce's own, for definite matrices), "
        "cholmod (scikit-sparse) or superlu (scipy); auto takes the fastest that is installed: superlu for small "
        "bodies, multifrontal for large ones. mumps (petsc4py) works on several processes under mpiexec, and must be "
        "asked for by name. summary.json states which one ran.",
        examples=["auto"],
    )
    threads: Count | None = Field(
        default=None,
        ge=1,
        le=_MOST_CORES,
        description="Threads of dense and sparse algebra; by default OMP_NUM_THREADS, or all cores.",
        examples=[2],
    )
    memory: Memory | None = Field(
        default=None,
        description="Memory that a factor may take. A factor that needs more is made in a file; without room on "
        "disk it is refused before it is computed. By default most of the free memory.",
        examples=["8 GiB"],
    )
    precision: Precision = Field(
        default="auto",
        description="Precision of the factor, with pardiso or multifrontal: double, or single, which takes half the "
        "memory and is refined to the same accuracy with several times the solves. auto takes single where double does "
        "not fit in memory. A matrix so ill conditioned that refinement does not converge is refused.",
        examples=["auto"],
    )
    ranks: Annotated[int, Strict(), Field(ge=1, le=_MOST_CORES)] = Field(
        default=2, description="Processes of mumps, among which a factor is distributed.", examples=[2]
    )
    python: Plain | None = Field(
        default=None,
        description="Python interpreter with petsc4py for the processes of mumps; by default the one that runs "
        "cmsreduce, or else /usr/bin/python3, for which Debian packages python3-petsc4py.",
        examples=["/usr/bin/python3"],
    )
    scratch: DataPath | None = Field(
        default=None,
        description="Folder for factors and bases that do not fit in memory (docs/large-bodies.md); by default that of "
        "the run's stages. A fast disk: each solve reads the whole factor twice.",
        examples=["/scratch/me"],
    )


# Stages whose keys a body may state for itself.
_OVER = ("reduce", "balance", "write")


def _check_component_name(name: str) -> str:
    if name.lower() == "system":
        raise ValueError("a component cannot be named 'system': that is the file of the assembled system")
    return name


class Pipeline(Keys):
    """A pipeline: the bodies, the scene they act in, and the stages to run; a stage that is absent is not run."""

    removed: ClassVar[Mapping[str, str]] = NO_PARTS
    other_words: ClassVar[Mapping[str, str]] = {
        **dict.fromkeys(("bodies", "models"), "components"),
        **dict.fromkeys(("out", "results"), "output"),
    }

    name: Name = Field(description="Name of the study.", examples=["galileo"])
    output: Annotated[Path, WithJsonSchema({"type": "string"})] = Field(
        default=Path("build"),
        description="Folder of the results, relative to the working directory (every other file name is relative to "
        "the file it is written in); by default build/NAME.",
        examples=["build/galileo"],
    )
    include: Annotated[tuple[DataPath, ...], OneOrMore()] = Field(
        default=(),
        description="File or files with keys to start from, merged in order; keys of this file win. Names are relative "
        "to this file.",
        examples=[["../configs/default.yaml"]],
    )
    components: dict[Annotated[Name, AfterValidator(_check_component_name)], Component] = Field(
        min_length=1, description="The bodies by name.", examples=[{"rotor": {"extseout": "rotor"}}]
    )
    scene: SceneKeys = Field(
        description="Band, joints, articulation, actuators and sensors.", examples=[{"band": "10 Hz"}]
    )
    reduce: ReduceKeys | None = Field(
        default=None,
        description="Reduce each body to a mode set.",
        examples=[{"method": "craig-bampton", "cutoff": 2.0}],
    )
    balance: BalanceKeys | None = Field(
        default=None,
        description="Rank the modes by their influence and keep the important ones.",
        examples=[{"rank": "gregory", "keep": {"frf_error": 0.01}}],
    )
    project: ProjectKeys | None = Field(
        default=None,
        description="Project modes of the whole system on the bodies, and join these again.",
        examples=[{"modes": "auto", "configurations": "all"}],
    )
    verify: VerifyKeys | None = Field(
        default=None,
        description="Compare the reduced with the unreduced system, with limits.",
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
        if isinstance(value, dict) and value.get("output", "") == "" and isinstance(value.get("name"), str):
            return {**value, "output": f"build/{value['name']}"}
        return value

    _tree: Entry | None = PrivateAttr(default=None)

    @property
    def tree(self) -> Entry | None:
        """The keys as written, with their places; None for a pipeline that was not read from a text."""
        return self._tree

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
        """Frame in which one body is written: its own keys over the pipeline's."""
        base = BodyWriteKeys() if self.write is None else self.write
        own = self.components[component].write
        if own is None:
            return base
        return base.model_copy(update={key: getattr(own, key) for key in own.model_fields_set})

    def record(self, *, exclude: Mapping[str, Any] | None = None, exclude_none: bool = False) -> dict[str, Any]:
        """Keys as JSON, with their defaults.

        Keys that stand over others, those of a stage for one body or of a compared mode set, are there as they are
        written, without defaults: an omitted one is that of the pipeline.

        Parameters
        ----------
        exclude : mapping, optional
            Keys to leave out, as in `model_dump`.
        exclude_none : bool
            Leave out keys without a value.
        """
        found = self.model_dump(mode="json", exclude=dict(exclude or {}), exclude_none=exclude_none)
        parts = found.get("components", {})
        over = [(parts[name], stage, getattr(self.components[name], stage)) for name in parts for stage in _OVER]
        compared = (found.get("verify") or {}).get("compare", {})
        if self.verify is not None:
            over += [(part, "reduce", self.verify.compare[label].reduce) for label, part in compared.items()]
        for part, stage, own in over:
            if own is not None and stage in part:
                part[stage] = own.model_dump(mode="json", exclude_unset=True, exclude_none=exclude_none)
        return found

    def keep_of(self, component: str) -> KeepKeys:
        """Rule by which modes of one body are kept."""
        ranking = self.balance_of(component)
        return KeepKeys() if ranking is None else ranking.keep


def json_schema() -> dict[str, Any]:
    """JSON Schema of the pipeline file, for editors and as its reference."""
    schema = Pipeline.model_json_schema(by_alias=True, mode="validation")
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "cmsreduce pipeline", **schema}


def key_names() -> list[str]:
    """Keys of the pipeline file below no name of the user, such as ``reduce.cutoff``, for completion.

    Examples
    --------
    >>> [name for name in key_names() if name.startswith("reduce.c")]
    ['reduce.cutoff']
    """
    schema = json_schema()
    return list(_dotted(schema, schema["$defs"], "", ()))


def _dotted(at: dict[str, Any], defs: dict[str, Any], above: str, within: tuple[str, ...]) -> Iterator[str]:
    name = at.get("$ref", "").rpartition("/")[2]
    if name in within:
        return
    inner = {**at, **defs.get(name, {})}
    for key, value in inner.get("properties", {}).items():
        yield f"{above}{key}"
        yield from _dotted(value, defs, f"{above}{key}.", (*within, name) if name else within)
    for arm in inner.get("anyOf", ()):
        yield from _dotted(arm, defs, above, (*within, name) if name else within)
