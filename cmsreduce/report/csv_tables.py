"""The tables of the report as rows of numbers, for a spreadsheet or a script."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from cmsreduce.model import INERTIA_AXES, SI, Response, RunResult, rigid_in_units
from cmsreduce.report.wording import FIGURES, compared, file_name, measured

__all__ = ["csv_tables"]

Cell = str | int | float | None

_MOTIONS = ("x", "y", "z", "rx", "ry", "rz")
_MODES = ("body", "mode", "hz", "zeta", "kind", "source_hz", "sigma", "spacing", "cluster", "kept", "why")


def csv_tables(run: RunResult) -> dict[str, list[tuple[Cell, ...]]]:
    """Every table of a run that has rows: errors, modes, pairs, checks, timings, gains, masses, responses.

    Parameters
    ----------
    run : RunResult

    Returns
    -------
    dict of str to list of tuple
        Names of the columns with their units, then rows of numbers in full; None where there is no value.
    """
    models = (run.model, *compared(run))
    figures = tuple(figure.name for figure in (measured(run) or FIGURES))
    results = [(result.configuration.name, result) for result in run.configurations]
    own = [(name, result.errors[run.model]) for name, result in results if run.model in result.errors]
    errors: list[tuple[Cell, ...]] = [
        (name, model, result.n_full, each.coordinates, each.seconds, *(getattr(each, key) for key in figures))
        for name, result in results
        for model in models
        if (each := result.errors.get(model)) is not None
    ]
    masses: list[tuple[Cell, ...]] = [
        (name, float(hz), *map(float, row))
        for name, curve in run.effective_mass.items()
        for hz, row in zip(curve.hz, curve.running, strict=True)
    ]
    found: dict[str, list[tuple[Cell, ...]]] = {
        "errors": [
            ("configuration", "model", "full_coordinates", "reduced_coordinates", "response_s", *figures),
            *errors,
        ],
        "modes": [_MODES, *_modes(run)],
        "frequencies": [
            ("configuration", "full_hz", "reduced_hz", "mac"),
            *(
                (name, float(full), float(reduced), float(mac))
                for name, each in own
                for full, reduced, mac in zip(each.full_hz, each.reduced_hz, each.mac, strict=True)
            ),
        ],
        "system": [
            ("configuration", "hz", "zeta"),
            *(
                (each.configuration.name, float(hz), None if each.zeta is None else float(each.zeta[k]))
                for each in run.systems
                for k, hz in enumerate(each.frequencies_hz)
            ),
        ],
        "rigid_bodies": [
            ("body", "mass_kg", "cg_x_m", "cg_y_m", "cg_z_m", *(f"inertia_{axes}_kg_m2" for axes in INERTIA_AXES)),
            *_rigid_bodies(run),
        ],
        "checks": [
            ("body", "check", "value", "limit", "passed"),
            *(
                (name, check.name, check.value, check.limit, int(check.passed))
                for name, part in run.components.items()
                for check in part.checks
            ),
        ],
        "timings": [
            ("body", "stage", "seconds"),
            *((name, stage, s) for name, part in run.components.items() for stage, s in part.seconds.items()),
        ],
        "gains": [("configuration", "input", "output", "hz", "running_gain"), *_gains(run)],
        "effective_mass": [
            ("body", "hz", *_MOTIONS),
            *masses,
        ],
        "completeness": [
            ("axis", "configuration", "band", "kept", "whole"),
            *((row.axis, row.configuration, row.band, row.kept, row.whole) for row in run.completeness),
        ],
    }
    for k, (name, result) in enumerate(results):
        there = [model for model in models if model in result.response.reduced]
        found[f"response_{k + 1}_{file_name(name)}"] = _responses(run, result.response, there)
    return {name: rows for name, rows in found.items() if len(rows) > 1}


def _rigid_bodies(run: RunResult) -> Iterable[tuple[Cell, ...]]:
    for body in run.rigid_bodies:
        si = rigid_in_units(body, SI)
        yield body.name, si.mass, *map(float, si.cg), *si.moments


def _modes(run: RunResult) -> Iterable[tuple[Cell, ...]]:
    for name, part in run.components.items():
        modes, kept = part.modes, set(part.kept.tolist())
        for k in range(modes.omega.size):
            yield (
                name,
                k + 1,
                float(modes.omega[k]) / (2 * math.pi),
                float(modes.zeta[k]),
                modes.kind[k],
                _known(modes.source_hz[k]),
                _known(modes.sigma[k]),
                _known(modes.spacing[k]),
                None if modes.cluster is None else int(modes.cluster[k]),
                int(k in kept),
                modes.why[k],
            )


def _gains(run: RunResult) -> Iterable[tuple[Cell, ...]]:
    for configuration, (kept, _) in run.gains.items():
        for o, output in enumerate(run.outputs):
            for i, name in enumerate(run.inputs):
                for hz, value in zip(kept.hz, kept.running[:, o, i], strict=True):
                    yield configuration, name, output, float(hz), float(value)


def _responses(run: RunResult, response: Response, models: list[str]) -> list[tuple[Cell, ...]]:
    """Real and imaginary parts of every channel, of the reference model ``full`` and of each reduced model."""
    heads = ["hz"]
    columns = [response.frequency_hz]
    for label, H in (("full", response.full), *((model, response.reduced[model]) for model in models)):
        for o, output in enumerate(run.outputs):
            for i, entry in enumerate(run.inputs):
                heads += [f"{label} {entry} > {output} {part}" for part in ("re", "im")]
                columns += [H[:, o, i].real, H[:, o, i].imag]
    return [tuple(heads), *map(tuple, np.column_stack(columns).tolist())]


def _known(value: float) -> float | None:
    return None if math.isnan(value) else float(value)
