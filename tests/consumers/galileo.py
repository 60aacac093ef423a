"""Rotor and stator of the Galileo sample, joined at the spin bearing alone: two flexible bodies that float freely."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from pathlib import Path

import numpy as np

from cmsreduce.assemble import assemble, system_modes
from cmsreduce.config import load_pipeline
from cmsreduce.model import Configuration, ModalComponent
from cmsreduce.pipeline import Run, Silent
from tests.consumers.bodies import ALL, clamped, modes, npz
from tests.consumers.exudyn_scene import Body, ExudynScene

__all__ = ["Galileo"]

SAMPLE = Path(__file__).parents[2] / "sample_models" / "galileo"
PIPELINE = """
name: galileo_pair
output: run
components:
  stator:
    stiffness: {{file: {sample}/stator.op4, matrix: KAA}}
    mass: {{file: {sample}/stator.op4, matrix: MAA}}
    geometry: {{file: {sample}/stator.bdf}}
    interfaces: {{spin_bearing: {{node: 2001}}}}
    damping: {{modal: 0.005}}
  rotor:
    stiffness: {{file: {sample}/rotor.op4, matrix: KAA}}
    mass: {{file: {sample}/rotor.op4, matrix: MAA}}
    geometry: {{file: {sample}/rotor.bdf}}
    interfaces: {{spin_bearing: {{node: 1001}}}}
    damping: {{modal: 0.005}}
scene:
  band: 10 Hz
  joints: {{spin: {{connect: [stator.spin_bearing, rotor.spin_bearing], free: [rz]}}}}
  articulation: {{spin: [0, 45, 90, 225 deg]}}
  actuators: {{motor: {{joint: spin, dof: rz}}}}
  sensors: {{gyro: {{at: stator.2002, measure: [rx, ry, rz]}}}}
reduce: {{method: craig-bampton, cutoff: 2.0}}
balance: {{rank: gregory, keep: {{modes: {{rotor: 19, stator: 10}}}}}}
"""
SPIN_AXIS = 5


class Galileo:
    """Modes of the pair and the scenes they act in.

    Parameters
    ----------
    folder : Path
        Files are written here.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        file = folder / "pair.yaml"
        file.write_text(PIPELINE.format(sample=SAMPLE))
        self.run = Run(load_pipeline(file), folder / "run", Silent())

    @cached_property
    def ranked(self) -> dict[str, ModalComponent]:
        """Modes of both bodies that Gregory's coefficient ranks first: 19 and 10."""
        return dict(self.run.kept)

    @cached_property
    def reduced(self) -> dict[str, ModalComponent]:
        """All modes of both bodies' Craig-Bampton sets to 20 Hz, twice the band."""
        return {name: self.run.modal(name) for name in self.run.bodies}

    @cached_property
    def full(self) -> dict[str, ModalComponent]:
        """Every mode of both bodies: as many as they have dofs."""
        return {name: modes(part.body, ALL) for name, part in self.run.bodies.items()}

    @property
    def settings(self) -> tuple[Configuration, ...]:
        """Configurations of the spin bearing."""
        return tuple(self.run.scene.configurations)

    @staticmethod
    def angle(setting: Configuration) -> float:
        """Angle of the spin bearing in rad."""
        return float(setting.angles["spin", SPIN_AXIS])

    def omega(self, components: Mapping[str, ModalComponent] | None, setting: Configuration) -> np.ndarray:
        """Elastic frequencies of the assembled system in rad/s, by cmsreduce; of the unreduced bodies if None."""
        scene = self.run.scene
        parts = {}
        for name, part in self.run.bodies.items():
            if components is None:
                parts[name] = part.substructure(scene)
            else:
                parts[name] = part.substructure(scene, components[name])
        return system_modes(assemble(parts, scene, setting), ALL)[0]

    def mesh_node(self, name: str, node: int) -> int:
        """Number that Exudyn gives a node of a body."""
        return int(np.searchsorted(np.unique(self.run.bodies[name].body.dofs.node), node))

    def scene(self, components: Mapping[str, ModalComponent], angle: float) -> tuple[ExudynScene, Body, Body]:
        """Exudyn's scene with the rotor turned by an angle in rad: scene, stator, rotor.

        Both bodies are clamped at the bearing, so that the frames that Exudyn moves are the two sides of the joint: a
        marker on one node of a flexible body has no rotation there.
        """
        scene = ExudynScene()
        c, s = np.cos(angle), np.sin(angle)
        turned = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        stator, rotor = (
            scene.add(npz(self.folder, clamped(components[name], "spin_bearing")), rotationMatrixRef=axes)
            for name, axes in (("stator", np.eye(3)), ("rotor", turned))
        )
        scene.join(stator.marker, rotor.marker, free=[SPIN_AXIS])
        return scene, stator, rotor
