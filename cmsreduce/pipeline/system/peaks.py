"""Peaks of the response of a model: where they are and how wide, with the damping as it is."""

from __future__ import annotations

from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from cmsreduce.errors import CmsReduceError
from cmsreduce.model import Configuration
from cmsreduce.pipeline.system.assembled import AssembledModel
from cmsreduce.pipeline.system.reduced_model import cross_orthogonality
from cmsreduce.pipeline.system.resonances import DampedModes
from cmsreduce.verify import with_roots

__all__ = ["peak_damping", "peaks"]

Real = NDArray[np.float64]


def peaks(model: AssembledModel, configuration: Configuration) -> tuple[Real, Real]:
    """Frequencies in rad/s and damping ratios of the peaks of a model: its modes without damping and complex ones."""
    found, damped = model.resonances(configuration), _damped(model, configuration)
    s = np.empty(0, dtype=np.complex128) if damped is None else damped.s
    return with_roots(found.omega, found.zeta, s)


def peak_damping(model: AssembledModel, configuration: Configuration) -> Real:
    """Damping ratios (k,) of the elastic modes up to a little above the band, no larger than in the complex modes.

    A damper that several modes share makes modes of other shapes, of which some have hardly any of it: a mode has the
    ratio of the complex mode that is most like it, if that is less than its own share of the damping.
    """
    found, damped = model.resonances(configuration), _damped(model, configuration)
    if damped is None or not damped.s.size:
        return found.zeta
    masses = {name: sub.M for name, sub in model.at(configuration).substructures.items()}
    shapes = {name: X.astype(np.complex128) for name, X in found.shapes.items()}
    s = damped.s[abs(cross_orthogonality(shapes, damped.shapes, masses)).argmax(axis=1)]
    return np.asarray(np.minimum(found.zeta, np.maximum(-s.real, 0.0) / abs(s)))


def _damped(model: AssembledModel, configuration: Configuration) -> DampedModes | None:
    # Roots that cannot be found are reported with the errors of the damping ratios.
    with suppress(CmsReduceError, np.linalg.LinAlgError):
        return model.damped_modes(configuration)
    return None
