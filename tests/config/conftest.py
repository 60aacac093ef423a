"""A pipeline with every part of the grammar, as a file to load and to break."""

from collections.abc import Callable
from pathlib import Path

import pytest

GALILEO = """\
name: galileo
output: build/galileo
include: [../configs/default.yaml]

components:
  rotor:
    stiffness: {file: ../sample_models/galileo/rotor.op4, matrix: KAA}
    mass:      {file: ../sample_models/galileo/rotor.op4, matrix: MAA}
    geometry:  {file: ../sample_models/galileo/rotor.bdf}
    interfaces: {spin_bearing: {node: 1001}}
    damping: {modal: 0.005}
    reduce: {method: guyan}
  stator:
    extseout: ../bodies/stator
    interfaces:
      spin_bearing: 7
      platform_hinge: {nodes: [7, 8, 9], dofs: 123}
    damping: {structural: 0.01}
    units: mm-t-s
  platform:
    rigid: {mass: 120.0, cg: [0, 0, 0.2], inertia: [10, 12, 8, 0.5, 0, -1]}
    interfaces: {hinge: {position: [0, 0, 0]}}

scene:
  band: 10 Hz
  joints:
    spin: {connect: [stator.spin_bearing, rotor.spin_bearing], free: [rz]}
    cone: {connect: [stator.platform_hinge, platform.hinge], free: [ry]}
  articulation: {spin: [0, 45, 90 deg], cone: [0, 30 deg]}
  actuators:
    motor: {joint: spin, dof: rz}
    thruster: {at: rotor.1200, force: [0, 0, 1]}
  sensors:
    gyro: {at: platform.cg, measure: [rx, ry, rz], rate: true}
    los: {rows: {rotor.1300.x: 1.0, stator.12.ry: -2.0}}

reduce: {cutoff: 3.0}
balance: {rank: gregory, keep: {frf_error: 0.01}}
write: {formats: [hdf5]}
"""

DEFAULTS = """\
reduce: {method: craig-bampton, cutoff: 2.0}
verify:
  frf: {points: 300}
  limits: {frf_error: 0.05, db_error: 1.0, frequency_error: 1e-3}
"""


@pytest.fixture
def galileo(tmp_path: Path) -> Path:
    """Write the pipeline of the three bodies and the file it includes."""
    for name, text in (("pipelines/galileo.yaml", GALILEO), ("configs/default.yaml", DEFAULTS)):
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).write_text(text)
    return tmp_path / "pipelines" / "galileo.yaml"


@pytest.fixture
def edited(galileo: Path) -> Callable[[str, str], Path]:
    """Replace one text of the pipeline by another."""

    def edit(old: str, new: str) -> Path:
        text = galileo.read_text()
        assert text.count(old) == 1, f"{old!r} stands {text.count(old)} times in the pipeline"
        galileo.write_text(text.replace(old, new))
        return galileo

    return edit
