"""Isotropic materials of a NASTRAN deck."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cmsreduce.read.nastran.cards import Cards
from cmsreduce.read.stated import NotCountedError

__all__ = ["Material", "is_compressible", "is_isotropic", "isotropic", "lame_of", "materials_of"]

# Moduli that contradict each other by more make no isotropic material.
_ISOTROPIC = 1e-3
# Beyond any modulus in any units; products with larger ones may overflow.
_LARGEST = 1e100


@dataclass(frozen=True)
class Material:
    """Isotropic material of a MAT1: Young's and shear modulus, Poisson's ratio, density."""

    E: float
    G: float
    nu: float
    density: float


def materials_of(cards: Cards) -> dict[int, Material]:
    """Materials by number; a blank modulus follows from the others, one that varies with temperature is unknown."""
    found = {}
    varied = {card.integer(0): card for card in cards.get("MATT1", ())}
    for card in cards.get("MAT1", ()):
        E, G, nu = card.real(1), card.real(2), card.real(3)
        if not card.text(1):
            E = 2 * (1 + nu) * G
        if not card.text(2):
            G = E / (2 * (1 + nu)) if nu != -1 else np.nan
        if not card.text(3) and G:
            nu = E / (2 * G) - 1
        number = card.integer(0)
        density = card.real(4)
        if number in varied:
            E = np.nan if any(varied[number].text(k) for k in (1, 2, 3)) else E
            density = np.nan if varied[number].text(4) else density
        found[number] = Material(E, G, nu, density)
    return found


def isotropic(number: int, materials: Mapping[int, Material]) -> Material:
    """Material by its number.

    Raises
    ------
    NotCountedError
        If there is none, or its moduli are not those of an isotropic one.
    """
    found = materials.get(number)
    if found is None or not is_isotropic(found):
        raise NotCountedError
    return found


def is_isotropic(material: Material) -> bool:
    """True if the moduli are those of an isotropic material."""
    return material.E > 0 and abs(2 * material.G * (1 + material.nu) / material.E - 1) <= _ISOTROPIC


def is_compressible(material: Material) -> bool:
    """True if a solid of the material has a finite energy, whatever its units."""
    return -1 < material.nu < 0.5 and material.E < _LARGEST


def lame_of(material: Material) -> float:
    """First constant of Lame."""
    return material.E * material.nu / (1 + material.nu) / (1 - 2 * material.nu)
