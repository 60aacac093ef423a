"""Rankings as a pipeline asks for them."""

from dataclasses import replace

import numpy as np
import pytest

from cmsreduce.balance import RANKINGS, Hankel, characteristic_length, component_costs
from cmsreduce.config import RankingKeys
from cmsreduce.pipeline.choose.ranked import ranked, ranking_channels


@pytest.fixture
def run(opened):
    return opened("balance={rank: gregory, keep: all}")


def given(run, name="arm", **keys):
    return ranked(run.modal(name), run.bodies[name].ports, RankingKeys(**keys), run.scene)


def test_every_ranking_stands_in_the_table(run):
    for name in RANKINGS:
        found = given(run, rank=name)
        assert set(found.rankings) == set(RANKINGS)
        np.testing.assert_array_equal(found.sigma, found.rankings[name])
        assert np.isnan(found.sigma[:6]).all() and np.isfinite(found.sigma[found.elastic]).all()
        kept = found.truncated([6, 8])
        np.testing.assert_array_equal(kept.rankings["hankel"], found.rankings["hankel"][[*range(6), 6, 8]])


def test_rotations_are_scaled_by_the_bodys_length(run):
    """The arm's interfaces: six motions of either end, displacements and rates."""
    component, ports = run.modal("arm"), run.bodies["arm"].ports
    plain, auto, half = (
        ranking_channels(component, ports, RankingKeys(scaling=s), run.scene) for s in ("none", "auto", "500 mm")
    )
    turns = component.body.dofs.component[ports.interface] > 3
    for found, length in ((auto, characteristic_length(component.body)), (half, 0.5)):
        factor = np.where(turns, length, 1.0)
        np.testing.assert_allclose(found.B[:, : turns.size], plain.B[:, : turns.size] * factor, rtol=1e-14)
        np.testing.assert_allclose(found.C1[: turns.size], plain.C1[: turns.size] * factor[:, None], rtol=1e-14)
        np.testing.assert_allclose(found.C2[: turns.size], plain.C2[: turns.size] * factor[:, None], rtol=1e-14)


@pytest.mark.parametrize(
    ("weighting", "gain"),
    [
        ({"low_pass": 30.0, "order": 1}, lambda w: 1 / np.sqrt(1 + (w / (60 * np.pi)) ** 2)),
        ({"numerator": [1.0, 0.0]}, lambda w: w),
        ("band", lambda w: 1 / np.sqrt(1 + (w / (120 * np.pi)) ** 4)),
        ({"band_pass": [0, 60.0]}, lambda w: 1 / np.sqrt(1 + (w / (120 * np.pi)) ** 4)),
    ],
)
def test_weighting_by_hand(run, weighting, gain):
    """The scene's band ends at 60 Hz."""
    plain, found = given(run), given(run, weighting=weighting)
    e = plain.elastic
    np.testing.assert_allclose(found.sigma[e], plain.sigma[e] * gain(plain.omega[e]), rtol=1e-12)


def test_clusters_are_as_wide_as_asked(run):
    component, ports = run.modal("arm"), run.bodies["arm"].ports
    channels = ranking_channels(component, ports, RankingKeys(), run.scene)
    for written, limit in ((0.5, 0.5), ("none", 1.0)):
        found = given(run, rank="hankel", clusters=written)
        np.testing.assert_array_equal(found.sigma[found.elastic], Hankel(limit).coefficients(channels))


def test_an_undamped_body_has_the_rankings_that_need_no_damping(opened):
    run = opened("balance={rank: modal-gain, keep: all}", "components.arm.damping=null")
    found = given(run, rank="modal-gain")
    assert set(found.rankings) == {"modal-gain", "frequency"}


@pytest.mark.parametrize("rank", ["hankel", "component-cost"])
@pytest.mark.parametrize(
    ("weighting", "band"), [("band", (0.0, 60.0)), ({"band_pass": ["20 Hz", "40 Hz"]}, (20.0, 40.0))]
)
def test_a_band_limits_the_gramians_of_a_body(run, rank, weighting, band):
    """Of the scene, or another: not the gain at each mode's frequency, but what happens within."""
    component, ports = run.modal("panel"), run.bodies["panel"].ports
    channels = ranking_channels(component, ports, RankingKeys(), run.scene)
    limits = (2 * np.pi * band[0], 2 * np.pi * band[1])
    plain, found = given(run, "panel", rank=rank), given(run, "panel", rank=rank, weighting=weighting)
    e = found.elastic
    np.testing.assert_array_equal(found.sigma[e], RANKINGS[rank].band_coefficients(channels, limits))
    if rank == "component-cost":
        # Mean square of one output under white noise in the band: the shares sum to the integral of |H|^2.
        w = np.linspace(*limits, 200001)
        receptance = 1 / (channels.omega**2 - w[:, None] ** 2 + 2j * channels.zeta * channels.omega * w[:, None])
        b, c = channels.B[:, 0], channels.C1[2]
        alone = replace(channels, B=channels.B[:, :1], C1=channels.C1[2:3], C2=channels.C2[:0])
        power = np.trapezoid(abs(receptance @ (b * c)) ** 2, w) / np.pi
        assert component_costs(alone, limits).sum() == pytest.approx(power, rel=1e-5)
    assert not np.allclose(found.sigma[e] / plain.sigma[e], found.sigma[e][0] / plain.sigma[e][0], rtol=0.01)
