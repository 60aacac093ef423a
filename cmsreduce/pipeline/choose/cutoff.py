"""`cutoff: auto`: the cutoff of each body that meets a response error."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace

from cmsreduce import __version__
from cmsreduce.assemble import rigid_substructure
from cmsreduce.config import Pipeline, ReduceKeys
from cmsreduce.errors import ConfigError
from cmsreduce.model import CutoffChoice, ModalComponent, RigidBody, Scene, Substructure
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.pipeline.bodies import FlexibleBody, reference
from cmsreduce.pipeline.store import stage_key
from cmsreduce.pipeline.system import AssembledModel, Comparison, ReducedModel, ReferenceModel
from cmsreduce.reduce import Examined

__all__ = [
    "MOST",
    "START",
    "CutoffSearch",
    "asked_error",
    "check_measurable",
    "choose_cutoffs",
    "cutoff_key",
    "neglected_errors",
]

START, MOST = 1.5, 8.0
"""Multiples of the band's upper end at which the search for a cutoff starts and ends."""
DEFAULT_ERROR = 0.01
"""frf_error to meet if neither balance nor verify states one."""
# Share of this error that the cutoffs of all bodies together may cost; the choice of modes needs the rest.
_SHARE = 0.5
# A cutoff is raised by the fourth root of the error's excess, because the inertia of modes left out acts with w^4, and
# a little more; within these factors, because modes come in groups.
_BEYOND = 1.02
_LEAST_STEP, _LARGEST_STEP = 1.25, 1.5
# Points of the grid before it is refined at resonances, where all error is.
_POINTS = 100


def asked_error(pipeline: Pipeline) -> float:
    """The frf_error that a run must meet: stated by balance, else by verify's limits, else the usual one."""
    balance, verify = pipeline.balance, pipeline.verify
    stated = [balance.keep.frf_error if balance else None, verify.limits.frf_error if verify else None]
    return next((error for error in stated if error is not None), DEFAULT_ERROR)


def check_measurable(bodies: Mapping[str, FlexibleBody], scene: Scene) -> None:
    """Refuse a search without a response to measure.

    Raises
    ------
    ConfigError
        If the scene has no actuator or no sensor, or nothing in it is damped.
    """
    if not (scene.actuators and scene.sensors):
        raise ConfigError(
            "reduce.cutoff: `auto` needs a response to measure: name at least one actuator and one sensor in the "
            "scene, or state a multiple of the band"
        )
    if all(part.body.damping.law == "none" and part.body.D is None for part in bodies.values()):
        raise ConfigError(
            "reduce.cutoff: `auto` measures a response, and without damping its resonances are infinite: no cutoff is "
            "high enough. Give the components `damping:`, or state a multiple of the band"
        )


def cutoff_key(
    pipeline: Pipeline, bodies: Mapping[str, FlexibleBody], stated: Mapping[str, ReduceKeys], unneeded: Iterable[str]
) -> str:
    """Hash of everything that the choice of the cutoffs depends on.

    Parameters
    ----------
    pipeline : Pipeline
        Scene, rigid bodies, and the error to meet.
    bodies : mapping of name to FlexibleBody
        As read.
    stated : mapping of name to ReduceKeys
        Keys of the bodies that are reduced, in which a cutoff may be ``auto``.
    unneeded : iterable of str
        Bodies kept rigid.
    """
    parts = {
        name: part.model_dump(mode="json", include={"place", "rigid", "interfaces"})
        for name, part in pipeline.components.items()
    }
    reduced = {name: keys.model_dump(mode="json") for name, keys in stated.items()}
    prints = {name: (flexible.fingerprint, repr(flexible.body.damping)) for name, flexible in bodies.items()}
    scene = pipeline.scene.model_dump(mode="json")
    return stage_key("cutoff", __version__, scene, parts, reduced, prints, asked_error(pipeline), sorted(unneeded))


def choose_cutoffs(
    names: Iterable[str], asked: float, errors_at: Callable[[Mapping[str, float]], Mapping[str, float]]
) -> dict[str, CutoffChoice]:
    """Raise the cutoff of each body until its missing modes cost little error.

    Parameters
    ----------
    names : iterable of str
        Bodies whose cutoff is free.
    asked : float
        The frf_error that the system may have.
    errors_at : callable
        Estimated frf_error that each body's missing modes cost, at given multiples of the band.

    Returns
    -------
    dict of str to CutoffChoice
        Each body may cost an equal part of half this error; the search ends at `MOST`.
    """
    cutoffs = dict.fromkeys(names, START)
    limit = _SHARE * asked / max(len(cutoffs), 1)
    tried: dict[str, list[tuple[float, float]]] = {name: [] for name in cutoffs}
    while True:
        errors = errors_at(cutoffs)
        short = [name for name in cutoffs if errors[name] > limit and cutoffs[name] < MOST]
        if not short:
            break
        for name in short:
            tried[name].append((cutoffs[name], errors[name]))
            step = min(max(_BEYOND * (errors[name] / limit) ** 0.25, _LEAST_STEP), _LARGEST_STEP)
            cutoffs[name] = min(cutoffs[name] * step, MOST)
    return {name: CutoffChoice(name, cutoffs[name], errors[name], limit, tuple(tried[name])) for name in cutoffs}


