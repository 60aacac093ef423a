"""Sensitivity of the choice of modes to the stated damping and to each sensor."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from cmsreduce.assemble import body_ports
from cmsreduce.balance import Selection
from cmsreduce.errors import CmsReduceError
from cmsreduce.linalg.blocks import dense
from cmsreduce.model import ModalComponent, Scene, SensitivityCase, SensitivityRecord, Substructure, is_gyroscopic
from cmsreduce.pipeline.bodies import FlexibleBody
from cmsreduce.pipeline.system import AssembledModel, Comparison, ReducedModel, ReferenceModel

__all__ = [
    "Change",
    "changed_bodies",
    "changed_component",
    "changed_comparison",
    "changed_model",
    "changes",
    "sensitivity",
]

DAMPING = (0.2, 5.0)
"""Factors on the damping of every body: the error of a ratio that was never measured."""


@dataclass(frozen=True, eq=False)
class Change:
    """One change of a run.

    Parameters
    ----------
    name : str
        In words.
    scene : Scene
        The scene of the run, or the scene without a sensor.
    damping : float
        Factor on the damping of every flexible body; dampers in joints are hardware, and stay.
    """

    name: str
    scene: Scene
    damping: float = 1.0


def changed_bodies(bodies: Mapping[str, FlexibleBody], scene: Scene) -> dict[str, FlexibleBody]:
    """The bodies of a run with the sensors of a changed scene."""
    found = {}
    for name, flexible in bodies.items():
        left = body_ports(flexible.body, scene)
        found[name] = replace(
            flexible, ports=replace(flexible.ports, displacements=left.displacements, rates=left.rates)
        )
    return found


def changed_component(component: ModalComponent, damping: float) -> ModalComponent:
    """A body of the run with its damping multiplied by a factor; shapes and frequencies stay."""
    body = component.body
    return replace(
        component,
        body=replace(body, damping=body.damping.scaled(damping), D=None if body.D is None else damping * body.D),
        zeta=damping * component.zeta,
        D=None if component.D is None else damping * component.D,
    )


def changes(scene: Scene) -> list[Change]:
    """All changes: the damping times 0.2 and 5, and the scene without each of its sensors.

    A sensor of several outputs is removed as a whole; if it is the only one, each of its outputs is removed by itself.
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


def changed_comparison(comparison: Comparison, change: Change) -> Comparison:
    """The reference model in a changed scene, with another damping."""
    scene, full = change.scene, comparison.reference
    unchanged = full.assembled.substructures
    subs = {name: _damped(sub, change.damping) for name, sub in unchanged.items() if name in scene.bodies}
    return Comparison(ReferenceModel(AssembledModel(subs, scene), full.shapes, full.bodies), comparison.points)


def sensitivity(
    chosen: Selection, scene: Scene, choose: Callable[[Change], Selection], advance: Callable[[int, int], None]
) -> SensitivityRecord:
    """Choose again with every change.

    Parameters
    ----------
    chosen : Selection
        Modes that the run keeps.
    scene : Scene
        Scene of the run.
    choose : callable
        Applies the run's rules to changed bodies.
    advance : callable
        Called after each change with their number and the number of all.
    """
    cases, tried = [], changes(scene)
    for number, change in enumerate(tried):
        try:
            cases.append(SensitivityCase(change.name, _numbered(choose(change))))
        except CmsReduceError as error:
            # A rule that cannot be met with another damping is a finding, and does not stop the run.
            cases.append(SensitivityCase(change.name, None, str(error)))
        advance(number + 1, len(tried))
    return SensitivityRecord(_numbered(chosen), tuple(cases))


def _numbered(selection: Selection) -> dict[str, tuple[int, ...]]:
    return {name: tuple((np.sort(columns) + 1).tolist()) for name, columns in selection.items()}


def _damped(sub: Substructure, factor: float) -> Substructure:
    D = None if sub.D is None else factor * sub.D
    if D is not None and sub.D is not None and is_gyroscopic(sub.D):
        # Gyroscopic forces, the skew part, are no damping.
        whole = dense(sub.D)
        D = factor * whole + (0.5 - 0.5 * factor) * (whole - whole.T)
    return replace(
        sub,
        D=D,
        loss=None if sub.loss is None else factor * sub.loss,
        terms=tuple(replace(term, matrix=factor * term.matrix) if term.letter == "D" else term for term in sub.terms),
    )
