"""Table of the formats of other programs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from cmsreduce.write.targets.extptfm import EXTPTFM_DIALECTS, write_extptfm
from cmsreduce.write.targets.exudyn import write_exudyn
from cmsreduce.write.targets.flex42 import MARK_42, files_42, write_42
from cmsreduce.write.targets.fmi import FMI_DIALECTS, write_body_unit
from cmsreduce.write.targets.joined_nodes import (
    JoinedNodes,
    an_interface,
    frames,
    one_frame,
    single_nodes,
    three_frames,
)
from cmsreduce.write.targets.mbdyn import write_mbdyn
from cmsreduce.write.targets.mbsim import write_mbsim
from cmsreduce.write.targets.nastran import NASTRAN_MARK, nastran_files, write_nastran
from cmsreduce.write.targets.nodal import write_nodal
from cmsreduce.write.targets.radioss import write_radioss
from cmsreduce.write.targets.sid import write_sid
from cmsreduce.write.targets.simscape import SIMSCAPE_MARK, simscape_files, write_simscape
from cmsreduce.write.targets.state_space import MAT_MARK, write_abcd, write_states
from cmsreduce.write.targets.treetops import write_treetops, write_treetops_h5

__all__ = ["TARGETS", "Target"]

_HDF5 = "\x89HDF"


@dataclass(frozen=True)
class Target:
    """A file of another program.

    Parameters
    ----------
    suffix : str
        End of the file name, after the name of the component; `convert` recognises the target by it.
    write : callable of (path, component), then (integrals) and (dialect) where the target has them
        Writes the file; returns the files written if they are not ``path`` alone.
    dialects : tuple of str
        Variants of the format, the default first; most have none.
    integrals : bool
        True if the writer takes the modal integrals.
    gyroscopic, structural : bool
        True if the format has a place for gyroscopic forces, and for structural damping, a complex stiffness.
    free : bool
        True if it takes bodies with six rigid motions alone.
    joins : callable of JoinedNodes
        Reason why it cannot hold such interfaces, with the remedy; empty if it can.
    lumped : tuple of str
        Dialects that need the lumped masses of all nodes, "" for a format without dialects.
    files : callable of path
        Every file that ``write`` makes of a path.
    mark : str
        Words near the beginning of one of the files, by which they are known as written here and may be replaced;
        without it, a file of this name is always replaced.
    """

    suffix: str
    write: Callable[..., tuple[Path, ...] | None]
    dialects: tuple[str, ...] = ()
    integrals: bool = True
    gyroscopic: bool = False
    structural: bool = False
    free: bool = False
    joins: Callable[[JoinedNodes], str] = lambda joined: ""
    lumped: tuple[str, ...] = ()
    files: Callable[[Path], tuple[Path, ...]] = lambda path: (path,)
    mark: str = ""


TARGETS: dict[str, Target] = {
    "nastran": Target(
        ".op4",
        write_nastran,
        integrals=False,
        structural=True,
        joins=an_interface,
        files=nastran_files,
        mark=NASTRAN_MARK,
    ),
    "42": Target(".42.txt", write_42, joins=single_nodes, files=files_42, mark=MARK_42),
    "sid": Target(".SID_FEM", write_sid, ("by-axis", "by-mode", "gr-by-mode", "embs"), mark=", columns of Gr "),
    "mbdyn": Target(
        ".fem",
        write_mbdyn,
        ("points", "invariants", "lumped", "first-order"),
        lumped=("lumped",),
        mark='NODE SET "ALL" of ',
    ),
    "mbsim": Target(".mbsim.h5", write_mbsim, mark=_HDF5),
    "exudyn": Target(".npz", write_exudyn, mark="modeBasis.npy"),
    "discos": Target(".discos.txt", write_nodal, lumped=("",), mark="$ NODAL DATA of "),
    "dads": Target(".dads.txt", write_nodal, lumped=("",), mark="$ NODAL DATA of "),
    "treetops": Target(".treetops.txt", write_treetops, mark="$ FLEXIBLE BODY "),
    "treetops-h5": Target(".treetops.h5", write_treetops_h5, mark=_HDF5),
    "matlab": Target(".mat", write_states, integrals=False, gyroscopic=True, mark=MAT_MARK),
    "abcd": Target(".abcd.txt", write_abcd, integrals=False, gyroscopic=True, mark="% STATE SPACE "),
    "fmi": Target(".fmu", write_body_unit, FMI_DIALECTS, integrals=False, gyroscopic=True, mark="modelDescription.xml"),
    "extptfm": Target(
        "_SE.dat", write_extptfm, EXTPTFM_DIALECTS, integrals=False, joins=one_frame, mark="!Superelement of "
    ),
    "radioss": Target(
        "_fxb.pch", write_radioss, integrals=False, free=True, joins=three_frames, mark="$ Flexible body "
    ),
    "simscape": Target(
        "_rom.m", write_simscape, integrals=False, free=True, joins=frames, files=simscape_files, mark=SIMSCAPE_MARK
    ),
}
"""Targets by their name in ``write.formats`` and ``convert --format``; one line registers a format."""
