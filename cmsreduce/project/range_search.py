"""Search for scene shapes of a whole range of configurations, in which each shape less gains little."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from cmsreduce.project.scene_responses import Shapes
from cmsreduce.project.settled_shapes import Settled
from cmsreduce.project.shape_search import ShapeSearch
from cmsreduce.project.shape_starts import MIXES

__all__ = ["RangeSearch"]

# So far from the limits the optimisation ends after a round without a better set.
_FAR = 2.0


class RangeSearch(ShapeSearch):
    """Scene shapes for some configurations of a range; more are added where these shapes err.

    Takes what :class:`ShapeSearch` takes. Other configurations need room, so that it leaves out what takes longest:
    other distributions between the bodies, numbers of shapes that failed once, and starts that never came near the
    limits.
    """

    _heats = ShapeSearch._heats[:2]

    def _passing(self, best: Settled) -> Settled:
        return self._fewer(best) if best.passes else self.reached(best)

    def _step(self, step: int, untried: int) -> int:
        while step > untried:
            step //= 2
        return step

    def _patience(self, best: Settled) -> int:
        return super()._patience(best) if best.judged.worst <= _FAR else 1

    def _starts(self, counts: Mapping[str, int]) -> Iterator[Shapes]:
        return (self.directions.leading(counts, mix) for mix in MIXES)

    def _shrunk(self, best: Settled, step: int) -> Settled | None:
        return self._without(best, step, mended=step == 1)
