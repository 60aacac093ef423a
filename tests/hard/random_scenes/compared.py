"""A run of a random scene beside the dense model of the same scene."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cmsreduce.config import load_pipeline
from cmsreduce.errors import CmsReduceError
from cmsreduce.model import ModalComponent, ModelErrors
from cmsreduce.pipeline import Run, execute
from cmsreduce.pipeline.store import Silent
from tests.hard.random_scenes.bodies import UNITS
from tests.hard.random_scenes.dense import DenseBody, DenseSystem, dense_body, dense_system, elastic_modes, response
from tests.hard.random_scenes.scenes import METHODS, Part, RandomScene, random_scene

__all__ = ["TOLERANCES", "Compared", "compared", "faults"]

TOLERANCES = {
    "frequencies": 1e-8,
    "responses": 1e-8,
    "reduced_frequencies": 1e-8,
    "reduced_responses": 1e-8,
    "errors": 1e-4,
    "below": 1e-8,
}
"""Largest deviations. Errors: relative to themselves and 1e-3, that is to 1e-7 where they vanish."""

# Rounding of the largest eigenvalue, in units of it, may be in each eigenvalue.
_ROUNDING = 4 * np.finfo(float).eps
# Rounding mixes two modes by 1e-12 over their distance, and a response by less than 1e-8 beyond this distance.
_ONE_FREQUENCY = 1e-4
# A channel with less than this share of the static response that its motions could have is silent or nearly so: its
# own response error is a quotient of small differences.
_SILENT = 1e-3


@dataclass
class Compared:
    """Deviations of a run from the dense model; each is relative.

    ``frequencies`` and ``responses``: reference model against the dense one, where 1e-8 is asked for; beyond it only
    what rounding of the stiffest motion explains. ``reduced_responses``: reduced system against a dense projection on
    the same shapes. ``errors``: response errors that the run reports, against those integrated here. ``below``: the
    share by which a reduced frequency is below the dense one (displacement mode sets; 0 otherwise).
    """

    seed: int
    method: str
    dofs: int
    frequencies: float
    responses: float
    reduced_frequencies: float
    reduced_responses: float
    errors: float
    below: float
    counts: tuple[int, int, int, int]
    unpaired: int
    frf_error: float


def compared(seed: int, folder: Path) -> Compared:
    """Run a scene up to verify, and model it densely."""
    scene = random_scene(seed, folder)
    for name, part in scene.parts.items():
        _one_ratio_for_a_pair(scene, name, part)
    bodies = {name: dense_body(part) for name, part in scene.parts.items()}
    full = dense_system(scene, bodies)
    w, _ = full.modes
    band = _band(w)
    path = scene.write(folder, band / (2 * np.pi))
    run = Run(load_pipeline(path, []), folder / "out", Silent())
    execute(run, path, until="verify", report=False)
    found = run.verified.configurations[0]
    shapes = {name: _shapes(scene, name, bodies[name], modal) for name, modal in run.final.items()}
    small = {
        name: bodies[name].reduced(Phi, run.final[name].static_count, scene.parts[name], _numbers(run, name))
        for name, Phi in shapes.items()
    }
    reduced = dense_system(scene, {**bodies, **small})
    w_r, _ = reduced.modes

    omega = 2 * np.pi * found.response.frequency_hz
    (H, rigid), (H_r, _) = (_in_units(scene, full, omega), _in_units(scene, reduced, omega))
    errors, floor = found.errors["reduced"], _floor(scene, full, band)
    sharpness = max(_sharpness(full, band), _sharpness(reduced, band))
    own_full = run.comparison.reference.assembled.resonances(found.configuration).omega
    own_reduced = run.model.assembled.resonances(found.configuration).omega
    displacement = all(modal.static_count == 0 for modal in run.final.values())
    count = min(w.size, w_r.size)
    slack = _ROUNDING * w.max(initial=0.0) ** 2 / w[:count] ** 2
    below = np.max(1 - w_r[:count] / w[:count] - slack, initial=0.0) if displacement else 0.0
    shutil.rmtree(folder / "out", ignore_errors=True)
    rounding, rounding_r = (_rounding(scene, system, band, omega) for system in (full, reduced))
    return Compared(
        seed,
        METHODS[seed % len(METHODS)],
        len(full.K),
        _apart(own_full, w, w.max(initial=0.0)),
        _response_apart(found.response.full, H, floor, rounding, sharpness),
        _apart(own_reduced, w_r, w.max(initial=0.0)),
        _response_apart(found.response.reduced["reduced"], H_r, floor, rounding_r, sharpness),
        _errors_apart(scene, omega, H - rigid, H_r - rigid, floor, errors, sharpness),
        float(below),
        (found.modes_full, int((w <= band).sum()), found.modes_reduced, int((w_r <= band).sum())),
        errors.full_hz.size + len(errors.lost) - int((w <= band).sum()),
        errors.frf_error,
    )


def _one_ratio_for_a_pair(scene: RandomScene, name: str, part: Part) -> None:
    """Give modes of one frequency one damping ratio: which of them is the first is rounding."""
    if part.law[0] != "per_mode":
        return
    body, ratios = dense_body(part), list(part.law[1])
    w, _ = elastic_modes(body.K, body.M, body.R)
    for k in range(min(len(ratios), w.size) - 1):
        if w[k + 1] - w[k] < _ONE_FREQUENCY * w[k]:
            ratios[k + 1] = ratios[k]
    part.law = ("per_mode", ratios)
    scene.keys["components"][name]["damping"] = {"per_mode": ratios}


def _band(w: np.ndarray) -> float:
    """Top of the band: in the widest gap, by ratio, above the second to fifth mode."""
    if w.size < 2:
        return 1.5 * float(w[0]) if w.size else 100.0
    last = min(5, w.size - 1)
    first = min(1, last - 1)
    k = first + int(np.argmax(w[first + 1 : last + 1] / w[first:last]))
    return float(np.sqrt(w[k] * w[k + 1]))


def _shapes(scene: RandomScene, name: str, body: DenseBody, modal: ModalComponent) -> np.ndarray:
    """Shapes of a reduced body in the coordinates of its dense model, SI."""
    part: Part = scene.parts[name]
    assert part.body is not None
    length, mass = UNITS[scene.units]
    rows = []
    for node, component in zip(modal.body.dofs.node, modal.body.dofs.component, strict=True):
        # Nodes after those of the deck are the points of ties, in the order of the interfaces.
        new = int(node) - len(part.body.xyz) - 1
        label = str(node) if new < 0 else [n for n in part.faces if n in part.body.ties][new]
        axes = part.axes[int(node) - 1] if new < 0 else part.faces[label].axes
        three = slice(3 * ((component - 1) // 3), 3 * ((component - 1) // 3) + 3)
        scale = length if component <= 3 else 1.0
        rows.append(scale * axes[(component - 1) % 3] @ body.points[label][three])
    return np.linalg.solve(np.array(rows), np.asarray(modal.Phi)) * np.sqrt(mass * length**2)


def _numbers(run: Run, name: str) -> np.ndarray:
    """Numbers of the elastic modes kept, by frequency, among those of the reduced body."""
    every, kept = (each.omega[each.elastic] for each in (run.modal(name), run.final[name]))
    return np.searchsorted(np.sort(every), kept * (1 - 1e-9))


def _in_units(scene: RandomScene, system: DenseSystem, omega: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Response and its rigid part in the units of the scene."""
    scale = _row_units(scene)[:, None] * _column_units(scene)
    H, rigid = response(system, omega)
    return scale * H, scale * rigid


