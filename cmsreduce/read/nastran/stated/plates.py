"""Laminates of the plates of a NASTRAN deck: forces and moments per length by strains and curvatures."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cmsreduce.read.nastran.cards import INTEGER, NO_CARDS, Card, CardTable
from cmsreduce.read.nastran.stated.elements import Elements
from cmsreduce.read.nastran.stated.faces import PLATES, own_thickness, properties_of
from cmsreduce.read.nastran.stated.materials import isotropic
from cmsreduce.read.stated import NotCountedError, StatedPlates, flat_plates

__all__ = ["stated_plates"]

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_FIRST_PLY, _PLY = 8, 4
# Angles, in radians, and laminates, of their largest entry, that are the same.
_TURN, _SAME = 1e-4, 1e-9
# Kinds of laminates whose plies all are written, or half of them.
_WHOLE, _HALF = "", "SYM"


def stated_plates(elements: Elements) -> StatedPlates | None:
    """Plates of a deck with the stiffness of each; None without plates.

    A plate with another thickness at each corner, a property that is not read here, or an angle that programs measure
    from different axes, is not flat.

    Raises
    ------
    NotCountedError
        If a plate has no property or is on an unknown grid.
    """
    made = {card.integer(0): card for name in ("PSHELL", "PCOMP") for card in elements.cards.get(name, ())}
    cards, parts, kinds = list(made.values()), [], 0
    for name, count in PLATES.items():
        found = elements.cards.get(name, NO_CARDS)
        if not len(found):
            continue
        corners = elements.nodes.index(np.stack([found.integers(2 + k) for k in range(count)], axis=1).ravel())
        if (corners < 0).any():
            raise NotCountedError
        angle, known = _angles(found, 2 + count)
        offset = found.reals(3 + count)
        own, shares, uneven = own_thickness(found, count)
        kind = np.stack([properties_of(found, made), angle, offset, own, shares], axis=1)
        used, of = np.unique(kind, axis=0, return_inverse=True)
        laminates = [
            _laminate(cards[int(k)], elements, turn, away, thick, bool(share)) for k, turn, away, thick, share in used
        ]
        unknown = np.array([each is None for each in laminates])
        filled = np.array([np.zeros((6, 6)) if each is None else each for each in laminates])
        plates = flat_plates(corners.reshape(-1, count), elements.nodes.xyz, filled[of], kinds + of)
        # Of materials that are alike in all directions no angle matters.
        unknown = unknown[of] | (_skew(elements.nodes.xyz[corners.reshape(-1, count)]) | ~known) & ~_alike(filled)[of]
        parts.append(plates._replace(flat=plates.flat & ~unknown & ~uneven))
        kinds += len(used)
    return StatedPlates(*(np.concatenate(each) for each in zip(*parts, strict=True))) if parts else None


def _angles(found: CardTable, field: int) -> tuple[Array, NDArray[np.bool_]]:
    """Angle of the material about the first edge, in radians, and whether it is one: an integer names a frame."""
    texts, which = found.texts(field)
    frames = np.array([bool(INTEGER.match(text)) for text in texts])[which]
    return np.where(frames, 0.0, np.radians(found.reals(field))), ~frames


def _laminate(card: Card, elements: Elements, angle: float, offset: float, thick: float, share: bool) -> Array | None:
    """Laminate (6, 6) about the first edge and the plane of the nodes; None if it is not read here.

    ``thick`` is the thickness of the element, or its share of that of the property; 0 for that of the property.
    """
    if thick and card.name != "PSHELL":
        return None
    try:
        whole = card.real(2) if card.name == "PSHELL" else 0.0
        thick = (thick * whole if share else thick) or whole
        own = _shell(card, elements, thick) if card.name == "PSHELL" else _layers(card, elements)
    except NotCountedError:
        return None
    R = np.kron(np.eye(2), _turned(angle))
    A, B, D = own[:3, :3], own[:3, 3:], own[3:, 3:]
    # Strains in the middle are those of the nodes, and so much of the curvature.
    B, D = B + offset * A, D + 2 * offset * B + offset**2 * A
    return np.asarray(R.T @ np.block([[A, B], [B, D]]) @ R)


def _turned(angle: float) -> Array:
    """Strains xx, yy and the angle xy along axes turned by an angle, from those before."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c * c, s * s, c * s], [s * s, c * c, -c * s], [-2 * c * s, 2 * c * s, c * c - s * s]])


