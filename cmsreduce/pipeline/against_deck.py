"""The mass matrix of a body against the masses that its deck states."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cmsreduce.linalg.modal_integrals import rigid_mass
from cmsreduce.model import Check, FEModel
from cmsreduce.read import deck_mass
from cmsreduce.verify.mass_properties import rigid_mass_properties

__all__ = ["against_deck"]

# Areas, densities and coordinates of a deck have five digits or more.
_DIGITS = 1e-4


def against_deck(path: Path, body: FEModel) -> list[Check]:
    """Compare mass and centre of mass with those of the elements of the deck.

    Parameters
    ----------
    path : Path
        Geometry file.
    body : FEModel
        As read from it, in its units; free in all directions.

    Returns
    -------
    list of Check
        Relative to the mass, and to the largest radius of gyration; empty where the deck states no masses, or some that
        are not counted.
    """
    stated = None if body.nodes is None else deck_mass(path, body.nodes)
    if stated is None:
        return []
    found = rigid_mass_properties(rigid_mass(body))
    mass = float(found.mass.max())
    radius = float(np.sqrt(abs(found.inertia).max() / mass))
    away = float(np.linalg.norm(found.cg - stated.centre))
    return [
        Check("mass against the deck", abs(stated.mass - mass) / mass, _DIGITS),
        Check("centre of mass against the deck", away / radius if radius > 0 else float(away > 0), _DIGITS),
    ]
