"""Three beams in a row, 54 dofs each, with two hinges that turn independently, on disk."""

from __future__ import annotations

from pathlib import Path

from tests.frames import line
from tests.pipeline.study import write_body

__all__ = ["write_beam_chain"]

BODY = """\
  {name}:
    stiffness: {{file: {name}.op4, matrix: KAA}}
    mass: {{file: {name}.op4, matrix: MAA}}
    geometry: {name}.bdf
    interfaces: {{inner: {{node: 1}}, outer: {{node: 9}}}}
    damping: {{modal: 0.005}}
"""
SCENE = """\
scene:
  band: 200 Hz
  joints:
    first: {connect: [a.outer, b.inner], free: [ry]}
    second: {connect: [b.outer, c.inner], free: [rz]}
  articulation: {first: [0, 90 deg], second: [-60 deg, 60 deg]}
  actuators: {lift: {joint: first, dof: ry}, turn: {joint: second, dof: rz}}
  sensors:
    first: {joint: first, dof: ry}
    second: {joint: second, dof: rz}
    tip: {at: c.9, measure: [y, z]}
reduce: {method: craig-bampton, cutoff: 16}
balance: {keep: all}
verify: {limits: {frf_error: 0.02, db_error: 1.0}}
write: {formats: [hdf5]}
"""


def write_beam_chain(folder: Path) -> Path:
    """Write the beams and a pipeline of all three; return the pipeline file."""
    for name, start, end in (("a", 0.0, 0.8), ("b", 0.8, 1.6), ("c", 1.6, 2.2)):
        write_body(folder, line(name, [start, 0, 0], [end, 0, 0], 8))
    path = folder / "chain.yaml"
    path.write_text("name: chain\noutput: out\ncomponents:\n" + "".join(BODY.format(name=n) for n in "abc") + SCENE)
    return path
