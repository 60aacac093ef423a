"""How far the choice of modes hangs on the damping that is stated, and on each sensor."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from cmsreduce.assemble import body_ports
from cmsreduce.balance import Selection
from cmsreduce.config import ModeSetKeys
from cmsreduce.errors import CmsReduceError
from cmsreduce.model import ModalComponent, Scene, SensitivityCase, SensitivityRecord, Substructure
from cmsreduce.pipeline.bodies import FlexibleBody
from cmsreduce.pipeline.system import AssembledModel, Comparison, ReducedModel

__all__ = ["Change", "ChangedBodies", "changed_comparison", "changed_model", "changes", "sensitivity"]

DAMPING = (0.2, 5.0)
"""Factors on the damping of every body: what a ratio that was never measured may be off by."""


@dataclass(frozen=True, eq=False)
class Change:
    """One thing that may be otherwise than a run has it.

    Parameters
    ----------
    name : str
        In words.
    scene : Scene
        The run's, or that without a sensor.
    damping : float
        Factor on the damping of every flexible body; dampers in joints are hardware, and stay.
    """

    name: str
    scene: Scene
    damping: float = 1.0


class ChangedBodies:
    """The bodies of a run in the modes that it has them in, with another damping, or without a sensor.

    Parameters
    ----------
    bodies : mapping of name to FlexibleBody
        As the run reads them.
    modal : callable
        Gives a body of the run in orthonormal modes.
    change : Change
        What is otherwise.
    """

    def __init__(
        self,
        bodies: Mapping[str, FlexibleBody],
        modal: Callable[[str, ModeSetKeys | None], ModalComponent],
        change: Change,
    ) -> None:
        self._modal, self._damping = modal, change.damping
        self._bodies = {name: _measured(flexible, change.scene) for name, flexible in bodies.items()}

    @property
    def bodies(self) -> Mapping[str, FlexibleBody]:
        """Bodies with the sensors that are left."""
        return self._bodies

    def modal(self, name: str, other: ModeSetKeys | None = None) -> ModalComponent:
        """One body in orthonormal modes: shapes and frequencies are the run's."""
        component, factor = self._modal(name, other), self._damping
        body = component.body
        return replace(
            component,
            body=replace(body, damping=body.damping.scaled(factor), D=None if body.D is None else factor * body.D),
            zeta=factor * component.zeta,
            D=None if component.D is None else factor * component.D,
        )


def changes(scene: Scene) -> list[Change]:
    """What is tried: the damping times 0.2 and 5, and the scene without each of its sensors.

    A sensor of several outputs goes as a whole; where it is the only one, each of its outputs goes by itself.
    """
    found = [Change(f"damping x {factor:g}", scene, factor) for factor in DAMPING]
    outputs = [channel.name for channel in scene.sensors]
    whole = {name: name.partition(".")[0] for name in outputs}
    if len(set(whole.values())) == 1:
        whole = {name: name for name in outputs}
    for removed in dict.fromkeys(whole.values()):
        left = tuple(channel for channel in scene.sensors if whole[channel.name] != removed)
        if left:
            found.append(Change(f"without {removed}", replace(scene, sensors=left)))
    return found


def changed_model(model: ReducedModel, reduced: Mapping[str, ModalComponent], change: Change) -> ReducedModel:
    """A model in a changed scene, with the damping of bodies that are not reduced changed as well."""
    scene = change.scene
    subs = {
        name: sub if name in reduced else _damped(sub, change.damping)
        for name, sub in model.assembled.substructures.items()
        if name in scene.bodies
    }
    return ReducedModel(AssembledModel(subs, scene), model.shapes)


def changed_comparison(whole: Comparison, change: Change) -> Comparison:
    """The full system in a changed scene, with another damping."""
    scene = change.scene
    subs = {
        name: _damped(sub, change.damping) for name, sub in whole.full.substructures.items() if name in scene.bodies
    }
    return Comparison(AssembledModel(subs, scene), whole.full_shapes, whole.bodies, scene, whole.points)


def sensitivity(
    chosen: Selection, scene: Scene, choose: Callable[[Change], Selection], advance: Callable[[int, int], None]
) -> SensitivityRecord:
    """Choose again with every change there is.

    Parameters
    ----------
    chosen : Selection
        What the run keeps.
    scene : Scene
        Of the run.
    choose : callable
        Applies the run's rules to changed bodies.
    advance : callable
        Told after each change how many are done, and of how many.
    """
    cases, tried = [], changes(scene)
    for number, change in enumerate(tried):
        try:
            cases.append(SensitivityCase(change.name, _numbered(choose(change))))
        except CmsReduceError as error:
            # A rule that cannot be met with another damping is a finding, and no reason to stop.
            cases.append(SensitivityCase(change.name, None, str(error)))
        advance(number + 1, len(tried))
    return SensitivityRecord(_numbered(chosen), tuple(cases))


def _numbered(selection: Selection) -> dict[str, tuple[int, ...]]:
    return {name: tuple((np.sort(columns) + 1).tolist()) for name, columns in selection.items()}


def _measured(flexible: FlexibleBody, scene: Scene) -> FlexibleBody:
    left = body_ports(flexible.body, scene)
    return replace(flexible, ports=replace(flexible.ports, displacements=left.displacements, rates=left.rates))


def _damped(sub: Substructure, factor: float) -> Substructure:
    return replace(
        sub,
        D=None if sub.D is None else factor * sub.D,
        loss=None if sub.loss is None else factor * sub.loss,
    )
