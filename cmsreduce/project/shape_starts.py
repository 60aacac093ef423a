"""Directions that a search for scene shapes starts from, adds and leaves out."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from functools import cached_property
from itertools import islice

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.linalg.blocks import svd
from cmsreduce.project.scene_responses import SceneResponses, Shapes
from cmsreduce.project.scene_shapes import energy_shapes, mode_shares
from cmsreduce.project.shape_losses import ShapeLosses

__all__ = ["MIXES", "SceneDirections"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

MIXES = (0.25, 0.0)
"""Exponents of the weight of a response: by its energy, and nearer to its decibels."""
# Directions of a body, and of either weight, that are tried as one shape more.
_TRIED = 3
# Share of the largest singular value of the responses, down to which directions enter the first set.
_FIRST = 0.01


class SceneDirections:
    """Directions of the bodies by their part in the responses of a scene.

    Parameters
    ----------
    scene : SceneResponses
    """

    def __init__(self, scene: SceneResponses) -> None:
        self.scene = scene
        self._by_energy: dict[float, dict[str, tuple[Array, Array]]] = {}

    def shares(self) -> dict[str, Array]:
        """Singular values of the responses of each body (k,), the largest first."""
        return {name: share for name, (_, share) in self._energy(MIXES[0]).items()}

    def counts(self, total: int | None = None) -> dict[str, int]:
        """Shapes of each body: those with the largest shares of all, or those above a share of the largest."""
        shares = self.shares()
        every = np.sort(np.concatenate(list(shares.values())))[::-1]
        least = _FIRST * every[0] if total is None else every[min(total, every.size) - 1]
        return {name: int(np.count_nonzero(share >= least)) for name, share in shares.items()}

    def leading(self, counts: Mapping[str, int], mix: float = MIXES[0]) -> dict[str, Array]:
        """The directions of each body with most energy."""
        return {name: V[:, : counts[name]] for name, (V, _) in self._energy(mix).items()}

    def beyond(self, name: str, V: Array) -> Iterator[Array]:
        """The strongest directions (n, 1) of a body's responses beyond its shapes."""
        w = self.scene.bodies[name].omega[:, None]
        U = np.linalg.qr(w * V)[0]
        for mix in MIXES:
            every, share = self._energy(mix)[name]
            left, _, _ = svd((w * every - U @ (U.T @ (w * every))) * share, full_matrices=False)
            yield from (left[:, [k]] / w for k in range(min(_TRIED, w.size - V.shape[1])))

    def less_one(self, names: Iterable[str], shapes: Shapes) -> Iterator[tuple[Shapes, list[Complex]]]:
        """The shapes without one of a body's weak directions in the scene or of its modes, and their responses.

        Of several bodies, one after another; the bodies are joined once for all of them.
        """
        weights = {name: self.scene.bodies[name].omega[:, None] for name in shapes}
        alone = {name: np.linalg.qr(weights[name] * V)[0] / weights[name] for name, V in shapes.items()}
        losses = ShapeLosses(self.scene, alone)
        for name in names:
            V, w, own = alone[name], weights[name], losses.of(name)
            _, directions = la.eigh(own.gram)
            _, modes = la.eigh((w * V).T @ (w * V), V.T @ V)
            # Of the directions the weakest half: the strongest ones are never the first to go.
            for basis, most in ((directions, (V.shape[1] + 1) // 2), (modes, V.shape[1])):
                for k, responses in enumerate(islice(own.without_each(basis), most)):
                    yield {**shapes, name: np.delete(V @ basis, k, axis=1)}, responses

    @cached_property
    def mode_shares(self) -> dict[str, Array]:
        """Share of each mode in the squared responses of all configurations."""
        return mode_shares(self.scene)

    def modes(self, numbers: Mapping[str, NDArray[np.int64]]) -> dict[str, Array]:
        """Modes of the bodies by their numbers."""
        return {name: np.eye(body.count)[:, numbers[name]] for name, body in self.scene.bodies.items()}

    def strongest_modes(self, count: int) -> dict[str, Array]:
        """The modes with the largest shares of all bodies together."""
        shares = self.mode_shares
        owner = np.repeat(list(shares), [own.size for own in shares.values()])
        number = np.concatenate([np.arange(own.size) for own in shares.values()])
        first = np.argsort(-np.concatenate(list(shares.values())), kind="stable")[:count]
        return self.modes({name: np.sort(number[first[owner[first] == name]]) for name in shares})

    def _energy(self, mix: float) -> dict[str, tuple[Array, Array]]:
        if mix not in self._by_energy:
            self._by_energy[mix] = energy_shapes(self.scene, mix)
        return self._by_energy[mix]
