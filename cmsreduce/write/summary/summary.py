"""Content of summary.json: results of a run under stable keys."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from cmsreduce.mechanics import advised_steps
from cmsreduce.model import (
    DOF_NAMES,
    ERRORS,
    SI,
    ComponentResult,
    Configuration,
    Factorisation,
    ModeCertificate,
    ModelErrors,
    ProjectionRecord,
    RigidBody,
    RunResult,
    SensitivityRecord,
    SimulationCost,
    Speed,
    health_data,
    rigid_in_units,
)
from cmsreduce.write.summary.checks import (
    basis,
    channels,
    controller,
    figures,
    pole_pairs,
    static_lack,
    system_checks,
    unpaired,
)

__all__ = ["angles", "summary"]


def summary(run: RunResult) -> dict[str, Any]:
    """Results of a run as plain JSON values.

    Parameters
    ----------
    run : RunResult

    Returns
    -------
    dict
        The keys ``name``, ``version``, ``components``, ``configurations``, ``worst``, ``speed``, ``passed``
        and ``verdict``, and ``rigid_bodies``, ``comparisons``, ``limits``, ``reference``, ``band_hz``, ``system``,
        ``projection``, ``search``, ``sensitivity``, ``completeness``, ``figures``, ``controller``, ``between``,
        ``channels_left_out``, ``not_checked``, ``notes`` and ``failures``. A value that is not finite is None.
    """
    labels = dict.fromkeys(label for result in run.configurations for label in result.errors)
    verdict = run.verdict
    facts: dict[str, Any] = _finite(
        {
            "name": run.name,
            "version": run.version,
            "components": {name: _component(part, run) for name, part in run.components.items()},
            "rigid_bodies": {body.name: _rigid(body) for body in run.rigid_bodies},
            "configurations": _configurations(run, run.model, sizes=True),
            "worst": _worst(run, run.model),
            "speed": _speed(run.speed),
            "passed": verdict.passed,
            "verdict": {
                "word": verdict.word,
                "broken": [each.label for each in verdict.broken],
                "not_measured": {each.label: each.note for each in verdict.unmeasured},
                "trusted": [f"{proof.what}: {proof.subject}".rstrip(": ") for proof in verdict.trusted],
                "unproven": [f"{proof.what}: {proof.subject}".rstrip(": ") for proof in verdict.unproven],
                "proofs": [asdict(proof) for proof in verdict.proofs],
            },
            "comparisons": {
                label: {"worst": _worst(run, label), "configurations": _configurations(run, label, sizes=False)}
                for label in labels
                if label != run.model
            },
            "limits": dict(run.limits),
            "reference": dict(run.reference),
            "band_hz": list(run.band),
            "system": [
                {
                    "name": modes.configuration.name,
                    "angles": angles(modes.configuration, [other.configuration for other in run.systems]),
                    "parameters": dict(modes.configuration.parameters),
                    "rigid_modes": modes.rigid_count,
                    "frequencies_hz": modes.frequencies_hz.tolist(),
                    "zeta": None if modes.zeta is None else modes.zeta.tolist(),
                    "integration": _integration(modes.highest_hz, static_highest_hz=modes.treated_hz),
                }
                for modes in run.systems
            ],
            "projection": None if run.projection is None else _projection(run.projection),
            "search": _record(run.search, "asked"),
            "sensitivity": None if run.sensitivity is None else _sensitivity(run.sensitivity),
            "completeness": [_record(axis, "missing") for axis in run.completeness],
            "figures": figures(run),
            "controller": controller(run),
            "between": None if run.between is None else asdict(run.between),
            "channels_left_out": {reason: list(names) for reason, names in run.left_out_channels.items()},
            "not_checked": [] if run.checks is None else list(run.checks.left_out),
            "notes": list(run.notes),
            "failures": [asdict(failure) for failure in run.failures],
        }
    )
    return facts


def _record(record: Any, *computed: str) -> dict[str, Any] | None:
    """Fields of a dataclass and some of its properties; None without the dataclass."""
    return None if record is None else asdict(record) | {name: getattr(record, name) for name in computed}


def _speed(speed: Speed | None) -> dict[str, Any] | None:
    """Wall times, and the cost of a simulated second of both systems."""
    facts = _record(speed)
    if speed is not None and facts is not None and speed.simulation is not None:
        for which in ("full", "reduced"):
            found: SimulationCost | None = getattr(speed.simulation, which)
            if found is not None:
                facts["simulation"][which]["operations"] = found.operations
    return facts


def _worst(run: RunResult, label: str) -> dict[str, float | None]:
    """Largest errors; a system without damping has no damping error. That of the worst channel is among the figures."""
    found = run.worst(label)
    return {name: found.get(name) for name in ERRORS if name != "channel_error"} if found else {}


def _complex_modes(errors: ModelErrors | None) -> list[dict[str, float]] | None:
    """Complex modes of the reduced system in the band, each with its partner in the reference model."""
    if errors is None or errors.damped is None:
        return None
    names = ("full_hz", "reduced_hz", "full_zeta", "reduced_zeta", "mac")
    columns = [getattr(errors.damped, name).tolist() for name in names]
    return [dict(zip(names, mode, strict=True)) for mode in zip(*columns, strict=True)]


def _component(part: ComponentResult, run: RunResult) -> dict[str, Any]:
    modes = part.modes
    elastic = np.arange(modes.omega.size)[modes.elastic]
    return {
        "full_dofs": part.full_dofs,
        "basis_size": modes.basis_size,
        "rigid_modes": modes.rigid_count,
        "elastic_modes": modes.elastic_count,
        "static_modes": modes.static_count,
        "kept_modes": part.kept_modes,
        "method": modes.method,
        "frequencies_hz": (modes.omega[np.intersect1d(part.kept, elastic)] / (2 * np.pi)).tolist(),
        "frequency_error_bars_hz": part.frequency_error_bars_hz.tolist(),
        "seconds": dict(part.seconds),
        "peak_mib": part.peak_mib,
        "certificate": _certificate(modes.certificate),
        "solver": _solver(part.factorised),
        "bound": _record(part.bound, "tightness"),
        "cutoff": None
        if (found := part.cutoff) is None
        else {
            "multiple": found.cutoff_bands,
            "estimate": found.error,
            "allowed": found.limit,
            "tried": found.tried,
        },
        "scaling": part.scaling,
        "integration": _integration(part.highest_hz, costly=_record(part.costly, "gain")),
        "single_precision": _record(part.rounding),
        "basis": basis(part),
        "health": health_data(part.health) if part.health else None,
        "static_lack": None if run.checks is None else static_lack(run.checks.static.get(part.name)),
        "checks": [
            {"name": each.name, "value": each.value, "limit": each.limit, "passed": each.passed} for each in part.checks
        ],
    }


def _rigid(body: RigidBody) -> dict[str, Any]:
    """Mass, centre of mass and inertia about it, by the names of the pipeline's keys and in SI."""
    si = rigid_in_units(body, SI)
    return {"mass_kg": si.mass, "cg_m": si.cg.tolist(), "inertia_kg_m2": si.moments}


