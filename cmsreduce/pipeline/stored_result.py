"""A finished run, or one component file, as it lies on the disk."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cmsreduce.errors import ReadError
from cmsreduce.write import ComponentFile, read_component

__all__ = ["StoredResult", "open_result"]

_COMPONENT_KEYS = {"checks", "frequencies_hz", "kept_modes"}


@dataclass(frozen=True, eq=False)
class StoredResult:
    """What is left of a run.

    Parameters
    ----------
    path : Path
        As the user named it.
    summary : mapping, optional
        summary.json of a run; None of a component file alone.
    files : mapping of component to ComponentFile
        Component files there are.
    """

    path: Path
    summary: Mapping[str, Any] | None
    files: Mapping[str, ComponentFile]

    @property
    def names(self) -> list[str]:
        """Components, in the order of the run."""
        return list(self.files if self.summary is None else self.summary["components"])

    def component(self, name: str) -> Mapping[str, Any] | None:
        """Summary of a component; None of a component file alone."""
        if self.summary is None:
            return None
        found: Mapping[str, Any] = self.summary["components"][name]
        return found


def open_result(path: Path) -> StoredResult:
    """Open a run directory, its summary.json, or a component file.

    Raises
    ------
    ReadError
        If the path holds no result, or a file of it is damaged.
    """
    if path.is_file() and path.suffix == ".h5":
        file = read_component(path)
        return StoredResult(path, None, {file.name: file})
    summary = path / "summary.json" if path.is_dir() else path
    if not summary.is_file():
        raise ReadError(f"{path}: there is no summary.json; give the output directory of a finished run")
    try:
        facts: dict[str, Any] = json.loads(summary.read_text(encoding="utf-8"))
        whole = all(facts["components"][name].keys() >= _COMPONENT_KEYS for name in facts["components"])
        # Summaries of earlier versions have errors only.
        facts["figures"] = _figures(facts)
        whole &= all({"value", "where", "limit"} <= figure.keys() for figure in facts["figures"].values())
    except (ValueError, KeyError, TypeError, AttributeError):
        whole = False
    if not whole:
        raise ReadError(f"{summary}: this is no summary of a run; run the pipeline again")
    beside = {name: summary.parent / f"{name}.h5" for name in facts["components"]}
    return StoredResult(path, facts, {name: read_component(file) for name, file in beside.items() if file.is_file()})


def _figures(facts: Mapping[str, Any]) -> dict[str, Any]:
    """Figures of a summary, or what its errors and limits say of them."""
    if "figures" in facts:
        return dict(facts["figures"])
    limits, rows = facts.get("limits", {}), facts.get("configurations", [])
    found = {}
    for name, value in (facts.get("worst") or {}).items():
        # A system without damping has no such error.
        if name == "damping_error" and value is None:
            continue
        where = next((row["name"] for row in rows if value is not None and row.get(name) == value), "")
        found[name] = {"value": value, "where": where, "limit": limits.get(name)}
    return found
