"""Files that a run may replace: those that this program wrote, and no file that the run reads."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path

from cmsreduce.errors import WriteError

__all__ = ["refuse_foreign"]

_GENERATOR = b'name="generator" content="cmsreduce'
# Pages of versions before the mark.
_EARLY_PAGE = b"script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"
_PAGE_HEAD = 1 << 20
# Folders that only a run or a sweep makes.
_RUN_FOLDERS = ("stages", "points")
_SUMMARY_KEYS = {"name", "components"}
_REMEDY = "choose another `output:` (or --out), or move the file away"


def refuse_foreign(outputs: Iterable[Path], inputs: Sequence[Path] = ()) -> None:
    """Refuse to replace files that this program did not write, before anything is computed.

    An HDF5 file, a summary or a page is known by its mark; files of other formats have none, and are known by the
    folder or the one above: it must be that of an earlier run.

    Parameters
    ----------
    outputs : iterable of Path
        Files that will be written; most do not exist yet.
    inputs : sequence of Path
        Files that are read.

    Raises
    ------
    WriteError
        For the first file that is foreign or an input.
    """
    given = {path.resolve() for path in inputs if path.exists()}
    for path in outputs:
        if not path.exists():
            continue
        if path.resolve() in given:
            raise WriteError(f"{path}: this file is read by the run and would be replaced by its result; {_REMEDY}")
        if not _is_own(path):
            raise WriteError(f"{path}: a file of this name is there that cmsreduce did not write; {_REMEDY}")


def _is_own(path: Path) -> bool:
    if not path.is_file():
        return False
    if path.suffix == ".h5" and (kind := _hdf5_format(path)) is not None:
        return kind.startswith("cmsreduce")
    try:
        if path.suffix == ".json":
            facts = json.loads(path.read_text(encoding="utf-8"))
            return isinstance(facts, dict) and facts.keys() >= _SUMMARY_KEYS
        if path.suffix == ".html":
            with path.open("rb") as file:
                head = file.read(_PAGE_HEAD)
            return _GENERATOR in head or _EARLY_PAGE in head
    except (OSError, ValueError, RecursionError):
        return False
    # A program's files lie in a folder of their own in the run directory.
    return any((folder / name).is_dir() for folder in path.parents[:2] for name in _RUN_FOLDERS)


def _hdf5_format(path: Path) -> str | None:
    """Format that an HDF5 file names; None for files of other programs' layouts, which have no mark of ours."""
    import h5py

    if path.name.endswith(".mbsim.h5"):
        return None
    try:
        with h5py.File(path, "r") as file:
            return str(file.attrs.get("format", ""))
    except (OSError, KeyError, RuntimeError, ValueError, TypeError):
        return ""
