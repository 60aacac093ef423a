"""Bodies whose candidates are isolated modes and directions of clusters."""

from dataclasses import replace

import numpy as np
import pytest

from cmsreduce.balance import (
    RANKINGS,
    DirectedComponent,
    Gregory,
    Hankel,
    cluster_groups,
    directed,
    direction_error,
    directions_bound,
    keep_directions_bound,
    keep_fraction,
    keep_modes,
    whole_groups,
    with_rankings,
)
from cmsreduce.errors import DampingError
from cmsreduce.model import ModalChannels, ModalComponent
from tests.balance.test_truncation import component
from tests.lyapunov import mixed, response, two_close_modes


def body(ch: ModalChannels) -> ModalComponent:
    """A body that is nothing but these modes: its shapes are unit columns."""
    return replace(component("body", 0, [0.0] * ch.count, ch.omega), zeta=ch.zeta)


def turned(ch: ModalChannels, ranking=RANKINGS["gregory"]) -> ModalComponent:
    found = with_rankings(ranking.rank(body(ch), ch), ch, RANKINGS)
    return directed(found, ch, cluster_groups(ch), ranking, RANKINGS)


def channels_of(cut: ModalComponent, ch: ModalChannels) -> ModalChannels:
    """What a body of unit shapes does between the same inputs and outputs."""
    return ModalChannels("cut", cut.omega, cut.zeta, cut.Phi.T @ ch.B, ch.C1 @ cut.Phi, ch.C2 @ cut.Phi)


def apart(ch: ModalChannels, other: ModalChannels, w: np.ndarray) -> float:
    return float(np.linalg.norm(response(ch, w) - response(other, w), 2, axis=(1, 2)).max())


@pytest.mark.parametrize(
    ("distance", "c", "first_mode", "first_candidate"),
    [
        (0.001, (1, 0.9), 89.91, 2.0045),
        # Less than the 22.21 of nothing at all, and a fifth of what a mode errs by.
        (0.001, (1, -0.9), 89.91, 18.686),
        # Not one cluster: the candidates are the modes.
        (0.5, (1, 0.9), 60.00, 60.00),
    ],
)
def test_one_candidate_of_the_golden_pairs(distance, c, first_mode, first_candidate):
    ch = two_close_modes(distance, c)
    w = np.unique(np.concatenate([np.linspace(0.9, 1.1, 40001), ch.omega[1] + np.linspace(-0.02, 0.02, 40001)]))
    plain = Gregory().rank(body(ch), ch)
    errors = [
        apart(ch, channels_of(each.truncated(keep_modes({"body": each}, 1)["body"]), ch), w)
        for each in (plain, turned(ch))
    ]
    np.testing.assert_allclose(errors, [first_mode, first_candidate], rtol=1e-4)


def test_directions_that_nearly_cancel_are_worth_little_together():
    """Modes have 50 and 45, 12.5 together. H2 norms of 1.1808 and 0.9394 are those of modes of 8.35 and 6.64."""
    ch = two_close_modes(0.001, (1, -0.9))
    for ranking in (Gregory(), Hankel()):
        np.testing.assert_allclose(np.sort(turned(ch, ranking).sigma), [6.64, 8.35], rtol=0.01)


def test_ten_equal_appendages_come_down_to_what_drives_them():
    """One frequency, two inputs, one output: what the output sees does what ten modes do, and nine do nothing."""
    rng = np.random.default_rng(3)
    B, C = rng.standard_normal((10, 2)), rng.standard_normal((1, 10))
    ch = ModalChannels("ten", np.full(10, 3.0), np.full(10, 0.01), B, C, np.zeros((0, 10)))
    plain, found = Gregory().rank(body(ch), ch), turned(ch)
    assert keep_fraction({"ten": plain}, 1e-6)["ten"].size == 10
    kept = keep_fraction({"ten": found}, 1e-6)["ten"]
    assert kept.size == 1
    w = np.linspace(0.1, 6, 500)
    assert apart(ch, channels_of(found.truncated(kept), ch), w) < 1e-9 * abs(response(ch, w)).max()


def test_isolated_modes_are_the_body_itself():
    ch = mixed(1)
    ch = ch.only([0, 1, 4])
    plain = with_rankings(Gregory().rank(body(ch), ch), ch, RANKINGS)
    cluster = np.arange(3)
    assert directed(plain, ch, cluster, RANKINGS["gregory"], RANKINGS) is plain


@pytest.mark.parametrize("seed", range(4))
def test_all_candidates_are_the_body_and_isolated_ones_keep_their_coefficients(seed):
    ch = mixed(seed, modes=9)
    found = turned(ch)
    assert isinstance(found, DirectedComponent)
    again = found.truncated(np.arange(9))
    np.testing.assert_allclose(again.omega, ch.omega, rtol=1e-12)
    w = np.linspace(0.5, 12, 300)
    assert apart(ch, channels_of(again, ch), w) < 1e-10 * abs(response(ch, w)).max()
    cluster = cluster_groups(ch)
    alone = np.flatnonzero(np.bincount(cluster)[cluster] == 1)
    for name, ranking in RANKINGS.items():
        values, own = ranking.coefficients(ch), found.rankings[name]
        for k in alone:
            (at,) = np.flatnonzero(found.Q[k] == 1)
            assert own[at] == pytest.approx(values[k], rel=1e-12)


