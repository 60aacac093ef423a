"""Bars of a body, unit loads on it, and the stiffness that the stress of each load adds (theory section 8)."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import SceneError
from cmsreduce.model.units import Units

__all__ = [
    "Bars",
    "GeometricStiffness",
    "INERTIA_LOADS",
    "Members",
    "ModalStiffening",
    "SQUARES",
    "UnitLoad",
    "loads_in_words",
]

SQUARES = ("xx", "yy", "zz", "xy", "yz", "xz")
"""Products of angular velocities, in the order of floating-frame codes."""

_AXES = {
    "acceleration": ("x", "y", "z"),
    "angular acceleration": ("x", "y", "z"),
    "centrifugal": SQUARES,
    "force": ("x", "y", "z"),
    "moment": ("x", "y", "z"),
}
_FORM = re.compile(r"\s*(?P<kind>[a-z][a-z ]*?)\s+(?:(?P<at>[A-Za-z0-9_-]+)\.)?(?P<axes>[xyz]{1,2})\s*")
_EXAMPLES = (
    "'acceleration x', 'angular acceleration z', 'centrifugal xx', 'centrifugal xy', 'force tip.x', 'moment 12.z'"
)


@dataclass(frozen=True, eq=False)
class Bars:
    """Straight bars and beams between two nodes each: properties for the force along them.

    Parameters
    ----------
    id : (b,) int64
        Element ids.
    node : (b, 2) int64
        Nodes at both ends.
    EA : (b,) float64
        Axial stiffness, in units of force.
    radius_squared : (b,) float64
        Polar moment of the section over its area, Ip / A, in units of length squared; 0 where it does not matter.
    bends : (b,) bool
        True for a beam, which has slopes at its ends; false for a rod.
    hinged : (b, 2) bool, optional
        True for each end of a beam that is free to rotate across it; none by default.
    offset : (b, 2, 3) float64, optional
        From each node to the end of the bar, along the node's displacement axes; zero by default.
    """

    id: NDArray[np.int64]
    node: NDArray[np.int64]
    EA: NDArray[np.float64]
    radius_squared: NDArray[np.float64]
    bends: NDArray[np.bool_]
    hinged: NDArray[np.bool_] | None = None
    offset: NDArray[np.float64] | None = None

    @property
    def turning(self) -> NDArray[np.bool_]:
        """True for each end of each bar with the slope of its node (b, 2)."""
        both = np.repeat(self.bends[:, None], 2, axis=1)
        return both if self.hinged is None else both & ~self.hinged

    @property
    def on_arms(self) -> NDArray[np.bool_]:
        """True for each end of each bar that is offset from its node (b, 2)."""
        return np.zeros((len(self), 2), dtype=bool) if self.offset is None else np.asarray(self.offset.any(axis=2))

    def __len__(self) -> int:
        return int(self.id.size)


@dataclass(frozen=True, eq=False)
class Members:
    """Elastic members of a deck: bars and rods between two nodes each, and springs between two dofs.

    Parameters
    ----------
    node : (b, 2) int64
        Ends of the bars.
    offset : (b, 2, 3) float64
        From each node to the bar's end, along the basic axes.
    up : (b, 3) float64
        Vector in the bar's first plane of bending, basic axes; not along the bar. Any vector for a rod.
    EA, GJ : (b,) float64
        Axial and torsional stiffness, in units of force and of force times area.
    EI : (b, 2, 2) float64
        Bending stiffness in the two planes, and coupling between them; zero for rods.
    shear : (b, 2) float64
        Shear flexibility in each plane, 1 / (k G A); zero for a bar without shear deformation.
    released : (b, 12) bool
        True for released motions of the ends, along the bar's own axes, end by end.
    spring : (s,) float64
        Stiffness of the springs.
    between : (s, 2, 2) int64
        Node and component of both dofs of each spring; node 0 is the ground.
    """

    node: NDArray[np.int64]
    offset: NDArray[np.float64]
    up: NDArray[np.float64]
    EA: NDArray[np.float64]
    GJ: NDArray[np.float64]
    EI: NDArray[np.float64]
    shear: NDArray[np.float64]
    released: NDArray[np.bool_]
    spring: NDArray[np.float64]
    between: NDArray[np.int64]


@dataclass(frozen=True)
class UnitLoad:
    """A load of one unit, along the body's basic axes.

    Parameters
    ----------
    kind : str
        ``acceleration`` and ``angular acceleration`` of the body's frame; ``centrifugal``: a product of two of its
        angular velocities; ``force`` and ``moment`` at a node. The first three mean the inertia forces that they cause,
        which act in the opposite direction.
    axes : str
        ``x``, ``y``, ``z``; for ``centrifugal`` one of ``SQUARES``.
    at : str
        Interface or node of a force or moment; empty for the others.

    Raises
    ------
    SceneError
        If there is no such load.
    """

    kind: str
    axes: str
    at: str = ""

    def __post_init__(self) -> None:
        known = self.axes in _AXES.get(self.kind, ())
        if not known or bool(self.at) != (self.kind in ("force", "moment")):
            raise SceneError(f"'{self.label}' is not a unit load: write one such as {_EXAMPLES}")

    @classmethod
    def parse(cls, text: str) -> UnitLoad:
        """Read the label of a load; the two axes of a product may be in either order.

        Examples
        --------
        >>> UnitLoad.parse("centrifugal yx").label
        'centrifugal xy'

        Raises
        ------
        SceneError
            If the text is not the label of a load.
        """
        found = _FORM.fullmatch(str(text))
        if found is None:
            raise SceneError(f"'{text}' is not a unit load: write one such as {_EXAMPLES}")
        return cls(found["kind"], "".join(sorted(found["axes"])), found["at"] or "")

    @property
    def label(self) -> str:
        """``kind axes`` or ``kind at.axis``."""
        return f"{self.kind} {self.at}.{self.axes}" if self.at else f"{self.kind} {self.axes}"

    def worth(self, units: Units) -> float:
        """Value in SI of one unit of the load in a unit system."""
        per_time = 1 / units.time**2
        sizes = {"acceleration": units.length * per_time, "force": units.force, "moment": units.energy}
        return sizes.get(self.kind, per_time)


def loads_in_words(labels: Sequence[str]) -> str:
    """Labels of loads in one line, with each kind named once.

    Examples
    --------
    >>> loads_in_words(["force 4.x", "centrifugal xx", "centrifugal xy"])
    'force 4.x; centrifugal xx xy'
    """
    kinds: dict[str, list[str]] = {}
    for label in labels:
        kind, _, axes = label.rpartition(" ")
        kinds.setdefault(kind, []).append(axes)
    return "; ".join(f"{kind} {' '.join(axes)}" for kind, axes in kinds.items())


INERTIA_LOADS = tuple(
    UnitLoad(kind, axes) for kind in ("acceleration", "angular acceleration", "centrifugal") for axes in _AXES[kind]
)
"""The twelve loads of a moving frame: three accelerations, three angular ones, six products of angular velocities."""


@dataclass(frozen=True, eq=False)
class GeometricStiffness:
    """Geometric stiffness of a body: under loads p_l, K becomes K + sum p_l K_l.

    Parameters
    ----------
    loads : tuple of UnitLoad
        Unit load of each matrix.
    matrices : tuple of (n, n) sparse array
        Symmetric, in the rows of the body; for the stress that the load causes in the held body.
    sources : tuple of str
        Source of each matrix: ``bars of the deck``, or a file.
    origin : (3,) float64
        Centre of rotation of the frame, in basic.
    held : str
        Support of the body while the loads act, in words.
    """

    loads: tuple[UnitLoad, ...]
    matrices: tuple[sp.csc_array, ...]
    sources: tuple[str, ...]
    origin: NDArray[np.float64]
    held: str


@dataclass(frozen=True, eq=False)
class ModalStiffening:
    """Geometric stiffness in modal coordinates.

    Parameters
    ----------
    loads : tuple of UnitLoad
        Unit loads.
    K : (loads, m, m) float64
        Phi^T K_l Phi of each load.
    origin : (3,) float64
        Centre of rotation of the frame, in basic.
    """

    loads: tuple[UnitLoad, ...]
    K: NDArray[np.float64]
    origin: NDArray[np.float64]

    def of(self, label: str) -> NDArray[np.float64] | None:
        """Matrix of a load (m, m); None if there is no such load."""
        labels = [load.label for load in self.loads]
        return self.K[labels.index(label)] if label in labels else None

    def spinning(self, velocity: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Stiffness (m, m) at a steady angular velocity (3,) in rad per unit of time, along the basic axes.

        None if a product of velocities is not zero and has no matrix.
        """
        total = np.zeros(self.K.shape[1:])
        for axes in SQUARES:
            a, b = ("xyz".index(axis) for axis in axes)
            product = float(velocity[a] * velocity[b])
            if product:
                K = self.of(f"centrifugal {axes}")
                if K is None:
                    return None
                total += product * K
        return total
