"""Keys of a body's damping."""

from __future__ import annotations

from typing import Annotated, ClassVar

from pydantic import BeforeValidator, Field, ValidationInfo, field_validator, model_validator

from cmsreduce.config.keys.files import MatrixFile
from cmsreduce.config.keys.mapping import Frequency, Keys, Number, exactly_one
from cmsreduce.errors import DampingError
from cmsreduce.model import Damping

__all__ = ["DampingKeys", "RayleighKeys"]

_LAWS = ("modal", "table", "per_mode", "rayleigh", "structural", "matrix")


def _check_pair(value: object) -> object:
    if isinstance(value, (list, tuple)) and len(value) != 2:
        raise ValueError(f"a pair of frequency and damping ratio is expected, e.g. [10 Hz, 0.005], found {len(value)}")
    return value


class RayleighKeys(Keys):
    """Damping matrix alpha M + beta K; the first part does not brake rigid motion."""

    alpha: Number = Field(default=0.0, description="Factor of the mass matrix, 1/s.", examples=[0.1])
    beta: Number = Field(default=0.0, description="Factor of the stiffness matrix, s.", examples=[1e-5])


class DampingKeys(Keys):
    """How a body loses energy: one of the keys; without damping it is undamped."""

    alternatives: ClassVar[tuple[str, ...]] = _LAWS

    modal: Number | None = Field(
        default=None, description="One damping ratio for every elastic mode.", examples=[0.005]
    )
    table: tuple[Annotated[tuple[Frequency, Number], BeforeValidator(_check_pair)], ...] | None = Field(
        default=None,
        description="Damping ratio against frequency (Hz unless written), interpolated linearly, held outside.",
        examples=[[["1 Hz", 0.01], ["10 Hz", 0.005]]],
    )
    per_mode: tuple[Number, ...] | None = Field(
        default=None,
        description="Damping ratio of each elastic mode by frequency; the last one holds for the rest.",
        examples=[[0.01, 0.01, 0.005]],
    )
    rayleigh: RayleighKeys | None = Field(
        default=None,
        description="Damping matrix alpha M + beta K; alpha M does not brake rigid motion.",
        examples=[{"alpha": 0.1, "beta": 1e-05}],
    )
    structural: Number | None = Field(
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
        """Damping law of the body; the one of no damping where a matrix is given."""
        return Damping(
            modal=self.modal,
            table=self.table,
            per_mode=self.per_mode,
            rayleigh=None if self.rayleigh is None else (self.rayleigh.alpha, self.rayleigh.beta),
            structural=self.structural,
        )
