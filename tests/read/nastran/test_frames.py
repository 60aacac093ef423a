"""Coordinate systems against closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cmsreduce.errors import ReadError
from cmsreduce.read.nastran.frames import BASIC, CoordinateSystem, FrameChain, FrameDefinition, Grid
from cmsreduce.read.printed_numbers import printed_rounding

ORIGIN = np.array([1.0, 2.0, 3.0])
# z along basic x, x along basic y: origin, a point on z, a point in the xz plane that is not on x.
TURNED = np.array([[1.0, 2, 3], [5, 2, 3], [2, 4, 3]])
ROOT = np.sqrt(0.5)


@pytest.mark.parametrize(
    ("kind", "point", "expected"),
    [
        ("rectangular", [1, 2, 3], [1 + 3, 2 + 1, 3 + 2]),
        ("cylindrical", [2, 0, 5], [1 + 5, 2 + 2, 3]),
        ("cylindrical", [2, 90, 5], [1 + 5, 2, 3 + 2]),
        ("cylindrical", [2, 210, 0], [1, 2 - np.sqrt(3), 3 - 1]),
        ("spherical", [2, 90, 0], [1, 2 + 2, 3]),
        ("spherical", [2, 90, 90], [1, 2, 3 + 2]),
        ("spherical", [2, 0, 33], [1 + 2, 2, 3]),
        ("spherical", [4, 60, 30], [1 + 2, 2 + 3, 3 + np.sqrt(3)]),
    ],
)
def test_points(kind: str, point: list[float], expected: list[float]) -> None:
    system = CoordinateSystem.through(1, kind, TURNED)
    np.testing.assert_allclose(system.axes, [[0, 1, 0], [0, 0, 1], [1, 0, 0]], atol=1e-15)
    np.testing.assert_allclose(system.to_basic([point])[0], expected, atol=1e-14)


@pytest.mark.parametrize(
    ("kind", "xyz", "expected"),
    [
        ("rectangular", [3, 3, 3], np.eye(3)),
        ("cylindrical", [0, 2, 7], [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]),
        ("cylindrical", [-1, -1, 0], [[-ROOT, -ROOT, 0], [ROOT, -ROOT, 0], [0, 0, 1]]),
        ("spherical", [1, 0, 0], [[1, 0, 0], [0, 0, -1], [0, 1, 0]]),
        ("spherical", [0, 1, 1], [[0, ROOT, ROOT], [0, ROOT, -ROOT], [-1, 0, 0]]),
        # On the axis theta and phi are undefined: NASTRAN takes the defining rectangular axes.
        ("cylindrical", [0, 0, 7], np.eye(3)),
        ("spherical", [0, 0, -2], np.eye(3)),
        ("cylindrical", [1e-9, 0, 7], np.eye(3)),
    ],
)
def test_displacement_axes(kind: str, xyz: list[float], expected: list[list[float]]) -> None:
    system = CoordinateSystem(5, kind, np.zeros(3), np.eye(3))
    np.testing.assert_allclose(system.displacement_axes([xyz])[0], expected, atol=1e-15)


@pytest.mark.parametrize("kind", ["rectangular", "cylindrical", "spherical"])
def test_displacement_axes_are_the_directions_of_growing_coordinates(kind: str) -> None:
    system = CoordinateSystem.through(1, kind, [[0.3, 1, -2], [1, 1.5, 0], [0, 4, 0.2]])
    point = np.array([2.0, 40.0, 65.0])
    axes = system.displacement_axes(system.to_basic([point]))[0]
    for k in range(3):
        step = np.zeros(3)
        step[k] = 1e-5
        along = (system.to_basic([point + step]) - system.to_basic([point - step]))[0]
        np.testing.assert_allclose(along / np.linalg.norm(along), axes[k], atol=1e-9)
    assert np.linalg.det(axes) == pytest.approx(1.0)


@pytest.mark.parametrize(
    "points", [np.zeros((3, 3)), [[0, 0, 0], [0, 0, 1], [0, 0, 5]], [[0, 0, 0], [0, 0, 1], [0, 0, 0]]]
)
def test_points_on_a_line_are_refused(points: list[list[float]]) -> None:
    with pytest.raises(ReadError, match="three points lie on one line"):
        CoordinateSystem.through(9, "rectangular", points)


def chain(*frames: FrameDefinition, grids: dict[int, Grid] | None = None) -> FrameChain:
    return FrameChain({frame.id: frame for frame in frames}, grids or {})


UP = np.array([[0.0, 0, 0], [0, 0, 1], [1, 0, 0]])


def test_a_chain_in_any_order_and_a_system_through_grids_in_another_system() -> None:
    # 30 is at r = 2, theta = 90 in the cylindrical 20, which is defined in 10, moved by (10, 0, 0).
    far = FrameDefinition(30, "rectangular", "CORD2R 30", 20, (2.0, 90, 0, 2, 90, 1, 3, 90, 0))
    middle = FrameDefinition(20, "cylindrical", "CORD2C 20", 10, (*UP.ravel(),))
    near = FrameDefinition(10, "rectangular", "CORD2R 10", 0, (10, 0, 0, 10, 0, 1, 11, 0, 0))
    by_grids = FrameDefinition(40, "spherical", "CORD1S 40", grids=(1, 2, 3))
    grids = {
        1: Grid(20, (2.0, 90.0, 0.0), "GRID 1"),
        2: Grid(30, (0.0, 1.0, 0.0), "GRID 2"),
        3: Grid(0, (10.0, 2.0, 1.0), "GRID 3"),
    }
    found = chain(far, middle, near, by_grids, grids=grids)
    system = found.system(30, "here")
    np.testing.assert_allclose(system.origin, [10, 2, 0], atol=1e-14)
    np.testing.assert_allclose(system.axes, [[0, 1, 0], [-1, 0, 0], [0, 0, 1]], atol=1e-14)
    system = found.system(40, "here")
    np.testing.assert_allclose(system.origin, [10, 2, 0], atol=1e-14)
    # z from grid 1 to grid 2 is -x of basic; grid 3 lies along +z of basic.
    np.testing.assert_allclose(system.axes, [[0, 0, 1], [0, 1, 0], [-1, 0, 0]], atol=1e-14)
    assert found.system(0, "here") is BASIC


def test_cycles_and_missing_systems_are_named() -> None:
    a = FrameDefinition(1, "rectangular", "CORD2R 1", 2, (*UP.ravel(),))
    b = FrameDefinition(2, "rectangular", "CORD2R 2", 3, (*UP.ravel(),))
    c = FrameDefinition(3, "rectangular", "CORD2R 3", 1, (*UP.ravel(),))
    with pytest.raises(ReadError, match=r"coordinate system 1 is defined by itself: 1 -> 2 -> 3 -> 1"):
        chain(a, b, c).system(1, "GRID 5")
    with pytest.raises(ReadError, match=r"GRID 5 refers to coordinate system 7, .* defines 1\)"):
        chain(a).system(7, "GRID 5")
    through = FrameDefinition(4, "rectangular", "CORD1R 4", grids=(1, 2, 3))
    with pytest.raises(ReadError, match="CORD1R 4 goes through grid 1, which the deck does not have"):
        chain(through).system(4, "GRID 5")
    itself = {k: Grid(4, (float(k), 0.0, 0.0), f"GRID {k}") for k in (1, 2, 3)}
    with pytest.raises(ReadError, match="4 -> 4"):
        chain(through, grids=itself).system(4, "GRID 5")


@pytest.mark.parametrize(
    ("value", "rounding"),
    [
        ("600.", 0.0),
        ("0.375", 0.0),
        ("12345.", 0.0),
        ("0.333333", 5e-7),
        ("-0.99999994039535", 5e-15),
        ("1.23456-8", 5e-14),
        # Trailing zeros are digits.
        ("0.300000", 5e-7),
        ("3.000000000E+00", 5e-10),
        ("0.0000000", 0.0),
    ],
)
def test_printed_rounding(value: str, rounding: float) -> None:
    assert printed_rounding([value])[0] == pytest.approx(rounding, rel=1e-12)


def test_rounding_of_a_system_reaches_its_points() -> None:
    frame = FrameDefinition(1, "cylindrical", "CORD2C 1", 0, (0.0, 0, 0, 0, 0, 1, 0.707107, 0.707107, 0))
    frame = replace(frame, rounding=(0.0,) * 6 + (5e-7, 5e-7, 0.0))
    system = chain(frame).system(1, "here")
    # Half a unit of the sixth digit over an arm of one, and as much again.
    assert 5e-7 < system.angle_rounding < 2e-6
    points = np.array([[10.0, 33.3333, 0.0]])
    off = system.position_rounding(points, printed_rounding(["10.", "33.3333", "0."])[None])[0]
    assert off == pytest.approx(10 * np.radians(5e-5) + system.origin_rounding + 10 * system.angle_rounding, rel=1e-6)
