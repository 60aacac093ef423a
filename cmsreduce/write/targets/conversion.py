"""Conversion of a component file to the file of another program."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from cmsreduce.errors import WriteError, not_among
from cmsreduce.write.component import ComponentFile, read_component, stored_integrals
from cmsreduce.write.targets.price import price_of
from cmsreduce.write.targets.profiles import PROFILES, TargetFiles, profile_files
from cmsreduce.write.targets.table import TARGETS, Target

__all__ = ["conversion", "convert"]


def convert(
    source: str | Path,
    destination: str | Path,
    target: str | None = None,
    dialect: str | None = None,
    *,
    profile: str | None = None,
    at: str | None = None,
    joints: Mapping[str, int] | None = None,
) -> tuple[Path, ...]:
    """Convert a component file to the format of another program.

    Parameters
    ----------
    source : Path
        Component file.
    destination : Path
        File to write, or a folder for a file with the component's name; a name that ends in a slash is a folder, which
        is made.
    target : str, optional
        Name in ``TARGETS``; by default found by the end of the destination's name.
    dialect : str, optional
        A dialect of the target; by default its first.
    profile : str, optional
        Name in ``PROFILES``, instead of a target: frame, modes and dialect that a program takes.
    at : str, optional
        With a profile: interface to clamp the frame to.
    joints : mapping of interface to int, optional
        With a profile: number of the scene's joint at each interface.

    Returns
    -------
    tuple of Path
        Files written.

    Raises
    ------
    ReadError
        If the source is not a complete component file.
    WriteError
        If the target, profile or dialect is unknown, the source lacks what it needs, or it cannot be written.
    """
    return conversion(source, destination, target, dialect, profile=profile, at=at, joints=joints).paths


def conversion(
    source: str | Path,
    destination: str | Path,
    target: str | None = None,
    dialect: str | None = None,
    *,
    profile: str | None = None,
    at: str | None = None,
    joints: Mapping[str, int] | None = None,
) -> TargetFiles:
    """The same, with the remarks and the body; arguments and errors as `convert`."""
    component = read_component(source)
    named = Path(destination)
    is_folder = named.is_dir() or str(destination).endswith(("/", os.sep))
    if profile is not None:
        if target is not None or dialect is not None:
            raise WriteError(f"the profile {profile} chooses format and dialect: leave out --format and --dialect")
        if profile not in PROFILES:
            raise WriteError(not_among("profile", profile, PROFILES))
        path = named / PROFILES[profile].file_name(component.name) if is_folder else named
        _check_path(path, source, TARGETS[PROFILES[profile].target])
        made = profile_files(component, profile, path.parent, at=at, joints=joints, file=path)
        return _at_zero(made, component)
    if at is not None or joints is not None:
        raise WriteError("a frame and numbers of joints belong to a program: give it by --for, with --at and --joint")
    name = _by_name(named, is_folder=is_folder) if target is None else target
    if name not in TARGETS:
        raise WriteError(not_among("target", name, TARGETS))
    chosen = TARGETS[name]
    if not chosen.gyroscopic:
        component.refuse_gyroscopic(f"the format {name}")
    if dialect is not None and dialect not in chosen.dialects:
        known = f"its dialects: {', '.join(chosen.dialects)}" if chosen.dialects else "it has none"
        raise WriteError(f"'{dialect}' is no dialect of {name} ({known})")
    path = named / f"{component.name}{chosen.suffix}" if is_folder else named
    _check_path(path, source, chosen)
    arguments = [dialect or chosen.dialects[0]] if chosen.dialects else []
    if not chosen.integrals:
        paths = chosen.write(path, component, *arguments) or (path,)
        return _at_zero(TargetFiles(paths, price_of(component, None, name, None), component), component)
    return _at_zero(_with_integrals(path, component, name, *arguments), component)


def _at_zero(made: TargetFiles, component: ComponentFile) -> TargetFiles:
    """Files with a note on parameters, which they do not hold."""
    names = sorted({term.parameter for term in component.parameter_terms})
    if not names:
        return made
    note = (
        f"{component.name}: {', '.join(names)} is zero in this file; `write.configuration` of a run writes other values"
    )
    return replace(made, notes=(*made.notes, note))


def _with_integrals(path: Path, component: ComponentFile, target: str, dialect: str | None = None) -> TargetFiles:
    integrals = stored_integrals(component)
    arguments: list[Any] = [integrals] if dialect is None else [integrals, dialect]
    paths = TARGETS[target].write(path, component, *arguments) or (path,)
    return TargetFiles(paths, price_of(component, integrals, target, dialect), component)


def _check_path(path: Path, source: str | Path, target: Target) -> None:
    if path.suffix.lower() == ".flx":
        raise WriteError(
            f"{path}: .FLX names TREETOPS's own file, whose layout is not public; this one needs another name"
        )
    if path.exists() and path.samefile(source):
        raise WriteError(f"{path}: would replace the component file itself; choose another name")
    # The user has named one file; those beside it may be of the model itself, such as its deck.
    beside = [file for file in target.files(path) if file != path and file.exists()]
    if beside and not any(_begins(file, target.mark) for file in target.files(path)):
        raise WriteError(f"{beside[0]}: would be replaced by a file beside {path.name}; choose another name")


def _begins(path: Path, mark: str) -> bool:
    if not path.is_file():
        return False
    with path.open("rb") as file:
        return file.read(len(mark)) == mark.encode()


def _by_name(destination: Path, *, is_folder: bool) -> str:
    ends = destination.name.lower()
    found = [name for name, target in TARGETS.items() if ends.endswith(target.suffix.lower())]
    if len(found) != 1 or is_folder:
        suffixes = ", ".join(f"{name} *{target.suffix}" for name, target in TARGETS.items())
        raise WriteError(
            f"{destination}: the name does not show the target; give --for PROGRAM, --format, or one of: {suffixes}"
        )
    return found[0]
