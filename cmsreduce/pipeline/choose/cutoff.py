"""`cutoff: auto`: as many normal modes of each body as the accuracy asked for needs."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from cmsreduce import __version__
from cmsreduce.assemble import modal_substructure
from cmsreduce.config import Pipeline, ReduceKeys
from cmsreduce.errors import ConfigError
from cmsreduce.model import ModalComponent, Scene, Substructure
from cmsreduce.pipeline.bodies import FlexibleBody
from cmsreduce.pipeline.store import stage_key
from cmsreduce.pipeline.system import AssembledModel, Comparison, ReducedModel

__all__ = [
    "MOST",
    "START",
    "CutoffChoice",
    "asked_error",
    "check_measurable",
    "choose_cutoffs",
    "cutoff_key",
    "neglected_errors",
]

START, MOST = 1.5, 8.0
"""Multiples of the band at which the search for a cutoff starts and ends."""
DEFAULT_ERROR = 0.01
"""The frf_error asked for where neither balance nor verify states one."""
# Part of the error asked for that the cutoffs of all bodies together may take; the choice of modes needs the rest.
_SHARE = 0.5
# A cutoff is raised by the fourth root of the error's excess, for the inertia of modes left out acts with w^4, and a
# little beyond; within these factors, because modes come in lumps.
_BEYOND = 1.02
_LEAST_STEP, _LARGEST_STEP = 1.25, 1.5
# Of a cutoff raised to the end, it is worth saying that it was in vain if this share of the first error is left.
_IN_VAIN = 0.5
# Points of the grid before it is refined at resonances, where all error is.
_POINTS = 100


@dataclass(frozen=True)
class CutoffChoice:
    """The cutoff of a body, and why.

    Parameters
    ----------
    body : str
        Its name.
    cutoff : float
        Multiple of the upper end of the band.
    error : float
        Estimated frf_error that the body's modes above the cutoff cost.
    limit : float
        What they may cost.
    tried : tuple of (float, float)
        Cutoffs before it, with their errors.
    """

    body: str
    cutoff: float
    error: float
    limit: float
    tried: tuple[tuple[float, float], ...] = ()

    @property
    def note(self) -> str:
        """What was chosen and why, in words."""
        cost = f"its modes above cost an estimated frf_error of {self.error:.1e}, {self.limit:.1e} is allowed"
        if self.error > self.limit:
            remedy = "static shapes are what it lacks: try method macneal-rubin, or residuals, or allow a larger error"
            vain = bool(self.tried) and self.error > _IN_VAIN * self.tried[0][1]
            rest = remedy if vain else "state a higher cutoff, or allow a larger error"
            return f"{self.body}: cutoff auto stopped at {self.cutoff:.3g} x the band; {cost}; {rest}"
        if not self.tried:
            return f"{self.body}: cutoff auto stays at {self.cutoff:.3g} x the band; {cost}"
        start, error = self.tried[0]
        return (
            f"{self.body}: cutoff auto raised from {start:.3g} to {self.cutoff:.3g} x the band, where {cost} "
            f"({error:.1e} before)"
        )


def asked_error(pipeline: Pipeline) -> float:
    """The frf_error that a run is to meet: that of balance, or of verify's limits, or the usual one."""
    balance, verify = pipeline.balance, pipeline.verify
    stated = [balance.keep.frf_error if balance else None, verify.limits.frf_error if verify else None]
    return next((error for error in stated if error is not None), DEFAULT_ERROR)


def check_measurable(bodies: Mapping[str, FlexibleBody], scene: Scene) -> None:
    """Refuse a search where there is no response to measure.

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
    pipeline: Pipeline,
    bodies: Mapping[str, FlexibleBody],
    stated: Callable[[str], ReduceKeys],
    unneeded: Iterable[str],
) -> str:
    """Hash of everything the choice of the cutoffs depends on.

    Parameters
    ----------
    pipeline : Pipeline
        Scene, rigid bodies, and the error asked for.
    bodies : mapping of name to FlexibleBody
        As read.
    stated : callable
        Keys of a body's reduction, in which a cutoff may be ``auto``.
    unneeded : iterable of str
        Bodies kept rigid.
    """
    parts = {
        name: part.model_dump(mode="json", include={"place", "rigid", "interfaces"})
        for name, part in pipeline.components.items()
    }
    reduced = {name: stated(name).model_dump(mode="json") for name in bodies if pipeline.reduce_of(name) is not None}
    prints = {name: (flexible.fingerprint, repr(flexible.body.damping)) for name, flexible in bodies.items()}
    scene = pipeline.scene.model_dump(mode="json")
    return stage_key("cutoff", __version__, scene, parts, reduced, prints, asked_error(pipeline), sorted(unneeded))


def choose_cutoffs(
    names: Iterable[str], asked: float, errors_at: Callable[[Mapping[str, float]], Mapping[str, float]]
) -> dict[str, CutoffChoice]:
    """Raise the cutoff of each body until what its missing modes cost is small, and of no other.

    Parameters
    ----------
    names : iterable of str
        Bodies whose cutoff is free.
    asked : float
        The frf_error asked of the system.
    errors_at : callable
        Estimated frf_error that each body's missing modes cost, at given multiples of the band.

    Returns
    -------
    dict of str to CutoffChoice
        Each body may cost an equal part of half the error asked for; the search ends at `MOST`.
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
        Some of them with the shapes that their basis misses first.
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
    A hierarchical estimate: the response of the larger basis stands for the exact one (docs/theory.md).
    """
    models = {name: bodies[name].body for name in components}

    def model(parts: Mapping[str, ModalComponent]) -> ReducedModel:
        subs = dict(others) | {
            name: modal_substructure(part, bodies[name].points(scene)) for name, part in parts.items()
        }
        shapes: dict[str, ModalComponent | None] = dict(parts)
        return ReducedModel(AssembledModel({name: subs[name] for name in scene.bodies}, scene), shapes)

    base = model(components)
    found = {}
    for name, richer in enriched.items():
        whole = model({**components, name: richer})
        compared = Comparison(whole.assembled, whole.shapes, models, scene, _POINTS)
        found[name] = compared.candidate_error(base)
    return found
