"""Responses of joined bodies in a few shapes of each, and their derivatives with respect to the shapes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from cmsreduce.project.body_modes import BodyModes
from cmsreduce.project.joined_shapes import BodyPart, JoinedShapes
from cmsreduce.project.response_sample import ResponseSample

__all__ = ["SceneResponses", "Shapes"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Shapes = Mapping[str, Array]
"""Shapes of each body (n, k): combinations of its free modes, of full rank."""


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
        return list(self.in_shapes(shapes))

    def responses(self, shapes: Shapes) -> list[Complex]:
        """The responses alone (f, outputs, inputs), in every configuration; errors as those of `joined`."""
        return [joined.H for joined in self.in_shapes(shapes)]

    def in_shapes(self, shapes: Shapes) -> Iterator[JoinedShapes]:
        """Every configuration with the bodies in their shapes; errors as those of `joined`."""
        flexibility = {name: body.flexibility(shapes[name], self._omega) for name, body in self.bodies.items()}
        for sample, some in zip(self.samples, self._parts, strict=True):
            parts = [BodyPart.of(sample, name, shapes[name], Y.at(some)) for name, Y in flexibility.items()]
            yield JoinedShapes(sample, parts)

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
        total = {name: np.zeros_like(shapes[name]) for name in self.bodies}
        moments = {name: np.zeros((3, V.shape[1], V.shape[1]), dtype=np.complex128) for name, V in total.items()}
        for sample, each, slope in zip(self.samples, joined, slopes, strict=True):
            # One adjoint solution for each input.
            forces, adjoint = each.swayed(slope.conj())
            powers = sample.omega[:, None] ** np.arange(3)
            for name in self.bodies:
                x, z = each.primal[name], adjoint[name]
                total[name] += sample.left[name].T @ _summed(forces, x).real
                total[name] += sample.right[name].T @ _summed(each.loads, z).real
                weighted = (powers[:, :, None, None] * z[:, None]).reshape(len(powers), -1, x.shape[2])
                moments[name] += _summed(weighted, x).reshape(moments[name].shape)
        found = {}
        for name, body in self.bodies.items():
            V = shapes[name]
            of_K, of_D, of_M = ((part + part.T) for part in moments[name])
            strain = body.omega[:, None] ** 2 * V
            lost = strain @ ((1 + 1j * body.loss) * of_K).real + np.asarray(body.damped(V)).real @ (1j * of_D).real
            found[name] = total[name] - lost + V @ of_M.real
        return found

    def full_responses(self) -> list[tuple[dict[str, Complex], dict[str, Complex]]]:
        """Primal and adjoint responses of the bodies in all their modes, in every configuration.

        Returns
        -------
        list of (primal, adjoint)
            Mappings of body to (f, n, inputs) and (f, n, outputs) complex128.
        """
        every = {name: np.eye(body.count) for name, body in self.bodies.items()}
        found = []
        for sample in self.samples:
            parts = [
                BodyPart.of(sample, name, V, self.bodies[name].in_all_modes(sample.omega)) for name, V in every.items()
            ]
            joined = JoinedShapes(sample, parts)
            found.append((joined.primal, joined.adjoint))
        return found


def _summed(X: Complex, Y: Complex) -> Complex:
    """Sum of X Y^T over all frequencies (a, b), for (f, a, i) and (f, b, i)."""
    return np.asarray(np.tensordot(X, Y, axes=((0, 2), (0, 2))))
