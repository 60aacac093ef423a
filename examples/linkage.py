"""Bodies on a base that stands still, and loops of them: a four-bar linkage with a flexible coupler.

A loop is cut open at one hinge, and constraints close it again: the two sides stay at one point, and their axes stay in
line. Ground, crank, coupler and rocker hang in a tree; the hinge from the rocker back to the ground is the one that is
cut. Constraints that others imply already, as in a loop that is planar, are left to least squares.

    python examples/linkage.py build/ground.h5 build/crank.h5 build/coupler.h5 build/rocker.h5 --spin 6.0

Interfaces: ``ground.a``, ``crank.a``, ``crank.b``, ``coupler.b``, ``coupler.c``, ``rocker.c``, ``rocker.d``,
``ground.d``; all hinges turn about the axis of the interface that ``--axis`` names. Needs numpy and h5py only.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from treetops_style import Body, Hinge, State, Tree, cross, load

__all__ = ["Linkage", "four_bar"]

Array = NDArray[np.float64]

# A constraint whose pivot is below this, of the largest, says what the others say.
_IMPLIED = 1e-9


class Linkage(Tree):
    """A tree whose base stands still.

    ``cut``: the interfaces that meet in the hinge that closes a loop, the first one of the base, and its axis; None for
    no loop. ``locked``: numbers of hinges that do not turn.
    """

    def __init__(
        self,
        bodies: Sequence[Body],
        hinges: Sequence[Hinge],
        cut: Hinge | None = None,
        gravity: Sequence[float] = (0, 0, 0),
        locked: Sequence[int] = (),
    ) -> None:
        super().__init__(bodies, hinges, gravity)
        self.cut, self.locked = cut, [6 + number for number in locked]
        names = [body.name for body in self.bodies]
        sides = [] if cut is None else [side.split(".") for side in (cut.parent, cut.child)]
        self.sides = [(names.index(body), interface) for body, interface in sides]
        # Two directions across the axis, which stands still with the base.
        self.across = np.zeros((0, 3)) if cut is None else np.linalg.svd(self._ends(self.rest())[0][3][None])[2][1:]

    def _ends(self, s: State) -> list[tuple[Array, Array, Array, Array]]:
        """Place, motion (6, n), its bias, and axis of the cut hinge in both of its sides."""
        motions, found, axis = self.motions(s), [], 0 if self.cut is None else self.cut.axis
        for body, interface in self.sides:
            place, B, c = self._carried(s, body, interface, *motions[body], 1)
            _, _, slope, frame = self.bodies[body].nodes[interface]
            turned = frame + cross(slope @ s.q[self._own(body)]) @ frame
            found.append((place, B, c, s.axes[body] @ turned[:, axis]))
        return found

    def gap(self, s: State) -> Array:
        """How far the two sides are apart (3,), and their axes out of line (2,)."""
        (here, _, _, axis), (there, _, _, other) = self._ends(s)
        return np.concatenate([there - here, self.across @ np.cross(axis, other)])

    def constraints(self, s: State) -> tuple[Array, Array]:
        """Rows J and rates g of J u' = g: what stands still, and both sides of the cut that move as one."""
        still = np.eye(self.size)[[*range(6), *self.locked]]
        if self.cut is None:
            return still, np.zeros(len(still))
        (_, first, c, _), (_, second, d, _) = self._ends(s)
        rows = np.vstack([still, (second - first)[:3], self.across @ (second - first)[3:]])
        return rows, -np.concatenate([np.zeros(len(still)), (d - c)[:3], self.across @ (d - c)[3:]])

    def accelerations(self, s: State, A: Array, f: Array) -> Array:
        """Rates of u under forces J^T l that keep the constraints: the shortest l, where some are implied."""
        J, g = self.constraints(s)
        free = np.linalg.solve(A, np.column_stack([f, J.T]))
        forces = np.linalg.lstsq(J @ free[:, 1:], g - J @ free[:, 0], rcond=_IMPLIED)[0]
        return np.asarray(free[:, 0] + free[:, 1:] @ forces)

    def spun(self, rate: float) -> State:
        """As built, the first hinge turning at a rate; the other hinges follow, the bodies do not bend."""
        s, hinges = self.rest(), slice(6, 6 + len(self.hinges))
        J = self.constraints(s)[0][6:, hinges]
        others = np.linalg.lstsq(J[:, 1:], -rate * J[:, 0], rcond=_IMPLIED)[0]
        u = s.u.copy()
        u[hinges] = [rate, *others]
        return replace(s, u=u)


def four_bar(bodies: Sequence[Body], axis: int = 2, gravity: Sequence[float] = (0, 0, 0)) -> Linkage:
    """Ground, crank, coupler and rocker, joined at a, b, c, and cut at d."""
    ground, crank, coupler, rocker = (body.name for body in bodies)
    hinges = [
        Hinge(f"{ground}.a", f"{crank}.a", axis),
        Hinge(f"{crank}.b", f"{coupler}.b", axis),
        Hinge(f"{coupler}.c", f"{rocker}.c", axis),
    ]
    return Linkage(bodies, hinges, Hinge(f"{ground}.d", f"{rocker}.d", axis), gravity)


def main() -> None:
    """Read the four bodies, spin the crank, and print what stays constant."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("files", nargs=4, type=Path, help="component files: ground, crank, coupler, rocker")
    for name, kind, value in (("axis", int, 2), ("spin", float, 6.0), ("duration", float, 1.0), ("steps", int, 2000)):
        parser.add_argument(f"--{name}", type=kind, default=value)
    options = parser.parse_args()
    bodies = [load(path) for path in options.files]
    # Links are stiff beside the coupler: they turn and do not bend.
    linkage = four_bar([body if at == 2 else body.cut(0) for at, body in enumerate(bodies)], options.axis)
    s, h = linkage.spun(options.spin), options.duration / options.steps
    start = linkage.energy(s)
    for number in range(options.steps + 1):
        if number % max(1, options.steps // 20) == 0:
            change, gap = linkage.energy(s) / start - 1, abs(linkage.gap(s)).max()
            sys.stdout.write(f"{np.degrees(s.angles)} deg, {change=:.2e}, {gap=:.2e}\n")
        s = linkage.step(s, number * h, h, lambda *_: np.zeros(3))


if __name__ == "__main__":
    main()
