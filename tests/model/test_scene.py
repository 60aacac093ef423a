"""Scenes refuse unknown names; components keep the chosen modes."""

import numpy as np
import pytest

from cmsreduce.errors import MatrixError, SceneError
from cmsreduce.model import (
    Channel,
    Configuration,
    Joint,
    JointTerm,
    ModeSet,
    Point,
    PointTerm,
    Scene,
    StrutTerm,
    dof_index,
)
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.reduce import CraigBampton
from tests.frames import line

A, B = Point("a", "x"), Point("b", "y")
HINGE = Joint("hinge", A, B, frozenset({5}))
PUSH = Channel("push", (PointTerm(A, np.eye(6)[0]),), "translation")

REFUSED = {
    "an empty band": ({"band": (5.0, 5.0)}, "band 5 to 5 Hz is empty"),
    "a negative band": ({"band": (-1.0, 5.0)}, "band -1 to 5 Hz"),
    "two joints of one name": ({"joints": (HINGE, HINGE)}, "two joints are named 'hinge'"),
    "two sensors of one name": ({"sensors": (PUSH, PUSH)}, "two sensors are named 'push'"),
    "a joint to nowhere": ({"joints": (Joint("j", A, Point("c", "z")),)}, r"'c\.z': there is no component 'c'"),
    "a ground of nowhere": ({"ground": (Point("c", "z"),)}, r"'c\.z'"),
    "an actuator in no joint": (
        {"actuators": (Channel("m", (JointTerm("spin", 5),), "rotation"),)},
        r"'m': there is no joint 'spin' \(there are: hinge\)",
    ),
    "a strut to nowhere": ({"sensors": (Channel("s", (StrutTerm(A, Point("c", "z")),), "translation"),)}, r"'c\.z'"),
    "an angle of no joint": ({"configurations": (Configuration("c", {("spin", 5): 1.0}),)}, "no joint 'spin'"),
    "an angle that is locked": (
        {"configurations": (Configuration("c", {("hinge", 4): 1.0}),)},
        "joint 'hinge' is not free in ry",
    ),
    "an unknown base": ({"base": "c"}, "base 'c' is no component"),
}


@pytest.mark.parametrize(("change", "message"), REFUSED.values(), ids=REFUSED)
def test_refused(change, message):
    with pytest.raises(SceneError, match=message):
        Scene(**({"bodies": ("a", "b"), "band": (0.0, 1.0), "joints": (HINGE,)} | change))


def test_points_in_order_of_first_mention():
    far = Point("b", "12")
    scene = Scene(
        ("a", "b"),
        (0.0, 1.0),
        (HINGE,),
        actuators=(Channel("s", (StrutTerm(B, far),), "translation"),),
        sensors=(PUSH,),
    )
    assert scene.points() == (A, B, far)


@pytest.mark.parametrize(("name", "index"), [("x", 0), ("RZ", 5), (" ry ", 4), ("4", 3), ("tz", 2)])
def test_motions_by_name(name, index):
    assert dof_index(name) == index


@pytest.mark.parametrize("name", ["0", "7", "rw", "", "xyz"])
def test_no_such_motion(name):
    with pytest.raises(SceneError):
        dof_index(name)


def test_truncation_keeps_rigid_modes_and_the_order():
    body = line("bar", [0, 0, 0], [1, 0, 0], 3)
    modal = orthogonalise(CraigBampton(1e9).reduce(body, body.interface_rows("a")))
    less = modal.truncated([11, 7, 2], [f"reason {k}" for k in range(24)])
    np.testing.assert_array_equal(less.omega, modal.omega[[0, 1, 2, 3, 4, 5, 7, 11]])
    np.testing.assert_array_equal(less.Phi, modal.Phi[:, [0, 1, 2, 3, 4, 5, 7, 11]])
    assert less.why[-2:] == ("reason 7", "reason 11")
    assert (less.elastic_count, less.basis_size) == (2, 24)


def test_a_mode_set_says_what_each_shape_is():
    with pytest.raises(MatrixError, match="2 columns need 2 kinds"):
        ModeSet("m", np.eye(2), ("fixed",), np.zeros(2), ("1", "2"))
    with pytest.raises(MatrixError, match="unknown kinds of modes"):
        ModeSet("m", np.eye(1), ("bent",), np.zeros(1), ("1",))
