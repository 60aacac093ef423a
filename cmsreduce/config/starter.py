"""The commented example of a pipeline."""

from __future__ import annotations

from cmsreduce.config.keys import check_name
from cmsreduce.errors import ConfigError

__all__ = ["checked_name", "starter_pipeline"]

_STARTER = """\
# A cmsreduce pipeline. `cmsreduce run NAME.yaml` runs it, `cmsreduce schema` lists every key.
# File names are relative to this file; `output` is relative to where the command is run.
name: "NAME"
output: "build/NAME"
# include: [configs/default.yaml]        # shared keys to start from; this file wins over them

components:
  rotor:                                  # a flexible body: matrices and the deck they came from
    stiffness: {file: rotor.op4, matrix: KAA}
    mass: {file: rotor.op4, matrix: MAA}
    geometry: rotor.bdf                   # grids, coordinate frames, sets; they prove the order of the rows
    # rows: a                             # set of the deck, or a dof list, where the sources do not say
    # units: mm-t-s                       # of the matrices; by default those of the scene
    interfaces:
      bearing: {node: 1001}               # all six dofs; or {nodes: [7, 8, 9], dofs: 123}, {set: b}
    damping: {modal: 0.005}               # or table, per_mode, rayleigh, structural, matrix
  hub:                                    # a rigid body
    rigid: {mass: 120.0, cg: [0, 0, 0.2], inertia: [10, 12, 8, 0, 0, 0]}    # xx yy zz xy xz yz about the cg
    interfaces:
      shaft: {position: [0, 0, 0]}

scene:
  band: 10 Hz                             # accuracy is asked for up to here
  base: hub                               # the body that articulation does not move
  joints:
    spin: {connect: [hub.shaft, rotor.bearing], free: [rz]}      # the other five dofs are locked
  articulation:
    spin: [0, 45, 90 deg]                 # assembled and checked at each
  actuators:
    motor: {joint: spin, dof: rz}         # or {at: rotor.1200, force: [0, 0, 1]}, {between: [a.1, b.2]}, {rows: ...}
  sensors:
    gyro: {at: hub.cg, measure: [rx, ry, rz], rate: true}

reduce: {method: craig-bampton, cutoff: 2.0}     # modes up to cutoff x band
balance: {rank: gregory, keep: limits}    # the fewest modes that meet the limits below; or all, {modes: 20}
verify:
  frf: {points: 400}
  # A broken limit fails the run. db_error: 1.0 asks for zeros and anti-resonances, too, and so for more modes.
  limits: {frf_error: 0.05, frequency_error: 1e-3}
write: {formats: [hdf5]}
"""


def starter_pipeline(name: str) -> str:
    """Text of a pipeline file with one flexible and one rigid body, every choice commented.

    Parameters
    ----------
    name : str
        Name of the study: letters, digits, _ and -.

    Raises
    ------
    ConfigError
        If the name cannot stand in a file name.
    """
    return _STARTER.replace("NAME", checked_name(name))


def checked_name(name: str) -> str:
    """The name of a study, which may stand in a file name.

    Raises
    ------
    ConfigError
        If it may not.
    """
    try:
        return check_name(name)
    except ValueError as error:
        raise ConfigError(str(error)) from None
