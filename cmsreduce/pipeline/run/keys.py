"""Content keys of the stages of a run: hashes of everything that they depend on."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from cmsreduce import __version__
from cmsreduce.config import CLOSED_LOOP, Pipeline, RankingKeys
from cmsreduce.model import Controller
from cmsreduce.pipeline.bodies import ALL_MODES_LIMIT, FlexibleBody
from cmsreduce.pipeline.store import stage_key
from cmsreduce.read import sha256_of

__all__ = [
    "absolute_files",
    "body_key",
    "contents",
    "file_size",
    "named_files",
    "projected_error",
    "proof_key",
    "read_key",
    "reference_key",
    "reference_model_key",
    "system_key",
]

_DOWNSTREAM = {"reduce", "balance"}
# Keys of a component that do not change its matrices, nodes and interfaces.
_OF_THE_PLACE = {"like", "place", "balance", "write"}
# Lists of dofs, expanded elements and superelements, which have the stem of a file that is named.
_BESIDE = (".dof", ".12d", ".12D", ".asm", ".ASM", ".pch", ".PCH")


def absolute_files(keys: Any) -> Any:
    """The pipeline, or a part of it, with absolute paths: no key depends on the folder that a command is called in."""
    if isinstance(keys, Path):
        try:
            return Path(os.path.normpath(keys.absolute()))
        except FileNotFoundError:
            # The present folder was removed, and only absolute paths lead to files.
            return keys
    if isinstance(keys, BaseModel):
        same = keys.model_copy(update={name: absolute_files(value) for name, value in keys})
        # Defaults stay defaults: keys of a single body stand over those of the pipeline only where they are written.
        same.__pydantic_fields_set__ = set(keys.model_fields_set)
        return same
    if isinstance(keys, Mapping):
        return {name: absolute_files(value) for name, value in keys.items()}
    return type(keys)(map(absolute_files, keys)) if isinstance(keys, (list, tuple)) else keys


def body_key(pipeline: Pipeline, name: str) -> str:
    """Hash of the keys that say which body a component is: equal for copies of one body."""
    part = pipeline.components[name]
    own = part.model_dump(mode="json", exclude=_OF_THE_PLACE | _DOWNSTREAM)
    return stage_key("read", own, _frame(pipeline, name), pipeline.reduce_of(name) is None, _parameters(pipeline, name))


def contents(pipeline: Pipeline, name: str) -> dict[Path, str]:
    """Hashes of the files that a body is read from as its keys name them, and of those beside them."""
    own = pipeline.components[name].model_dump(exclude=_OF_THE_PLACE | _DOWNSTREAM)
    return {path: sha256_of(path) for path in sorted(_with_beside(own)) if path.is_file()}


def proof_key(pipeline: Pipeline, name: str, files: Mapping[Path, str]) -> str:
    """Hash of everything that a body as read and proven depends on: code, keys, and `contents` of files.

    A damping law is no part of it, nor is a place; a sweep over them proves the body once.
    """
    part = pipeline.components[name]
    own = part.model_dump(exclude=_OF_THE_PLACE | _DOWNSTREAM | {"damping"})
    law = part.damping is not None and part.damping.matrix is None and not part.in_modes
    own["damping"] = "law" if law or part.damping is None else part.damping.model_dump()
    hashes = {str(path): content for path, content in files.items()}
    return stage_key("proof", name, own, part.damping is None, pipeline.units.name, hashes)


def file_size(pipeline: Pipeline, name: str) -> int:
    """Bytes of the files that a body is read from: a measure of the work on it."""
    files = {*_with_beside(pipeline.components[name].model_dump())}
    return sum(path.stat().st_size for path in files if path.is_file())


def named_files(value: Any) -> Iterator[Path]:
    """Files in keys, such as those of a component."""
    if isinstance(value, Path):
        yield value
    elif isinstance(value, Mapping):
        yield from (path for each in value.values() for path in named_files(each))
    elif isinstance(value, (list, tuple)):
        yield from (path for each in value for path in named_files(each))


def _with_beside(value: Any) -> Iterator[Path]:
    """Files in the keys of a component, and those that readers look for beside them."""
    for path in named_files(value):
        yield path
        yield from (path.with_suffix(end) for end in _BESIDE if path.name)


def _parameters(pipeline: Pipeline, name: str) -> list[Any]:
    """Matrices that parameters add to a body, with all configurations where there are any."""
    added: list[Any] = [
        (parameter, keys.unit.plain, letter, matrices[name].model_dump(mode="json"))
        for parameter, keys in pipeline.scene.parameters.items()
        for letter, matrices in keys.matrices().items()
        if name in matrices
    ]
    added += [
        (parameter, keys.unit.plain, "wheel", text)
        for parameter, keys in pipeline.scene.parameters.items()
        for text in keys.wheels
        if text.partition(".")[0] == name
    ]
    if not added:
        return []
    return [added, pipeline.scene.model_dump(mode="json", include={"articulation", "parameters"})]


def read_key(pipeline: Pipeline, name: str) -> str:
    """Hash of the settings that reading a body depends on; within one sweep its files do not change."""
    keys = pipeline.reduce_of(name)
    part = pipeline.components[name].model_dump(mode="json", exclude=_DOWNSTREAM)
    scene = pipeline.scene.model_dump(mode="json", exclude={"band", "articulation", "parameters"})
    residuals = None if keys is None else keys.residuals
    return stage_key("read", name, part, _frame(pipeline, name), scene, residuals, _parameters(pipeline, name))


def _frame(pipeline: Pipeline, name: str) -> dict[str, Any] | None:
    """Frame of a body whose interface may hold it while it is stiffened; None for a body that is not."""
    stiffened = pipeline.components[name].geometric_stiffness is not None
    return pipeline.write_of(name).model_dump(mode="json") if stiffened else None


def reference_key(flexible: FlexibleBody, cutoff_hz: float, fits: bool, wide: bool) -> str:
    """Hash of everything that the representation of an unreduced body depends on."""
    # All modes of a small body are taken, whatever the cutoff.
    beyond = None if fits and flexible.body.n <= ALL_MODES_LIMIT else cutoff_hz
    return stage_key("reference", flexible.fingerprint, repr(flexible.body.damping), beyond, wide)


def reference_model_key(pipeline: Pipeline, points: int, references: Mapping[str, str]) -> str:
    """Hash of everything that the reference model and its responses depend on."""
    parts = {name: part.model_dump(mode="json", exclude=_DOWNSTREAM) for name, part in pipeline.components.items()}
    return stage_key("read", pipeline.scene.model_dump(mode="json"), parts, points, dict(references))


def projected_error(pipeline: Pipeline) -> float | None:
    """The error that projection must meet: its own, else of balance, else verify's limit; None if none is stated."""
    keys, balance, verify = pipeline.project, pipeline.balance, pipeline.verify
    stated = (
        keys.frf_error if keys else None,
        balance.keep.frf_error if balance else None,
        verify.limits.frf_error if verify else None,
    )
    return next((error for error in stated if error is not None), None)


