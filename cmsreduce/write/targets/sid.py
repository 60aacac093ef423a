"""SID: standard input data of flexible bodies (Wallrapp), as FEMBS writes them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cmsreduce.model import ModalIntegrals, cross_matrix
from cmsreduce.write.component import (
    ComponentFile,
    FlexibleBody,
    FrameStiffening,
    flexible_body,
    frame_stiffening,
    require_mass,
)
from cmsreduce.write.files import put_lines

__all__ = ["SidDialect", "write_sid"]

SidDialect = Literal["by-axis", "by-mode", "gr-by-mode", "embs"]
"""Column of Gr and Ge for axis a and mode l, from 0: a nq + l as FEMBS writes them, or 3 l + a, a block a mode; or Gr
by mode and Ge by axis. ``embs``: by mode, in words and digits that EMBS_ModelicaLib and PyMBS understand."""

_FIVE_DIGITS = 99999
"""Largest node id that the reader of EMBS_ModelicaLib has room for."""

_SYMMETRIC, _FULL, _ZERO = 2, 3, 0
_SECOND_MOMENTS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
"""Rows of J: xx yy zz xy xz yz."""
_SQUARES = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))
"""Columns of Oe: products of angular velocities; the last two are swapped compared with J."""

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Taylor:
    """A term m0 (rows, columns), and m1 (rows, modes, columns) if it depends on the modal coordinates."""

    name: str
    m0: Array
    m1: Array | None = None
    symmetric: bool = False


def write_sid(path: Path, component: ComponentFile, integrals: ModalIntegrals, dialect: SidDialect = "by-axis") -> None:
    """Write the body as an SID file.

    Parameters
    ----------
    path : Path
        Name of the file, which is complete or absent.
    component : ComponentFile
        The body.
    integrals : ModalIntegrals
        Integrals over its modes, about the frame of reference.
    dialect : SidDialect
        Order of the columns of Gr and Ge, and words for one reader.

    Raises
    ------
    WriteError
        If the component file lacks data, a mode has no mass, or the file cannot be written.
    """
    body = flexible_body(component, integrals, slow=True)
    require_mass(body, "a code that reads SID inverts Me")
    put_lines(path, _lines(body, frame_stiffening(component, integrals), dialect))


def _lines(body: FlexibleBody, stiffening: FrameStiffening | None, dialect: SidDialect) -> Iterator[str]:
    # The reader of EMBS_ModelicaLib takes keywords from the name, of a symmetric matrix what it finds, and ids of at
    # most five digits; it has room for seventeen digits of a number.
    embs = dialect == "embs"
    digits = 16 if embs else 11
    ids = np.arange(1, body.node.size + 1) if embs and body.node.max(initial=0) > _FIVE_DIGITS else body.node
    about = f"{body.name}, columns of Gr {dialect}, units {body.units.name}"
    yield f"    {body.node.size}   {body.k}    :No. nodes, No. modes: {about}"
    yield " part"
    yield _value(6, "new modal", "body" if embs else body.name)
    yield f"{'':11}refmod"
    yield _value(16, "mass", _number(body.integrals.mass, digits))
    yield _value(16, "nelastq", f"{body.k:4d}")
    for number, omega in enumerate(body.omega, 1):
        yield _value(16, f"ielastq ({number:4d})", f" Eigen Mode {number:4d} : {omega / (2 * np.pi):12.6g} Hz")
    yield f"{'':11}end refmod"
    yield f"{'':11}frame"
    for index, node in enumerate(ids):
        yield _value(16, "new node", f"{node:9d}")
        yield _value(21, "rframe", " body ref")
        for part in _node(body, index, stiffening):
            yield from _taylor(part, body.k, 21, digits)
        yield f"{'':16}end node"
    yield f"{'':11}end frame"
    for part in _body(body, stiffening, dialect):
        yield from _taylor(replace(part, symmetric=part.symmetric and not embs), body.k, 11, digits)
    yield f"{'':6}end modal"
    yield " end part"


def _node(body: FlexibleBody, index: int, stiffening: FrameStiffening | None) -> Sequence[_Taylor]:
    phi, psi = body.translation[index], body.rotation[index]
    # A node rotates with the slope of each mode: AP = 1 + S(psi q).
    turned = np.moveaxis(cross_matrix(psi.T), 0, 1)
    # Geometric stiffness of a load at the node, with the sign of its generalised force: entry [axis, mode, mode].
    node = int(body.node[index])
    force, moment = (None, None) if stiffening is None else (stiffening.force.get(node), stiffening.moment.get(node))
    return (
        _Taylor("origin", body.position[index][:, None], phi[:, :, None]),
        _Taylor("phi", phi, None if force is None else -force),
        _Taylor("psi", psi, None if moment is None else -moment),
        _Taylor("AP", np.eye(3), turned),
    )


def _body(body: FlexibleBody, stiffening: FrameStiffening | None, dialect: SidDialect) -> Sequence[_Taylor]:
    integrals = body.integrals
    inertia, growth, second = _centrifugal(integrals)
    # Entry [k, l, axis] of phi_l x phi_k.
    turning = np.moveaxis(body.phi_cross_phi, (0, 1, 2), (2, 1, 0))
    pull, drag, spin = _stressed(stiffening, body.k)
    return (
        _Taylor("mdCM", integrals.first_moment[:, None], integrals.phi[:, :, None]),
        _Taylor("J", inertia, growth[:, :, None]),
        _Taylor("Ct", integrals.phi.T, pull),
        _Taylor("Cr", integrals.r_cross_phi.T, turning + drag),
        _Taylor("Me", body.mass, symmetric=True),
        _Taylor("Gr", _columns("Gr", _gyroscopic(integrals), dialect)),
        _Taylor("Ge", _columns("Ge", 2 * np.moveaxis(turning, 1, 2), dialect)),
        _Taylor("Oe", _products(-0.5 * growth.T), second + spin),
        _Taylor("ksigma", np.zeros((body.k, 1))),
        _Taylor("Ke", body.stiffness, symmetric=True),
        _Taylor("De", body.damping, symmetric=True),
    )


def _stressed(stiffening: FrameStiffening | None, k: int) -> tuple[Array, Array, Array]:
    """Geometric stiffness [row, mode, column] per acceleration, angular acceleration and product of velocities."""
    if stiffening is None:
        return np.zeros((k, k, 3)), np.zeros((k, k, 3)), np.zeros((k, k, len(_SQUARES)))
    parts = (stiffening.acceleration, stiffening.turning, stiffening.spinning)
    pull, drag, spin = (np.moveaxis(part, 0, -1) for part in parts)
    return pull, drag, spin


def _centrifugal(integrals: ModalIntegrals) -> tuple[Array, Array, Array]:
    """J (6, 1), its derivatives (6, k), and Oe's derivatives (k, k, 6)."""
    derivative = (
        2 * np.einsum("iil,ab->abl", integrals.r_phi, np.eye(3)) - integrals.r_phi - np.swapaxes(integrals.r_phi, 0, 1)
    )
    P = integrals.phi_phi
    pull = P - np.einsum("iikl,ab->abkl", P, np.eye(3))
    pull = 0.5 * (pull + np.swapaxes(pull, 0, 1))
    second = np.stack([pull[a, b] * (1 if a == b else 2) for a, b in _SQUARES], axis=-1)
    return (
        np.array([[integrals.inertia[a, b]] for a, b in _SECOND_MOMENTS]),
        np.array([derivative[a, b] for a, b in _SECOND_MOMENTS]),
        second,
    )