def _row_units(scene: RandomScene) -> np.ndarray:
    return np.array([1.0 if _turns(sensor) else UNITS[scene.units][0] for sensor in scene.sensors])


def _column_units(scene: RandomScene) -> np.ndarray:
    length, mass = UNITS[scene.units]
    return np.array([1 / (mass * length ** (2 if _turns(one) else 1)) for one in scene.actuators])


def _turns(channel: dict) -> bool:
    return bool(channel.get("turns")) or channel.get("dof", "").startswith("r")


def _apart(own: np.ndarray, dense: np.ndarray, highest: float) -> float:
    """Largest relative difference of the lowest frequencies, beyond rounding of the highest."""
    dense = dense[: own.size]
    if dense.size < own.size:
        return float("inf")
    return float(np.max(abs(own - dense) / dense - _ROUNDING * highest**2 / dense**2, initial=0.0))


def _response_apart(
    own: np.ndarray, dense: np.ndarray, floor: np.ndarray, rounding: np.ndarray, sharpness: float
) -> float:
    """Largest difference over the grid beyond rounding, by the root mean square of each channel or its scale."""
    miss, size = (np.sqrt(np.mean(abs(X) ** 2, axis=0)) for X in (own - dense, dense))
    size = np.maximum(np.maximum(size, floor), np.finfo(float).tiny)
    return max(float(np.max(np.maximum(miss - rounding, 0.0) / size, initial=0.0)) - sharpness, 0.0)


