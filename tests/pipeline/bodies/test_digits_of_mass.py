"""Mass matrices with fewer digits than the stiffness, in binary files: rounding is no negative energy."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.model import FEModel
from tests.frames import BAR, frame
from tests.pipeline.bodies.test_body_proofs import opened, proof_of


def without_twist(seed: int) -> FEModel:
    """Bars without inertia about their own axes, so that the mass of nodes between them is singular."""
    xyz = np.round(np.random.default_rng(seed).random((12, 3)), 3)
    body = frame("part", xyz, [(i, i + 1) for i in range(1, 12)])
    M = body.M.toarray()
    for i in range(1, 12):
        along = xyz[i] - xyz[i - 1]
        length = float(np.linalg.norm(along))
        rows = np.r_[6 * i - 3 : 6 * i, 6 * i + 3 : 6 * i + 6]
        spin = np.kron(np.array([[2, 1], [1, 2]]) / 6, np.outer(along, along) / length**2)
        M[np.ix_(rows, rows)] -= BAR.rho * (BAR.Iy + BAR.Iz) * length * spin
    return replace(body, M=sp.csc_array((M + M.T) / 2), grounded=False)


def printed(M: sp.csc_array, digits: int) -> sp.csc_array:
    values = [float(f"{value:.{digits - 1}e}") for value in M.data]
    return sp.csc_array((values, M.indices, M.indptr), shape=M.shape)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("digits", [4, 5, 7, 10])
def test_printed_digits_are_no_negative_energy(tmp_path: Path, seed: int, digits: int) -> None:
    body = without_twist(seed)
    proof = proof_of(opened(tmp_path, replace(body, M=printed(body.M, digits)), []), "mass")
    assert proof.state == "proven"
    # A number with a leading 1 has a digit less, and errors of a few add up.
    assert proof.digits == pytest.approx(min(digits - 1.7, 6), abs=0.1)


def test_single_precision_is_no_negative_energy(tmp_path: Path) -> None:
    body = without_twist(0)
    M = sp.csc_array(body.M.astype(np.float32).astype(float))
    assert proof_of(opened(tmp_path, replace(body, M=M), []), "mass").state == "proven"


@pytest.mark.parametrize("digits", [4, 17])
def test_negative_energy_beyond_the_digits_is_refuted(tmp_path: Path, digits: int) -> None:
    body = without_twist(0)
    M = printed(body.M, digits).tolil()
    M[40, 40] *= 0.9
    proof = proof_of(opened(tmp_path, replace(body, M=sp.csc_array(M)), []), "mass")
    assert proof.state == "refuted"
