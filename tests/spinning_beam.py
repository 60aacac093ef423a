"""The spun beam of the verification library (theory section 9) on disk: matrices, a deck with bars, a pipeline."""

from __future__ import annotations

from pathlib import Path

from cmsreduce.model import FEModel
from tests.frames import Section, line

__all__ = ["BEAM", "LENGTH", "PIPELINE", "beam", "write_beam"]

LENGTH, WIDTH, HEIGHT, E, RHO, NU = 2.0, 0.01, 0.02, 6.895e10, 2500.0, 0.3
BEAM = Section(
    E=E,
    G=E / 2 / (1 + NU),
    A=WIDTH * HEIGHT,
    Iy=WIDTH**3 * HEIGHT / 12,
    Iz=WIDTH * HEIGHT**3 / 12,
    J=WIDTH**3 * HEIGHT * 0.229,
    rho=RHO,
)
"""Weak about y, so that it flaps along z when it spins about z, and bends along y in the plane of the spin."""

PIPELINE = """\
name: spun
output: {output}
components:
  beam:
    stiffness: {{file: beam.op4, matrix: KAA}}
    mass: {{file: beam.op4, matrix: MAA}}
    geometry: beam.bdf
    interfaces: {{root: {{node: 1}}, tip: {{node: {tip}}}}}
    damping: {{modal: 0.005}}
    geometric_stiffness: {{bars: all, held: root}}
scene:
  band: 60 Hz
  ground: beam.root
  spin: {{beam: {{rate: 10 rad/s, axis: z}}}}
  actuators:
    lift: {{at: beam.tip, force: [0, 1, 1]}}
  sensors:
    up: {{at: beam.tip, measure: [y, z]}}
reduce: {{method: craig-bampton, cutoff: 3}}
verify: {{frf: {{points: 20}}}}
write: {{formats: [hdf5]}}
"""


def beam(elements: int) -> FEModel:
    """The beam along x, free."""
    return line("beam", [0, 0, 0], [LENGTH, 0, 0], elements, section=BEAM, interfaces={"root": 1, "tip": elements + 1})


def write_beam(folder: Path, elements: int = 20, text: str = PIPELINE, cards: str = "") -> Path:
    """Write the beam, its deck and the pipeline file, whose output is ``out`` beside it."""
    from pyyeti.nastran import op4

    body = beam(elements)
    assert body.nodes is not None
    op4.write(str(folder / "beam.op4"), {"KAA": body.K.toarray(), "MAA": body.M.toarray()})
    lines = ["BEGIN BULK"]
    for node, (x, y, z) in zip(body.nodes.id, body.nodes.xyz, strict=True):
        lines.append(f"GRID,{node},,{x:.12f},{y:.1f},{z:.1f}")
    lines += [f"CBAR,{k},7,{k},{k + 1},0.,1.,0." for k in range(1, elements + 1)]
    lines += [f"PBAR,7,3,{BEAM.A:.8E},{BEAM.Iz:.8E},{BEAM.Iy:.8E},{BEAM.J:.8E}", f"MAT1,3,{E:.6E},,{NU},{RHO}"]
    (folder / "beam.bdf").write_text("\n".join(lines) + "\n" + cards + "ENDDATA\n")
    path = folder / "spun.yaml"
    path.write_text(text.format(output=folder / "out", tip=elements + 1))
    return path
