"""Responses of joined bodies in a few shapes of each, and their derivatives with respect to the shapes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

__all__ = ["BodyModes", "JoinedShapes", "ResponseSample", "SceneResponses", "Shapes"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Shapes = Mapping[str, Array]
"""Shapes of each body (n, k): combinations of its free modes, of full rank."""

# A sum over complex modes is checked at about so many frequencies, and holds where it inverts the stiffness this well:
# rounding times the condition of a sharp resonance.
_CHECKED, _INVERTED = 12, 1e-8


@dataclass(frozen=True, eq=False)
class BodyModes:
    """A body in its free modes: Z(w) = K (1 + i loss) + i w D - w^2, with K = diag(omega^2) and a mass of one.

    Parameters
    ----------
    omega : (n,) float64
        Elastic frequencies in rad/s.
    D : (n,) or (n, n) float64
        Viscous damping: its diagonal, or a symmetric matrix.
    loss : float
        Loss factor of structural damping.
    """

    omega: Array
    D: Array
    loss: float = 0.0

    @property
    def count(self) -> int:
        """Number of elastic modes, n."""
        return self.omega.size

    def damped(self, X: Array | Complex) -> Array | Complex:
        """D X."""
        return self.D[:, None] * X if self.D.ndim == 1 else self.D @ X

    def dynamic_stiffness(self, V: Array, omega: Array) -> Complex:
        """V^T Z V at frequencies (f, k, k)."""
        weighted, w = self.omega[:, None] * V, omega[:, None, None]
        return np.asarray(
            (1 + 1j * self.loss) * (weighted.T @ weighted) + 1j * w * (V.T @ self.damped(V)) - w**2 * (V.T @ V)
        )

    def flexibility(self, V: Array, omega: Array) -> Complex:
        """(V^T Z V)^-1 at frequencies (f, k, k), as a sum over the complex modes of the shapes.

        Notes
        -----
        The modes of s^2 M + s D + K in the shapes come from one eigenproblem of twice their number; then all
        frequencies are one product. Where modes coincide without being independent, each frequency is inverted.
        """
        weighted, k = self.omega[:, None] * V, V.shape[1]
        M, D, K = V.T @ V, V.T @ self.damped(V), (1 + 1j * self.loss) * (weighted.T @ weighted)
        X = np.linalg.inv(M)
        first = np.block([[np.zeros((k, k)), np.eye(k)], [-X @ K, -X @ D]])
        s, shapes = np.linalg.eig(first)
        try:
            loads = np.linalg.solve(shapes, np.vstack([np.zeros((k, k)), X]).astype(np.complex128))
        except np.linalg.LinAlgError:
            return np.asarray(np.linalg.inv(self.dynamic_stiffness(V, omega)))
        weights = 1 / (1j * omega[:, None] - s)
        Y = (weights @ (shapes[:k].T[:, :, None] * loads[:, None, :]).reshape(2 * k, -1)).reshape(-1, k, k)
        check = self.dynamic_stiffness(V, omega[:: max(1, omega.size // _CHECKED)])
        off = check @ Y[:: max(1, omega.size // _CHECKED)] - np.eye(k)
        if abs(off).max(initial=0.0) < _INVERTED:
            return np.asarray(Y)
        return np.asarray(np.linalg.inv(self.dynamic_stiffness(V, omega)))

    def modal_stiffness(self, omega: Array) -> Complex:
        """Diagonal of Z at frequencies (f, n)."""
        viscous = self.D if self.D.ndim == 1 else self.D.diagonal()
        w = omega[:, None]
        return np.asarray(self.omega**2 * (1 + 1j * self.loss) + 1j * w * viscous - w**2)

    def solve(self, omega: float, F: Complex) -> Complex:
        """Z^-1 F at one frequency, for loads (n, p)."""
        if self.D.ndim == 1:
            return np.asarray(F / self.modal_stiffness(np.array([omega])).T)
        diagonal = self.omega**2 * (1 + 1j * self.loss) - omega**2
        return np.asarray(np.linalg.solve(np.diag(diagonal) + 1j * omega * self.D, F))

    def dual_norms(self, omega: Array, F: Complex) -> Array:
        """F^H (w D)^-1 F of loads (f, n, p), with the loss factor times K in place of w D; infinite without damping."""
        if not self.loss and self.D.ndim == 2:
            solved = np.linalg.solve(self.D, F)
            return np.asarray(np.sum((F.conj() * solved).real, axis=1) / omega[:, None])
        viscous = self.D if self.D.ndim == 1 else self.D.diagonal()
        drag = (self.loss * self.omega**2 + omega[:, None] * viscous)[:, :, None]
        squares = abs(F) ** 2
        return np.asarray(
            np.sum(np.divide(squares, drag, out=np.where(squares > 0, np.inf, 0.0), where=drag > 0), axis=1)
        )


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
        flexibility = {name: body.flexibility(shapes[name], self._omega) for name, body in self.bodies.items()}
        return [
            _joined(sample, shapes, {name: Y[part] for name, Y in flexibility.items()})
            for sample, part in zip(self.samples, self._parts, strict=True)
        ]

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
                for power in range(3):
                    moments[power] += _summed(to_outputs * (sample.omega**power)[:, None, None], x)
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
            loads, observers, _ = _forces(sample, G)
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


def _forces(sample: ResponseSample, G: Complex) -> tuple[Complex, Complex, Complex]:
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


def _joined(sample: ResponseSample, shapes: Shapes, flexibility: Mapping[str, Complex]) -> JoinedShapes:
    left = {name: sample.left[name] @ shapes[name] for name in flexibility}
    right = {name: sample.right[name] @ shapes[name] for name in flexibility}
    G = sample.rest + sum(left[name] @ Y @ right[name].T for name, Y in flexibility.items())
    loads, observers, H = _forces(sample, G)
    primal = {name: Y @ (right[name].T @ loads) for name, Y in flexibility.items()}
    adjoint = {name: Y @ (left[name].T @ observers) for name, Y in flexibility.items()}
    return JoinedShapes(H, loads, observers, primal, adjoint)
