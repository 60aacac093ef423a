"""How many ranked modes are kept."""

from collections.abc import Mapping

import numpy as np
import pytest

from cmsreduce.balance import keep_all, keep_error, keep_fraction, keep_modes
from cmsreduce.errors import ConfigError
from cmsreduce.model import DofTable, FEModel, ModalComponent


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


def weights(**lost: dict[int, float]):
    """Error as the root sum of squares of what each mode left out costs."""
    calls = []

    def error_of(selection):
        calls.append(as_lists(selection))
        total = sum(
            cost**2 for name, costs in lost.items() for k, cost in costs.items() if k not in selection[name].tolist()
        )
        return float(np.sqrt(total))

    return error_of, calls


COSTS = {"rotor": {2: 0.5, 3: 3.0, 4: 0.1, 5: 2.0}, "stator": {0: 1.0, 1: 0.01}}


@pytest.mark.parametrize(
    ("limit", "expected"),
    [
        (10.0, {"rotor": [], "stator": []}),
        (3.0, {"rotor": [3], "stator": []}),
        (1.2, {"rotor": [3, 5], "stator": []}),
        (0.6, {"rotor": [3, 5], "stator": [0]}),
        (0.2, {"rotor": [2, 3, 5], "stator": [0]}),
        (0.05, {"rotor": [2, 3, 4, 5], "stator": [0]}),
        (0.0, {"rotor": [2, 3, 4, 5], "stator": [0, 1]}),
    ],
)
def test_the_fewest_that_meet_an_error(limit, expected):
    error_of, _ = weights(**COSTS)
    assert as_lists(keep_error(BODIES, error_of, limit)) == expected


def test_modes_ranked_high_but_idle_are_left_out():
    error_of, _ = weights(rotor={2: 0.5, 3: 0.0, 4: 2.0, 5: 0.0}, stator={0: 0.0, 1: 0.0})
    assert as_lists(keep_error(BODIES, error_of, 0.1)) == {"rotor": [2, 4], "stator": []}


def test_an_error_below_what_all_modes_reach_is_refused():
    with pytest.raises(ConfigError, match=r"frf_error 0\.01 cannot be met: all 6 modes .* leave 0\.3"):
        keep_error(BODIES, lambda _: 0.3, 0.01)


def test_a_long_list_is_bracketed_rather_than_tried():
    sigma = np.geomspace(1.0, 1e-3, 600)
    body = {"long": component("long", 0, sigma.tolist())}
    calls = 0

    def error_of(selection):
        nonlocal calls
        calls += 1
        kept = selection["long"].size
        return 1.0 if kept < 37 else 0.0

    assert keep_error(body, error_of, 0.5)["long"].size == 37
    # Full, bracket, then one trial for each mode taken.
    assert calls < 60


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


def test_an_error_never_splits_a_repeated_mode():
    """The mode at column 6 alone would do; its group comes, and the pair, ranked higher but idle, goes whole."""
    error_of, calls = weights(frame={6: 2.0})
    assert as_lists(keep_error(GROUPED, error_of, 0.1)) == {"frame": [5, 6, 7]}
    for call in calls:
        assert len({2, 3} & set(call["frame"])) in (0, 2) and len({5, 6, 7} & set(call["frame"])) in (0, 3)


def test_all_means_all_elastic_and_no_static():
    assert as_lists(keep_all(GROUPED)) == {"frame": [1, 2, 3, 4, 5, 6, 7]}
