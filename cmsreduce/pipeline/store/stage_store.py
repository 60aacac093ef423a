"""Finished stages on disk: each file holds its content key, a hash of code, settings and earlier stages."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from cmsreduce import __version__
from cmsreduce.linalg.blocks import new_basis, outgrows, row_blocks
from cmsreduce.model import CHECKSUM, checksum, map_dataset, mapped_in
from cmsreduce.pipeline.store.stage_data import Arrays
from cmsreduce.write import atomic_path, hdf5_file, put_texts

__all__ = [
    "STAGES_FOLDER",
    "StageStore",
    "code_version",
    "is_stage",
    "share_stages",
    "stage_key",
]

_PACKAGE = Path(__file__).resolve().parents[2]
SHARED = ("read", "reduce", "reference", "orthogonalise")
"""Stages of single bodies, which runs with different later stages have in common."""

ONE_AT_A_TIME = ("read",)
"""Stages that processes of one run would all do by themselves."""

STAGES_FOLDER = "stages"
"""Folder of a run directory with its finished stages."""

STAGE_FORMAT = "cmsreduce-stage"
"""Attribute ``format`` of the file of a finished stage."""

# Datasets with the facts that are no arrays, and with the places of short vectors in those that hold all of one type;
# no array has these names.
_FACTS, _PLACES, _SHORT = "facts.", "places.", "short."
# Vectors of so many bytes or fewer lie in one dataset: thousands of channels have zeros in each configuration.
_SHORT_BYTES = 4096
# File in the folder of a run's stages with the path of the shared folder.
_POINTER = "shared.json"
# Hexadecimal digits of a key in the name of a file: 80 bits; the file holds the whole key.
_DIGITS = 20
_MATRIX = 2
# A list of values beyond this number of bytes is mapped from its file: a body's matrices, which may not be needed.
_LONG = 1 << 20
_KEY = re.compile(r"[0-9a-f]{64}")
# Errors of HDF5, and of later steps, on damaged bytes.
_DAMAGE = (OSError, KeyError, ValueError, RuntimeError, TypeError, IndexError, AttributeError, OverflowError)
_BASE = ("model", "linalg", "multifrontal", "mechanics")
_EVERY = (*_BASE, "reduce", "orthogonalise.py", "assemble", "balance", "project", "verify", "pipeline")
# Readers are left out, because keys hold a hash of the matrices that were read; so is the code that prints and draws.
_ROOMS = {
    "read": (),
    "proof": (*_EVERY, "read"),
    "reduce": (*_BASE, "reduce", "assemble", "pipeline"),
    "orthogonalise": (*_BASE, "orthogonalise.py", "pipeline"),
    "reference": (*_BASE, "reduce", "orthogonalise.py", "assemble", "pipeline"),
}


@cache
def code_version(stage: str, package: Path = _PACKAGE) -> str:
    """Hash of the sources that a stage's results depend on.

    Parameters
    ----------
    stage : str
        Such as ``reduce``; a stage that is not listed here depends on all rooms that compute.
    package : Path
        Folder of the package.

    Returns
    -------
    str
        Hexadecimal; of the version alone if the package has no sources.
    """
    digest = hashlib.sha256(__version__.encode())
    for room in _ROOMS.get(stage, _EVERY):
        at = package / room
        for file in [at] if at.is_file() else sorted(at.rglob("*.py")):
            digest.update(str(file.relative_to(package)).encode())
            digest.update(file.read_bytes())
    return digest.hexdigest()


def stage_key(stage: str, *parts: Any) -> str:
    """Hash of everything that a stage depends on: code, settings, hashes of files, keys of earlier stages."""
    text = json.dumps([stage, code_version(stage), *parts], sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()


def share_stages(folder: Path, shared: Path) -> None:
    """Make a run directory keep the stages of its bodies in a folder that other runs use, too.

    Parameters
    ----------
    folder : Path
        Run directory.
    shared : Path
        The common folder. The run directory holds its relative path, so that both can be moved together.
    """
    stages = folder / STAGES_FOLDER
    text = json.dumps({"shared": os.path.relpath(shared, stages)})
    path = stages / _POINTER
    if not path.is_file() or path.read_text(encoding="utf-8") != text:
        with atomic_path(path) as temporary:
            temporary.write_text(text, encoding="utf-8")


def is_stage(path: Path) -> bool:
    """True for the file of a finished stage, by its content; versions before the mark wrote a key and facts alone."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            key = str(file.attrs["key"])
            marked = file.attrs.get("format", STAGE_FORMAT) == STAGE_FORMAT
            return marked and _FACTS in file and _KEY.fullmatch(key) is not None
    except _DAMAGE:
        return False


