"""Sections and element matrices: Euler-Bernoulli beam, rod and concentrated mass, in the basic frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["Array", "Material", "Section", "bar", "box", "point_mass", "rod", "round_to", "tube"]

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Material:
    """An isotropic material (MAT1).

    Parameters
    ----------
    E, G : float
        Young's and shear modulus, Pa.
    rho : float
        Density, kg/m^3.
    """

    E: float
    G: float
    rho: float


@dataclass(frozen=True)
class Section:
    """A beam's cross-section (PBAR).

    Parameters
    ----------
    A : float
        Area, m^2.
    I1, I2 : float
        Second moments of area for bending in plane 1 (which holds the orientation vector) and in plane 2, m^4.
    J : float
        Torsion constant, m^4.
    material : str
        Name of its material.
    """

    A: float
    I1: float
    I2: float
    J: float
    material: str


def round_to(x: float, digits: int = 4) -> float:
    """Round to significant digits, so that a bulk data field holds the number exactly."""
    return float(f"{x:.{digits - 1}e}")


def tube(radius: float, wall: float, material: str) -> Section:
    """Thin round tube of mean radius and wall thickness in m."""
    inertia = np.pi * radius**3 * wall
    return _section(2 * np.pi * radius * wall, inertia, inertia, 2 * inertia, material)


def box(width: float, depth: float, wall: float, material: str) -> Section:
    """Thin rectangular tube, m; its depth lies along the orientation vector."""
    return _section(
        2 * wall * (width + depth),
        wall * depth**2 * (width / 2 + depth / 6),
        wall * width**2 * (depth / 2 + width / 6),
        2 * wall * (width * depth) ** 2 / (width + depth),
        material,
    )


def _section(A: float, I1: float, I2: float, J: float, material: str) -> Section:
    return Section(round_to(A), round_to(I1), round_to(I2), round_to(J), material)


def bar(a: Array, b: Array, v: Array, section: Section, material: Material) -> tuple[Array, Array]:
    """Stiffness and consistent mass of a beam without shear deformation.

    As NASTRAN's CBAR with COUPMASS: no rotary inertia and no torsional inertia of the section.

    Parameters
    ----------
    a, b : (3,) float64
        Ends.
    v : (3,) float64
        Orientation vector: plane 1 holds it and the beam's axis.
    section, material : Section, Material
        Properties.

    Returns
    -------
    K, M : (12, 12) float64
        Rows x y z rx ry rz of end a, then of end b, along the basic axes.
    """
    L = float(np.linalg.norm(b - a))
    x = (b - a) / L
    z = np.cross(x, v)
    z /= np.linalg.norm(z)
    T = np.kron(np.eye(4), np.array([x, np.cross(z, x), z]))
    K, M = np.zeros((12, 12)), np.zeros((12, 12))
    line = np.array([[1.0, -1.0], [-1.0, 1.0]])
    K[np.ix_([0, 6], [0, 6])] = material.E * section.A / L * line
    K[np.ix_([3, 9], [3, 9])] = material.G * section.J / L * line
    mass = material.rho * section.A * L
    M[np.ix_([0, 6], [0, 6])] = mass / 6 * np.array([[2.0, 1.0], [1.0, 2.0]])
    k = np.array(
        [
            [12.0, 6 * L, -12.0, 6 * L],
            [6 * L, 4 * L**2, -6 * L, 2 * L**2],
            [-12.0, -6 * L, 12.0, -6 * L],
            [6 * L, 2 * L**2, -6 * L, 4 * L**2],
        ]
    )
    m = np.array(
        [
            [156.0, 22 * L, 54.0, -13 * L],
            [22 * L, 4 * L**2, 13 * L, -3 * L**2],
            [54.0, 13 * L, 156.0, -22 * L],
            [-13 * L, -3 * L**2, -22 * L, 4 * L**2],
        ]
    )
    for rows, sign, inertia in (([1, 5, 7, 11], 1.0, section.I1), ([2, 4, 8, 10], -1.0, section.I2)):
        turn = np.outer([1.0, sign, 1.0, sign], [1.0, sign, 1.0, sign])
        K[np.ix_(rows, rows)] = material.E * inertia / L**3 * k * turn
        M[np.ix_(rows, rows)] = mass / 420 * m * turn
    return T.T @ K @ T, T.T @ M @ T


def rod(a: Array, b: Array, section: Section, material: Material) -> tuple[Array, Array]:
    """Stiffness and consistent mass of a rod that carries tension only (CROD); arguments and rows as in `bar`."""
    L = float(np.linalg.norm(b - a))
    x = (b - a) / L
    K, M = np.zeros((12, 12)), np.zeros((12, 12))
    at = np.ix_([0, 1, 2, 6, 7, 8], [0, 1, 2, 6, 7, 8])
    K[at] = np.kron([[1.0, -1.0], [-1.0, 1.0]], material.E * section.A / L * np.outer(x, x))
    M[at] = np.kron([[2.0, 1.0], [1.0, 2.0]], material.rho * section.A * L / 6 * np.eye(3))
    return K, M


def point_mass(mass: float, inertia: tuple[float, float, float]) -> Array:
    """Mass matrix (6, 6) of a concentrated mass, kg, with inertias along the basic axes, kg m^2 (CONM2)."""
    return np.diag([mass, mass, mass, *inertia])
