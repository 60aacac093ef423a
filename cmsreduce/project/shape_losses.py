"""Responses of joined bodies without one of their shapes: those of every shape of every body from one solve."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from cmsreduce.project.joined_shapes import JoinedShapes
from cmsreduce.project.scene_responses import SceneResponses, Shapes

__all__ = ["BodyLosses", "ShapeLosses"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


def _along(joined: JoinedShapes, inverse: Complex, name: str) -> tuple[Complex, Complex, Complex, Complex]:
    """The response; primal and adjoint amplitudes of a body's shapes, and the flexibility along them (f, k, k)."""
    (part,) = (each for each in joined.parts if each.name == name)
    c, Y, one = joined.sample.c, part.Y, np.eye(part.left.shape[1])
    joint, force = part.rows < c, part.columns < c
    held = inverse[:, part.columns[force][:, None], part.rows[joint]] @ Y.between(part.left[joint], one)
    along = Y.between(one, one) - Y.between(one, part.right[force]) @ held
    return joined.H, joined.primal[name], joined.adjoint[name], along


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
        self._places = [
            (joined, np.asarray(np.linalg.inv(joined.between_joints))) for joined in scene.in_shapes(shapes)
        ]

    def of(self, name: str) -> BodyLosses:
        """The losses of one body."""
        return BodyLosses([_along(*place, name) for place in self._places])


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
