"""Project on the scene's responses: the fewest shapes of each body that meet all limits, in the whole range."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from cmsreduce.balance import Selection
from cmsreduce.config import LimitKeys, ProjectKeys
from cmsreduce.errors import ConfigError
from cmsreduce.model import CertificateRecord, Configuration, Finding, ModalComponent, ProjectionRecord, Scene
from cmsreduce.pipeline.project.articulation_range import ArticulationRange
from cmsreduce.pipeline.project.certified_responses import DirectSolve, certified
from cmsreduce.pipeline.project.projected_bodies import Projected
from cmsreduce.pipeline.project.range_errors import RangeErrors
from cmsreduce.pipeline.project.response_samples import SampledScene
from cmsreduce.pipeline.system import Comparison, ReducedModel
from cmsreduce.project import (
    Judged,
    RangeSearch,
    ResponseLimits,
    SceneResponses,
    Settled,
    Shapes,
    ShapeSearch,
    keep_combinations,
)

__all__ = ["ResponseShapes"]

# frf_error that is met if the pipeline has no limit of a response.
_USUAL_ERROR = 0.01
# Configurations that the optimisation starts with; the others are looked at like those between them.
_FIRST = 12
# Configurations between those of the scene that it starts with, if the whole range counts.
_FIRST_BETWEEN = 16
# Channels that symmetry silences are faint beside it, and their decibels count. At most so many neighbours, at this
# share of the range, are among the first configurations: shapes optimised without them seldom hold there.
_BESIDE, _FIRST_BESIDE = 5e-4, 6
# Configurations of the range looked at together, for each motion that articulates, and at most.
_LOOKED_AT, _MOST_LOOKED_AT = 32, 64
# So many configurations that no decision was made with must hold a share of the limits (`HELD`) at the end: with 95 %
# confidence less than 0.6 % of the range exceeds the share, and much less breaks a limit.
_PROOF = 512
# Rounds of additions of configurations.
_ADDITIONS = 24
# Neighbours of added configurations that are looked at, too, in shares of the range.
_NEAR = 0.02
# Share of every limit that is aimed at where the whole range counts: other configurations err a little more.
_BETWEEN_AIM = 0.92
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
    joined : callable
        Joins bodies to a model.
    measured : callable
        Finding of reduced bodies with the largest ratio to its limit, by every limit, in the scene's configurations.
    fewest : callable
        Fewest modes of ``kept`` that a search finds within the limits in the scene's configurations, if these may be
        fewer than a number; None where there are none.
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
        joined: Callable[[Mapping[str, ModalComponent]], ReducedModel],
        measured: Callable[[Mapping[str, ModalComponent]], Finding | None],
        fewest: Callable[[int | None], Selection | None],
        direct: DirectSolve,
        reference: Mapping[str, str],
        advance: Callable[[int, int], None],
    ) -> None:
        self.keys, self.scene = keys, scene
        self._joined, self._measured, self._fewest = joined, measured, fewest
        self._direct, self._reference = direct, reference
        self._held, self._largest_held = 0, 0.0
        self._span = ArticulationRange(scene)
        frf, decibel = limits.frf_error, limits.db_error
        if frf is None and decibel is None:
            frf = _USUAL_ERROR
        self.limits = ResponseLimits(frf or np.inf, decibel or np.inf)
        self._errors = RangeErrors(self._span, comparison, self.limits, lambda: advance(self._held, _PROOF))
        covers = keys.between and keys.responses == "auto" and not self._span.is_point
        self._aim = _BETWEEN_AIM if covers else 1.0
        self.bodies = {name: self._candidates(name, source) for name in kept}
        self.sampled = SampledScene(source, self.bodies, comparison.reference)
        if not self.sampled.bodies:
            raise ConfigError(
                "project.responses: no body has an elastic mode to make shapes of: all are kept rigid, because no "
                "response of the scene needs them, or their cutoff is below their first mode. Take `project:` out, or "
                "raise reduce.cutoff"
            )
        every = scene.configurations
        self.chosen = [every[k] for k in sorted({*np.linspace(0, len(every) - 1, min(len(every), _FIRST)).astype(int)})]
        self._seen = 0
        if covers:
            self._seen = max(_FIRST - len(self.chosen), _FIRST_BETWEEN)
            self.chosen += [*self._beside_silence(), *self._span.points(self._seen)]
        search = RangeSearch if covers else ShapeSearch
        self._search = search(self.sampled.responses(self.chosen), self.limits, self._judged, self._in_decibels)

    def _beside_silence(self) -> list[Configuration]:
        """Neighbours of the first configurations in which more channels are heard."""
        found: list[Configuration] = []
        for each in self.chosen:
            (here,) = self.sampled.responses([each]).samples
            near = [] if here.heard.all() else self._span.around(each, _BESIDE)
            there = self.sampled.responses(near).samples
            found += [other for other, sample in zip(near, there, strict=True) if sample.heard.sum() > here.heard.sum()]
        return found[:_FIRST_BESIDE]

    def run(self) -> Projected:
        """Find the shapes, and the bodies in them.

        Raises
        ------
        ConfigError
            If a body or a number of the key does not exist, or no number of shapes meets the limits.
        """
        asked = self.keys.responses
        if asked == "auto":
            found = self._search.smallest(self._modes)
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
            self._search.directions.shares(),
            {name: component.elastic_count for name, component in components.items()},
            between={name: errors[0] for name, errors in between.items()},
            limit=None if np.isinf(self.limits.frf_error) else self.limits.frf_error,
            configurations=tuple(each.name for each in self.chosen),
            certificate=certificate,
        )
        return Projected(components, record, tuple(self._notes(found, between, certificate)))

    def _modes(self, below: int | None) -> dict[str, NDArray[np.int64]] | None:
        """The fewest modes, by their numbers among the elastic candidates, if these may be fewer than a number."""
        found = None if self.keys.of == "full" else self._fewest(below)
        return (
            None
            if found is None
            else {name: found[name] - self.bodies[name].elastic.start for name in self.sampled.bodies}
        )

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
        errors = np.array([self.sampled.judge(each).errors(shapes) for each in self.chosen]).reshape(-1, 2)
        frf, decibel = (errors / (self.limits.frf_error, self.limits.db_error)).T / self._aim
        worst = float(max(frf.max(initial=0.0), decibel.max(initial=0.0)))
        self._critical = None
        if worst <= 1:
            self._critical = self._measured(self._components(shapes))
            worst = max(worst, 0.0 if self._critical is None else self._critical.ratio)
        return Judged(frf, decibel, worst)

    def _in_decibels(self) -> SceneResponses | None:
        """The chosen configurations on grids that show decibels, if these have a limit."""
        return None if np.isinf(self.limits.db_error) else self.sampled.responses(self.chosen, decibels=True)

    def _covering(self, found: Settled, grow: bool) -> tuple[Settled, dict[str, tuple[float, float]]]:
        """Add the configurations with the largest errors until many others, never looked at before, break no limit.

        Returns
        -------
        Settled
            Shapes.
        dict
            frf_error and db_error of the last configurations that were looked at and not added.
        """
        span = self._span
        count = min(_LOOKED_AT * max(len(span.axes), 1), _MOST_LOOKED_AT)
        seen, additions, first, self._held = self._seen, 0, len(self.chosen), 0
        while True:
            model = self._joined(self._components(found.shapes))
            fresh = span.points(count, seen)
            seen += count
            follow = grow and additions < _ADDITIONS
            looked, (errors, worst) = fresh, self._looked_at(model, fresh, follow=follow)
            if not (worst or self._held):
                # Once after every change: where errors were large, they are so in narrow ridges.
                near = [other for each in self.chosen[first:] for other in span.around(each, _NEAR)]
                named = [*self.scene.configurations, *span.corners()]
                others = [*(each for each in named if each not in self.chosen), *near]
                more, worst = self._looked_at(model, others, follow=follow)
                looked, errors = [*fresh, *others], np.vstack([errors, more])
            if worst:
                self._held, self._largest_held, additions = 0, 0.0, additions + 1
                self.chosen += worst
                self._search = self._search.extended(self.sampled.responses(self.chosen))
                found = self._search.reached(self._search.settled(found.shapes, _ROUNDS, afresh=False))
                continue
            self._held += len(fresh)
            self._largest_held = max(self._largest_held, float(self._errors.over(errors).max(initial=0.0)))
            if not grow or not fresh or self._held >= _PROOF or self._largest_held > 1:
                break
        return found, {each.name: tuple(error) for each, error in zip(looked, errors.tolist(), strict=True)}

    def _looked_at(
        self, model: ReducedModel, some: list[Configuration], *, follow: bool
    ) -> tuple[NDArray[np.float64], list[Configuration]]:
        """Errors of some configurations, and the worst ones to be added, if these are followed."""
        errors = self._errors.measured(model, some)
        return errors, self._errors.largest(model, some, errors, self.chosen) if follow else []

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
            if self._held >= _PROOF:
                notes.append(
                    f"project: {self._held} configurations of the range that the search had never looked at before "
                    f"have at most {self._largest_held:.3g} of each limit"
                )
            elif (worst > (self.limits.frf_error, self.limits.db_error)).any():
                notes.append(
                    f"project: the limits do not hold in the whole range after {_ADDITIONS} rounds of added "
                    "configurations: name the worst ones in `scene.articulation`, or allow larger errors"
                    if self.keys.responses == "auto"
                    else "project: the limits do not hold in the whole range; ask for more shapes, or for `auto`"
                )
        name, estimate, bound = certificate.worst
        proven = f"proven to be below {bound:.3g} of the system of all candidates"
        if bound == np.inf:
            proven = "has no proven bound, since some motion has little or no damping,"
        off = max((each.error / each.estimate for each in certificate.solved if each.estimate), default=0.0)
        notes.append(
            f"project: certificate: frf_error is estimated at {estimate:.3g} and {proven} "
            f"in '{name}', the configuration with the largest bound; at "
            f"{len(certificate.solved)} frequencies with the largest estimates, solves of the unreduced bodies give at "
            f"most {off:.3g} times the estimated error"
        )
        if certificate.unsettled:
            more = f" and {len(certificate.unsettled) - 1} more" if len(certificate.unsettled) > 1 else ""
            notes.append(
                f"project: certificate: the estimate has not settled in '{certificate.unsettled[0]}'{more}: shapes "
                "from the residuals do not converge, as near resonances with little damping, and the error may be many "
                "times the estimate; there only the bound and the solves count"
            )
        return notes
