"""Arguments of `read_body`: matrices, rows, interfaces and damping in memory, as the reader of files takes them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from numbers import Integral
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.config import Component, parse_ratio, pipeline_from_keys
from cmsreduce.errors import ConfigError, DampingError
from cmsreduce.model import Damping, FEModel, Units
from cmsreduce.pipeline.bodies import interface_specs, tied_body
from cmsreduce.read import InterfaceSpec, MatrixSource, prove_row_order

__all__ = [
    "FaceLike",
    "Faces",
    "MatrixLike",
    "RowsLike",
    "faces_in_memory",
    "law_in_memory",
    "matrix_in_memory",
    "rows_in_memory",
]

MatrixLike = str | Path | tuple[str | Path, str] | MatrixSource | NDArray[np.float64] | sp.sparray | sp.spmatrix
RowsLike = str | Path | Sequence[str] | Sequence[tuple[int, int]] | NDArray[np.integer]
FaceLike = int | Sequence[int] | NDArray[np.integer] | Mapping[str, Any] | InterfaceSpec

_MOTIONS = 6  # of a body that is free in all directions


@dataclass(frozen=True)
class Faces:
    """Interfaces of a body.

    Parameters
    ----------
    specs : dict of name to InterfaceSpec
        As the reader takes them.
    keys : Component, optional
        Keys of those that are given as mappings.
    """

    specs: dict[str, InterfaceSpec]
    keys: Component | None = None

    def tied(self, body: FEModel) -> FEModel:
        """The body with its ties."""
        if self.keys is None:
            return body
        proof = prove_row_order(body)
        return tied_body(body, self.keys, proof.status == "proven" and proof.motions == _MOTIONS)


def faces_in_memory(body: str, given: Mapping[str, FaceLike], units: Units) -> Faces:
    """Interfaces from node ids, mappings of keys, or specs.

    Raises
    ------
    ConfigError
        If one is something else, or a key is wrong.
    """
    keys = {label: dict(face) for label, face in given.items() if isinstance(face, Mapping)}
    if not keys:
        return Faces({label: _of_nodes(label, face) for label, face in given.items()})
    files = {role: {"file": "memory"} for role in ("stiffness", "mass")}
    # The grammar asks for a band, which decides nothing here.
    scene = {"band": "1 Hz", "units": units.name}
    pipeline = {"name": "read_body", "components": {body: {**files, "interfaces": keys}}, "scene": scene}
    part = pipeline_from_keys(pipeline, "read_body").components[body]
    stated = interface_specs(body, part, units)
    return Faces({label: stated.get(label) or _of_nodes(label, face) for label, face in given.items()}, part)


def _of_nodes(label: str, face: Any) -> InterfaceSpec:
    if isinstance(face, InterfaceSpec):
        return face
    ids = face if isinstance(face, (Sequence, np.ndarray)) and not isinstance(face, str) else [face]
    if np.ndim(ids) != 1 or not all(isinstance(node, Integral) for node in ids):
        raise ConfigError(
            f"read_body: interface '{label}' is a node, nodes, or a mapping such as "
            f"{{'near': [x, y, z], 'within': 0.01}}, found {face!r:.60}"
        )
    return InterfaceSpec(tuple(int(node) for node in ids))


def rows_in_memory(rows: RowsLike | None, folder: Path) -> str | Path | None:
    """File or set of the rows; those in memory are written to a file.

    Raises
    ------
    ConfigError
        If they are neither texts nor pairs of node and component.
    """
    if rows is None or isinstance(rows, (str, Path)):
        return rows
    lines = [row if isinstance(row, str) else ".".join(map(str, row)) if np.shape(row) == (2,) else "" for row in rows]
    if not all(lines):
        raise ConfigError(
            f"read_body: row {lines.index('') + 1} is {rows[lines.index('')]!r:.60}; write a text such as '12.3', or a "
            "pair of node and component, (12, 3)"
        )
    listed = folder / "rows.txt"
    listed.write_text("\n".join(lines), encoding="utf-8")
    return listed


def law_in_memory(damping: float | str | Damping | None) -> Damping | None:
    """Law of a body from one ratio of all its modes; another law stays as it is.

    Raises
    ------
    DampingError
        If it is no ratio.
    """
    if damping is None or isinstance(damping, Damping):
        return damping
    ratio = parse_ratio(damping)
    if not isinstance(ratio, (int, float)):
        raise DampingError(f"damping '{damping}' is not a ratio, such as 0.005 or '0.5 %'")
    return Damping(modal=ratio)


def matrix_in_memory(role: str, matrix: MatrixLike, folder: Path) -> MatrixSource:
    """File of a matrix; a matrix in memory is written to a temporary file, which is read as any other.

    Raises
    ------
    ConfigError
        If it is no array of numbers with two dimensions.
    """
    if isinstance(matrix, MatrixSource):
        return matrix
    if isinstance(matrix, (str, Path)):
        return MatrixSource(Path(matrix))
    if isinstance(matrix, tuple):
        return MatrixSource(Path(matrix[0]), matrix[1])
    array: Any = matrix if sp.issparse(matrix) else np.asarray(matrix)
    if array.ndim != 2 or array.dtype.kind not in "fiuc":
        lumped = "; write a lumped one as scipy.sparse.diags_array(masses)" if array.ndim == 1 else ""
        raise ConfigError(
            f"read_body: {role} is the name of a file, (file, matrix), or an array of numbers with two dimensions, "
            f"found {type(matrix).__name__} of {array.ndim} dimensions and type {array.dtype}{lumped}"
        )
    path = folder / f"{role}.npz"
    sp.save_npz(path, sp.csc_array(array), compressed=False)
    return MatrixSource(path)
