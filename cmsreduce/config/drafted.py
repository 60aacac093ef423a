"""Drafts of pipelines from files: for one body, and for bodies that are joined where they meet."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cmsreduce.config.starter import checked_name
from cmsreduce.errors import ConfigError

__all__ = ["BodyDraft", "body_pipeline", "scene_pipeline"]

_TEXT = """\
# A cmsreduce pipeline for one body: the reduced body is checked under loads at its interface, {support}.
# Lines marked CHECK hold a choice that the files cannot make for you. `cmsreduce schema` lists every key.
name: "{name}"
output: "build/{name}"

components:
{components}

scene:
  # units: m-kg-s                         # of this file and of all results
  # CHECK: accuracy is asked for up to here{elastic}
  band: {band}
  actuators:                              # loads on the body in your system
{actuators}
  sensors:                                # motions that matter to your system
    mount_motion: {{at: {name}.{point}, measure: [{axes}]}}
    far_motion: {{at: {name}.{far}, measure: [{axes}]}}    # the grid farthest from the mount

reduce:
  method: macneal-rubin                   # or craig-bampton, if the mount holds the body
  cutoff: 3.0                             # modes up to cutoff x band
  residuals: [sensors]                    # static shapes for sensors away from the mount
{rest}"""
_SCENE = """\
# A cmsreduce pipeline for bodies that are joined where they meet.
# Lines marked CHECK hold a choice that the files cannot make for you. `cmsreduce schema` lists every key.
name: "{name}"
output: "build/{name}"

components:
{components}

scene:
  # units: m-kg-s                         # of this file and of all results
  # CHECK: accuracy is asked for up to here{elastic}
  band: {band}
{joints}
  actuators:                              # loads on the bodies
{actuators}
  sensors:                                # motions that matter to you
{sensors}

reduce:
{method}
  cutoff: 3.0                             # modes up to cutoff x band
  residuals: [sensors]                    # static shapes for sensors away from the joints
{rest}"""
_HOLD = "  method: craig-bampton                   # joints hold the bodies"
_LEAVE_FREE = "  method: macneal-rubin                   # the joints leave motions of a body free, as balls do"
_REST = """\
balance: {rank: gregory, keep: all}     # ranked, all kept; in your own scene: keep: limits
verify:
  limits:                                 # a broken limit fails the run: exit code 1
    frf_error: 0.05                       # of all responses over the band, resonances above all
    db_error: 1.0                         # at any frequency, between resonances too
    frequency_error: 1e-3
    static_lack: 0.01                     # share of strain energy missed under loads at the interfaces
