"""Bodies that others reduced or measured: modal matrices, and shapes at some nodes.

Their change to dofs at interfaces, and the readers of other programs' files, belong here.
Superelements whose rows are dofs already belong with the matrices of their program.
"""

from cmsreduce.read.reduced.modal_body import ModalBody, in_dofs
from cmsreduce.read.reduced.modes import read_modes
from cmsreduce.read.reduced.sid import read_sid

__all__ = ["ModalBody", "in_dofs", "read_modes", "read_sid"]
