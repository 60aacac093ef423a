"""Keys of a component: its matrices, geometry, interfaces, damping and place."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, ClassVar

from pydantic import BeforeValidator, Field, ValidationInfo, field_validator, model_validator

from cmsreduce.config.keys.balance import RankingKeys
from cmsreduce.config.keys.files import GeometryFile, MatrixFile, RowOrder
from cmsreduce.config.keys.interface import InterfaceKeys, InterfaceName, Rotations, rotation_matrix
from cmsreduce.config.keys.mapping import (
    DataPath,
    Flag,
    Frequency,
    Keys,
    LengthVector,
    Name,
    Number,
    Ratio,
    UnitSystem,
    exactly_one,
    place_in,
)
from cmsreduce.config.keys.modes import ModesKeys
from cmsreduce.config.keys.quantities import Quantity
from cmsreduce.config.keys.reduce import ReduceKeys
from cmsreduce.config.keys.rigid import RigidKeys
from cmsreduce.config.keys.stiffening import GeometricStiffnessKeys
from cmsreduce.config.keys.wheels import WheelKeys
from cmsreduce.config.keys.write import BodyWriteKeys
from cmsreduce.config.located import Text
from cmsreduce.errors import DampingError
from cmsreduce.model import Damping, Placement, Units

__all__ = ["Component", "DampingKeys", "EXTSEOUT_NAMES", "FLEXIBLE_ONLY", "PlacementKeys", "RayleighKeys", "RigidKeys"]

FLEXIBLE_ONLY = (
    *("extseout", "modes", "reduced", "states", "stiffness", "mass", "geometry", "rows", "damping"),
    *("gyroscopic", "grounded", "geometric_stiffness", "reduce", "balance", "write"),
)
"""Keys that a rigid body does not have."""

EXTSEOUT_NAMES = ("KXX", "MXX")
"""Stiffness and mass that an EXTSEOUT stem stands for; where the file names them otherwise, its content decides."""

# Files of a superelement by what they hold, the likeliest first.
_EXTSEOUT_MATRICES, _EXTSEOUT_GEOMETRY = (".op4", ".op2", ".pch"), (".asm", ".pch")
_NOT_BESIDE_MODES = (
    *("rigid", "extseout", "reduced", "states", "stiffness", "mass", "gyroscopic", "geometric_stiffness"),
)
_NOT_BESIDE_REDUCED = (
    *("rigid", "extseout", "states", "stiffness", "mass", "geometry", "rows", "gyroscopic", "grounded"),
    "geometric_stiffness",
)
_NOT_BESIDE_STATES = ("rigid", "extseout", "stiffness", "mass", "gyroscopic", "geometric_stiffness")
_LAWS = ("modal", "table", "per_mode", "rayleigh", "structural", "matrix")


def _check_pair(value: object) -> object:
    if isinstance(value, (list, tuple)) and len(value) != 2:
        raise ValueError(f"a pair of frequency and damping ratio is expected, e.g. [10 Hz, 0.005], found {len(value)}")
    return value


class RayleighKeys(Keys):
    """Damping matrix alpha M + beta K; alpha M does not act on rigid motion."""

    alpha: Number = Field(
        default=0.0,
        description="Factor of the mass matrix, 1/s; 1/ms where `units` of the body count ms.",
        examples=[0.1],
    )
    beta: Number = Field(
        default=0.0,
        description="Factor of the stiffness matrix, s; ms where `units` of the body count ms.",
        examples=[1e-5],
    )


class DampingKeys(Keys):
    """Damping of a body, stated by one of the keys."""

    alternatives: ClassVar[tuple[str, ...]] = _LAWS

    modal: Ratio | None = Field(
        default=None,
        description="One damping ratio for every elastic mode, such as 0.005 or 0.5 %; one or more must have its %.",
        examples=[0.005, "0.5 %"],
    )
    table: tuple[Annotated[tuple[Frequency, Ratio], BeforeValidator(_check_pair)], ...] | None = Field(
        default=None,
        description="Damping ratio over frequency (Hz without a unit), interpolated linearly, constant outside.",
        examples=[[["1 Hz", 0.01], ["10 Hz", 0.005]]],
    )
    per_mode: tuple[Ratio, ...] | None = Field(
        default=None,
        description="Damping ratio of each elastic mode in order of frequency; the last one holds for the rest. Modes "
        "of one frequency have the mean of theirs.",
        examples=[[0.01, 0.01, 0.005]],
    )
    rayleigh: RayleighKeys | None = Field(
        default=None,
        description="Damping matrix alpha M + beta K; alpha M does not act on rigid motion.",
        examples=[{"alpha": 0.1, "beta": 1e-05}],
    )
    structural: Ratio | None = Field(
        default=None, description="Loss factor g: complex stiffness K (1 + i g).", examples=[0.01]
    )
    matrix: MatrixFile | None = Field(
        default=None,
        description="Viscous damping matrix from a file.",
        examples=[{"file": "rotor.op4", "matrix": "BAA"}],
    )

    @field_validator("modal", "table", "per_mode", "rayleigh", "structural")
    @classmethod
    def _positive(cls, value: object, info: ValidationInfo) -> object:
        figures = (value.alpha, value.beta) if isinstance(value, RayleighKeys) else value
        try:
            Damping(**{str(info.field_name): figures})  # type: ignore[arg-type]
        except DampingError as error:
            raise ValueError(str(error)) from None
        return value

    @model_validator(mode="after")
    def _one_law(self) -> DampingKeys:
        exactly_one(self, _LAWS, "damping")
        return self

    def law(self) -> Damping:
        """Damping law of the body; no damping where a matrix is given."""
        return Damping(
            modal=self.modal,
            table=self.table,
            per_mode=self.per_mode,
            rayleigh=None if self.rayleigh is None else (self.rayleigh.alpha, self.rayleigh.beta),
            structural=self.structural,
        )


class PlacementKeys(Keys):
    """Place of a body in the scene: it is rotated about its basic origin first, then moved."""

    at: LengthVector = Field(
        default=(Quantity(0.0),) * 3,
        description="Position of the origin of the body's basic frame, in the scene's unit of length or with units.",
        examples=[[0, 0, "120 mm"]],
    )
    rotate: Rotations | None = Field(
        default=None,
        description="One rotation or a list of rotations, in order, about the axes of the scene.",
        examples=[{"axis": "z", "angle": "30 deg"}],
    )

    def placement(self, units: Units) -> Placement:
        """Rotation and translation in the scene's units."""
        return Placement(rotation_matrix(self.rotate or ()), place_in(self.at, units))


