"""A small study on disk: two frames of bars and a rigid hub, as matrices, decks and a pipeline file."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.model import FEModel
from tests.frames import frame, line

__all__ = [
    "ARM",
    "ARM_FILES",
    "CANTILEVER",
    "PANEL",
    "PIPELINE",
    "RIGID_PANEL",
    "Log",
    "arm",
    "panel",
    "system_frequencies",
    "write_body",
    "write_study",
]

ARM_FILES = """\
  arm:
    stiffness: {{file: arm.op4, matrix: KAA}}
    mass: {{file: arm.op4, matrix: MAA}}
    geometry: arm.bdf
"""
ARM = (
    ARM_FILES
    + """\
    interfaces: {{root: {{node: 1}}, tip: {{node: 5}}}}
    damping: {{modal: 0.01}}
"""
)
PANEL = """\
  panel:
    stiffness: {{file: panel.op4, matrix: KAA}}
    mass: {{file: panel.op4, matrix: MAA}}
    geometry: panel.bdf
    interfaces: {{root: {{node: 1}}}}
    damping: {{modal: 0.01}}
"""

PIPELINE = (
    """\
name: study
output: {output}

components:
"""
    + ARM
    + PANEL
    + """\
  hub:
    rigid: {{mass: 5.0, cg: [-0.1, 0, 0.05], inertia: [0.2, 0.3, 0.25, 0.01, 0, 0]}}
    interfaces: {{face: {{position: [0, 0, 0]}}, back: {{position: [-0.2, 0, 0]}}}}

scene:
  band: 60 Hz
  base: hub
  joints:
    weld: {{connect: [hub.face, arm.root]}}
    hinge: {{connect: [arm.tip, panel.root], free: [ry]}}
  articulation:
    hinge: [0, 50 deg]
  actuators:
    motor: {{joint: hinge, dof: ry}}
    thruster: {{at: hub.cg, force: [0, 1, 1]}}
  sensors:
    gyro: {{at: hub.cg, measure: [ry, rz], rate: true}}
    probe: {{at: panel.6, measure: [z]}}

reduce: {{method: craig-bampton, cutoff: 15}}
balance: {{rank: gregory, keep: all}}
verify:
  frf: {{points: 60}}
  limits: {{frf_error: 0.05}}
write: {{formats: [hdf5]}}
"""
)

RIGID_PANEL = PIPELINE.replace("panel.6", "panel.end").replace(
    PANEL,
    """\
  panel:
    rigid: {{mass: 2.0, cg: [1.2, 0.1, 0.05], inertia: [0.05, 0.2, 0.2, 0, 0, 0]}}
    interfaces: {{root: {{position: [0.8, 0, 0]}}, end: {{position: [1.75, 0.125, 0.05]}}}}
""",
)
"""The study with one flexible body."""

CANTILEVER = (
    """\
name: cantilever
output: {output}
components:
"""
    + ARM_FILES
    + """\
    interfaces: {{root: {{node: 1}}}}
    damping: {{modal: 0.01}}
scene:
  band: 200 Hz
  ground: arm.root
  actuators:
    lift: {{at: arm.5, force: [0, 0, 1]}}
    push: {{at: arm.5, force: [0, 1, 0]}}
  sensors:
    up: {{at: arm.5, measure: z}}
    across: {{at: arm.4, measure: y}}
reduce: {{cutoff: 8}}
balance: {{keep: {{frf_error: 0.01}}}}
"""
)
"""The arm alone, held at its root and shaken at its tip in two directions; its lump is on its axis, so that bending in
either plane, stretching and twisting do not couple."""


def arm() -> FEModel:
    """A straight bar of four elements along x, 0.8 m, with a lump in its middle."""
    return line("arm", [0, 0, 0], [0.8, 0, 0], 4, masses={3: 0.3})


def panel() -> FEModel:
    """Two bars at an angle, and a third across, from the end of the arm."""
    xyz = [[0.8, 0, 0], [1.1, 0, 0], [1.4, 0, 0], [1.4, 0.25, 0.1], [1.4, 0.5, 0.2], [1.75, 0.125, 0.05]]
    return frame("panel", xyz, [(1, 2), (2, 3), (3, 4), (4, 5), (3, 6)], {"root": 1})


def write_body(folder: Path, body: FEModel, *, length: float = 1.0, mass: float = 1.0) -> None:
    """Write a body as an OP4 file with KAA and MAA and a deck of grids, in units so many times smaller than SI.

    ``length=1e3, mass=1e-3`` is millimetres and tonnes. A force in the new units is m l / t^2 old ones.
    """
    from pyyeti.nastran import op4

    assert body.nodes is not None
    # Energy is m l^2; a translation of one new unit is 1 / l of the old one, a rotation is what it was.
    scale = np.where(body.dofs.component <= 3, 1 / length, 1.0)
    K, M = (mass * length**2 * A.toarray() * np.outer(scale, scale) for A in (body.K, body.M))
    op4.write(str(folder / f"{body.name}.op4"), {"KAA": K, "MAA": M})
    cards = []
    for node, xyz in zip(body.nodes.id, body.nodes.xyz * length, strict=True):
        x, y, z = (f"{value:.9E}".rjust(16) for value in xyz)
        cards.append(f"GRID*   {node:16d}{'':16}{x}{y}\n*       {z}\n")
    (folder / f"{body.name}.bdf").write_text("BEGIN BULK\n" + "".join(cards) + "ENDDATA\n")


def system_frequencies(path: Path) -> np.ndarray:
    """Frequencies in Hz of the first configuration in a system.h5, the rigid ones first."""
    with h5py.File(path) as file:
        group = file["configuration_0"]
        if "frequency_hz" in group:
            return group["frequency_hz"][()]
        parts = {
            name: [group[name][part][()] for part in ("data", "indices", "indptr", "shape")] for name in ("K", "M")
        }
    K, M = (sp.csc_array(tuple(arrays), shape=tuple(shape)) for *arrays, shape in parts.values())
    squared = la.eigvalsh(K.toarray(), M.toarray())
    return np.sqrt(np.maximum(squared, 0.0)) / (2 * np.pi)


def write_study(folder: Path, text: str = PIPELINE) -> Path:
    """Write both bodies and the pipeline file, whose output is ``out`` beside it."""
    for body in (arm(), panel()):
        write_body(folder, body)
    path = folder / "study.yaml"
    path.write_text(text.format(output=folder / "out"))
    return path


class Log:
    """Listener that keeps what was done and what was reused, as ``stage what``."""

    def __init__(self) -> None:
        self.done: list[str] = []
        self.reused_: list[str] = []
        self.notes: list[str] = []

    def stage(self, stage: str, what: str) -> None:
        self.done.append(f"{stage} {what}")

    def reused(self, stage: str, what: str) -> None:
        self.reused_.append(f"{stage} {what}")

    def advance(self, done: int, total: int) -> None:
        assert 0 < done <= total

    def note(self, text: str) -> None:
        self.notes.append(text)
