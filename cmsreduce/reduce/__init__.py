"""Mode sets: each turns a finite-element body into a small one."""

from cmsreduce.model import InterfaceLoading
from cmsreduce.reduce.benfield_hruda import AugmentedBody, BenfieldHruda
from cmsreduce.reduce.characteristic import InterfaceReduction
from cmsreduce.reduce.craig_bampton import CraigBampton, Guyan
from cmsreduce.reduce.macneal_rubin import MacNealRubin
from cmsreduce.reduce.methods import METHODS, reduction
from cmsreduce.reduce.neglected import Examined
from cmsreduce.reduce.reduction import Reduction, project
from cmsreduce.reduce.rigid import kept_rigid

__all__ = [
    "METHODS",
    "AugmentedBody",
    "BenfieldHruda",
    "CraigBampton",
    "Examined",
    "Guyan",
    "InterfaceLoading",
    "InterfaceReduction",
    "MacNealRubin",
    "Reduction",
    "kept_rigid",
    "project",
    "reduction",
]
