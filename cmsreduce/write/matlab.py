"""MATLAB files of state-space models: MAT 5, which MATLAB, Octave and scipy read."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import WriteError
from cmsreduce.write.atomic import atomic_path

__all__ = ["StateSpace", "write_matlab"]

# Fixed text in place of the date that scipy writes, so that equal input gives equal bytes.
_HEADER = b"MATLAB 5.0 MAT-file, written by cmsreduce".ljust(116)
# A MAT 5 file counts its bytes in 32 bits.
_LARGEST = 2**31

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class StateSpace:
    """x' = A x + B u, y = C x + D u, with names.

    Parameters
    ----------
    A, B, C, D : float64
        The model.
    inputs, outputs : sequence of str
        Names of the channels.
    facts : mapping
        What else is known of it: arrays, texts, lists of texts.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    inputs: Sequence[str]
    outputs: Sequence[str]
    facts: Mapping[str, Any] = field(default_factory=dict)

    def variables(self) -> dict[str, Any]:
        """The model as MATLAB variables."""
        own = {"A": self.A, "B": self.B, "C": self.C, "D": self.D}
        return {**own, "inputs": list(self.inputs), "outputs": list(self.outputs), **self.facts}


def write_matlab(path: Path, variables: Mapping[str, Any]) -> None:
    """Write a MAT 5 file.

    Parameters
    ----------
    path : Path
        Where; the file is whole or not there.
    variables : mapping
        Arrays, numbers, texts; a list of texts becomes a cell array, a mapping a structure, a list of mappings a cell
        array of structures.

    Raises
    ------
    WriteError
        If the file cannot be written, or is too large for the format.
    """
    from scipy.io import savemat

    image = io.BytesIO()
    values = {name: _value(value) for name, value in variables.items()}
    savemat(image, values, do_compression=True, oned_as="column")  # type: ignore[arg-type]
    content = _HEADER + image.getvalue()[len(_HEADER) :]
    if len(content) >= _LARGEST:
        raise WriteError(f"{path}: {len(content) / 2**30:.1f} GiB are more than a MAT 5 file holds; keep fewer modes")
    with atomic_path(path) as temporary:
        temporary.write_bytes(content)


def _value(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _value(part) for name, part in value.items()}
    if isinstance(value, (list, tuple)):
        cells = np.empty((len(value), 1), dtype=object)
        for place, part in enumerate(value):
            cells[place, 0] = _value(part)
        return cells
    return value
