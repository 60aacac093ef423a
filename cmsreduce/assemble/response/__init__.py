"""Frequency responses of joined bodies by coupling their receptances.

Receptances, modal terms, what one mode more or less changes, and residual flexibility belong here.
The matrices of the joined system belong in `assemble`; searches for modes belong in `balance`.
"""

from cmsreduce.assemble.response.frequency_response import body_receptances, couple, frequency_response, rigid_response
from cmsreduce.assemble.response.modal_receptance import ModalReceptance
from cmsreduce.assemble.response.modal_terms import Change
from cmsreduce.assemble.response.receptance import Receptance, receptance, receptances, tabulated

__all__ = [
    "Change",
    "ModalReceptance",
    "Receptance",
    "body_receptances",
    "couple",
    "frequency_response",
    "receptance",
    "receptances",
    "rigid_response",
    "tabulated",
]
