"""Stored results, and the changes between two of them: frequencies, shapes, mass, integrals, kept modes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ConfigError, ReadError
from cmsreduce.model import Finding
from cmsreduce.pipeline.results.baseline_matrices import matrix_findings
from cmsreduce.pipeline.results.baseline_rows import common_dofs, lost_or_new, row_findings
from cmsreduce.pipeline.results.baseline_statements import statement_findings
from cmsreduce.pipeline.results.limits import Tolerances
from cmsreduce.pipeline.store import ORIGIN, read_origin
from cmsreduce.read import expect_kind, file_kind
from cmsreduce.report import place
from cmsreduce.verify import ModePairing, integral_change, mass_change, pair_modes, scaled_rows
from cmsreduce.write import ComponentFile, read_component, read_summary, refuse_changed, stated_settings

__all__ = ["SAME_RUN", "StoredResult", "compare", "open_result"]

Array = NDArray[np.float64]
Modes = tuple[Array, ComponentFile | None]
"""Kept elastic modes of one component: frequencies in Hz, and its file, if there is one."""

_COMPONENT_KEYS = {"checks", "frequencies_hz", "kept_modes"}
SAME_RUN = 1e-9
"""Largest relative difference of a figure that two files of one run hold, both in double precision."""

# Modes named in a note; more do not fit a line.
_NAMED = 4
# Integrals over modes: axes that count modes, and the rigid mass whose square root bounds them.
_INTEGRALS: Mapping[str, tuple[tuple[int, ...], str]] = {
    "int_phi": ((1,), "mass"),
    "int_r_x_phi": ((1,), "inertia"),
    "phi": ((1,), "mass"),
    "r_cross_phi": ((1,), "inertia"),
    "r_phi": ((2,), "inertia"),
    "phi_phi": ((2, 3), "one"),
}


@dataclass(frozen=True, eq=False)
class StoredResult:
    """A run directory or a component file on disk.

    Parameters
    ----------
    path : Path
        As the user named it.
    summary : mapping, optional
        summary.json of a run; None for a component file alone.
    files : mapping of component to ComponentFile
        Existing component files.
    """

    path: Path
    summary: Mapping[str, Any] | None
    files: Mapping[str, ComponentFile]

    @property
    def names(self) -> list[str]:
        """Components, in the order of the run."""
        return list(self.files if self.summary is None else self.summary["components"])

    def component(self, name: str) -> Mapping[str, Any] | None:
        """Summary of a component; None for a component file alone."""
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
    expect_kind(path, "result")
    if path.is_file() and file_kind(path).name == "component":
        file = read_component(path)
        return StoredResult(path, None, {file.name: file})
    summary = path / "summary.json" if path.is_dir() else path
    if not summary.is_file():
        raise ReadError(f"{path}: there is no summary.json; give the output directory of a finished run")
    if (summary.parent / ORIGIN).is_file():
        # Results whose source is not known are not checked.
        read_origin(summary.parent)
    facts = read_summary(summary)
    try:
        components: dict[str, Any] = facts["components"]
        whole = all(part.keys() >= _COMPONENT_KEYS for part in components.values())
        whole &= all(np.isfinite(part["frequencies_hz"]).ndim == 1 for part in components.values())
        # Summaries of earlier versions have errors only.
        facts["figures"] = _figures(facts)
        whole &= all({"value", "where", "limit"} <= figure.keys() for figure in facts["figures"].values())
    except (ValueError, KeyError, TypeError, AttributeError):
        whole = False
    if not whole:
        raise ReadError(f"{summary}: this is no summary of a run; run the pipeline again")
    system = summary.parent / "system.h5"
    settings = stated_settings(system) if system.is_file() else None
    beside = {name: summary.parent / f"{name}.h5" for name in components}
    files = {name: read_component(file) for name, file in beside.items() if file.is_file()}
    for name, file in files.items():
        _refuse_foreign(beside[name], name, file, components[name]["frequencies_hz"])
        if settings is not None and file.sealed and file.settings != settings:
            raise ReadError(
                f"{system}: it is of another run than {beside[name].name} beside it; write both again with "
                "`cmsreduce run`"
            )
    refuse_changed(summary.parent)
    return StoredResult(path, facts, files)


def _refuse_foreign(path: Path, name: str, file: ComponentFile, kept_hz: Sequence[float]) -> None:
    """Refuse a component file of another body, or of another run of the body: its seal alone does not show it."""
    if file.name != name:
        raise ReadError(f"{path}: it holds component '{file.name}', not '{name}'; write it again with `cmsreduce run`")
    hz = file.omega[file.elastic] / (2 * np.pi)
    if len(hz) != len(kept_hz) or not np.allclose(hz, kept_hz, rtol=SAME_RUN, atol=0.0):
        raise ReadError(
            f"{path}: its modes are not those of summary.json ({_listed(hz) if hz.size else 'none'}, against "
            f"{_listed(np.array(kept_hz)) if kept_hz else 'none'}): the file is of another run; write it again with "
            "`cmsreduce run`"
        )


def _figures(facts: Mapping[str, Any]) -> dict[str, Any]:
    """Figures of a summary, or of an early version its errors with their limits."""
    if "figures" in facts:
        return dict(facts["figures"])
    limits, rows = facts.get("limits", {}), facts.get("configurations", [])
    found = {}
    for name, value in (facts.get("worst") or {}).items():
        # A system without damping has no damping error.
        if name == "damping_error" and value is None:
            continue
        where = next((row["name"] for row in rows if value is not None and row.get(name) == value), "")
        found[name] = {"value": value, "where": where, "limit": limits.get(name)}
    return found


def compare(old: StoredResult, new: StoredResult, tolerances: Tolerances) -> list[Finding]:
    """Compare a result with its baseline.

    Parameters
    ----------
    old, new : StoredResult
        Runs or component files; a single component is compared with the one of its name in a run.
    tolerances : Tolerances
        Largest changes that pass.

    Returns
    -------
    list of Finding
        One for each kind of change of each component, with the largest change in words.

    Raises
    ------
    ConfigError
        If the two have no component in common.
    """
    common = [name for name in new.names if name in old.names]
    if not common:
        raise ConfigError(
            f"--baseline {old.path}: it holds {', '.join(old.names) or 'no component'}, but {new.path} holds "
            f"{', '.join(new.names) or 'no component'}: compare results of the same bodies"
        )
    findings = []
    if old.summary is not None and new.summary is not None:
        findings += list(_run(old.summary, new.summary, tolerances))
        findings.append(lost_or_new("baseline: components", old.names, new.names))
        rows = ([row["name"] for row in facts.get("system", [])] for facts in (old.summary, new.summary))
        findings.append(lost_or_new("baseline: configurations", *rows))
    for name in common:
        findings += [
            replace(found, name=f"baseline: {found.name}", subject=name)
            for found in _component(_modes(old, name), _modes(new, name), tolerances)
        ]
    return findings


def _modes(result: StoredResult, name: str) -> Modes:
    file = result.files.get(name)
    if file is not None:
        return file.omega[file.elastic] / (2 * np.pi), file
    part = result.component(name)
    return np.array(part["frequencies_hz"] if part is not None else [], dtype=np.float64), None


def _run(old: Mapping[str, Any], new: Mapping[str, Any], tolerances: Tolerances) -> Iterator[Finding]:
    was, now = ({name: each["value"] for name, each in facts["figures"].items()} for facts in (old, new))
    for key in was:
        if was[key] is None:
            continue
        known = now.get(key) is not None
        grown = max(now[key] - was[key], 0.0) if known else float("nan")
        note = f"{f'{now[key]:.4g}' if known else 'not measured'}, was {was[key]:.4g}"
        yield Finding(f"baseline: growth of {key}", grown, tolerances.errors, note)
    before = {row["name"]: row["frequencies_hz"] for row in old.get("system", [])}
    worst, note, shared = 0.0, "", False
    for row in new.get("system", []):
        if row["name"] not in before:
            continue
        shared = True
        w, v = (np.array(values, dtype=np.float64) for values in (before[row["name"]], row["frequencies_hz"]))
        pairs = pair_modes(w, v, np.empty((0, w.size)), np.empty((0, v.size)))
        shift, text = _worst_shift(pairs, w, v)
        if shift >= worst:
            worst, note = shift, f"{text} {place(row['name'])}" if text else ""
    if shared:
        yield Finding("baseline: frequencies of the system", worst, tolerances.frequency, note)


def _component(old: Modes, new: Modes, tolerances: Tolerances) -> Iterator[Finding]:
    (old_hz, old_file), (new_hz, new_file) = old, new
    shapes = np.empty((0, old_hz.size)), np.empty((0, new_hz.size))
    if old_file is not None and new_file is not None:
        shapes = _common_shapes(old_file, new_file)
    pairs = pair_modes(old_hz, new_hz, *shapes)
    shift, text = _worst_shift(pairs, old_hz, new_hz)
    yield Finding("frequencies", shift, tolerances.frequency, text)
    count = pairs.lost.size + pairs.gained.size
    yield Finding("modes lost or gained", float(count), tolerances.modes, _came_and_went(pairs, old_hz, new_hz))
    if old_file is None or new_file is None:
        return
    for what in ("rigid", "static"):
        a, b = (getattr(file, f"{what}_count") for file in (old_file, new_file))
        yield Finding(f"{what} modes", float(abs(a - b)), 0.0, f"{b}, were {a}" if a != b else "")
    if shapes[0].shape[0]:
        worst = float((1 - pairs.mac).max(initial=0.0))
        yield Finding("mode shapes", worst, tolerances.shape, _worst_shape(pairs, new_hz))
    yield from row_findings(old_file, new_file, pairs, tolerances)
    yield from _integrals(old_file, new_file, pairs, tolerances)
    yield from matrix_findings(old_file, new_file, pairs, tolerances)
    yield from statement_findings(old_file, new_file, tolerances)


def _common_shapes(old: ComponentFile, new: ComponentFile) -> tuple[Array, Array]:
    """Shapes of the elastic modes at the dofs that both files hold."""
    i, j, rotation = common_dofs(old, new)
    was, now = scaled_rows(old.arrays["dofs/shapes"][i], new.arrays["dofs/shapes"][j], rotation)
    return was[:, old.elastic], now[:, new.elastic]


def _integrals(old: ComponentFile, new: ComponentFile, pairs: ModePairing, tolerances: Tolerances) -> Iterator[Finding]:
    key = "integrals/rigid_mass"
    if key not in old.arrays or key not in new.arrays:
        return
    rigid = old.arrays[key]
    for what, value in mass_change(rigid, new.arrays[key]).items():
        yield Finding(what, value, tolerances.mass)
    bounds = {"mass": rigid.diagonal()[:3].max(), "inertia": rigid.diagonal()[3:].max(), "one": 1.0}
    changed = {}
    for name, (axes, bound) in _INTEGRALS.items():
        parts = [_over_pairs(file, name, axes, at) for file, at in ((old, pairs.old), (new, pairs.new))]
        if parts[0] is not None and parts[1] is not None:
            limit = float(np.sqrt(bounds[bound]))
            changed[name] = integral_change(parts[0], parts[1], axes, pairs.turn, limit)
    if changed:
        worst = max(changed, key=lambda name: changed[name])
        note = f"of {worst}" if changed[worst] else ""
        yield Finding("modal integrals", changed[worst], tolerances.integrals, note)


def _over_pairs(file: ComponentFile, name: str, axes: Sequence[int], elastic: NDArray[np.int64]) -> Array | None:
    """An integral over the paired modes; None where the file has none, or it leaves some of them out."""
    values = file.arrays.get(f"integrals/{name}")
    if values is None:
        return None
    columns = elastic + file.rigid_count
    if values.shape[axes[0]] != file.omega.size:
        over = file.arrays.get("integrals/modes")
        if over is None or not np.isin(columns, over).all():
            return None
        columns = np.searchsorted(over, columns)
    for axis in axes:
        values = np.take(values, columns, axis=axis)
    return np.asarray(values)


def _worst_shift(pairs: ModePairing, old_hz: Array, new_hz: Array) -> tuple[float, str]:
    if not pairs.shift.size:
        return 0.0, ""
    at = int(abs(pairs.shift).argmax())
    shift = float(abs(pairs.shift[at]))
    i, j = int(pairs.old[at]), int(pairs.new[at])
    return shift, f"mode {j + 1}: {new_hz[j]:.6g} Hz, was {old_hz[i]:.6g} Hz" if shift else ""


def _worst_shape(pairs: ModePairing, hz: Array) -> str:
    if not pairs.mac.size:
        return ""
    at = int(pairs.mac.argmin())
    j = int(pairs.new[at])
    return f"mode {j + 1} at {hz[j]:.6g} Hz: MAC {pairs.mac[at]:.6f}"


def _came_and_went(pairs: ModePairing, old_hz: Array, new_hz: Array) -> str:
    words = [
        f"{what} {_listed(hz[at])}"
        for what, hz, at in (("lost", old_hz, pairs.lost), ("gained", new_hz, pairs.gained))
        if at.size
    ]
    return "; ".join([f"{new_hz.size} elastic modes, were {old_hz.size}", *words]) if words else ""


def _listed(hz: Array) -> str:
    named = ", ".join(f"{value:.6g}" for value in hz[:_NAMED])
    return f"{named}{f' and {hz.size - _NAMED} more' if hz.size > _NAMED else ''} Hz"