def _skew(x: Array) -> NDArray[np.bool_]:
    """True for quadrilaterals (e, 4, 3) in which programs measure the angle of a material from different axes.

    They are the first edge, and the line that halves the angle of the diagonals; in a rectangle they are one. Also true
    where one of these has no length.
    """
    if x.shape[1] == 3:
        return np.zeros(len(x), dtype=bool)
    lines = np.stack([x[:, 1] - x[:, 0], x[:, 2] - x[:, 0], x[:, 1] - x[:, 3]])
    lengths = np.linalg.norm(lines, axis=2, keepdims=True)
    edge, *diagonals = lines / np.where(lengths > 0, lengths, 1.0)
    middle = diagonals[0] + diagonals[1]
    off = np.linalg.norm(np.cross(edge, middle), axis=1)
    return np.asarray((off > _TURN * np.linalg.norm(middle, axis=1)) | ~lengths.all(axis=(0, 2)))


def _alike(laminates: Array) -> NDArray[np.bool_]:
    """True for laminates (k, 6, 6) that are the same about every axis."""
    R = np.kron(np.eye(2), _turned(0.7))
    off = abs(R.T @ laminates @ R - laminates).max(axis=(1, 2))
    return np.asarray(off <= _SAME * abs(laminates).max(axis=(1, 2)))


def _shell(card: Card, elements: Elements, thick: float) -> Array:
    """A PSHELL of a thickness; its shear across changes no force of a plate of constant curvature."""
    if card.integer(1, 0) < 0 or card.integer(3, 0) < 0 or card.text(10):
        raise NotCountedError
    found = np.zeros((6, 6))
    for first, k, share in ((0, 1, thick), (3, 3, card.real(4, 1.0) * thick**3 / 12)):
        if card.text(k):
            found[first : first + 3, first : first + 3] = share * _plane(card.integer(k), elements)
    return found


def _layers(card: Card, elements: Elements) -> Array:
    """A PCOMP, from its bottom; a blank material or thickness is that of the ply before."""
    kind = card.text(7).upper()
    if kind not in (_WHOLE, _HALF):
        raise NotCountedError
    plies: list[tuple[int, float, float]] = []
    for k in range(_FIRST_PLY, len(card.fields), _PLY):
        if not any(card.text(k + j) for j in range(_PLY)):
            continue
        last = plies[-1] if plies else (0, 0.0, 0.0)
        plies.append((card.integer(k, last[0]), card.real(k + 1, last[1]), np.radians(card.real(k + 2))))
    if kind == _HALF:
        plies += plies[::-1]
    total = sum(t for _, t, _ in plies)
    z, found = card.real(1, -total / 2), np.zeros((6, 6))
    for number, t, turn in plies:
        Q = _turned(turn).T @ _plane(number, elements) @ _turned(turn)
        powers = [((z + t) ** k - z**k) / k for k in (1, 2, 3)]
        found += np.block([[powers[0] * Q, powers[1] * Q], [powers[1] * Q, powers[2] * Q]])
        z += t
    return found


def _plane(number: int, elements: Elements) -> Array:
    """Plane stress of a MAT1, MAT2 or MAT8: stresses by strains xx, yy and the angle xy.

    Raises
    ------
    NotCountedError
        If there is no such material, or it has no stiffness.
    """
    card = elements.anisotropic.get(number)
    if card is not None and card.name == "MAT2":
        a, b, c, d, e, f = (card.real(k) for k in range(1, 7))
        return np.array([[a, b, c], [b, d, e], [c, e, f]])
    if card is not None:
        E1, E2, nu, G = (card.real(k) for k in range(1, 5))
        if not (E1 > 0 and E2 > 0 and nu**2 * E2 < E1):
            raise NotCountedError
        along = E1 / (1 - nu**2 * E2 / E1)
        return np.array([[along, nu * along * E2 / E1, 0], [nu * along * E2 / E1, along * E2 / E1, 0], [0, 0, G]])
    made = isotropic(number, elements.materials)
    found = made.E / (1 - made.nu**2) * np.array([[1, made.nu, 0], [made.nu, 1, 0], [0, 0, 0]])
    found[2, 2] = made.G
    return found