class StageStore:
    """The ``stages`` folder of a run directory, and the one it shares with other runs, if any.

    A run's own folder holds one result of each stage, that of the last settings. In a shared folder the key is part of
    the file's name, so that the results of all settings lie side by side.

    Parameters
    ----------
    folder : Path
        Run directory.
    say : callable, optional
        Called with a message for each damaged entry, which is made again; ``damaged`` lists these messages.
    """

    def __init__(self, folder: Path, say: Callable[[str], None] = lambda text: None) -> None:
        self.folder, self._say = folder / STAGES_FOLDER, say
        self.damaged: list[str] = []
        self.shared = _shared_folder(self.folder)

    def path(self, stage: str, what: str, key: str) -> Path:
        """File of a stage of a component or of the system."""
        if self._is_shared(stage):
            assert self.shared is not None
            return self.shared / f"{what}.{stage}.{key[:_DIGITS]}.h5"
        return self.folder / f"{what}.{stage}.h5"

    def load(self, stage: str, what: str, key: str) -> tuple[Arrays, dict[str, Any]] | None:
        """Read a finished stage; None if it is absent, has another key, or is damaged."""

        def everything(file: Any) -> tuple[Arrays, dict[str, Any]]:
            # Reading a dataset compares its checksum.
            own = {*json.loads(file.attrs["names"])}
            return {name: _array(file.filename, file[name]) for name in own} | _short_arrays(file), _facts(file)

        found: tuple[Arrays, dict[str, Any]] | None = self._read(stage, what, key, everything)
        return found

    def facts(self, stage: str, what: str, key: str) -> dict[str, Any] | None:
        """Read the facts of a finished stage, without its arrays; None as `load`."""
        found: dict[str, Any] | None = self._read(stage, what, key, _facts)
        return found

    def save(
        self, stage: str, what: str, key: str, arrays: Mapping[str, NDArray[Any]], facts: Mapping[str, Any]
    ) -> Path:
        """Write a finished stage under a temporary name, and rename it when it is complete."""
        path = self.path(stage, what, key)
        # Arrays on disk are copied from file to file, without passing through memory.
        large = {
            name: array
            for name, array in arrays.items()
            if mapped_in(array) is not None or (array.ndim == 1 and array.nbytes > _LONG)
        }
        with hdf5_file(path, large) as file:
            file.attrs["format"] = STAGE_FORMAT
            file.attrs["key"] = key
            short = {name: each for name, each in arrays.items() if name not in large and _is_short(each)}
            file.attrs["names"] = json.dumps(sorted(arrays.keys() - short.keys()))
            together, places = _together(short)
            # Datasets, because HDF5 bounds the size of attributes.
            put_texts(file, _FACTS, [json.dumps(facts, sort_keys=True)])
            put_texts(file, _PLACES, [json.dumps(places)])
            for name, array in {**arrays, **together}.items():
                if name in large or name in short:
                    continue
                value = np.asarray(array)
                filtered = {"fletcher32": True} if value.size else {}
                file.create_dataset(name, data=value, track_times=False, **filtered)
        return path

    @contextmanager
    def claimed(self, stage: str, what: str, key: str) -> Iterator[bool]:
        """Keep other processes from an entry of the shared folder, or of a body to prove, while the block lasts.

        The operating system ends the claim when the process ends.

        Yields
        ------
        bool
            True if another process may have finished the entry before the claim was granted.
        """
        if not self._is_shared(stage) and stage not in ONE_AT_A_TIME:
            yield False
            return
        lock = self._lock(stage, what, key)
        try:
            lock.parent.mkdir(parents=True, exist_ok=True)
            opened = lock.open("a")
        except OSError:
            # The folder cannot be written, which the first result to write reports.
            yield False
            return
        with opened as handle:
            _wait_for(handle)
            try:
                yield True
            finally:
                # Processes that wait have the file open; at worst another process does the same work once more.
                lock.unlink(missing_ok=True)

    def is_claimed(self, stage: str, what: str, key: str) -> bool:
        """True while another process is at work on an entry."""
        try:
            with self._lock(stage, what, key).open("r") as handle:
                return not _granted(handle)
        except OSError:
            return False

    def _lock(self, stage: str, what: str, key: str) -> Path:
        path = self.path(stage, what, key)
        return path.with_name(f".{path.name}.lock")

    def _is_shared(self, stage: str) -> bool:
        return self.shared is not None and stage in SHARED

    def _read(self, stage: str, what: str, key: str, content: Callable[[Any], Any]) -> Any:
        import h5py

        path = self.path(stage, what, key)
        if not path.is_file():
            return None
        try:
            with h5py.File(path, "r") as file:
                if file.attrs.get("key") != key:
                    return None
                if not {*json.loads(file.attrs["names"]), _FACTS, _PLACES} <= set(file):
                    raise KeyError("not all of its arrays are there")
                return content(file)
        except _DAMAGE as error:
            # It holds no data of the user, and is made again.
            self.damaged.append(f"{path} is damaged and is made again ({' '.join(str(error).split())})")
            self._say(self.damaged[-1])
            return None


