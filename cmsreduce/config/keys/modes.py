"""Keys of a body that is known by its modes, computed elsewhere or measured."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

from pydantic import Field, model_validator

from cmsreduce.config.keys.files import MatrixFile
from cmsreduce.config.keys.mapping import DataPath, Frequency, Keys, Positive, exactly_one
from cmsreduce.config.keys.rigid import RigidKeys

__all__ = ["ModesKeys"]


class ModesKeys(Keys):
    """A file with all of it, or frequencies or modal matrices and the shapes at some nodes."""

    short_key: ClassVar[str] = "file"
    short_schema: ClassVar[tuple[dict[str, Any], ...]] = ({"type": "string"},)
    alternatives: ClassVar[tuple[str, ...]] = ("file", "frequencies", "stiffness")

    file: DataPath | None = Field(
        default=None,
        description="Universal file with modes (datasets 55 and 2414): frequencies, damping, modal masses, shapes and, "
        "without `geometry`, the nodes.",
        examples=["test.uff"],
    )

    frequencies: Annotated[tuple[Frequency, ...], Field(min_length=1)] | None = Field(
        default=None,
        description="Natural frequency of each mode (Hz without a unit); 0 for a rigid motion among the shapes.",
        examples=[["12.3 Hz", "15.1 Hz"]],
    )
    modal_mass: tuple[Positive, ...] | None = Field(
        default=None,
        description="Modal mass of each mode, beside frequencies (by default 1) or a file whose shapes have no scale.",
        examples=[[1.0, 2.5]],
    )
    stiffness: MatrixFile | None = Field(
        default=None,
        description="Modal stiffness matrix, one row a mode, instead of frequencies.",
        examples=[{"file": "modes.mat", "matrix": "K"}],
    )
    mass: MatrixFile | None = Field(
        default=None, description="Modal mass matrix, beside the stiffness.", examples=[{"file": "modes.mat"}]
    )
    shapes: MatrixFile | None = Field(
        default=None,
        description="Shapes: rows are dofs of nodes, which `rows` lists, columns are modes.",
        examples=[{"file": "modes.mat", "matrix": "PHI"}],
    )
    rigid: RigidKeys | None = Field(
        default=None,
        description="Mass properties of a body whose shapes are elastic modes of the free body only: its six rigid "
        "motions are added.",
        examples=[{"mass": 4.2, "cg": [0, 0, 0.1], "inertia": [0.1, 0.1, 0.02, 0, 0, 0]}],
    )

    @model_validator(mode="after")
    def _frequencies_or_matrices(self) -> ModesKeys:
        given = exactly_one(self, ("file", "frequencies", "stiffness"), "modes")
        if given == "file":
            beside = self.given(("shapes", "mass"))
            if beside:
                raise ValueError(f"`file` of modes holds its shapes and masses: take `{beside[0]}` out")
            return self
        if self.shapes is None:
            raise ValueError("modes need `shapes`: the motion of some nodes in each of them")
        if (self.mass is None) == (given == "stiffness"):
            raise ValueError("`stiffness` and `mass` of modes are given together, or `frequencies` alone")
        if self.modal_mass is not None and given == "stiffness":
            raise ValueError("`modal_mass` stands beside `frequencies`: `mass` is the matrix beside `stiffness`")
        if self.modal_mass is not None and len(self.modal_mass) != len(self.frequencies or ()):
            raise ValueError(f"{len(self.frequencies or ())} frequencies need as many modal masses")
        if any(frequency < 0 for frequency in self.frequencies or ()):
            raise ValueError("a frequency is not negative; write 0 for a rigid motion")
        return self
