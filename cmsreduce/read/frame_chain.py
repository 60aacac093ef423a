"""Coordinate systems that are defined in one another and through grids, in any order."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import ReadError
from cmsreduce.read.frames import BASIC, CoordinateSystem
from cmsreduce.read.printed_digits import printed_rounding

__all__ = ["FrameChain", "FrameDefinition", "GridLocation"]


@dataclass(frozen=True, eq=False)
class FrameDefinition:
    """A coordinate system as a card defines it.

    Parameters
    ----------
    id : int
        Number.
    kind : str
        ``rectangular``, ``cylindrical`` or ``spherical``.
    where : str
        Card it comes from, for messages.
    reference : int
        System that ``points`` are given in.
    points : (3, 3) float64, optional
        Origin, a point on the z axis, a point in the xz plane.
    grids : tuple of int
        Grids at those three points, where ``points`` is None.
    """

    id: int
    kind: str
    where: str
    reference: int = 0
    points: NDArray[np.float64] | None = None
    grids: tuple[int, ...] = ()

    def same_as(self, other: FrameDefinition) -> bool:
        """Whether both say the same, so that one may be dropped."""
        return (self.kind, self.reference, self.grids) == (other.kind, other.reference, other.grids) and np.array_equal(
            self.points if self.points is not None else (), other.points if other.points is not None else ()
        )


@dataclass(frozen=True)
class GridLocation:
    """Where a card says a grid is: coordinates ``x`` in system ``cp``."""

    cp: int
    x: tuple[float, float, float]
    where: str


class FrameChain:
    """Resolves coordinate systems into basic.

    Parameters
    ----------
    definitions : mapping of int to FrameDefinition
        Systems by number.
    grids : mapping of int to GridLocation
        Grids by id.
    """

    def __init__(self, definitions: Mapping[int, FrameDefinition], grids: Mapping[int, GridLocation]) -> None:
        self._definitions = definitions
        self._grids = grids
        self._resolved: dict[int, CoordinateSystem] = {0: BASIC}

    def system(self, id: int, where: str) -> CoordinateSystem:
        """Coordinate system of a number.

        Parameters
        ----------
        id : int
            Number of the system.
        where : str
            Card that asks for it, for messages.

        Raises
        ------
        ReadError
            If it, or a system or grid it builds on, is missing, or it builds on itself.
        """
        return self._system(id, where, ())

    def _system(self, id: int, where: str, waiting: tuple[int, ...]) -> CoordinateSystem:
        if id in self._resolved:
            return self._resolved[id]
        if id in waiting:
            loop = " -> ".join(str(i) for i in (*waiting[waiting.index(id) :], id))
            raise ReadError(f"{self._definitions[id].where}: coordinate system {id} is defined by itself: {loop}")
        if id not in self._definitions:
            known = ", ".join(str(i) for i in sorted(self._definitions)[:10]) or "none"
            raise ReadError(
                f"{where} refers to coordinate system {id}, which the deck does not define (it defines {known}). "
                "Include the file with its CORD card"
            )
        found = self._place(self._definitions[id], (*waiting, id))
        self._resolved[id] = found
        return found

    def _place(self, definition: FrameDefinition, waiting: tuple[int, ...]) -> CoordinateSystem:
        """Put one definition into basic."""
        if definition.points is not None:
            parent = self._system(definition.reference, definition.where, waiting)
            points = parent.to_basic(definition.points)
            rounding = parent.position_rounding(definition.points, printed_rounding(definition.points))
            turn = parent.angle_rounding
        else:
            placed = [self._grid(grid, definition.where, waiting) for grid in definition.grids]
            points = np.array([xyz for xyz, _ in placed])
            rounding, turn = np.array([off for _, off in placed]), 0.0
        return CoordinateSystem.through(
            definition.id, definition.kind, points, float(rounding.max()), turn, definition.where
        )

    def _grid(self, id: int, where: str, waiting: tuple[int, ...]) -> tuple[NDArray[np.float64], float]:
        """Position in basic of a grid that a system goes through, and how far it may be off."""
        if id not in self._grids:
            raise ReadError(f"{where} goes through grid {id}, which the deck does not have")
        grid = self._grids[id]
        system = self._system(grid.cp, grid.where, waiting)
        x = np.array([grid.x])
        return system.to_basic(x)[0], float(system.position_rounding(x, printed_rounding(x))[0])
