"""Reduce finite-element bodies to checked components for multibody simulation.

There are two ways to use it from Python. The first runs a pipeline file, the same file that the command
`cmsreduce run` takes, and gives its results as objects.

>>> import cmsreduce as cms
>>> run = cms.run("pipelines/hub_beams.yaml", set={"reduce.cutoff": 20})
>>> run.passed                                   # every limit and every check is met
True
>>> run.components["right"]
<Component right: 82 dofs, 2 rigid, 10 elastic, 0 static modes, first 1.40755 Hz>
>>> run.components["right"].frequencies_hz[2:5].round(3).tolist()
[1.408, 3.88, 7.607]
>>> run.components["right"].shapes("hinge").shape   # translation and rotation along basic axes, by mode
(6, 12)
>>> list(run.errors.columns)                     # a table with one row a configuration
['frf_error', 'channel_error', 'db_error', 'frequency_error', 'damping_error', 'n_full', 'n_reduced']
>>> system = run.system("as built")              # or a name such as "spin=45 cone=30", angles in degrees
>>> system.response([0.5, 1.0]).shape            # at frequencies in Hz: (frequencies, outputs, inputs)
(2, 3, 3)
>>> states = system.state_space()                # control.StateSpace

A run that wrote its component files can move in time, by any joint angle; `docs/simulate.md` has the equations.

>>> motion = cms.simulate("build/galileo", 8, efforts={"motor": cms.Slew(1.57, 5)}, method="implicit")  # doctest: +SKIP

The second calls the stages one by one, without a pipeline file.

>>> sample = "sample_models/hub_beams/right"
>>> body = cms.read_body("right", stiffness=(f"{sample}.op4", "KFF"), mass=(f"{sample}.op4", "MFF"),
...                      geometry=f"{sample}.bdf", interfaces={"hinge": 101}, damping=0.005)
>>> beam = cms.orthogonalise(cms.CraigBampton(cutoff_hz=64).reduce(body))
>>> beam = cms.balance(beam, "gregory", keep=4)  # the modes kept and their coefficients: beam.table
>>> hub = {"rigid": {"mass": 5, "inertia": [2, 2, 3, 0, 0, 0]},
...        "interfaces": {"right": {"position": [0.6, 0, 0], "dofs": ["y", "rz"]}}}
>>> system = cms.assemble({"hub": hub, "right": beam},
...                       joints={"hinge": {"connect": ["hub.right", "right.hinge"], "free": ["rz"]}},
...                       actuators={"wheel": {"at": "hub.cg", "torque": [0, 0, 1]}},
...                       sensors={"gyro": {"at": "hub.cg", "measure": "rz"}})
>>> system
<AssembledSystem as built: 11 coordinates, 7 rigid motions, 1 inputs, 1 outputs>
>>> file = cms.write_component(beam, "build/right.h5")

Mode sets are `CraigBampton`, `MacNealRubin`, `BenfieldHruda`, `AugmentedBody` and `Guyan`. Mappings such as ``joints``
have the keys of a pipeline file; `cmsreduce schema` lists these.

Units: frequencies are in Hz where the name ends in ``_hz``, damping ratios are fractions of critical damping. Names of
configurations have angles in degrees. Masses, lengths and forces are in the units of the scene, m-kg-s unless stated.
Shapes are normalised to unit modal mass. A response is an output (a displacement, an angle in rad, or the rate of
either) per unit input (a force or a torque). An error that an engineer can mend is a `CmsReduceError`.
"""

import sys
from types import ModuleType

# Type checkers know this name; importing typing would take longer than all the rest.
TYPE_CHECKING = False

if TYPE_CHECKING:
    from cmsreduce.errors import CmsReduceError
    from cmsreduce.model import Damping, Units, in_units
    from cmsreduce.models_in_memory import AssembledSystem, Component
    from cmsreduce.reduce import AugmentedBody, BenfieldHruda, CraigBampton, Guyan, MacNealRubin
    from cmsreduce.runs import FinishedRun, run, simulate
    from cmsreduce.simulate import Motion, Pulse, Slew
    from cmsreduce.steps import assemble, balance, orthogonalise, read_body, write_component
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
    "Motion",
    "Pulse",
    "Slew",
    "Units",
    "assemble",
    "balance",
    "convert",
    "in_units",
    "orthogonalise",
    "read_body",
    "read_component",
    "run",
    "simulate",
    "write_component",
]

_MODULES = {
    "errors": ("CmsReduceError",),
    "model": ("Damping", "Units", "in_units"),
    "reduce": ("AugmentedBody", "BenfieldHruda", "CraigBampton", "Guyan", "MacNealRubin"),
    "runs": ("FinishedRun", "run", "simulate"),
    "simulate": ("Motion", "Pulse", "Slew"),
    "models_in_memory": ("AssembledSystem", "Component"),
    "steps": ("assemble", "balance", "orthogonalise", "read_body", "write_component"),
    "write": ("convert", "read_component"),
}
_HOME = {name: f"cmsreduce.{module}" for module, names in _MODULES.items() for name in names}


if not TYPE_CHECKING:

    def __getattr__(name):
        from importlib import import_module

        # Looking the version up takes longer than all else that a command needs to start.
        if name == "__version__":
            from importlib.metadata import PackageNotFoundError, version

            try:
                return version("cmsreduce")
            except PackageNotFoundError as error:
                from pathlib import Path

                from cmsreduce.errors import CmsReduceError

                clone = Path(__file__).parents[1]
                raise CmsReduceError(
                    f"the copy of cmsreduce in {clone} is not installed, so its version and its libraries are not "
                    f"known: `pip install --editable {clone}`"
                ) from error
        if name not in _HOME:
            # With the module, Python adds the name that was meant.
            message = f"module 'cmsreduce' has no attribute '{name}'"
            raise AttributeError(message, name=name, obj=import_module("cmsreduce"))
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
