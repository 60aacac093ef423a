"""Numbers that arithmetic is bad at: contrasts, units, few digits, a stiffness that round-off made indefinite."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from cmsreduce.model import FEModel, Units, in_units
from tests.frames import Section
from tests.hard.case import Case
from tests.hard.structures import bars, rigid_motions, rows, springs, twin

__all__ = [
    "far_from_the_origin",
    "in_inches",
    "in_metres",
    "in_millimetres",
    "indefinite",
    "penalty_springs",
    "single_precision",
    "soft_beside_stiff",
    "ten_digits",
]

TRUSS = [
    [0, 0, 0],
    [1, 0, 0],
    [2, 0, 0],
    [3, 0, 0],
    [0.2, 1, 0],
    [1.1, 0.9, 0.2],
    [2, 1.1, 0],
    [0.9, 0.4, 1],
    [2.1, 0.5, 1],
]
PAIRS = [(1, 2), (2, 3), (3, 4), (5, 6), (6, 7), (1, 5), (2, 6), (3, 7), (2, 8), (3, 9), (6, 8), (7, 9), (8, 9)]
BAND = (1.0, 60.0)


def _panel() -> tuple[FEModel, NDArray[np.int64], NDArray[np.float64]]:
    body = bars("panel", TRUSS, PAIRS)
    return body, rows(body, (1, 5)), rigid_motions(body)


def _panel_case(
    name: str, hard: str, treated: str, spoil: Callable[[FEModel], FEModel], completeness: float = 1e-10
) -> Case:
    body, face, rigid = _panel()
    return Case(
        name,
        hard,
        treated,
        spoil(body),
        face,
        BAND,
        rigid,
        sensors=rows(body, (4, 9), (1, 2, 3)),
        neighbour=twin(body, face, rigid),
        truth=body,
        completeness=completeness,
    )


def penalty_springs() -> Case:
    """Two bars held together by springs 1e12 times as stiff."""
    xyz = np.linspace([0, 0, 0], [2, 0.3, 0], 11)
    xyz = np.vstack([xyz[:6], xyz[5:]])
    section = Section()
    body = bars("joined", xyz, [(k, k + 1) for k in (1, 2, 3, 4, 5, 7, 8, 9, 10, 11)], section)
    a, b = rows(body, 6), rows(body, 7)
    E = np.zeros((body.n, 6))
    E[a, np.arange(6)], E[b, np.arange(6)] = 1.0, -1.0

    softest = float(body.K.diagonal().min())

    def joined(contrast: float) -> FEModel:
        # A rotation is held over an arm of a centimetre.
        spring = contrast * softest * np.array([1.0, 1.0, 1.0, 1e-4, 1e-4, 1e-4])
        return replace(body, K=sp.csc_array(body.K + sp.csc_array((E * spring) @ E.T)))

    # At 1e9 the joint is as tight, and every number is good.
    stiff, exact = joined(1e12), joined(1e9)
    face, rigid = rows(body, (1, 12)), rigid_motions(body)
    return Case(
        "stiffness contrast 1e12",
        "Six penalty springs join two coincident nodes, 1e12 times as stiff as the bars in torsion.",
        "A pivot is compared with its own diagonal entry, a shape by its energy. No tolerance is relative to the "
        "largest entry of K alone.",
        stiff,
        face,
        (2.0, 120.0),
        rigid,
        sensors=rows(body, 9, (1, 2, 3)),
        neighbour=twin(exact, face, rigid),
        truth=exact,
        # An entry of the joint, 3e15 N/m, is known to 0.4 N/m; the bending it carries has 2e3 N/m. The energy
        # of a dozen such roundings:
        completeness=1e-5,
    )


def _in(units: str) -> Case:
    body, face, rigid = _panel()
    stated = in_units(body, Units.parse(units))
    # Translations in the new unit of length, rotations as they were.
    length = np.where(body.dofs.component <= 3, body.units.length / stated.units.length, 1.0)[:, None]
    return Case(
        units,
        f"The panel in {units}: entries of K and M, translations and rotations differ by other powers of ten.",
        "All matrices are scaled to a unit diagonal before they are compared; the three unit systems give one answer.",
        stated,
        face,
        BAND,
        rigid * length,
        sensors=rows(body, (4, 9), (1, 2, 3)),
        neighbour=twin(stated, face, rigid * length),
    )


def in_metres() -> Case:
    """SI."""
    return _in("m-kg-s")


def in_millimetres() -> Case:
    """Millimetres and tonnes."""
    return _in("mm-t-s")


def in_inches() -> Case:
    """Inches and slinches."""
    return _in("in-slinch-s")


def single_precision() -> Case:
    """Entries rounded to 24 bits."""

    def spoil(body: FEModel) -> FEModel:
        K, M = (sp.csc_array(A.astype(np.float32).astype(np.float64)) for A in (body.K, body.M))
        return replace(body, K=K, M=M, rounding=6e-8)

    return _panel_case(
        "single precision",
        "Entries rounded to 24 bits: K on a rigid motion is 1e-7 of |K|, which would be 0.1 Hz, in part imaginary.",
        "Rigid modes come from the geometry. A projection removes the rounding that K has on them.",
        spoil,
        # Roundings of 6e-8 in bars 1e4 times as stiff along as across, as energy:
        completeness=1e-6,
    )


def ten_digits() -> Case:
    """Entries printed with ten digits and read back."""

    def printed(A: sp.csc_array) -> sp.csc_array:
        return sp.csc_array((np.array([float(f"{x:.9E}") for x in A.data]), A.indices, A.indptr), shape=A.shape)

    def spoil(body: FEModel) -> FEModel:
        return replace(body, K=printed(body.K), M=printed(body.M), rounding=5e-11)

    return _panel_case(
        "ten-digit punch",
        "Entries printed with ten digits, as in DMIG punch files.",
        "Tolerances depend on the number of digits in the file.",
        spoil,
    )


def indefinite() -> Case:
    """K with noise of 1e-10, so that rigid motion has negative stiffness."""

    def spoil(body: FEModel) -> FEModel:
        noise = np.random.default_rng(3).uniform(-1, 1, body.K.nnz)
        noisy = sp.csc_array((body.K.data * (1 + 1e-10 * noise), body.K.indices, body.K.indptr), shape=body.K.shape)
        K = sp.csc_array((noisy + noisy.T) / 2)
        R = rigid_motions(body)
        # Pushed below zero on all rigid motion, by as much as the noise could.
        push = 1e-10 * float(body.K.diagonal().mean()) * sp.csc_array(R @ R.T)
        return replace(body, K=sp.csc_array(K - push), rounding=1e-10)

    return _panel_case(
        "slightly indefinite",
        "Round-off gave K six negative eigenvalues, which would be six imaginary frequencies.",
        "Rigid modes have stiffness zero by name; the elastic part is solved on their complement.",
        spoil,
    )


def far_from_the_origin() -> Case:
    """A million metres away."""

    def spoil(body: FEModel) -> FEModel:
        assert body.nodes is not None
        return replace(body, nodes=replace(body.nodes, xyz=body.nodes.xyz + np.array([1e6, -2e6, 5e5])))

    return _panel_case(
        "far from the origin",
        "Coordinates of 1e6 on a body of size 3: rigid rotations about the origin are nearly translations.",
        "Rigid shapes are taken about the centroid.",
        spoil,
    )


def soft_beside_stiff() -> Case:
    """Two stiff chains on a spring of 1e-4 Hz."""
    # Powers of two, so that the matrices hold the soft spring exactly.
    count, stiff, soft = 12, 2.0**23, 2.0**-19
    pairs = [(i, i + 1, stiff) for i in range(1, count)] + [(i, i + 1, stiff) for i in range(count + 1, 2 * count)]
    body = springs("tethered", [*pairs, (count, count + 1, soft)], np.ones(2 * count))
    face, rigid = np.array([0, 2 * count - 1]), np.ones((2 * count, 1))
    return Case(
        "1e-4 Hz beside 1e3 Hz",
        "Two stiff chains on a tether: an elastic mode seven decades below the next, fourteen in K.",
        "The pencil is inverted, so soft modes keep their digits. A rigid motion is recognised by its energy, not "
        "by its frequency.",
        body,
        face,
        (10.0, 300.0),
        rigid,
        sensors=np.array([11, 12]),
        neighbour=twin(body, face, rigid),
    )
