"""Table of the formats of other programs, and the conversion of a component file to one of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cmsreduce.errors import WriteError, not_among
from cmsreduce.write.component import read_component, stored_integrals
from cmsreduce.write.targets.exudyn import write_exudyn
from cmsreduce.write.targets.flex42 import write_42
from cmsreduce.write.targets.mbdyn import write_mbdyn
from cmsreduce.write.targets.mbsim import write_mbsim
from cmsreduce.write.targets.nastran import write_nastran
from cmsreduce.write.targets.nodal import write_nodal
from cmsreduce.write.targets.sid import write_sid
from cmsreduce.write.targets.state_space import write_abcd, write_states
from cmsreduce.write.targets.treetops import write_treetops, write_treetops_h5

__all__ = ["TARGETS", "Target", "convert"]


@dataclass(frozen=True)
class Target:
    """A file of another program.

    Parameters
    ----------
    suffix : str
        End of the file name, after the name of the component; `convert` recognises the target by it.
    write : callable of (path, component), then (integrals) and (dialect) where the target has them
        Writes the file; returns the files written if they are not ``path`` alone.
    dialects : tuple of str
        Variants of the format, the default first; most have none.
    integrals : bool
        True if the writer takes the modal integrals.
    """

    suffix: str
    write: Callable[..., tuple[Path, ...] | None]
    dialects: tuple[str, ...] = ()
    integrals: bool = True


TARGETS: dict[str, Target] = {
    "nastran": Target(".op4", write_nastran, integrals=False),
    "42": Target(".42.txt", write_42),
    "sid": Target(".SID_FEM", write_sid, ("by-axis", "by-mode")),
    "mbdyn": Target(".fem", write_mbdyn, ("points", "invariants", "lumped")),
    "mbsim": Target(".mbsim.h5", write_mbsim),
    "exudyn": Target(".npz", write_exudyn),
    "discos": Target(".discos.txt", write_nodal),
    "dads": Target(".dads.txt", write_nodal),
    "treetops": Target(".treetops.txt", write_treetops),
    "treetops-h5": Target(".treetops.h5", write_treetops_h5),
    "matlab": Target(".mat", write_states, integrals=False),
    "abcd": Target(".abcd.txt", write_abcd, integrals=False),
}
"""Targets by their name in ``write.formats`` and ``convert --format``; one line registers a format."""


def convert(
    source: str | Path, destination: str | Path, target: str | None = None, dialect: str | None = None
) -> tuple[Path, ...]:
    """Convert a component file to the format of another program.

    Parameters
    ----------
    source : Path
        Component file.
    destination : Path
        File to write, or an existing folder for a file with the component's name.
    target : str, optional
        Name in ``TARGETS``; by default found by the end of the destination's name.
    dialect : str, optional
        A dialect of the target; by default its first.

    Returns
    -------
    tuple of Path
        Files written.

    Raises
    ------
    ReadError
        If the source is not a complete component file.
    WriteError
        If the target or dialect is unknown, the source lacks what it needs, or it cannot be written.
    """
    component, destination = read_component(source), Path(destination)
    name = _by_name(destination) if target is None else target
    if name not in TARGETS:
        raise WriteError(not_among("target", name, TARGETS))
    chosen = TARGETS[name]
    if dialect is not None and dialect not in chosen.dialects:
        known = f"its dialects: {', '.join(chosen.dialects)}" if chosen.dialects else "it has none"
        raise WriteError(f"'{dialect}' is no dialect of {name} ({known})")
    path = destination / f"{component.name}{chosen.suffix}" if destination.is_dir() else destination
    if path.suffix.lower() == ".flx":
        raise WriteError(
            f"{path}: .FLX names TREETOPS's own file, whose layout is not public; this one needs another name"
        )
    if path.exists() and path.samefile(source):
        raise WriteError(f"{path}: would replace the component file itself; choose another name")
    arguments: list[Any] = [stored_integrals(component)] if chosen.integrals else []
    if chosen.dialects:
        arguments.append(dialect or chosen.dialects[0])
    return chosen.write(path, component, *arguments) or (path,)


def _by_name(destination: Path) -> str:
    ends = destination.name.lower()
    found = [name for name, target in TARGETS.items() if ends.endswith(target.suffix.lower())]
    if len(found) != 1 or destination.is_dir():
        suffixes = ", ".join(f"{name} *{target.suffix}" for name, target in TARGETS.items())
        raise WriteError(f"{destination}: the name does not show the target; give --format, or one of: {suffixes}")
    return found[0]
