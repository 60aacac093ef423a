"""Short and long forms of what a ranking takes account of."""

import pytest
from pydantic import ValidationError

from cmsreduce.config import RankingKeys
from cmsreduce.model import Units

DEFAULT = RankingKeys()


@pytest.mark.parametrize(
    ("written", "found"),
    [
        ("band", {"scene_band": True}),
        ({"scene_band": True, "order": 1}, {"scene_band": True, "order": 1}),
        ({"band_pass": ["0.1 Hz", "5 Hz"]}, {"band_pass": (0.1, 5.0)}),
        ({"low_pass": "120 rpm"}, {"low_pass": 2.0, "order": 2}),
        ({"numerator": [1, 0], "denominator": [1, 6.0]}, {"numerator": (1.0, 0.0), "denominator": (1.0, 6.0)}),
    ],
)
def test_weighting(written, found):
    keys = RankingKeys(weighting=written).weighting
    assert {name: getattr(keys, name) for name in found} == found
    assert RankingKeys.model_validate(RankingKeys(weighting=written).model_dump(mode="json")).weighting == keys


@pytest.mark.parametrize(
    ("written", "value", "unit", "plain"),
    [("300 mm", 300.0, "mm", "300.0 mm"), (0.3, 0.3, "", 0.3)],
)
def test_scaling_by_a_length(written, value, unit, plain):
    keys = RankingKeys(scaling=written)
    length = keys.scaling.length
    assert (length.value, length.unit) == (value, unit)
    assert keys.model_dump(mode="json")["scaling"] == {"length": plain, "inputs": {}, "outputs": {}}
    assert RankingKeys.model_validate(keys.model_dump(mode="json")) == keys


def test_defaults_and_words():
    assert (DEFAULT.weighting, DEFAULT.scaling.length) == (None, "auto")
    assert DEFAULT.clusters.correlation == 0.1
    assert (RankingKeys(scaling="none").scaling.length, RankingKeys(clusters="none").clusters.correlation) == (
        "none",
        1.0,
    )
    assert DEFAULT.model_dump(mode="json")["scaling"]["length"] == "auto"


@pytest.mark.parametrize(
    ("written", "units", "kind", "worth"),
    [
        (2, "mm-t-s", None, 2.0),
        # A newton is the force unit of m-kg-s and of mm-t-s; its metre is a thousand of the latter's.
        ("5 N", "m-kg-s", "force", 5.0),
        ("5 N", "mm-t-s", "force", 5.0),
        ("0.5kN", "m-kg-s", "force", 500.0),
        ("1 lbf", "m-kg-s", "force", 4.4482216152605),
        ("2 Nm", "m-kg-s", "torque", 2.0),
        ("2 N m", "mm-t-s", "torque", 2000.0),
        ("2 N*m", "m-g-s", "torque", 2000.0),
        ("3 mNm", "m-kg-s", "torque", 0.003),
        ("1 mm", "m-kg-s", "length", 1e-3),
        ("1 in", "mm-t-s", "length", 25.4),
        ("180 deg", "m-kg-s", "angle", 3.141592653589793),
        ("1 mm/s", "mm-t-s", "velocity", 1.0),
        ("1 deg/s", "m-kg-s", "angular velocity", 0.017453292519943295),
        ("60 rpm", "m-kg-s", "angular velocity", 6.283185307179586),
    ],
)
def test_sizes_of_channels(written, units, kind, worth):
    keys = RankingKeys(scaling={"outputs": {"gyro.rx": written}})
    assert keys.scaling.outputs["gyro.rx"].value_in(Units.parse(units), kind) == pytest.approx(worth, rel=1e-12)
    assert keys.model_dump(mode="json")["scaling"]["outputs"] == {"gyro.rx": written}
    assert RankingKeys.model_validate(keys.model_dump(mode="json")) == keys


@pytest.mark.parametrize(
    ("written", "correlation"),
    [(0.3, 0.3), ("none", 1.0), ({}, 0.1), ({"correlation": 0.2}, 0.2), ({"correlation": "none"}, 1.0)],
)
def test_clusters(written, correlation):
    keys = RankingKeys(clusters=written)
    assert keys.clusters.correlation == correlation
    assert RankingKeys.model_validate(keys.model_dump(mode="json")) == keys


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"weighting": "bands"}, "`band` or a mapping is expected"),
        ({"weighting": {}}, "found none of them"),
        ({"weighting": {"low_pass": 2, "numerator": [1]}}, "found low_pass and numerator"),
        ({"weighting": {"low_pass": "2 m"}}, "is a length, a frequency is expected"),
        ({"weighting": {"low_pass": 2, "order": 3}}, "less than or equal to 2"),
        ({"scaling": "45 deg"}, "a length above zero"),
        ({"scaling": 0}, "a length above zero"),
        ({"scaling": "automatic"}, "is not a number"),
        ({"scaling": {"inputs": {"motor": "0 Nm"}}}, "above zero"),
        ({"scaling": {"inputs": {"motor": -1}}}, "above zero"),
        ({"scaling": {"outputs": {"gyro": "1 s"}}}, "no size of an effort or a motion"),
        ({"scaling": {"outputs": {"gyro": "5 /s"}}}, "no size of an effort or a motion"),
        ({"scaling": {"outputs": {"gyro": True}}}, "is not a number"),
        ({"clusters": 1.5}, "between 0 and 1"),
        ({"clusters": True}, "between 0 and 1"),
        ({"clusters": {"correlation": 0}}, "between 0 and 1"),
        ({"keep": {"total": 5}}, "take rank system-cost"),
        ({"keep": {"total": 5, "modes": 3}, "rank": "system-cost"}, "modes and total are different rules"),
        ({"rank": "hankels"}, "hankel"),
        ({"rank": "peak-amplitude"}, "write gregory, which gives the same order"),
        ({"rank": "moore"}, "ranks states, not modes. A body cut to balanced states has no mass"),
        ({"keep": {"states": {"rotor": [1, 2]}}}, "modes are kept, not states.*balanced_states: 12"),
    ],
)
def test_mistakes(keys, words):
    with pytest.raises(ValidationError, match=words):
        RankingKeys(**keys)
