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

__all__ = ["BALL", "BEAM", "GIMBAL", "ROBOT", "assembled", "finished", "finished_robot", "linear", "pulse"]

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

# Rigid bodies joined by a ball with unlike springs, along the axes of a frame.
BALL = """\
name: ball
output: {output}
components:
  base:
    rigid: {{mass: 5, cg: [0.1, 0, 0.05], inertia: [0.4, 0.5, 0.3, 0.02, 0, 0.01]}}
    interfaces:
      h: {{position: [0.1, 0.2, 0.3], frame: {{axis: [0, 1, 1], angle: 20 deg}}}}
      wall: {{position: [0, 0, 0]}}
  pod:
    rigid: {{mass: 2, cg: [0.2, 0.3, 0.2], inertia: [0.05, 0.06, 0.07, 0.01, 0.002, 0]}}
    interfaces: {{h: {{position: [0.1, 0.2, 0.3]}}}}
scene:
  band: 20 Hz
  ground: [base.wall]
  joints:
    j:
      connect: [base.h, pod.h]
      free: [rx, ry, rz]
      stiffness: {{rx: 20 N*m/rad, ry: 30 N*m/rad, rz: 25 N*m/rad}}
  actuators: {{one: {{joint: j, dof: rx}}, two: {{joint: j, dof: ry}}}}
  sensors: {{a: {{joint: j, dof: rx}}, b: {{joint: j, dof: ry}}, c: {{joint: j, dof: rz}}}}
write: {{formats: [hdf5]}}
"""

# A turned universal joint with an arm on a flexible body, and a turned ball; ENDS, EARLIER and LATER are open.
GIMBAL = """\
name: gimbal
output: {output}
components:
  arm:
    stiffness: {{file: arm.op4, matrix: KAA}}
    mass: {{file: arm.op4, matrix: MAA}}
    geometry: arm.bdf
    interfaces: {{root: {{node: 1, frame: {{axis: [1, 2, 3], angle: 50 deg}}}}, tip: {{node: 5}}}}
    damping: {{modal: 0.02}}
    place: {{at: [0.1, 0.2, 0.3], rotate: {{axis: [1, 0, 2], angle: 35 deg}}}}
  mount:
    rigid: {{mass: 5, cg: [0.1, 0, 0.05], inertia: [0.4, 0.5, 0.6, 0.02, 0, 0.01]}}
    interfaces: {{
      h: {{position: [0.1, 0.2, 0.3], frame: {{axis: [0, 1, 1], angle: 20 deg}}}}, wall: {{position: [0, 0, 0]}}}}
  pod:
    rigid: {{mass: 2, cg: [0.2, 0.1, -0.1], inertia: [0.05, 0.06, 0.07, 0.01, 0.002, 0]}}
    interfaces: {{socket: {{position: [0, 0, 0]}}}}
    place: {{at: [0.924708667, 0.566979361, 0.387645666], rotate: {{axis: [1, 0, 2], angle: 35 deg}}}}
scene:
  band: 20 Hz
  base: mount
  ground: [mount.wall]
  joints:
    cross:
      connect: [ENDS]
      free: [EARLIER, LATER]
      stiffness: {{EARLIER: 40 N*m/rad, LATER: 90 N*m/rad}}
      damping: {{EARLIER: 0.3 N*m*s/rad, LATER: 0.2 N*m*s/rad}}
      inertia: {{EARLIER: 0.02 kg*m^2}}
    ball:
      connect: [arm.tip, pod.socket]
      offset: [0.1, -0.1, 0.05]
      free: [rx, ry, rz]
      stiffness: {{rx: 20 N*m/rad, ry: 30 N*m/rad, rz: 25 N*m/rad}}
      damping: {{ry: 0.1 N*m*s/rad}}
  articulation: [{{cross.EARLIER: 25 deg, cross.LATER: 50 deg, ball.rx: 30 deg, ball.ry: -40 deg, ball.rz: 20 deg}}]
  actuators:
    one: {{joint: cross, dof: EARLIER}}
    two: {{joint: cross, dof: LATER}}
    three: {{joint: ball, dof: rz}}
  sensors:
    first: {{joint: cross, dof: EARLIER}}
    second: {{joint: cross, dof: LATER}}
    first_rate: {{joint: cross, dof: EARLIER, rate: true}}
    second_rate: {{joint: cross, dof: LATER, rate: true}}
    third: {{joint: ball, dof: ry}}
    third_rate: {{joint: ball, dof: rz, rate: true}}
    pod: {{at: pod.cg, measure: [x, y, z, rx]}}
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