def system_key(
    stage: str, pipeline: Pipeline, points: int, bodies: Mapping[str, str], controller: Controller | None = None
) -> str:
    """Hash of everything that balance, project or verify depends on.

    Parameters
    ----------
    stage : str
        One of the three.
    pipeline : Pipeline
        Its settings; those of later stages do not count, nor do limits, which judge the results, unless they choose
        the modes.
    points : int
        Points of the grid that errors are taken on.
    bodies : mapping of name to str
        Keys of the bodies' orthonormal modes.
    controller : Controller, optional
        Of the scene.
    """
    # File names are left out: their contents are in the keys of the bodies.
    read = {"like", "extseout", "reduced", "modes", "stiffness", "mass", "geometry", "rows", "damping", "gyroscopic"}
    files: dict[str, Any] = {"components": {"__all__": read}}
    elsewhere = dict.fromkeys(("name", "output", "include", "write"), True)
    # A controller closes loops around finished results.
    files["scene"] = {"controller"}
    settings = pipeline.record(exclude=files | elsewhere)
    compared = settings.pop("verify") or {}
    keys = pipeline.verify
    checks: tuple[Any, ...] = ([], True, 0)
    if keys is not None:
        checks = sorted(keys.required_checks), keys.checks is None, keys.between
    asked: list[Any] = [points, [compared.get("compare"), *checks] if stage == "verify" else None]
    if settings["balance"] is not None:
        # Looking at other choices changes nothing in this one.
        settings["balance"].pop("sensitivity")
    by_limits = any(ranking.keep.rule == "limits" for ranking in _rankings(pipeline))
    by_limits |= stage != "balance" and pipeline.project is not None and pipeline.project.responses is not None
    loop = None if controller is None else [A.tolist() for A in vars(controller).values()]
    if keys is not None and by_limits:
        asked.append([keys.limits.model_dump(exclude_none=True), keys.between, loop])
    elif any(ranking.rank == CLOSED_LOOP or ranking.keep.rule == "frf_error" for ranking in _rankings(pipeline)):
        asked.append(loop)
    if keys is not None and any(ranking.keep.minimise == "cost" for ranking in _rankings(pipeline)):
        asked.append(keys.cost.model_dump(include={"integrator", "accuracy"}))
    if stage == "balance":
        settings.pop("project")
    elif pipeline.project is not None:
        # A limit may be the error that projection must meet.
        asked.append(projected_error(pipeline))
    return stage_key(stage, __version__, settings, asked, dict(bodies))


def _rankings(pipeline: Pipeline) -> Iterator[RankingKeys]:
    """Rankings of the run's own model, of single bodies, and of models that it is compared with."""
    if pipeline.balance is not None:
        yield pipeline.balance
    yield from (component.balance for component in pipeline.components.values() if component.balance is not None)
    if pipeline.verify is not None:
        yield from pipeline.verify.compare.values()