class Component(Keys):
    """A body: `rigid`, matrices (`stiffness`, `mass`, `extseout`), `modes`, `reduced`, `states`, or `like` another."""

    like: Name | None = Field(
        default=None,
        description="Name of another component: this is the same body at another place. It has all keys of that "
        "component; keys given here win, key by key. Files are read once, and copies that the scene loads alike are "
        "reduced once.",
        examples=["wheel"],
    )
    rigid: RigidKeys | None = Field(
        default=None,
        description="Mass properties of a body that does not deform.",
        examples=[{"mass": 120, "inertia": [10, 12, 8, 0, 0, 0]}],
    )
    extseout: DataPath | None = Field(
        default=None,
        description="NASTRAN EXTSEOUT body by the common stem of its files. Stands for stiffness, mass and damping of "
        "the .op4, .op2 or .pch (KXX, MXX, BXX, K4XX, or KAA and so on) and for the geometry of the .asm or .pch, "
        "unless these keys are given.",
        examples=["../bodies/inboard"],
    )
    reduced: DataPath | None = Field(
        default=None,
        description="File that holds the whole body in a few modes, as others reduced it: a component file of "
        "cmsreduce, an SID file or a modal body of MBDyn. An interface is one of its nodes, or `set: NAME` for an "
        "interface of the file.",
        examples=["../build/arm/panel.h5"],
    )
    modes: ModesKeys | None = Field(
        default=None,
        description="A body that is known by its modes, computed elsewhere or measured, with `geometry` for the places "
        "of its nodes.",
        examples=[{"frequencies": ["12.3 Hz", "15.1 Hz"], "shapes": {"file": "modes.mat", "matrix": "PHI"}}],
    )
    states: MatrixFile | None = Field(
        default=None,
        description="A body in state space: a file with A, B and C, or with M, K, B and perhaps D and C; `matrix` "
        "names the struct that holds them. `rows` lists the dof that each input drives and each output measures, "
        "`geometry` has the places of the nodes.",
        examples=["plant.mat"],
    )
    stiffness: MatrixFile | None = Field(
        default=None, description="Stiffness matrix.", examples=[{"file": "rotor.op4", "matrix": "KAA"}]
    )
    mass: MatrixFile | None = Field(
        default=None, description="Mass matrix.", examples=[{"file": "rotor.op4", "matrix": "MAA"}]
    )
    geometry: GeometryFile | None = Field(
        default=None,
        description="Nodes, coordinate frames and dof sets; absent for bodies of scalar dofs only.",
        examples=["rotor.bdf"],
    )
    rows: RowOrder | None = Field(
        default=None,
        description="Order of the matrix rows: a set of the deck (a, f, g, b, ...) or a dof list file; by default the "
        "order that the sources state. `trusted`, or `trusted: true` beside the order, goes on without a proof.",
        examples=["a"],
    )
    interfaces: dict[InterfaceName, InterfaceKeys] = Field(
        default={}, description="Interfaces by name: places where joints attach.", examples=[{"hinge": {"node": 1001}}]
    )
    damping: DampingKeys | None = Field(
        default=None, description="Damping of the body; undamped without this key.", examples=[{"modal": 0.005}]
    )
    gyroscopic: MatrixFile | None = Field(
        default=None,
        description="Gyroscopic matrix of rotors, skew, in the rows and units of the stiffness; it is added to the "
        "damping.",
        examples=["rotor_gyroscopic.op4"],
    )
    wheels: dict[Name, WheelKeys] = Field(
        default={},
        description="Momentum wheels and rotors by name: each turns at constant speed about an axis of the body.",
        examples=[{"roll": {"at": 1001, "axis": "x", "momentum": "12 N*m*s"}}],
    )
    units: UnitSystem | None = Field(
        default=None,
        description="Unit system of the matrices and coordinates, length-mass-time; by default the scene's.",
        examples=["mm-t-s"],
    )
    grounded: Flag = Field(
        default=False,
        description="The matrices include supports to the ground, so that the stiffness resists rigid motion. The rows "
        "of all nodes away from the supports are still proven.",
        examples=[True],
    )
    geometric_stiffness: GeometricStiffnessKeys | None = Field(
        default=None,
        description="Geometric stiffness of spinning, of accelerations and of forces; without this key it is absent.",
        examples=[{"bars": "all", "held": "root"}],
    )
    place: PlacementKeys | None = Field(
        default=None,
        description="Rotates and moves the body relative to the basic frame that all bodies share.",
        examples=[{"at": [0, 0, 1.5]}],
    )
    reduce: ReduceKeys | None = Field(
        default=None, description="Overrides keys of the stage for this body.", examples=[{"cutoff": 4}]
    )
    balance: RankingKeys | None = Field(
        default=None, description="Overrides keys of the stage for this body.", examples=[{"keep": {"modes": 20}}]
    )
    write: BodyWriteKeys | None = Field(
        default=None,
        description="Overrides keys of the stage for this body; `frame: null` where it needs none.",
        examples=[{"frame": {"kind": "clamped", "at": "hinge"}}],
    )

    @classmethod
    def written_out(cls, value: object) -> object:
        """Add the files that an EXTSEOUT stem stands for; their content names the matrices."""
        stem = value.get("extseout") if isinstance(value, dict) else None
        if not isinstance(value, dict) or not isinstance(stem, (str, Path)) or not str(stem):
            return value
        text = str(stem)
        if text.lower().endswith((*_EXTSEOUT_MATRICES, *_EXTSEOUT_GEOMETRY)):
            text = text[:-4]

        def beside(suffixes: tuple[str, ...]) -> str | Path:
            folder = stem.folder if isinstance(stem, Text) else None
            names = [text + each for suffix in suffixes for each in (suffix, suffix.upper())]
            name = next((name for name in names if Path(folder or "", name).is_file()), names[0])
            return Text.at(name, stem.folder) if isinstance(stem, Text) else Path(name)

        implied = {
            "stiffness": {"file": beside(_EXTSEOUT_MATRICES), "matrix": EXTSEOUT_NAMES[0]},
            "mass": {"file": beside(_EXTSEOUT_MATRICES), "matrix": EXTSEOUT_NAMES[1]},
            "geometry": {"file": beside(_EXTSEOUT_GEOMETRY)},
        }
        given = {key: item for key, item in value.items() if item is not None}
        stem_only = Text.at(text, stem.folder) if isinstance(stem, Text) else Path(text)
        return {**implied, **given, "extseout": stem_only}

    @model_validator(mode="after")
    def _rigid_or_flexible(self) -> Component:
        if self.reduced is not None:
            beside = [key for key in _NOT_BESIDE_REDUCED if getattr(self, key) not in (None, False)]
            if beside:
                raise ValueError(f"`reduced` is a whole body: take `{beside[0]}` out, or `reduced`")
            return self
        if self.modes is not None:
            beside = [key for key in _NOT_BESIDE_MODES if getattr(self, key) is not None]
            if beside:
                raise ValueError(f"`modes` is a whole body: take `{beside[0]}` out, or `modes`")
            if self.geometry is None and self.modes.file is None:
                raise ValueError("`modes` needs `geometry`, the places of the nodes of its shapes")
            return self
        if self.states is not None:
            beside = [key for key in _NOT_BESIDE_STATES if getattr(self, key) is not None]
            if beside:
                raise ValueError(f"`states` is a whole body: take `{beside[0]}` out, or `states`")
            if self.geometry is None or self.rows is None or self.rows.file is None:
                lacking = "geometry" if self.geometry is None else "rows"
                raise ValueError(
                    f"`states` needs `{lacking}`: `rows` is a list of the dof (node.component) of each input and "
                    "output, `geometry` has the places of these nodes"
                )
            return self
        if self.rigid is not None:
            return self
        if self.stiffness is None and self.mass is None:
            raise ValueError(
                "a component needs `rigid`, or `stiffness` and `mass`, or `extseout`, `modes`, `reduced`, `states` or "
                "`like`"
            )
        if self.stiffness is None or self.mass is None:
            given, lacking = ("mass", "stiffness") if self.stiffness is None else ("stiffness", "mass")
            raise ValueError(f"`{given}` is given without `{lacking}`: a flexible body needs both")
        return self

    @property
    def in_modes(self) -> bool:
        """True if the body is given in amplitudes of modes or in states, and not in dofs of nodes."""
        return self.reduced is not None or self.modes is not None or self.states is not None

    def units_in(self, scene: Units) -> Units:
        """Unit system of the body's data."""
        return scene if self.units is None else Units.parse(self.units)
