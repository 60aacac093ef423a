"""Components that are `like` another one: keys that win, and refusals with their place."""

import re

import pytest

from cmsreduce.config import load_pipeline, pipeline_from_keys
from cmsreduce.errors import ConfigError

WHEELS = """\
name: cart
components:
  frame:
    rigid: {mass: 10, inertia: [1, 1, 1, 0, 0, 0]}
    interfaces: {left: {position: [0, 1, 0]}, right: {position: [0, -1, 0]}}
  wheel:
    stiffness: {file: wheel.op4, matrix: KAA}
    mass: {file: wheel.op4, matrix: MAA}
    geometry: wheel.bdf
    interfaces: {hub: {node: 1}}
    damping: {modal: 0.01}
    place: {at: [0, 1, 0]}
  right:
    like: wheel
    place: {at: [0, -1, 0]}
    damping: {structural: 0.02}
    interfaces: {rim: 7}
    reduce: {cutoff: 4}
scene: {band: 10 Hz, ground: frame.left}
"""


def load(tmp_path, text=WHEELS, overrides=()):
    path = tmp_path / "cart.yaml"
    path.write_text(text)
    return load_pipeline(path, overrides)


def test_a_copy_has_the_keys_of_the_original_and_its_own_win(tmp_path):
    parts = load(tmp_path).components
    wheel, right = parts["wheel"], parts["right"]
    assert (right.stiffness, right.mass, right.geometry) == (wheel.stiffness, wheel.mass, wheel.geometry)
    assert right.stiffness.file == tmp_path / "wheel.op4"
    assert [item.value for item in right.place.at] == [0, -1, 0]
    assert right.damping.structural == 0.02 and right.damping.modal is None
    assert {name: face.node for name, face in right.interfaces.items()} == {"hub": 1, "rim": 7}
    assert wheel.reduce is None and right.reduce.cutoff_bands == 4


def test_a_copy_by_an_override_and_from_python(tmp_path):
    overrides = ["components.wheel.damping.modal=0.05", "components.third={like: wheel}"]
    parts = load(tmp_path, overrides=overrides).components
    assert parts["third"].damping.modal == 0.05
    rigid = {"rigid": {"mass": 1, "inertia": [1, 1, 1, 0, 0, 0]}}
    keys = {"name": "two", "components": {"a": rigid, "b": {"like": "a"}}, "scene": {"band": 1}}
    assert pipeline_from_keys(keys, "keys").components["b"].rigid.mass == 1


# What is replaced, by what, words of the line that the message names, the message.
MISTAKES = {
    "unknown name": ("like: wheel", "like: whel", "like: whel",
        "key 'components.right.like': there is no component 'whel', did you mean 'wheel'? There are: frame, wheel"),
    "itself": ("like: wheel", "like: right", "like: right",
        "key 'components.right.like': a component cannot be like itself"),
    "chain": ("scene:", "  third: {like: right}\nscene:", "like: right",
        "key 'components.third.like': 'right' is a copy itself: write `like: wheel`"),
    "circle": ("scene:", "  third: {like: fourth}\n  fourth: {like: third}\nscene:", "like: fourth",
        "in a circle: third -> fourth -> third; one needs matrices"),
    "other matrices": ("    reduce: {cutoff: 4}", "    mass: {file: b.op4}", "b.op4",
        "key 'components.right.mass': 'right' is like 'wheel', which has its own mass: take this key out"),
    "other units": ("    reduce: {cutoff: 4}", "    units: mm-t-s", "units: mm", "which has its own units"),
    "no name": ("like: wheel", "like: 3", "like: 3",
        "key 'components.right.like': found the number 3, expected a text"),
    "misspelt": ("like: wheel", "lik: wheel", "lik:", "key 'components.right.lik' is unknown: did you mean 'like'?"),
}  # fmt: skip


@pytest.mark.parametrize(("old", "new", "at", "words"), MISTAKES.values(), ids=MISTAKES)
def test_mistakes_name_their_line(tmp_path, old, new, at, words):
    text = WHEELS.replace(old, new)
    line = text[: text.index(at)].count("\n") + 1
    with pytest.raises(ConfigError) as refused:
        load(tmp_path, text)
    named = [each for each in str(refused.value).splitlines() if f"cart.yaml:{line}: " in each]
    assert named and words in named[0]


def test_a_mistake_in_the_original_is_listed_once(tmp_path):
    with pytest.raises(ConfigError) as refused:
        load(tmp_path, WHEELS.replace("wheel.bdf", "{fil: wheel.bdf}").replace("{node: 1}", "{position: [0, 0, 0]}"))
    assert set(re.findall(r"key 'components\.(\w+)", str(refused.value))) == {"wheel"}
    with pytest.raises(ConfigError) as refused:
        load(tmp_path, WHEELS.replace("{node: 1}", "{position: [0, 0, 0]}"))
    assert set(re.findall(r"key 'components\.(\w+)", str(refused.value))) == {"wheel"}
