"""Responses of joined bodies in a few shapes of each, and their derivatives with respect to the shapes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from cmsreduce.project.body_modes import BodyModes, ShapeFlexibility

__all__ = [
    "BodyPart",
    "JoinedShapes",
    "ResponseSample",
    "SceneResponses",
    "Shapes",
    "coupled",
    "forces",
    "trapezoidal",
]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Shapes = Mapping[str, Array]
"""Shapes of each body (n, k): combinations of its free modes, of full rank."""


@dataclass(frozen=True, eq=False)
class ResponseSample:
    """The scene in one configuration: rows of joints, inputs and outputs, and the response to be met.

    Parameters
    ----------
    omega : (f,) float64
        Circular frequencies in rad/s.
    left, right : mapping of body to (l, n), (r, n) float64
        Motions of the free modes of each body at c joint rows, then at the outputs (left) or at the inputs (right).
    rest : (f, l, r) complex128
        Flexibility between these rows of everything that does not change: rigid motions, static modes, other bodies.
    c : int
        Joint rows.
    measure : (f, outputs, l - c) complex128
        Outputs from the motions of the last rows on the left; a rate is i w times a motion.
    H, elastic : (f, outputs, inputs) complex128
        Response of the reference model with its rigid-body part, and without it.
    row, column : float64
        Scales that make outputs and inputs comparable; zero for silent ones.
    heard : (outputs, inputs) bool
        Channels whose decibels count.
    """

    omega: Array
    left: Mapping[str, Array]
    right: Mapping[str, Array]
    rest: Complex
    c: int
    measure: Complex
    H: Complex
    elastic: Complex
    row: Array
    column: Array
    heard: NDArray[np.bool_]

    @cached_property
    def weights(self) -> Array:
        """Shares of the squared errors of all channels in the squared response error over the band (f, o, i)."""
        weights = trapezoidal(self.omega)[:, None, None] * (self.row[:, None] * self.column) ** 2
        size = float(np.sum(weights * abs(self.elastic) ** 2))
        return weights / size if size else np.zeros(self.H.shape)

    @cached_property
    def decades(self) -> Array:
        """Shares of the points whose decibels count (f, o, i): a Bode plot has a logarithmic axis."""
        heard = self.heard & (abs(self.H) > 0)
        decades = np.where(heard, trapezoidal(np.log(self.omega))[:, None, None], 0.0)
        return np.asarray(decades / (decades.sum() or 1.0))

    @cached_property
    def touched(self) -> dict[str, tuple[NDArray[np.int64], NDArray[np.int64]]]:
        """Rows on the left and on the right that are not zero on a body."""
        sides = {name: (self.left[name], self.right[name]) for name in self.left}
        return {name: (np.flatnonzero(L.any(axis=1)), np.flatnonzero(R.any(axis=1))) for name, (L, R) in sides.items()}


@dataclass(frozen=True, eq=False)
class JoinedShapes:
    """Responses of the joined bodies in one configuration, and what their derivatives need.

    Parameters
    ----------
    H : (f, outputs, inputs) complex128
        Response, rigid-body part included.
    loads, observers : (f, r, inputs), (f, l, outputs) complex128
        Forces at the rows on the right under unit inputs, and at those on the left under unit outputs: the channels
        themselves, and the forces in the joints.
    primal, adjoint : mapping of body to (f, k, inputs), (f, k, outputs) complex128
        Amplitudes of the shapes under these forces.
    """

    H: Complex
    loads: Complex
    observers: Complex
    primal: Mapping[str, Complex] = field(default_factory=dict)
    adjoint: Mapping[str, Complex] = field(default_factory=dict)


class SceneResponses:
    """Responses of bodies in a few shapes each, joined in several configurations.

    Parameters
    ----------
    bodies : mapping of name to BodyModes
        Bodies whose shapes change.
    samples : sequence of ResponseSample
        Configurations.

    Notes
    -----
    Every body is reduced by a symmetric (Galerkin) projection V^T Z V, the same in all configurations. Its flexibility
    at the rows of the joints and channels is L V (V^T Z V)^-1 V^T R^T; joint forces are solved for. Theory section
    "Scene shapes".
    """

    def __init__(self, bodies: Mapping[str, BodyModes], samples: Sequence[ResponseSample]) -> None:
        self.bodies, self.samples = bodies, list(samples)
        self._omega = np.concatenate([np.empty(0), *(sample.omega for sample in self.samples)])
        ends = np.cumsum([0, *(sample.omega.size for sample in self.samples)])
        self._parts = [slice(int(a), int(b)) for a, b in pairwise(ends)]

    def joined(self, shapes: Shapes) -> list[JoinedShapes]:
        """Responses in every configuration.

        Raises
        ------
        LinAlgError
            If the joints are not independent in the motions that the shapes leave.
        """
        return [_joined(*each) for each in self.in_shapes(shapes)]

    def responses(self, shapes: Shapes) -> list[Complex]:
        """The responses alone (f, outputs, inputs), in every configuration; errors as those of `joined`."""
        return [_response(sample, coupled(sample, parts)) for sample, parts in self.in_shapes(shapes)]

    def in_shapes(self, shapes: Shapes) -> Iterator[tuple[ResponseSample, list[BodyPart]]]:
        """Every configuration with the bodies in their shapes."""
        flexibility = {name: body.flexibility(shapes[name], self._omega) for name, body in self.bodies.items()}
        for sample, some in zip(self.samples, self._parts, strict=True):
            yield sample, [_part(sample, name, shapes[name], Y.at(some)) for name, Y in flexibility.items()]

    def gradient(self, shapes: Shapes, joined: Sequence[JoinedShapes], slopes: Sequence[Complex]) -> dict[str, Array]:
        """Derivative of a real function of the responses with respect to the shapes of each body (n, k).

        Parameters
        ----------
        shapes : mapping of body to (n, k) float64
        joined : sequence of JoinedShapes
            Their responses.
        slopes : sequence of (f, outputs, inputs) complex128
            Derivative of the function by the real part of the response in each configuration, plus i times that by its
            imaginary part.

        Notes
        -----
        With loads r and observers l of one body, and x = (V^T Z V)^-1 V^T r, z likewise, a change dV changes the
        response by (l - Z V z)^T dV x + z^T dV^T (r - Z V x): products of a residual and an amplitude. One more solve
        with the matrices of the response gives z. Nothing of the size n times f is formed.
        """
        found = {}
        for name, body in self.bodies.items():
            V = shapes[name]
            total = np.zeros_like(V)
            moments = np.zeros((3, V.shape[1], V.shape[1]), dtype=np.complex128)
            for sample, each, slope in zip(self.samples, joined, slopes, strict=True):
                x, z = each.primal[name], each.adjoint[name]
                # Conjugated slope between adjoint and primal amplitudes.
                to_inputs, to_outputs = x @ slope.conj().transpose(0, 2, 1), z @ slope.conj()
                total += sample.left[name].T @ _summed(each.observers, to_inputs).real
                total += sample.right[name].T @ _summed(each.loads, to_outputs).real
                powers = sample.omega[:, None] ** np.arange(3)
                weighted = (powers[:, :, None, None] * to_outputs[:, None]).reshape(len(powers), -1, x.shape[2])
                moments += _summed(weighted, x).reshape(moments.shape)
            of_K, of_D, of_M = ((part + part.T) for part in moments)
            strain = body.omega[:, None] ** 2 * V
            total -= strain @ ((1 + 1j * body.loss) * of_K).real + np.asarray(body.damped(V)).real @ (1j * of_D).real
            found[name] = total + V @ of_M.real
        return found

    def full_responses(self) -> list[tuple[dict[str, Complex], dict[str, Complex]]]:
        """Primal and adjoint responses of the bodies in all their modes, in every configuration.

        Returns
        -------
        list of (primal, adjoint)
            Mappings of body to (f, n, inputs) and (f, n, outputs) complex128.
        """
        found = []
        for sample in self.samples:
            flexible = {name: _all_modes(body, sample, name) for name, body in self.bodies.items()}
            G = sample.rest + sum(sample.left[name] @ right for name, (_, right) in flexible.items())
            loads, observers, _ = forces(sample, G)
            primal = {name: right @ loads for name, (_, right) in flexible.items()}
            adjoint = {name: left @ observers for name, (left, _) in flexible.items()}
            found.append((primal, adjoint))
        return found


def _summed(X: Complex, Y: Complex) -> Complex:
    """Sum of X Y^T over all frequencies (a, b), for (f, a, i) and (f, b, i)."""
    return np.asarray(np.tensordot(X, Y, axes=((0, 2), (0, 2))))


def _all_modes(body: BodyModes, sample: ResponseSample, name: str) -> tuple[Complex, Complex]:
    """Z^-1 L^T and Z^-1 R^T at every frequency (f, n, l), (f, n, r)."""
    left, right = sample.left[name], sample.right[name]
    both = np.hstack([left.T, right.T]).astype(np.complex128)
    X = np.array([body.solve(float(w), both) for w in sample.omega]).reshape(sample.omega.size, body.count, -1)
    return X[:, :, : left.shape[0]], X[:, :, left.shape[0] :]


def forces(sample: ResponseSample, G: Complex) -> tuple[Complex, Complex, Complex]:
    """Loads, observers and the response from the flexibility of all bodies between the rows (f, l, r)."""
    c, f = sample.c, G.shape[0]
    inputs, measured = G.shape[2] - c, G.shape[1] - c
    one = np.broadcast_to(np.eye(inputs), (f, inputs, inputs))
    seen = sample.measure.transpose(0, 2, 1)
    both = G[:, c:, c:]
    # Flexibilities of bodies without gyroscopic forces are symmetric, so that one factor serves both sides.
    X = np.linalg.solve(G[:, :c, :c], np.concatenate([G[:, :c, c:], G[:, c:, :c].transpose(0, 2, 1)], axis=2))
    both = both - G[:, c:, :c] @ X[:, :, :inputs]
    loads = np.concatenate([-X[:, :, :inputs], one], axis=1)
    observers = np.concatenate([-X[:, :, inputs:], np.broadcast_to(np.eye(measured), (f, measured, measured))], axis=1)
    return loads, observers @ seen, np.asarray(sample.measure @ both)


def _response(sample: ResponseSample, G: Complex) -> Complex:
    """The response alone, from the flexibility of all bodies between the rows (f, l, r)."""
    c = sample.c
    both = G[:, c:, c:] - G[:, c:, :c] @ np.linalg.solve(G[:, :c, :c], G[:, :c, c:])
    return np.asarray(sample.measure @ both)


@dataclass(frozen=True, eq=False)
class BodyPart:
    """A body in its shapes in one configuration: its rows of all, their motions (l, k), (r, k), and its flexibility."""

    name: str
    rows: NDArray[np.int64]
    columns: NDArray[np.int64]
    left: Array
    right: Array
    Y: ShapeFlexibility


def _part(sample: ResponseSample, name: str, V: Array, Y: ShapeFlexibility) -> BodyPart:
    rows, columns = sample.touched[name]
    return BodyPart(name, rows, columns, sample.left[name][rows] @ V, sample.right[name][columns] @ V, Y)


def coupled(sample: ResponseSample, parts: Sequence[BodyPart]) -> Complex:
    """Flexibility of all bodies between the rows (f, l, r)."""
    G = sample.rest.copy()
    for part in parts:
        G[:, part.rows[:, None], part.columns] += part.Y.between(part.left, part.right)
    return G


def _joined(sample: ResponseSample, parts: Sequence[BodyPart]) -> JoinedShapes:
    loads, observers, H = forces(sample, coupled(sample, parts))
    primal = {part.name: part.Y.amplitudes(part.right, loads[:, part.columns]) for part in parts}
    adjoint = {part.name: part.Y.amplitudes(part.left, observers[:, part.rows]) for part in parts}
    return JoinedShapes(H, loads, observers, primal, adjoint)


def trapezoidal(x: Array) -> Array:
    """Weights of the trapezoidal rule at increasing points (f,)."""
    step = np.diff(x)
    return np.asarray((np.concatenate([[0.0], step]) + np.concatenate([step, [0.0]])) / 2)
