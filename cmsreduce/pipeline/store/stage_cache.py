"""Finished stages of run directories and sweeps: list them, clear them, and lock a run directory.

Two runs never work in one directory at a time: they would write results of different settings side by side.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cmsreduce.errors import ReadError
from cmsreduce.pipeline.store.stage_store import STAGES_FOLDER, is_stage
from cmsreduce.write import atomic_path

__all__ = [
    "ORIGIN",
    "CacheEntry",
    "cache_entries",
    "clear_cache",
    "read_origin",
    "sole_use",
    "write_origin",
]

_KEY_SHOWN = 12
# Pipeline and overrides of a run directory, so that its report can be written again.
ORIGIN = f"{STAGES_FOLDER}/origin.json"
# Names of locks, of files that were not finished, and of shapes on disk.
_LEFT = re.compile(r"\..+\.h5\.lock|\..+\.[0-9a-f]{8}-\d+-[0-9a-f]+\.tmp|\.basis-\d+-[0-9a-f]+\.tmp")


@dataclass(frozen=True)
class CacheEntry:
    """One finished stage.

    Parameters
    ----------
    path : Path
    what, stage : str
        Such as ``rotor`` and ``reduce``.
    key : str
        First digits of its content key; empty if the file cannot be read.
    size : int
        In bytes.
    made : float
        Seconds since the epoch.
    """

    path: Path
    what: str
    stage: str
    key: str
    size: int
    made: float


def cache_entries(folder: Path) -> list[CacheEntry]:
    """Finished stages of a run directory, or of a sweep and all its points.

    Raises
    ------
    ReadError
        If the folder is neither.
    """
    found = []
    for path in _files(folder):
        if path.suffix != ".h5" or path.name.startswith("."):
            continue
        # WHAT.STAGE.h5, or WHAT.STAGE.KEY.h5 where it is shared.
        key, status = _key(path), path.stat()
        words = path.name.removesuffix(".h5").split(".")
        if len(words) > 2 and key.startswith(words[-1][:_KEY_SHOWN]):
            words = words[:-1]
        found.append(CacheEntry(path, ".".join(words[:-1]), words[-1], key, status.st_size, status.st_mtime))
    return found


def clear_cache(folder: Path) -> tuple[int, int, list[Path]]:
    """Remove finished stages, and parts that killed runs left of others; the results of the runs stay.

    Returns
    -------
    count, size : int
        Number of files removed, and their bytes.
    kept : list of Path
        Files that have the name of a stage, but that no run wrote, or that are damaged; they stay.

    Raises
    ------
    ReadError
        If the folder is no run directory and no sweep.
    """
    count = size = 0
    kept = []
    for path in _files(folder):
        if path.suffix == ".h5" and not is_stage(path):
            kept.append(path)
        elif path.suffix == ".h5" or _LEFT.fullmatch(path.name):
            size += path.stat().st_size
            count += 1
            path.unlink(missing_ok=True)
    return count, size, kept


def write_origin(folder: Path, pipeline: Path, overrides: Sequence[str]) -> None:
    """Write the pipeline and the overrides that a run directory is from."""
    origin = json.dumps({"pipeline": str(pipeline.resolve()), "overrides": list(overrides)}, indent=2)
    with atomic_path(folder / ORIGIN) as temporary:
        temporary.write_text(origin, encoding="utf-8")


def read_origin(folder: Path) -> dict[str, Any]:
    """Pipeline and overrides of a run directory: the keys ``pipeline`` and ``overrides``.

    Raises
    ------
    ReadError
        If the folder is no run directory, or the file is damaged.
    """
    path = folder / ORIGIN
    if not path.is_file():
        raise ReadError(
            f"{folder}: this is no run directory ({ORIGIN} is missing); give the `output:` of a finished run"
        )
    try:
        facts = json.loads(path.read_bytes())
        whole = (
            isinstance(facts["pipeline"], str)
            and "\0" not in facts["pipeline"]
            and all(isinstance(each, str) for each in facts["overrides"])
        )
    except (ValueError, KeyError, TypeError, RecursionError):
        whole = False
    if not whole:
        raise ReadError(
            f"{path}: the record of the pipeline that this run is from is damaged; run the pipeline again with this "
            "folder, which writes the record anew and reuses the finished stages"
        )
    return dict(facts)


def _files(folder: Path) -> Iterator[Path]:
    if (folder / ORIGIN).is_file():
        # A damaged folder is not listed or cleared as if it were whole.
        read_origin(folder)
    own = folder / STAGES_FOLDER
    points = sorted(folder.glob(f"points/*/{STAGES_FOLDER}"))
    if not own.is_dir() and not points:
        raise ReadError(f"{folder}: there are no finished stages; give the folder of a run or of a sweep")
    for stages in (own, *points):
        if stages.is_dir():
            yield from sorted(path for path in stages.iterdir() if path.is_file())


def _key(path: Path) -> str:
    import h5py

    try:
        with h5py.File(path, "r") as file:
            return str(file.attrs["key"])[:_KEY_SHOWN]
    except (OSError, KeyError, RuntimeError, ValueError):
        return ""


@contextmanager
def sole_use(folder: Path, say: Callable[[str], None]) -> Iterator[None]:
    """Keep other runs out of a folder while the block lasts; wait for a run that is in it.

    The folder itself is locked, so that no lock file is left in it. The operating system ends the lock when the process
    ends.

    Parameters
    ----------
    folder : Path
        Made if it is not there.
    say : callable
        Called with a message if there is a run to wait for.
    """
    try:
        import fcntl
    except ImportError:
        # Without locks each file is still complete.
        yield
        return
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle = os.open(folder, os.O_RDONLY)
    except OSError:
        # The first file that is written there fails with a message.
        yield
        return
    try:
        try:
            fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            say(f"another run is at work in {folder}; this one goes on when that ends (or give it another --out)")
            fcntl.flock(handle, fcntl.LOCK_EX)
        except OSError:
            # Some shared disks cannot lock folders.
            pass
        yield
    finally:
        os.close(handle)
