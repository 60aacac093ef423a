"""Arrays that a library reads from a file; those of the last files are held."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.read.files import HEADERS, reading, sha256_of
from cmsreduce.read.formats import CELL_CORNERS, Cells

__all__ = ["Arrays", "arrays_of", "cells_of"]

Arrays = dict[str, NDArray[np.generic]]
"""Arrays that a library read from a file, by name."""

_PROGRAM = Path(__file__).with_name("program.py")
# Of the process: the start, and for each byte of the file. Slow formats are read at a million bytes a second, and a
# number of two printed characters becomes a Python object of 32 bytes in a list. Seconds are those of a processor:
# other work on the machine does not count.
_SECONDS, _SECONDS_A_BYTE = 5.0, 1e-6
_WAITING = 6.0  # on the clock, times those of a processor
_BYTES, _BYTES_A_BYTE = 3 << 29, 60
# Signals that end a process at the limit of its time: SIGKILL and SIGXCPU.
_STOPPED = (9, 24)
# Characters of a library's complaint that are shown.
_LONGEST_REASON = 300
# A run asks for one file several times, and a process that loads the library takes longer than a small run: the arrays
# of the last files are held, unless they are large. Other meshes may have their arrays in files beside them, as a
# distributed result of ANSYS has: job1.rst beside job0.rst.
_HELD: dict[tuple[str, Path, str], Arrays] = {}
_FILES_HELD, _BYTES_HELD = 4, 1 << 26
_ONE_FILE = (".mdpa", ".mesh", ".meshb", ".msh", ".vtk", ".vtu")


def arrays_of(path: Path, kind: str, refused: Callable[[str], ReadError]) -> Arrays:
    """Arrays of a file, read by a library.

    Parameters
    ----------
    path : Path
        The file.
    kind : str
        Reader of ``program.py``: ``mesh``, ``med``, ``universal``, ``ansys-nodes`` or ``ansys-full``.
    refused : callable
        Error for the reason that the library gives.

    Returns
    -------
    dict of name to array
        Not to be written to.

    Raises
    ------
    ReadError
        The one of ``refused`` if the library fails, or exceeds the limits.
    """
    several = (
        path.suffix.lower() not in _ONE_FILE if kind == "mesh" else kind == "ansys-nodes" and path.stem[-1:] == "0"
    )
    if several:
        return _read(path, kind, refused)
    key = kind, path.absolute(), sha256_of(path)
    found = _HELD.pop(key, None)
    if found is None:
        found = _read(path, kind, refused)
        if sum(array.nbytes for array in found.values()) > _BYTES_HELD or sha256_of(path) != key[2]:
            return found
        for array in found.values():
            array.flags.writeable = False
    _HELD[key] = found
    for oldest in list(_HELD)[:-_FILES_HELD]:
        _HELD.pop(oldest, None)
    return dict(found)


def _read(path: Path, kind: str, refused: Callable[[str], ReadError]) -> Arrays:
    """Arrays of a file, from a process of their own."""
    size = path.stat().st_size
    seconds = _SECONDS + _SECONDS_A_BYTE * size
    with tempfile.TemporaryDirectory(prefix="cmsreduce-read-") as folder:
        arrays = Path(folder) / "arrays.npz"
        # -P keeps the program's own folder out of the import path: its files have names of libraries.
        command = [sys.executable, "-P", str(_PROGRAM), kind, str(path), str(arrays)]
        command += [str(int(_BYTES + _BYTES_A_BYTE * size)), str(int(seconds))]
        try:
            done = subprocess.run(command, capture_output=True, timeout=_WAITING * seconds, check=False)
        except subprocess.TimeoutExpired:
            raise refused(
                f"Reading it was stopped after {_WAITING * seconds:.0f} s, in which the machine gave it less than "
                f"{seconds:.0f} s of a processor: run again when it is less busy"
            ) from None
        if -done.returncode in _STOPPED:
            raise refused(f"Reading it was stopped after {seconds:.0f} s: it is damaged")
        if done.returncode < 0:
            raise refused(f"The library crashed (signal {-done.returncode}): it is damaged")
        if done.returncode or not arrays.is_file():
            said = " ".join((done.stdout + b" " + done.stderr).decode(errors="replace").split())
            raise refused(said[:_LONGEST_REASON])
        with reading(path, "what the library read"), HEADERS, np.load(arrays, allow_pickle=False) as loaded:
            return {name: loaded[name] for name in loaded.files}


def cells_of(path: Path, arrays: Arrays) -> Cells:
    """Elements of the arrays of a library, which are named by a number and the kind of cell, such as ``0 tetra10``.

    Raises
    ------
    ReadError
        If the numbers of nodes are no integers, or do not fit one of 64 bits.
    """
    found: dict[str, list[NDArray[np.int64]]] = {}
    for name, nodes in arrays.items():
        kind = next((kind for kind in CELL_CORNERS if name.partition(" ")[2].startswith(kind)), None)
        if kind is None or kind == "vertex" or nodes.ndim != 2 or nodes.shape[1] < CELL_CORNERS[kind]:
            continue
        corners = nodes[:, : CELL_CORNERS[kind]]
        # A damaged number may be the largest of an unsigned type.
        if corners.dtype.kind not in "iu" or int(corners.max(initial=0)) > np.iinfo(np.int64).max:
            raise ReadError(f"{path}: a {kind} names its points by numbers that are no indices; write the mesh again")
        found.setdefault(kind, []).append(corners.astype(np.int64))
    return {kind: np.vstack(parts) for kind, parts in found.items()}
