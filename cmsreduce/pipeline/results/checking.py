"""Check of a finished run or a component file against its limits and a baseline."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cmsreduce.errors import ReadError, WriteError
from cmsreduce.model import CONTROLLER_LIMITS, Failure, Finding, Proof, RunResult, Verdict, failure_findings, judge
from cmsreduce.pipeline.bodies import RIGID_MOTIONS
from cmsreduce.pipeline.results.baseline import SAME_RUN, StoredResult, compare, open_result
from cmsreduce.pipeline.results.limits import Limits, limited
from cmsreduce.pipeline.results.mass_and_frame import file_totals, total_findings
from cmsreduce.pipeline.results.step_advice import file_rounding
from cmsreduce.read import file_kind
from cmsreduce.report import junit_xml, markdown_summary, place
from cmsreduce.verify import MOMENTUM, REALISABLE, RIGID_SHAPES, inertia_excess, momentum_balance
from cmsreduce.write import SAME_MASS, ComponentFile, atomic_path, summary

__all__ = ["check_result", "refuse_model_file", "refuse_other_summary", "write_junit", "write_markdown"]

# Rigid modes of a body that is free in all directions.
_FREE = 6
_PLAIN = ("empty", "unknown", "yaml")
_UNSEALED = "written by an earlier version, without a checksum of its content"


def check_result(path: Path, limits: Limits, baseline: Path | None = None) -> tuple[list[Finding], Verdict]:
    """Check a run directory, its summary.json, or a component file.

    The verdict on a run is that of the run itself, with its files checked and with the limits given here.

    Parameters
    ----------
    path : Path
        Run directory, summary.json or component file.
    limits : Limits
        They replace the limits that are stored with the result.
    baseline : Path, optional
        Run directory or component file to compare with.

    Returns
    -------
    findings : list of Finding
        Errors of the run, checks of each component, checks of its file alone, changes from the baseline.
    verdict : Verdict
        ``not checked`` without a limit of the run, a limit given here, or a baseline.

    Raises
    ------
    ReadError
        If a path holds no result.
    ConfigError
        If a limit is on a figure that does not exist.
    """
    result = open_result(path)
    try:
        findings, proofs = list(_errors(result)), _proofs(result)
        checks = {name: list(_checks(result, name)) for name in result.names}
        unlisted = list(_speed((result.summary or {}).get("speed") or {}))
        unlisted += [size for name in result.names for size in _sizes(result, name)]
    except (KeyError, TypeError, AttributeError, ValueError):
        raise ReadError(f"{path}: its summary.json is damaged; run the pipeline again, or `cmsreduce report`") from None
    for name in result.names:
        findings += checks[name]
        if name in result.files:
            seal = Finding("unsealed", float(not result.files[name].sealed), note=_UNSEALED, subject=name)
            (unlisted if result.files[name].sealed else findings).append(seal)
            findings += _file_alone(name, result.files[name])
            findings += _modal_mass(name, result.files[name])
            findings += _rounding(name, result.files[name])
            findings += total_findings(name, file_totals(result.files[name]))
    if baseline is not None:
        findings += compare(open_result(baseline), result, limits.tolerances)
    found = limited(findings, limits, unlisted, path)
    given = bool(limits.maxima) or baseline is not None or bool((result.summary or {}).get("limits"))
    verdict = judge(found, proofs, limited=given)
    _refuse_contradiction(path, result.summary or {}, verdict if not limits.maxima else None)
    return found, verdict


def _refuse_contradiction(path: Path, summary: Mapping[str, Any], verdict: Verdict | None) -> None:
    """Refuse a summary whose word, ``passed`` and figures say different things."""
    stated = (summary.get("verdict") or {}).get("word")
    if stated is None:
        return
    if summary.get("passed") != (stated == "PASS"):
        contradiction = f"states {stated}, but `passed` is {summary.get('passed')!r}"
    elif stated == "FAIL" and verdict is not None and verdict.word == "PASS":
        contradiction = "states FAIL, but its figures give PASS"
    else:
        return
    raise ReadError(f"{path}: summary.json {contradiction}: it was edited; run the pipeline again")


def refuse_other_summary(folder: Path, result: RunResult) -> None:
    """Refuse a result whose modes, errors or limits are not those of the summary beside it.

    The pipeline was changed since, and some of its stages were run: page and summary would give two verdicts.

    Raises
    ------
    ReadError
        With the first figure that differs.
    """
    path = folder / "summary.json"
    try:
        stored = json.loads(path.read_text(encoding="utf-8"))
        was, now = (
            {
                **{f"frequencies of {name}": part["frequencies_hz"] for name, part in facts["components"].items()},
                **{name: [value] for name, value in facts["worst"].items()},
                **{f"limit on {name}": [value] for name, value in facts["limits"].items()},
            }
            for facts in (stored, summary(result))
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        # A missing summary contradicts nothing, and `check` names what is wrong with a damaged one.
        return
    for what in {**was, **now}:
        if not _same(was.get(what), now.get(what)):
            raise ReadError(
                f"{path}: it is of other settings than the finished stages beside it ({what}): the pipeline was "
                "changed after the run; run it again, which makes both anew"
            )


def _same(was: list[float | None] | None, now: list[float | None] | None) -> bool:
    if was is None or now is None or len(was) != len(now):
        return False
    a, b = (np.array(values, dtype=np.float64) for values in (was, now))
    # JSON has null for infinity, too.
    both = np.isfinite(a) & np.isfinite(b)
    return bool((np.isfinite(a) == np.isfinite(b)).all()) and np.allclose(a[both], b[both], rtol=SAME_RUN, atol=0.0)


def _speed(speed: Mapping[str, Any]) -> Iterator[Finding]:
    """Times of a run, and the cost of a simulation."""
    yield from (Finding(key, float(value)) for key, value in speed.items() if isinstance(value, (int, float)))
    for which, cost in (speed.get("simulation") or {}).items():
        if isinstance(cost, dict):
            known = {key: cost.get(key) for key in ("operations", "steps_per_second", "seconds")}
            yield from (Finding(f"{which}_{key}", float(value)) for key, value in known.items() if value is not None)


def write_junit(path: Path, findings: list[Finding], verdict: Verdict, checked: Path) -> None:
    """Write findings and verdict as JUnit XML; the file is whole or not there."""
    refuse_model_file(path)
    with atomic_path(path) as temporary:
        temporary.write_bytes(junit_xml(findings, verdict, str(checked)))


def write_markdown(path: Path, findings: list[Finding], verdict: Verdict, checked: Path) -> None:
    """Write findings and verdict as a Markdown summary; the file is whole or not there."""
    refuse_model_file(path)
    with atomic_path(path) as temporary:
        temporary.write_text(markdown_summary(findings, verdict, str(checked)), encoding="utf-8")


def refuse_model_file(path: Path) -> None:
    """Refuse to write a log or a list of checks over matrices, a deck, a pipeline, a result or a document.

    Raises
    ------
    WriteError
        If the file is one; a file of an earlier log or list may be replaced.
    """
    if not path.is_file():
        return
    kind = file_kind(path)
    # Lines of a log may read like YAML.
    if kind.name not in _PLAIN or path.suffix in (".yaml", ".yml"):
        raise WriteError(f"{path}: this is {kind.words}, which would be replaced; choose another name")


def _proofs(result: StoredResult) -> list[Proof]:
    """Proofs that the run stored; none in a component file, and in a summary of an early version."""
    stored = ((result.summary or {}).get("verdict") or {}).get("proofs") or []
    return [
        Proof(each["what"], each["state"], each["digits"], each["remark"], each["subject"], each.get("only", ""))
        for each in stored
    ]


def _errors(result: StoredResult) -> Iterator[Finding]:
    facts = result.summary
    if facts is None:
        return
    found: dict[str, Finding] = {}
    for name, figure in facts["figures"].items():
        value, where = figure["value"], figure["where"]
        # JSON has no number for a value that was not measured, nor for an infinite one.
        measured = math.nan if value is None else float(value)
        note = where if where.startswith("not measured") else place(where)
        found[name] = Finding(name, measured, _number(figure["limit"]), note)
    yield from found.values()
    limits = {**CONTROLLER_LIMITS, **{name: _number(limit) for name, limit in (facts.get("limits") or {}).items()}}
    failures = [
        Failure(each["what"], each["reason"], each["required"], tuple(each["limits"]))
        for each in facts.get("failures", ())
    ]
    yield from failure_findings(failures, limits, found)


def _checks(result: StoredResult, name: str) -> Iterator[Finding]:
    part = result.component(name)
    if part is not None:
        for check in part["checks"]:
            yield Finding(check["name"], _number(check["value"]), _number(check["limit"]), subject=name)
    else:
        yield from (replace(stored, subject=name) for stored in result.files[name].checks)


def _file_alone(name: str, file: ComponentFile) -> Iterator[Finding]:
    """Checks of a component file that do not need its body."""
    arrays = file.arrays
    if "integrals/rigid_mass" not in arrays:
        return
    rigid = arrays["integrals/rigid_mass"]
    excess = inertia_excess(rigid)
    if excess is not None:
        yield Finding("inertia in the file: beyond what mass can have", excess, REALISABLE, subject=name)
    if file.rigid_count == _FREE and "integrals/int_phi" in arrays:
        # A static mode has no modal mass to measure its momentum by.
        massive = slice(0, file.elastic.stop)
        momentum = np.vstack([arrays["integrals/int_phi"], arrays["integrals/int_r_x_phi"]])[:, massive]
        # A floating frame couples the elastic modes with the rigid ones in the mass matrix.
        coupled = arrays["modes/mass"][: file.rigid_count, massive].copy()
        coupled[:, : file.rigid_count] = 0.0
        momentum = momentum - momentum[:, : file.rigid_count] @ coupled
        carried, left = momentum_balance(rigid, momentum, file.rigid_count)
        # The rigid modes are those of K; the motions of the geometry are the same to the digits that the input has.
        limit = max([MOMENTUM, *(check.limit for check in file.checks if check.name == RIGID_MOTIONS)])
        # The run found so much about the centre of mass; about the origin it may be twice as much. The mass that the
        # rigid modes lack is quadratic in it.
        known = 2 * max([0.0, *(check.value for check in file.checks if check.name == RIGID_SHAPES)])
        yield Finding("momentum of the rigid modes against the rigid mass", carried, max(limit, known**2), subject=name)
        yield Finding("momentum of the elastic modes", left, max(limit, known), subject=name)


def _modal_mass(name: str, file: ComponentFile) -> Iterator[Finding]:
    """Trace of int phi_i phi_j dm against the modal mass, where both are over one mass."""
    facts, arrays = file.attributes.get("integrals", {}), file.arrays
    if "integrals/phi_phi" not in arrays or facts.get("lumping", "consistent") != "consistent":
        return
    modes = arrays["integrals/modes"]
    mass = arrays["modes/mass"][np.ix_(modes, modes)]
    apart = abs(np.einsum("iiab->ab", arrays["integrals/phi_phi"]) - mass).max(initial=0.0)
    relative = float(apart / max(abs(mass).max(initial=0.0), np.finfo(float).tiny))
    yield Finding("trace of int phi_i phi_j dm against the modal mass", relative, SAME_MASS, subject=name)


def _rounding(name: str, file: ComponentFile) -> Iterator[Finding]:
    """Effect of single precision on the body; judged only where a limit is set on it."""
    effect = file_rounding(file)
    if effect is None:
        return
    hz = f"lowest elastic frequency: {effect.lowest_hz:.4g} Hz"
    figures = (
        ("float32: change of frequencies", effect.free, ""),
        ("float32: change of frequencies, interfaces held", effect.held, ""),
        ("float32: rigid motion in Hz", effect.rigid_hz, hz),
        ("float32 superelement: change of frequencies", effect.boundary_free, ""),
        ("float32 superelement: rigid motion in Hz", effect.boundary_rigid_hz, hz),
    )
    for figure, value, note in figures:
        yield Finding(figure, value, note=note, subject=name)


def _sizes(result: StoredResult, name: str) -> Iterator[Finding]:
    """Figures of a component that have no limit of their own."""
    figures: dict[str, Any] = {}
    part = result.component(name)
    if part is not None:
        figures |= {key: part.get(key) for key in ("full_dofs", "basis_size", "elastic_modes", "kept_modes")}
        figures |= {"peak_mib": part.get("peak_mib"), "seconds": sum(part.get("seconds", {}).values())}
        figures["highest_hz"] = max(part.get("frequencies_hz", []), default=0.0)
        figures["basis_condition"] = part.get("basis", {}).get("condition")
        figures["static_lack"] = max((each["lack"] for each in part.get("static_lack") or ()), default=None)
    else:
        file = result.files[name]
        figures["basis_size"] = int(file.attributes["modes"].get("basis_size", file.omega.size))
        figures["kept_modes"] = file.omega[file.elastic].size
        figures["highest_hz"] = float(file.omega[file.elastic].max(initial=0.0) / (2 * np.pi))
    for key, value in figures.items():
        if value is not None:
            yield Finding(key, float(value), subject=name)


def _number(value: float | None) -> float:
    # JSON has no infinity: the summary writes null for it.
    return float("inf") if value is None else float(value)
