"""The models of the front door: a body in its modes, and joined bodies in one configuration.

Each adds tables, shapes and responses to the data of a stage; nothing is computed here.
"""

from __future__ import annotations

from dataclasses import fields
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cmsreduce.assemble import state_space
from cmsreduce.errors import DofMapError, SceneError, not_among, optional_library
from cmsreduce.model import Configuration, ModalComponent
from cmsreduce.pipeline.system import AssembledModel
from cmsreduce.write import basic_shapes

if TYPE_CHECKING:
    import control
    import pandas as pd

__all__ = ["AssembledSystem", "Component"]


class Component(ModalComponent):
    """A reduced body in its modes: rigid ones, then elastic ones by frequency, then static ones."""

    @classmethod
    def of(cls, modal: ModalComponent) -> Component:
        """Component of the modes that a stage returns."""
        return cls(**{each.name: getattr(modal, each.name) for each in fields(modal)})

    @property
    def table(self) -> pd.DataFrame:
        """One row a mode: frequency in Hz, damping ratio, kind, influence coefficient, and why it is kept."""
        pandas = optional_library("pandas", "pandas", "tables in Python")
        columns = {"damping_ratio": self.zeta, "kind": self.kind, "coefficient": self.sigma, "why": self.why}
        frame: pd.DataFrame = pandas.DataFrame({"frequency_hz": self.frequencies_hz, **columns}).rename_axis("mode")
        return frame

    def shapes(self, point: str | int) -> NDArray[np.float64]:
        """Translation and rotation of a point in each mode, along the basic axes of the body.

        Parameters
        ----------
        point : str or int
            Interface of one node, or node id.

        Returns
        -------
        (6, modes) float64
            x y z rx ry rz; NaN where the body does not determine a motion, as the rotation of a solid's node.

        Raises
        ------
        SceneError
            If there is no such point, or the interface has several nodes.
        DofMapError
            If the body has no geometry.
        """
        body, label = self.body, str(point)
        nodes = [int(label)] if label.isdigit() else []
        if label in body.interfaces:
            nodes = body.interfaces[label].node.tolist()
        if len(nodes) > 1:
            ids = ", ".join(map(str, nodes))
            raise SceneError(f"interface '{self.name}.{label}' has {len(nodes)} nodes; name one of them: {ids}")
        if body.nodes is None:
            raise DofMapError(f"body '{self.name}' has no geometry, so the axes of its nodes are not known")
        if not nodes:
            raise SceneError(f"body '{self.name}': {not_among('interface', label, body.interfaces)}; or a node id")
        if body.nodes.index(np.array(nodes))[0] < 0:
            raise SceneError(f"body '{self.name}': its geometry has no node {nodes[0]}")
        at = np.array(nodes)
        parts = [basic_shapes(body, body.nodes, self.Phi, at, motion)[0] for motion in ("translation", "rotation")]
        return np.concatenate(parts)


class AssembledSystem:
    """Joined bodies in one configuration.

    Parameters
    ----------
    model : AssembledModel
        Bodies and scene.
    configuration : Configuration
        Positions of the joints.
    """

    def __init__(self, model: AssembledModel, configuration: Configuration) -> None:
        self.model, self.configuration = model, configuration
        self.matrices = model.system(configuration)
        """Mass, stiffness, damping, inputs and outputs; see `cmsreduce.model.System`."""

    @property
    def configurations(self) -> tuple[str, ...]:
        """Names of all configurations, such as ``spin=45 cone=30`` with angles in degrees."""
        return tuple(each.name for each in self.model.scene.configurations)

    def at(self, configuration: str) -> AssembledSystem:
        """The system in another configuration, by its name; the joints may stand in any order.

        Raises
        ------
        SceneError
            If there is none of this name; the message lists all names.
        """
        for each in self.model.scene.configurations:
            if sorted(each.name.split()) == sorted(str(configuration).split()):
                return AssembledSystem(self.model, each)
        raise SceneError(not_among("configuration", str(configuration), self.configurations))

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the actuators, in the order of the columns of a response."""
        return self.matrices.inputs

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the motions that sensors measure, in the order of the rows of a response."""
        return self.matrices.outputs

    @cached_property
    def frequencies_hz(self) -> NDArray[np.float64]:
        """Undamped natural frequencies in Hz, ascending; zero for each rigid motion and each free motion of a joint."""
        omega, _, _ = self.model.every_mode(self.configuration)
        return np.concatenate([np.zeros(self.matrices.rigid.shape[1]), omega]) / (2 * np.pi)

    def response(self, frequencies_hz: ArrayLike) -> NDArray[np.complex128]:
        """Frequency response, rigid motions included.

        Parameters
        ----------
        frequencies_hz : (f,) array_like
            Frequencies in Hz, above zero if the system can move freely.

        Returns
        -------
        (f, outputs, inputs) complex128
            Displacement or angle in rad, or its rate, per unit force or torque.
        """
        return self.model.response(self.configuration, 2 * np.pi * np.atleast_1d(np.asarray(frequencies_hz, float)))

    def state_space(self) -> control.StateSpace:
        """State space with the inputs and outputs of the scene; states are coordinates, then their rates."""
        return state_space(self.matrices)

    def __repr__(self) -> str:
        size = f"{self.matrices.N} coordinates, {self.matrices.rigid.shape[1]} rigid motions"
        channels = f"{len(self.inputs)} inputs, {len(self.outputs)} outputs"
        return f"<AssembledSystem {self.configuration.name}: {size}, {channels}>"
