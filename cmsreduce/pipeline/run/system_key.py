"""Everything that a stage of the whole system depends on, as one key, and the error that projection goes for."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cmsreduce import __version__
from cmsreduce.config import Pipeline
from cmsreduce.pipeline.store import stage_key

__all__ = ["projected_error", "system_key"]


def projected_error(pipeline: Pipeline) -> float | None:
    """The error that projection goes for: its own, or that of balance, or verify's limit; None if none is stated."""
    keys, balance, verify = pipeline.project, pipeline.balance, pipeline.verify
    stated = (
        keys.frf_error if keys else None,
        balance.keep.frf_error if balance else None,
        verify.limits.frf_error if verify else None,
    )
    return next((error for error in stated if error is not None), None)


def system_key(stage: str, pipeline: Pipeline, points: int, bodies: Mapping[str, str]) -> str:
    """Hash of everything that balance, project or verify depends on.

    Parameters
    ----------
    stage : str
        One of the three.
    pipeline : Pipeline
        Its settings; those of later stages do not count, nor do limits, which judge what is found.
    points : int
        Points of the grid that errors are taken on.
    bodies : mapping of name to str
        Keys of the bodies' orthonormal modes.
    """
    # File names are left out: what they hold is in the keys of the bodies.
    files: dict[str, Any] = {
        "components": {"__all__": {"stiffness", "mass", "geometry", "extseout", "rows", "damping"}}
    }
    elsewhere = dict.fromkeys(("name", "output", "include", "write"), True)
    # A controller closes loops around what was found.
    files["scene"] = {"controller"}
    settings = pipeline.model_dump(mode="json", exclude=files | elsewhere)
    compared = settings.pop("verify") or {}
    asked: list[Any] = [points, [compared.get("compare"), *_checks(pipeline)] if stage == "verify" else None]
    if settings["balance"] is not None:
        # Whether other choices are looked at changes nothing in this one.
        settings["balance"].pop("sensitivity")
    if stage == "balance":
        settings.pop("project")
    elif pipeline.project is not None:
        # A limit may be the error that projection goes for.
        asked.append(projected_error(pipeline))
    return stage_key(stage, __version__, settings, asked, dict(bodies))


def _checks(pipeline: Pipeline) -> tuple[list[str], bool]:
    """Checks that are required, and whether the usual ones are done."""
    keys = pipeline.verify
    return ([], True) if keys is None else (sorted(keys.required_checks), keys.checks is None)
