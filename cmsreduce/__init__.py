"""Reduce finite-element bodies to checked components for multibody simulation.

There are two ways to use it from Python. The first runs a pipeline file, the same file that the command
`cmsreduce run` takes, and gives its results as objects::

    import cmsreduce as cms

    run = cms.run("pipelines/galileo.yaml", set={"balance.keep": {"modes": 20}})
    run.passed                                  # whether every limit and every check is met
    run.errors                                  # pandas.DataFrame, one row a configuration
    run.components["rotor"].frequencies_hz      # of the modes kept
    run.components["rotor"].shapes("spin_bearing")
    run.system("spin=45 cone=30").response([0.5, 1.0, 2.0])
    run.system("spin=45 cone=30").state_space() # control.StateSpace

The second calls the stages one by one, without a file::

    body = cms.read_body("rotor", stiffness=("rotor.op4", "KAA"), mass=("rotor.op4", "MAA"), geometry="rotor.bdf",
                         interfaces={"bearing": 1001}, damping=0.005)
    rotor = cms.orthogonalise(cms.CraigBampton(cutoff_hz=20).reduce(body))
    rotor = cms.balance(rotor, "gregory", keep=20)
    system = cms.assemble({"rotor": rotor, "hub": {"rigid": {...}, "interfaces": {...}}}, joints={...},
                          actuators={...}, sensors={...})
    cms.write_component(rotor, "rotor.h5")

Mode sets are `CraigBampton`, `MacNealRubin`, `BenfieldHruda`, `AugmentedBody` and `Guyan`. Mappings such as ``joints``
have the keys of a pipeline file; `cmsreduce schema` lists these.

Units: frequencies are in Hz where the name ends in ``_hz``, damping ratios are fractions of critical damping, angles of
configurations are in degrees. Masses, lengths and forces are in the units of the scene, m-kg-s unless stated; shapes are
normalised to unit modal mass, and a response is an output (a displacement, an angle in rad, or its rate) per unit input
(a force or a torque). Every error that an engineer can mend is a `CmsReduceError`.
"""

import sys
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from cmsreduce.errors import CmsReduceError
    from cmsreduce.model import Damping, Units, in_units
    from cmsreduce.reduce import AugmentedBody, BenfieldHruda, CraigBampton, Guyan, MacNealRubin
    from cmsreduce.runs import FinishedRun, run
    from cmsreduce.steps import (
        AssembledSystem,
        Component,
        assemble,
        balance,
        orthogonalise,
        read_body,
        write_component,
    )
    from cmsreduce.write import convert, read_component

    __version__: str

__all__ = [
    "AssembledSystem",
    "AugmentedBody",
    "BenfieldHruda",
    "CmsReduceError",
    "Component",
    "CraigBampton",
    "Damping",
    "FinishedRun",
    "Guyan",
    "MacNealRubin",
    "Units",
    "assemble",
    "balance",
    "convert",
    "in_units",
    "orthogonalise",
    "read_body",
    "read_component",
    "run",
    "write_component",
]

_MODULES = {
    "errors": ("CmsReduceError",),
    "model": ("Damping", "Units", "in_units"),
    "reduce": ("AugmentedBody", "BenfieldHruda", "CraigBampton", "Guyan", "MacNealRubin"),
    "runs": ("FinishedRun", "run"),
    "steps": ("AssembledSystem", "Component", "assemble", "balance", "orthogonalise", "read_body", "write_component"),
    "write": ("convert", "read_component"),
}
_HOME = {name: f"cmsreduce.{module}" for module, names in _MODULES.items() for name in names}


if not TYPE_CHECKING:

    def __getattr__(name):
        # Looking the version up takes longer than all else that a command needs to start.
        if name == "__version__":
            from importlib.metadata import version

            return version("cmsreduce")
        if name not in _HOME:
            raise AttributeError(f"module 'cmsreduce' has no attribute '{name}'")
        from importlib import import_module

        return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return [*__all__, "__version__"]


class _Package(ModuleType):
    """The package, where `assemble`, `balance` and `orthogonalise` name functions and not the rooms of these names."""

    def __setattr__(self, name: str, value: object) -> None:
        # Importing a room sets it as an attribute of the package, whichever comes first.
        if not (name in _HOME and isinstance(value, ModuleType)):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
