"""Coordinate systems: rectangular, cylindrical and spherical, defined in each other and through grids in any order."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cmsreduce.errors import ReadError
from cmsreduce.read.nastran.cards import Card, Cards
from cmsreduce.read.printed_numbers import printed_rounding

__all__ = [
    "BASIC",
    "FRAME_CARDS",
    "CoordinateSystem",
    "FrameChain",
    "FrameDefinition",
    "Grid",
    "frame_definitions",
    "printed_by",
]

_KINDS = {"R": "rectangular", "C": "cylindrical", "S": "spherical"}
_BY_POINTS = {f"CORD2{letter}": kind for letter, kind in _KINDS.items()}
_BY_GRIDS = {f"CORD1{letter}": kind for letter, kind in _KINDS.items()}
FRAME_CARDS = frozenset({*_BY_POINTS, *_BY_GRIDS})
"""Cards that define coordinate systems."""

# A point printed with eight digits lies off an axis through other such points by 1e-8 of its coordinates.
_ON_AXIS = 1e-7
# Below this the sine of the angle between AB and AC is round-off of eight printed digits.
_COLLINEAR = 1e-7
# Columns of a field; a number that fills it was cut to fit.
_FIELD = 8
# Systems defined in one another: more would exceed the stack of Python.
_DEEPEST = 100


@dataclass(frozen=True, eq=False)
class CoordinateSystem:
    """A coordinate system placed in basic.

    Parameters
    ----------
    id : int
        Number, 0 is basic.
    kind : str
        ``rectangular`` (x y z), ``cylindrical`` (r, theta in degrees from x, z) or ``spherical`` (r, theta in
        degrees from z, phi in degrees from x).
    origin : (3,) float64
        Origin in basic.
    axes : (3, 3) float64
        Unit vectors x y z as rows, in basic.
    origin_rounding : float
        Largest error of the origin, in the unit of length.
    angle_rounding : float
        Largest rotation error of the axes, in radians.
    """

    id: int
    kind: str
    origin: NDArray[np.float64]
    axes: NDArray[np.float64]
    origin_rounding: float = 0.0
    angle_rounding: float = 0.0

    @classmethod
    def through(
        cls, id: int, kind: str, points: ArrayLike, rounding: float = 0.0, angle_rounding: float = 0.0, where: str = ""
    ) -> CoordinateSystem:
        """System with origin A, z axis through B, and C in the half plane xz of positive x.

        Parameters
        ----------
        id, kind
            As of the class.
        points : (3, 3) array_like
            A, B and C in basic.
        rounding : float
            Largest error of each point, in the unit of length.
        angle_rounding : float
            Rotation error of the system that the points are given in, in radians.
        where : str
            Card of the system, for the message.

        Raises
        ------
        ReadError
            If the three points lie on a line.
        """
        A, B, C = np.asarray(points, dtype=np.float64)
        along, aside = B - A, C - A
        arm = float(np.linalg.norm(along))
        z = along / arm if arm > 0 else along
        normal = np.cross(z, aside)
        height = float(np.linalg.norm(normal))
        if arm == 0 or height <= _COLLINEAR * np.linalg.norm(aside) or height == 0:
            raise ReadError(f"{where or f'coordinate system {id}'}: its three points lie on one line")
        y = normal / height
        turn = 2 * rounding / min(arm, height) + angle_rounding
        return cls(id, kind, A, np.array([np.cross(y, z), y, z]), rounding, turn)

    def to_basic(self, points: ArrayLike) -> NDArray[np.float64]:
        """Basic coordinates of points given in this system, (k, 3) -> (k, 3)."""
        return self.origin + self._local(np.asarray(points, dtype=np.float64)) @ self.axes

    def _local(self, p: NDArray[np.float64]) -> NDArray[np.float64]:
        """Rectangular coordinates along the axes."""
        if self.kind == "rectangular":
            return p
        r, angle = p[..., 0], np.radians(p[..., 1])
        if self.kind == "cylindrical":
            return np.stack([r * np.cos(angle), r * np.sin(angle), p[..., 2]], axis=-1)
        flat, turn = r * np.sin(angle), np.radians(p[..., 2])
        return np.stack([flat * np.cos(turn), flat * np.sin(turn), r * np.cos(angle)], axis=-1)

    def position_rounding(self, points: NDArray[np.float64], rounding: NDArray[np.float64]) -> NDArray[np.float64]:
        """Largest errors of points given in this system, in the unit of length.

        Parameters
        ----------
        points, rounding : (k, 3) float64
            Coordinates in this system, and the largest error of each.

        Returns
        -------
        (k,) float64
        """
        own = rounding.copy()
        angles = {"rectangular": [], "cylindrical": [1], "spherical": [1, 2]}[self.kind]
        own[:, angles] *= np.radians(np.abs(points[:, :1]))
        reach = np.linalg.norm(self._local(points), axis=1)
        return np.asarray(np.linalg.norm(own, axis=1) + self.origin_rounding + self.angle_rounding * reach)

    def displacement_axes(self, xyz: ArrayLike) -> NDArray[np.float64]:
        """Axes along which displacements in this system are measured at points in basic.

        On the polar axis, where the direction of r is undefined, they are the system's x y z.

        Parameters
        ----------
        xyz : (k, 3) array_like
            Points in basic.

        Returns
        -------
        (k, 3, 3) float64
            Unit vectors as rows, in basic.
        """
        xyz = np.asarray(xyz, dtype=np.float64)
        frames = np.tile(self.axes, (xyz.shape[0], 1, 1))
        if self.kind == "rectangular":
            return frames
        x, y, z = ((xyz - self.origin) @ self.axes.T).T
        flat = np.hypot(x, y)
        off = flat > _ON_AXIS * (np.linalg.norm(xyz, axis=1) + np.linalg.norm(self.origin))
        c, s = x[off] / flat[off], y[off] / flat[off]
        zero, one = np.zeros_like(c), np.ones_like(c)
        if self.kind == "cylindrical":
            local = np.array([[c, s, zero], [-s, c, zero], [zero, zero, one]])
        else:
            far = np.hypot(flat[off], z[off])
            sin, cos = flat[off] / far, z[off] / far
            local = np.array([[sin * c, sin * s, cos], [cos * c, cos * s, -sin], [-s, c, zero]])
        frames[off] = np.einsum("ijk,jl->kil", local, self.axes)
        return frames

    def axes_rounding(self, xyz: NDArray[np.float64], rounding: NDArray[np.float64]) -> NDArray[np.float64]:
        """Largest rotation errors of displacement axes, in radians.

        Parameters
        ----------
        xyz : (k, 3) float64
            Points in basic.
        rounding : (k,) float64
            Largest error of each.

        Returns
        -------
        (k,) float64
        """
        turn = np.full(xyz.shape[0], self.angle_rounding)
        if self.kind == "rectangular":
            return turn
        x, y, _ = ((xyz - self.origin) @ self.axes.T).T
        flat = np.hypot(x, y)
        off = flat > _ON_AXIS * (np.linalg.norm(xyz, axis=1) + np.linalg.norm(self.origin))
        turn[off] += (rounding[off] + self.origin_rounding) / flat[off]
        return turn


BASIC = CoordinateSystem(0, "rectangular", np.zeros(3), np.eye(3))
"""The basic coordinate system."""


@dataclass(frozen=True)
class FrameDefinition:
    """A coordinate system as a card defines it; equal cards in different places are equal.

    Parameters
    ----------
    id : int
        Number.
    kind : str
        ``rectangular``, ``cylindrical`` or ``spherical``.
    where : str
        Card of the definition, for messages.
    reference : int
        System that ``points`` are given in.
    points : tuple of 9 float
        Origin, a point on the z axis, a point in the xz plane; empty for a system through grids.
    grids : tuple of int
        Grids at these three points, in place of ``points``.
    rounding : tuple of 9 float
        Rounding of ``points`` as printed.
    """

    id: int
    kind: str
    where: str = field(compare=False)
    reference: int = 0
    points: tuple[float, ...] = ()
    grids: tuple[int, ...] = ()
    rounding: tuple[float, ...] = field(default=(0.0,) * 9, compare=False)


def printed_by(card: Card, first: int, end: int) -> tuple[float, ...]:
    """Rounding of the numbers in some fields of a card."""
    return tuple(printed_rounding([card.text(k) for k in range(first, end)], _FIELD).tolist())


def frame_definitions(cards: Cards) -> dict[int, FrameDefinition]:
    """Coordinate systems by number.

    Raises
    ------
    ReadError
        If a system is defined twice with different data.
    """
    found: list[FrameDefinition] = []
    for name, kind in _BY_POINTS.items():
        for card in cards.get(name, ()):
            points = tuple(card.real(k) for k in range(2, 11))
            number, reference, rounding = card.integer(0), card.integer(1, 0), printed_by(card, 2, 11)
            found.append(FrameDefinition(number, kind, card.where, reference, points, rounding=rounding))
    for name, kind in _BY_GRIDS.items():
        for card in cards.get(name, ()):
            for start in (0, 4):
                if card.text(start):
                    grids = tuple(card.integer(start + k) for k in (1, 2, 3))
                    found.append(FrameDefinition(card.integer(start), kind, card.where, grids=grids))
    out: dict[int, FrameDefinition] = {}
    for frame in found:
        before = out.setdefault(frame.id, frame)
        if frame != before:
            raise ReadError(f"{frame.where}: coordinate system {frame.id} differs from {before.where}")
    return out


@dataclass(frozen=True)
class Grid:
    """A GRID card: coordinates ``x`` in system ``cp``, displacements in system ``cd``, sorted constraints ``ps``.

    ``rounding`` is that of ``x`` as printed.
    """

    cp: int
    x: tuple[float, float, float]
    where: str = field(compare=False)
    cd: int = 0
    ps: str = ""
    rounding: tuple[float, ...] = field(default=(0.0,) * 3, compare=False)


class FrameChain:
    """Resolves coordinate systems into basic.

    Parameters
    ----------
    definitions : mapping of int to FrameDefinition
        Systems by number.
    grids : mapping of int to Grid
        Grids by id.
    """

    def __init__(self, definitions: Mapping[int, FrameDefinition], grids: Mapping[int, Grid]) -> None:
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
            Card that refers to it, for messages.

        Raises
        ------
        ReadError
            If the system, or a system or grid that defines it, is missing, or it is defined by itself.
        """
        return self._system(id, where, ())

    def _system(self, id: int, where: str, waiting: tuple[int, ...]) -> CoordinateSystem:
        if id in self._resolved:
            return self._resolved[id]
        if id in waiting:
            loop = " -> ".join(str(i) for i in (*waiting[waiting.index(id) :], id))
            raise ReadError(f"{self._definitions[id].where}: coordinate system {id} is defined by itself: {loop}")
        if len(waiting) > _DEEPEST:
            raise ReadError(f"{where}: more than {_DEEPEST} coordinate systems in one another; define {id} in basic")
        if id not in self._definitions:
            known = ", ".join(str(i) for i in sorted(self._definitions)[:10]) or "none"
            raise ReadError(
                f"{where} refers to coordinate system {id}, which the deck does not define (it defines {known}). "
                "Include the file with its CORD card"
            )
        self._resolved[id] = self._place(self._definitions[id], (*waiting, id))
        return self._resolved[id]

    def _place(self, definition: FrameDefinition, waiting: tuple[int, ...]) -> CoordinateSystem:
        """Transform one definition into basic."""
        if definition.points:
            parent = self._system(definition.reference, definition.where, waiting)
            given, off = (np.reshape(each, (3, 3)) for each in (definition.points, definition.rounding))
            points, rounding = parent.to_basic(given), parent.position_rounding(given, off)
            turn = parent.angle_rounding
        else:
            placed = [self._grid(grid, definition.where, waiting) for grid in definition.grids]
            points = np.array([xyz for xyz, _ in placed])
            rounding, turn = np.array([off for _, off in placed]), 0.0
        return CoordinateSystem.through(
            definition.id, definition.kind, points, float(rounding.max()), turn, definition.where
        )

    def _grid(self, id: int, where: str, waiting: tuple[int, ...]) -> tuple[NDArray[np.float64], float]:
        """Position in basic of a grid that a system goes through, and its largest error."""
        if id not in self._grids:
            raise ReadError(f"{where} goes through grid {id}, which the deck does not have")
        grid = self._grids[id]
        system = self._system(grid.cp, grid.where, waiting)
        x = np.array([grid.x])
        return system.to_basic(x)[0], float(system.position_rounding(x, np.array([grid.rounding]))[0])
