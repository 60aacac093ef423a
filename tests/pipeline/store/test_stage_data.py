"""Results that come back from the store are equal to those that were stored."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.model import ChannelZeros, CutoffRecord, ModeCertificate, ReductionChecks, SystemChecks
from cmsreduce.pipeline.choose import Choice
from cmsreduce.pipeline.store import decode, encode


def test_of_two_bodies_that_lack_the_same_the_first_is_named_again() -> None:
    lack = {"interface 'hinge'": 0.25}
    made = ReductionChecks({"right": lack, "left": lack})
    arrays, facts = encode(made)
    # As the store writes facts.
    back = decode(arrays, json.loads(json.dumps(facts, sort_keys=True)), {})
    assert back.static == made.static
    assert made.figures((), ()) == back.figures((), ()) == {"static_lack": (0.25, "right, interface 'hinge'")}


def stored(value: Any, given: Any = None) -> Any:
    """A value after it was on disk."""
    arrays, facts = encode(value)
    return decode(arrays, json.loads(json.dumps(facts, sort_keys=True)), given or {})


def test_dataclasses_mappings_and_arrays_come_back() -> None:
    choice = stored(Choice({"panel": np.array([7, 9]), "arm": np.empty(0, np.int64)}))
    assert list(choice.selection) == ["panel", "arm"] and choice.selection["arm"].dtype == np.int64
    cutoffs = {"arm": CutoffRecord(2.5, 1e-3, 5e-3, ((1.5, 0.1), (2.0, 0.01)))}
    assert stored(cutoffs) == cutoffs
    certificate = stored(ModeCertificate(60.0, None, np.array([1.0, 2.0]), np.array([1e-9, np.nan])))
    assert certificate.counted is None and np.isnan(certificate.bound[1])
    assert stored({1: (np.float64(2.0), float("inf")), "b": [None, True]}) == {
        1: (2.0, float("inf")),
        "b": [None, True],
    }
    assert stored(np.array([1 + 2j])).dtype == np.complex128


def test_parts_of_unequal_length_and_names_of_any_kind_are_no_trouble() -> None:
    pairs = tuple(ChannelZeros(0, k, np.ones(k), np.zeros(2), np.zeros(k), np.arange(k)) for k in range(3))
    arrays, _ = encode({"a/b": SystemChecks("hinge=50", zeros=pairs)})
    assert "0.zeros.2.full" in arrays and not any("/" in name for name in arrays)
    back = stored({"a/b": SystemChecks("hinge=50", zeros=pairs)})["a/b"]
    assert [pair.judged.tolist() for pair in back.zeros] == [[], [0], [0, 1]]


def test_bodies_are_named_and_not_stored() -> None:
    from tests.pipeline.study import arm

    body = arm()
    arrays, facts = encode((body, 1))
    assert not arrays
    assert decode(arrays, facts, {"FEModel": {"arm": body}}) == (body, 1)


@pytest.mark.parametrize("value", [sp.eye_array(3), object(), {"a": print}])
def test_what_cannot_be_stored_is_refused(value: Any) -> None:
    with pytest.raises(TypeError, match="which no stage can store"):
        encode(value)


@pytest.mark.parametrize(
    "kind", ["os:system", "subprocess:Popen", "cmsreduce.model:FEModel.rows", "cmsreduce.cli:main"]
)
def test_a_stage_file_makes_dataclasses_of_the_package_and_nothing_else(kind: str) -> None:
    with pytest.raises((TypeError, AttributeError)):
        decode({}, {"class": kind, "fields": {}}, {})