def _floor(scene: RandomScene, system: DenseSystem, band: float) -> np.ndarray:
    """Static response that channels of these motions can have, if no terms cancel: the scale of what is rounding."""
    w, X = system.modes
    rates = np.where(system.rate, band, 1.0)
    row, column = (np.linalg.norm(terms @ abs(X) / w, axis=1) for terms in (system.terms[1], system.terms[0]))
    return (row * rates * _row_units(scene))[:, None] * (column * _column_units(scene))


def _rounding(scene: RandomScene, system: DenseSystem, band: float, omega: np.ndarray) -> np.ndarray:
    """Rounding of channels, which are sums over elastic and rigid motions."""
    X = system.R @ np.linalg.inv(np.linalg.cholesky(system.R.T @ system.M @ system.R)).T
    row, column = (np.linalg.norm(terms @ abs(X), axis=1) for terms in (system.terms[1], system.terms[0]))
    by_rate, by_motion = (np.sqrt(np.mean(omega**power)) for power in (-2.0, -4.0))
    rates = np.where(system.rate, by_rate, by_motion)
    rigid = (row * rates * _row_units(scene))[:, None] * (column * _column_units(scene))
    return _ROUNDING * np.sqrt(len(system.K)) * (_floor(scene, system, band) + rigid)


def _sharpness(system: DenseSystem, band: float) -> float:
    """Rounding of the stiffest motion, seen in the height of the sharpest resonance in the band."""
    w, X = system.modes
    top = w.max(initial=0.0)
    w, X = w[w <= band], X[:, w <= band]
    zeta = (np.einsum("ij,ij->j", X, system.D @ X) + np.einsum("ij,ij->j", X, system.loss @ X) / w) / (2 * w)
    # Products with the matrices are sums over the dofs, whose rounding grows as the root of their number.
    return float(np.max(_ROUNDING * np.sqrt(len(system.K)) * (top / w) ** 2 / zeta, initial=0.0))


def _errors_apart(
    scene: RandomScene,
    omega: np.ndarray,
    H: np.ndarray,
    H_r: np.ndarray,
    floor: np.ndarray,
    errors: ModelErrors,
    sharpness: float,
) -> float:
    """Largest difference of the response errors, of all channels and of each, from their definition.

    An error is known to the rounding of the responses, ``sharpness``.
    """
    miss, size = (_integral(abs(X) ** 2, omega) for X in (H - H_r, H))
    loud = size > (omega[-1] - omega[0]) * (_SILENT * floor) ** 2
    if not loud.any():
        return 0.0

    def apart(own: np.ndarray, low: np.ndarray, high: np.ndarray) -> float:
        beyond = np.maximum(np.maximum(own - high, low - own) - sharpness, 0.0)
        return float(np.max(beyond / (1e-3 + high)))

    each = np.sqrt(miss / np.where(loud, size, 1.0))
    worst = apart(errors.channel_errors[loud], each[loud], each[loud])
    kinds_in = {_turns(a) for a in scene.actuators}
    kinds_out = {(_turns(s), s["rate"]) for s in scene.sensors}
    if len(kinds_in) == len(kinds_out) == 1:
        total = np.sqrt(miss.sum() / size.sum())
        return max(worst, apart(np.asarray(errors.frf_error), total, total))
    if not loud.all():
        return worst
    # Whatever the scales of unlike units are, the total is between the errors of the parts.
    return max(worst, apart(np.asarray(errors.frf_error), each.min(), each.max()))


def _integral(values: np.ndarray, omega: np.ndarray) -> np.ndarray:
    step = np.diff(omega)[:, None, None]
    return np.sum((values[1:] + values[:-1]) / 2 * step, axis=0)


def faults(seed: int, folder: Path) -> list[str]:
    """Deviations of a random scene beyond their tolerances, in words; empty if the run is right."""
    try:
        found = compared(seed, folder)
    except CmsReduceError as error:
        return [f"{seed}: refused: {error}"]
    values = [
        (name, getattr(found, name), limit) for name, limit in TOLERANCES.items() if not getattr(found, name) <= limit
    ]
    wrong = [f"{seed}, {found.method}: {name} {value:.2g}, at most {limit:g}" for name, value, limit in values]
    full, dense, reduced, dense_reduced = found.counts
    if full != dense or reduced != dense_reduced:
        wrong.append(f"{seed}, {found.method}: modes in the band {full}, {reduced}; {dense}, {dense_reduced} are right")
    if found.unpaired:
        wrong.append(f"{seed}, {found.method}: {found.unpaired} modes in the band too many are paired or lost")
    return wrong
