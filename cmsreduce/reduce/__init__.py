"""Mode sets: each turns a finite-element body into a small one.

A base class owns projection and recovery; a method supplies only its shapes.
The choice among the modes of a set belongs in `balance`.
"""

from cmsreduce.model import InterfaceLoading
from cmsreduce.reduce.benfield_hruda import AugmentedBody, BenfieldHruda
from cmsreduce.reduce.characteristic import InterfaceReduction
from cmsreduce.reduce.craig_bampton import CraigBampton, Guyan
from cmsreduce.reduce.macneal_rubin import MacNealRubin
from cmsreduce.reduce.methods import METHODS, reduction
from cmsreduce.reduce.neglected import Examined
from cmsreduce.reduce.reduction import Reduction, kept_rigid, project

__all__ = [
    "AugmentedBody",
    "BenfieldHruda",
    "CraigBampton",
    "Examined",
    "Guyan",
    "InterfaceLoading",
    "InterfaceReduction",
    "METHODS",
    "MacNealRubin",
    "Reduction",
    "kept_rigid",
    "project",
    "reduction",
]
