"""A hard case: a body that breaks textbook code, and what every mode set must make of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.errors import CmsReduceError, SingularInterfaceError
from cmsreduce.model import FEModel, InterfaceLoading

__all__ = ["COMPLETE", "LIMITS", "LOADED", "METHODS", "NOT_HELD", "Case", "Refusal"]

METHODS = ("craig-bampton", "macneal-rubin", "benfield-hruda", "augmented", "guyan")
COMPLETE = ("craig-bampton", "macneal-rubin", "guyan")
"""Sets that hold the static response to every load on the interface."""
LOADED = ("benfield-hruda", "augmented")
"""Sets whose modes are those of the company, and which hold no static response."""

LIMITS: Mapping[str, float | None] = {"macneal-rubin": 0.01, "guyan": None}
"""Largest frf_error of the sets whose limit is one for all bodies, at 1 % of critical damping.

Of a free mode at w_c left out, residuals keep the static part and its inertia: what is missed is (w/w_c)^4 of its share
in the response, at most 1/16 and 1/80 on average over a band of half its frequency. Guyan has no modes: nothing is
promised of its dynamics.
"""


@dataclass(frozen=True)
class Refusal:
    """The error that a mode set must meet a body with.

    Parameters
    ----------
    error : type
        Its class.
    reason : str
        Pattern of what its message must say besides the body's name.
    """

    error: type[CmsReduceError]
    reason: str


def _not_held(*methods: str) -> dict[str, Refusal]:
    return dict.fromkeys(methods, Refusal(SingularInterfaceError, r"rigid-body motions, but its \d+ interface dofs"))


NOT_HELD = _not_held("craig-bampton", "guyan")
"""What the sets with constraint modes say of an interface that does not hold the body."""


@dataclass(frozen=True, eq=False)
class Case:
    """One difficulty.

    Parameters
    ----------
    name : str
        What a table calls it.
    hard : str
        What is hard about it.
    treated : str
        What the package does about it.
    body : FEModel
        n dofs.
    interface : (i,) int64
        Rows of the i-set.
    band_hz : (float, float)
        Where responses are compared; normal modes are kept up to twice its end.
    rigid : (n, r) float64
        All motions that strain nothing, from the construction of the body.
    loads : (n, l) float64, optional
        Self-balancing loads inside the body.
    sensors : (s,) int64
        Rows measured besides the interface.
    measured : bool
        Whether anything is measured at all.
    neighbour : InterfaceLoading, optional
        What the body is joined to: its loading of the interface, and the company responses are compared in.
    truth : FEModel, optional
        The body before its numbers were spoilt; the body itself if absent.
    loss : float
        Structural loss factor of the responses; zero compares between the resonances.
    points : int
        Frequencies compared, besides those around resonances.
    probes : (p,) int64, optional
        Interface rows that responses are compared at, where they are too many to look at all.
    completeness : float
        Largest share of the strain energy of static responses that a complete set may miss.
    limits : mapping of method to float or None
        Largest frf_error where it is not that of theory in general.
    refused : mapping of method to Refusal
        Sets that do not apply.
    """

    name: str
    hard: str
    treated: str
    body: FEModel
    interface: NDArray[np.int64]
    band_hz: tuple[float, float]
    rigid: NDArray[np.float64]
    loads: NDArray[np.float64] | None = None
    sensors: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    measured: bool = True
    neighbour: InterfaceLoading | None = None
    truth: FEModel | None = None
    loss: float = 0.02
    points: int = 60
    probes: NDArray[np.int64] | None = None
    completeness: float = 1e-10
    limits: Mapping[str, float | None] = field(default_factory=dict)
    refused: Mapping[str, Refusal] = field(default_factory=dict)

    @property
    def exact(self) -> FEModel:
        """The body that answers are compared with."""
        return self.body if self.truth is None else self.truth

    @property
    def loading(self) -> NDArray[np.float64]:
        """Static loads: unit forces on the interface, then those inside the body (n, i + l)."""
        return self._with_loads(self.interface)

    @property
    def inputs(self) -> NDArray[np.float64]:
        """Forces that responses are compared under (n, u)."""
        return self._with_loads(self._probed)

    @property
    def outputs(self) -> NDArray[np.int64]:
        """Rows measured."""
        return np.concatenate([self._probed, self.sensors]) if self.measured else np.empty(0, dtype=np.int64)

    @property
    def _probed(self) -> NDArray[np.int64]:
        return self.interface if self.probes is None else self.probes

    def _with_loads(self, rows: NDArray[np.int64]) -> NDArray[np.float64]:
        unit = np.zeros((self.body.n, rows.size))
        unit[rows, np.arange(rows.size)] = 1.0
        return unit if self.loads is None else np.hstack([unit, self.loads])

    @property
    def cutoff_hz(self) -> float:
        """Highest frequency of normal modes."""
        return 2 * self.band_hz[1]

    def joined(self) -> tuple[sp.csc_array, sp.csc_array]:
        """K and M of the exact body joined to its neighbour."""
        K, M = self.exact.K, self.exact.M
        if self.neighbour is None:
            return K, M
        E = sp.csc_array(self.loading[:, : self.interface.size])
        added = (sp.csc_array(E @ sp.csc_array(A) @ E.T) for A in (self.neighbour.K, self.neighbour.M))
        return tuple(sp.csc_array(A + B) for A, B in zip((K, M), added, strict=True))  # type: ignore[return-value]
