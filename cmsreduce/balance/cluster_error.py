"""What a cluster loses when it is cut down to some directions: its mean square error, in closed form."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cmsreduce.linalg.gramians import Band, band_shares, check_damped
from cmsreduce.model import ModalChannels

__all__ = ["ClusterError"]

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ClusterError:
    """H2 errors of a few modes that are cut down to combinations of themselves, relative to their own H2 norm.

    Parameters
    ----------
    channels : ModalChannels
        m damped modes of one cluster.
    band : (float, float), optional
        Frequencies in rad/s that count; all by default.

    Notes
    -----
    The square of an H2 norm is the mean square of all outputs under white noise at all inputs. That of modes i with
    inputs b_i, displacement outputs c_i and rate outputs r_i is the sum over all pairs of
    (b_i . b_j) ((c_i . c_j) s + (r_i . r_j) (d_j w_i^2 + d_i w_j^2)) / Delta in the letters of `controllability`.
    """

    channels: ModalChannels
    band: Band | None = None

    def __post_init__(self) -> None:
        check_damped(self.channels, "the error of a cluster")

    @cached_property
    def rows(self) -> Array:
        """Products of the modes' rows of inputs and of outputs, each relative to all of them (m, m)."""
        inputs, displacements, rates = self._products
        w, _ = self._lines
        outputs = displacements / np.outer(w, w) + rates
        return np.asarray(sum(G / np.trace(G) for G in (inputs, outputs) if np.trace(G) > 0))

    @cached_property
    def whole(self) -> float:
        """Square of the H2 norm of the modes."""
        inputs, displacements, rates = self._products
        c, r = self._kernels(self._lines, self._lines)
        return max(float(np.sum(inputs * (displacements * c + rates * r))), 0.0)

    def relative(self, Q: Array) -> Array:
        """Error of the cluster cut down to some directions, for several choices of them.

        Parameters
        ----------
        Q : (choices, m, k) float64
            Orthonormal columns.

        Returns
        -------
        (choices,) float64
            H2 norm of what is lost over that of the cluster; zero where that is zero. It is a difference of squares, so
            that less than 1e-8 is nothing.
        """
        if not self.whole or not Q.shape[2]:
            return np.full(Q.shape[0], 1.0 if self.whole else 0.0)
        w, d = self._lines
        squared, X = np.linalg.eigh(np.swapaxes(Q, 1, 2) @ (w[:, None] ** 2 * Q))
        Y = Q @ X
        lines = np.sqrt(squared), np.sum(Y**2 * d[:, None], axis=1)
        mixed = [np.swapaxes(Y, 1, 2) @ product for product in self._products]
        own = [each @ Y for each in mixed]
        shared, kept = (
            np.sum(b * (c * displacement + r * rate), axis=(1, 2))
            for (b, c, r), (displacement, rate) in (
                (mixed, self._kernels(lines, self._lines)),
                (own, self._kernels(lines, lines)),
            )
        )
        return np.asarray(np.sqrt(np.maximum(self.whole - 2 * shared + kept, 0.0) / self.whole))

    @cached_property
    def _lines(self) -> tuple[Array, Array]:
        return self.channels.omega, 2 * self.channels.zeta * self.channels.omega

    @cached_property
    def _products(self) -> tuple[Array, Array, Array]:
        ch = self.channels
        return ch.B @ ch.B.T, ch.C1.T @ ch.C1, ch.C2.T @ ch.C2

    def _kernels(self, one: tuple[Array, Array], other: tuple[Array, Array]) -> tuple[Array, Array]:
        """Mean square of pairs of modes of unit gain, displacements and rates: (..., i) and (..., j) to (..., i, j)."""
        wi, di = (each[..., :, None] for each in one)
        wj, dj = (each[..., None, :] for each in other)
        D, s, E = (wi - wj) * (wi + wj), di + dj, dj * wi**2 + di * wj**2
        delta = D**2 + s * E
        if self.band is None:
            return s / delta, E / delta
        a11, a12, a21, a22 = (x[..., :, None] for x in band_shares(one[0], one[1] / (2 * one[0]), self.band))
        b11, b12, b21, b22 = (x[..., None, :] for x in band_shares(other[0], other[1] / (2 * other[0]), self.band))
        return (
            ((a11 + b11) * s - (a12 / wi - b12 / wj) * D) / delta,
            ((a22 + b22) * E + (a21 * wi - b21 * wj) * D) / delta,
        )
