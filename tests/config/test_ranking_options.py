"""Short and long forms of what a ranking takes account of."""

import pytest
from pydantic import ValidationError

from cmsreduce.config import RankingKeys

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
    assert (keys.scaling.value, keys.scaling.unit) == (value, unit)
    assert keys.model_dump(mode="json")["scaling"] == plain


def test_defaults_and_words():
    assert (DEFAULT.weighting, DEFAULT.scaling) == (None, "auto")
    assert (DEFAULT.clusters.correlation, DEFAULT.clusters.rotate) == (0.1, False)
    assert (RankingKeys(scaling="none").scaling, RankingKeys(clusters="none").clusters.correlation) == ("none", 1.0)
    assert DEFAULT.model_dump(mode="json")["scaling"] == "auto"


@pytest.mark.parametrize(
    ("written", "correlation", "rotate"),
    [(0.3, 0.3, False), ("none", 1.0, False), ({"rotate": True}, 0.1, True), ({"correlation": "none"}, 1.0, False)],
)
def test_clusters(written, correlation, rotate):
    keys = RankingKeys(clusters=written)
    assert (keys.clusters.correlation, keys.clusters.rotate) == (correlation, rotate)
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
        ({"clusters": 1.5}, "between 0 and 1"),
        ({"clusters": True}, "between 0 and 1"),
        ({"clusters": {"correlation": 0}}, "between 0 and 1"),
        ({"clusters": {"rotate": 1}}, "bool"),
        ({"keep": {"total": 5}}, "take rank system-cost"),
        ({"keep": {"total": 5, "modes": 3}, "rank": "system-cost"}, "modes and total are two rules"),
        ({"rank": "hankels"}, "hankel"),
    ],
)
def test_mistakes(keys, words):
    with pytest.raises(ValidationError, match=words):
        RankingKeys(**keys)
