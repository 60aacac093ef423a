"""The file system.h5 read back: the assembled system, and the keys of the pipeline that it is from."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import scipy.sparse as sp

from cmsreduce.errors import ReadError
from cmsreduce.model import Configuration, System, Units
from cmsreduce.write.seal import verify_seal
from cmsreduce.write.system import JOINT_BODIES, QUANTITIES, SYSTEM_FORMAT, SYSTEM_FORMAT_VERSION, SYSTEM_MATRICES

__all__ = ["SystemFile", "read_system", "stated_settings", "system_settings"]

_BASE = ("length", "mass", "time")


@dataclass(frozen=True, eq=False)
class SystemFile:
    """Contents of a system file that other programs need.

    Parameters
    ----------
    name : str
        Name of the pipeline.
    systems : tuple of System
        One for each configuration, without the joints, which K, D and M include.
    units : Units or None
        Unit system of the scene.
    quantities : tuple of two tuples of str
        What each input and each output is, as in `write_system`; empty texts where the file does not say it.
    """

    name: str
    systems: tuple[System, ...]
    units: Units | None
    quantities: tuple[tuple[str, ...], tuple[str, ...]]


def read_system(path: Path) -> SystemFile:
    """Read a system file.

    Raises
    ------
    ReadError
        If the file is missing, damaged, changed after it was written, or of another format or a later version.
    """
    import h5py

    if not path.is_file():
        raise ReadError(f"{path}: there is no such file")
    verify_seal(path)
    try:
        with h5py.File(path, "r") as file:
            kind, version = file.attrs.get("format"), file.attrs.get("format_version", 0)
            if kind != SYSTEM_FORMAT or not 1 <= version <= SYSTEM_FORMAT_VERSION:
                raise ReadError(f"{path}: format {kind!r} of version {version} is not read; write it again")
            groups = [file[f"configuration_{k}"] for k in range(sum(n.startswith("configuration_") for n in file))]
            first, facts = groups[0], file["units"].attrs if "units" in file else {}
            stated = [_texts(first, name) if name in first else None for name in QUANTITIES]
            return SystemFile(
                name=json.loads(_texts(file, "provenance/pipeline")[0]) if "provenance/pipeline" in file else "system",
                systems=tuple(_system(group) for group in groups),
                units=None
                if facts is None
                else Units(str(facts["name"]), *(float(facts[f"{x}_in_si"]) for x in _BASE)),
                quantities=(stated[0] or ("",) * len(first["inputs"]), stated[1] or ("",) * len(first["outputs"])),
            )
    # Numbers in the place of texts cannot be decoded.
    except (OSError, KeyError, ValueError, TypeError, RuntimeError, IndexError, AttributeError) as error:
        raise ReadError(
            f"{path}: the file is damaged or incomplete ({error}); write it again with `cmsreduce run`"
        ) from None


def stated_settings(path: Path) -> dict[str, Any] | None:
    """Keys of the pipeline that a system file is from; None if an early version wrote it.

    Raises
    ------
    ReadError
        If the file is damaged, of another format, or was changed after it was written.
    """
    import h5py

    sealed = verify_seal(path)
    with h5py.File(path, "r") as file:
        if file.attrs.get("format") != SYSTEM_FORMAT or (sealed and "provenance/settings" not in file):
            raise ReadError(f"{path}: this is no system file of a run; give the output directory of a finished run")
        if not sealed:
            return None
        settings: dict[str, Any] = json.loads(file["provenance/settings"][0])
        return settings


def system_settings(path: Path) -> dict[str, Any]:
    """Keys of the pipeline that a system file is from.

    Raises
    ------
    ReadError
        As `stated_settings`, and if the file is missing, or an early version wrote it.
    """
    import h5py

    if not path.is_file():
        raise ReadError(f"{path}: there is no such file; a run with `write: {{formats: [hdf5]}}` leaves it")
    settings = stated_settings(path)
    if settings is None:
        raise ReadError(f"{path}: it has no seal, so an early version wrote it; write it again with `cmsreduce run`")
    with h5py.File(path, "r") as file:
        bodies = [name.decode("utf-8") for name in file["configuration_0/bodies"][()]]
    if list(settings.get("components", ())) != [name for name in bodies if not name.startswith(JOINT_BODIES)]:
        raise ReadError(
            f"{path}: an early version wrote it, without the order of bodies and joints; write it again with "
            "`cmsreduce run`"
        )
    return settings


def _texts(group: Any, name: str) -> tuple[str, ...]:
    return tuple(text.decode("utf-8") for text in group[name][()])


def _system(group: Any) -> System:
    def matrix(name: str) -> Any:
        if name not in group:
            return None
        parts = group[name]
        if not hasattr(parts, "keys"):
            return parts[()]
        arrays = tuple(parts[part][()] for part in ("data", "indices", "indptr"))
        return sp.csc_array(arrays, shape=tuple(parts["shape"][()]))

    sizes = dict(zip(_texts(group, "bodies"), group["sizes"][()].tolist(), strict=True))
    return System(
        configuration=Configuration(str(group.attrs["name"])),
        **{name: matrix(name) for name in SYSTEM_MATRICES},
        sizes=sizes,
        inputs=_texts(group, "inputs"),
        outputs=_texts(group, "outputs"),
        rounding=float(group.attrs.get("rounding", 2.0**-53)),
        notes=_texts(group, "notes"),
    )
