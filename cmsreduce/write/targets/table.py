"""Every file that a component file can be turned into, and the table that `write.formats` and `convert` go by."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from cmsreduce.errors import WriteError
from cmsreduce.write.component import ComponentFile, read_component, stored_integrals
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

Writer = Callable[[Path, ComponentFile, str], tuple[Path, ...]]


@dataclass(frozen=True)
class Target:
    """A file that another code reads.

    Parameters
    ----------
    suffix : str
        End of the name, by which ``convert`` knows it; the component's name stands before it.
    write : callable of (path, component, dialect)
        Writes it and returns the files written.
    dialects : tuple of str
        Ways to write it, the default first; none for most.
    """

    suffix: str
    write: Writer
    dialects: tuple[str, ...] = ()


def _with_integrals(write: Callable[..., None], *, dialect: bool = False) -> Writer:
    """A writer of one file that takes the integrals, and the dialect if it has any."""

    def one(path: Path, component: ComponentFile, chosen: str) -> tuple[Path, ...]:
        write(path, component, stored_integrals(component), *([chosen] if dialect else []))
        return (path,)

    return one


def _alone(write: Callable[[Path, ComponentFile], None]) -> Writer:
    """A writer of one file that takes the component and nothing else."""

    def one(path: Path, component: ComponentFile, _: str) -> tuple[Path, ...]:
        write(path, component)
        return (path,)

    return one


TARGETS: dict[str, Target] = {
    "nastran": Target(".op4", lambda path, component, _: write_nastran(path, component)),
    "42": Target(".42.txt", _with_integrals(write_42)),
    "sid": Target(".SID_FEM", _with_integrals(write_sid, dialect=True), ("by-axis", "by-mode")),
    "mbdyn": Target(".fem", _with_integrals(write_mbdyn, dialect=True), ("invariants", "lumped")),
    "mbsim": Target(".mbsim.h5", _with_integrals(write_mbsim)),
    "exudyn": Target(".npz", _with_integrals(write_exudyn)),
    "discos": Target(".discos.txt", _with_integrals(write_nodal)),
    "dads": Target(".dads.txt", _with_integrals(write_nodal)),
    "treetops": Target(".treetops.txt", _with_integrals(write_treetops)),
    "treetops-h5": Target(".treetops.h5", _with_integrals(write_treetops_h5)),
    "matlab": Target(".mat", _alone(write_states)),
    "abcd": Target(".abcd.txt", _alone(write_abcd)),
}
"""By the name that ``write.formats`` and ``convert --format`` know."""


def convert(
    source: str | Path, destination: str | Path, target: str | None = None, dialect: str | None = None
) -> tuple[Path, ...]:
    """Turn a component file into another code's.

    Parameters
    ----------
    source : Path
        Component file, all that is needed.
    destination : Path
        File to write; in an existing folder, under the component's name.
    target : str, optional
        Name in ``TARGETS``; by the end of the destination's name if not given.
    dialect : str, optional
        One of the target's; its first if not given.

    Returns
    -------
    tuple of Path
        Files written.

    Raises
    ------
    ReadError
        If the source is no whole component file.
    WriteError
        If the target or dialect is unknown, the source lacks what it needs, or it cannot be written.
    """
    component, destination = read_component(source), Path(destination)
    name = _by_name(destination) if target is None else target
    if name not in TARGETS:
        raise WriteError(f"'{name}' is no target (targets: {', '.join(TARGETS)})")
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
        raise WriteError(f"{path}: would take the place of the component file itself; choose another name")
    return chosen.write(path, component, dialect or (chosen.dialects or ("",))[0])


def _by_name(destination: Path) -> str:
    ends = destination.name.lower()
    found = [name for name, target in TARGETS.items() if ends.endswith(target.suffix.lower())]
    if len(found) != 1 or destination.is_dir():
        suffixes = ", ".join(f"{name} *{target.suffix}" for name, target in TARGETS.items())
        raise WriteError(f"{destination}: the name does not say the target; give --format, or one of: {suffixes}")
    return found[0]
