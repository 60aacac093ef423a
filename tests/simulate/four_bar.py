"""A four-bar linkage: crank 0.3, coupler 0.9, rocker 0.7, ground 1 m; the crank at 60 degrees as built."""

from __future__ import annotations

import numpy as np

from cmsreduce.model import FEModel
from tests.frames import BAR, Section, line

__all__ = ["bars", "circles", "inertia"]

CRANK, COUPLER, ROCKER, GROUND = 0.3, 0.9, 0.7, 1.0
THIN = Section(Iy=1e-9, Iz=1e-9)


def circles(angle: float) -> tuple[np.ndarray, np.ndarray]:
    """Where crank and coupler, and coupler and rocker, meet in the plane."""
    b, d = CRANK * np.array([np.cos(angle), np.sin(angle)]), np.array([GROUND, 0.0])
    way = d - b
    far = np.linalg.norm(way)
    along = (COUPLER**2 - ROCKER**2 + far**2) / (2 * far)
    return b, b + (along * way + np.sqrt(COUPLER**2 - along**2) * np.array([-way[1], way[0]])) / far


def bars() -> list[FEModel]:
    """Ground, crank, coupler and rocker; the coupler is thin."""
    b, c = (np.r_[point, 0.0] for point in circles(np.pi / 3))
    a, d = np.zeros(3), np.array([GROUND, 0.0, 0.0])
    return [
        line("ground", a, d, 4, interfaces={"a": 1, "d": 5}),
        line("crank", a, b, 4, interfaces={"a": 1, "b": 5}),
        line("coupler", b, c, 4, interfaces={"b": 1, "c": 5}, section=THIN),
        line("rocker", c, d, 4, interfaces={"c": 1, "d": 5}),
    ]


def inertia(angle: float) -> float:
    """Of the whole linkage about the crank's turn: twice the energy at unit rate."""
    b, c = circles(angle)
    d = np.array([GROUND, 0.0])

    def turned(v: np.ndarray) -> np.ndarray:
        return np.array([-v[1], v[0]])

    # v_c = v_b + w3 x (c - b) = w4 x (c - d).
    _, w4 = np.linalg.solve(np.column_stack([turned(c - b), -turned(c - d)]), -turned(b))
    at_b, at_c = turned(b), w4 * turned(c - d)
    per_length = BAR.rho * BAR.A
    coupler = (at_b @ at_b + at_b @ at_c + at_c @ at_c) / 3 * COUPLER
    return per_length * (CRANK**3 / 3 + coupler + w4**2 * ROCKER**3 / 3)
