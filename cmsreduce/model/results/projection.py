"""Projection of system modes and of scene shapes: what was projected, what came back, and how far it is certified."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "CertificateRecord",
    "ExtraneousMode",
    "ProjectionRecord",
    "SampledModes",
    "SolvedPoint",
]

# Smallest MAC at which an extraneous mode is a mode of the reference model.
_ALIKE = 0.9


@dataclass(frozen=True, eq=False)
class ExtraneousMode:
    """A mode of the reassembled system that was not chosen.

    Parameters
    ----------
    configuration : str
        Name of the configuration.
    hz : float
        Frequency.
    body : str
        Body with the largest part of its energy.
    energy : mapping of body to float
        Share of each body in the mode's kinetic and strain energy, which sum to one.
    interface : str
        Interface with the largest motion, relative to the motion of all modes there; empty without interfaces.
    weight : (outputs,) float64
        Largest peak, over the inputs, in each output, relative to the largest peak of any mode there.
    mac : float
        Largest MAC with a mode of the reference model that was not chosen: near one, it is this mode; well below one,
        the reference model has no such mode.
    """

    configuration: str
    hz: float
    body: str
    energy: Mapping[str, float]
    interface: str
    weight: NDArray[np.float64]
    mac: float = 0.0

    @property
    def spurious(self) -> bool:
        """True if the reference model has no such mode."""
        return self.mac < _ALIKE


@dataclass(frozen=True, eq=False)
class SampledModes:
    """System modes projected in one configuration, and their errors after reassembly.

    Parameters
    ----------
    configuration : str
        Name of the configuration.
    hz : (n_R,) float64
        Chosen natural frequencies.
    error : (n_R,) float64
        Relative error of each in the reassembled system.
    extraneous : int
        Number of elastic modes of the reassembled system that were not chosen.
    predicted : int, optional
        The same number by sum r_i - rank(A_R) - n_R, with a separately computed rank of the reduced constraints.
    """

    configuration: str
    hz: NDArray[np.float64]
    error: NDArray[np.float64]
    extraneous: int
    predicted: int | None = None


@dataclass(frozen=True)
class SolvedPoint:
    """Error of the reduced response at one frequency, by a solve of the unreduced bodies.

    Parameters
    ----------
    configuration : str
    hz : float
    error : float
        Of all channels, relative to their elastic response there.
    estimate, bound : float
        Of this error, by residuals.
    """

    configuration: str
    hz: float
    error: float
    estimate: float
    bound: float


@dataclass(frozen=True, eq=False)
class CertificateRecord:
    """Errors of the reduced responses by residuals, and solves of the unreduced bodies that check them.

    Parameters
    ----------
    estimated, bound : mapping of configuration to float
        Estimate of frf_error, and a bound of it that is proven for the system of all candidates.
    solved : tuple of SolvedPoint
        Frequencies with the largest estimates.
    factor : float
        The error of a configuration is at most so many times its estimate, as a rule, where the estimate has settled.
    reference : mapping of body to str
        The unreduced bodies as they were solved.
    unsettled : tuple of str
        Configurations whose estimate has not: the factor does not hold there.
    """

    estimated: Mapping[str, float]
    bound: Mapping[str, float]
    solved: tuple[SolvedPoint, ...]
    factor: float
    reference: Mapping[str, str]
    unsettled: tuple[str, ...] = ()

    @property
    def worst(self) -> tuple[str, float, float]:
        """Configuration with the largest bound, its estimate and its bound."""
        name = max(self.bound, key=lambda each: self.bound[each])
        return name, self.estimated[name], self.bound[name]


@dataclass(frozen=True, eq=False)
class ProjectionRecord:
    """One run of the project stage.

    Parameters
    ----------
    sampled : tuple of SampledModes
        Projected modes, configuration by configuration.
    singular : mapping of body to (k,) float64
        Singular values of all shapes projected on the body, in the norm of its mass, the largest first.
    rank : mapping of body to int
        Number of shapes kept.
    extraneous : tuple of ExtraneousMode
        Extraneous modes in the band, in every sampled configuration; many of them are modes of the reference model.
    suppressed : mapping of body to int
        Number of static shapes added to move extraneous modes out of the band; empty if none were added.
    between : mapping of str to float
        frf_error at the midpoint configurations, if measured.
    limit : float, optional
        Largest frf_error allowed there.
    tolerance : float
        Largest singular value of a dependent shape.
    outputs : tuple of str
        Names of the outputs of ``ExtraneousMode.weight``.
    configurations : tuple of str
        Configurations that scene shapes were optimised in; empty if system modes were projected.
    certificate : CertificateRecord, optional
        Errors of scene shapes by residuals.
    """

    sampled: tuple[SampledModes, ...]
    singular: Mapping[str, NDArray[np.float64]]
    rank: Mapping[str, int]
    extraneous: tuple[ExtraneousMode, ...] = ()
    suppressed: Mapping[str, int] = field(default_factory=dict)
    between: Mapping[str, float] = field(default_factory=dict)
    limit: float | None = None
    tolerance: float = 0.0
    outputs: tuple[str, ...] = ()
    configurations: tuple[str, ...] = ()
    certificate: CertificateRecord | None = None

    @property
    def worst_return(self) -> float:
        """Largest relative error of a chosen frequency in the reassembled system, in any sampled configuration."""
        return max((float(each.error.max(initial=0.0)) for each in self.sampled), default=0.0)
