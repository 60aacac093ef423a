"""The scene of a finished run, made again from its files alone: system.h5 and the component files beside it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cmsreduce.assemble import available, closing_motion, joint_arms, joint_tree, motion_axes, place_bodies
from cmsreduce.config import Pipeline, build_scene, pipeline_from_keys
from cmsreduce.errors import ReadError, SceneError, not_among
from cmsreduce.model import (
    FIRST_ROTATION,
    Configuration,
    Interface,
    MultibodyScene,
    Placement,
    Scene,
    SceneBody,
    SceneJoint,
)
from cmsreduce.pipeline.bodies import read_rigid
from cmsreduce.write import ComponentFile, read_component, system_settings

__all__ = ["multibody_scene"]

# What a body is for a floating-frame code; names, rankings and channels may differ between equal bodies.
_THE_BODY = (
    *("modes/mass", "modes/stiffness", "modes/damping", "modes/gyroscopic", "modes/omega"),
    *("nodes/", "integrals/", "frame/"),
)


def multibody_scene(folder: Path, configuration: str | None = None) -> MultibodyScene:
    """Read the scene of a run for simulation in time.

    Parameters
    ----------
    folder : Path
        Run directory with system.h5 and the component file of every flexible body.
    configuration : str, optional
        Name of a configuration, its joints in any order; by default the first one.

    Returns
    -------
    MultibodyScene

    Raises
    ------
    ReadError
        If a file is missing, was changed after it was written, is of another run, or holds no modal integrals.
    SceneError
        If the run has no configuration of this name.
    """
    if not folder.is_dir():
        raise ReadError(f"{folder}: there is no such folder; give the output directory of a finished run")
    settings = system_settings(folder / "system.h5")
    components: Mapping[str, Mapping[str, Any]] = settings["components"]
    files = {
        name: _component(folder / f"{name}.h5", name, settings)
        for name, part in components.items()
        if "rigid" not in part
    }
    pipeline = pipeline_from_keys(_scene_keys(settings, files), str(folder / "system.h5"))
    scene = build_scene(pipeline)
    for name, file in files.items():
        _check_units(folder / f"{name}.h5", file, scene)
    chosen = _chosen(scene, configuration)
    unplaced = _bodies(pipeline, scene, folder, files)
    placed = place_bodies({body.name: body for body in unplaced}, scene, chosen)
    bodies = tuple(
        SceneBody(body.name, body.interfaces, placed[body.name], body.file, body.rigid, body.grounded)
        for body in unplaced
    )
    return MultibodyScene(pipeline.name, scene, chosen, bodies, _joints(scene, chosen, bodies))


def _scene_keys(settings: Mapping[str, Any], files: Mapping[str, ComponentFile]) -> dict[str, Any]:
    """Keys of the scene and its bodies; flexible bodies by the nodes in their files, whatever they were named by."""
    parts: dict[str, Any] = {}
    for name, part in settings["components"].items():
        parts[name] = {
            key: part[key] for key in ("rigid", "wheels", "interfaces", "place", "units", "grounded") if key in part
        }
        if name in files:
            faces = {face: {"nodes": list(nodes)} for face, nodes in files[name].interfaces.items()}
            source = {"file": f"{name}.h5"}
            parts[name] |= {"stiffness": source, "mass": source, "interfaces": faces}
    scene = {key: value for key, value in settings["scene"].items() if key not in ("spin", "controller")}
    return {"name": settings["name"], "components": parts, "scene": scene}


def _chosen(scene: Scene, name: str | None) -> Configuration:
    """Configuration by its name; the joints may stand in any order."""
    if name is None:
        return scene.configurations[0]
    for each in scene.configurations:
        if sorted(each.name.split()) == sorted(name.split()):
            return each
    raise SceneError(not_among("configuration", name, [each.name for each in scene.configurations]))


def _component(path: Path, name: str, settings: Mapping[str, Any]) -> ComponentFile:
    """Component file of a body of the run; refuse one that does not serve a floating frame."""
    if not path.is_file():
        raise ReadError(
            f"{path}: the component file of '{name}' is missing; the run writes it with `write: {{formats: [hdf5]}}`"
        )
    file = read_component(path)
    if file.name != name or file.settings != settings:
        raise ReadError(
            f"{path}: it holds component '{file.name}' of another run than system.h5 beside it; write both again with "
            "`cmsreduce run`"
        )
    if "integrals/origin" not in file.arrays:
        why = (
            "it was written by an early version: write it again with `cmsreduce run`"
            if "nodes/id" in file.arrays
            else "a body of scalar points has no geometry, so no floating frame can carry it"
        )
        raise ReadError(f"{path}: it holds no modal integrals; {why}")
    return file


def _check_units(path: Path, file: ComponentFile, scene: Scene) -> None:
    units = file.attributes["units"]
    if any(units[f"{what}_in_si"] != getattr(scene.units, what) for what in ("length", "mass", "time")):
        raise ReadError(
            f"{path}: it is in units {units['name']}, and the scene in {scene.units.name}; write it again with "
            "`cmsreduce run`"
        )


def _bodies(pipeline: Pipeline, scene: Scene, folder: Path, files: Mapping[str, ComponentFile]) -> list[SceneBody]:
    """Bodies as built."""
    found: list[SceneBody] = []
    shared: dict[tuple[str, ...], Path] = {}
    for name, part in pipeline.components.items():
        place = scene.placements.get(name, Placement())
        if name not in files:
            rigid = read_rigid(pipeline, name, scene)
            found.append(SceneBody(name, rigid.interfaces, place, rigid=rigid))
            continue
        path = shared.setdefault(_content(files[name]), folder / f"{name}.h5")
        found.append(SceneBody(name, _interfaces(files[name]), place, path, grounded=part.grounded))
    return found


def _content(file: ComponentFile) -> tuple[str, ...]:
    """Digests of the body that a file holds: equal for copies; the file itself where it has no seal."""
    if not file.sealed:
        return (file.name,)
    digests = zip(file.texts["seal/item"], file.texts["seal/sha256"], strict=True)
    return tuple(f"{item} {digest}" for item, digest in digests if item.startswith(_THE_BODY))


def _interfaces(file: ComponentFile) -> dict[str, Interface]:
    """Interfaces of a body by its component file."""
    arrays, found = file.arrays, dict[str, Interface]()
    for name, nodes in file.interfaces.items():
        row_node, component = (arrays[f"interfaces/{name}/{part}"] for part in ("node", "component"))
        frames = [arrays["nodes/frame"][arrays["nodes/id"] == node] for node in nodes]
        found[name] = Interface(
            name,
            np.array(nodes, dtype=np.int64),
            tuple(tuple(component[row_node == node].tolist()) for node in nodes),
            arrays[f"interfaces/{name}/position"],
            arrays[f"interfaces/{name}/frame"],
            np.concatenate(frames),
        )
    return found


def _joints(scene: Scene, configuration: Configuration, bodies: tuple[SceneBody, ...]) -> tuple[SceneJoint, ...]:
    """Joints with their axes on both bodies, and the bodies that they carry."""
    by_name = {body.name: body for body in bodies}
    _, inboard_of = joint_tree(scene)
    outboard = {joint.name: name for name, joint in inboard_of.items()}
    found, placed = [], {body.name: body.placement for body in bodies}
    for joint in scene.joints:
        values = np.array([configuration.angles.get((joint.name, dof), 0.0) for dof in range(6)])
        if joint.name not in outboard:
            values = closing_motion(by_name, scene, placed, joint)
        face = by_name[joint.first.body].interfaces[joint.first.name]
        # Both interfaces of a locked motion have it: the run has checked it.
        turning = motion_axes(by_name, scene, placed, joint, FIRST_ROTATION)
        about = turning @ placed[joint.first.body].rotation
        moving = [available(face, k, face.frame)[:3] + available(face, k, about)[3:] for k in range(face.node.size)]
        found.append(
            SceneJoint(
                joint.at(configuration.parameters),
                face.frame,
                turning @ placed[joint.second.body].rotation,
                values,
                tuple(tuple(dof for dof in range(6) if can[dof] and dof not in joint.free) for can in moving),
                joint_arms(by_name, placed, joint),
                outboard.get(joint.name, ""),
            )
        )
    return tuple(found)
