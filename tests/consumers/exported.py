"""Scenes that are exported to several programs, and what their small motions must be by system.h5."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy.linalg as la

from cmsreduce.config import load_pipeline
from cmsreduce.pipeline import Run, execute
from tests.pipeline.study import Log, arm, panel, write_body

__all__ = ["BEAM", "ROBOT", "assembled", "finished", "finished_robot", "linear", "pulse"]

# A joint of every kind: two axes with springs, an arm, a slide, a weld, a ring closed by a ball; ground; a copy.
ROBOT = """\
name: robot
output: {output}
components:
  arm:
    stiffness: {{file: arm.op4, matrix: KAA}}
    mass: {{file: arm.op4, matrix: MAA}}
    geometry: arm.bdf
    interfaces: {{root: {{node: 1}}, tip: {{node: 5, frame: {{axis: x, angle: 25 deg}}}}}}
    damping: {{modal: 0.02}}
  copy: {{like: arm, place: {{at: [0, 0.3, 0], rotate: {{axis: x, angle: 40 deg}}}}}}
  panel:
    stiffness: {{file: panel.op4, matrix: KAA}}
    mass: {{file: panel.op4, matrix: MAA}}
    geometry: panel.bdf
    interfaces: {{root: {{node: 1}}}}
    damping: {{modal: 0.01}}
  base:
    rigid: {{mass: 9, cg: [0, 0, 0.1], inertia: [0.2, 0.3, 0.25, 0.01, 0, 0]}}
    interfaces: {{a: {{position: [0, 0, 0]}}, b: {{position: [0, 0.3, -0.1]}}, feet: {{position: [0, 0, 0.2]}}}}
scene:
  band: 60 Hz
  base: base
  joints:
    shoulder:
      connect: [base.a, arm.root]
      free: [ry, rz]
      stiffness: {{ry: 30 N*m/rad, rz: 20 N*m/rad}}
      damping: {{rz: 0.1 N*m*s/rad}}
      inertia: {{ry: 2e-2 kg*m^2}}
    rail: {{connect: [base.b, copy.root], offset: [0, 0, 0.1], free: [y], stiffness: {{y: 900 N/m}}}}
    wrist:
      connect: [arm.tip, panel.root]
      free: [rx]
      stiffness: {{rx: 3 N*m/rad}}
      damping: {{rx: 0.02 N*m*s/rad}}
      inertia: {{rx: 1e-3 kg*m^2}}
  articulation: [{{wrist: 0}}, {{wrist: 65 deg, rail.y: 0.05}}]
  ground: [base.feet]
  actuators:
    motor: {{joint: wrist, dof: rx}}
    lead: {{joint: rail}}
    push: {{at: arm.3, force: [1, 2, -1]}}
    twist: {{at: panel.5, torque: [0, 1, 1]}}
    cable: {{between: [arm.2, panel.6]}}
    shaped: {{rows: {{arm.3.z: 1.0, panel.6.ry: -0.1}}}}
  sensors:
    station: {{at: arm.3, measure: [y, rz]}}
    speed: {{at: panel.6, measure: [y], rate: true}}
    gyro: {{at: panel.5, measure: [rx, ry], rate: true}}
    turned: {{joint: wrist}}
    slide: {{joint: rail, rate: true}}
    stretch: {{between: [arm.4, panel.6]}}
    sight: {{rows: {{panel.6.x: 1.0, arm.2.ry: -0.3}}}}
reduce: {{cutoff: 3}}
write: {{formats: [hdf5]}}
"""

BEAM = """\
name: spin-up
output: {output}
components:
  hub:
    rigid: {{mass: 1, inertia: [1, 1, 1, 0, 0, 0]}}
    interfaces: {{axle: {{position: [0, 0, 0]}}, wall: {{position: [0, 0, 0]}}}}
  beam:
    stiffness: {{file: beam.op4, matrix: KAA}}
    mass: {{file: beam.op4, matrix: MAA}}
    geometry: beam.bdf
    interfaces: {{root: {{node: 1}}}}
scene:
  band: 50 Hz
  ground: hub.wall
  joints: {{axle: {{connect: [hub.axle, beam.root], free: [rz]}}}}
  actuators: {{motor: {{joint: axle}}}}
  sensors:
    angle: {{joint: axle}}
    tip: {{at: beam.9, measure: [x, y]}}
reduce: {{cutoff: 2}}
write: {{formats: [hdf5], frame: {{kind: clamped, at: root}}}}
"""


def finished(folder: Path, text: str) -> Path:
    """Run directory of a pipeline."""
    path = folder / "scene.yaml"
    path.write_text(text.format(output=folder / "out"))
    pipeline = load_pipeline(path)
    execute(Run(pipeline, pipeline.output, Log()), path, report=False)
    return pipeline.output


def finished_robot(folder: Path) -> Path:
    """Run directory of the scene with a joint of every kind."""
    for body in (arm(), panel()):
        write_body(folder, body)
    return finished(folder, ROBOT)


def assembled(run: Path, number: int) -> tuple[str, dict[str, Any]]:
    """Name and matrices of a configuration in system.h5."""
    with h5py.File(run / "system.h5") as file:
        group = file[f"configuration_{number}"]
        return group.attrs["name"], {name: item[()] for name, item in group.items() if hasattr(item, "shape")}


def pulse(size: float, period: float) -> Callable[[float], float]:
    return lambda t: size * float(np.sin(np.pi * t / period) ** 2) if t < period else 0.0


def linear(system: dict[str, Any], laws: list[Callable[[float], float]], times: np.ndarray) -> np.ndarray:
    """Outputs of M x'' + D x' + K x = B u from rest, by exact steps of a u that is linear in each."""
    M, K, B = system["M"], system["K"], system["B"]
    n, D = len(M), system.get("D", np.zeros_like(M))
    lu = la.cho_factor(M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-la.cho_solve(lu, K), -la.cho_solve(lu, D)]])
    G = np.vstack([np.zeros((n, B.shape[1])), la.cho_solve(lu, B)])
    h, u = times[1] - times[0], np.array([[law(t) for law in laws] for t in times])
    m = G.shape[1]
    step = la.expm(h * np.block([[A, G, np.zeros_like(G)], [np.zeros((2 * m, 2 * n)), np.eye(2 * m, k=m) / h]])[:, :])
    x, states = np.zeros(2 * n), []
    for now, then in zip(u, [*u[1:], u[-1]], strict=True):
        states.append(x)
        x = (step @ np.concatenate([x, now, then - now]))[: 2 * n]
    return np.array(states) @ np.hstack([system["C1"], system["C2"]]).T
