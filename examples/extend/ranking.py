"""A ranking of your own: the size of each mode in the static response (docs/extend.md).

Its place would be cmsreduce/balance/static_gain.py.
"""

from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

import cmsreduce as cms
from cmsreduce.balance import Ranking
from cmsreduce.model import ModalChannels


class StaticGain(Ranking):
    """Size of each mode in the static response, |c_i| |b_i| / w_i^2; damping has no part in it."""

    name: ClassVar[str] = "static-gain"

    def coefficients(self, channels: ModalChannels) -> NDArray[np.float64]:
        """See `Ranking.coefficients`."""
        b, c = np.linalg.norm(channels.B, axis=1), np.linalg.norm(channels.C1, axis=0)
        gain: NDArray[np.float64] = b * c / channels.omega**2
        return gain


SAMPLE = Path(__file__).parents[2] / "sample_models" / "hub_beams"


def test_one_mode_by_hand() -> None:
    """With b = 3, c = 4 and w = 2 the gain is 3."""
    one = ModalChannels(
        "body", np.array([2.0]), np.array([0.01]), np.array([[3.0]]), np.array([[4.0]]), np.zeros((0, 1))
    )
    assert StaticGain().coefficients(one).tolist() == [3.0]


def test_modes_of_a_beam() -> None:
    """The ranking works at once, by its class or by its name."""
    body = cms.read_body(
        "right",
        stiffness=(f"{SAMPLE}/right.op4", "KFF"),
        mass=(f"{SAMPLE}/right.op4", "MFF"),
        geometry=f"{SAMPLE}/right.bdf",
        interfaces={"hinge": 101},
    )
    beam = cms.orthogonalise(cms.CraigBampton(cutoff_hz=64).reduce(body))
    ranked = cms.balance(beam, StaticGain(), keep=3)
    assert ranked.elastic_count == 3
    assert "static-gain" in ranked.table["why"].iloc[-1]
