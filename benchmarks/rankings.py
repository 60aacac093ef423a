"""Rankings on the space station ISS-1R: error against order, with real modes and with balanced states.

Prints the tables of benchmarks/rankings.md; ``--write`` puts them there. `control.balred` needs slycot
(`pip install slycot`) and is left out without it. ISS-1R is iss.mat of the SLICOT collection of models, by default in
../shared/data/slicot; another place is given as an argument.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

from cmsreduce.balance import (
    CLOSE,
    RANKINGS,
    BandPass,
    Hankel,
    balanced,
    cluster_groups,
    component_costs,
    hankel_values,
    mode_spacing,
)
from cmsreduce.linalg.gramian import state_space
from cmsreduce.model import ModalChannels

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "benchmarks" / "rankings.md"
MARK = "<!-- tables of benchmarks/rankings.py -->"
STATION = ROOT.parent / "shared" / "data" / "slicot" / "iss.mat"

ALL, LOW = (0.1, 100.0), (0.1, 5.0)
"""Bands in rad/s: all modes lie in the first."""
ORDERS = (1, 2, 3, 5, 10, 15, 20, 30, 40, 60, 80)
ASKED = 0.01

Array = NDArray[np.float64]


def space_station(path: Path = STATION) -> ModalChannels:
    """ISS-1R as 135 modes with 3 inputs and 3 rate outputs."""
    from scipy.io import loadmat

    A, B, C = (np.asarray(M.todense() if hasattr(M, "todense") else M) for M in map(loadmat(path).get, "ABC"))
    n = A.shape[0] // 2
    omega = np.sqrt(-np.diag(A[n:, :n]))
    return ModalChannels("iss", omega, -np.diag(A[n:, n:]) / (2 * omega), B[n:], C[:0, :n], C[:, n:])


def modal_errors(ch: ModalChannels, order: NDArray[np.int64], band: tuple[float, float]) -> Array:
    """Relative response error over a band of the first 0, 1, .. modes of an order (e + 1,).

    The error is the response of the modes left out; its mean square over the band is their component cost, in closed
    form.
    """
    whole = component_costs(ch, band).sum()
    left = [component_costs(ch.only(order[k:]), band).sum() for k in range(order.size)]
    return np.sqrt(np.maximum([*left, 0.0], 0.0) / whole)


def grid(ch: ModalChannels, band: tuple[float, float]) -> tuple[Array, Array]:
    """Nodes and weights of Gauss's rule on panels that narrow at every resonance."""
    near = np.array([-30, -10, -5, -3, -2, -1, -0.5, 0, 0.5, 1, 2, 3, 5, 10, 30])
    ends = np.unique(
        np.concatenate([np.geomspace(*band, 200), (ch.omega[:, None] * (1 + ch.zeta[:, None] * near)).ravel()])
    )
    ends = ends[(ends >= band[0]) & (ends <= band[1])]
    x, weights = np.polynomial.legendre.leggauss(4)
    half = np.diff(ends)[:, None] / 2
    return (ends[:-1, None] + half * (1 + x)).ravel(), (half * weights).ravel()


def response(A: Array, B: Array, C: Array, w: Array) -> NDArray[np.complex128]:
    """Transfer function (f, outputs, inputs) of a small model through its poles."""
    poles, X = la.eig(A)
    left, right = C @ X, la.solve(X, B.astype(complex))
    return np.einsum("ok,fk,ki->foi", left, 1 / (1j * w[:, None] - poles), right, optimize=True)


def balanced_errors(ch: ModalChannels, orders: tuple[int, ...], band: tuple[float, float]) -> Mapping[str, list[float]]:
    """Relative errors of balanced models with two states for every mode of the orders: control's and our own."""
    import control

    A, B, C = state_space(ch)
    w, weights = grid(ch, band)
    full = response(A, B, C, w)
    size = np.sum(weights * np.sum(abs(full) ** 2, axis=(1, 2)))

    def error(a: Array, b: Array, c: Array) -> float:
        miss = abs(full - response(a, b, c, w)) ** 2
        return float(np.sqrt(np.sum(weights * np.sum(miss, axis=(1, 2))) / size))

    own = balanced(ch)
    found = {"balanced states": [error(*own.truncated(A, B, C, 2 * k)) for k in orders]}
    try:
        models = control.balred(control.ss(A, B, C, np.zeros((C.shape[0], B.shape[1]))), [2 * k for k in orders])
        found["control.balred"] = [error(m.A, m.B, m.C) for m in models]
    except ImportError:
        pass
    return found


