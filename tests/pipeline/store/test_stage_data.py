"""Checks that come back from the store say what they said when they were made."""

from __future__ import annotations

import json

from cmsreduce.model import ReductionChecks
from cmsreduce.pipeline.store import decode, encode


def test_of_two_bodies_that_lack_the_same_the_first_is_named_again() -> None:
    lack = {"interface 'hinge'": 0.25}
    made = ReductionChecks({"right": lack, "left": lack})
    arrays, facts = encode(made)
    # As the store writes facts.
    back = decode(arrays, json.loads(json.dumps(facts, sort_keys=True)), {})
    assert back.static == made.static
    assert made.figures((), ()) == back.figures((), ()) == {"static_lack": (0.25, "right, interface 'hinge'")}
