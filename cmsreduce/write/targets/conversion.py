"""Conversion of a component file to the file of another program."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from cmsreduce.errors import WriteError, not_among
from cmsreduce.write.component import ComponentFile, read_component, stored_integrals
from cmsreduce.write.own_files import is_result
from cmsreduce.write.targets.price import price_of
from cmsreduce.write.targets.profiles import PROFILES, TargetFiles, profile_files
from cmsreduce.write.targets.table import TARGETS, Target

__all__ = ["conversion", "convert", "refuse_other_file"]

# Bytes at the beginning of a file that hold the mark of its format.
_HEAD = 200


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
        refuse_other_file(path, source, TARGETS[PROFILES[profile].target])
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
    refuse_other_file(path, source, chosen)
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


def refuse_other_file(path: Path, source: str | Path, target: Target) -> None:
    """Refuse to replace files that are no earlier files of a target, before one of them is written.

    Raises
    ------
    WriteError
        For the first of the files; also if it is the source.
    """
    if path.suffix.lower() == ".flx":
        raise WriteError(
            f"{path}: .FLX names TREETOPS's own file, whose layout is not public; this one needs another name"
        )
    if path.exists() and path.samefile(source):
        raise WriteError(f"{path}: would replace the component file itself; choose another name")
    # They may be of the model itself, such as its matrices or its deck, or a component file.
    there = [file for file in target.files(path) if file.is_file() and file.stat().st_size]
    if there and not any(_is_marked(file, target.mark) for file in there):
        raise WriteError(
            f"{there[0]}: would be replaced, but is no earlier file of this format from cmsreduce; choose another name"
        )


def _is_marked(path: Path, mark: str) -> bool:
    with path.open("rb") as file:
        return mark.encode("latin-1") in file.read(_HEAD) and not is_result(path)


def _by_name(destination: Path, *, is_folder: bool) -> str:
    ends = destination.name.lower()
    found = [name for name, target in TARGETS.items() if ends.endswith(target.suffix.lower())]
    if len(found) != 1 or is_folder:
        suffixes = ", ".join(f"{name} *{target.suffix}" for name, target in TARGETS.items())
        raise WriteError(
            f"{destination}: the name does not show the target; give --for PROGRAM, --format, or one of: {suffixes}"
        )
    return found[0]
