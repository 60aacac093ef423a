"""The modal integrals that a component file holds."""

from __future__ import annotations

from typing import cast

import numpy as np

from cmsreduce.errors import WriteError
from cmsreduce.model import Lumping, ModalIntegrals
from cmsreduce.write.component_file import ComponentFile

__all__ = ["stored_integrals"]

_ARRAYS = ("origin", "axes", "first_moment", "inertia", "phi", "r_cross_phi", "r_phi", "phi_phi", "modes")


def stored_integrals(component: ComponentFile) -> ModalIntegrals:
    """Modal integrals of a component file.

    Raises
    ------
    WriteError
        If it has none, or was written before there were any of second order.
    """
    arrays = component.arrays
    missing = [name for name in ("mass", *_ARRAYS) if f"integrals/{name}" not in arrays]
    if missing:
        raise WriteError(
            f"component '{component.name}': its file has no modal integrals (integrals/{missing[0]} is missing); a "
            "body without geometry has none, and a file of an earlier version is written again with `cmsreduce run`"
        )
    return ModalIntegrals(
        mass=float(arrays["integrals/mass"]),
        lumping=cast(Lumping, str(component.attributes["integrals"].get("lumping", "consistent"))),
        **{name: np.asarray(arrays[f"integrals/{name}"]) for name in _ARRAYS},
    )