def _products(moments: Array) -> Array:
    """Columns of Oe (k, 6) from half the derivatives of -J (k, 6): mixed products count twice, in the order of Oe."""
    doubled = moments * np.array([1, 1, 1, 2, 2, 2])
    return np.asarray(doubled[:, [_SECOND_MOMENTS.index(pair) for pair in _SQUARES]])


def _gyroscopic(integrals: ModalIntegrals) -> Array:
    """-2 int S(r) S(phi_l) dm: entry [row, axis, l]."""
    return np.asarray(2 * (np.einsum("iil,ab->abl", integrals.r_phi, np.eye(3)) - np.swapaxes(integrals.r_phi, 0, 1)))


def _columns(name: str, blocks: Array, dialect: SidDialect) -> Array:
    """Columns of [row, axis, mode] in the order asked for."""
    by_axis = dialect == "by-axis" or (dialect == "gr-by-mode" and name == "Ge")
    ordered = blocks if by_axis else np.swapaxes(blocks, 1, 2)
    return np.asarray(ordered.reshape(blocks.shape[0], blocks.shape[1] * blocks.shape[2]))


def _taylor(part: _Taylor, modes: int, indent: int, digits: int) -> Iterator[str]:
    inner = 26
    zero = not part.m0.any() and (part.m1 is None or not part.m1.any())
    yield f"{'':{indent}}{part.name:<8}"
    yield _value(inner, "order", f"{int(part.m1 is not None):5d}")
    yield _value(inner, "nrow", f"{part.m0.shape[0]:5d}")
    yield _value(inner, "ncol", f"{part.m0.shape[1]:5d}")
    yield _value(inner, "nq", f"{modes:5d}")
    yield _value(inner, "nqn", f"{0:5d}")
    yield _value(inner, "structure", f"{_ZERO if zero else _SYMMETRIC if part.symmetric else _FULL:5d}")
    for row, column in zip(*np.nonzero(np.triu(part.m0) if part.symmetric else part.m0), strict=True):
        yield _value(inner, f"m0({row + 1:2d},{column + 1:2d})", _number(part.m0[row, column], digits))
    if part.m1 is not None:
        for column, row, mode in zip(*np.nonzero(np.moveaxis(part.m1, 2, 0)), strict=True):
            name = f"m1({row + 1:2d},{mode + 1:2d},{column + 1:2d})"
            yield _value(inner, name, _number(part.m1[row, mode, column], digits))
    yield f"{'':{indent}}end {part.name:<8}"


def _value(indent: int, name: str, value: str) -> str:
    """A line with the equals sign in the same column as the others."""
    return f"{'':{indent}}{name}".ljust(48) + f"={value}"


def _number(value: float, digits: int) -> str:
    return f"{value:{digits + 7}.{digits}E}".replace("E", "D")
