"""A sweep of five points made by hand, one of which failed."""

from __future__ import annotations

from cmsreduce.model import SweepResult, SweepRow
from cmsreduce.model.results.sweep import SweepStatus

__all__ = ["HOSTILE", "made_sweep"]

HOSTILE = "</script><b>$x_1$ & more"


def made_sweep(name: str = "study") -> SweepResult:
    """Two methods, of which one is called so that markup in a value would show."""
    figures: list[tuple[str, str, SweepStatus, int, float, float, float]] = [
        ("craig-bampton", "1.5", "limit broken", 10, 0.1, 1.0, 0.02),
        ("craig-bampton", "2", "limit broken", 12, 0.1, 2.0, 0.03),
        ("craig-bampton", "4", "passed", 20, 0.001, 3.0, 0.04),
        (HOSTILE, "1.5", "limit broken", 20, 0.2, 0.5, 0.01),
    ]
    rows = [
        SweepRow(
            point=number,
            folder=f"points/{number}",
            overrides={"reduce.method": method, "reduce.cutoff": cutoff},
            status=status,
            kept_modes=size - 6,
            basis_size=size,
            n_reduced=size,
            n_full=100,
            frf_error=error,
            db_error=10 * error,
            frequency_error=error / 100,
            damping_error=error / 10,
            reduce_s=seconds,
            full_frf_s=1.0,
            reduced_frf_s=response,
            steps_per_second=100.0 * size,
            operations=1e4 * size**2,
            simulation_s=seconds,
            simulation_noise=0.1,
            point_s=1.0,
        )
        for number, (method, cutoff, status, size, error, seconds, response) in enumerate(figures, 1)
    ]
    rows.append(
        SweepRow(5, "points/5", {"reduce.method": HOSTILE, "reduce.cutoff": "2"}, "failed", "no such method, says, 1")
    )
    axes = {"reduce.method": ("craig-bampton", HOSTILE), "reduce.cutoff": ("1.5", "2", "4")}
    return SweepResult(name, axes, tuple(rows), 12.5, {"program": "cmsreduce 0", "jobs": 2})
