"""The points of a sweep: every combination of the values of some keys."""

from __future__ import annotations

import hashlib
import itertools
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

from cmsreduce.config import Pipeline, load_pipeline, parse
from cmsreduce.errors import CmsReduceError, ConfigError
from cmsreduce.model import short_keys
from cmsreduce.read import expect_kind

__all__ = ["SweepPoint", "sweep_axes", "sweep_points"]

# The sweep itself sets the names and folders of results.
_NOT_SWEPT = ("output", "include", "name")
# Longer names of folders are cut; some digits of a hash make them unique.
_LONGEST, _DIGITS = 80, 8


@dataclass(frozen=True)
class SweepPoint:
    """One combination of values.

    Parameters
    ----------
    number : int
        From 1.
    folder : str
        Name of its run directory, made from the overrides.
    axes : tuple of (str, str)
        Key and value, as YAML.
    overrides : tuple of str
        All overrides of the run, ``KEY=VALUE``, those of the sweep last.
    pipeline : Pipeline or None
        None if the combination is bad input.
    message : str
        The reason.
    """

    number: int
    folder: str
    axes: tuple[tuple[str, str], ...]
    overrides: tuple[str, ...]
    pipeline: Pipeline | None
    message: str = ""

    @cached_property
    def system(self) -> str:
        """Hash of everything that the reference model depends on; points with the same hash share the model."""
        if self.pipeline is None:
            return ""
        own: dict[str, Any] = {"components": {"__all__": {"reduce", "balance"}}}
        stages = ("name", "output", "include", "reduce", "balance", "project", "verify", "write", "solver")
        settings = self.pipeline.model_dump(mode="json", exclude=own | dict.fromkeys(stages, True))
        return hashlib.sha256(json.dumps(settings, sort_keys=True, default=str).encode()).hexdigest()


def sweep_axes(texts: Sequence[str]) -> dict[str, tuple[str, ...]]:
    """Split ``KEY=V1,V2,...`` texts into keys, dotted as in ``--set``, and their values, each as YAML.

    Parameters
    ----------
    texts : sequence of str
        Values are YAML; lists and mappings are in brackets. Equal values are taken once.

    Raises
    ------
    ConfigError
        If a text has no such form, or names a key twice or one that cannot be swept.

    Examples
    --------
    >>> sweep_axes(["reduce.cutoff=1.5,2", "balance.keep={modes: 10},all"])
    {'reduce.cutoff': ('1.5', '2'), 'balance.keep': ('{modes: 10}', 'all')}
    """
    axes: dict[str, tuple[str, ...]] = {}
    for text in texts:
        key, sign, values = (part.strip() for part in text.partition("="))
        if not sign or not values or not all(key.split(".")):
            raise ConfigError(f"--over {text}: write KEY=V1,V2,..., e.g. --over reduce.cutoff=1.5,2,4")
        if key.split(".")[0] in _NOT_SWEPT:
            raise ConfigError(f"--over {text}: '{key}' cannot be swept: each point has a folder of its own")
        if key in axes:
            raise ConfigError(f"--over {text}: '{key}' is given twice; write all its values behind one --over")
        axes[key] = _values(text, values)
    if not axes:
        raise ConfigError("a sweep needs at least one --over KEY=V1,V2,..., e.g. --over reduce.cutoff=1.5,2,4")
    return axes


def sweep_points(
    path: Path, axes: Mapping[str, Sequence[str]], overrides: Sequence[str] = ()
) -> tuple[SweepPoint, ...]:
    """Every combination of the values, checked against the grammar.

    Parameters
    ----------
    path : Path
        Pipeline file.
    axes : mapping of str to sequence of str
        Keys and their values; the first key is the slowest.
    overrides : sequence of str
        Keys set for all points.

    Raises
    ------
    CmsReduceError
        If no combination is good input, as with an unknown key.
    """
    expect_kind(path, "pipeline")
    points, first = [], None
    names = short_keys(list(axes))
    for number, values in enumerate(itertools.product(*axes.values()), 1):
        chosen = tuple(zip(axes, values, strict=True))
        every = (*overrides, *(f"{key}={value}" for key, value in chosen))
        pipeline, message = None, ""
        try:
            pipeline = load_pipeline(path, every)
        except CmsReduceError as error:
            message = _as_typed(str(error), every[len(overrides) :])
            first = first or type(error)(message)
        folder = _folder(list(zip(names, values, strict=True)))
        points.append(SweepPoint(number, folder, chosen, every, pipeline, message))
    if first is not None and all(point.pipeline is None for point in points):
        raise first
    return tuple(points)


def _values(text: str, values: str) -> tuple[str, ...]:
    """The source text of each item, which becomes the override of a point."""
    listed = f"[{values}]"
    parse(listed, f"--over {text}", Path(), in_override=True)
    node = YAML(typ="safe", pure=True).compose(listed)
    found = [listed[item.start_mark.index : item.end_mark.index].strip() for item in node.value]
    if not all(found):
        raise ConfigError(f"--over {text}: there is a value missing: write null to leave a key out")
    return tuple(dict.fromkeys(found))


def _as_typed(message: str, swept: Sequence[str]) -> str:
    """Name an override as it was typed."""
    for override in swept:
        message = message.replace(f"--set {override}", f"--over {override}")
    return message


def _folder(chosen: Sequence[tuple[str, str]]) -> str:
    """A unique file name of letters, digits and a few signs."""
    plain = "_".join(f"{key}={value}" for key, value in chosen)
    name = "_".join(f"{key}={_letters(value)}" for key, value in chosen)
    if name == plain and len(name) <= _LONGEST:
        return name
    return f"{name[:_LONGEST]}-{hashlib.sha256(plain.encode()).hexdigest()[:_DIGITS]}"


def _letters(value: str) -> str:
    return "-".join(re.sub(r"[^A-Za-z0-9.=+_-]+", " ", value).split())
