"""Geometric stiffness in the frame of a code: one force, stated in several frames."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cmsreduce.errors import WriteError
from cmsreduce.mechanics import bars_stiffness, modal_integrals, modal_stiffening
from cmsreduce.model import INERTIA_LOADS, SQUARES, UnitLoad
from cmsreduce.write import ComponentFile
from cmsreduce.write.component.flexible_body import frame_stiffening
from cmsreduce.write.component.layout import fault
from tests.frames import BAR, frame, rotation
from tests.mechanics.test_geometric_stiffness import bars_of

XYZ, PAIRS = [[0, 0, 0], [0.5, 0.1, 0], [1, 0.3, 0.2], [1.2, 0.9, 0.1]], [(1, 2), (2, 3), (3, 4)]
BODY = frame("arm", XYZ, PAIRS)
HELD = BODY.dofs.rows_of(1, range(1, 7))
SHAPES = np.random.default_rng(4).normal(size=(BODY.n, 3))
POINTS = [UnitLoad(kind, axis, "4") for kind in ("force", "moment") for axis in "xyz"]


def stored(loads: list[UnitLoad], origin=(0.0, 0.0, 0.0)) -> ComponentFile:
    found = modal_stiffening(
        bars_stiffness(BODY, bars_of(PAIRS, BAR), loads, held=HELD, origin=np.array(origin)), SHAPES
    )
    return ComponentFile(
        name="arm",
        method="craig-bampton",
        rigid_count=0,
        static_count=0,
        arrays={"geometric_stiffness/K": found.K, "geometric_stiffness/origin": found.origin},
        texts={"geometric_stiffness/load": tuple(load.label for load in found.loads)},
        attributes={},
        checks=(),
    )


def total(found, a, alpha, w) -> np.ndarray:
    """Stiffness of a motion given along the axes of the frame."""
    products = [w["xyz".index(i)] * w["xyz".index(j)] for i, j in SQUARES]
    parts = ((found.acceleration, a), (found.turning, alpha), (found.spinning, products))
    return sum(np.einsum("i,iab->ab", np.array(amount), K) for K, amount in parts)


def test_a_frame_that_stands_and_points_elsewhere_tells_of_the_same_stiffness() -> None:
    file = stored([*INERTIA_LOADS, *POINTS])
    P, A = np.array([0.4, -0.3, 0.7]), rotation([1, 2, 3], 0.8)
    there = frame_stiffening(file, modal_integrals(BODY, SHAPES, origin=P, axes=A))
    here = frame_stiffening(file, modal_integrals(BODY, SHAPES))
    a, alpha, w = np.array([1.0, -2, 3]), np.array([0.5, 0.7, -1.1]), np.array([2.0, 1.0, -0.6])
    # The point at the basic origin of a frame that moves so at P accelerates by this.
    at_origin = a - np.cross(alpha, P) - np.cross(w, np.cross(w, P))
    expected = total(here, at_origin, alpha, w)
    np.testing.assert_allclose(total(there, A @ a, A @ alpha, A @ w), expected, atol=1e-9 * abs(expected).max())
    force = np.array([1.0, 5.0, -2.0])
    for name in ("force", "moment"):
        one, other = getattr(here, name)[4], getattr(there, name)[4]
        np.testing.assert_allclose(
            np.einsum("i,iab->ab", A @ force, other), np.einsum("i,iab->ab", force, one), atol=1e-9 * abs(one).max()
        )


def test_it_is_what_is_computed_about_that_point() -> None:
    P = np.array([0.4, -0.3, 0.7])
    restated = frame_stiffening(stored(list(INERTIA_LOADS)), modal_integrals(BODY, SHAPES, origin=P))
    direct = frame_stiffening(stored(list(INERTIA_LOADS), P), modal_integrals(BODY, SHAPES, origin=P))
    for name in ("acceleration", "turning", "spinning"):
        one, other = getattr(restated, name), getattr(direct, name)
        np.testing.assert_allclose(one, other, atol=1e-9 * abs(other).max())


def test_some_terms_alone_cannot_be_restated() -> None:
    file = stored([UnitLoad("centrifugal", "zz")])
    assert abs(frame_stiffening(file, modal_integrals(BODY, SHAPES)).spinning[2]).max() > 0
    with pytest.raises(WriteError, match="'acceleration x' is missing"):
        frame_stiffening(file, modal_integrals(BODY, SHAPES, origin=(0.1, 0, 0)))
    # Forces at nodes do not turn with the frame's origin.
    moved = frame_stiffening(stored(POINTS), modal_integrals(BODY, SHAPES, origin=(0.1, 0, 0)))
    assert list(moved.force) == list(moved.moment) == [4]


def test_a_file_without_the_term_has_none() -> None:
    assert frame_stiffening(replace(stored([]), arrays={}), modal_integrals(BODY, SHAPES)) is None


def test_a_matrix_of_another_size_is_a_fault() -> None:
    groups = ["modes", "dofs", "inputs", "outputs", "checks", "provenance", "units", "interfaces", "integration"]
    assert "modes/omega" in fault([*groups, "geometric_stiffness"], {})