def first_below(errors: Array) -> int:
    """Fewest modes, in this order, with no more than the error asked for."""
    return int(np.argmax(errors <= ASKED))


def tables(ch: ModalChannels) -> Iterator[str]:
    """Lines of the page's tables."""
    errors = {n: modal_errors(ch, np.argsort(-r.coefficients(ch), kind="stable"), ALL) for n, r in RANKINGS.items()}
    states = balanced_errors(ch, ORDERS, ALL)
    yield f"Relative response error, {ALL[0]:g} to {ALL[1]:g} rad/s, in per cent.\n"
    heads = [*errors, *states]
    yield f"| modes | {' | '.join(heads)} |"
    yield "|---" * (len(heads) + 1) + "|"
    for row, k in enumerate(ORDERS):
        figures = [errors[name][k] for name in errors] + [states[name][row] for name in states]
        yield f"| {k} | {' | '.join(f'{100 * figure:.3g}' for figure in figures)} |"
    least = [first_below(errors[name]) for name in errors]
    # Every order between, so that the first is exact.
    between = tuple(range(1, max(least) + 1))
    fine = balanced_errors(ch, between[: min(least) + 5], ALL)
    least += [between[first_below(np.array(fine[name]))] for name in states]
    yield f"| **for 1 %** | {' | '.join(f'**{k}**' for k in least)} |\n"

    yield (
        f"Modes needed for 1 % over {LOW[0]:g} to {LOW[1]:g} rad/s only, the modes ranked with and without a weighting "
        "of that band.\n"
    )
    yield "| ranking | unweighted | weighted |"
    yield "|---|---|---|"
    for name, ranking in RANKINGS.items():
        counts = [
            first_below(modal_errors(ch, np.argsort(-ranking.weighted(ch, weighting), kind="stable"), LOW))
            for weighting in (None, BandPass(*LOW))
        ]
        yield f"| {name} | {counts[0]} | {counts[1]} |"
    exact, own = hankel_values(ch), Hankel().coefficients(ch)
    gregory = np.repeat(np.sort(RANKINGS["gregory"].coefficients(ch))[::-1], 2)
    clusters = np.bincount(cluster_groups(ch))
    close = int((mode_spacing(ch.omega, ch.zeta) > CLOSE).sum())
    sizes = sorted(clusters[clusters > 1])
    yield (
        f"\n{ch.count} modes, {close} of them closer than ten half-power widths to the next; {len(sizes)} clusters of "
        f"{', '.join(map(str, sizes))} modes. Hankel values come in pairs; a ranking has one coefficient for both.\n"
    )
    yield "| | 1 | 3 | 5 | 9 | 17 | 33 |"
    yield "|---|---|---|---|---|---|---|"
    at = np.array([0, 2, 4, 8, 16, 32])
    largest = np.repeat(np.sort(own)[::-1], 2)
    for label, values in (
        ("exact Hankel value", exact),
        ("ranking hankel, sorted", largest),
        ("gregory, sorted", gregory),
    ):
        yield f"| {label} | {' | '.join(f'{value:.4g}' for value in values[at])} |"


if __name__ == "__main__":
    given = [argument for argument in sys.argv[1:] if argument != "--write"]
    lines = "\n".join(tables(space_station(Path(given[0]) if given else STATION)))
    if "--write" in sys.argv[1:]:
        before, _, _ = PAGE.read_text(encoding="utf-8").partition(MARK)
        PAGE.write_text(f"{before}{MARK}\n\n{lines}\n", encoding="utf-8")
    else:
        print(lines)
