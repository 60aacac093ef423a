"""Damping laws."""

import numpy as np
import pytest

from cmsreduce.errors import DampingError
from cmsreduce.model import Damping

OMEGA = 2 * np.pi * np.array([1.0, 5.0, 20.0])


@pytest.mark.parametrize(
    ("law", "ratios", "on_modes"),
    [
        ({"modal": 0.01}, [0.01] * 3, True),
        ({"table": ((2.0, 0.01), (10.0, 0.05))}, [0.01, 0.025, 0.05], True),
        ({"per_mode": (0.1, 0.2)}, [0.1, 0.2, 0.2], True),
        ({"rayleigh": (2 * np.pi, 1 / (20 * np.pi))}, [0.55, 0.35, 1.025], False),
        ({"structural": 0.04}, [0.02] * 3, False),
        ({}, [0.0] * 3, False),
    ],
    ids=lambda value: next(iter(value), "none") if isinstance(value, dict) else "",
)
def test_ratios(law, ratios, on_modes):
    damping = Damping(**law)
    assert damping.law == next(iter(law), "none")
    assert damping.acts_on_modes is on_modes
    np.testing.assert_allclose(damping.ratios(OMEGA), ratios, rtol=1e-13)
    np.testing.assert_allclose(damping.scaled(5.0).ratios(OMEGA), 5 * np.array(ratios), rtol=1e-13)
    assert damping.scaled(5.0).law == damping.law


def test_ratios_of_a_repeated_mode_do_not_depend_on_its_shapes():
    # 1 % and 3 % of two shapes of one space: in another basis shares of each; their sum stays.
    ratios = Damping(per_mode=(0.01, 0.03, 0.05)).ratios(np.array([5.0, 5.0 * (1 + 1e-12), 5.0001]))
    np.testing.assert_allclose(ratios, [0.02, 0.02, 0.05], rtol=1e-13)


@pytest.mark.parametrize(
    ("law", "message"),
    [
        ({"modal": 0.0}, "modal: 0 is not positive"),
        ({"modal": -0.01}, r"modal: -0\.01 is not positive"),
        ({"modal": float("nan")}, "not a finite number"),
        ({"per_mode": ()}, "the list is empty"),
        ({"per_mode": (0.1, 0.0)}, "per_mode: 0 is not positive"),
        ({"table": ((1.0, 0.01), (1.0, 0.02))}, "frequencies must increase"),
        ({"table": ((1.0, -0.01),)}, r"table: -0\.01"),
        ({"structural": -0.1}, "structural"),
        ({"rayleigh": (-1.0, 1.0)}, "must not be negative"),
        ({"rayleigh": (0.0, 0.0)}, "nor both zero"),
        ({"modal": 0.1, "structural": 0.1}, "given twice, as modal and structural"),
    ],
    ids=str,
)
def test_refused(law, message):
    with pytest.raises(DampingError, match=message):
        Damping(**law)
