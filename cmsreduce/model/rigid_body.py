"""Bodies that do not deform."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import MatrixError
from cmsreduce.model.body import Interface
from cmsreduce.model.parameters import Values
from cmsreduce.model.units import SI, Units

__all__ = ["INERTIA_AXES", "RigidBody"]

INERTIA_AXES = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}
"""Entries of an inertia tensor in the order of the keys of a pipeline."""

# Round-off of six printed digits may make the inertia about a rod's axis slightly negative.
_INERTIA_ROUNDING = 1e-6


@dataclass(frozen=True, eq=False)
class RigidBody:
    """A body that does not deform.

    Parameters
    ----------
    name : str
        Name of the body.
    mass : float
        Mass, positive.
    cg : (3,) float64
        Centre of mass in basic.
    inertia : (3, 3) float64
        Inertia tensor about the centre of mass, basic axes: diagonal Ixx Iyy Izz, off-diagonal the negative
        products of inertia, as the tensor has them.
    interfaces : mapping of name to Interface
        Interfaces, at which joints attach; node ids are -1.
    units : Units
        Unit system.
    momentum : (3,) float64
        Angular momentum of wheels that turn in the body at constant speed, basic axes; their mass is the body's.
    spun : mapping of parameter to (3,) float64
        Momentum that each parameter of the scene adds, times its value.

    Raises
    ------
    MatrixError
        If the mass is not positive or no distribution of mass has this inertia.
    """

    name: str
    mass: float
    cg: NDArray[np.float64]
    inertia: NDArray[np.float64]
    interfaces: Mapping[str, Interface] = field(default_factory=dict)
    units: Units = SI
    momentum: NDArray[np.float64] = field(default_factory=lambda: np.zeros(3))
    spun: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        cg, J = np.asarray(self.cg, dtype=np.float64), np.asarray(self.inertia, dtype=np.float64)
        if cg.shape != (3,) or J.shape != (3, 3) or not np.isfinite(J).all() or not np.isfinite(cg).all():
            raise MatrixError(f"rigid body '{self.name}': cg needs 3 numbers and inertia 6: xx yy zz xy xz yz")
        if not self.mass > 0:
            raise MatrixError(f"rigid body '{self.name}': mass {self.mass:g} is not positive")
        principal = np.linalg.eigvalsh(J)
        slack = _INERTIA_ROUNDING * abs(principal).max()
        if principal[0] < -slack or principal[0] + principal[1] < principal[2] - slack:
            raise MatrixError(
                f"rigid body '{self.name}': no mass distribution has principal inertias "
                f"{', '.join(f'{p:g}' for p in principal)} (each must be positive and at most the sum of the other "
                "two). Order is xx yy zz xy xz yz, tensor components about the cg"
            )
        object.__setattr__(self, "cg", cg)
        object.__setattr__(self, "inertia", J)

    @property
    def moments(self) -> tuple[float, ...]:
        """Inertia about the centre of mass in the order of `INERTIA_AXES`."""
        return tuple(float(self.inertia[entry]) for entry in INERTIA_AXES.values())

    def momentum_at(self, values: Values) -> NDArray[np.float64]:
        """Angular momentum of its wheels (3,) at some values of the parameters."""
        added = [values.get(name, 0.0) * vector for name, vector in self.spun.items()]
        return np.asarray(np.sum([self.momentum, *added], axis=0))

    def __repr__(self) -> str:
        return f"<RigidBody {self.name}: mass {self.mass:g}, {len(self.interfaces)} interfaces>"
