"""Range of the articulation: all configurations between those that the scene names."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import DOF_NAMES, Configuration, Scene
from cmsreduce.pipeline.system import midpoint_configurations

__all__ = ["ArticulationRange"]

Real = NDArray[np.float64]

# Corners of the range that are listed: those of four motions.
_CORNERS = 16


class ArticulationRange:
    """Configurations that a scene may take between its named ones.

    Parameters
    ----------
    scene : Scene

    Notes
    -----
    If the configurations are a product of values, the range is the box between the smallest and the largest value of
    each motion; a rotation whose values span more than half a turn turns all the way round. Otherwise the
    configurations are a path, and the range is the straight lines from each one to the next.
    """

    def __init__(self, scene: Scene) -> None:
        self._scene = scene
        self.axes = sorted({axis for each in scene.configurations for axis in each.angles})
        named = np.array([[each.angles.get(axis, 0.0) for axis in self.axes] for each in scene.configurations])
        self._named = named.reshape(len(scene.configurations), len(self.axes))
        values = [np.unique(column) for column in self._named.T]
        count = int(np.prod([found.size for found in values]))
        self.is_box = len(np.unique(self._named, axis=0)) == count
        self.low = np.array([found[0] for found in values])
        self.high = np.array([found[-1] for found in values])
        turns = np.array([dof >= len(DOF_NAMES) // 2 for _, dof in self.axes], dtype=bool)
        self.turning = turns & (self.high - self.low > np.pi)
        self.high = np.where(self.turning, self.low + 2 * np.pi, self.high)

    @property
    def is_point(self) -> bool:
        """The scene has one configuration only."""
        return len(self._named) < 2 or not (self.high > self.low).any()

    def points(self, count: int, first: int = 0) -> list[Configuration]:
        """Configurations that fill the range evenly, whatever their number.

        Parameters
        ----------
        count : int
        first : int
            Number of points of earlier calls, which are left out.

        Notes
        -----
        Multiples of the powers of a generalised golden ratio, modulo one (Roberts, 2018): each further point falls
        into the largest gap.
        """
        if self.is_point:
            return []
        moving = self.high > self.low if self.is_box else np.ones(1, dtype=bool)
        d = int(np.count_nonzero(moving))
        ratio = 2.0
        for _ in range(60):
            ratio = (1 + ratio) ** (1 / (d + 1))
        steps = ratio ** -np.arange(1.0, d + 1)
        shares = (0.5 + np.outer(np.arange(first + 1, first + count + 1), steps)) % 1.0
        return self._at(shares)

    def random(self, count: int, seed: int) -> list[Configuration]:
        """Configurations drawn at random from the range."""
        d = int(np.count_nonzero(self.high > self.low)) if self.is_box else 1
        return self._at(np.random.default_rng(seed).random((count, d)))

    def corners(self) -> list[Configuration]:
        """Corners of the range, and the midpoint configurations."""
        if self.is_point:
            return []
        found = midpoint_configurations(self._scene)
        if self.is_box:
            ends = [(a, b) if b > a else (a,) for a, b in zip(self.low, self.high, strict=True)]
            for values in list(product(*ends))[:_CORNERS]:
                found.append(self._configuration(np.array(values)))
        return found

    def around(self, configuration: Configuration, share: float) -> list[Configuration]:
        """Configurations that differ by a share of the range in one motion; none on a path."""
        here = np.array([configuration.angles.get(axis, 0.0) for axis in self.axes])
        found = []
        for k in np.flatnonzero(self.high > self.low) if self.is_box else ():
            for step in (-share, share):
                there = here.copy()
                there[k] += step * (self.high[k] - self.low[k])
                if self.low[k] <= there[k] <= self.high[k]:
                    found.append(self._configuration(there))
        return found

    def apart(self, one: Configuration, other: Configuration) -> float:
        """Distance of two configurations: the largest share of the range of a motion that lies between them."""
        size = np.where(self.high > self.low, self.high - self.low, 1.0)
        away = np.array([abs(one.angles.get(axis, 0.0) - other.angles.get(axis, 0.0)) for axis in self.axes]) / size
        return float(np.where(self.turning, np.minimum(away, abs(1 - away)), away).max(initial=0.0))

    def _at(self, shares: Real) -> list[Configuration]:
        if self.is_box:
            values = np.tile(self.low, (len(shares), 1))
            moving = self.high > self.low
            values[:, moving] += shares * (self.high - self.low)[moving]
        else:
            place = shares[:, 0] * (len(self._named) - 1)
            at = np.minimum(place.astype(np.int64), len(self._named) - 2)
            values = self._named[at] + (place - at)[:, None] * (self._named[at + 1] - self._named[at])
        return [self._configuration(each) for each in values]

    def _configuration(self, values: Sequence[float] | Real) -> Configuration:
        labels = []
        for (joint, dof), value in zip(self.axes, values, strict=True):
            shown = np.degrees(value) if dof >= len(DOF_NAMES) // 2 else value
            labels.append(f"{joint}.{DOF_NAMES[dof]}={shown:.6g}")
        angles = dict(zip(self.axes, (float(value) for value in values), strict=True))
        return Configuration(" ".join(labels), angles, between=True)
