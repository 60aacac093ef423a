"""Conversion of files that a run wrote: component files, and assembled systems as Functional Mock-up Units."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from cmsreduce.assemble import modal_states
from cmsreduce.errors import WriteError, not_among
from cmsreduce.model import Scene, System
from cmsreduce.read import expect_kind, file_kind
from cmsreduce.write import (
    TARGETS,
    LinearModel,
    Port,
    SystemFile,
    conversion,
    read_system,
    refuse_other_file,
    unit_binary,
    write_unit,
)

__all__ = ["channel_quantities", "convert_file", "convert_system", "unit_paths", "without_binary"]

_EFFORTS = {"translation": "force", "rotation": "torque"}


def channel_quantities(scene: Scene) -> tuple[list[str], list[str]]:
    """Kind of each actuator and sensor: force or torque; translation, rotation, with `` rate``; combination."""
    efforts = [_EFFORTS.get(channel.quantity, channel.quantity) for channel in scene.actuators]
    return efforts, [channel.quantity + " rate" * channel.rate for channel in scene.sensors]


def unit_paths(folder: Path, configurations: int) -> list[Path]:
    """Files of a run: system.fmu, or system-0.fmu, system-1.fmu and so on, numbered as in system.h5."""
    if configurations == 1:
        return [folder / "system.fmu"]
    return [folder / f"system-{number}.fmu" for number in range(configurations)]


def convert_file(
    source: Path,
    destination: str,
    target: str | None = None,
    dialect: str | None = None,
    configuration: str | None = None,
    **program: Any,
) -> tuple[tuple[Path, ...], tuple[str, ...]]:
    """Convert a component file, or a system file to ``fmi``.

    Parameters
    ----------
    source, destination, target, dialect
        As `conversion` takes them.
    configuration : str, optional
        Name of a configuration of a system file.
    **program
        ``profile``, ``at`` and ``joints`` of `conversion`.

    Returns
    -------
    paths : tuple of Path
        Files written.
    notes : tuple of str
        What the user must know.

    Raises
    ------
    ReadError
        If the source is of another kind.
    WriteError
        As `conversion` and `convert_system` do.
    """
    as_unit = target == "fmi" or (target is None and Path(destination).suffix.lower() == TARGETS["fmi"].suffix)
    notes: tuple[str, ...] = ()
    if as_unit and source.is_file() and file_kind(source).name == "system":
        if any(program.values()):
            raise WriteError(f"{source}: --for, --at and --joint are for component files")
        written = convert_system(source, destination, dialect, configuration)
    else:
        if configuration is not None:
            raise WriteError(f"{source}: --configuration is for system files that are written as fmi")
        expect_kind(source, "component")
        made = conversion(source, destination, target, dialect, **program)
        written, notes = made.paths, made.notes
    return written, (*notes, *without_binary(written))


def without_binary(written: Iterable[Path]) -> list[str]:
    """Remarks on units that hold C sources only, because this machine has no C compiler."""
    return [
        f"{path.name} holds C sources only: there is no C compiler `cc` here; the importer compiles them"
        for path in written
        if path.suffix.lower() == TARGETS["fmi"].suffix and not unit_binary(path)
    ]


def convert_system(
    source: Path, destination: str | Path, version: str | None = None, configuration: str | None = None
) -> tuple[Path, ...]:
    """Write an assembled system as a Functional Mock-up Unit.

    Parameters
    ----------
    source : Path
        The file system.h5.
    destination : str or Path
        File to write, or a folder, there or with a slash at its end, for a file of each configuration, or of the one
        that is named.
    version : {"fmi3", "fmi2"}, optional
        Version of the standard.
    configuration : str, optional
        Name of a configuration; needed for a single file if the system has several.

    Returns
    -------
    tuple of Path
        Files written.

    Raises
    ------
    ReadError
        If the source is not a complete system file.
    WriteError
        If the configuration or version is unknown, or the file cannot be written.
    MatrixError
        If the system has no real state space (`modal_states`).
    """
    dialects = TARGETS["fmi"].dialects
    if version is not None and version not in dialects:
        raise WriteError(f"'{version}' is no dialect of fmi (its dialects: {', '.join(dialects)})")
    found = read_system(source)
    names = [system.configuration.name for system in found.systems]
    if configuration is not None and configuration not in names:
        raise WriteError(f"{source}: {not_among('configuration', configuration, names)}")
    out = Path(destination)
    is_folder = out.is_dir() or str(destination).endswith(("/", os.sep))
    if configuration is None and len(names) > 1 and not is_folder:
        raise WriteError(
            f"{source} has {len(names)} configurations, and a unit holds one: name it with --configuration "
            f"({', '.join(names)}), or give a folder, FOLDER/, for a unit of each"
        )
    numbers = range(len(names)) if configuration is None else [names.index(configuration)]
    written = []
    for number in numbers:
        path = unit_paths(out, len(names))[number] if is_folder else out
        refuse_other_file(path, source, TARGETS["fmi"])
        write_unit(path, _model(found, found.systems[number]), version or dialects[0])
        written.append(path)
    return tuple(written)


def _model(file: SystemFile, system: System) -> LinearModel:
    states, (inputs, outputs) = modal_states(system), file.quantities
    name = system.configuration.name
    return LinearModel(
        name=f"{file.name} {name}",
        about=f"assembled reduced system {file.name}, configuration {name}: small motions about rest",
        A=states.A,
        B=states.B,
        C=states.C,
        D=states.D,
        inputs=tuple(map(Port, system.inputs, inputs)),
        outputs=tuple(map(Port, system.outputs, outputs)),
        frequency_hz=states.omega / (2 * np.pi * (file.units.time if file.units else 1.0)),
        units=file.units,
    )
