"""How many ranked modes are kept."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from cmsreduce.balance import Gregory, Hankel, keep_all, keep_fraction, keep_modes, keep_total
from cmsreduce.errors import ConfigError
from cmsreduce.model import DofTable, FEModel, ModalChannels, ModalComponent
from tests.lyapunov import response, two_close_modes


def component(name: str, rigid: int, sigma: list[float], omega: list[float] | None = None, static: int = 0):
    import scipy.sparse as sp

    m = rigid + len(sigma) + static
    w = 1.0 + np.arange(len(sigma)) if omega is None else omega
    one = sp.csc_array(np.eye(m))
    return ModalComponent(
        body=FEModel(name, one, one, DofTable(np.arange(1, m + 1), np.zeros(m))),
        method="all",
        Phi=np.eye(m),
        omega=np.r_[np.zeros(rigid), w, np.full(static, np.inf)],
        zeta=np.r_[np.zeros(rigid), np.full(len(sigma), 0.01), np.zeros(static)],
        rigid_count=rigid,
        D=None,
        kind=("rigid",) * rigid + ("free",) * (len(sigma) + static),
        source_hz=np.zeros(m),
        sigma=np.r_[np.full(rigid, np.nan), sigma, np.full(static, np.nan)],
        spacing=np.full(m, np.nan),
        why=("",) * m,
        basis_size=m,
        static_count=static,
    )


BODIES = {
    "rotor": component("rotor", 2, [0.5, 3.0, 0.1, 2.0]),
    "stator": component("stator", 0, [1.0, 0.01]),
}


@pytest.mark.parametrize(("count", "left"), [(1, [0]), (2, [0]), (3, [0, 1]), (4, [0, 1]), (5, [0, 1]), (6, [0, 1])])
def test_equal_modes_of_twin_bodies_are_kept_together(count: int, left: list[int]) -> None:
    """Coefficients of a left and a right wing agree to rounding; the third mode of each is rounding itself."""
    wings = {
        "left": component("left", 0, [2.0, 1.0, 1e-17]),
        "right": component("right", 0, [2.0 + 1e-12, 1.0 - 1e-12, 2e-17]),
    }
    kept = as_lists(keep_total(wings, count))
    assert kept["left"][:2] == kept["right"][:2] == left
    assert sum(map(len, kept.values())) == max(count, 2 * len(left))


def as_lists(selection: Mapping[str, np.ndarray]) -> dict[str, list[int]]:
    return {name: columns.tolist() for name, columns in selection.items()}


@pytest.mark.parametrize(
    ("count", "expected"),
    [
        (1, {"rotor": [3], "stator": [0]}),
        (2, {"rotor": [3, 5], "stator": [0, 1]}),
        (0, {"rotor": [], "stator": []}),
        ({"rotor": 3}, {"rotor": [2, 3, 5], "stator": [0, 1]}),
        ({"rotor": 0, "stator": 1}, {"rotor": [], "stator": [0]}),
        ({}, {"rotor": [2, 3, 4, 5], "stator": [0, 1]}),
    ],
    ids=str,
)
def test_a_number_keeps_the_highest_ranked(count, expected):
    assert as_lists(keep_modes(BODIES, count)) == expected


@pytest.mark.parametrize(
    ("count", "message"),
    [
        ({"motor": 1}, r"no flexible component 'motor' \(there are: rotor, stator\)"),
        ({"stator": 3}, r"3 modes of 'stator' .* has 2 elastic"),
        (3, r"3 modes of 'stator'"),
        ({"rotor": -1}, r"-1 modes of 'rotor'"),
    ],
    ids=str,
)
def test_what_cannot_be_kept_is_refused(count, message):
    with pytest.raises(ConfigError, match=message):
        keep_modes(BODIES, count)


@pytest.mark.parametrize(
    ("fraction", "expected"),
    [
        (1.0, {"rotor": [3], "stator": [0]}),
        (0.6, {"rotor": [3, 5], "stator": [0]}),
        (0.1, {"rotor": [2, 3, 5], "stator": [0]}),
        (0.01, {"rotor": [2, 3, 4, 5], "stator": [0, 1]}),
    ],
)
def test_a_fraction_of_the_largest_of_each_body(fraction, expected):
    assert as_lists(keep_fraction(BODIES, fraction)) == expected


def test_all_means_all_elastic():
    assert as_lists(keep_all(BODIES)) == {"rotor": [2, 3, 4, 5], "stator": [0, 1]}


# A pair at 2 and a triple at 5, of one rigid and two static modes; the halves of the pair rank unlike.
GROUPED = {
    "frame": component(
        "frame", 1, [0.5, 3.0, 0.2, 0.4, 1.0, 1.0, 1.0], [1.0, 2.0, 2.0 * (1 + 1e-9), 4.0, 5.0, 5.0, 5.0], static=2
    )
}


@pytest.mark.parametrize(
    ("count", "expected"),
    [(0, []), (1, [2, 3]), (2, [2, 3]), (3, [2, 3, 5, 6, 7]), (5, [2, 3, 5, 6, 7]), (6, [1, 2, 3, 5, 6, 7])],
)
def test_a_number_never_splits_a_repeated_mode(count, expected):
    assert as_lists(keep_modes(GROUPED, count)) == {"frame": expected}


def test_a_fraction_never_splits_a_repeated_mode():
    assert as_lists(keep_fraction(GROUPED, 0.9)) == {"frame": [2, 3]}
    assert as_lists(keep_fraction(GROUPED, 0.15)) == {"frame": [1, 2, 3, 5, 6, 7]}


def test_all_means_all_elastic_and_no_static():
    assert as_lists(keep_all(GROUPED)) == {"frame": [1, 2, 3, 4, 5, 6, 7]}


@pytest.mark.parametrize("ranking", [Gregory(), Hankel()])
@pytest.mark.parametrize(
    ("apart", "c", "error"),
    [(0.001, (1, 0.9), 89.91), (0.001, (1, -0.9), 89.91), (0.01, (1, 0.9), 89.11), (0.5, (1, 0.9), 60.00)],
)
def test_one_mode_of_the_golden_pairs(ranking, apart, c, error):
    """H-infinity errors with the most important mode kept; theory section 4 has the models."""
    pair = two_close_modes(apart, c)
    body = ranking.rank(replace(component("body", 0, [0.0, 0.0], pair.omega), zeta=pair.zeta), pair)
    kept = body.truncated(keep_modes({"body": body}, 1)["body"])
    left = ModalChannels("left", kept.omega, kept.zeta, kept.Phi.T @ pair.B, pair.C1 @ kept.Phi, pair.C2 @ kept.Phi)
    w = np.unique(np.concatenate([np.linspace(0.9, 1.1, 40001), pair.omega[1] + np.linspace(-0.02, 0.02, 40001)]))
    assert abs(response(pair, w) - response(left, w)).max() == pytest.approx(error, abs=0.006)
