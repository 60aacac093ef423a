"""Bases of large bodies from responses of the assembled scene, at frequencies where the estimated error is largest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.assemble import JoinedRows, PointStack, body_receptances
from cmsreduce.errors import ConfigError, SceneError
from cmsreduce.linalg.blocks import svd
from cmsreduce.linalg.response import ResonanceError
from cmsreduce.model import Configuration, Scene, Substructure, is_gyroscopic
from cmsreduce.pipeline.bodies import FlexibleBody
from cmsreduce.pipeline.project.articulation_range import ArticulationRange
from cmsreduce.pipeline.project.scene_shapes import SceneShapes
from cmsreduce.pipeline.system import AssembledModel, peaks
from cmsreduce.project import ESTIMATE_FACTOR
from cmsreduce.reduce import ResponseBody
from cmsreduce.verify import channel_scales, frequency_grid

__all__ = ["SceneBasis"]

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

# Share of the limit of frf_error that the estimate is brought below: what later stages leave out has the rest.
_SHARE = 0.1
# Points at most: as many factors of each body.
_MOST = 40
# Frequencies over the band on which the error is estimated, before refinement; one in so many points at resonances.
_POINTS, _COARSE = 100, 3
# Points are apart from each other and from resonances by these shares of a frequency at least: at a resonance without
# damping the resonant shape would hide all other responses.
_APART, _BESIDE = 2e-3, 0.02
# Configurations between those of the scene, if it articulates.
_BETWEEN = 6
# Loads and motions whose part beyond the others is a smaller share are the same.
_SAME = 1e-9
_SKEW = "has gyroscopic forces, and scene shapes need symmetric matrices; use craig-bampton or macneal-rubin"


@dataclass(frozen=True, eq=False)
class _Estimate:
    """Estimated error of one configuration, its square at each frequency, and the scales of the channels."""

    configuration: Configuration
    omega: Real
    error: float
    square: Real
    row: Real
    column: Real


class SceneBasis:
    """Adaptive rational Krylov basis of some bodies of a scene.

    Parameters
    ----------
    bodies : mapping of name to FlexibleBody
        Bodies to reduce.
    others : mapping of name to Substructure
        The other bodies of the scene as they enter it.
    scene : Scene
        Joints, configurations, channels, band.
    limit : float
        Limit of frf_error that later stages are to meet.

    Raises
    ------
    ConfigError
        If the scene has no response, a body no damping, or matrices that the method does not take.

    Notes
    -----
    The joined system is never factorised: each body gives its responses to unit forces at its joints and channels,
    and the forces in the joints are found from these flexibilities, as in `couple`. Primal and adjoint responses of all
    configurations come from the same factor, since the matrices are symmetric.
    """

    def __init__(
        self,
        bodies: Mapping[str, FlexibleBody],
        others: Mapping[str, Substructure],
        scene: Scene,
        limit: float,
    ) -> None:
        _refuse(bodies, others, scene)
        self.scene, self._others, self._limit = scene, others, limit
        alone = {name: replace(each, body=each.undamped).substructure(scene) for name, each in bodies.items()}
        subs = {**others, **alone}
        self._order = [name for name in scene.bodies if name in subs]
        self._wired = AssembledModel({name: subs[name] for name in self._order}, scene)
        span = ArticulationRange(scene)
        between = [] if span.is_point else span.points(_BETWEEN)
        self.configurations = [*scene.configurations, *(each for each in between if self._fits(each))]
        wirings = [self._wired.wiring(each) for each in self.configurations]
        self._columns = {name: self._wired.stack.body_columns(name) for name in bodies}
        self.points: list[float] = []
        self.bodies = {}
        for name, each in bodies.items():
            here = self._columns[name]
            rows = np.vstack([getattr(w, part)[:, here] for w in wirings for part in ("A", "B", "C1", "C2")])
            still = np.setdiff1d(np.arange(rows.shape[1]), self._wired.stack.moving(name))
            rows[:, still] = 0.0
            acting = _orthonormal_rows(rows)
            loads = _static_loads(each)
            self.bodies[name] = ResponseBody(each.body, each.rigid, alone[name], acting, loads, each.ports.interface)

    def _fits(self, configuration: Configuration) -> bool:
        """The loops of the scene close at these angles."""
        try:
            self._wired.wiring(configuration)
        except SceneError:
            return False
        return True

    def start(self) -> None:
        """Add the static responses to the inertia of the static shapes: zero is the first point, and has its factor."""
        if not self.points:
            self.points.append(0.0)
            for body in self.bodies.values():
                body.add_inertia()

    def estimate(self) -> float:
        """Estimated frf_error of the shapes, in the worst configuration."""
        return self._worst(self._model(), self._model(richer=True)).error

    def run(self) -> SceneShapes:
        """Add points until the estimate is below a tenth of the limit, and the last solve agreed with its estimate.

        Damping that is stated mode by mode needs the modes of the bodies, not their responses alone: where a solve
        finds no new shape, what the richer model has beyond the shapes joins them.
        """
        checked, allowed, ended = list[tuple[float, float, float]](), _SHARE * self._limit, False
        self.start()
        while True:
            less, more = self._model(), self._model(richer=True)
            worst = self._worst(less, more)
            if checked and (
                ended or len(self.points) >= _MOST or (worst.error <= allowed and _agree(*checked[-1][1:], allowed))
            ):
                break
            point, before = self._next(worst, more), self._count
            try:
                found = self._add(point, less, worst)
            except ResonanceError:
                # That of a mode which the shapes do not have yet.
                point *= 1 + _BESIDE
                found = self._add(point, less, worst)
            self.points.append(point)
            checked.append((point / (2 * np.pi), *found))
            if self._count == before and worst.error > allowed:
                ended = not sum(body.add_inertia() for body in self.bodies.values())
        return SceneShapes(
            {name: body.shapes for name, body in self.bodies.items()},
            tuple(w / (2 * np.pi) for w in self.points),
            worst.error,
            allowed,
            worst.configuration.name,
            tuple(checked),
        )

    @property
    def _count(self) -> int:
        """Number of shapes of all bodies."""
        return sum(body.count for body in self.bodies.values())

    def _model(self, *, richer: bool = False) -> AssembledModel:
        """The system of the shapes, or that of the shapes and their residuals."""
        highest = 2 * np.pi * self.scene.band[1]
        subs = {**self._others, **{name: each.modes(highest, richer=richer) for name, each in self.bodies.items()}}
        return AssembledModel({name: subs[name] for name in self._order}, self.scene)

    def _worst(self, less: AssembledModel, more: AssembledModel) -> _Estimate:
        return max((self._estimate(each, less, more) for each in self.configurations), key=lambda found: found.error)

    def _estimate(self, configuration: Configuration, less: AssembledModel, more: AssembledModel) -> _Estimate:
        """The difference of both models, on a grid refined at the peaks of the richer one."""
        omega = frequency_grid(self.scene.band, _POINTS, *peaks(more, configuration), _COARSE)
        H, H_less = (model.response(configuration, omega) for model in (more, less))
        elastic = H - more.rigid_response(configuration, omega)
        row, column = channel_scales(self.scene.actuators, self.scene.sensors, elastic, H, omega)
        weight = row[:, None] * column
        square, size = (np.sum(abs(part * weight) ** 2, axis=(1, 2)) for part in (H - H_less, elastic))
        whole = np.trapezoid(size, omega)
        error = float(np.sqrt(np.trapezoid(square, omega) / whole)) if whole else 0.0
        return _Estimate(configuration, omega, error, square, row, column)

    def _next(self, worst: _Estimate, more: AssembledModel) -> float:
        """The frequency with the largest estimate, apart from all points, and beside a resonance instead of at it."""
        chosen, resonances = np.array(self.points), more.resonances(worst.configuration).omega
        at = worst.omega
        if resonances.size:
            near = resonances[abs(at[:, None] - resonances).argmin(axis=1)]
            at = np.where(abs(at - near) < _BESIDE * near, np.where(at < near, 1 - _BESIDE, 1 + _BESIDE) * near, at)
        apart = (abs(at[:, None] - chosen) > _APART * chosen).all(axis=1)
        return float(at[np.argmax(np.where(apart, worst.square, -1.0))])

    def _add(self, omega: float, model: AssembledModel, worst: _Estimate) -> tuple[float, float]:
        """Add the responses of the scene at a frequency to the shapes of the bodies.

        Returns
        -------
        error, estimate : float
            Error of the response in the worst configuration before, by the solves of the bodies and by their residuals,
            relative to the response; bodies without a damping matrix count undamped.
        """
        w, stack = np.array([omega]), model.stack
        responses = {name: body.responses(omega) for name, body in self.bodies.items()}
        exact = {name: body.flexibility(omega, responses[name]) for name, body in self.bodies.items()}
        # The bodies as they are: forces of the ground are among those of the joints.
        others = PointStack({name: sub for name, sub in stack.substructures.items() if name not in self.bodies})
        Y = {name: of(w)[0] for name, of in body_receptances(others, w).items()}
        gathered: dict[str, list[Complex]] = {name: [] for name in self.bodies}
        found = 0.0, 0.0
        for configuration in self.configurations:
            rows = JoinedRows.of(model.wiring(configuration), stack)
            sides = {
                name: tuple(part[:, self._columns[name]] @ body.acting for part in (rows.left, rows.right))
                for name, body in self.bodies.items()
            }
            rest = np.zeros(rows.shape, dtype=np.complex128)
            for name, each in Y.items():
                moving = stack.body_columns(name).start + stack.moving(name)
                rest += rows.left[:, moving] @ each @ rows.right[:, moving].T
            G = _joined(rest, sides, exact)
            if configuration is worst.configuration:
                H, richer, less = (
                    rows.response(_joined(rest, sides, each)[None], w)[0] * worst.row[:, None] * worst.column
                    for each in (exact, self._reduced(omega, richer=True), self._reduced(omega, richer=False))
                )
                size = np.linalg.norm(H) or 1.0
                found = float(np.linalg.norm(H - less) / size), float(np.linalg.norm(richer - less) / size)
            loads, observers = _forces(rows, G)
            for name, (left, right) in sides.items():
                gathered[name] += [right.T @ loads, left.T @ observers]
        for name, body in self.bodies.items():
            amplitudes = np.hstack(gathered[name])
            body.add_responses(responses[name], np.hstack([amplitudes.real, amplitudes.imag]))
        return found

    def _reduced(self, omega: float, *, richer: bool) -> dict[str, Real | Complex]:
        return {name: body.reduced_flexibility(omega, richer=richer) for name, body in self.bodies.items()}


def _agree(error: float, estimate: float, allowed: float) -> bool:
    return error <= ESTIMATE_FACTOR * max(estimate, allowed)


def _joined(rest: Complex, sides: Mapping[str, tuple[Real, ...]], own: Mapping[str, Real | Complex]) -> Complex:
    """Flexibility between the rows of the joints and channels: of the other bodies, and of those with scene shapes."""
    return np.asarray(rest + sum(left @ own[name] @ right.T for name, (left, right) in sides.items()))


def _refuse(bodies: Mapping[str, FlexibleBody], others: Mapping[str, Substructure], scene: Scene) -> None:
    if not (scene.actuators and scene.sensors):
        raise ConfigError(
            "reduce: method scene needs a response: name at least one actuator and one sensor in the scene"
        )
    if any(each.parameters for each in scene.configurations):
        raise ConfigError(
            "reduce: method scene does not take scene.parameters, which change the matrices of bodies or joints; use "
            "craig-bampton or macneal-rubin"
        )
    for name, sub in others.items():
        if is_gyroscopic(sub.D):
            raise ConfigError(f"reduce: method scene: body '{name}' {_SKEW}")
    for name, each in bodies.items():
        why = _unfit(each)
        if why:
            raise ConfigError(f"reduce: method scene: body '{name}' {why}")


def _unfit(flexible: FlexibleBody) -> str | None:
    """Reason why a body has no scene shapes."""
    body = flexible.body
    if any(term.gyroscopic for term in body.terms):
        return _SKEW
    if body.D is None:
        if body.damping.law == "none":
            return "has no damping, so that its responses are infinite at resonances; give it `damping:`"
        return None
    size = abs(body.D)
    if flexible.rigid.shape[1]:
        drag = abs(body.D @ flexible.rigid).max()
        if drag > _SAME * size.max() * abs(flexible.rigid).max():
            return (
                "has a damping matrix that resists its rigid motion; give dampers to the ground as `dampers` of a "
                "joint, or use craig-bampton or macneal-rubin"
            )
    return None


def _orthonormal_rows(rows: Real) -> Real:
    """Orthonormal combinations of motions (p, q) that span some rows (k, p)."""
    length = np.linalg.norm(rows, axis=1)
    rows = rows[length > 0] / length[length > 0, None]
    _, share, V = svd(rows, full_matrices=False)
    return np.asarray(V[share > _SAME * share.max(initial=0.0)].T)


def _static_loads(flexible: FlexibleBody) -> sp.csc_array:
    """Unit forces at the interfaces, and loads that the keys name."""
    body = flexible.body
    rows = np.array([row for face in body.interfaces for row in body.interface_rows(face)], dtype=np.int64)
    units = sp.eye_array(body.n, format="csc")[:, np.unique(rows)]
    return sp.csc_array(sp.hstack([units, sp.csc_array(flexible.ports.static_loads)]))


def _forces(rows: JoinedRows, G: Complex) -> tuple[Complex, Complex]:
    """Forces at the rows on the right under unit inputs, and at those on the left under unit measured motions."""
    c = rows.c
    inner = np.linalg.solve(G[:c, :c], G[:c, c:]) if c else np.zeros((0, G.shape[1]), dtype=np.complex128)
    outer = np.linalg.solve(G[:c, :c].T, G[c:, :c].T) if c else np.zeros((0, G.shape[0]), dtype=np.complex128)
    return (
        np.vstack([-inner, np.eye(G.shape[1] - c)]),
        np.vstack([-outer, np.eye(G.shape[0] - c)]),
    )
