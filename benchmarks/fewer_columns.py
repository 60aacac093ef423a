"""Smaller models than the searches of `smallest_model.py` find: the limits that stand in their way.

    python benchmarks/fewer_columns.py --visible station         modes of the system whose loss alone breaks a limit
    python benchmarks/fewer_columns.py --balanced station 26 40  balanced models of as many columns, two states each
    python benchmarks/fewer_columns.py --shapes station 26 30    errors of so many scene shapes, at their best
    python benchmarks/fewer_columns.py --shapes station auto    the fewest that the search finds
    python benchmarks/fewer_columns.py --exchanges galileo       all sets with two modes exchanged for another one
    python benchmarks/fewer_columns.py --beam galileo 30         the best of so many modes by a beam search of the tests

Each takes half a minute of one core, but for scene shapes, which take some minutes a number.
"""

from __future__ import annotations

import sys
import tempfile
from itertools import combinations
from pathlib import Path

import numpy as np
import scipy.linalg as la
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from benchmarks.smallest_model import LIMITS, opened  # noqa: E402
from cmsreduce.assemble import elastic_states  # noqa: E402
from cmsreduce.balance import whole_groups  # noqa: E402
from cmsreduce.linalg.gramian import balancing, semidefinite_root  # noqa: E402
from cmsreduce.pipeline.system import system_errors  # noqa: E402
from cmsreduce.verify import db_error, db_errors, decibel_grid, frf_error  # noqa: E402
from tests.pipeline.greedy import Greedy  # noqa: E402

Real = NDArray[np.float64]
# Sets are measured if their error is predicted to be no larger than this many times the limit.
SLACK = 1.2
# Sets of each size in a beam search, and rounds of exchanges at its end.
WIDTH, ROUNDS = 16, 2


def visible(system: str) -> None:
    """Modes of the assembled system whose motion breaks a limit if it alone is left out of the response.

    The assembled system has as many elastic modes as the bodies have elastic shapes. A model within the limits needs a
    resonance for every one that shows: their number is what no basis falls far below, whatever its shapes.
    """
    with tempfile.TemporaryDirectory() as folder:
        run = opened(system, Path(folder))
        model, omega, (frf, decibel) = run.joined(run.ranked).assembled, decibel_grid(run.scene.band), LIMITS[system]
        for configuration in run.scene.configurations:
            target, at = run.comparison.reference.target(configuration, omega), model.system(configuration)
            w, Phi, _ = model.every_mode(configuration)
            damping = np.zeros(w.size) if at.D is None else np.einsum("ij,ij->j", Phi, at.D @ Phi)
            C = at.C1 @ Phi + 1j * omega[:, None, None] * (at.C2 @ Phi)
            moving = 1 / (w**2 - omega[:, None] ** 2 + 1j * omega[:, None] * damping) - 1 / w**2
            H, needed = target.elastic + target.rigid, 0
            for k, load in enumerate(Phi.T @ at.B):
                part = C[:, :, [k]] * moving[:, [k], None] * load
                worst = np.nanmax(db_errors(H, H - part, target.row, target.column)) / decibel
                error = frf_error(omega, target.elastic, target.elastic - part, target.row, target.column)
                needed += max(float(worst), error / frf) > 1
            inside = int(np.count_nonzero(w <= 2 * np.pi * run.scene.band[1]))
            print(f"{system}, {configuration.name}: {needed} modes break a limit alone; {inside} lie in the band")


def sized(system: str, sizes: list[str]) -> None:
    """Errors of stated numbers of scene shapes, optimised for both limits."""
    for size in sizes:
        with tempfile.TemporaryDirectory() as folder:
            run = opened(system, Path(folder), f"project={{responses: {size}, between: false}}")
            found = run.comparison.at(run.scene.configurations, {"reduced": run.model})
            errors = [each.errors["reduced"] for each in found]
            frf, decibel = max(e.frf_error for e in errors), max(e.db_error for e in errors)
        print(f"{system}, {size} scene shapes: worst frf_error {frf:.2%}, worst db_error {decibel:.2f} dB", flush=True)


