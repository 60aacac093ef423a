"""The tables of the report as rows of numbers, for a spreadsheet or a script."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from cmsreduce.model import RunResult
from cmsreduce.report.wording import FIGURES, compared, file_name, measured

__all__ = ["CsvTable", "csv_tables"]

Cell = str | int | float | None

_MOTIONS = ("x", "y", "z", "rx", "ry", "rz")
_MODES = ("body", "mode", "hz", "zeta", "kind", "source_hz", "sigma", "spacing", "cluster", "kept", "why")


@dataclass(frozen=True)
class CsvTable:
    """One table.

    Parameters
    ----------
    name : str
        Name of its file, without an ending.
    heads : tuple of str
        Columns, units in them.
    rows : list of tuple
        Numbers in full, None where there is no value.
    """

    name: str
    heads: tuple[str, ...]
    rows: list[tuple[Cell, ...]]


def csv_tables(run: RunResult) -> list[CsvTable]:
    """Every table of a run that has rows: errors, modes, pairs, checks, timings, gains, masses, responses.

    Parameters
    ----------
    run : RunResult
    """
    models = (run.model, *compared(run))
    figures = tuple(figure.name for figure in (measured(run) or FIGURES[:3]))
    results = [(result.configuration.name, result) for result in run.configurations]
    own = [(name, result, result.errors[run.model]) for name, result in results if run.model in result.errors]
    found = [
        CsvTable(
            "errors",
            ("configuration", "model", "full_coordinates", "reduced_coordinates", "response_s", *figures),
            [
                (name, model, result.n_full, each.coordinates, each.seconds, *(getattr(each, key) for key in figures))
                for name, result in results
                for model in models
                if (each := result.errors.get(model)) is not None
            ],
        ),
        CsvTable("modes", _MODES, list(_modes(run))),
        CsvTable(
            "frequencies",
            ("configuration", "full_hz", "reduced_hz", "mac"),
            [
                (name, float(full), float(reduced), float(mac))
                for name, _, each in own
                for full, reduced, mac in zip(each.full_hz, each.reduced_hz, each.mac, strict=True)
            ],
        ),
        CsvTable(
            "checks",
            ("body", "check", "value", "limit", "passed"),
            [
                (name, check.name, check.value, check.limit, int(check.passed))
                for name, part in run.components.items()
                for check in part.checks
            ],
        ),
        CsvTable(
            "timings",
            ("body", "stage", "seconds"),
            [(name, stage, s) for name, part in run.components.items() for stage, s in part.seconds.items()],
        ),
        CsvTable("gains", ("configuration", "input", "output", "hz", "running_gain"), list(_gains(run))),
        CsvTable(
            "effective_mass",
            ("body", "hz", *_MOTIONS),
            [
                (name, float(hz), *map(float, row))
                for name, curve in run.effective_mass.items()
                for hz, row in zip(curve.hz, curve.running, strict=True)
            ],
        ),
        CsvTable(
            "completeness",
            ("axis", "configuration", "band", "kept", "whole"),
            [(row.axis, row.configuration, row.band, row.kept, row.whole) for row in run.completeness],
        ),
    ]
    for k, (name, result) in enumerate(results):
        found.append(
            _responses(
                run, f"response_{k + 1}_{file_name(name)}", k, [m for m in models if m in result.response.reduced]
            )
        )
    return [table for table in found if table.rows]


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
    for curve in run.gains:
        for o, output in enumerate(run.outputs):
            for i, name in enumerate(run.inputs):
                for hz, value in zip(curve.kept.hz, curve.kept.running[:, o, i], strict=True):
                    yield curve.configuration, name, output, float(hz), float(value)


def _responses(run: RunResult, name: str, at: int, models: list[str]) -> CsvTable:
    """Complex responses of every channel: real and imaginary parts of the full system and of each model."""
    response = run.configurations[at].response
    heads = ["hz"]
    columns = [response.frequency_hz]
    for label, H in (("full", response.full), *((model, response.reduced[model]) for model in models)):
        for o, output in enumerate(run.outputs):
            for i, given in enumerate(run.inputs):
                heads += [f"{label} {given} > {output} {part}" for part in ("re", "im")]
                columns += [H[:, o, i].real, H[:, o, i].imag]
    return CsvTable(name, tuple(heads), [tuple(row) for row in np.column_stack(columns).tolist()])


def _known(value: float) -> float | None:
    return None if math.isnan(value) else float(value)
