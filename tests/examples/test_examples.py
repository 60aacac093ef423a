"""The examples run, print what they promise, and leave a page of curves; tests/simulate has their physics."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture
def example(request: pytest.FixtureRequest) -> Iterator[ModuleType]:
    sys.path.insert(0, str(EXAMPLES))
    yield importlib.import_module(request.param)
    sys.path.remove(str(EXAMPLES))


@pytest.mark.parametrize("example", ["slew"], indirect=True)
def test_a_slew_of_galileo(example: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The slew reaches its angle but for the boom's swing; the spacecraft as a whole does not turn."""
    motion = example.main(tmp_path, 0.3)
    # A fast slew of bodies that bend: most of the angle is there.
    assert np.degrees(motion.joints["spin.rz"][-1]) == pytest.approx(20.0, rel=0.5)
    rotor = motion.system.bodies[motion.names.index("rotor")]
    spun = np.trace(rotor.second_moment) * abs(motion.angular_velocity["rotor"]).max()
    assert abs(motion.momentum[:, 3:]).max() < 1e-3 * spun
    assert "boom tip" in capsys.readouterr().out
    assert (tmp_path / "motion.html").stat().st_size > 1e6


@pytest.mark.parametrize("example", ["linkage"], indirect=True)
def test_a_loop(example: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The rocker's angle follows from the crank's by the triangles of the loop, but for the bending of the coupler."""
    motion = example.main(tmp_path, 0.15)
    turn = np.pi / 3 + motion.joints["a.rz"][-1]
    b, c = 0.6 * np.array([np.cos(turn), np.sin(turn)]), motion.point("rocker", "c")[-1, :2]
    assert turn - np.pi / 3 > 0.1
    assert np.linalg.norm(c - b) == pytest.approx(2.0, abs=1e-4)
    assert np.linalg.norm(c - [2.0, 0.0]) == pytest.approx(1.2169, abs=1e-4)
    assert "closed to" in capsys.readouterr().out


@pytest.mark.parametrize("example", ["spinup"], indirect=True)
def test_a_spin_up(example: ModuleType, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Torque over inertia: the hub's 40 and the beam's m L^2 / 3 about the axle, as if it were rigid."""
    motion = example.main(tmp_path, 0.3)
    beam, t = 2.0**3 * 0.01 * 0.02 * 2500 / 3, motion.time[-1]
    impulse = 1040.0 * (t / 2 - 3.0 / (4 * np.pi) * np.sin(2 * np.pi * t / 3.0))
    assert motion.angular_velocity["hub"][-1, 2] == pytest.approx(impulse / (40 + beam), rel=1e-2)
    assert "no divergence" in capsys.readouterr().out
