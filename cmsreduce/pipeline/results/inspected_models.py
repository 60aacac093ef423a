"""The content of files that hold a whole model in a few coordinates: system.h5, and bodies that others reduced."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.errors import ReadError
from cmsreduce.model import SI, System
from cmsreduce.pipeline.bodies import reduced_body
from cmsreduce.read import FileKind
from cmsreduce.report import InspectedLine
from cmsreduce.write import read_system, verify_seal

__all__ = ["inspected_body", "inspected_system"]

# Frequencies of each configuration.
_NAMED = 4
# Relative to the mean of K over M: small beside elastic motions, large beside the rounding of rigid ones.
_SHIFT = 1e-9


def inspected_system(path: Path) -> tuple[list[InspectedLine], dict[str, Any]]:
    """Lines and values of a system file: bodies, channels, and the lowest frequencies of each configuration.

    Raises
    ------
    ReadError
        If the file is damaged, or was changed after it was written.
    """
    sealed, file = verify_seal(path), read_system(path)
    said = [
        f"assembled reduced system of '{file.name}', {len(file.systems)} configurations",
        "sealed" if sealed else "not sealed: it was written by an earlier version",
    ]
    first = file.systems[0]
    rows = [
        *map(InspectedLine, said),
        InspectedLine("unknown" if file.units is None else file.units.name, "units"),
        InspectedLine(", ".join(f"{name} ({size})" for name, size in first.sizes.items()), "coordinates of bodies"),
    ]
    quantities = dict(zip(("inputs", "outputs"), file.quantities, strict=True))
    for label, names in (("inputs", first.inputs), ("outputs", first.outputs)):
        said = [f"{name} ({what})" if what else name for name, what in zip(names, quantities[label], strict=True)]
        rows.append(InspectedLine(", ".join(said) or "none", label))
    lowest = {}
    for system in file.systems:
        hz = _lowest_hz(system)
        lowest[system.configuration.name] = hz
        words = ", ".join(f"{value:.6g}" for value in hz) or "none"
        rigid = f"{system.rigid.shape[1]} rigid motions, {system.K.shape[0]} coordinates"
        rows.append(InspectedLine(f"{rigid}; lowest elastic frequencies {words} Hz", system.configuration.name))
    data = {
        "kind": "system",
        "name": file.name,
        "sealed": sealed,
        "units": None if file.units is None else file.units.name,
        "sizes": dict(first.sizes),
        "inputs": list(first.inputs),
        "outputs": list(first.outputs),
        "frequencies_hz": lowest,
    }
    return rows, data


def _lowest_hz(system: System) -> list[float]:
    """A few elastic frequencies of a reduced system, whose coordinates may be without mass."""
    K, M = (np.asarray(A.toarray() if sp.issparse(A) else A) for A in (system.K, system.M))
    if not K.size:
        return []
    # Rigid motions have no stiffness: shifted, they are the heaviest of all.
    shift = float(np.trace(K) / max(np.trace(M), np.finfo(float).tiny)) * _SHIFT
    share = la.eigvalsh(M, K + shift * M)[::-1][system.rigid.shape[1] :][:_NAMED]
    return [float(np.sqrt(max(1 / each - shift, 0.0)) / (2 * np.pi)) for each in share if each > 0]


def inspected_body(kind: FileKind, path: Path) -> tuple[list[InspectedLine], dict[str, Any]]:
    """Lines and values of a body that another program holds in its modes.

    Raises
    ------
    ReadError
        If the file is damaged, or no body has its mass.
    """
    modal = reduced_body("body", path, SI)
    try:
        elastic = la.eigvalsh(modal.K, modal.M)[int((~modal.K.any(axis=0)).sum()) :]
    except la.LinAlgError as error:
        raise ReadError(
            f"{path}: its mass matrix is not positive definite: the modal mass, the momentum of the modes and the mass "
            "of the body contradict each other; write the file again"
        ) from error
    hz = np.sqrt(np.maximum(elastic, 0.0)) / (2 * np.pi)
    rigid, mass = modal.K.shape[0] - hz.size, float(modal.M[0, 0])
    whole = "given" if modal.second_order is not None else "not in the file, or not of the same modes"
    low, high = (" ".join(f"{x:g}" for x in corner) for corner in (modal.nodes.xyz.min(0), modal.nodes.xyz.max(0)))
    rows = [
        InspectedLine(kind.words),
        InspectedLine(f"{len(modal.nodes)} nodes, from {low}  to {high}"),
        InspectedLine(
            f"{rigid} rigid motions and {hz.size} modes; free frequencies from {hz[0]:.6g} to {hz[-1]:.6g} Hz"
        ),
        InspectedLine(f"{mass:.9g}", "mass"),
        InspectedLine(whole, "integrals of second order"),
        InspectedLine(kind.step, "next"),
    ]
    data = {"kind": "reduced", "format": kind.name, "nodes": len(modal.nodes), "mass": mass}
    return rows, {**data, "frequencies_hz": hz.tolist(), "second_order": modal.second_order is not None}
