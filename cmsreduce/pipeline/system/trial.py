"""One configuration of a search for modes: errors of a selection on fixed grids, the hardest frequencies first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from cmsreduce.assemble import Change, ModalReceptance
from cmsreduce.balance import ChangedResponse, Selection
from cmsreduce.pipeline.system.reference_model import Target
from cmsreduce.project import trapezoidal
from cmsreduce.verify import PERCENTILE, channel_errors, db_errors, loud_channels

__all__ = ["Trial"]

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Points = NDArray[np.int64]

# Frequencies that are computed first: those with the largest errors of the last refused selection.
_HARDEST = 96
# Frequencies of the band at which effects are computed: those with the strongest response, and some of the others.
_STRONGEST, _OTHERS = 96, 192
# Frequencies of the decibel error at which effects are computed: those with the largest present errors.
_WORST = 96
# Without a limit on it, the response error still orders the modes.
_NO_LIMIT = 1e3
# Above this share of a response its rounding is no error of a selection: a hundredth of a decibel.
_ROUNDING = 1e-3
# Response values of all effects of one configuration; with more, fewer frequencies are taken.
_VALUES = 2**22


@dataclass(eq=False)
class Trial:
    """One configuration: the target response, and the scales that make a squared error a sum of squares.

    Parameters
    ----------
    target : Target
        Response of the reference model.
    table : ModalReceptance
        At the frequencies of the target, and then at those of the decibel error.
    full_db : (d, outputs, inputs) complex128
        Reference response there; no frequency if the decibel error is not judged here.
    limits : mapping of str to float
        Limits that are judged here.
    """

    target: Target
    table: ModalReceptance
    full_db: Complex
    limits: Mapping[str, float]
    hardest: Points = field(init=False)
    hardest_db: Points = field(init=False)

    def __post_init__(self) -> None:
        target = self.target
        self.points = np.arange(target.omega.size)
        self.points_db = target.omega.size + np.arange(self.full_db.shape[0])
        self.channel = target.row[:, None] * target.column[None, :]
        power = trapezoidal(target.omega) * np.sum(abs(target.elastic * self.channel) ** 2, axis=(1, 2))
        # Without any response in the reference model, all scales and all errors are zero.
        self.size = 1 / power.sum() if power.any() else 0.0
        self.weight = trapezoidal(target.omega) * self.size
        self.total = target.elastic + target.rigid
        self.loud = self.loud_db = target.loud
        if self.points_db.size:
            self.loud_db = self.loud | loud_channels(self.full_db, target.row, target.column)
            # With every mode: NaN, where no selection is judged. The model that is found is judged by its own modes.
            lost = self.table.rounding({}, self.points_db) > _ROUNDING * abs(self.full_db)
            self.full_db = np.where(lost, np.nan, self.full_db)
        self.hardest = np.argsort(-power, kind="stable")[:_HARDEST]
        self.hardest_db = np.empty(0, dtype=np.int64)

    def squares(self, H: Complex, at: Points | None = None) -> Array:
        """Contribution of each frequency to the squared frf_error (g,)."""
        points = slice(None) if at is None else at
        error = (H - self.total[points]) * self.channel
        return np.asarray(self.weight[points] * np.sum(error.real**2 + error.imag**2, axis=(1, 2)))

    def least(self, kept: Selection) -> float:
        """Lower bound of the ratio of any error to its limit, from the frequencies where selections failed before."""
        in_db = self.hardest_db if "db_error" in self.limits else self.hardest_db[:0]
        in_band = self.hardest if "frf_error" in self.limits else self.hardest[:0]
        H = self.table.response(kept, np.concatenate([in_band, self.points.size + in_db]))
        worst = 0.0
        if in_band.size:
            worst = float(np.sqrt(np.sum(self.squares(H[: in_band.size], in_band)))) / self.limits["frf_error"]
        # So many of the largest errors lie above the percentile.
        beyond = int(self.points_db.size * (1 - PERCENTILE / 100))
        if in_db.size > beyond and self.loud_db.any():
            apart = _decibels(H[in_band.size :, self.loud_db], self.full_db[in_db][:, self.loud_db])
            worst = max(worst, float(np.sort(apart, axis=0)[-1 - beyond].max()) / self.limits["db_error"])
        return worst

    def frf_error(self, kept: Selection) -> float:
        """Error of the elastic response over the band."""
        return float(np.sqrt(np.sum(self.squares(self.table.response(kept, self.points)))))

    def ratio(self, H: Complex) -> float:
        """Largest ratio of the errors of the response to their limits; ``H`` is at all frequencies of the table."""
        target, limits, worst = self.target, self.limits, 0.0
        in_band, in_db = H[: self.points.size], H[self.points.size :]
        if "frf_error" in limits:
            worst = float(np.sqrt(np.sum(self.squares(in_band)))) / limits["frf_error"]
        if "channel_error" in limits:
            elastic = np.where(target.responding, in_band - target.rigid, 0.0)
            own = channel_errors(target.omega, target.elastic, elastic)[self.loud]
            worst = max(worst, float(np.nanmax(own, initial=0.0)) / limits["channel_error"])
        if "db_error" in limits:
            worst = max(worst, float(np.nanmax(self.db_errors(in_db), initial=0.0)) / limits["db_error"])
        return worst

    def db_errors(self, in_db: Complex) -> Array:
        """Decibel errors of the channels (outputs, inputs)."""
        reference = np.where(np.isnan(self.full_db), in_db, self.full_db)
        return db_errors(reference, in_db, self.target.row, self.target.column, self.loud_db)

    def failed(self, H: Complex) -> None:
        """Remember the frequencies with the largest errors: the next selection probably fails there."""
        self.hardest = np.argsort(-self.squares(H[: self.points.size]), kind="stable")[:_HARDEST]
        if self.points_db.size and self.loud_db.any():
            apart = _decibels(H[self.points.size :][:, self.loud_db], self.full_db[:, self.loud_db]).max(axis=1)
            self.hardest_db = np.argsort(-apart, kind="stable")[:_HARDEST]

    def changed(self, selection: Selection, changes: Sequence[Change], H: Complex | None = None) -> ChangedResponse:
        """Effects of changes on the response at a few frequencies; ``H`` is the response at all of them, if known."""
        most = max(_HARDEST, _VALUES // ((1 + len(changes)) * self.channel.size))
        every = max(1, -(-self._sampled[0].size // most))
        band, weight = self._sampled[0][::every], every * self._sampled[1][::every]
        worst = self._worst(selection, H)[: most // 2]
        at = np.concatenate([band, self.points.size + worst])

        def responses() -> tuple[Complex, Complex]:
            present, effects, known = self.table.effects(selection, changes, at)
            for k in map(int, np.flatnonzero(~known)):
                body, columns = changes[k]
                other = {**selection, body: np.setxor1d(selection[body], columns)}
                effects[..., k] = self.table.response(other, at) - present
            return present, effects

        return ChangedResponse(
            responses,
            partial(self._estimate, band, weight, worst),
            at.size * self.channel.size,
            partial(self.table.together, selection, changes, at=at),
            self.table.alone(selection, changes),
        )

    @cached_property
    def _sampled(self) -> tuple[Points, Array]:
        """Frequencies of the band that stand for all of them, and their weights in the squared frf_error."""
        power = self.squares(self.total - self.target.elastic)
        order = np.argsort(-power, kind="stable")
        every = max(1, (order.size - _STRONGEST) // _OTHERS)
        strong, rest = order[:_STRONGEST], np.sort(order[_STRONGEST:])[::every]
        weight = np.concatenate([self.weight[strong], every * self.weight[rest]])
        return np.concatenate([strong, rest]), weight

    def _worst(self, selection: Selection, H: Complex | None) -> Points:
        """Frequencies of the decibel error with the largest errors of a selection."""
        if not (self.points_db.size and self.loud_db.any()):
            return self.points_db[:0]
        H = self.table.response(selection, self.points_db) if H is None else H[self.points.size :]
        apart = _decibels(H[:, self.loud_db], self.full_db[:, self.loud_db]).max(axis=1)
        return np.sort(np.argsort(-apart, kind="stable")[:_WORST])

    def _estimate(self, band: Points, weight: Array, worst: Points, H: Complex) -> Array:
        """Estimate of `ratio` from a few frequencies, for responses (p, outputs, inputs, sets)."""
        limits = self.limits
        miss = H[: band.size] - self.total[band][..., None]
        square = miss.real**2 + miss.imag**2
        sums = np.tensordot(weight[:, None, None] * self.channel**2, square, axes=3)
        found = np.asarray(np.sqrt(sums) / limits.get("frf_error", _NO_LIMIT))
        if "channel_error" in limits and self.loud.any():
            size = np.asarray(np.trapezoid(abs(self.target.elastic[:, self.loud]) ** 2, self.target.omega, axis=0))
            own = np.tensordot(weight, square[:, self.loud], axes=1) / (self.size * size[:, None])
            found = np.maximum(found, np.sqrt(own.max(axis=0)) / limits["channel_error"])
        if worst.size:
            there, reference = H[band.size :][:, self.loud_db], self.full_db[worst][:, self.loud_db]
            found = np.maximum(found, self._percentile(there, reference[..., None]) / limits["db_error"])
        return found

    def _percentile(self, H: Complex, reference: Complex) -> Array:
        """Percentile of the decibel error of the worst channel (sets,), if errors elsewhere are smaller."""
        tiny = np.finfo(float).tiny
        power = np.maximum((H.real**2 + H.imag**2) / np.maximum(abs(reference) ** 2, tiny), tiny)
        power[np.broadcast_to(np.isnan(reference), power.shape)] = 1.0
        apart = np.maximum(power, 1 / power)
        # From the largest error down to the two between which the percentile of all frequencies lies.
        last = (self.points_db.size - 1) * (1 - PERCENTILE / 100)
        upper = min(int(last), len(H) - 1)
        lower = min(upper + 1, len(H) - 1)
        ranked = np.partition(apart, (len(H) - 1 - upper, len(H) - 1 - lower), axis=0)
        two = 10 * np.log10(ranked[[len(H) - 1 - upper, len(H) - 1 - lower]])
        return np.asarray((two[0] + (last - int(last)) * (two[1] - two[0])).max(axis=0, initial=0.0))


def _decibels(H: Complex, reference: Complex) -> Array:
    tiny = np.finfo(float).tiny
    apart = abs(20 * np.log10(np.maximum(abs(H), tiny) / np.maximum(abs(reference), tiny)))
    return np.where(np.isnan(reference), 0.0, apart)
