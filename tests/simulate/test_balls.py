"""Balls: motions are rotation vectors, and springs on them keep the energy, whatever the path."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cmsreduce.errors import SimulationError
from cmsreduce.model import JointElement
from cmsreduce.simulate import Motion, Pulse
from cmsreduce.simulate.balls import vector_rates
from tests.simulate.scenes import hinged, joint, simulate
from tests.simulate.test_rigid_bodies import brick

STIFF = np.array([20.0, 35.0, 5.0])


def swung(folder: Path, stiff: np.ndarray, seconds: float, **options: object) -> Motion:
    elements = tuple(JointElement(dof, stiffness=float(k)) for dof, k in zip((3, 4, 5), stiff, strict=True) if k)
    bodies = [brick("wall", (1, 1, 1)), brick("pod", (0.3, 0.5, 0.4), cg=(0.1, 0.2, 0.3))]
    scene = hinged(
        bodies, [joint("ball", "wall.hinge", "pod.hinge", (3, 4, 5), elements=elements)], folder, ground=["wall.hinge"]
    )
    return simulate(scene, seconds, accuracy=1e-9, **options)  # type: ignore[arg-type]


def vectors(motion: Motion) -> np.ndarray:
    return np.column_stack([motion.joints[f"ball.{axis}"] for axis in ("rx", "ry", "rz")])


@pytest.mark.parametrize("angle", [0.0, 1e-3, 0.9, np.pi, 4.5])
def test_rates_of_a_rotation_vector_are_differences(angle: float) -> None:
    theta, w, h = angle * np.array([0.48, -0.6, 0.64]), np.array([[0.3], [-0.7], [0.5]]), 1e-5
    R = Rotation.from_rotvec(theta + h * vector_rates(theta, w)[:, 0])
    turned = Rotation.from_rotvec(h * w[:, 0]) * Rotation.from_rotvec(theta)
    assert (R * turned.inv()).magnitude() < 1e-8 * np.linalg.norm(w)


def test_energy_of_springs_is_a_function_of_the_position(tmp_path: Path) -> None:
    """Two motors swing a body about two axes at a time: its energy and the vector are those of the matrix."""
    efforts = {"ball.3": Pulse(25.0, 0.4), "ball.4": Pulse(-30.0, 0.3, start=0.1)}
    motion = swung(tmp_path, STIFF, 1.5, efforts=efforts)
    theta = Rotation.from_matrix(motion.rotation["pod"]).as_rotvec()
    assert np.linalg.norm(theta, axis=1).max() > 1.0 and abs(theta).max(axis=0).min() > 0.3
    np.testing.assert_allclose(vectors(motion), theta, rtol=0, atol=1e-8)
    kinetic, potential = motion.energy.T
    springs = 0.5 * theta**2 @ STIFF
    np.testing.assert_allclose(potential, springs, rtol=0, atol=1e-7)
    np.testing.assert_allclose(kinetic + springs, motion.work, rtol=0, atol=1e-7 * kinetic.max())


def test_like_springs_pull_along_the_rotation_vector(tmp_path: Path) -> None:
    """A sphere at its centre swings in one plane from any push: the vector keeps its direction and period."""
    bodies = [brick("wall", (1, 1, 1)), brick("pod", (0.5, 0.5, 0.5))]
    elements = tuple(JointElement(dof, stiffness=8.0) for dof in (3, 4, 5))
    ball = joint("ball", "wall.hinge", "pod.hinge", (3, 4, 5), elements=elements)
    scene = hinged(bodies, [ball], tmp_path, ground=["wall.hinge"])
    rates = np.array([4.0, -5.0, 2.0])
    motion = simulate(
        scene, 3.0, accuracy=1e-9, rates=dict(zip(("ball.rx", "ball.ry", "ball.rz"), rates.tolist(), strict=True))
    )
    expected = np.sin(4.0 * motion.time)[:, None] * rates / 4.0
    assert np.linalg.norm(expected, axis=1).max() > 1.5
    np.testing.assert_allclose(vectors(motion), expected, rtol=0, atol=1e-7)


def test_a_ball_without_springs_turns_without_end(tmp_path: Path) -> None:
    motion = swung(tmp_path, np.zeros(3), 4.0, rates={"ball.rx": 6.0, "ball.rz": 2.0})
    theta, R = vectors(motion), motion.rotation["pod"]
    assert np.linalg.norm(theta, axis=1).max() < 1.5 * np.pi + 0.5
    np.testing.assert_allclose(Rotation.from_rotvec(theta).as_matrix(), R, rtol=0, atol=1e-7)


def test_springs_of_a_ball_are_refused_near_a_whole_turn(tmp_path: Path) -> None:
    with pytest.raises(SimulationError, match=r"joint 'ball' has turned by 2[78]. degrees"):
        swung(tmp_path, 0.01 * STIFF, 4.0, rates={"ball.rx": 6.0})
