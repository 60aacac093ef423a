"""Bounds of what is lost with modes left out, against the largest singular value of what is lost."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cmsreduce.balance import elastic_norm, hankel_values, keep_bound, mode_bounds
from cmsreduce.config import load_pipeline
from cmsreduce.errors import DampingError
from cmsreduce.model import ModalChannels
from cmsreduce.pipeline import Run, Silent
from cmsreduce.pipeline.choose.selection import modal_channels

GALILEO = Path(__file__).parents[2] / "pipelines" / "galileo.yaml"
# What a sampled peak may lie above its closed form by rounding.
ROUNDING = 1e-12


def channels(omega, zeta, B, C1, C2) -> ModalChannels:
    return ModalChannels("body", *(np.asarray(x, dtype=float) for x in (omega, zeta, B, C1, C2)))


def response(body: ModalChannels, omega: np.ndarray) -> np.ndarray:
    """Largest singular value from the state space, which shares nothing with sums over modes."""
    e = body.count
    A = np.block([[np.zeros((e, e)), np.eye(e)], [-np.diag(body.omega**2), -np.diag(2 * body.zeta * body.omega)]])
    B = np.vstack([np.zeros_like(body.B), body.B])
    C = np.block([[body.C1, np.zeros_like(body.C1)], [np.zeros_like(body.C2), body.C2]])
    return np.array([np.linalg.norm(C @ np.linalg.solve(1j * w * np.eye(2 * e) - A, B + 0j), 2) for w in omega])


def sampled(body: ModalChannels, points: int = 41) -> float:
    """Finely at every resonance, and between them."""
    if not body.count:
        return 0.0
    near = body.omega[:, None] * (1 + body.zeta[:, None] * np.linspace(-4, 4, points))
    wide = np.geomspace(body.omega.min() / 10, body.omega.max() * 10, 60)
    return float(response(body, np.concatenate([[0.0], wide, abs(near).ravel()])).max())


def random_body(seed: int, modes: int, repeated: bool, zeta: float) -> ModalChannels:
    rng = np.random.default_rng(seed)
    w = np.sort(rng.uniform(1, 20, modes))
    if repeated and modes > 2:
        w[1] = w[0] * (1 + rng.choice([0.0, 1e-7, 9e-7]))
        w[2] = w[1]
    z = zeta * rng.uniform(0.5, 2.0, modes)
    if repeated and modes > 2 and rng.random() < 0.5:
        z[:3] = z[0]
    C1, C2 = rng.standard_normal((2, modes)), rng.standard_normal((rng.integers(0, 3), modes))
    return channels(w, z, rng.standard_normal((modes, 2)), C1 * rng.choice([0.0, 1.0]), C2)


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 2**31),
    modes=st.integers(1, 9),
    repeated=st.booleans(),
    zeta=st.sampled_from([1e-4, 0.005, 0.1, 0.45]),
    limit=st.sampled_from([0.02, 0.3, 1.5]),
)
def test_a_bound_is_never_violated(seed, modes, repeated, zeta, limit):
    body = random_body(seed, modes, repeated, zeta)
    kept = keep_bound(body, limit)
    left_out = body.only(np.setdiff1d(np.arange(modes), kept))
    error, bound = sampled(left_out), sum(mode_bounds(left_out)[1])
    norm = elastic_norm(body)
    assert error <= bound * (1 + ROUNDING) and bound <= limit * norm
    # From below, and not by much: what a finer grid finds elsewhere is no larger.
    assert sampled(body, 161) <= norm * (1 + 1e-3) + 1e-300


@pytest.mark.parametrize("zeta", [1e-5, 0.005, 0.2, 0.9])
def test_a_single_mode_has_its_closed_form(zeta):
    w = 7.0
    b, c = np.array([[3.0, 4.0]]), np.array([[1.0], [2.0], [2.0]])
    none = np.zeros((0, 1))
    (displacement,) = mode_bounds(channels([w], [zeta], b, c, none))[1]
    top = 2 * zeta * np.sqrt(1 - zeta**2) if zeta < np.sqrt(0.5) else 1.0
    assert displacement == pytest.approx(15 / (top * w**2), rel=1e-12)
    (rate,) = mode_bounds(channels([w], [zeta], b, none, c))[1]
    assert rate == pytest.approx(15 / (2 * zeta * w), rel=1e-12)
    both = channels([w], [zeta], b, 5 * c, c)
    (bound,) = mode_bounds(both)[1]
    grid = w * (1 + zeta * np.linspace(-1, 1, 20001))
    gain = 15 * np.sqrt(25 + grid**2) / abs(w**2 - grid**2 + 2j * zeta * w * grid)
    assert bound == pytest.approx(gain.max(), rel=1e-7) and bound >= gain.max() * (1 - ROUNDING)
    assert elastic_norm(both) == pytest.approx(bound, rel=1e-12)


@pytest.mark.parametrize("g", [1e-3, 0.2, 0.9])
def test_structural_damping_has_a_bound_of_its_own(g: float) -> None:
    """Of a rate, viscous damping of the ratio g/2 gives less than the loss factor g: by g^2 / 8."""
    w, bodies = 7.0, [channels([7.0], [g / 2], [[1.0]], p * np.ones((1, 1)), q * np.ones((1, 1))) for p, q in RATES]
    bodies += [replace(random_body(seed, 6, True, 0.1), zeta=np.full(6, g / 2)) for seed in range(9)]
    for body in (replace(each, structural=True) for each in bodies):
        at = np.concatenate([[0.0], np.outer(body.omega, 1 + np.linspace(-2 * g, 2 * g, 401)).ravel().clip(0)])
        gain = 1 / (body.omega**2 * (1 + 1j * g) - at[:, None] ** 2)
        H = np.concatenate([np.einsum("oi,fi,ij->foj", C, gain * f, body.B) for C, f in loaded(body, at)], axis=1)
        largest, bound = np.linalg.norm(H, 2, axis=(1, 2)).max(), sum(mode_bounds(body)[1])
        assert largest <= bound * (1 + ROUNDING) and largest <= elastic_norm(body) * (1 + 1e-3)
        if body.count == 1:
            assert elastic_norm(body) == pytest.approx(bound, rel=1e-12) and bound == pytest.approx(largest, rel=1e-3)
    rate = 1 / np.sqrt(2 * (np.sqrt(1 + g**2) - 1)) / w
    assert mode_bounds(replace(bodies[0], structural=True))[1] == pytest.approx([rate], rel=1e-10)


# Weights of displacement and rate of a mode.
RATES = [(0.0, 1.0), (1.0, 0.0), (20.0, 1.0)]


def loaded(body: ModalChannels, at: np.ndarray):
    return (body.C1, np.ones((at.size, 1))), (body.C2, 1j * at[:, None])


def test_a_repeated_mode_is_one_term():
    """Two modes of one frequency that drive different outputs from different inputs: their norms are no sum."""
    two = channels([5.0, 5.0], [0.01, 0.01], np.eye(2), np.eye(2), np.zeros((0, 2)))
    groups, (bound,) = mode_bounds(two)
    assert [g.tolist() for g in groups] == [[0, 1]]
    assert bound == pytest.approx(1 / (2 * 0.01 * np.sqrt(1 - 1e-4) * 25), rel=1e-12)
    assert keep_bound(two, 1.0 + 1e-9).size == 0 and keep_bound(two, 0.99).tolist() == [0, 1]
    # Of opposite sign they leave nothing, and of unlike damping what remains is bounded all the same.
    gone = channels([5.0, 5.0], [0.01, 0.01], [[1.0], [-1.0]], [[1.0, 1.0]], np.zeros((0, 2)))
    assert mode_bounds(gone)[1] == [0.0]
    apart = replace(gone, zeta=np.array([0.01, 0.011]))
    assert sampled(apart, 401) <= mode_bounds(apart)[1][0] <= 0.15 * mode_bounds(two)[1][0]


# d, c2, norm, error of one mode, error of the balanced model of two states: theory section 4.
CLUSTERS = [
    (0.001, 0.9, 188.04, 89.91, 0.472),
    (0.001, -0.9, 22.21, 89.91, 3.574),
    (0.01, 0.9, 123.91, 89.11, 34.17),
    (0.5, 0.9, 100.01, 60.00, 59.99),
]


@pytest.mark.parametrize(("d", "c", "norm", "modal", "balanced"), CLUSTERS)
def test_clusters_of_two(d, c, norm, modal, balanced):
    both = channels([1.0, 1 + d], [0.005, 0.005], [[1.0], [1.0]], np.zeros((0, 2)), [[1.0, c]])
    assert elastic_norm(both) == pytest.approx(norm, abs=0.006)
    # One mode left out: its bound is its error.
    assert mode_bounds(both)[1][1] == pytest.approx(modal, abs=0.006)
    sigma = hankel_values(both)
    # Glover's and Enns's bound: twice the sum of the values left out.
    assert balanced <= 2 * sigma[2:].sum() + 5e-4
    assert 2 * sigma.sum() >= norm - 0.006


@pytest.mark.shared
def test_the_space_station(space_station):
    """Rates only: the sum over the modes left out holds at every order, and so does twice that of Hankel values."""
    norm = elastic_norm(space_station)
    assert norm == pytest.approx(0.11588, rel=2e-4)
    sizes = []
    for limit in (0.5, 0.1, 0.01):
        kept = keep_bound(space_station, limit)
        left_out = space_station.only(np.setdiff1d(np.arange(space_station.count), kept))
        bound = sum(mode_bounds(left_out)[1])
        assert sampled(left_out, 3) <= bound <= limit * norm
        sizes.append(kept.size)
    assert 0 < sizes[0] < sizes[1] < sizes[2] < space_station.count


@pytest.mark.parametrize("name", ["rotor", "stator"])
def test_the_bodies_of_galileo(name, tmp_path):
    run = Run(load_pipeline(GALILEO), tmp_path, Silent())
    body = modal_channels(run.modal(name), run.bodies[name].ports)
    for limit in (0.3, 0.03):
        left_out = body.only(np.setdiff1d(np.arange(body.count), keep_bound(body, limit)))
        bound = sum(mode_bounds(left_out)[1])
        assert 0 < sampled(left_out, 9) <= bound <= limit * elastic_norm(body)


def test_an_undamped_mode_has_no_bound():
    body = channels([1.0, 2.0], [0.01, 0.0], np.ones((2, 1)), np.ones((1, 2)), np.zeros((0, 2)))
    for ask in (mode_bounds, elastic_norm, lambda b: keep_bound(b, 0.1)):
        with pytest.raises(DampingError, match=r"body 'body': .* mode 2 has zeta = 0"):
            ask(body)


@pytest.mark.parametrize(("inputs", "outputs"), [(0, 2), (2, 0), (2, 2)])
def test_a_body_that_nothing_drives_or_measures_keeps_nothing(inputs, outputs):
    body = channels([1.0, 2.0], [0.01, 0.01], np.zeros((2, inputs)), np.ones((outputs, 2)), np.zeros((0, 2)))
    assert elastic_norm(body) == 0.0 and keep_bound(body, 0.1).size == 0


def test_modes_without_participation_are_left_out_first():
    body = channels([1.0, 2.0, 3.0], [0.01] * 3, [[1.0], [0.0], [1.0]], [[1.0, 1.0, 0.0]], np.zeros((0, 3)))
    assert mode_bounds(body)[1][1:] == [0.0, 0.0]
    assert keep_bound(body, 1e-12).tolist() == [0]
