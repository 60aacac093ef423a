"""What the stress of a unit load adds to a body's stiffness, load by load (theory section 8)."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import SceneError
from cmsreduce.model.units import Units

__all__ = ["INERTIA_LOADS", "SQUARES", "GeometricStiffness", "ModalStiffening", "UnitLoad", "loads_in_words"]

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


@dataclass(frozen=True)
class UnitLoad:
    """A load of one unit, along the body's basic axes.

    Parameters
    ----------
    kind : str
        ``acceleration`` and ``angular acceleration`` of the body's frame; ``centrifugal``: a product of two of its
        angular velocities; ``force`` and ``moment`` at a node. The first three stand for the inertia forces that they
        cause, which pull the other way.
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
            raise SceneError(f"'{self.label}' is no unit load: write one such as {_EXAMPLES}")

    @classmethod
    def parse(cls, text: str) -> UnitLoad:
        """Read a load's label; the two axes of a product may stand in either order.

        Examples
        --------
        >>> UnitLoad.parse("centrifugal yx").label
        'centrifugal xy'

        Raises
        ------
        SceneError
            If the text names no load.
        """
        found = _FORM.fullmatch(str(text))
        if found is None:
            raise SceneError(f"'{text}' is no unit load: write one such as {_EXAMPLES}")
        return cls(found["kind"], "".join(sorted(found["axes"])), found["at"] or "")

    @property
    def label(self) -> str:
        """``kind axes`` or ``kind at.axis``."""
        return f"{self.kind} {self.at}.{self.axes}" if self.at else f"{self.kind} {self.axes}"

    def worth(self, units: Units) -> float:
        """The load in SI: what one unit of it is, in a unit system."""
        per_time = 1 / units.time**2
        sizes = {"acceleration": units.length * per_time, "force": units.force, "moment": units.energy}
        return sizes.get(self.kind, per_time)


def loads_in_words(labels: Sequence[str]) -> str:
    """Labels of loads, of each kind once.

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
    """Matrices of a whole body: under loads p_l, K becomes K + sum p_l K_l.

    Parameters
    ----------
    loads : tuple of UnitLoad
        What each matrix is for one unit of.
    matrices : tuple of (n, n) sparse array
        In the rows of the body, symmetric; of a load along with the stress it causes in the body held.
    sources : tuple of str
        Where each comes from: ``bars of the deck``, or a file.
    origin : (3,) float64
        Point the frame turns about, in basic.
    held : str
        What holds the body while the loads act, in words.
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
        Phi^T K_l Phi of each.
    origin : (3,) float64
        Point the frame turns about, in basic.
    """

    loads: tuple[UnitLoad, ...]
    K: NDArray[np.float64]
    origin: NDArray[np.float64]

    def of(self, label: str) -> NDArray[np.float64] | None:
        """Matrix of a load (m, m); None where there is none."""
        labels = [load.label for load in self.loads]
        return self.K[labels.index(label)] if label in labels else None

    def spinning(self, velocity: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """Stiffness (m, m) at a steady angular velocity (3,) in rad per unit of time, along the basic axes.

        None where a product of velocities that is not zero has no matrix.
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
