"""Keys of a rigid body."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field, model_validator

from cmsreduce.config.keys.mapping import Keys, LengthVector, Number, Positive
from cmsreduce.config.keys.quantities import Quantity
from cmsreduce.errors import MatrixError
from cmsreduce.model import RigidBody

__all__ = ["RigidKeys"]


def _check_inertia(value: object) -> object:
    if isinstance(value, (list, tuple)) and len(value) != 6:
        raise ValueError(f"6 numbers are expected, xx yy zz xy xz yz, found {len(value)}")
    return value


class RigidKeys(Keys):
    """Mass properties of a body that does not deform, in its units and basic frame."""

    mass: Positive = Field(description="Mass.", examples=[120.0])
    cg: LengthVector = Field(
        default=(Quantity(0.0),) * 3,
        description="Centre of mass, in the body's unit of length or with units.",
        examples=[[0, 0, 0.2]],
    )
    inertia: Annotated[tuple[Number, Number, Number, Number, Number, Number], BeforeValidator(_check_inertia)] = Field(
        description="Inertia tensor about the cg: xx yy zz xy xz yz; the last three are entries of the tensor, that "
        "is, minus the products of inertia.",
        examples=[[10, 12, 8, 0, 0, 0]],
    )

    @model_validator(mode="after")
    def _physical(self) -> RigidKeys:
        try:
            RigidBody("", self.mass, np.zeros(3), self.tensor())
        except MatrixError as error:
            raise ValueError(str(error).partition(": ")[2]) from None
        return self

    def tensor(self) -> NDArray[np.float64]:
        """(3, 3) inertia about the cg."""
        xx, yy, zz, xy, xz, yz = self.inertia
        return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