def _integration(highest_hz: float | None, **more: Any) -> dict[str, Any] | None:
    """Integrator steps for a highest frequency; None where it is not known."""
    if highest_hz is None:
        return None
    return {"highest_hz": highest_hz, "steps": advised_steps(2 * math.pi * highest_hz), **more}


def _certificate(certificate: ModeCertificate | None) -> dict[str, Any] | None:
    """Proven facts on the normal modes; None without a certificate."""
    if certificate is None:
        return None
    return {
        "cutoff_hz": certificate.cutoff_hz,
        "counted": certificate.counted,
        "found": certificate.frequency_hz.size,
        "frequency_bound": certificate.worst_bound,
    }


def _projection(record: ProjectionRecord) -> dict[str, Any]:
    """Projection and assembly: chosen modes, the error with which they return, ranks, extraneous modes."""
    return {
        "sampled": [
            {
                "configuration": each.configuration,
                "modes": each.hz.size,
                "frequencies_hz": each.hz.tolist(),
                "worst_return": float(each.error.max(initial=0.0)),
                "extraneous": each.extraneous,
                "extraneous_by_count": each.predicted,
            }
            for each in record.sampled
        ],
        "rank": dict(record.rank),
        "tolerance": record.tolerance,
        "singular_values": {name: values.tolist() for name, values in record.singular.items()},
        "outputs": list(record.outputs),
        "extraneous_in_band": [
            {
                "configuration": mode.configuration,
                "frequency_hz": mode.hz,
                "body": mode.body,
                "energy": dict(mode.energy),
                "interface": mode.interface,
                "weight": mode.weight.tolist(),
                "mac": mode.mac,
            }
            for mode in record.extraneous
        ],
        "static_shapes_added": dict(record.suppressed),
        "between": dict(record.between),
        "configurations": list(record.configurations),
        "certificate": None if record.certificate is None else asdict(record.certificate),
    }


