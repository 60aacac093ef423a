"""Errors of a reduced model in one configuration: its response, its modes and their damping."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import Configuration, DampedPairs, MacMatrix, ModelErrors, UnpairedMode
from cmsreduce.pipeline.store import diagnostic
from cmsreduce.pipeline.system.assembled import AssembledModel
from cmsreduce.pipeline.system.peaks import peak_damping, peaks
from cmsreduce.pipeline.system.reduced_model import ReducedModel, cross_orthogonality
from cmsreduce.pipeline.system.reference_model import ReferenceModel, Target
from cmsreduce.verify import (
    FrequencyPairs,
    channel_errors,
    complex_mac,
    frac,
    frf_error,
    lost_complex_modes,
    pair_complex_modes,
    pair_frequencies,
    peak_errors,
    peak_shifts,
    responding_channels,
)

__all__ = ["model_errors"]

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

# A reduced model has a response in a channel that the reference model does not have if it is above -120 dB of what the
# channel could have; smaller ones come from rounding of its modes.
_FALSE = 1e-6
# A mode whose frequency or damping ratio errs by more than this is named, with the channel that shows it.
_FAR = 0.1


def model_errors(
    reference: ReferenceModel,
    target: Target,
    model: ReducedModel,
    H_r: Complex,
    in_db: Real,
    seconds: float | None = None,
    *,
    damped: bool = True,
    at_peaks: bool = False,
) -> ModelErrors:
    """Errors of a model in one configuration.

    Parameters
    ----------
    reference : ReferenceModel
    target : Target
        Response of the reference model.
    model : ReducedModel
    H_r : (f, outputs, inputs) complex128
        Response of the model on the grid of the target.
    in_db : (outputs, inputs) float64
        Its decibel errors.
    seconds : float, optional
        Wall time of its response.
    damped : bool
        Pair the complex modes, too, for the errors of damping ratios.
    at_peaks : bool
        Measure the heights of its peaks at its resonances, too, for a grid that was refined at those of other models.
    """
    configuration, omega, H = target.configuration, target.omega, target.elastic
    alone = _share_alone(reference, configuration, model)
    false = alone > 0
    responding = target.responding | false
    # In a channel that responds in neither model, both responses are rounding.
    elastic = np.where(responding, H_r - model.assembled.rigid_response(configuration, omega, target.calm), 0.0)
    loud = target.loud | false
    pairs, mac = _pairs(reference, configuration, model)
    shape = frac(H, elastic)
    peak = peak_errors(H, np.concatenate([elastic, _at_peaks(model, target)]) if at_peaks else elastic)
    shift = peak_shifts(omega / (2 * np.pi), H, pairs.full_hz, pairs.reduced_hz)
    sure = loud & ~false
    highest, highest_r = (np.where(loud, abs(each).max(axis=0, initial=0.0), 0) for each in (H, elastic))
    far = pairs.at[_farthest(pairs.error)]
    nothing = float("nan")
    return ModelErrors(
        # Without a channel there is nothing to measure.
        frf_error=_frf_error(target, elastic, alone) if loud.any() else nothing,
        db_error=float(np.nanmax(in_db, initial=0.0)) if loud.any() else nothing,
        channel_db=in_db,
        frequency_error=pairs.worst,
        frac=shape,
        full_hz=pairs.full_hz,
        reduced_hz=pairs.reduced_hz,
        mac=pairs.mac,
        damped=_damped_pairs(reference, configuration, model, highest) if damped else None,
        peak_error=float(peak[sure].max(initial=0.0)) if sure.any() else nothing,
        frac_error=float((1 - shape[sure]).max(initial=0.0)) if sure.any() else nothing,
        channel_errors=np.where(false, alone, channel_errors(omega, H, elastic)),
        channel_peak=peak,
        channel_shift=shift,
        nrfd=float(np.nanmax(shift[loud], initial=0.0)) if loud.any() else nothing,
        mac_matrix=mac,
        coordinates=model.assembled.system(configuration).N,
        seconds=seconds,
        responding=responding,
        loud=loud,
        lost=_alone(reference.assembled, configuration, pairs.lost, highest),
        extra=_alone(model.assembled, configuration, pairs.extra, highest_r),
        farthest=next(iter(_alone(reference.assembled, configuration, far, highest)), None),
    )


def _at_peaks(model: ReducedModel, target: Target) -> Complex:
    """Elastic response (k, outputs, inputs) at the resonances of a model in the band; zero where none responds."""
    omega, _ = peaks(model.assembled, target.configuration)
    omega = omega[(omega >= target.omega[0]) & (omega <= target.omega[-1])]
    H_r = model.assembled.response(target.configuration, omega)
    calm = model.assembled.calm(target.configuration, omega, H_r)
    return np.where(target.responding, H_r - model.assembled.rigid_response(target.configuration, omega, calm), 0.0)


def _share_alone(reference: ReferenceModel, configuration: Configuration, model: ReducedModel) -> Real:
    """Largest share (outputs, inputs) of its reach that a channel has in the reduced model alone; 0 of other channels.

    The reference model is silent there, so that no response of its own can be the measure.
    """
    responding, reach = reference.responding(configuration)
    if responding.all():
        return np.zeros(responding.shape)
    H_r = model.assembled.response(configuration, reference.few)
    calm = model.assembled.calm(configuration, reference.few, H_r)
    elastic = H_r - model.assembled.rigid_response(configuration, reference.few, calm)
    false = ~responding & responding_channels(elastic, reach, _FALSE)
    share = np.divide(abs(elastic), reach, out=np.full(reach.shape, np.inf), where=reach > 0)
    return np.where(false, share.max(axis=0, where=elastic != 0, initial=0.0), 0.0)


def _pairs(
    reference: ReferenceModel, configuration: Configuration, model: ReducedModel
) -> tuple[FrequencyPairs, MacMatrix]:
    full, reduced = reference.assembled.resonances(configuration), model.assembled.resonances(configuration)
    cross = cross_orthogonality(full.shapes, reduced.shapes, model.masses(reference, configuration))
    # Both sets are orthonormal in mass.
    mac = MacMatrix(full.omega / (2 * np.pi), reduced.omega / (2 * np.pi), cross**2)
    low, high = reference.scene.band
    return pair_frequencies(full.omega, reduced.omega, cross, high, low), mac


@diagnostic(
    "the damping of the modes in '{}'",
    about=lambda reference, configuration, *_: configuration.name,
    limits=("damping_error",),
)
def _damped_pairs(
    reference: ReferenceModel, configuration: Configuration, model: ReducedModel, highest: Real
) -> DampedPairs | None:
    full, reduced = reference.assembled.damped_modes(configuration), model.assembled.damped_modes(configuration)
    if full is None or reduced is None:
        return None
    cross = cross_orthogonality(full.shapes, reduced.shapes, model.masses(reference, configuration))
    masses = reference.assembled.at(configuration).substructures
    own = cross_orthogonality(full.shapes, full.shapes, {name: masses[name].M for name in full.shapes})
    mac, (low, high) = complex_mac(full.s, cross, own), reference.scene.band
    pairs = pair_complex_modes(full.s, reduced.s, mac, high, low)
    lost = lost_complex_modes(full.s, reduced.s, mac, high, low)
    named = np.concatenate([lost, *(np.flatnonzero(full.s == root)[:1] for root in pairs.full[_farthest(pairs.error)])])
    energies = [
        {name: float((X[:, k].conj() @ np.asarray(masses[name].M @ X[:, k])).real) for name, X in full.shapes.items()}
        for k in named.tolist()
    ]
    modes = _unpaired(
        np.asarray(abs(full.s[named]) / (2 * np.pi), dtype=np.float64), full.peaks[named], energies, highest
    )
    return replace(pairs, lost=modes[: lost.size], farthest=next(iter(modes[lost.size :]), None))


def _farthest(error: Real) -> NDArray[np.int64]:
    """Position of the largest error, alone; none if that is small."""
    known = np.nan_to_num(error, nan=0.0)
    return np.flatnonzero((known == known.max(initial=0.0)) & (known > _FAR))[:1]


def _frf_error(target: Target, elastic: Complex, alone: Real) -> float:
    """Error of the elastic response; in a unit that is silent in the reference model, the share of the reach counts."""
    unscaled = (target.row[:, None] == 0) | (target.column[None, :] == 0)
    found = frf_error(target.omega, target.elastic, elastic, target.row, target.column)
    return max(found, float(alone[unscaled].max(initial=0.0)))


def _alone(
    model: AssembledModel, configuration: Configuration, modes: NDArray[np.int64], highest: Real
) -> tuple[UnpairedMode, ...]:
    """Modes of one model without a partner: the body that moves most, and the channel that shows them best.

    Parameters
    ----------
    model : AssembledModel
    configuration : Configuration
    modes : (l,) int64
        Positions among its resonances.
    highest : (outputs, inputs) float64
        Highest elastic response of each judged channel over the band; 0 of the others.
    """
    if not modes.size:
        return ()
    hz = model.resonances(configuration).omega[modes] / (2 * np.pi)
    peaks = model.modal_peaks(configuration, peak_damping(model, configuration))[modes]
    return _unpaired(hz, peaks, model.kinetic_shares(configuration, modes.tolist()), highest)


def _unpaired(
    hz: Real, peaks: Real, energies: Sequence[Mapping[str, float]], highest: Real
) -> tuple[UnpairedMode, ...]:
    """Modes without a partner, from their peaks (l, outputs, inputs) and the kinetic energy in each body."""
    seen = np.where(highest > 0, peaks / np.where(highest > 0, highest, 1.0), 0.0)
    found = []
    for each, share, energy in zip(hz, seen, energies, strict=True):
        body = max(energy, key=lambda name: energy[name])
        largest = float(share.max(initial=0.0))
        y, u = np.unravel_index(int(share.argmax()), share.shape) if share.size else (0, 0)
        channel = (int(y), int(u)) if largest > 0 else None
        found.append(UnpairedMode(float(each), body, energy[body] / sum(energy.values()), largest, channel))
    return tuple(found)