class CutoffSearch:
    """Search for the cutoffs of some bodies, with the last reduction of each.

    Parameters
    ----------
    bodies : mapping of name to FlexibleBody
        Flexible bodies, as read.
    rigid_bodies : mapping of name to RigidBody
        The others.
    scene : Scene
        With actuators and sensors.
    examine : callable
        Reduces a body up to a frequency in Hz, and enriches its basis.
    alike : callable
        Gives the bodies whose reduction, up to the same frequency, is that of a body.
    """

    def __init__(
        self,
        bodies: Mapping[str, FlexibleBody],
        rigid_bodies: Mapping[str, RigidBody],
        scene: Scene,
        examine: Callable[[str, float], Examined],
        alike: Callable[[str], Iterable[str]] = lambda name: [name],
    ) -> None:
        self._bodies, self._rigid_bodies, self._scene, self._examine = bodies, rigid_bodies, scene, examine
        self._alike = alike
        self._last: dict[str, tuple[float, Examined]] = {}

    def found(self, name: str, cutoff_hz: float) -> Examined | None:
        """The last reduction of a body, if it was up to this frequency."""
        last_hz, examined = self._last.get(name, (None, None))
        return examined if last_hz == cutoff_hz else None

    def choose(
        self, names: Iterable[str], asked: float, others: Mapping[str, ModalComponent]
    ) -> dict[str, CutoffChoice]:
        """Choose the cutoffs of bodies for an frf_error of the system, beside bodies whose cutoff is stated.

        Raises
        ------
        ConfigError
            If the scene has no response to measure, or nothing in it is damped.
        """
        check_measurable(self._bodies, self._scene)
        return choose_cutoffs(names, asked, lambda cutoffs: self._errors_at(cutoffs, others))

    def _errors_at(self, cutoffs: Mapping[str, float], others: Mapping[str, ModalComponent]) -> dict[str, float]:
        band_hz = self._scene.band[1]
        for name, cutoff_bands in cutoffs.items():
            if self.found(name, cutoff_bands * band_hz) is None:
                self._last[name] = (cutoff_bands * band_hz, self._examined(name, cutoff_bands * band_hz))
        enriched = {name: orthogonalise(last.enriched) for name, (_, last) in self._last.items() if last.enriched}
        components = {name: orthogonalise(self._last[name][1].component) for name in cutoffs} | dict(others)
        rest = {name: rigid_substructure(body) for name, body in self._rigid_bodies.items()}
        for name, flexible in self._bodies.items():
            if name not in components:
                own = reference(flexible.body, flexible.ports, flexible.rigid, START * band_hz)
                rest[name] = flexible.substructure(self._scene, own.modes)
        return neglected_errors(components, enriched, self._bodies, rest, self._scene)

    def _examined(self, name: str, cutoff_hz: float) -> Examined:
        """Reduction of a body, or that of a copy of it under its name."""
        done = (found for other in self._alike(name) if (found := self.found(other, cutoff_hz)) is not None)
        copied = next(done, None)
        if copied is None:
            return self._examine(name, cutoff_hz)
        body = self._bodies[name].body
        enriched = None if copied.enriched is None else replace(copied.enriched, body=body)
        return replace(copied, component=replace(copied.component, body=body), enriched=enriched)


def neglected_errors(
    components: Mapping[str, ModalComponent],
    enriched: Mapping[str, ModalComponent],
    bodies: Mapping[str, FlexibleBody],
    others: Mapping[str, Substructure],
    scene: Scene,
) -> dict[str, float]:
    """Estimate the frf_error that the modes left out of each body cost the system.

    Parameters
    ----------
    components : mapping of name to ModalComponent
        Reduced bodies.
    enriched : mapping of name to ModalComponent
        Some of them, with the shapes that matter most of those that their basis misses.
    bodies : mapping of name to FlexibleBody
        As read.
    others : mapping of name to Substructure
        Bodies that are rigid or not reduced.
    scene : Scene
        With actuators and sensors.

    Returns
    -------
    dict of body to float
        For each body of ``enriched``, the frf_error between the system as it is and the system with this body enriched,
        at the worst configuration.

    Notes
    -----
    A hierarchical estimate: it takes the response of the larger basis for the exact one (docs/theory.md).
    """
    models = {name: bodies[name].body for name in components}

    def model(parts: Mapping[str, ModalComponent]) -> ReducedModel:
        subs = dict(others) | {name: bodies[name].substructure(scene, part) for name, part in parts.items()}
        shapes: dict[str, ModalComponent | None] = dict(parts)
        return ReducedModel(AssembledModel({name: subs[name] for name in scene.bodies}, scene), shapes)

    base = model(components)
    found = {}
    for name, part in enriched.items():
        richer = model({**components, name: part})
        found[name] = Comparison(ReferenceModel(richer.assembled, richer.shapes, models), _POINTS).candidate_error(base)
    return found
