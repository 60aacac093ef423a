"""All hard cases, by name of the function that builds them."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache

from tests.hard import inertia, interfaces, loads, motions, multiplicity, numbers, size
from tests.hard.case import Case

__all__ = ["BUILDERS", "build"]

_BY_DIFFICULTY = {
    multiplicity: ("square_beam", "symmetric_frame", "ten_appendages"),
    interfaces: ("determinate", "indeterminate", "redundant", "one_pin", "nothing", "everything"),
    motions: (
        "hinge_between_interfaces",
        "hinge_behind_the_interface",
        "bar_along_x",
        "planar_frame",
        "scalar_chain",
        "grounded",
        "lone_node",
        "massless_spin",
        "held_by_mass_alone",
    ),
    numbers: (
        "penalty_springs",
        "soft_beside_stiff",
        "in_metres",
        "in_millimetres",
        "in_inches",
        "single_precision",
        "ten_digits",
        "indefinite",
        "far_from_the_origin",
    ),
    inertia: ("massless_rotations", "massless_interface", "massless_tip", "tiny_inertia", "heavy_end"),
    loads: ("loads_1e9_apart", "loads_twice", "no_outputs", "no_damping"),
    size: ("grillage", "slender_mast", "mast"),
}

BUILDERS: dict[str, Callable[[], Case]] = {
    name: getattr(module, name) for module, names in _BY_DIFFICULTY.items() for name in names
}
"""Builders of the cases, those of one difficulty together."""


@lru_cache(maxsize=1)
def build(name: str) -> Case:
    """The case of a name; kept until the next one is asked for."""
    return BUILDERS[name]()
