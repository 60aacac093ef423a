"""Bodies on a path from an actuator to a sensor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from cmsreduce.model import Channel, Joint, JointTerm, Point, PointTerm, Scene, StrutTerm
from cmsreduce.pipeline.choose.paths import off_every_path

BODIES = ("a", "b", "c", "d")


def at(name: str, body: str) -> Channel:
    return Channel(name, (PointTerm(Point(body, "1"), np.eye(6)[0]),), "translation")


def joint(name: str, first: str, second: str) -> Joint:
    return Joint(name, Point(first, f"to_{second}"), Point(second, f"to_{first}"))


CHAIN = (joint("ab", "a", "b"), joint("bc", "b", "c"))


@pytest.mark.parametrize(
    ("joints", "ground", "actuators", "sensors", "off"),
    [
        # An appendage of the path loads it, so it counts; only the island d does not.
        (CHAIN, (), [at("f", "a")], [at("y", "b")], {"d": "an actuator or a sensor"}),
        (
            CHAIN,
            (),
            [at("f", "a")],
            [at("y", "d")],
            {"a": "a sensor", "b": "a sensor", "c": "a sensor", "d": "an actu"},
        ),
        (
            CHAIN[:1],
            (),
            [at("f", "a"), at("g", "c")],
            [at("y", "b")],
            {"c": "a sensor", "d": "an actuator or a sensor"},
        ),
        # What the ground holds passes nothing on.
        (CHAIN, (Point("b", "to_c"),), [at("f", "a")], [at("y", "a")], {"c": "an actuator", "d": "an actuator"}),
        (CHAIN, (Point("c", "to_b"),), [at("f", "a")], [at("y", "a")], {"c": "an actuator", "d": "an actuator"}),
        # Elsewhere on the body it holds it, and the path goes on.
        (CHAIN, (Point("b", "foot"),), [at("f", "a")], [at("y", "c")], {"d": "an actuator"}),
        # A motor moves both sides, a strut both its ends, but only those it reaches.
        (CHAIN[:1], (), [Channel("m", (JointTerm("ab", 5),), "rotation")], [at("y", "b")], {"c": "an", "d": "an"}),
        (
            (),
            (),
            [Channel("s", (StrutTerm(Point("a", "1"), Point("b", "1")),), "translation")],
            [at("y", "a"), at("z", "b")],
            {"c": "an", "d": "an"},
        ),
    ],
)
def test_bodies_off_every_path(
    joints: Sequence[Joint],
    ground: Sequence[Point],
    actuators: Sequence[Channel],
    sensors: Sequence[Channel],
    off: dict[str, str],
) -> None:
    scene = Scene(
        BODIES, (0.0, 1.0), tuple(joints), actuators=tuple(actuators), sensors=tuple(sensors), ground=tuple(ground)
    )
    found = off_every_path(scene)
    assert found.keys() == off.keys()
    for body, words in off.items():
        assert f"leads from it to {words}" in found[body]


@pytest.mark.parametrize(("actuators", "sensors"), [([at("f", "a")], []), ([], [at("y", "a")]), ([], [])])
def test_without_a_response_every_body_is_wanted_for_itself(
    actuators: Sequence[Channel], sensors: Sequence[Channel]
) -> None:
    assert not off_every_path(Scene(BODIES, (0.0, 1.0), actuators=tuple(actuators), sensors=tuple(sensors)))
