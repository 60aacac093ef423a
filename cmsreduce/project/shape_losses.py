"""Responses of joined bodies without one of their shapes: those of every shape of every body from one solve."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cmsreduce.project.scene_responses import BodyPart, ResponseSample, SceneResponses, Shapes, coupled, forces

__all__ = ["BodyLosses", "ShapeLosses"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class _Place:
    """One configuration: the response, loads, observers, and the inverse flexibility between the joint rows."""

    sample: ResponseSample
    parts: Sequence[BodyPart]
    H: Complex
    loads: Complex
    observers: Complex
    inverse: Complex

    @classmethod
    def of(cls, sample: ResponseSample, parts: Sequence[BodyPart]) -> _Place:
        G = coupled(sample, parts)
        loads, observers, H = forces(sample, G)
        inverse = np.asarray(np.linalg.inv(G[:, : sample.c, : sample.c]))
        return cls(sample, parts, H, loads, observers, inverse)

    def along(self, name: str) -> tuple[Complex, Complex, Complex, Complex]:
        """The response; primal and adjoint amplitudes of a body's shapes, and the flexibility along them (f, k, k)."""
        (part,) = (each for each in self.parts if each.name == name)
        Y, one = part.Y, np.eye(part.left.shape[1])
        joint, force = part.rows < self.sample.c, part.columns < self.sample.c
        held = self.inverse[:, part.columns[force][:, None], part.rows[joint]] @ Y.between(part.left[joint], one)
        x = Y.amplitudes(part.right, self.loads[:, part.columns])
        z = Y.amplitudes(part.left, self.observers[:, part.rows])
        return self.H, x, z, Y.between(one, one) - Y.between(one, part.right[force]) @ held


class ShapeLosses:
    """Joined bodies in some shapes, ready for the loss of any one shape of any body.

    Parameters
    ----------
    scene : SceneResponses
    shapes : mapping of body to (n, k) float64

    Raises
    ------
    LinAlgError
        If the joints are not independent in the motions that the shapes leave.
    """

    def __init__(self, scene: SceneResponses, shapes: Shapes) -> None:
        self._places = [_Place.of(sample, parts) for sample, parts in scene.in_shapes(shapes)]

    def of(self, name: str) -> BodyLosses:
        """The losses of one body."""
        return BodyLosses([place.along(name) for place in self._places])


class BodyLosses:
    """Losses of one body.

    Parameters
    ----------
    places : sequence of (H, x, z, D)
        In each configuration, the response (f, outputs, inputs), the amplitudes of the shapes under unit inputs and
        outputs (f, k, inputs), (f, k, outputs), and the flexibility along the shapes (f, k, k).
    """

    def __init__(self, places: Sequence[tuple[Complex, Complex, Complex, Complex]]) -> None:
        self._places = places

    @property
    def gram(self) -> Array:
        """Energies of the amplitudes and their products (k, k), of every configuration and side with one weight."""
        count = self._places[0][3].shape[1]
        total = np.zeros((count, count))
        for _, *both, _ in self._places:
            for X in both:
                flat = X.transpose(1, 0, 2).reshape(count, -1)
                size = float(np.sum(abs(flat) ** 2))
                total += (flat @ flat.conj().T).real / size if size else 0.0
        return total

    def without_each(self, basis: Array | None = None) -> Iterator[list[Complex]]:
        """The responses in every configuration without one of the shapes, or of combinations of them, each in turn.

        Parameters
        ----------
        basis : (k, k) float64, optional
            Independent combinations of the shapes, as columns.

        Notes
        -----
        Without a shape its amplitude is zero: a force along it undoes the motion x that an input causes, by x / d with
        d the flexibility of the joined bodies along the shape. It changes the output by its adjoint amplitude z, so
        that the response is H - z x / d. Where the joints need the shape, d is zero and the response is not finite.
        """
        # Amplitudes of the combinations, from those of the shapes.
        share = np.eye(self._places[0][3].shape[1]) if basis is None else np.linalg.inv(basis)
        found = [(H, share @ x, share @ z, np.sum((share @ D) * share, axis=2)) for H, x, z, D in self._places]
        for j in range(len(share)):
            with np.errstate(divide="ignore", invalid="ignore"):
                yield [H - z[:, j, :, None] * (x[:, j] / d[:, j, None])[:, None] for H, x, z, d in found]
