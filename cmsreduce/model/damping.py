"""Damping laws of a body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cmsreduce.errors import DampingError
from cmsreduce.model.mode_set import repeated_groups

__all__ = ["Damping"]

_LAWS = ("modal", "table", "per_mode", "rayleigh", "structural")


@dataclass(frozen=True)
class Damping:
    """Damping law of a body; one of the laws, or none (undamped, or a matrix D on the body itself).

    Parameters
    ----------
    modal : float, optional
        One damping ratio for every elastic mode.
    table : tuple of (frequency in Hz, ratio), optional
        Damping ratio against frequency, interpolated linearly, held constant outside.
    per_mode : tuple of float, optional
        Damping ratio of each elastic mode in order of frequency; the last one is used for all later modes. Modes of one
        repeated frequency have the mean of theirs.
    rayleigh : (alpha, beta), optional
        D = alpha M + beta K; alpha in 1/s, beta in s.
    structural : float, optional
        Loss factor g: complex stiffness K (1 + i g).

    Raises
    ------
    DampingError
        If more than one law is given, or a value is not positive.
    """

    modal: float | None = None
    table: tuple[tuple[float, float], ...] | None = None
    per_mode: tuple[float, ...] | None = None
    rayleigh: tuple[float, float] | None = None
    structural: float | None = None

    def __post_init__(self) -> None:
        given = [name for name in _LAWS if getattr(self, name) is not None]
        if len(given) > 1:
            raise DampingError(f"damping is given twice, as {' and '.join(given)}: keep one")
        if not given:
            return
        value = getattr(self, given[0])
        numbers = np.ravel(np.asarray(value, dtype=np.float64))
        if numbers.size == 0:
            raise DampingError(f"damping {given[0]}: the list is empty: write its numbers, or leave `damping` out")
        if not np.isfinite(numbers).all():
            raise DampingError(f"damping {given[0]}: {value} is not a finite number")
        if given[0] == "rayleigh":
            if numbers.min() < 0 or numbers.max() <= 0:
                raise DampingError(f"damping rayleigh: alpha, beta = {value} must not be negative, nor both zero")
            return
        ratios = numbers.reshape(-1, 2)[:, 1] if given[0] == "table" else numbers
        if ratios.min() <= 0:
            raise DampingError(
                f"damping {given[0]}: {ratios.min():g} is not positive; a mode without damping has no finite "
                "peak. Give a small ratio such as 0.001, or leave `damping` out for an undamped body"
            )
        if given[0] == "table" and (np.diff(numbers.reshape(-1, 2)[:, 0]) <= 0).any():
            raise DampingError("damping table: frequencies must increase")

    @property
    def law(self) -> str:
        """Name of the law that is given, ``none`` without one."""
        return next((name for name in _LAWS if getattr(self, name) is not None), "none")

    def scaled(self, factor: float) -> Damping:
        """The same law with its damping multiplied by a factor above zero."""
        return Damping(
            None if self.modal is None else factor * self.modal,
            None if self.table is None else tuple((hz, factor * ratio) for hz, ratio in self.table),
            None if self.per_mode is None else tuple(factor * ratio for ratio in self.per_mode),
            None if self.rayleigh is None else (factor * self.rayleigh[0], factor * self.rayleigh[1]),
            None if self.structural is None else factor * self.structural,
        )

    @property
    def acts_on_modes(self) -> bool:
        """True if the law is stated mode by mode: then a response of the unreduced body needs all its modes."""
        return self.law in {"modal", "table", "per_mode"}

    def ratios(self, omega: ArrayLike) -> NDArray[np.float64]:
        """Viscous damping ratio of each elastic mode.

        Parameters
        ----------
        omega : (e,) array_like
            Elastic natural frequencies, ascending, rad/s, all positive.

        Returns
        -------
        (e,) float64
            Ratios; for a structural loss factor g the equivalent g/2 at resonance; zero without damping.
        """
        w = np.asarray(omega, dtype=np.float64)
        if self.modal is not None:
            return np.asarray(self.modal * np.ones_like(w))
        if self.table is not None:
            frequency, ratio = np.array(self.table).T
            return np.asarray(np.interp(w / (2 * np.pi), frequency, ratio))
        if self.per_mode is not None:
            given = np.array(self.per_mode)
            stated = given[np.minimum(np.arange(w.size), given.size - 1)]
            # Shapes of a repeated mode are any basis of one space: no basis changes the mean alone.
            group = repeated_groups(w)
            return np.asarray((np.bincount(group, stated) / np.bincount(group))[group])
        if self.rayleigh is not None:
            alpha, beta = self.rayleigh
            return alpha / (2 * w) + beta * w / 2
        if self.structural is not None:
            return self.structural / 2 * np.ones_like(w)
        return np.zeros(w.shape)
