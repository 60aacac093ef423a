"""Bodies that others reduced or measured: modal matrices, and shapes at some nodes.

Their change to dofs at interfaces, and the readers of other programs' files, belong here.
Superelements whose rows are dofs already belong with the matrices of their program.
"""

from cmsreduce.read.reduced.mbdyn import read_mbdyn
from cmsreduce.read.reduced.modal_body import ModalBody, in_dofs
from cmsreduce.read.reduced.modes import read_modes
from cmsreduce.read.reduced.sid import read_sid
from cmsreduce.read.reduced.states import read_states
from cmsreduce.read.reduced.universal_modes import read_universal_modes

__all__ = ["ModalBody", "in_dofs", "read_mbdyn", "read_modes", "read_sid", "read_states", "read_universal_modes"]