def test_directions_of_equal_gain_stay_together():
    """A repeated mode driven and seen alike in both directions has no direction of its own."""
    eye = np.eye(2)
    ch = ModalChannels("pair", np.full(2, 2.0), np.full(2, 0.01), eye, eye, np.zeros((0, 2)))
    assert [group.tolist() for group in whole_groups(turned(ch))] == [[0, 1]]
    ch = replace(ch, B=np.diag([1.0, 0.5]))
    assert [group.size for group in whole_groups(turned(ch))] == [1, 1]


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("limit", [0.3, 0.05, 1e-3])
def test_a_bound_is_never_violated(seed, limit):
    """Against the response of the body that is kept, summed mode by mode."""
    rng = np.random.default_rng(seed)
    w = np.sort(np.concatenate([1 + 0.01 * rng.random(5), rng.uniform(2, 8, 4)]))
    parts = (rng.standard_normal(shape) for shape in ((9, 2), (2, 9), (1, 9)))
    ch = ModalChannels("nine", w, np.full(9, 0.01), *parts)
    found = turned(ch)
    kept, bound = keep_directions_bound(found, ch, limit)
    grid = np.unique(np.concatenate([np.linspace(0, 9, 3000), *(x + 0.05 * np.linspace(-1, 1, 400) for x in w)]))
    size = apart(ch, ch.only([]), grid)
    cut = channels_of(found.truncated(kept), ch)
    # What is kept whole comes back to rounding.
    assert apart(ch, cut, grid) - 1e-10 * size <= bound <= limit * size * 1.001
    lost = direction_error(ch, found.Q[:, kept])
    assert apart(lost, lost.only([]), grid) == pytest.approx(apart(ch, cut, grid), rel=1e-8, abs=1e-10 * size)


def test_a_direction_of_small_gain_has_a_small_bound():
    """The first direction of the golden pair errs by 2.0045; twice the sum of four Hankel values is no less."""
    ch = two_close_modes(0.001, (1, 0.9))
    found = turned(ch)
    best = int(np.argmax(found.sigma))
    assert 2.0045 <= directions_bound(ch, found.Q[:, [best]]) < 4 * 2.0045
    assert directions_bound(ch, np.eye(2)) == 0


@pytest.mark.parametrize("limit", [0.01, 0.3, 1.0, 3.0, 10.0, 30.0])
def test_two_shapes_that_nearly_cancel_are_kept_both_or_left_out_both(limit):
    """Keeping one of them errs by 90 or more, keeping none by the norm of 22.2: one is never what a bound asks for."""
    ch = two_close_modes(0.001, (1, -0.9))
    kept, bound = keep_directions_bound(turned(ch), ch, limit)
    assert kept.size in (0, 2)
    assert bound == 0 if kept.size else 22.2 < bound <= limit * 22.21


def test_what_has_no_damping_cannot_be_turned():
    ch = replace(two_close_modes(0.001, (1, 0.9)), zeta=np.array([0.005, 0.0]))
    with pytest.raises(DampingError, match="needs positive damping"):
        directed(body(ch), ch, np.zeros(2, dtype=np.int64), RANKINGS["modal-gain"], {})


def test_a_note_says_where_fewer_directions_lose_less():
    """As if one direction of the pair lost half as much again as nothing at all."""
    ch = two_close_modes(0.001, (1, -0.9))
    found = turned(ch)
    found = replace(found, cluster=np.ones(2, dtype=np.int64), left=np.array([1.5, 0.0]))
    best = int(np.argmin(found.tie))
    (note,) = found.notes([best])
    assert "1 of the 2 directions of cluster 1 are kept, and lose 1.5 of its response" in note
    assert "with none of them it would lose 1:" in note
    assert found.notes([]) == () and found.notes([0, 1]) == ()
    assert replace(found, left=turned(ch).left).notes([best]) == ()


def test_candidates_that_go_together_are_bounded_together():
    """Two silent modes far apart from what is driven are tied; a bound still counts every candidate."""
    ch = two_close_modes(0.001, (1, 0.9))
    still = ModalChannels("five", np.array([1.0, 1.001, 3.0, 3.001]), np.full(4, 0.005), *_padded(ch))
    cluster = np.array([0, 0, 1, 1])
    plain = with_rankings(Gregory().rank(body(still), still), still, RANKINGS)
    found = directed(plain, still, cluster, RANKINGS["gregory"], RANKINGS)
    assert [group.size for group in whole_groups(found)] == [1, 1, 2]
    kept, bound = keep_directions_bound(found, still, 0.2)
    assert kept.size == 1 and 0 < bound <= 0.2 * 188.1


def _padded(ch: ModalChannels) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    none = np.zeros((2, 1))
    return np.vstack([ch.B, none]), np.zeros((0, 4)), np.hstack([ch.C2, none.T])
