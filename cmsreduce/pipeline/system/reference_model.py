"""The unreduced model of the scene: the response that reduced models are measured against."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import Configuration, FEModel, ModalComponent, Scene
from cmsreduce.pipeline.store import once
from cmsreduce.pipeline.system.assembled import AssembledModel
from cmsreduce.verify import channel_scales, decibel_grid, loud_channels, responding_channels

__all__ = ["ReferenceModel", "Target"]

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Above this number of configurations, receptances of the bodies on the decibel grid are tabulated.
_TABULATED = 16
# Responses on the decibel grid are kept up to this size.
_KEPT_BYTES = 2**27
# Frequencies of the grid of the decibel error at which the elastic response of a channel is looked for.
_LOOKED_AT = 8


@dataclass(frozen=True, eq=False)
class Target:
    """Response of the reference model in one configuration.

    Parameters
    ----------
    configuration : Configuration
    omega : (f,) float64
        Circular frequencies in rad/s.
    elastic, rigid : (f, outputs, inputs) complex128
        Response without its rigid-body part, and the rigid-body part.
    row, column : float64
        Scales of the channels.
    responding : (outputs, inputs) bool
        Channels whose elastic response is more than rounding; it is zero in the others.
    calm : (f, outputs, inputs) bool, optional
        Where the rigid-body part has no nutation.
    """

    configuration: Configuration
    omega: Real
    elastic: Complex
    rigid: Complex
    row: Real
    column: Real
    responding: NDArray[np.bool_]
    calm: NDArray[np.bool_] | None = None

    @property
    def loud(self) -> NDArray[np.bool_]:
        """Channels (outputs, inputs) whose elastic response is not silent beside the strongest one."""
        return loud_channels(self.elastic, self.row, self.column, self.omega)


class ReferenceModel:
    """The unreduced bodies, joined.

    Parameters
    ----------
    assembled : AssembledModel
        The model.
    shapes : mapping of name to ModalComponent or None
        Modes whose amplitudes are the coordinates of each flexible body; None where these are its dofs.
    bodies : mapping of name to FEModel
        Flexible bodies.
    """

    def __init__(
        self,
        assembled: AssembledModel,
        shapes: Mapping[str, ModalComponent | None],
        bodies: Mapping[str, FEModel],
    ) -> None:
        self.assembled, self.shapes, self.bodies = assembled, shapes, bodies
        self.decibel_grid = decibel_grid(self.scene.band)
        self.few = self.decibel_grid[np.linspace(0, self.decibel_grid.size - 1, _LOOKED_AT).astype(np.int64)]
        self._decibels: dict[str, Complex] = {}

    @property
    def scene(self) -> Scene:
        """Configurations, channels, band."""
        return self.assembled.scene

    def target(self, configuration: Configuration, omega: Real) -> Target:
        """Response in a configuration, of the scene or not, on a grid."""
        return self.as_target(configuration, omega, self.assembled.response(configuration, omega))

    def as_target(
        self, configuration: Configuration, omega: Real, H: Complex, of_rigid: AssembledModel | None = None
    ) -> Target:
        """Response H (f, outputs, inputs) on a grid, with its rigid part, its scales and the channels that respond.

        The rigid part is that of this model, or of a reduced one, which is the same: every one keeps the rigid modes.
        """
        model = of_rigid or self.assembled
        calm = model.calm(configuration, omega, H)
        rigid = model.rigid_response(configuration, omega, calm)
        responding, _ = self.responding(configuration, of_rigid)
        elastic = np.where(responding, H - rigid, 0.0)
        row, column = channel_scales(self.scene.actuators, self.scene.sensors, elastic, H, omega)
        return Target(configuration, omega, elastic, rigid, row, column, responding, calm)

    def responding(
        self, configuration: Configuration, of_rigid: AssembledModel | None = None
    ) -> tuple[NDArray[np.bool_], Real]:
        """Channels with an elastic response, and the reach of all at the frequencies ``few``; as for `as_target`."""
        H, reach = self._at_few(configuration)
        model = of_rigid or self.assembled
        rigid = model.rigid_response(configuration, self.few, model.calm(configuration, self.few, H))
        return responding_channels(H - rigid, reach), reach

    @once
    def _at_few(self, configuration: Configuration) -> tuple[Complex, Real]:
        return self.assembled.collocated(configuration, self.few, self.assembled.at(configuration).tables(self.few))

    def decibels(self, configurations: Sequence[Configuration]) -> list[Complex]:
        """Responses on the decibel grid; for many configurations, receptances of the bodies are tabulated."""
        every = self.scene.configurations
        # Tables are of one set of parameters.
        many = len(every) > _TABULATED and not any(each.parameters for each in every)
        new = [each for each in configurations if each.name not in self._decibels]
        tables = self.assembled.tables(self.decibel_grid) if many else None
        found = self.assembled.responses(new, [self.decibel_grid] * len(new), tables)
        both = {**self._decibels, **{each.name: H for each, H in zip(new, found, strict=True)}}
        if sum(H.nbytes for H in both.values()) <= _KEPT_BYTES:
            # A search, its last proof and the verification need them.
            self._decibels = both
        return [both[each.name] for each in configurations]