def beam(system: str, count: int) -> None:
    """Smallest errors of so many modes, and of one more, by a beam search with algebra of its own, no midpoints."""
    with tempfile.TemporaryDirectory() as folder:
        greedy = Greedy(opened(system, Path(folder)), *LIMITS[system])
        for size, error in sorted(greedy.smallest_errors(count, WIDTH, ROUNDS).items()):
            print(f"{system}: the best set of {size} modes that a beam search finds has {error:.4f} of a limit")


def response(A: Real, B: Real, C: Real, omega: Real) -> NDArray[np.complex128]:
    """C (i w - A)^-1 B of a state space (f, outputs, inputs)."""
    roots, X = la.eig(A)
    weights = 1 / (1j * omega[:, None] - roots)
    return np.einsum("yk,fk,ku->fyu", C @ X, weights, la.solve(X, B + 0j))


def balanced(system: str, sizes: list[int]) -> None:
    """Decibel errors of balanced models of each configuration by itself: not optimised, but free of any structure."""
    with tempfile.TemporaryDirectory() as folder:
        run = opened(system, Path(folder))
        model, omega = run.joined(run.ranked).assembled, decibel_grid(run.scene.band)
        for configuration in run.scene.configurations:
            target = run.comparison.reference.target(configuration, omega)
            all_of_it = elastic_states(model.system(configuration))
            A, B, C = all_of_it.A, all_of_it.B, all_of_it.C
            driven, seen = B * target.column, (C * target.row[:, None]).T
            W, V = (la.solve_continuous_lyapunov(a, -f @ f.T) for a, f in ((A, driven), (A.T, seen)))
            found = balancing(*(semidefinite_root((gramian + gramian.T) / 2) for gramian in (W, V)))
            H, whole = model.response(configuration, omega), response(A, B, C, omega)
            for size in sizes:
                left, right = found.left[:, : 2 * size], found.right[:, : 2 * size]
                part = response(left.T @ A @ right, left.T @ B, C @ right, omega)
                error = db_error(H, H + part - whole, target.row, target.column)
                print(f"{system}, {configuration.name}: {2 * size} states: db_error {error:.2f} dB", flush=True)


def exchanges(system: str) -> None:
    """The smallest error of all sets with one mode less than the search keeps: two of its modes for another one."""
    with tempfile.TemporaryDirectory() as folder:
        run = opened(system, Path(folder), "balance={keep: limits}")
        kept = run.choice.selection
        limits, every = run.measure.limits, list(run.ranked)
        judge, _ = system_errors(run.measure, limits, run.ranked, every, run.joined, between=True)
        groups = [(name, columns) for name, part in run.ranked.items() for columns in whole_groups(part)]
        inside = [bool(np.isin(columns, kept[name]).all()) for name, columns in groups]
        out, into = (np.flatnonzero(np.array(inside) == each).tolist() for each in (True, False))
        sets = np.array([(*pair, k) for pair in combinations(out, 2) for k in into])
        judge.error(kept)
        near, best = sets, np.inf
        for each in judge.effects(kept, groups).configurations:
            near = near[each.predicted(near) <= SLACK]
        for exchanged in near:
            other = dict(kept)
            for k in exchanged:
                name, columns = groups[k]
                other[name] = np.setxor1d(other[name], columns)
            best = min(best, judge.error(other, best))
        modes = sum(columns.size for columns in kept.values())
        print(f"{system}: {modes} modes; two of them for another one: {len(sets)} sets, {len(near)} of them measured")
        print(f"{system}: the best of these has {best:.4f} of a limit")


if __name__ == "__main__":
    option, name, *more = sys.argv[1:]
    if option == "--visible":
        visible(name)
    elif option == "--balanced":
        balanced(name, [int(each) for each in more])
    elif option == "--exchanges":
        exchanges(name)
    elif option == "--beam":
        beam(name, int(more[0]))
    else:
        sized(name, more)