def _facts(file: Any) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(file[_FACTS][0])
    return found


def _is_short(array: NDArray[Any]) -> bool:
    return array.ndim == 1 and array.nbytes <= _SHORT_BYTES


def _together(arrays: Mapping[str, NDArray[Any]]) -> tuple[Arrays, dict[str, tuple[str, int, int]]]:
    """Vectors of one type as one, by the dataset that holds it, and of each its dataset and first and last place."""
    parts: dict[str, list[NDArray[Any]]] = {}
    places: dict[str, tuple[str, int, int]] = {}
    ends: dict[str, int] = {}
    for name, array in arrays.items():
        dataset = f"{_SHORT}{array.dtype.str[1:]}"
        first = ends.get(dataset, 0)
        ends[dataset] = first + array.size
        places[name] = dataset, first, ends[dataset]
        parts.setdefault(dataset, []).append(array)
    return {dataset: np.concatenate(each) for dataset, each in parts.items()}, places


def _short_arrays(file: Any) -> Arrays:
    """Arrays of `_together`."""
    places = json.loads(file[_PLACES][0])
    values = {dataset: file[dataset][()] for dataset in {at[0] for at in places.values()}}
    return {name: values[dataset][first:last] for name, (dataset, first, last) in places.items()}


def _array(path: str, dataset: Any) -> NDArray[Any]:
    """Values of a dataset, compared with their checksum; a large array stays in the file, or is copied to one."""
    if CHECKSUM in dataset.attrs:
        Phi = map_dataset(Path(path), dataset)
        if checksum(Phi) != dataset.attrs[CHECKSUM]:
            raise OSError(f"the checksum of {dataset.name} does not fit")
        return Phi
    if dataset.ndim != _MATRIX or dataset.dtype != np.float64 or not outgrows(*dataset.shape):
        found: NDArray[Any] = dataset[()]
        return found
    basis = new_basis(*dataset.shape)
    for rows in row_blocks(*dataset.shape):
        basis[rows] = dataset[rows]
    return basis


def _shared_folder(stages: Path) -> Path | None:
    pointer = stages / _POINTER
    try:
        named = json.loads(pointer.read_text(encoding="utf-8"))["shared"]
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError):
        # Without it the run does by itself what it would have shared.
        return None
    shared = (stages / str(named)).resolve()
    # A run directory from elsewhere must not choose any folder of this machine.
    return shared if stages.resolve().is_relative_to(shared.parent) else None


def _wait_for(handle: IO[str]) -> None:
    with contextlib.suppress(OSError):
        _granted(handle, wait=True)


def _granted(handle: IO[str], *, wait: bool = False) -> bool:
    """True if a lock is free, or becomes so."""
    try:
        import fcntl
    except ImportError:
        # Without locks two processes may do the same work; both results are complete.
        return True
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | (0 if wait else fcntl.LOCK_NB))
    except BlockingIOError:
        return False
    return True
