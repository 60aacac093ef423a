"""Modal bodies of MBDyn (.fem): record groups of nodes, shapes, modal matrices and mass."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cmsreduce.mechanics import points_of_lumps
from cmsreduce.model import SecondOrder, Units, cross_matrix
from cmsreduce.read.files import reading
from cmsreduce.read.printed_numbers import number_of, rounding_of_printed
from cmsreduce.read.reduced.floating_body import FloatingBody
from cmsreduce.read.reduced.modal_body import ModalBody

__all__ = ["read_mbdyn"]

_GROUP = re.compile(r"\*\*\s*RECORD\s+GROUP\s+(\d+)", re.IGNORECASE)
_TITLES = {1: "header", 2: "nodes", 5: "x", 6: "y", 7: "z", 8: "mode shapes", 9: "modal mass", 10: "modal stiffness"}
_LUMPS, _RIGID, _DAMPING = 11, 12, 13
_INVARIANTS = (14, 15, 16, 17, 18)

Array = NDArray[np.float64]


def read_mbdyn(name: str, path: Path, units: Units) -> ModalBody:
    """Read a modal body of MBDyn.

    Parameters
    ----------
    name : str
        Name of the component.
    path : Path
        The file.
    units : Units
        Its unit system, which the file does not state.

    Returns
    -------
    ModalBody
        Coordinates: translation and rotation of the modal node, then the modes. Momentum and integrals of second order
        are those of the lumped masses of group 11, or else of the invariants of groups 14 to 18. A file without both
        has modes without momentum, as MBDyn takes them: modes about mean axes.

    Raises
    ------
    ReadError
        If the file is damaged or incomplete.
    """
    with reading(path, "the modal body of MBDyn"):
        words = _groups(path.read_text(encoding="latin-1"))
        lost = [f"{group} ({title})" for group, title in _TITLES.items() if group not in words]
        if lost:
            raise ValueError(f"record group {lost[0]} is missing")
        if not {_LUMPS, _RIGID} & words.keys():
            raise ValueError("it states no mass: neither record group 11 (lumped masses) nor 12 (rigid body)")
        node = np.array([int(word) for word in words[2]])
        n = node.size
        values = {group: np.array([number_of(word) for word in found]) for group, found in words.items() if group > 2}
        k = round(values[8].size / (6 * n)) if n else 0
        body = _body(node, k, _shaped(values, n, k))
        digits = rounding_of_printed([word for group in (8, 9, 10) for word in words[group]])
    return body.modal(name, path, units, rounding=digits, kind="MBDyn")


def _groups(text: str) -> dict[int, list[str]]:
    """Words of each record group, which its title opens; other lines with two stars are remarks."""
    found: dict[int, list[str]] = {}
    words: list[str] = []
    for line in text.splitlines():
        if title := _GROUP.match(line.strip()):
            words = found.setdefault(int(title[1]), [])
        elif not line.lstrip().startswith("**"):
            words += line.split()
    return found


def _shaped(values: Mapping[int, Array], n: int, k: int) -> dict[int, Array]:
    """Numbers of each group in its shape.

    Raises
    ------
    ValueError
        If a group has another number of them.
    """
    shapes: dict[int, tuple[int, ...]] = {
        **dict.fromkeys((5, 6, 7), (n,)),
        8: (k, n, 6),
        **dict.fromkeys((9, 10, _DAMPING), (k, k)),
        _LUMPS: (n, 6),
        _RIGID: (13,),
        **dict.fromkeys((14, 15), (3, k)),
        16: (3, k, 3),
        17: (3, k, k),
        18: (3, k, k, 3),
    }
    for group, shape in shapes.items():
        if group in values and values[group].size != np.prod(shape):
            raise ValueError(
                f"record group {group} has {values[group].size} numbers, where {int(np.prod(shape))} fit {n} nodes and "
                f"{k} modes"
            )
    return {group: values[group].reshape(shape) for group, shape in shapes.items() if group in values}


def _body(node: NDArray[np.int64], k: int, f: Mapping[int, Array]) -> FloatingBody:
    xyz, shapes = np.column_stack([f[5], f[6], f[7]]), np.moveaxis(f[8], 0, 2)
    body = FloatingBody(
        mass=0.0,
        first_moment=np.zeros(3),
        inertia=np.zeros((3, 3)),
        phi=np.zeros((3, k)),
        r_cross_phi=np.zeros((3, k)),
        M=f[9],
        K=f[10],
        D=f.get(_DAMPING, np.zeros((k, k))),
        node=node,
        xyz=xyz,
        translation=shapes[:, :3],
        rotation=shapes[:, 3:],
    )
    if _LUMPS in f:
        body = _of_lumps(body, f[_LUMPS])
    elif f.keys() >= set(_INVARIANTS):
        body = replace(body, phi=f[14], r_cross_phi=f[15], second_order=_of_invariants(f[16], f[18]))
    if _RIGID in f:
        mass, centre, about = f[_RIGID][0], f[_RIGID][1:4], f[_RIGID][4:].reshape(3, 3)
        arm = cross_matrix(centre)
        body = replace(body, mass=float(mass), first_moment=mass * centre, inertia=about - mass * arm @ arm)
    return body


def _of_lumps(body: FloatingBody, lumps: Array) -> FloatingBody:
    """The body with the mass and the integrals of lumps at its nodes, as MBDyn forms them."""
    points = points_of_lumps(lumps[:, 0], lumps[:, 3:], body.xyz, body.translation, body.rotation)
    whole = points.second_order(np.eye(6))
    # Of the six rigid motions and the modes: their momentum is in the rows of the rigid ones.
    M = np.einsum("iiab->ab", whole.phi_phi)
    return replace(
        body,
        mass=float(M[0, 0]),
        first_moment=-np.array([M[2, 4], M[0, 5], M[1, 3]]),
        inertia=M[3:6, 3:6],
        phi=M[:3, 6:],
        r_cross_phi=M[3:6, 6:],
        points=points,
    )


def _of_invariants(eight: Array, nine: Array) -> SecondOrder:
    """Integrals of second order of the invariants 8 (3, k, 3) and 9 (3, k, k, 3).

    Invariant 8 is - int S(r) S(phi) dm, and 9 is int S(phi) S(phi') dm, with S(a) S(b) = b a^T - (a . b) 1.
    """
    of_eight, of_nine = np.einsum("aja->j", eight) / 2, np.einsum("ajka->jk", nine) / -2
    r_phi = np.einsum("j,ab->abj", of_eight, np.eye(3)) - np.einsum("ajb->baj", eight)
    phi_phi = np.einsum("ajkb->bajk", nine) + np.einsum("jk,ab->abjk", of_nine, np.eye(3))
    return SecondOrder(r_phi, phi_phi)
