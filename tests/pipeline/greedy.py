"""A greedy choice of modes by algebra of its own: dense receptances, errors by the formulas of the guide, no search.

Bodies, joints and the response of the unreduced system are those of a run; everything after them is written here again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cmsreduce.linalg.blocks import dense
from cmsreduce.model import Configuration
from cmsreduce.pipeline import Run

# A set that breaks the limits by prediction at one frequency in four is not measured.
THINNED, SLACK = 4, 1.1
# Of each step so many sets are measured at all frequencies, the best predicted first.
MEASURED = 3


@dataclass(frozen=True, eq=False)
class Sampled:
    """One configuration at some frequencies: flexibilities over joint rows, then inputs or outputs.

    Parameters
    ----------
    Y : (f, c + outputs, c + inputs) complex128
        Of everything that is always kept.
    left, right : (c + outputs, n), (c + inputs, n) complex128 or float64
        Candidates at the rows; the outputs are per unit of motion.
    Z : (f, n) complex128
        Dynamic stiffness of each candidate.
    H : (f, outputs, inputs) complex128
        Response of the unreduced system.
    weight : (f, outputs, inputs) float64
        Of squared errors in the squared response error; zero on the grid of decibels.
    c : int
        Rows of joints.
    """

    Y: np.ndarray
    left: np.ndarray
    right: np.ndarray
    Z: np.ndarray
    H: np.ndarray
    weight: np.ndarray
    loud: np.ndarray
    c: int

    def thinned(self, *, bode: int = THINNED) -> Sampled:
        """One in so many frequencies, and of those of the decibels one in ``bode``."""
        silent = self.weight.sum(axis=(1, 2)) == 0
        some = np.concatenate([np.flatnonzero(~silent)[::THINNED], np.flatnonzero(silent)[::bode]])
        parts = self.Y[some], self.left, self.right, self.Z[some], self.H[some], THINNED * self.weight[some]
        return Sampled(*parts, self.loud, self.c)

    def joined(self, kept: np.ndarray) -> tuple[np.ndarray, ...]:
        """Response with some candidates, and what an update of it needs: C - O S A, S, B parts."""
        Y = self.Y + (self.left[:, kept] / self.Z[:, None, kept]) @ self.right[:, kept].T
        c = self.c
        S = np.linalg.inv(Y[:, :c, :c])
        across = Y[:, c:, :c] @ S
        return Y[:, c:, c:] - across @ Y[:, :c, c:], S, across, Y[:, :c, c:]

    def changed(self, kept: np.ndarray, others: np.ndarray) -> np.ndarray:
        """Responses after one candidate more or less (f, outputs, inputs, k), after Sherman and Morrison."""
        H, S, across, inward = self.joined(kept)
        c, sign = self.c, np.where(np.isin(others, kept), -1.0, 1.0)
        joint = S @ self.left[:c, others]
        seen = self.left[c:, others] - across @ self.left[:c, others]
        driven = self.right[c:, others] - inward.transpose(0, 2, 1) @ joint
        pivot = sign * self.Z[:, others] + np.sum(self.left[:c, others] * joint, axis=1)
        return np.asarray(H[..., None] + seen[:, :, None] * driven[:, None] / pivot[:, None, None])

    def ratio(self, H: np.ndarray, frf: float, decibel: float, pooled: bool) -> np.ndarray:
        """Errors over their limits, the largest, of responses (f, outputs, inputs, k)."""
        miss = np.sqrt(np.einsum("fyu,fyuk->k", self.weight, abs(H - self.H[..., None]) ** 2)) / frf
        bode = self.weight.sum(axis=(1, 2)) == 0
        # Without any mode a channel may be silent.
        full, own = (np.maximum(abs(X[bode][:, self.loud]), np.finfo(float).tiny) for X in (self.H, H))
        apart = abs(20 * np.log10(own / full[..., None]))
        apart = apart.reshape(-1, 1, apart.shape[-1]) if pooled else apart
        return np.maximum(miss, np.percentile(apart, 99, axis=0).max(axis=0) / decibel)


class Greedy:
    """Choices of modes of a run under limits on the response and on the decibels.

    Parameters
    ----------
    run : Run
        Without gyroscopic forces, parameters and damping that couples modes.
    frf_error, db_error : float
    pooled : bool
        One percentile over all channels instead of that of the worst channel.
    """

    def __init__(self, run: Run, frf_error: float, db_error: float, *, pooled: bool = False) -> None:
        self.limits = frf_error, db_error, pooled
        self.modes = [(name, k) for name, part in run.ranked.items() for k in range(*part.elastic.indices(10**9))]
        self.full = [self._sampled(run, configuration) for configuration in run.scene.configurations]
        self.few = [each.thinned() for each in self.full]

    def _sampled(self, run: Run, configuration: Configuration) -> Sampled:
        model = run.joined(run.ranked)
        low, high = run.scene.band
        bode = 2 * np.pi * np.geomspace(low or high / 1000, high, 1000)
        band = run.comparison.grid(configuration, [model])
        omega = np.concatenate([band, bode])
        stack, wiring = model.assembled.stack, model.assembled.wiring(configuration)
        c, outputs, inputs = wiring.A.shape[0], wiring.C1.shape[0], wiring.B.shape[0]
        Y = np.zeros((omega.size, c + outputs, c + inputs), dtype=complex)
        left, right, stiffness = [], [], []
        for name, sub in model.assembled.substructures.items():
            motion, here = dense(stack.motions(name)), stack.body_columns(name)
            rows = np.vstack([wiring.A[:, here], (wiring.C1 + wiring.C2)[:, here]]) @ motion
            columns = np.vstack([wiring.A[:, here], wiring.B[:, here]]) @ motion
            M, K, D = (np.zeros((sub.m, sub.m)) if part is None else dense(part) for part in (sub.M, sub.K, sub.D))
            assert not np.count_nonzero(D - np.diag(D.diagonal())) and sub.loss is None
            chosen = np.array([k for body, k in self.modes if body == name], dtype=int)
            rest = np.setdiff1d(np.arange(sub.m), chosen)
            w, at = omega[:, None, None], np.ix_(rest, rest)
            Y += rows[:, rest] @ np.linalg.solve(K[at] - w**2 * M[at] + 1j * w * D[at], columns[:, rest].T + 0j)
            m, k, d = (part.diagonal()[chosen] for part in (M, K, D))
            stiffness.append(k - omega[:, None] ** 2 * m + 1j * omega[:, None] * d)
            left.append(rows[:, chosen])
            right.append(columns[:, chosen])
        # Responses are per motion: those of rates are divided by i w.
        rate = wiring.C2.any(axis=1)
        assert not (rate & wiring.C1.any(axis=1)).any()
        unit = np.where(rate[:, None], 1j * omega[:, None, None], 1.0)
        target = run.comparison.reference.target(configuration, band)
        on_bode = run.comparison.reference.target(configuration, bode)
        H = np.concatenate([target.elastic + target.rigid, on_bode.elastic + on_bode.rigid])
        scale, step = target.row[:, None] * target.column, np.diff(band)
        trapezoid = ((np.r_[0, step] + np.r_[step, 0]) / 2)[:, None, None]
        weight = np.zeros(H.shape)
        weight[: band.size] = trapezoid * abs(unit[: band.size]) ** 2 * scale**2
        weight /= np.sum(trapezoid * abs(target.elastic * scale) ** 2)
        loud = np.sqrt(np.mean(abs(H[band.size :]) ** 2, axis=0)) * scale
        parts = np.hstack(left), np.hstack(right), np.hstack(stiffness), H / unit, weight
        return Sampled(Y, *parts, loud > 1e-6 * loud.max(), c)

    def error(self, kept: Sequence[int]) -> float:
        """Largest error over its limit, at all frequencies."""
        some = np.array(kept, dtype=int)
        return float(max(each.ratio(each.joined(some)[0][..., None], *self.limits)[0] for each in self.full))

    def predicted(self, kept: Sequence[int], others: Sequence[int]) -> np.ndarray:
        """Largest error over its limit after each change, at one frequency in four."""
        some, changes = np.array(kept, dtype=int), np.array(others, dtype=int)
        return np.max([each.ratio(each.changed(some, changes), *self.limits) for each in self.few], axis=0)

    def pruned(self, kept: Sequence[int]) -> list[int]:
        """Leave out the mode that is missed least, as long as the limits are met."""
        now = list(kept)
        while now:
            ratio = self.predicted(now, now)
            order = [k for k in np.argsort(ratio)[:MEASURED] if ratio[k] <= SLACK]
            fewer = ([*now[:k], *now[k + 1 :]] for k in order)
            found = next((each for each in fewer if self.error(each) <= 1), None)
            if found is None:
                break
            now = found
        return now

    def grown(self, most: int) -> list[int] | None:
        """Add the mode that helps most, until the limits are met; None beyond a number of modes."""
        now: list[int] = []
        while len(now) <= most:
            if self.error(now) <= 1:
                return self.pruned(now)
            others = [k for k in range(len(self.modes)) if k not in now]
            now.append(others[int(np.argmin(self.predicted(now, others)))])
        return None

    def smallest_errors(self, count: int, width: int, rounds: int) -> dict[int, float]:
        """Smallest errors of the sets of so many modes, and of one more, that a beam search finds.

        So many sets are kept of each size, on the way down from all modes, and then in rounds of one mode less and one
        more: every set of the beam is exchanged with every mode that it lacks.
        """
        self.few = [each.thinned(bode=1) for each in self.full]
        every, beam, smallest = range(len(self.modes)), [frozenset(range(len(self.modes)))], dict[int, float]()
        for size in [*range(len(self.modes) - 1, count - 1, -1), *(count - 1, count) * rounds]:
            found: dict[frozenset[int], float] = {}
            for each in beam:
                others = [k for k in every if (k in each) is (size < len(each))]
                for k, ratio in zip(others, self.predicted(sorted(each), others), strict=True):
                    found[each ^ {k}] = float(ratio)
            # Wide where sets begin to fail.
            beam = sorted(found, key=lambda each: found[each])[: width if size <= count + width // 2 else 1]
            if count <= size <= count + 1:
                best = min(self.error(sorted(each)) for each in beam[:MEASURED])
                smallest[size] = min(best, smallest.get(size, np.inf))
        return smallest

    def fewest(self) -> int:
        """Modes of the smaller of both sets."""
        pruned = self.pruned(range(len(self.modes)))
        grown = self.grown(len(pruned) - 1)
        return len(pruned if grown is None else grown)
