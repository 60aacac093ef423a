"""The finished stages of run directories and sweeps: what is there, and how to be rid of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from cmsreduce.errors import ReadError
from cmsreduce.pipeline.stage_store import STAGES_FOLDER

__all__ = ["CacheEntry", "cache_entries", "clear_cache"]

_KEY_SHOWN = 12


@dataclass(frozen=True)
class CacheEntry:
    """One finished stage.

    Parameters
    ----------
    path : Path
    what, stage : str
        Such as ``rotor`` and ``reduce``.
    key : str
        First digits of the hash of all it was made from; empty where the file cannot be read.
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


def clear_cache(folder: Path) -> tuple[int, int]:
    """Remove finished stages, and what killed runs left of others; results beside them stay.

    Returns
    -------
    count, size : int
        Files removed, and their bytes.

    Raises
    ------
    ReadError
        If the folder is no run directory and no sweep.
    """
    count = size = 0
    for path in _files(folder):
        if path.suffix in (".h5", ".lock", ".tmp"):
            size += path.stat().st_size
            count += 1
            path.unlink(missing_ok=True)
    return count, size


def _files(folder: Path) -> Iterator[Path]:
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
