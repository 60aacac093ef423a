"""Inputs and outputs of the scene on a body as its reduction asks for them, and points that CalculiX made anew."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cmsreduce.assemble import Ports, body_ports
from cmsreduce.config import Pipeline
from cmsreduce.errors import SceneError
from cmsreduce.model import DOF_NAMES, FEModel, Point, PointTerm, Scene
from cmsreduce.read import expanded_node

__all__ = ["scene_ports"]

# A node of the thickness lies in its middle to this share of the thickness.
_IN_THE_MIDDLE = 1e-3
_MOTIONS = np.arange(1, 7)


def scene_ports(pipeline: Pipeline, body: FEModel, scene: Scene) -> Ports:
    """Inputs and outputs of the scene on a body.

    Parameters
    ----------
    pipeline : Pipeline
        Its residuals are loads.
    body : FEModel
        In the scene's units.
    scene : Scene
        Joints, actuators, sensors.

    Raises
    ------
    SceneError
        As `body_ports` does. Of a node of a shell or beam, for which CalculiX has others, it names these.
    """
    geometry, keys = pipeline.components[body.name].geometry, pipeline.reduce_of(body.name)
    residuals = () if keys is None else keys.residuals
    if geometry is not None:
        loads = (Point(body.name, text.partition(".")[0]) for text in residuals)
        for point in (*scene.points(), *loads):
            if point.body == body.name and point.name not in body.interfaces and point.name.isdecimal():
                _refuse_expanded(body, scene, point, geometry.file)
    return body_ports(body, scene, residuals)


def _refuse_expanded(body: FEModel, scene: Scene, point: Point, geometry: Path) -> None:
    """Refuse a node without rows that became others, and say which of them to name.

    CalculiX has no one average of them: at a corner of a quadratic shell it lays a force on them with the weights
    -1/2, 2, -1/2, and prints their motion with 1/6, 2/3, 1/6.
    """
    node = int(point.name)
    if (body.recovery.dofs.node == node).any():
        return
    made = [one for one in expanded_node(geometry, node) if (body.dofs.rows(one, _MOTIONS) >= 0).any()]
    if not made or body.nodes is None:
        return
    at = body.nodes.xyz[body.nodes.index(np.array(made))]
    away = np.linalg.norm(at - at.mean(axis=0), axis=1)
    middle = made[int(away.argmin())]
    if len(made) == 1 or away.min() <= _IN_THE_MIDDLE * away.max():
        advice = f"write '{body.name}.{middle}'" + (", the one in their middle" if len(made) > 1 else "")
    elif point not in scene.points():
        advice = "name one of them"
    elif len(made) == 2:
        axis = _axis(scene, point)
        pair = ", ".join(f"{body.name}.{one}.{axis}: 0.5" for one in made)
        advice = f"write `rows: {{{pair}}}` in place of `at:`, their average along {axis}"
    else:
        advice = (
            f"name their average as an interface of {body.name}, `n{node}: {{node: {node}, tie: average}}`, and write "
            f"'{body.name}.n{node}'"
        )
    raise SceneError(
        f"'{point}': CalculiX made {'node' if len(made) == 1 else 'nodes'} {', '.join(map(str, made))} of node {node} "
        f"of a shell or beam, and the matrices of '{body.name}' have {'it' if len(made) == 1 else 'these'} in its "
        f"place: {advice}"
    )


def _axis(scene: Scene, point: Point) -> str:
    """The axis along which a channel acts most at a point."""
    terms = (term for channel in (*scene.actuators, *scene.sensors) for term in channel.terms)
    along = [term.direction[:3] for term in terms if isinstance(term, PointTerm) and term.at == point]
    return DOF_NAMES[int(abs(along[0]).argmax())] if along else DOF_NAMES[0]
