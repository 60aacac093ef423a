"""Whole runs of bodies whose files have few digits: the run goes on, and says how far its frequencies are known."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.errors import DofMapError
from cmsreduce.model import FEModel
from cmsreduce.pipeline import Run, execute
from cmsreduce.pipeline.results import check_result
from cmsreduce.pipeline.results.limits import Limits
from tests.frames import line
from tests.linalg.eigen.test_null_space import planar_beam
from tests.pipeline.study import CANTILEVER, write_body
from tests.solids import block
from tests.verify.test_input_rounding import wing

# The files of the arm under the names that the study gives them.
SAVED = CANTILEVER.replace("{{file: arm.op4, matrix: KAA}}", "K.npy").replace("{{file: arm.op4, matrix: MAA}}", "M.npy")
FREE = SAVED.replace("  ground: arm.root\n", "").replace("balance: {{keep: {{frf_error: 0.01}}}}\n", "verify: {{}}\n")


def rounded(A: np.ndarray, digits: int | None) -> np.ndarray:
    if digits is None:
        return np.float64(np.float32(A))
    return np.array([[float(f"{x:.{digits - 1}e}") for x in row] for row in A])


@pytest.fixture
def saved(study: Path) -> Callable[..., FEModel]:
    """Write the arm with few digits, and perhaps with two nodes exchanged."""

    def make(digits: int | None, exchanged: tuple[int, int] | None = None) -> FEModel:
        body = line("arm", [0, 0, 0], [0.8, 0, 0], 4, masses={3: 0.3})
        rows = np.arange(body.n)
        if exchanged:
            a, b = (np.flatnonzero(body.dofs.node == node) for node in exchanged)
            rows[a], rows[b] = b, a
        for name, A in (("K", body.K), ("M", body.M)):
            # In another unit of mass the numbers have all digits.
            np.save(study.parent / f"{name}.npy", rounded(np.pi * A.toarray(), digits)[np.ix_(rows, rows)])
        return body

    return make


def test_empty_rotations_leave_the_rigid_motions_proven(
    opened: Callable[..., Run], study: Path, saved: Callable[..., FEModel]
) -> None:
    """Matrices of solids with six dofs a node: the rows of rotations are empty, and are held."""
    saved(9)
    solid = block("arm", [0.8, 0.2, 0.1], [4, 1, 1])
    assert solid.nodes is not None
    write_body(study.parent, solid)
    place = 6 * np.searchsorted(solid.nodes.id, solid.dofs.node) + solid.dofs.component - 1
    for name, A in (("K", solid.K), ("M", solid.M)):
        six = np.zeros((6 * solid.nodes.id.size,) * 2)
        six[np.ix_(place, place)] = rounded(np.pi * A.toarray(), 9)
        np.save(study.parent / f"{name}.npy", six)
    proven = opened(text=FREE)._proven("arm")
    (counted,) = [proof for proof in proven.proofs if proof.what == "rigid motions"]
    assert counted.state == "proven" and proven.held and proven.rigid.shape[1] == 6
    assert not any("softest" in note for note in proven.notes)


@pytest.mark.parametrize(("digits", "coarse"), [(None, True), (10, False), (6, True)], ids=["single", "10", "6"])
def test_few_digits_run_with_error_bars(
    opened: Callable[..., Run], study: Path, saved: Callable[..., FEModel], digits: int | None, coarse: bool
) -> None:
    saved(digits)
    # The check of the frequencies' error bars is as strict as the run's limit on frequencies.
    limit = 1e-6
    run = opened(f"verify.limits={{frequency_error: {limit}}}", text=FREE)
    execute(run, study, report=False)
    facts = json.loads((run.folder / "summary.json").read_text())
    part = facts["components"]["arm"]
    assert part["rigid_modes"] == 6
    hz, bars = np.array(part["frequencies_hz"]), np.array(part["frequency_error_bars_hz"])
    assert bars.shape == hz.shape and (bars > 0).all()
    worst = part["health"]["frequency_error_bar"]
    assert worst["modes"] == np.count_nonzero(bars > limit * hz)
    said = [note for note in facts["notes"] if note.startswith("arm: ") and "too few digits" in note]
    assert bool(said) == coarse == bool(worst["modes"])
    proofs = {proof["what"]: proof for proof in facts["verdict"]["proofs"] if proof["subject"] in ("", "arm")}
    assert proofs["row order"]["state"] == proofs["rigid motions"]["state"] == "proven"
    assert proofs["rigid motions"]["digits"] < (10 if digits == 10 else 7)


def test_a_component_file_is_checked_to_the_digits_of_its_nodes(opened: Callable[..., Run], study: Path) -> None:
    """Its rigid modes are those of K; the motions of the geometry are the same to the digits of the deck."""
    body = line("arm", [0, 0, 0], [0.7777777, 0, 0], 4, masses={3: 0.3})
    assert body.nodes is not None
    write_body(study.parent, body)
    np.save(study.parent / "K.npy", body.K.toarray())
    np.save(study.parent / "M.npy", body.M.toarray())
    grids = [f"GRID,{node},,{x:.6f},0.,0.\n" for node, x in zip(body.nodes.id, body.nodes.xyz[:, 0], strict=True)]
    (study.parent / "arm.bdf").write_text("BEGIN BULK\n" + "".join(grids) + "ENDDATA\n")
    run = opened("write.formats=[hdf5]", text=FREE)
    result = execute(run, study, report=False)
    findings, verdict = check_result(run.folder, Limits())
    momentum = [each for each in findings if each.name.startswith("momentum")]
    assert len(momentum) == 2 and max(each.value for each in momentum) > 1e-8
    # Half a micrometre in two directions, against a radius of gyration of 7 mm about the bar's own axis.
    assert all(each.limit < 2e-4 for each in momentum)
    assert result is not None and verdict.word == result.verdict.word == "not checked"


SLENDER = """\
name: slender
output: {output}
components:
  beam:
    stiffness: K.npy
    mass: M.npy
    geometry: beam.bdf
    rows: rows.txt
    interfaces: {{tip: {{node: 41, dofs: [2]}}}}
    damping: {{modal: 0.01}}
