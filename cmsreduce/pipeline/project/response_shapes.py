"""Project on the scene's responses: the fewest shapes of each body that meet all limits, in the whole range."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from cmsreduce.config import LimitKeys, ProjectKeys
from cmsreduce.errors import ConfigError
from cmsreduce.model import CertificateRecord, Configuration, Finding, ModalComponent, ProjectionRecord, Scene
from cmsreduce.pipeline.project.articulation_range import ArticulationRange
from cmsreduce.pipeline.project.certified_responses import DirectSolve, certified
from cmsreduce.pipeline.project.projected_bodies import Projected
from cmsreduce.pipeline.project.response_samples import SampledScene, ScenePoints
from cmsreduce.pipeline.system import Comparison, ReducedModel
from cmsreduce.project import Judged, ResponseLimits, Settled, Shapes, ShapeSearch, keep_combinations

__all__ = ["ResponseShapes"]

# frf_error that is met if the pipeline has no limit of a response.
_USUAL_ERROR = 0.01
# Configurations that the optimisation starts with; the others are looked at like those between them.
_FIRST = 12
# Configurations between those of the scene that it starts with, if the whole range counts.
_FIRST_BETWEEN = 6
# Configurations looked at in the range for each motion that articulates, and at most.
_LOOKED_AT, _MOST_LOOKED_AT = 64, 256
# Configurations added at a time, and rounds of additions.
_ADDED, _ADDITIONS = 2, 16
# Share of every limit that is aimed at where the whole range counts: angles that were not looked at err a little more.
_BETWEEN_AIM = 0.92
# Configurations with the largest errors that are followed uphill, and the steps, in shares of the range.
_CLIMBED, _CLIMB = 6, (0.04, 0.02, 0.01)
# A coarse grid of frequencies misses up to this share of an error: larger ones are measured again on a fine grid.
_MISSED, _MOST_FINE = 0.2, 32
# Rounds of the optimisation before another shape is added.
_ROUNDS = 6
# Added configurations that a note names; summary.json has them all.
_NAMED = 4
# Reason why a body's combinations of modes are kept.
_WHY = "scene shape"


class ResponseShapes:
    """Shapes of the bodies from the scene's own responses.

    Parameters
    ----------
    keys : ProjectKeys
        With ``responses``.
    limits : LimitKeys
        Limits of ``verify``.
    scene : Scene
        Configurations, channels, band.
    kept : mapping of name to ModalComponent
        The bodies after the stages before.
    source : ReducedModel
        System of the candidates: of ``kept``, or of unreduced bodies.
    comparison : Comparison
        The reference model.
    measured : callable
        Finding of reduced bodies with the largest ratio to its limit, by every limit, in the scene's configurations.
    direct : callable
        Solves the unreduced bodies at a few frequencies.
    reference : mapping of body to str
        How they enter these solves.
    advance : callable
        Called with the number of finished configurations and the number of all.
    """

    def __init__(
        self,
        keys: ProjectKeys,
        limits: LimitKeys,
        scene: Scene,
        kept: Mapping[str, ModalComponent],
        source: ReducedModel,
        comparison: Comparison,
        measured: Callable[[Mapping[str, ModalComponent]], Finding | None],
        direct: DirectSolve,
        reference: Mapping[str, str],
        advance: Callable[[int, int], None],
    ) -> None:
        self.keys, self.scene, self._measured, self._advance = keys, scene, measured, advance
        self._direct, self._reference = direct, reference
        self._span = ArticulationRange(scene)
        frf, decibel = limits.frf_error, limits.db_error
        if frf is None and decibel is None:
            frf = _USUAL_ERROR
        self.limits = ResponseLimits(frf or np.inf, decibel or np.inf)
        self._aim = _BETWEEN_AIM if keys.between and keys.responses == "auto" and not self._span.is_point else 1.0
        self.bodies = {name: self._candidates(name, source) for name in kept}
        self.sampled = SampledScene(source, self.bodies, comparison)
        every = scene.configurations
        self.chosen = [every[k] for k in sorted({*np.linspace(0, len(every) - 1, min(len(every), _FIRST)).astype(int)})]
        self._seen = 0
        if keys.between and keys.responses == "auto":
            self._seen = max(_FIRST - len(self.chosen), _FIRST_BETWEEN)
            self.chosen += self._span.points(self._seen)
        self._search = ShapeSearch(self.sampled.responses(self.chosen), self.limits, self._judged)

    def run(self) -> Projected:
        """Find the shapes, and the bodies in them.

        Raises
        ------
        ConfigError
            If a body or a number of the key does not exist, or no number of shapes meets the limits.
        """
        asked = self.keys.responses
        if asked == "auto":
            found = self._search.smallest()
            if not found.passes:
                worst, critical = self._aim * found.judged.worst, self._critical
                which = "its limit" if critical is None or critical.passed else f"the limit of {critical.name}"
                raise ConfigError(
                    f"project.responses: no shapes of the candidates meet the limits: all {found.count} modes leave an "
                    f"error of {worst:.3g} times {which}. Raise reduce.cutoff, or allow larger errors"
                )
        else:
            found = (
                self._search.given(self._counts(asked)) if isinstance(asked, Mapping) else self._total(int(asked or 0))
            )
        between: dict[str, tuple[float, float]] = {}
        if self.keys.between:
            found, between = self._covering(found, grow=asked == "auto")
        components = self._components(found.shapes)
        certificate = certified(self._search.scene, self.chosen, found.shapes, self._direct, self._reference)
        record = ProjectionRecord(
            (),
            self._search.shares(),
            {name: component.elastic_count for name, component in components.items()},
            between={name: errors[0] for name, errors in between.items()},
            limit=None if np.isinf(self.limits.frf_error) else self.limits.frf_error,
            configurations=tuple(each.name for each in self.chosen),
            certificate=certificate,
        )
        return Projected(components, record, tuple(self._notes(found, between, certificate)))

    def _candidates(self, name: str, source: ReducedModel) -> ModalComponent:
        found = source.shapes[name]
        if found is None:
            raise ConfigError(
                f"project: {{responses: ..., of: full}}: body '{name}' is too large for all its modes; leave `of` out, "
                "and raise reduce.cutoff instead"
            )
        return found

    def _total(self, asked: int) -> Settled:
        self._check(asked, sum(c.elastic_count for c in self.bodies.values()), "all bodies")
        return self._search.distributed(asked)

    def _counts(self, asked: Mapping[str, int]) -> dict[str, int]:
        for name in asked:
            if name not in self.bodies:
                raise ConfigError(
                    f"project.responses: there is no reduced body '{name}' (there are: {', '.join(self.bodies)})"
                )
        missing = [name for name in self.sampled.bodies if name not in asked]
        if missing:
            raise ConfigError(
                f"project.responses: state a number of shapes of '{missing[0]}', too, or one for all bodies"
            )
        for name, count in asked.items():
            self._check(count, self.bodies[name].elastic_count, f"'{name}'")
        return dict(asked)

    @staticmethod
    def _check(count: int, most: int, of: str) -> None:
        if count > most:
            raise ConfigError(f"project.responses: {count} shapes of {of} are more than its {most} elastic modes")

    def _components(self, shapes: Shapes) -> dict[str, ModalComponent]:
        return {
            name: keep_combinations(component, np.linalg.qr(shapes[name])[0], _WHY, coupled=True)
            if name in shapes
            else component
            for name, component in self.bodies.items()
        }

    def _judged(self, shapes: Shapes) -> Judged:
        """Errors at the chosen configurations over what is aimed at; other limits count once the responses' are met."""
        frf, decibel = self._ratios(shapes, [self.sampled.judge(each) for each in self.chosen]).T / self._aim
        worst = float(max(frf.max(initial=0.0), decibel.max(initial=0.0)))
        self._critical = None
        if worst <= 1:
            self._critical = self._measured(self._components(shapes))
            worst = max(worst, 0.0 if self._critical is None else self._critical.ratio)
        return Judged(frf, decibel, worst)

    def _ratios(self, shapes: Shapes, points: Sequence[ScenePoints]) -> NDArray[np.float64]:
        """Both errors over their limits (configurations, 2)."""
        limits = (self.limits.frf_error, self.limits.db_error)
        return np.array([each.errors(shapes) for each in points]).reshape(-1, 2) / limits

    def _covering(self, found: Settled, grow: bool) -> tuple[Settled, dict[str, tuple[float, float]]]:
        """Add the configurations with the largest errors until no limit is broken in the range.

        Returns
        -------
        Settled
            Shapes.
        dict
            frf_error and db_error of configurations that were looked at and not added.
        """
        span = self._span
        count = min(_LOOKED_AT * max(len(span.axes), 1), _MOST_LOOKED_AT)
        others = [each for each in self.scene.configurations if each not in self.chosen]
        looked = [*others, *span.corners(), *span.points(count, self._seen)]
        fresh = self._seen + count
        for _ in range(_ADDITIONS if grow else 0):
            worst = self._largest(found.shapes, looked)
            if not worst:
                # Points that no decision was made with.
                more = span.points(count, fresh)
                fresh, looked = fresh + count, [*looked, *more]
                worst = self._largest(found.shapes, more)
                if not worst:
                    break
            self.chosen += worst
            self._search = self._search.extended(self.sampled.responses(self.chosen))
            found = self._search.settled(found.shapes, _ROUNDS, afresh=False)
            while not found.passes and found.count < sum(c.elastic_count for c in self.bodies.values()):
                found = self._search.grown(found, 1)
        left = [each for each in looked if each not in self.chosen]
        errors = [point.errors(found.shapes) for point in self._quick(left)]
        return found, {each.name: error for each, error in zip(left, errors, strict=True)}

    def _largest(self, shapes: Shapes, looked: Sequence[Configuration]) -> list[Configuration]:
        """The configurations with the largest errors above what is aimed at, apart from those already chosen."""
        left = [each for each in looked if each not in self.chosen]
        if not left:
            return []
        ratios = self._quick_ratios(shapes, left)
        order = np.argsort(-ratios)
        found = [left[k] for k in order[:_MOST_FINE] if ratios[k] > (1 - _MISSED) * self._aim]
        found += [self._climbed(shapes, left[k], ratios[k]) for k in order[:_CLIMBED]]
        found = list({each.name: each for each in found}.values())
        exact = self._ratios(shapes, [self.sampled.judge(each) for each in found]).max(axis=1)
        return [found[k] for k in np.argsort(-exact)[:_ADDED] if exact[k] > self._aim]

    def _climbed(self, shapes: Shapes, start: Configuration, ratio: float) -> Configuration:
        """A configuration nearby with a larger error, by steps of decreasing size."""
        for share in _CLIMB:
            near = self._span.around(start, share)
            ratios = self._quick_ratios(shapes, near)
            if near and ratios.max() > ratio:
                start, ratio = near[int(ratios.argmax())], float(ratios.max())
        return start

    def _quick_ratios(self, shapes: Shapes, configurations: Sequence[Configuration]) -> NDArray[np.float64]:
        return np.asarray(self._ratios(shapes, self._quick(configurations)).max(axis=1, initial=0.0))

    def _quick(self, configurations: Sequence[Configuration]) -> list[ScenePoints]:
        found = []
        for number, each in enumerate(configurations):
            found.append(self.sampled.judge(each, quick=True))
            self._advance(number + 1, len(configurations))
        return found

    def _notes(
        self, found: Settled, between: Mapping[str, tuple[float, float]], certificate: CertificateRecord
    ) -> list[str]:
        counts = ", ".join(f"{count} of {name}" for name, count in found.counts.items())
        frf, decibel = (self._aim * ratios.max(initial=0.0) for ratios in (found.judged.frf, found.judged.db))
        names = {each.name for each in self.scene.configurations}
        added = [each.name for each in self.chosen if each.name not in names]
        notes = [
            f"project: {found.count} scene shapes ({counts}) of {sum(c.elastic_count for c in self.bodies.values())} "
            f"candidates, optimised in {len(self.chosen)} configurations: {frf:.3g} and {decibel:.3g} of the limits of "
            "frf_error and db_error there"
        ]
        if added:
            more = f"; and {len(added) - _NAMED} more" if len(added) > _NAMED else ""
            notes.append(f"project: configurations added between those of the scene: {'; '.join(added[:_NAMED])}{more}")
        if between:
            worst = np.array(list(between.values())).max(axis=0)
            notes.append(
                f"project: at {len(between)} configurations of the articulation's range that were not optimised, the "
                f"worst frf_error is {worst[0]:.3g}, the worst db_error {worst[1]:.3g} dB"
            )
            if (worst > (self.limits.frf_error, self.limits.db_error)).any():
                notes.append(
                    f"project: the limits do not hold in the whole range after {_ADDITIONS} rounds of added "
                    "configurations: name the worst ones in `scene.articulation`, or allow larger errors"
                    if self.keys.responses == "auto"
                    else "project: the limits do not hold in the whole range; ask for more shapes, or for `auto`"
                )
        name, estimate, bound = certificate.worst
        off = max((each.error / each.estimate for each in certificate.solved if each.estimate), default=0.0)
        notes.append(
            f"project: certificate: frf_error is estimated at {estimate:.3g} and proven to be below {bound:.3g} of the "
            f"system of all candidates in '{name}', the configuration with the largest bound; at "
            f"{len(certificate.solved)} frequencies with the largest estimates, solves of the unreduced bodies give at "
            f"most {off:.3g} times the estimated error"
        )
        return notes
