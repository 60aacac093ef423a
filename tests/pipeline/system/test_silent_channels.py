"""Channels that are silent in the reference model: symmetric bodies have many, and rounding must not fail them."""

from types import SimpleNamespace

import numpy as np
import pytest

from cmsreduce.pipeline.system.model_errors import _frf_error, _share_alone

FEW = np.array([1.0, 2.0, 3.0])
REACH = np.array([4.0, 2.0, 1e-3])[:, None, None] * np.ones((3, 2, 1))


def shares(elastic: np.ndarray) -> np.ndarray:
    """Shares of a model whose elastic responses in two channels are given; the second is silent in the reference."""
    silent = np.array([[True], [False]])
    comparison = SimpleNamespace(responding=lambda _: (silent, REACH), few=FEW)
    assembled = SimpleNamespace(response=lambda *_: elastic + 7.0, rigid_response=lambda *_: np.full(REACH.shape, 7.0))
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
