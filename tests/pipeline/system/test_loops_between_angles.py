"""Errors of a closed loop at angles between those of the scene."""

from __future__ import annotations

import importlib
from dataclasses import replace

import numpy as np
import pytest

from cmsreduce.model import Configuration
from cmsreduce.pipeline.system import AssembledModel, Comparison, ReducedModel, ReferenceModel
from tests.assemble.response.test_near_modes import four_bar

# The module, and not the function of the same name that it holds.
RESIDUAL = importlib.import_module("cmsreduce.assemble.response.residual_flexibility")


def test_errors_are_those_by_the_forces_in_all_joints(monkeypatch: pytest.MonkeyPatch) -> None:
    subs, scene = four_bar()
    few = {name: np.arange(12) for name in ("crank", "coupler", "rocker")}
    turned = [Configuration(f"{angle}", {("a", 5): angle}, between=True) for angle in (-0.7, 0.2, 0.5)]

    def errors(configurations: list[Configuration]) -> np.ndarray:
        full = AssembledModel(subs, replace(scene, configurations=(Configuration("as built"),)))
        comparison = Comparison(ReferenceModel(full, {}, {}), 100)
        return comparison.screened(configurations, ReducedModel(full.narrowed(few), {}))

    found = errors(turned)
    # The angles of the other joints that close the loop, by the triangles of the linkage, are found before.
    full = AssembledModel(subs, scene)
    closed = [replace(full.closed(each), between=False) for each in turned]
    assert [full.closed(each) is each for each in closed] == [True] * 3
    monkeypatch.setattr(RESIDUAL, "_FEWEST_FORCES", 1000)
    np.testing.assert_allclose(found, errors(closed), rtol=1e-9)
    assert (found > 1e-3).all()
