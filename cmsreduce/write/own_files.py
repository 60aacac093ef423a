"""Files that a run may replace: those that this program wrote, and no file that the run reads."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Sequence
from pathlib import Path

from cmsreduce.errors import ReadError, WriteError, refuse_unreadable
from cmsreduce.write.files import atomic_path

__all__ = ["LOG_MARK", "is_result", "record_outputs", "refuse_changed", "refuse_foreign", "refuse_shared_names"]

LOG_MARK = "log of cmsreduce: tracebacks of what failed alone\n"
"""First line of the log of failures."""

_GENERATOR = b'name="generator" content="cmsreduce'
# Pages of versions before the mark.
_EARLY_PAGE = b"script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:"
_PAGE_HEAD = 1 << 20
# Folders that only a run or a sweep makes.
_RUN_FOLDERS = ("stages", "points")
# A pipeline may be JSON, too, and has the first two.
_SUMMARY_KEYS = {"name", "components", "configurations", "worst"}
# The files that runs wrote into a folder; those of the last run with their digests, or that they have a seal.
_RECORD = f"{_RUN_FOLDERS[0]}/written.json"
_SEALED = "sealed"
_REMEDY = "choose another `output:` (or --out), or move the file away"


def refuse_foreign(outputs: Iterable[Path], inputs: Sequence[Path] = ()) -> None:
    """Refuse to replace files that this program did not write, before anything is computed.

    An HDF5 file, a summary, a page or a log is known by its mark; files of other formats have none, and are known by
    the record of the run directory, which is their folder or the one above.

    Parameters
    ----------
    outputs : iterable of Path
        Files that will be written; most do not exist yet.
    inputs : sequence of Path
        Files that are read.

    Raises
    ------
    WriteError
        For the first file that is foreign, an input, or in a folder that this user may not write in.
    ReadError
        For a file that cannot be read, and may be either.
    """
    given = {path.resolve() for path in inputs if path.exists()}
    for path in outputs:
        if path.parent.is_dir() and not os.access(path.parent, os.W_OK):
            raise WriteError(f"{path}: you have no permission to write in this folder; {_REMEDY}")
        if not path.exists():
            continue
        if path.resolve() in given:
            raise WriteError(f"{path}: this file is read by the run and would be replaced by its result; {_REMEDY}")
        refuse_unreadable(path)
        if not _is_own(path):
            raise WriteError(f"{path}: a file of this name is there that cmsreduce did not write; {_REMEDY}")


def refuse_shared_names(outputs: Sequence[Path]) -> None:
    """Refuse a run of which two results would be one file, such as that of a component and of the system.

    The disks of macOS and Windows do not tell capitals apart, and results are taken there.

    Raises
    ------
    WriteError
        For the first name that two of the files have.
    """
    seen: dict[str, Path] = {}
    for path in outputs:
        other = seen.setdefault(str(path).casefold(), path)
        if other is path:
            continue
        alike = "" if other == path else f" ({other.name} is another one on some disks only)"
        raise WriteError(
            f"{path}: two results of this run would have this name{alike}, and the second would replace the first; "
            "give the component another name, or leave one of the formats out"
        )


def record_outputs(folder: Path, outputs: Iterable[Path], written: Iterable[Path] = ()) -> Path:
    """Add files of a run to the record of its folder, by which the next run knows them.

    Parameters
    ----------
    folder : Path
        Run directory.
    outputs : iterable of Path
        Files that the run is about to write, or has written.
    written : iterable of Path
        Those of them that are complete; `refuse_changed` looks at them.

    Returns
    -------
    Path
        The record.

    Raises
    ------
    WriteError
        If the record cannot be written.
    """
    found: dict[str, str] = dict.fromkeys(
        [*(_recorded(folder) or {}), *(_within(folder, path) for path in outputs)], ""
    )
    # A seal of its own tells whether a result is as it was written, but not whether it is there.
    found |= {
        _within(folder, path): _SEALED if is_result(path) else _digest(path) for path in written if path.is_file()
    }
    record = folder / _RECORD
    with atomic_path(record) as temporary:
        temporary.write_text(json.dumps(found, indent=1, sort_keys=True), encoding="utf-8")
    return record


def refuse_changed(folder: Path) -> None:
    """Refuse a run directory in which a file is gone, or one of another program is not as its last run wrote it.

    Raises
    ------
    ReadError
        For the first file that is gone, changed or damaged.
    """
    for name, digest in (_recorded(folder) or {}).items():
        if not digest:
            continue
        if not (path := folder / name).is_file():
            raise ReadError(f"{path}: the run wrote this file, and it is gone; write it again with `cmsreduce run`")
        refuse_unreadable(path)
        if digest != _SEALED and _digest(path) != digest:
            raise ReadError(
                f"{path}: the file is damaged, or was changed after the run wrote it; write it again with "
                "`cmsreduce run`"
            )


def _within(folder: Path, path: Path) -> str:
    return path.relative_to(folder).as_posix()


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _recorded(folder: Path) -> dict[str, str] | None:
    """Files of a folder that runs wrote, with their digests; None where early versions, without a record, made it."""
    try:
        found = json.loads((folder / _RECORD).read_bytes())
    except FileNotFoundError:
        return None
    except (OSError, ValueError, RecursionError):
        return {}
    # A list of names has no digests.
    pairs = (
        found.items() if isinstance(found, dict) else [(name, "") for name in found] if isinstance(found, list) else []
    )
    return {str(name): str(digest) for name, digest in pairs}


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
        if path.suffix == ".log":
            with path.open("rb") as file:
                if file.read(len(LOG_MARK)) == LOG_MARK.encode():
                    return True
    except (OSError, ValueError, RecursionError):
        return False
    # A program's files lie in a folder of their own in the run directory.
    for folder in path.parents[:2]:
        if any((folder / name).is_dir() for name in _RUN_FOLDERS):
            recorded = _recorded(folder)
            return recorded is None or _within(folder, path) in recorded
    return False


def is_result(path: Path) -> bool:
    """True for a component file or system.h5 of a run."""
    return path.suffix == ".h5" and _stated_format(path) in ("cmsreduce-component", "cmsreduce-system")


def _hdf5_format(path: Path) -> str | None:
    """Format that an HDF5 file names; None for files of other programs' layouts, which have no mark of ours."""
    return None if path.name.endswith(".mbsim.h5") else _stated_format(path)


def _stated_format(path: Path) -> str:
    import h5py

    try:
        with h5py.File(path, "r") as file:
            return str(file.attrs.get("format", ""))
    except (OSError, KeyError, RuntimeError, ValueError, TypeError):
        return ""
