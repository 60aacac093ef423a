"""Table of the programs that take whole scenes, and the export of a scene to one of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from cmsreduce.errors import WriteError, not_among
from cmsreduce.model import MultibodyScene
from cmsreduce.write.component import read_component
from cmsreduce.write.export.exudyn import write_exudyn_scene
from cmsreduce.write.export.mbdyn import write_mbdyn_scene
from cmsreduce.write.export.scene42 import write_42_scene
from cmsreduce.write.targets import PROFILES

__all__ = ["EXPORTS", "SceneExport", "export_scene"]


@dataclass(frozen=True)
class SceneExport:
    """A program that takes whole scenes.

    Parameters
    ----------
    write : callable of (folder, scene)
        Writes the program's input into an empty folder; returns the files, the one to start with first.
    start : str
        Command that runs the scene in that folder, for the message.
    """

    write: Callable[[Path, MultibodyScene], tuple[Path, ...]]
    start: str


EXPORTS: dict[str, SceneExport] = {
    "exudyn": SceneExport(write_exudyn_scene, "python scene.py"),
    "mbdyn": SceneExport(write_mbdyn_scene, "mbdyn -f scene.mbd"),
    "42": SceneExport(write_42_scene, "42 . MODEL, where MODEL is the folder Model of 42, relative to this one"),
}
"""Programs by their name in ``export --to``; one line registers a program."""


def export_scene(scene: MultibodyScene, program: str, folder: Path) -> tuple[Path, ...]:
    """Write a scene as the input of another program.

    Parameters
    ----------
    scene : MultibodyScene
        In the configuration in which the simulation starts.
    program : str
        Name in ``EXPORTS``.
    folder : Path
        Folder to make; it is absent or empty, so that nothing that the user has changed is lost.

    Returns
    -------
    tuple of Path
        Files written, the one to start with first.

    Raises
    ------
    WriteError
        If the program is unknown, the folder holds files, or the program cannot take a part of the scene.
    ReadError
        If a component file is not complete.
    """
    if program in PROFILES and program not in EXPORTS:
        raise WriteError(
            f"{program} gets single bodies and no whole scene: no scene for it was ever run. Write the bodies by "
            f"`cmsreduce convert BODY.h5 OUT --for {program}`; scenes are for {', '.join(EXPORTS)}"
        )
    if program not in EXPORTS:
        raise WriteError(not_among("program", program, EXPORTS))
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise WriteError(f"{folder}: it holds files already, which may have been changed; remove it, or choose --out")
    for body in scene.bodies:
        if body.file is not None:
            component = read_component(body.file)
            component.refuse_parameters(scene.configuration.parameters, f"a scene for {program}")
            component.refuse_gyroscopic(f"a scene for {program}")
        elif body.rigid is not None and body.rigid.momentum_at(scene.configuration.parameters).any():
            raise WriteError(
                f"rigid body '{body.name}': a scene for {program} has no place for the momentum of its wheels; model "
                "the wheel as a body of its own in that program and take it out here"
            )
    folder.parent.mkdir(parents=True, exist_ok=True)
    # Renamed at the end: a body that is refused leaves no half scene.
    with TemporaryDirectory(prefix=f".{folder.name}.", dir=folder.parent) as temporary:
        whole = Path(temporary) / folder.name
        whole.mkdir()
        written = EXPORTS[program].write(whole, scene)
        whole.replace(folder)
    return tuple(folder / path.relative_to(whole) for path in written)
