"""Two flexible bodies on one hinge in Exudyn, against cmsreduce's own assembly at every angle."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("exudyn")
from tests.consumers.galileo import Galileo

pytestmark = pytest.mark.exudyn

# Six rigid motions of the pair and the spin of one body on the other.
RIGID = 7
BAND = 2 * np.pi * 10.0


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Galileo:
    return Galileo(tmp_path_factory.mktemp("galileo"))


@pytest.mark.parametrize("number", range(4))
def test_frequencies_at_frozen_angles(pair: Galileo, number: int) -> None:
    """Exudyn's linearisation of the turned pair is the system that cmsreduce assembles at that angle."""
    setting = pair.settings[number]
    expected = pair.omega(pair.ranked, setting)
    assert expected.size == 29
    scene, _, _ = pair.scene(pair.ranked, pair.angle(setting))
    found = scene.frequencies()
    assert found[RIGID - 1] < 1e-4 * found[RIGID]
    np.testing.assert_allclose(found[RIGID:], expected, rtol=1e-8)


def test_reduced_bodies_against_full_ones(pair: Galileo) -> None:
    """At an angle far from the one that the files were written at, every frequency in the band from above."""
    setting = pair.settings[3]
    full = pair.omega(None, setting)
    scene, _, _ = pair.scene(pair.reduced, pair.angle(setting))
    found = scene.frequencies()[RIGID:]
    inside = full < BAND
    assert inside.sum() == 58
    ratio = found[: full.size][inside[: found.size]] / full[inside]
    # Craig-Bampton modes to twice the band: from above, and three times what is measured (docs/consumers.md).
    assert ratio.min() > 1 - 1e-8
    assert ratio.max() < 1 + 1e-4
