"""Frequency responses of joined bodies by coupling their receptances.

Receptances, modal terms, what one mode more or less changes, and residual flexibility belong here.
The matrices of the joined system belong in `assemble`; searches for modes belong in `balance`.
"""

from cmsreduce.assemble.response.by_modes import modal_weights
from cmsreduce.assemble.response.frequency_response import body_receptances, couple, frequency_response, rigid_response
from cmsreduce.assemble.response.modal_receptance import ModalReceptance
from cmsreduce.assemble.response.modal_terms import Change
from cmsreduce.assemble.response.receptance import Receptance, receptance, receptances, tabulated
from cmsreduce.assemble.response.residual_flexibility import JoinedRows

__all__ = [
    "Change",
    "JoinedRows",
    "ModalReceptance",
    "Receptance",
    "body_receptances",
    "couple",
    "frequency_response",
    "modal_weights",
    "receptance",
    "receptances",
    "rigid_response",
    "tabulated",
]
