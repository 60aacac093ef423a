"""Draft pipelines: a commented example, and a pipeline for one body from its files."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cmsreduce.config.keys import check_name
from cmsreduce.errors import ConfigError

__all__ = [
    "BodyDraft",
    "body_pipeline",
    "starter_pipeline",
]

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
balance: {rank: gregory, keep: {frf_error: 0.01}}         # or keep: all, {modes: 20}, {bound: 0.05}
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
    try:
        check_name(name)
    except ValueError as error:
        raise ConfigError(str(error)) from None
    return _STARTER.replace("NAME", name)


_TEXT = """\
# A cmsreduce pipeline for one body: the reduced body is checked under loads at its interface, floating free.
# Lines marked CHECK hold a choice that the files cannot make for you. `cmsreduce schema` lists every key.
name: "{name}"
output: "build/{name}"

components:
  {name}:
{sources}
    # units: mm-t-s                       # of the files: length-mass-time; by default those of the scene
    {grounded}
    interfaces:
      # CHECK: the grid your joint holds; all dofs it has, or {{nodes: [7, 8], dofs: 123}}, {{set: b}}
      mount: {interface}
    damping: {{modal: 0.005}}               # CHECK: damping ratio of every mode

scene:
  # units: m-kg-s                         # of this file and of all results
  # CHECK: accuracy is asked for up to here{elastic}
  band: {band}
  actuators:                              # loads on the body in your system
{actuators}
  sensors:                                # motions that matter to your system
    mount_motion: {{at: {name}.{node}, measure: [{axes}]}}
    far_motion: {{at: {name}.{far}, measure: [{axes}]}}    # the grid farthest from the mount

reduce:
  method: macneal-rubin                   # or craig-bampton, if the mount holds the body
  cutoff: 3.0                             # modes up to cutoff x band
  residuals: [sensors]                    # static shapes for sensors away from the mount
balance: {{rank: gregory, keep: all}}     # ranked, all kept; in your own scene: keep: {{frf_error: 0.01}}
verify:
  limits:                                 # a broken limit fails the run: exit code 1
    frf_error: 0.05                       # of all responses over the band, resonances above all
    db_error: 1.0                         # at any frequency, between resonances too
    frequency_error: 1e-3
    static_lack: 0.01                     # share of strain energy missed under loads at the mount
write: {{formats: [hdf5]}}
"""
# In multiples of the first elastic frequency: below that frequency, a rigid body would be enough.
_BAND_OF_FIRST_MODE = 5.0
_UNKNOWN_BAND = "10 Hz"
_FREE = "# grounded: true                      # if the matrices hold the body to the ground"
_GROUNDED = "grounded: true                        # CHECK: the matrices hold the body to the ground"


@dataclass(frozen=True)
class BodyDraft:
    """Data of a body from its files, for a draft pipeline.

    Parameters
    ----------
    stiffness, mass : tuple of Path and str
        File and name of each matrix; the name is empty where the file has only one without a name.
    geometry : Path, optional
        Deck or mesh.
    extseout : Path, optional
        Stem of a NASTRAN external superelement, which stands for the matrices and the geometry.
    interface : str
        Proposed interface, as YAML.
    node, far : int
        A node of the interface, and the node farthest from it.
    axes : str
        Translations of the node, such as ``xyz``.
    elastic_hz : float, optional
        First elastic frequency of the free body in Hz.
    remark : str
        Reason why the files do not fit together; empty if they do.
    grounded : bool
        True if the ground holds the body and the geometry does not say so.
    """

    stiffness: tuple[Path, str]
    mass: tuple[Path, str]
    geometry: Path | None = None
    extseout: Path | None = None
    interface: str = "{node: 1}"
    node: int = 1
    far: int = 1
    axes: str = "xyz"
    elastic_hz: float | None = None
    remark: str = ""
    grounded: bool = False


def body_pipeline(name: str, draft: BodyDraft) -> str:
    """Text of a pipeline file for one body, complete enough to run.

    Parameters
    ----------
    name : str
        Name of the study and of the body: letters, digits, _ and -.
    draft : BodyDraft
        Data from its files.

    Raises
    ------
    ConfigError
        If the name cannot stand in a file name, or is ``system``.
    """
    try:
        check_name(name)
    except ValueError as error:
        raise ConfigError(str(error)) from None
    if name.lower() == "system":
        raise ConfigError("a component cannot be named 'system': that is the file of the assembled system")
    elastic, band = "", _UNKNOWN_BAND
    if draft.elastic_hz is not None:
        elastic = f"; the first elastic mode of the body is at {draft.elastic_hz:.4g} Hz"
        # Two digits without an exponent, because users edit this number.
        band = f"{float(f'{_BAND_OF_FIRST_MODE * draft.elastic_hz:.2g}'):g} Hz"
    forces = [
        f"    push_{axis}: {{at: {name}.{draft.node}, force: {[int(other == axis) for other in 'xyz']}}}"
        for axis in draft.axes
    ]
    return _TEXT.format(
        name=name,
        sources="\n".join(_sources(draft)),
        grounded=_GROUNDED if draft.grounded else _FREE,
        interface=draft.interface,
        band=band,
        elastic=elastic,
        actuators="\n".join(forces),
        node=draft.node,
        far=draft.far,
        axes=", ".join(draft.axes),
    )


def _sources(draft: BodyDraft) -> Sequence[str]:
    if draft.extseout is not None:
        return [f'    extseout: "{draft.extseout.as_posix()}"    # stem of the .asm, .pch and .op4 of a superelement']
    lines = [f"    {what}: {_matrix(*of)}" for what, of in (("stiffness", draft.stiffness), ("mass", draft.mass))]
    if draft.geometry is not None:
        lines.append(
            f'    geometry: "{draft.geometry.as_posix()}"    # grids, frames, sets; they prove the order of the rows'
        )
    return lines


def _matrix(file: Path, name: str) -> str:
    return f'{{file: "{file.as_posix()}"}}' if not name else f'{{file: "{file.as_posix()}", matrix: "{name}"}}'
