"""Laminates of the plates of a NASTRAN deck: forces and moments per length by strains and curvatures."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cmsreduce.read.nastran.cards import Card
from cmsreduce.read.nastran.deck_elements import Elements, Material, isotropic
from cmsreduce.read.stated import NotCountedError, StatedPlates
from cmsreduce.read.stated_nodes import flat_plates

__all__ = ["stated_plates"]

Array = NDArray[np.float64]


def stated_plates(elements: Elements) -> StatedPlates | None:
    """Plates of a deck with the stiffness of each; None without plates.

    Raises
    ------
    NotCountedError
        If the stiffness of a plate is not that of isotropic materials.
    """
    parts, kinds = [], 0
    for faces in elements.plates:
        used, of = np.unique(faces.property, return_inverse=True)
        laminates = np.array([_shell(faces.cards[k], elements.materials) for k in used]).reshape(-1, 6, 6)
        parts.append(flat_plates(faces.nodes, elements.nodes.xyz, laminates[of], kinds + of))
        kinds += used.size
    if not parts:
        return None
    return StatedPlates(*(np.concatenate(each) for each in zip(*parts, strict=True)))


def _shell(card: Card, materials: dict[int, Material]) -> Array:
    """Laminate (6, 6) of a PSHELL; its shear across turns no edge of a plate of constant curvature."""
    if card.integer(1, 0) < 0 or card.integer(3, 0) < 0 or card.text(10):
        raise NotCountedError
    thick = card.real(2)
    found = np.zeros((6, 6))
    for first, k, share in ((0, 1, thick), (3, 3, card.real(4, 1.0) * thick**3 / 12)):
        if card.text(k):
            found[first : first + 3, first : first + 3] = share * _plane(isotropic(card.integer(k), materials))
    return found


def _plane(material: Material) -> Array:
    """Plane stress: stresses by strains xx, yy and the angle xy."""
    found = material.E / (1 - material.nu**2) * np.array([[1, material.nu, 0], [material.nu, 1, 0], [0, 0, 0]])
    found[2, 2] = material.G
    return found
