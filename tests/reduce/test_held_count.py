"""Fixed-interface modes counted by certified free modes, against dense eigenvalues; none where bounds leave it open."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.errors import MatrixError
from cmsreduce.model import FEModel, ModalComponent
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.reduce import CraigBampton, MacNealRubin
from cmsreduce.reduce.held_count import held_count
from tests.frames import frame
from tests.solids import block

# A count at this share beside an eigenvalue is proven, at the other one it never is: squared frequencies.
DECIDED, UNDECIDED = 0.1, 1e-8


def squared(body: FEModel, held: np.ndarray) -> np.ndarray:
    """Squared frequencies of a body held at some dofs, by dense algebra."""
    j = np.setdiff1d(np.arange(body.n), held)
    return la.eigh(body.K.toarray()[np.ix_(j, j)], body.M.toarray()[np.ix_(j, j)], eigvals_only=True)


def free_modes(body: FEModel, interface: np.ndarray, cutoff_hz: float, enriched: bool = True) -> ModalComponent:
    return orthogonalise(MacNealRubin(cutoff_hz).reduce(body, interface, enriched=enriched))


def random_body(rng: np.random.Generator) -> tuple[FEModel, np.ndarray]:
    """A tree of bars with a few more of them, or a block, and an interface of 3 to 60 dofs at random."""
    if rng.integers(2):
        count = int(rng.integers(12, 20))
        bars = [(int(rng.integers(1, node)), node) for node in range(2, count + 1)]
        bars += [(node, node + 2) for node in range(1, count - 2, 5) if (node, node + 2) not in bars]
        body = frame("tree", rng.uniform(-1, 1, (count, 3)), bars)
    else:
        body = block("block", rng.uniform(0.1, 1.0, 3), rng.integers([5, 2, 2], [9, 4, 3]))
    # Free modes and interface together must leave some motions for the bounds to speak of.
    size = int(rng.integers(3, min(60, body.n // 4) + 1))
    return body, np.sort(rng.choice(body.n, size, replace=False))


@pytest.mark.parametrize("seed", range(8))
def test_the_count_is_that_of_dense_eigenvalues_or_none(seed: int) -> None:
    rng = np.random.default_rng(seed)
    body, interface = random_body(rng)
    exact = squared(body, interface)
    top = float(np.sqrt(exact[rng.integers(5, 10)])) / np.pi
    free = free_modes(body, interface, top, enriched=bool(rng.integers(2)))
    inside = exact[exact < (np.pi * top) ** 2]
    # Motions that the interface leaves free have the rounding of dense algebra.
    near = inside[inside > 1e-9 * exact[-1], None] * (1 + np.array([1e-2, -1e-2, 1e-3, -1e-3, 1e-6, -1e-6]))
    squares = np.concatenate([rng.uniform(1e-3, 1.0, 40) * (np.pi * top) ** 2, near.ravel()])
    found = [held_count(free, interface, float(omega)) for omega in np.sqrt(squares)]
    assert all(count in (None, np.count_nonzero(exact < s)) for count, s in zip(found, squares, strict=True))
    apart = abs(exact[:, None] / squares - 1).min(axis=0) > DECIDED
    assert all(count is not None for count, clear in zip(found, apart, strict=True) if clear)


@pytest.fixture(scope="module")
def bar() -> tuple[FEModel, np.ndarray]:
    """A bar of 630 dofs, more than dense algebra takes, and the dofs of its root."""
    body = block("bar", [2.1, 0.2, 0.23], [34, 1, 2])
    return body, np.arange(18)


@pytest.fixture(scope="module")
def known(bar: tuple[FEModel, np.ndarray]) -> ModalComponent:
    return free_modes(*bar, 4000.0)


def test_a_mode_at_the_cutoff_is_left_to_the_factor(bar, known) -> None:
    body, root = bar
    for s in squared(body, root)[:6]:
        for share in (0.0, UNDECIDED, -UNDECIDED):
            assert held_count(known, root, float(np.sqrt(s * (1 + share)))) is None


def test_without_an_interface_free_modes_are_counted(bar, known) -> None:
    exact = squared(bar[0], np.arange(0))
    for omega in 2 * np.pi * np.array([300.0, 1100.0, 2500.0]):
        assert held_count(known, np.arange(0), omega) == np.count_nonzero(exact < omega**2)


def test_an_interface_that_hardly_holds_the_body_is_counted_or_left(bar) -> None:
    """Three nodes in a line leave a rotation free; two neighbours on a stiff side resist it by little."""
    body = bar[0]
    for interface in (np.arange(9), np.array([0, 1, 2, 3, 4, 8]), np.array([0])):
        exact, free = squared(body, interface), free_modes(body, interface, 3000.0)
        for omega in 2 * np.pi * np.linspace(200.0, 1500.0, 15):
            assert held_count(free, interface, omega) in (None, np.count_nonzero(exact < omega**2))
        assert held_count(free, interface, 2 * np.pi * 700.0) is not None


def test_what_is_not_certified_counts_nothing(bar, known) -> None:
    root, omega = bar[1], 2 * np.pi * 1000.0
    certificate = known.certificate
    assert held_count(known, root, omega) is not None
    assert held_count(replace(known, certificate=None), root, omega) is None
    # A mode was counted and not found: the free modes are not all.
    missed = replace(certificate, counted=certificate.counted + 1)
    assert held_count(replace(known, certificate=missed), root, omega) is None
    unbounded = replace(certificate, bound=np.full(certificate.bound.size, np.nan))
    assert held_count(replace(known, certificate=unbounded), root, omega) is None
    # Nor do modes above their cutoff.
    assert held_count(known, root, 2 * np.pi * 4001.0) is None
    # Without the static shapes of the interface nothing bounds what is left out.
    bare = known.truncated(range(known.rigid_count + certificate.frequency_hz.size))
    assert held_count(bare, root, omega) is None


@pytest.fixture
def factors(monkeypatch) -> list[float]:
    """Frequencies at which a factor was asked for a count."""
    room, asked = import_module("cmsreduce.linalg.eigen.eigenpairs"), []
    count = room.sturm_count
    monkeypatch.setattr(room, "sturm_count", lambda K, M, omega: (asked.append(omega), count(K, M, omega))[1])
    return asked


@pytest.mark.parametrize("method", [CraigBampton, MacNealRubin])
def test_a_reduction_takes_the_count_and_no_factor(method, bar, known, factors) -> None:
    body, root = bar
    plain = method(1500.0).reduce(body, root)
    assert len(factors) == 1
    # The body is that of the free modes.
    counted = method(1500.0).counted_by(known).reduce(known.body, root)
    assert len(factors) == 1
    assert counted.modes.certificate.counted == plain.modes.certificate.counted > 5
    np.testing.assert_array_equal(counted.modes.Phi, plain.modes.Phi)


def test_free_modes_of_another_body_and_an_open_count_ask_for_the_factor(bar, known, factors) -> None:
    body, root = bar
    CraigBampton(1500.0).counted_by(known).reduce(replace(body, K=2 * body.K), root)
    assert len(factors) == 1
    at_a_mode = float(np.sqrt(squared(body, root)[3])) / (2 * np.pi)
    found = CraigBampton(at_a_mode).counted_by(known).reduce(known.body, root)
    assert len(factors) == 2
    assert found.modes.certificate.counted == 4


def test_a_mode_that_the_search_misses_is_missed_by_the_count(bar, known, factors, monkeypatch) -> None:
    """The search is blind for the fifth fixed mode; the count from free modes knows that there is one."""
    body, root = bar
    lost = squared(body, root)[4]
    search = import_module("cmsreduce.linalg.eigen.shift_invert")
    monkeypatch.setattr(search, "_PATIENCE", 4)
    chosen = search._chosen

    def blind(window, lam, settled):
        return chosen(window, np.where(abs(lam / lost - 1) < 1e-6, np.inf, lam), settled)

    monkeypatch.setattr(search, "_chosen", blind)
    with pytest.raises(MatrixError, match="modes lie below 1500 Hz but"):
        CraigBampton(1500.0).counted_by(known).reduce(known.body, root)
    assert not factors