scene:
  band: 5 Hz
  actuators: {{push: {{at: beam.tip, force: [0, 1, 0]}}}}
  sensors: {{up: {{at: beam.tip, measure: [y]}}}}
reduce: {{method: macneal-rubin, cutoff: 3}}
verify: {{limits: {{frf_error: 0.05}}}}
"""


@pytest.mark.parametrize(("digits", "state", "off"), [(7, "unproven", 5e-3), (12, "proven", 2e-5)])
def test_digits_that_do_not_bound_a_frequency_prove_no_rigid_motions(
    opened: Callable[..., Run], study: Path, digits: int, state: str, off: float
) -> None:
    """A clamped beam of 40 elements of unit properties."""
    for name, A in zip("KM", planar_beam(40, held=(0, 1)), strict=False):
        np.save(study.parent / f"{name}.npy", rounded(A.toarray() / 7, digits))
    grids = "".join(f"GRID,{node},,{(node - 1) / 40!r},0.,0.\n" for node in range(1, 42))
    (study.parent / "beam.bdf").write_text(f"BEGIN BULK\n{grids}SPC1,1,123456,1\nENDDATA\n")
    (study.parent / "rows.txt").write_text("".join(f"{node}.2\n{node}.6\n" for node in range(2, 42)))
    result = execute(opened(text=SLENDER), study, report=False)
    proof = next(proof for proof in result.components["beam"].proofs if proof.what == "rigid motions")
    assert proof.state == state
    said = "beam: the digits of the files do not bound the error of 0.55"
    assert any(note.startswith(said) for note in result.notes) == (state == "unproven")
    # The closed form of a clamped beam.
    assert result.components["beam"].modes.frequencies_hz[0] == pytest.approx(1.87510407**2 / (2 * np.pi), rel=off)


CONDENSED = """\
name: condensed
output: {output}
components:
  wing:
    stiffness: {{file: wing.op4, matrix: KAA}}
    mass: {{file: wing.op4, matrix: MAA}}
    geometry: wing.bdf
    rows: rows.txt
    interfaces: {{root: {{node: 1}}}}
    damping: {{modal: 0.01}}
scene:
  band: 2 Hz
  actuators: {{lift: {{at: wing.201, force: [0, 0, 1]}}}}
  sensors: {{up: {{at: wing.101, measure: z}}}}
reduce: {{cutoff: 3}}
verify: {{limits: {{frf_error: 0.05}}}}
"""


@pytest.mark.parametrize("level", [1e-10, 4e-10])
def test_a_superelement_with_the_noise_of_condensation_passes(
    opened: Callable[..., Run], study: Path, level: float
) -> None:
    exact = wing(200, 10)
    own = np.sqrt(exact.K.diagonal())
    draw = np.random.default_rng(1).standard_normal(exact.K.shape)
    noisy = exact.K.toarray() + level * (draw + draw.T) / 6 * np.outer(own, own)
    write_body(study.parent, replace(exact, K=sp.csc_array(noisy)))
    (study.parent / "rows.txt").write_text("".join(f"{label}\n" for label in exact.dofs.labels))
    run = opened(text=CONDENSED)
    result = execute(run, study, report=False)
    part = result.components["wing"]
    assert result.verdict.word == "PASS" and part.modes.rigid_count == 6
    proof = next(proof for proof in part.proofs if proof.what == "rigid motions")
    assert proof.state == "proven" and 7 < proof.digits < 9 and "noise of" in proof.remark
    # Below the first bending of the wing there is nothing else.
    assert part.modes.frequencies_hz[6] == pytest.approx(0.0941228, rel=1e-5)


@pytest.mark.parametrize("digits", [None, 10, 6], ids=["single", "10", "6"])
def test_exchanged_nodes_are_refused_in_few_digits(
    opened: Callable[..., Run], saved: Callable[..., FEModel], digits: int | None
) -> None:
    saved(digits, (2, 4))
    run = opened(text=FREE)
    with pytest.raises(DofMapError, match="rigid motion must cost no force"):
        _ = run.bodies
