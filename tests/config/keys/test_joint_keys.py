"""Springs, dampers and inertias of joints as they are written: units against their definitions, and messages."""

import math

import pytest

from cmsreduce.config import build_scene, load_pipeline
from cmsreduce.config.keys.quantities import parse_compound
from cmsreduce.errors import CmsReduceError, UnitsError
from cmsreduce.model import JointElement, Units

SI, MM, INCH = (Units.parse(name) for name in ("SI", "mm-t-s", "in-slinch-s"))
POUND_INCH = 4.4482216152605 * 0.0254


@pytest.mark.parametrize(
    ("written", "figure", "rotation", "units", "worth"),
    [
        ("120 N*m/rad", "stiffness", True, SI, 120.0),
        ("120 N m/rad", "stiffness", True, SI, 120.0),
        ("120 N·m", "stiffness", True, SI, 120.0),
        ("1 N*m/deg", "stiffness", True, SI, 180 / math.pi),
        ("2 in*lbf/rad", "stiffness", True, SI, 2 * POUND_INCH),
        ("120 N*m/rad", "stiffness", True, MM, 120e3),
        ("2 in*lbf/rad", "stiffness", True, INCH, 2.0),
        ("5 N/mm", "stiffness", False, SI, 5e3),
        ("5 N/mm", "stiffness", False, MM, 5.0),
        ("0.4 N*m*s/rad", "damping", True, SI, 0.4),
        ("0.4 N*m*s/rad", "damping", True, MM, 400.0),
        ("3 N*s/m", "damping", False, SI, 3.0),
        ("3 kN*ms/mm", "damping", False, SI, 3e3),
        ("1e-3 kg*m^2", "inertia", True, SI, 1e-3),
        ("1e-3 kg*m²", "inertia", True, SI, 1e-3),
        ("1e-3 kg*m**2", "inertia", True, MM, 1.0),
        ("2 N*m*s^2/rad", "inertia", True, SI, 2.0),
        (1e-3, "inertia", True, MM, 1e-3),
        ("7", "stiffness", True, INCH, 7.0),
    ],
)
def test_worth(written, figure, rotation, units, worth):
    assert parse_compound(written).figure_in(units, figure, rotation) == pytest.approx(worth, rel=1e-14)


def test_a_text_reads_back():
    written = parse_compound("0.1 N*m*s/rad")
    assert parse_compound(str(written)) == written


@pytest.mark.parametrize(
    ("written", "words"),
    [
        ("120 N*furlong", "unknown unit 'furlong'"),
        ("N*m", "is not a number with units, e.g. 120 N"),
        ("3 /s", "is no product of units"),
        ("1 N**m", "is no product of units"),
        ("1e200 N*m", "is not a number with units"),
        (True, "is not a number"),
        (float("nan"), "is not a number"),
    ],
)
def test_refused_texts(written, words):
    with pytest.raises(UnitsError, match=words.replace("*", r"\*")):
        parse_compound(written)


def joint_of(galileo, *overrides):
    return build_scene(load_pipeline(galileo, overrides)).joints[0]


def test_elements_of_a_joint(galileo):
    spin = joint_of(
        galileo,
        "scene.joints.spin.stiffness={rz: 120 N*m/rad}",
        "scene.joints.spin.damping={rz: 0.4 N*m*s/rad}",
        "scene.joints.spin.inertia={6: 1e-3 kg*m^2}",
    )
    assert spin.elements == (JointElement(5, 120.0, 0.4, 1e-3),)
    assert spin.own_body == "joint spin"
    assert joint_of(galileo).elements == ()


def test_all_motions_free_and_what_the_scene_says_of_redundancy(galileo):
    overrides = (
        "scene.joints.spin.free=all",
        "scene.redundant=drop",
        "scene.floating=platform",
        "scene.articulation=null",
    )
    scene = build_scene(load_pipeline(galileo, overrides))
    assert scene.joints[0].free == set(range(6))
    assert (scene.redundant, scene.floating) == ("drop", ("platform",))


@pytest.mark.parametrize(
    ("override", "words"),
    [
        ("stiffness={rx: 5 N*m/rad}", "stiffness: rx is locked, free are: rz"),
        ("stiffness={rz: 5 N/m}", "is no stiffness about an axis, e.g. 120 N"),
        ("damping={rz: 5 N*m/rad}", "is no damping about an axis, e.g. 0.4 N"),
        ("damping={rz: -5}", "damping: -5.0 is negative"),
        ("inertia={rz: 5 kg}", "is no inertia about an axis, e.g. 1e-3 kg"),
        ("inertia={rw: 5}", "'rw' is no dof"),
    ],
)
def test_refused_keys(galileo, override, words):
    with pytest.raises(CmsReduceError, match=words):
        joint_of(galileo, f"scene.joints.spin.{override}")


def test_an_inertia_does_not_slide(galileo):
    with pytest.raises(CmsReduceError, match="x is a translation, and a sliding mass acts in every direction"):
        joint_of(galileo, "scene.joints.spin.free=[x, rz]", "scene.joints.spin.inertia={x: 5}")


def test_a_floating_body_must_be_there(galileo):
    with pytest.raises(
        CmsReduceError, match=r"scene\.floating.*there is no component 'platfrm', did you mean 'platform'"
    ):
        load_pipeline(galileo, ["scene.floating=[platfrm]"])
