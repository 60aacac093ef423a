"""The scene's responses as data: what the shapes of the bodies are optimised for, and what their errors are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from cmsreduce.assemble import JoinedRows, held_bodies, modal_weights
from cmsreduce.errors import ConfigError
from cmsreduce.linalg.blocks import dense
from cmsreduce.model import Configuration, ModalComponent, is_gyroscopic
from cmsreduce.pipeline.store import once
from cmsreduce.pipeline.system import ReducedModel, ReferenceModel, Target, peaks
from cmsreduce.project import BodyModes, ResponseSample, SceneResponses, Shapes
from cmsreduce.verify import db_error, decibel_grid, frequency_grid, frf_error, loud_channels

__all__ = ["ScenePoints", "SampledScene"]

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Points of the coarse grid of the optimisation, over the band; each resonance has three more. A grid for decibels has
# one in so many points of theirs, too.
_POINTS, _OF_DECIBELS = 50, 5
# Points nearer than this share of a half-width add nothing there.
_APART = 0.4
# Points of the grid on which a configuration is judged, before refinement; one in so many points at resonances.
_JUDGED, _COARSE = 200, 3
# Damping that couples rigid or static modes to elastic ones by more than this share is no rounding.
_COUPLED = 1e-9
# Width given to a resonance without damping.
_NO_DAMPING = 1e-4


class SampledScene:
    """Bodies in modes, joined in configurations, as data of the optimisation.

    Parameters
    ----------
    source : ReducedModel
        The system of all candidates.
    bodies : mapping of name to ModalComponent
        Bodies whose shapes are sought, in the modes of ``source``.
    reference : ReferenceModel

    Raises
    ------
    ConfigError
        If the damping matrix of a body couples its rigid motion, or a body has gyroscopic forces.
    """

    def __init__(self, source: ReducedModel, bodies: Mapping[str, ModalComponent], reference: ReferenceModel) -> None:
        self.model, self.reference = source.assembled, reference
        turning = [
            name
            for name, sub in self.model.substructures.items()
            if is_gyroscopic(sub.D) or any(term.gyroscopic for term in sub.terms)
        ]
        if turning:
            raise ConfigError(
                f"project.responses: body '{turning[0]}' has gyroscopic forces, and scene shapes need symmetric "
                "matrices; use `project: {modes: ...}` or `balance:`"
            )
        self.held = held_bodies(self.model.stack, self.model.scene, in_modes=False)
        self.components = {name: c for name, c in bodies.items() if c.elastic_count}
        self.bodies = {name: _body_modes(component) for name, component in self.components.items()}

    def responses(self, configurations: Sequence[Configuration], *, decibels: bool = False) -> SceneResponses:
        """Responses on coarse grids for the optimisation, or on grids that show the errors in decibels."""
        more = decibel_grid(self.reference.scene.band)[::_OF_DECIBELS] if decibels else np.empty(0)
        grids = [np.union1d(self._coarse_grid(each), more) for each in configurations]
        targets = [self.reference.target(*each) for each in zip(configurations, grids, strict=True)]
        return SceneResponses(self.bodies, [self._sample(target) for target in targets])

    @once
    def judge(self, configuration: Configuration) -> ScenePoints:
        """A configuration on the grids of the errors."""
        band, decibel = self.reference.scene.band, decibel_grid(self.reference.scene.band)
        fine = frequency_grid(band, _JUDGED, *peaks(self.reference.assembled, configuration), _COARSE)
        every = np.unique(np.concatenate([fine, decibel]))
        sample = self._sample(self.reference.target(configuration, every))
        return ScenePoints(SceneResponses(self.bodies, [sample]), np.searchsorted(every, decibel))

    def _coarse_grid(self, configuration: Configuration) -> Real:
        """A logarithmic grid, with each peak of the reference model and its half-power points."""
        low, *_, high = decibel_grid(self.reference.scene.band)
        omega, zeta = peaks(self.reference.assembled, configuration)
        inside = omega <= high
        omega, width = omega[inside], np.maximum(zeta[inside], _NO_DAMPING) * omega[inside]
        grid = np.unique(np.concatenate([np.geomspace(low, high, _POINTS), omega - width, omega, omega + width]))
        grid = grid[(grid >= low) & (grid <= high)]
        if not omega.size:
            return np.asarray(grid)
        # A peak wider than the band takes no points of the grid away.
        apart = np.minimum(width[abs(grid[:, None] - omega).argmin(axis=1)], np.log(high / low) / _POINTS * grid)
        least = _APART * apart
        keep = [0]
        for k in range(1, grid.size):
            if grid[k] - grid[keep[-1]] >= least[k]:
                keep.append(k)
        return np.asarray(grid[keep])

    def _sample(self, target: Target) -> ResponseSample:
        """Rows of one configuration over the modes of the bodies, and the flexibility of the rest."""
        omega, stack = target.omega, self.held.stack
        rows = JoinedRows.of(self.held.wiring(self.model.wiring(target.configuration)), stack)
        rest = np.zeros((omega.size, *rows.shape), dtype=np.complex128)
        left, right = {}, {}
        receptances = self.model.receptances(omega)
        for name, sub in self.held.substructures.items():
            here = stack.body_columns(name)
            if name not in self.components:
                moving = here.start + stack.moving(name)
                rest += rows.left[:, moving] @ receptances[name](omega) @ rows.right[:, moving].T
                continue
            e, motions = self.components[name].elastic, dense(stack.motions(name))
            L, R = rows.left[:, here] @ motions, rows.right[:, here] @ motions
            always = np.delete(np.arange(sub.m), e)
            rest += (L[:, always] * modal_weights(sub, omega, always)[:, None, :]) @ R[:, always].T
            left[name], right[name] = L[:, e], R[:, e]
        return ResponseSample(
            omega,
            left,
            right,
            rest,
            rows.c,
            rows.displacement,
            rows.rate,
            target.elastic + target.rigid,
            target.elastic,
            target.row,
            target.column,
            # As errors in decibels judge them.
            loud_channels(target.elastic + target.rigid, target.row, target.column) | target.loud,
        )


class ScenePoints:
    """One configuration on the grids of the errors.

    Parameters
    ----------
    scene : SceneResponses
        Of one sample.
    decibel : (d,) int64
        Points of its grid that the decibel error is taken at.
    """

    def __init__(self, scene: SceneResponses, decibel: NDArray[np.int64]) -> None:
        self.scene, self.decibel = scene, decibel
        (sample,) = scene.samples
        self.loud = loud_channels(sample.elastic, sample.row, sample.column, sample.omega)

    def errors(self, shapes: Shapes) -> tuple[float, float]:
        """frf_error and db_error of the bodies in some shapes; infinite where the joints are not independent."""
        (sample,) = self.scene.samples
        try:
            (H,) = self.scene.responses(shapes)
        except np.linalg.LinAlgError:
            return np.inf, np.inf
        elastic = H - (sample.H - sample.elastic)
        at = self.decibel
        return (
            frf_error(sample.omega, sample.elastic, elastic, sample.row, sample.column),
            db_error(sample.H[at], H[at], sample.row, sample.column, self.loud),
        )


def _body_modes(component: ModalComponent) -> BodyModes:
    e, D = component.elastic, component.D
    loss = component.damping.structural or 0.0
    if D is None:
        return BodyModes(component.omega[e], component.viscous[e], loss)
    size = abs(D).max(initial=0.0)
    others = np.delete(np.arange(component.omega.size), e)
    if abs(D[others, e]).max(initial=0.0) > _COUPLED * size:
        raise ConfigError(
            f"project.responses: body '{component.name}' has a damping matrix that couples its rigid motion or its "
            "static modes to its elastic modes; scene shapes need dampers to the ground as `dampers` of a joint"
        )
    return BodyModes(component.omega[e], D[e, e], loss)
