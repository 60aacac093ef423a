"""system.h5: the assembled reduced system in every configuration."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from cmsreduce.model import DOF_NAMES, System
from cmsreduce.write.atomic import atomic_path
from cmsreduce.write.datasets import put, put_texts

__all__ = ["write_system"]

SYSTEM_FORMAT = "cmsreduce-system"
SYSTEM_FORMAT_VERSION = 1


def write_system(path: Path, systems: Sequence[System], *, provenance: Mapping[str, Any]) -> None:
    """Write the assembled reduced system.

    Parameters
    ----------
    path : Path
        Where; the file is whole or not there.
    systems : sequence of System
        Dense, one for each configuration.
    provenance : mapping
        JSON values: settings, notes.

    Raises
    ------
    WriteError
        If the file cannot be written.
    """
    import h5py

    with atomic_path(path) as temporary, h5py.File(temporary, "w", libver="v110") as file:
        file.attrs["format"] = SYSTEM_FORMAT
        file.attrs["format_version"] = SYSTEM_FORMAT_VERSION
        file.attrs["created_utc"] = datetime.now(UTC).isoformat(timespec="seconds")
        notes = file.create_group("provenance")
        for key, value in provenance.items():
            put_texts(notes, key, [json.dumps(value, sort_keys=True, default=str)], about="JSON")
        for number, system in enumerate(systems):
            group = file.create_group(f"configuration_{number}")
            group.attrs["name"] = system.configuration.name
            for (joint, dof), value in system.configuration.angles.items():
                group.attrs[f"setting {joint}.{DOF_NAMES[dof]}"] = value
            for name, size in system.sizes.items():
                group.attrs[f"coordinates {name}"] = size
            put_texts(group, "inputs", system.inputs)
            put_texts(group, "outputs", system.outputs)
            for name in ("M", "K", "D", "loss", "B", "C1", "C2", "T", "rigid"):
                matrix = getattr(system, name)
                if matrix is not None:
                    put(group, name, matrix)
