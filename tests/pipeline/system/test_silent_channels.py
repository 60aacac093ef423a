"""Channels that are silent in the reference model: symmetric bodies have many, and rounding must not fail them."""

import tracemalloc
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from cmsreduce.model import Channel
from cmsreduce.pipeline.system.assembled import AssembledModel
from cmsreduce.pipeline.system.model_errors import _frf_error, _share_alone
from tests.assemble.rigs import at, strut
from tests.pipeline.system.test_damped_peaks import HERE, hinged

FEW = np.array([1.0, 2.0, 3.0])
REACH = np.array([4.0, 2.0, 1e-3])[:, None, None] * np.ones((3, 2, 1))


def shares(elastic: np.ndarray) -> np.ndarray:
    """Shares of a model whose elastic responses in two channels are given; the second is silent in the reference."""
    silent = np.array([[True], [False]])
    comparison = SimpleNamespace(responding=lambda _: (silent, REACH), few=FEW)
    assembled = SimpleNamespace(
        response=lambda *_: elastic + 7.0, rigid_response=lambda *_: np.full(REACH.shape, 7.0), calm=lambda *_: None
    )
    return _share_alone(comparison, None, SimpleNamespace(assembled=assembled))  # type: ignore[arg-type]


@pytest.mark.parametrize(("last", "share"), [(2e-9, 2e-6), (5e-4, 0.5), (1e-10, 0.0)])
def test_a_response_of_the_reduced_model_alone_is_a_share_of_what_the_channel_could_have(last, share) -> None:
    elastic = np.array([[1.0, 0.0], [1.0, 1e-12], [1.0, last]])[:, :, None]
    assert shares(elastic + 0j) == pytest.approx(np.array([[0.0], [share]]), rel=1e-5)


def test_the_share_is_the_error_of_a_unit_that_is_silent_otherwise() -> None:
    H = np.array([[1.0, 0.0], [1.0, 0.0]])[:, :, None] + 0j
    H_r = np.array([[1.01, 0.3], [1.01, 0.3]])[:, :, None] + 0j
    target = SimpleNamespace(omega=np.array([1.0, 2.0]), elastic=H, row=np.array([1.0, 0.0]), column=np.ones(1))
    measured = [_frf_error(target, H_r, np.array([[0.0], [share]])) for share in (0.3, 2e-6)]  # type: ignore[arg-type]
    assert measured == pytest.approx([0.3, 0.01])


def test_a_stretch_beside_rigid_motion_has_a_decibel_error() -> None:
    """A thousandth of the band's top makes rigid motion a million times as large as at the top; a stretch stays."""
    comparison, model = hinged(1.0, at("far.b", "y"), strut("near.a", "near.b"))
    (result,) = comparison.at([HERE], {"reduced": model})
    errors = result.errors["reduced"]
    assert errors.loud is not None and errors.loud.all()
    w = comparison.reference.decibel_grid
    H, H_r = (abs(m.response(HERE, w)[:, 1, 0]) for m in (comparison.reference.assembled, model.assembled))
    assert H.max() < 1e-7 < abs(result.response.full[:, 0, 0]).max() / 1e7
    expected = np.percentile(abs(20 * np.log10(H_r / H)), 99)
    assert expected > 1e-4 and errors.channel_db[1, 0] == pytest.approx(expected, rel=1e-9)
    (screened,) = comparison.screened([HERE], model)
    assert screened[1] == pytest.approx(errors.db_error, rel=1e-6)
    worse = SimpleNamespace(assembled=model.assembled.narrowed({"near": np.arange(8)}))
    (screened,) = comparison.screened([HERE], worse)  # type: ignore[arg-type]
    assert np.isfinite(screened).all() and screened[1] > 10 * errors.db_error


def test_the_reach_of_many_sensors_is_that_of_each_alone() -> None:
    """All together would take 100 MB for the responses of each to efforts on every other."""
    axes = np.eye(6)
    many = [at("far.b" if k % 5 else "near.a", axes[k % 6].tolist(), f"sensor {k}") for k in range(600)]
    model = hinged(1.0, *many)[0].reference.assembled
    tracemalloc.start()
    _, reach = model.collocated(HERE, FEW)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 25e6
    ((push,), sensors) = model.scene.actuators, model.scene.sensors

    def own(channel: Channel) -> np.ndarray:
        scene = replace(model.scene, actuators=(channel,), sensors=(channel,))
        return abs(AssembledModel(model.substructures, scene).response(HERE, FEW)[:, 0, 0])

    expected = np.sqrt([own(push) * own(sensor) for sensor in sensors[-7:]])
    np.testing.assert_allclose(reach[:, -7:, 0], expected.T, rtol=1e-9)
