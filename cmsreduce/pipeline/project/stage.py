"""The project stage: choose modes of the system in some configurations, project them on the bodies, join these."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from cmsreduce.config import ProjectKeys
from cmsreduce.errors import ConfigError
from cmsreduce.model import Configuration, ExtraneousMode, ModalComponent, ProjectionRecord, Scene
from cmsreduce.pipeline.bodies import FlexibleBody
from cmsreduce.pipeline.project.projected_bodies import Projected, attachment_amplitudes, projected_body
from cmsreduce.pipeline.project.returned_modes import extraneous_in_band, sampled_modes
from cmsreduce.pipeline.project.system_modes import (
    CANDIDATE_BANDS,
    ModesOfSystem,
    SystemModeChoice,
    SystemModes,
    feedback_gain,
)
from cmsreduce.pipeline.system import ReducedModel, midpoint_configurations
from cmsreduce.project import Projection

__all__ = ["ProjectStage"]

# frf_error that `auto` reaches if neither the stage, nor balance, nor verify states one.
_USUAL_ERROR = 0.01
# Extraneous modes named in notes; summary.json has them all.
_EXTRANEOUS_SHOWN = 8


class ProjectStage:
    """Project modes of the system on its bodies.

    Parameters
    ----------
    keys : ProjectKeys
        Rules for modes and configurations.
    scene : Scene
        Configurations, band.
    bodies : mapping of name to FlexibleBody
        Bodies to project on.
    kept : mapping of name to ModalComponent
        The bodies after the stages before.
    source : ReducedModel
        System whose modes are projected: of ``kept``, or of unreduced bodies.
    model : callable
        Joins bodies to a model.
    error : callable, optional
        Response error of a model in a configuration; None without actuators or sensors.
    asked : float, optional
        Error that the pipeline states.
    advance : callable
        Called with the number of finished configurations and the number of all.
    """

    def __init__(
        self,
        keys: ProjectKeys,
        scene: Scene,
        bodies: Mapping[str, FlexibleBody],
        kept: Mapping[str, ModalComponent],
        source: ReducedModel,
        model: Callable[[Mapping[str, ModalComponent]], ReducedModel],
        error: Callable[[Configuration, ReducedModel], float] | None,
        asked: float | None,
        advance: Callable[[int, int], None],
    ) -> None:
        self.keys, self.scene, self.bodies, self.kept = keys, scene, bodies, kept
        self.source, self._model, self._error, self._advance = source, model, error, advance
        self._asked, self._limit = asked, asked or _USUAL_ERROR
        omega = 2 * np.pi * scene.band[1] * (keys.modes.cutoff_bands or CANDIDATE_BANDS)
        gain = feedback_gain(keys.feedback, scene) if keys.feedback or keys.damped else None
        self._modes = ModesOfSystem(source, omega, gain)
        self._choice = SystemModeChoice(keys, self._modes, self._limit)

    def run(self) -> Projected:
        """Choose modes, project them, join the bodies again, and find extraneous modes.

        Raises
        ------
        ConfigError
            If a configuration or a mode of the keys does not exist, or the error cannot be met.
        DampingError
            If modes are ranked and one has no damping.
        """
        rule = self.keys.modes.rule
        if (rule == "auto" or self.keys.configurations == "auto") and self._error is None:
            raise ConfigError(
                "project: auto needs a response to measure: name at least one actuator and one sensor in the scene, or "
                "give project.modes a cutoff, and project.configurations names"
            )
        notes: list[str] = []
        if self.keys.configurations == "auto":
            chosen, components, parts = self._greedy(notes)
        else:
            chosen = self._chosen(self._sampled())
            components, parts = self._bodies(chosen)
        model = self._model(components)
        found = extraneous_in_band(model, self._modes, chosen, self.scene)
        attached: dict[str, int] = {}
        if self.keys.suppress and _spurious(found):
            components, model, attached = self._suppressed(chosen, components, model, found, notes)
            found = extraneous_in_band(model, self._modes, chosen, self.scene)
        sampled = sampled_modes(model, self._modes, chosen)
        worst_return = max(float(each.error.max(initial=0.0)) for each in sampled)
        notes += self._remarks(parts, found, worst_return)
        record = ProjectionRecord(
            sampled,
            {name: part.singular for name, part in parts.items()},
            {name: part.rank for name, part in parts.items()},
            found,
            attached,
            self._between(model, chosen, notes),
            self._asked,
            self.keys.tolerance,
            tuple(channel.name for channel in self.scene.sensors),
        )
        return Projected(components, record, tuple(notes))

    def _sampled(self) -> list[Configuration]:
        every = {configuration.name: configuration for configuration in self.scene.configurations}
        if isinstance(self.keys.configurations, str):
            return list(every.values())
        unknown = [name for name in self.keys.configurations if name not in every]
        if unknown:
            raise ConfigError(
                f"project.configurations: there is no configuration '{unknown[0]}' (there are: {', '.join(every)})"
            )
        return [every[name] for name in self.keys.configurations]

    def _chosen(self, configurations: Sequence[Configuration]) -> dict[str, SystemModes]:
        def error(chosen: dict[str, SystemModes]) -> float:
            return self._worst(self._model(self._bodies(chosen)[0]), configurations)[0]

        return self._choice.at(configurations, error)

    def _greedy(
        self, notes: list[str]
    ) -> tuple[dict[str, SystemModes], dict[str, ModalComponent], dict[str, Projection]]:
        """Add the worst configuration until the limit holds in all of them, or the worst one is sampled."""
        every = [*self.scene.configurations, *(midpoint_configurations(self.scene) if self.keys.between else [])]
        sampled = every[:1]
        while True:
            chosen = self._chosen(sampled)
            components, parts = self._bodies(chosen)
            error, worst = self._worst(self._model(components), every)
            if error <= self._limit or worst in sampled:
                break
            sampled.append(worst)
        met = "is met" if error <= self._limit else "is not met"
        notes.append(
            f"project: system modes of {len(sampled)} of {len(every)} configurations "
            f"({', '.join(c.name for c in sampled)}); the limit frf_error {self._limit:g} {met} in all of "
            f"them: the worst is {error:.3g} at '{worst.name}'"
        )
        return chosen, components, parts

    def _bodies(
        self, chosen: Mapping[str, SystemModes], attached: Mapping[str, NDArray[np.float64]] | None = None
    ) -> tuple[dict[str, ModalComponent], dict[str, Projection]]:
        components, parts = {}, {}
        by_body = [found.by_body for found in chosen.values()]
        for name in self.kept:
            components[name], parts[name] = projected_body(
                self.bodies[name],
                self.kept[name],
                self.source.shapes[name],
                [shapes[name] for shapes in by_body],
                self.keys.tolerance,
                None if attached is None else attached[name],
            )
        return components, parts

    def _suppressed(
        self,
        chosen: Mapping[str, SystemModes],
        components: dict[str, ModalComponent],
        model: ReducedModel,
        found: tuple[ExtraneousMode, ...],
        notes: list[str],
    ) -> tuple[dict[str, ModalComponent], ReducedModel, dict[str, int]]:
        """The bodies with static shapes of their interfaces added, unless these make the response worse."""
        shapes = {name: attachment_amplitudes(c, self.bodies[name].ports.interface) for name, c in self.kept.items()}
        fuller, _ = self._bodies(chosen, shapes)
        if all(fuller[name].omega.size == components[name].omega.size for name in fuller):
            notes.append("project: the shapes hold the static shapes of the interfaces already: none was added")
            return components, model, {}
        other = self._model(fuller)
        left = _spurious(extraneous_in_band(other, self._modes, chosen, self.scene))
        added = {name: fuller[name].omega.size - components[name].omega.size for name in fuller}
        effect = (
            f"{len(_spurious(found))} extraneous modes in the band without {sum(added.values())} static shapes of the "
            f"interfaces, {len(left)} with them"
        )
        if self._error is not None:
            before = self._worst(model, self.scene.configurations)[0]
            after = self._worst(other, self.scene.configurations)[0]
            effect += f"; frf_error {before:.3g} without, {after:.3g} with them"
            if after > max(before, self._limit):
                notes.append(f"project: {effect}: they would make the response worse, so they were not added")
                return components, model, {}
        notes.append(f"project: {effect}")
        return fuller, other, added

    def _worst(self, model: ReducedModel, configurations: Sequence[Configuration]) -> tuple[float, Configuration]:
        assert self._error is not None
        errors = []
        for number, configuration in enumerate(configurations):
            errors.append(self._error(configuration, model))
            self._advance(number + 1, len(configurations))
        k = int(np.argmax(errors))
        return errors[k], configurations[k]

    def _between(self, model: ReducedModel, chosen: Mapping[str, SystemModes], notes: list[str]) -> dict[str, float]:
        """Errors in configurations that were not sampled: others of the scene, and midpoint configurations."""
        if self._error is None:
            return {}
        others = [configuration for configuration in self.scene.configurations if configuration.name not in chosen]
        others += midpoint_configurations(self.scene) if self.keys.between else []
        errors = {each.name: self._error(each, model) for each in others}
        if errors:
            name = max(errors, key=errors.__getitem__)
            notes.append(f"project: between the angles sampled, the worst frf_error is {errors[name]:.3g} at '{name}'")
        return errors

    def _remarks(
        self, parts: Mapping[str, Projection], found: Sequence[ExtraneousMode], worst_return: float
    ) -> list[str]:
        notes = []
        for name, part in parts.items():
            if part.left_out > self.keys.tolerance / 10 and self.keys.tolerance > ProjectKeys().tolerance:
                notes.append(
                    f"{name}: compressed to {part.rank} shapes; the shapes left out hold {part.left_out:.2g} of the "
                    f"amplitude of a system mode, and the largest error of a chosen frequency is {worst_return:.2g}"
                )
        foreign = _spurious(found)
        for mode in foreign[:_EXTRANEOUS_SHOWN]:
            where = f", at {mode.interface}" if mode.interface else ""
            weights = zip((sensor.name for sensor in self.scene.sensors), mode.weight, strict=True)
            peaks = ", ".join(f"{name} {weight:.2g}" for name, weight in weights)
            notes.append(
                f"project: extraneous mode at {mode.hz:.4g} Hz in '{mode.configuration}', in the band: "
                f"{mode.energy[mode.body]:.0%} of its energy in {mode.body}{where}; its peaks, "
                f"relative to the largest of all modes: {peaks or 'no output'}"
            )
        if len(foreign) > _EXTRANEOUS_SHOWN:
            notes.append(
                f"project: {len(foreign) - _EXTRANEOUS_SHOWN} more extraneous modes in the band: see summary.json"
            )
        if len(found) > len(foreign):
            notes.append(
                f"project: {len(found) - len(foreign)} times the reassembled system has a mode of the system in the "
                "band that was not chosen: see summary.json"
            )
        return notes


def _spurious(found: Sequence[ExtraneousMode]) -> list[ExtraneousMode]:
    """Extraneous modes that resemble no mode of the system, the strongest first."""
    return sorted((mode for mode in found if mode.spurious), key=lambda mode: -mode.weight.max(initial=0.0))