def _sensitivity(record: SensitivityRecord) -> dict[str, Any]:
    """Modes kept in each case, and the modes on the edge; modes are numbered as in the tables."""
    cases = []
    for case in record.cases:
        more, less = case.against(record.chosen)
        counts = None if case.kept is None else {body: len(modes) for body, modes in case.kept.items()}
        cases.append(
            {"change": case.change, "kept_modes": counts, "added": more, "left_out": less, "failure": case.failure}
        )
    edges = {
        body: [{"mode": number, "cases": list(changes)} for number, changes in record.edge(body).items()]
        for body in record.chosen
    }
    return {"cases": cases, "on_the_edge": edges}


def _solver(done: Sequence[Factorisation]) -> dict[str, Any]:
    """Sparse factorisations of a body: solvers, number, time, and the largest one."""
    largest = max(done, key=lambda each: each.entries, default=None)
    return {
        "backends": sorted({each.backend for each in done}),
        "factorisations": len(done),
        "seconds": sum(each.seconds for each in done),
        # The key of earlier versions, which could factorise in parts; readers may need it.
        "largest": None if largest is None else asdict(largest) | {"parts": 1},
    }


def _configurations(run: RunResult, label: str, *, sizes: bool) -> list[dict[str, Any]]:
    rows = []
    every = [result.configuration for result in run.configurations]
    for result in run.configurations:
        row: dict[str, Any] = {
            "name": result.configuration.name,
            "angles": angles(result.configuration, every),
            "parameters": dict(result.configuration.parameters),
        }
        errors = result.errors.get(label)
        row |= {name: None if errors is None else getattr(errors, name) for name in ERRORS}
        row |= unpaired(run, errors)
        if sizes:
            row |= {
                "complex_modes": _complex_modes(errors),
                "channels": channels(run, errors),
                "modes": pole_pairs(errors),
                "checks": system_checks(run, result),
                "n_full": result.n_full,
                "n_reduced": result.n_reduced,
                "modes_full": result.modes_full,
                "modes_reduced": result.modes_reduced,
            }
        rows.append(row)
    return rows


def angles(configuration: Configuration, among: Sequence[Configuration] = ()) -> dict[str, float]:
    """Joint values in degrees; translations in the scene's unit of length.

    Parameters
    ----------
    configuration : Configuration
    among : sequence of Configuration
        All configurations of the run. A joint with values for several motions in any of them is written ``joint.dof``
        in all of them.

    Examples
    --------
    >>> angles(Configuration("tilted", {("spin", 5): np.pi / 4}))
    {'spin': 45.0}
    """
    motions = {key for one in (configuration, *among) for key in one.angles}
    joints = [joint for joint, _ in motions]
    found = {}
    for (joint, dof), value in configuration.angles.items():
        key = joint if joints.count(joint) == 1 else f"{joint}.{DOF_NAMES[dof]}"
        # Twelve decimals restore the degrees that the user typed.
        found[key] = round(math.degrees(value), 12) if dof >= 3 else value
    return found


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(item) for item in value]
    if isinstance(value, (float, np.floating)):
        return float(value) if math.isfinite(value) else None
    if isinstance(value, (np.integer, np.bool_)):
        return value.item()
    return value
