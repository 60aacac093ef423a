"""Random scenes of every mode set against a dense model of the same scene, made from the geometry alone.

`python benchmarks/random_scenes.py` runs a thousand.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.hard.random_scenes.compared import faults

SCENES, GROUP = 200, 10
# Benfield-Hruda beside a neighbour with free motions that carry neither mass nor stiffness: refused.
REFUSED = (32, 57, 142)


@pytest.mark.parametrize("first", range(0, SCENES, GROUP))
def test_random_scenes(first: int, tmp_path: Path) -> None:
    found = []
    for seed in sorted({*range(first, first + GROUP)} - {*REFUSED}):
        folder = tmp_path / str(seed)
        folder.mkdir()
        found += faults(seed, folder)
    assert not found, "\n".join(found)


@pytest.mark.parametrize("seed", REFUSED)
def test_neighbours_without_mass_and_stiffness_are_refused(seed: int, tmp_path: Path) -> None:
    (fault,) = faults(seed, tmp_path)
    assert "motions with neither mass nor stiffness, so that benfield-hruda has no loaded modes" in fault
