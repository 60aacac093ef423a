"""Mass properties of one body by its consistent mass and by its lumped ones, and how far these are apart."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.mechanics import rigid_mass
from cmsreduce.model import LUMPINGS, Check, FEModel, Finding
from cmsreduce.verify import mass_change, rigid_mass_properties
from cmsreduce.write import ComponentFile

__all__ = ["body_totals", "file_totals", "total_data", "total_findings", "total_lines"]

Totals = Mapping[str, NDArray[np.float64]]
"""R^T M R (6, 6) about the basic origin, by the mass it is of; the consistent one first."""

_STORED = {
    "consistent": "integrals/rigid_mass",
    "row-sum": "integrals/rigid_mass_row_sum",
    "diagonal": "integrals/rigid_mass_diagonal",
}
# A coordinate below this share of the largest is rounding.
_ZERO = 1e-12


def body_totals(body: FEModel) -> Totals:
    """Of a body with geometry; nothing of one without, or without mass."""
    if body.nodes is None or not body.M.nnz:
        return {}
    return {lumping: rigid_mass(body, lumping=lumping) for lumping in LUMPINGS}


def file_totals(file: ComponentFile) -> Totals:
    """Of a component file; nothing of files that were written before they held them."""
    if any(path not in file.arrays for path in _STORED.values()):
        return {}
    return {lumping: file.arrays[path] for lumping, path in _STORED.items()}


def total_lines(totals: Totals) -> Iterator[str]:
    """State each total, and how far the lumped ones are from the consistent one."""
    for lumping, rigid in totals.items():
        found = rigid_mass_properties(rigid)
        apart = ""
        if lumping != "consistent":
            change = mass_change(totals["consistent"], rigid)
            apart = "; off by " + ", ".join(f"{what} {value:.2e}" for what, value in change.items())
        inertia = _numbers(found.inertia.diagonal())
        yield (
            f"{lumping} mass {found.mass.max(initial=0.0):.9g}, centre of mass {_numbers(found.cg)}, inertia about it "
            f"{inertia}{apart}"
        )


def total_data(totals: Totals) -> dict[str, Any]:
    """Mass, centre of mass and inertia about it by each mass, as plain values."""
    found = {lumping: rigid_mass_properties(rigid) for lumping, rigid in totals.items()}
    return {
        lumping: {
            "mass": float(part.mass.max(initial=0.0)),
            "centre_of_mass": part.cg.tolist(),
            "inertia": part.inertia.tolist(),
        }
        for lumping, part in found.items()
    }


def total_findings(name: str, totals: Totals) -> Iterator[Finding]:
    """How far the lumped inertias are from the consistent one; figures without a limit."""
    for lumping, rigid in totals.items():
        if lumping == "consistent":
            continue
        change = mass_change(totals["consistent"], rigid)
        note = ", ".join(f"{what} {value:.2e} off" for what, value in change.items() if what != "inertia")
        check = Check(f"inertia of the {lumping} mass against the consistent one", change["inertia"], float("inf"))
        yield Finding(name, check, note)


def _numbers(values: NDArray[np.float64]) -> str:
    size = float(abs(values).max(initial=0.0))
    return " ".join(f"{0.0 if abs(x) < _ZERO * size else x:.6g}" for x in values)
