"""Proofs of a large body that run beside its factor: the same facts as one after the other, and the same errors."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.errors import DofMapError
from cmsreduce.linalg.machine import SolverSettings, solver_settings
from cmsreduce.model import FEModel
from cmsreduce.pipeline.bodies import FlexibleBody, proven_bodies
from tests.pipeline.bodies.decks import brick_cards
from tests.pipeline.bodies.test_body_proofs import opened
from tests.solids import block

CELLS = (20, 6, 6)
BLOCK = block("part", [5.0, 1.5, 1.5], CELLS)


def proven(folder: Path, threads: int, body: FEModel = BLOCK) -> FlexibleBody:
    with solver_settings(SolverSettings(threads=threads)):
        return opened(folder, body, brick_cards(CELLS))


def test_two_threads_prove_what_one_does(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert BLOCK.n > 2000
    began, begun = list[bool](), proven_bodies.begun

    def counted(work, *, beside):
        began.append(beside)
        return begun(work, beside=beside)

    monkeypatch.setattr(proven_bodies, "begun", counted)
    one, two = (proven(tmp_path / str(threads), threads) for threads in (1, 2))
    assert began == [True] * 4
    assert [proof.state for proof in two.proofs][:3] == ["proven"] * 3
    assert (one.proofs, one.checks, one.notes) == (two.proofs, two.checks, two.notes)


@pytest.mark.parametrize("threads", [1, 2])
def test_a_mass_in_another_order_is_refused(tmp_path: Path, threads: int) -> None:
    order = np.arange(BLOCK.n)
    order[30:33], order[300:303] = order[300:303].copy(), order[30:33].copy()
    wrong = replace(BLOCK, M=sp.csc_array(BLOCK.M[order][:, order]))
    with pytest.raises(DofMapError, match=r"the rows of the mass matrix .* are not in the order of the stiffness"):
        proven(tmp_path, threads, wrong)
