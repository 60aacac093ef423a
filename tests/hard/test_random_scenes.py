"""Random scenes of every mode set against a dense model of the same scene, made from the geometry alone.

`python benchmarks/random_scenes.py` runs a thousand.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.hard.random_scenes.compared import faults

SCENES, GROUP = 200, 10


@pytest.mark.parametrize("first", range(0, SCENES, GROUP))
def test_random_scenes(first: int, tmp_path: Path) -> None:
    found = []
    for seed in range(first, first + GROUP):
        folder = tmp_path / str(seed)
        folder.mkdir()
        found += faults(seed, folder)
    assert not found, "\n".join(found)
