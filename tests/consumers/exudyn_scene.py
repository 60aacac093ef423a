"""Scenes in Exudyn of bodies loaded from their files."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import exudyn as exu
import numpy as np
from exudyn.FEM import ObjectFFRFreducedOrderInterface
from exudyn.itemInterface import (
    GenericJoint,
    LoadForceVector,
    LoadTorqueVector,
    MarkerBodyRigid,
    MarkerNodeRigid,
    MarkerSuperElementPosition,
    MarkerSuperElementRigid,
    ObjectGround,
    SensorNode,
    SensorSuperElement,
    SphericalJoint,
)

__all__ = ["Body", "ExudynScene"]

# Of Newton's iterations, relative to the first residual and absolute: steps end at round-off.
_NEWTON = 1e-12

Torque = Callable[[float], Sequence[float]]


@dataclass(frozen=True)
class Body:
    """Numbers that Exudyn gave: the object, the node of its frame and that of its modes, a marker on the frame."""

    item: int
    frame: int
    modes: int
    marker: int


class ExudynScene:
    """A system under construction; ``mbs`` is Exudyn's own object."""

    def __init__(self) -> None:
        # The container owns the system and must outlive it.
        self._container = exu.SystemContainer()
        self.mbs: Any = self._container.AddSystem()
        self._ground_item: int = self.mbs.AddObject(ObjectGround())
        self.ground: int = self.ground_at((0, 0, 0))

    def add(self, file: Path, **initial: object) -> Body:
        """Load a body; ``initial`` are places and velocities of its frame by Exudyn's names."""
        interface = ObjectFFRFreducedOrderInterface()
        interface.LoadFromFile(str(file))
        made = interface.AddObjectFFRFreducedOrder(self.mbs, **initial)
        frame = made["nRigidBody"]
        marker = self.mbs.AddMarker(MarkerNodeRigid(nodeNumber=frame))
        return Body(made["oFFRFreducedOrder"], frame, made["nGenericODE2"], marker)

    def ground_at(self, place: Sequence[float]) -> int:
        """Marker of the ground at a place (3,)."""
        return int(self.mbs.AddMarker(MarkerBodyRigid(bodyNumber=self._ground_item, localPosition=list(place))))

    def marker_at(self, body: Body, mesh_node: int) -> int:
        """Marker that moves with one mesh node; it has no rotation."""
        return int(
            self.mbs.AddMarker(
                MarkerSuperElementPosition(bodyNumber=body.item, meshNodeNumbers=[mesh_node], weightingFactors=[1])
            )
        )

    def ball(self, first: int, second: int) -> None:
        """Hold two markers at one point."""
        self.mbs.AddObject(SphericalJoint(markerNumbers=[first, second]))

    def marker_on(self, body: Body, mesh_nodes: Sequence[int]) -> int:
        """Marker that moves and turns with the mean of some mesh nodes, all with one weight."""
        weights = np.full(len(mesh_nodes), 1 / len(mesh_nodes))
        return int(
            self.mbs.AddMarker(
                MarkerSuperElementRigid(
                    bodyNumber=body.item, meshNodeNumbers=list(mesh_nodes), weightingFactors=weights
                )
            )
        )

    def join(self, first: int, second: int, free: Sequence[int] = ()) -> None:
        """Join two markers but for the motions ``free``, 0..5."""
        held = [int(axis not in free) for axis in range(6)]
        self.mbs.AddObject(GenericJoint(markerNumbers=[first, second], constrainedAxes=held))

    def turn(self, body: Body, torque: Torque) -> None:
        """Torque (3,) over time on a body's frame, along its axes."""
        self.mbs.AddLoad(
            LoadTorqueVector(
                markerNumber=body.marker,
                loadVector=[0, 0, 0],
                bodyFixed=True,
                loadVectorUserFunction=lambda mbs, t, _: list(torque(t)),
            )
        )

    def pull(self, body: Body, mesh_node: int, force: Sequence[float]) -> None:
        """Constant force (3,) on one mesh node."""
        marker = self.marker_at(body, mesh_node)
        self.mbs.AddLoad(LoadForceVector(markerNumber=marker, loadVector=list(force)))

    def frequencies(self) -> np.ndarray:
        """Natural frequencies in rad/s as the system was built, ascending; rigid motions are 0."""
        self.mbs.Assemble()
        return np.sqrt(np.sort(self.mbs.ComputeODE2Eigenvalues(useAbsoluteValues=True)[0]))

    def settle(self) -> None:
        """Static solution."""
        self.mbs.Assemble()
        settings = exu.SimulationSettings()
        settings.solution.file.write = False
        settings.staticSolver.verboseMode = 0
        settings.staticSolver.newton.relativeTolerance = _NEWTON
        settings.staticSolver.newton.absoluteTolerance = _NEWTON
        self.mbs.SolveStatic(settings)

    def move(self, seconds: float, steps: int, radius: float = 1.0, modified: bool = False) -> None:
        """Integrate by generalised alpha; at a spectral radius of 1 it takes no energy."""
        self.mbs.Assemble()
        settings = exu.SimulationSettings()
        settings.solution.file.write = False
        # Under one step, so that rounding of the time skips none.
        settings.solution.sensors.writePeriod = 0.5 * seconds / steps
        settings.timeIntegration.verboseMode = 0
        settings.timeIntegration.endTime = seconds
        settings.timeIntegration.numberOfSteps = steps
        # The full Newton method forms all derivatives numerically at each step.
        settings.timeIntegration.newton.useModifiedNewton = modified
        settings.timeIntegration.generalizedAlpha.spectralRadius = radius
        settings.timeIntegration.newton.relativeTolerance = _NEWTON
        settings.timeIntegration.newton.absoluteTolerance = _NEWTON
        self.mbs.SolveDynamic(settings)

    def watch_point(self, body: Body, mesh_node: int, quantity: str = "Position") -> int:
        """Sensor of a mesh node; ``quantity`` by Exudyn's name."""
        kind = getattr(exu.OutputVariableType, quantity)
        sensor = SensorSuperElement(
            bodyNumber=body.item,
            meshNodeNumber=mesh_node,
            storeInternal=True,
            writeToFile=False,
            outputVariableType=kind,
        )
        return int(self.mbs.AddSensor(sensor))

    def watch_frame(self, body: Body, quantity: str) -> int:
        """Sensor of a body's frame."""
        kind = getattr(exu.OutputVariableType, quantity)
        sensor = SensorNode(nodeNumber=body.frame, storeInternal=True, writeToFile=False, outputVariableType=kind)
        return int(self.mbs.AddSensor(sensor))

    def seen(self, sensor: int) -> np.ndarray:
        """What a sensor saw: time, then its values, one row for each step from the start."""
        return np.array(self.mbs.GetSensorStoredData(sensor))

    def position(self, body: Body, mesh_node: int) -> np.ndarray:
        """Where a mesh node is (3,)."""
        return np.array(self.mbs.GetObjectOutputSuperElement(body.item, exu.OutputVariableType.Position, mesh_node))

    def local_displacement(self, body: Body, mesh_node: int) -> np.ndarray:
        """Displacement of a mesh node along the axes of its body's frame (3,)."""
        return np.array(
            self.mbs.GetObjectOutputSuperElement(body.item, exu.OutputVariableType.DisplacementLocal, mesh_node)
        )
