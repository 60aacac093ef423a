"""Factors by parts against dense algebra: exact solves, pivots and inertia, whatever is kept in memory."""

import pickle

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp

from cmsreduce.linalg.factorise import InsufficientMemoryError, NotPositiveDefiniteError, factorise
from cmsreduce.linalg.parted_factor import PartedFactor
from cmsreduce.linalg.solver_settings import SolverSettings, solver_settings
from tests.frames import frame
from tests.solids import block

BAR = block("bar", (4.0, 0.2, 0.25), (40, 2, 2), held=range(1, 10))
SPECTRUM = la.eigvalsh(BAR.K.toarray(), BAR.M.toarray())


@pytest.fixture(params=["superlu", pytest.param("pardiso", marks=pytest.mark.pardiso)])
def backend(request):
    return request.param


@pytest.mark.parametrize("parts", [2, 3, 8])
@pytest.mark.parametrize("share", [0.5, 0.0], ids=["all kept", "none kept"])
def test_solutions_and_pivots_are_exact(backend, parts, share, monkeypatch):
    monkeypatch.setattr("cmsreduce.linalg.parted_factor._KEPT", share)
    with solver_settings(SolverSettings(backend, parts=parts)) as settings:
        factor = factorise(BAR.K)
        assert isinstance(factor, PartedFactor)
        assert len(factor.cut.interiors) == parts
        assert factor.kept == (parts if share else 0)
        b = np.random.default_rng(1).standard_normal((BAR.n, 70))
        for x, load in ((factor(b), b), (factor(b[:, 0]), b[:, 0])):
            missed = abs(BAR.K @ x - load) / (abs(BAR.K) @ abs(x) + abs(load))
            assert missed.max() < 1e-14
        assert factor.inertia_known
        assert factor.negative_pivots == 0
        assert np.log(factor.pivots).sum() == pytest.approx(np.linalg.slogdet(BAR.K.toarray())[1], rel=1e-11)
        assert factor.weakest[1] == pytest.approx((factor.pivots / BAR.K.diagonal()).min(), rel=0.5)
    # Every part and the rows between are recorded once, then the whole, although parts are made again.
    assert [work.parts for work in settings.work] == [1] * (parts + 1) + [parts]
    assert settings.work[-1].rows == BAR.n


@pytest.mark.parametrize("parts", [2, 5])
@pytest.mark.parametrize("below", [0, 1, 7, 60, 300])
def test_the_inertia_is_that_of_the_whole(backend, parts, below):
    sigma = (SPECTRUM[below - 1] + SPECTRUM[below]) / 2 if below else SPECTRUM[0] / 2
    with solver_settings(SolverSettings(backend, parts=parts)):
        factor = factorise(sp.csc_array(BAR.K - sigma * BAR.M), definite=False)
        assert factor.inertia_known
        assert factor.negative_pivots == below


def test_a_shift_onto_a_mode_of_a_part_is_noticed(backend):
    with solver_settings(SolverSettings(backend, parts=3)):
        own = factorise(BAR.K).cut.interiors[1]
        K, M = (A[own][:, own].toarray() for A in (BAR.K, BAR.M))
        sigma = la.eigvalsh(K, M)[2]
        try:
            factor = factorise(sp.csc_array(BAR.K - sigma * BAR.M), definite=False)
        except NotPositiveDefiniteError:
            return
        assert not factor.inertia_known or factor.negative_pivots == np.count_nonzero(sigma > SPECTRUM)


@pytest.mark.parametrize("seed", range(5))
def test_a_free_body_is_singular(backend, seed):
    rng = np.random.default_rng(seed)
    body = frame("free", rng.standard_normal((40, 3)), [(k, k + 1) for k in range(1, 40)])
    with solver_settings(SolverSettings(backend, parts=4)), pytest.raises(NotPositiveDefiniteError, match="the body"):
        factorise(body.K, what="the body")


def test_a_mechanism_in_a_part_is_named_by_its_row_of_the_whole(backend):
    K = sp.lil_array(BAR.K)
    row = BAR.n // 2
    K[row, :] = 0.0
    K[:, row] = 0.0
    with solver_settings(SolverSettings(backend, parts=3)), pytest.raises(NotPositiveDefiniteError) as caught:
        factorise(sp.csc_array(K), what="the body")
    assert caught.value.row == row


@pytest.mark.pardiso
def test_auto_cuts_only_what_does_not_fit():
    # Thick enough that its entries outweigh what MKL takes for any factor, on some processors 16 MB.
    body = block("bar", (60.0, 0.6, 0.6), (1500, 3, 3), held=range(1, 17))
    with solver_settings(SolverSettings("pardiso", parts="auto")):
        whole = factorise(body.K)
    assert not isinstance(whole, PartedFactor)
    settings = SolverSettings("pardiso", memory=0.3 * whole.cost.bytes, parts="auto")
    x = np.random.default_rng(0).standard_normal((body.n, 3))
    with solver_settings(settings):
        factor = factorise(body.K)
        assert isinstance(factor, PartedFactor)
        assert factor.cost.bytes < settings.memory
        b = body.K @ x
        missed = abs(body.K @ factor(b) - b) / (abs(body.K) @ abs(x) + abs(b))
        assert missed.max() < 1e-13
    with (
        solver_settings(SolverSettings("pardiso", memory=1e3, parts="auto")),
        pytest.raises(InsufficientMemoryError) as refused,
    ):
        factorise(body.K)
    again = pickle.loads(pickle.dumps(refused.value))
    assert (str(again), again.bytes) == (str(refused.value), refused.value.bytes)
    assert again.bytes > 1e3