write: {formats: [hdf5]}
"""
_COMPONENT = """\
  {name}:
{sources}
    {units}
    {grounded}
    interfaces:
{interfaces}
{damping}"""
_DAMPING = "    damping: {modal: 0.005}               # CHECK: damping ratio of every mode"
_DAMPING_IN_FILES = "    # damping: {modal: 0.005}             # in place of the damping that the files hold"
_UNITS = "# units: mm-t-s                       # of the files: length-mass-time; by default those of the scene"
_FREE = "# grounded: true                      # if the matrices hold the body to the ground"
_HELD = "grounded: true    # CHECK: the matrices hold the body; the other nodes are in order"
_CHOICE = "all dofs it has, or {nodes: [7, 8], dofs: 123}, {set: b}, {near: [x, y, z], within: 2 mm}"
# In multiples of the first elastic frequency: below that frequency, a rigid body would be enough.
_BAND_OF_FIRST_MODE = 5.0
_UNKNOWN_BAND = "10 Hz"


@dataclass(frozen=True)
class BodyDraft:
    """Data of a body from its files, for a draft pipeline.

    Parameters
    ----------
    name : str
        Name of the component.
    stiffness, mass : tuple of Path and str
        File and name of each matrix; the name is empty where the file has only one without a name.
    geometry : Path, optional
        Deck or mesh.
    rows : Path, optional
        List of the dofs of the rows.
    extseout : Path, optional
        Stem of a NASTRAN external superelement, which stands for the matrices and the geometry.
    interfaces : tuple of (str, str, str)
        Interfaces in use: name, YAML, and what the place is.
    proposed : tuple of (str, str, str)
        Other places where the body could be joined, in the same form.
    point : str
        Point of the first interface that loads act on: a node, or the interface itself where nodes are tied.
    far : int
        The node farthest from the first interface.
    axes : str
        Translations of the first interface, such as ``xyz``.
    elastic_hz : float, optional
        First elastic frequency of the free body in Hz.
    units : str
        Unit system of the files where it is certain; empty for that of the scene.
    units_remark : str
        What speaks against the units of the scene.
    grounded : bool
        True if the matrices hold the body to the ground, and the nodes away from it are proven.
    held : bool
        True if the stiffness resists rigid motion.
    remark : str
        Reason why the files do not fit together; empty if they do.
    notes : tuple of str
        What the content of the files says against their names.
    damped : bool
        True if a superelement's files hold its damping.
    damping : tuple of Path and str, optional
        Damping matrix beside the stiffness, as that is given.
    reduced : Path, optional
        File that holds the whole body reduced already, in place of the matrices.
    """

    name: str
    stiffness: tuple[Path, str]
    mass: tuple[Path, str]
    geometry: Path | None = None
    rows: Path | None = None
    extseout: Path | None = None
    interfaces: tuple[tuple[str, str, str], ...] = (("mount", "{node: 1}", ""),)
    proposed: tuple[tuple[str, str, str], ...] = ()
    point: str = "1"
    far: int = 1
    axes: str = "xyz"
    elastic_hz: float | None = None
    units: str = ""
    units_remark: str = ""
    grounded: bool = False
    held: bool = False
    remark: str = ""
    notes: tuple[str, ...] = ()
    damped: bool = False
    damping: tuple[Path, str] | None = None
    reduced: Path | None = None


def body_pipeline(name: str, draft: BodyDraft) -> str:
    """Text of a pipeline file for one body, complete enough to run.

    Parameters
    ----------
    name : str
        Name of the study: letters, digits, _ and -.
    draft : BodyDraft
        Data from its files.

    Raises
    ------
    ConfigError
        If the name cannot stand in a file name, or is ``system``.
    """
    _check_names(name, [draft])
    elastic, band = _band([draft])
    return _TEXT.format(
        name=draft.name,
        components=_component(draft, "CHECK: the place that your joint holds"),
        band=band,
        elastic=elastic,
        actuators="\n".join(_pushes("push", f"{draft.name}.{draft.point}", draft.axes)),
        point=draft.point,
        far=draft.far,
        axes=", ".join(draft.axes),
        support="held by the supports in its files" if draft.grounded or draft.held else "floating free",
        rest=_REST,
    )


def scene_pipeline(
    name: str, drafts: Sequence[BodyDraft], joints: Sequence[tuple[str, str, str]], hold: bool = True
) -> str:
    """Text of a pipeline file for several bodies and their joints.

    Parameters
    ----------
    name : str
        Name of the study: letters, digits, _ and -.
    drafts : sequence of BodyDraft
        Bodies; loads act on the first, motions are measured on all.
    joints : sequence of (str, str, str)
        Name of each joint, and the two interfaces that it connects.
    hold : bool
        True if the joints hold each body in all its motions, as Craig-Bampton needs.

    Raises
    ------
    ConfigError
        As `body_pipeline`.
    """
    _check_names(name, drafts)
    elastic, band = _band(drafts)
    welds = [f"    {joint}: {{connect: [{one}, {other}]}}" for joint, one, other in joints]
    head = "  joints:                                 # CHECK: each is a weld; `free: [rz]` frees a turn about z"
    if not joints:
        head = "  # joints: {weld: {connect: [BODY.INTERFACE, BODY.INTERFACE]}}    # CHECK: nothing coincides"
    first = drafts[0]
    return _SCENE.format(
        name=name,
        components="\n".join(_component(draft, "CHECK: the places that joints hold") for draft in drafts),
        band=band,
        elastic=elastic,
        method=_HOLD if hold else _LEAVE_FREE,
        joints="\n".join([head, *welds]),
        actuators="\n".join(_pushes("push", f"{first.name}.{first.far}", first.axes)),
        sensors="\n".join(
            f"    {each.name}_motion: {{at: {each.name}.{each.far}, measure: [{', '.join(each.axes)}]}}"
            for each in drafts
        ),
        rest=_REST,
    )


def _check_names(name: str, drafts: Sequence[BodyDraft]) -> None:
    checked_name(name)
    if "system" in (draft.name.lower() for draft in drafts):
        raise ConfigError("a component cannot be named 'system': that is the file of the assembled system")


def _band(drafts: Sequence[BodyDraft]) -> tuple[str, str]:
    """Remark on the first elastic frequency, and the band that it suggests."""
    known = [draft.elastic_hz for draft in drafts if draft.elastic_hz is not None]
    if not known:
        return "", _UNKNOWN_BAND
    one = "the body" if len(drafts) == 1 else "a body"
    # Two digits without an exponent, because users edit this number.
    band = f"{float(f'{_BAND_OF_FIRST_MODE * min(known):.2g}'):g} Hz"
    return f"; the first elastic mode of {one} is at {min(known):.4g} Hz", band


def _pushes(name: str, point: str, axes: str) -> list[str]:
    return [f"    {name}_{axis}: {{at: {point}, force: {[int(other == axis) for other in 'xyz']}}}" for axis in axes]


def _component(draft: BodyDraft, choice: str) -> str:
    lines = [f"      # {choice}; {_CHOICE}"]
    lines += [f"      {name}: {place}" + (f"    # {words}" if words else "") for name, place, words in draft.interfaces]
    lines += [f"      # {name}: {place}    # {words}" for name, place, words in draft.proposed]
    units = _UNITS
    if draft.units:
        units = f"units: {draft.units}    # CHECK: {draft.units_remark}"
    elif draft.units_remark:
        units = f"# CHECK the units of the files: {draft.units_remark}\n    {_UNITS}"
    return _COMPONENT.format(
        name=draft.name,
        sources="\n".join(_sources(draft)),
        units=units,
        grounded=_HELD if draft.grounded else _FREE,
        interfaces="\n".join(lines),
        damping=_damping(draft),
    )


def _damping(draft: BodyDraft) -> str:
    if draft.damping is not None:
        return f"    damping: {{matrix: {_matrix(*draft.damping)}}}    # or {{modal: 0.005}}"
    return _DAMPING_IN_FILES if draft.damped else _DAMPING


def _sources(draft: BodyDraft) -> Sequence[str]:
    if draft.extseout is not None:
        return [f'    extseout: "{draft.extseout.as_posix()}"    # stem of the files of a superelement']
    if draft.reduced is not None:
        return [f'    reduced: "{draft.reduced.as_posix()}"    # the whole body in its modes']
    lines = [f"    {what}: {_matrix(*of)}" for what, of in (("stiffness", draft.stiffness), ("mass", draft.mass))]
    if draft.geometry is not None:
        lines.append(
            f'    geometry: "{draft.geometry.as_posix()}"    # grids, frames, sets; they prove the order of the rows'
        )
    if draft.rows is not None:
        lines.append(f'    rows: {{file: "{draft.rows.as_posix()}"}}    # nodes and dofs of the rows')
    return lines


def _matrix(file: Path, name: str) -> str:
    return f'{{file: "{file.as_posix()}"}}' if not name else f'{{file: "{file.as_posix()}", matrix: "{name}"}}'
