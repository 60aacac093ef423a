"""Table of programs: frame, modes, dialect and names of the files that each one runs as they are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cmsreduce.errors import WriteError, not_among
from cmsreduce.model import FrameCondition
from cmsreduce.write.component import (
    ComponentFile,
    in_frame,
    read_component,
    stored_integrals,
    with_unit_modal_mass,
)
from cmsreduce.write.targets.price import price_of
from cmsreduce.write.targets.table import TARGETS

__all__ = ["PROFILES", "Profile", "TargetFiles", "profile_files"]


@dataclass(frozen=True)
class Profile:
    """Parts of a flexible body that one program takes.

    Parameters
    ----------
    target : str
        Format, a name in ``TARGETS``.
    dialect : str, optional
        Dialect of the format.
    name : str
        Name of the file, with ``{}`` for the name of the component.
    mean_axes : bool
        True if the program is right about mean axes alone; others take any frame, so that the file's own is kept.
    unit_mass : bool
        True if the program needs orthogonal modes of unit modal mass.
    numbered_joints : bool
        True if the file has numbers of the joints of the whole scene.
    why : str
        Reason for these settings, found by running the program.
    limit : str
        What the program itself leaves out of a body that the file holds.
    """

    target: str
    dialect: str | None = None
    name: str = ""
    mean_axes: bool = False
    unit_mass: bool = False
    numbered_joints: bool = False
    why: str = ""
    limit: str = ""

    def file_name(self, component: str) -> str:
        """Name of the file of a component."""
        return self.name.format(component) if self.name else f"{component}{TARGETS[self.target].suffix}"


PROFILES: dict[str, Profile] = {
    "42": Profile(
        "42",
        name="Flex_{}.txt",
        mean_axes=True,
        unit_mass=True,
        numbered_joints=True,
        why="42 is right to first order about mean axes with REFPT_CM, where it leaves out the momentum of other modes",
        limit="42 keeps its inertia as it is at rest: large motions are right to first order in the deformation",
    ),
    "mbdyn-1.7.3": Profile(
        "mbdyn",
        "points",
        why="MBDyn 1.7.3 does not know the record groups of invariants, and forms them exactly from mass points",
    ),
    "mbdyn-1.7.3-first-order": Profile(
        "mbdyn",
        "first-order",
        mean_axes=True,
        why="about mean axes MBDyn needs no invariants to first order: for bodies without integrals of second order",
    ),
    "mbdyn-1.7.3-lumped": Profile(
        "mbdyn", "lumped", why="MBDyn 1.7.3 forms its invariants from the lumped mass of all nodes of the mesh"
    ),
    "mbdyn": Profile("mbdyn", "invariants", why="versions of MBDyn that read record groups 14 to 18"),
    "embs": Profile(
        "sid",
        "embs",
        unit_mass=True,
        why="EMBS_ModelicaLib takes Gr and Ge by mode, unit modal mass for granted, and keywords from the body's name",
    ),
    "pymbs": Profile("sid", "embs", why="PyMBS takes Gr and Ge by mode, and whole matrices"),
    "fembs": Profile("sid", "by-axis", why="the order in which FEMBS writes Gr and Ge"),
    "pysid": Profile("sid", "gr-by-mode", why="the order of PY_SID: Gr by mode, Ge by axis"),
    "mbsim": Profile("mbsim"),
    "exudyn": Profile("exudyn"),
}
"""Profiles by their name in ``write.targets`` and ``convert --for``; one entry registers a program."""


@dataclass(frozen=True, eq=False)
class TargetFiles:
    """Files of a body for one program.

    Parameters
    ----------
    paths : tuple of Path
        Files written.
    notes : tuple of str
        What the user must know: a change of the frame, numbers of joints, the price of the format.
    body : ComponentFile
        The body as the files hold it, in memory: ``integrals/origin`` and ``integrals/axes`` place its frame in the
        body's basic frame, ``nodes/*`` hold its shapes along the basic axes.
    """

    paths: tuple[Path, ...]
    notes: tuple[str, ...]
    body: ComponentFile


def profile_files(
    component: ComponentFile | Path | str,
    profile: str,
    folder: Path | str,
    *,
    at: str | None = None,
    joints: Mapping[str, int] | None = None,
    file: Path | None = None,
) -> TargetFiles:
    """Write a body for a program, in the frame, modes and dialect that the program takes.

    Parameters
    ----------
    component : ComponentFile or Path
        The body, or its component file.
    profile : str
        Name in ``PROFILES``.
    folder : Path
        Folder of the files.
    at : str, optional
        Interface to clamp the frame to; by default mean axes where the program needs them, else the frame of the
        component file.
    joints : mapping of interface to int, optional
        Number of the scene's joint at each interface, for programs that number them.
    file : Path, optional
        Name of the first file instead of the profile's own.

    Raises
    ------
    ReadError
        If the component file is not complete.
    WriteError
        If the profile is unknown, the program gets the frame wrong, the body lacks what it needs, or a file cannot be
        written.
    """
    if profile not in PROFILES:
        raise WriteError(not_among("profile", profile, PROFILES))
    chosen = PROFILES[profile]
    if not isinstance(component, ComponentFile):
        component = read_component(component)
    component.refuse_gyroscopic(f"a file for {profile}")
    if at is not None and chosen.mean_axes:
        raise WriteError(
            f"component '{component.name}': {profile} takes mean axes, not a frame clamped at '{at}': {chosen.why}"
        )
    if joints is not None and not chosen.numbered_joints:
        raise WriteError(f"component '{component.name}': a file for {profile} has no numbers of joints; take them out")
    body, notes = _prepared(component, profile, at)
    integrals = stored_integrals(body)
    path = file or Path(folder) / chosen.file_name(body.name)
    arguments: dict[str, Any] = {} if chosen.dialect is None else {"dialect": chosen.dialect}
    if chosen.numbered_joints:
        arguments["joints"] = joints
        if joints is None and body.interfaces:
            numbered = ", ".join(f"{name} {number}" for number, name in enumerate(body.interfaces))
            notes.append(
                f"{body.name}: its interfaces have the joint numbers {numbered}; give those of your spacecraft: "
                f"`cmsreduce convert --for {profile} --joint {next(iter(body.interfaces))}=2`"
            )
    paths = TARGETS[chosen.target].write(path, body, integrals, **arguments) or (path,)
    notes += price_of(body, integrals, chosen.target, chosen.dialect)
    notes += [f"{body.name}: {chosen.limit}"] if chosen.limit else []
    return TargetFiles(paths, tuple(notes), body)


def _prepared(component: ComponentFile, profile: str, at: str | None) -> tuple[ComponentFile, list[str]]:
    """The body in the frame and modes of a program, and remarks on what that changed."""
    chosen, notes, body = PROFILES[profile], list[str](), component
    if chosen.mean_axes or at is not None:
        condition = FrameCondition("mean-axis") if at is None else FrameCondition("clamped", at)
        body = in_frame(component, condition)
        before = str(component.attributes.get("frame", {}).get("kind", "none"))
        if before not in ("none", condition.kind):
            notes.append(
                f"{component.name}: its frame is {before} in its file, and {condition} in the file for {profile}"
            )
    if chosen.unit_mass:
        body = with_unit_modal_mass(body)
    return body, notes
