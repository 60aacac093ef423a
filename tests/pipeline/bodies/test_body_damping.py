"""Damping of a body: no energy to any motion, no drag on a floating body, no ratio beyond belief."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg as la
import scipy.sparse as sp
from click.testing import CliRunner, Result

from cmsreduce.cli import main
from cmsreduce.model import FEModel
from tests.frames import line
from tests.pipeline.study import write_body

PIPELINE = """\
name: bar
output: {output}
components:
  bar:
    stiffness: {{file: bar.op4, matrix: KAA}}
    mass: {{file: bar.op4, matrix: MAA}}
    geometry: bar.bdf
    damping: {damping}
    {more}
scene:
  band: 300 Hz
  {scene}
  actuators: {{push: {{at: bar.5, force: [0, 1, 1]}}}}
  sensors: {{tip: {{at: bar.3, measure: z}}}}
reduce: {{cutoff: 3}}
verify: {{frf: {{points: 40}}, limits: {{frequency_error: 100 %}}}}
"""
BETA = 1e-6
Array = np.ndarray[Any, np.dtype[np.float64]]
Attempt = Callable[..., tuple[Result, Mapping[str, Any] | None]]


def bar() -> FEModel:
    """A bar along x with a lump, so that no mode is as its mirror image."""
    return line("bar", [0, 0, 0], [0.8, 0, 0], 6, masses={3: 0.3})


def modes(body: FEModel) -> tuple[Array, Array]:
    """Frequencies in rad/s and shapes of the elastic modes of a floating body."""
    lam, V = la.eigh(body.K.toarray(), body.M.toarray())
    return np.sqrt(lam[6:]), V[:, 6:]


def column(body: FEModel, **weights: float) -> Array:
    """Motion of a damper's ends: weights of dofs such as ``n3z``."""
    d = np.zeros((body.n, 1))
    for label, weight in weights.items():
        d[body.dofs.rows(int(label[1:-1]), "xyz".index(label[-1]) + 1)] = weight
    return d


@pytest.fixture
def attempt(tmp_path: Path) -> Attempt:
    """Run the bar with a damping matrix or a law; the result of the command and its summary."""

    def run(D: Array | None = None, law: str = "", body: FEModel | None = None, scene: str = "", more: str = "") -> Any:
        write_body(tmp_path, bar() if body is None else body)
        if D is not None:
            sp.save_npz(tmp_path / "D.npz", sp.csc_array(D))
            law = "{matrix: {file: D.npz}}"
        path = tmp_path / "bar.yaml"
        path.write_text(PIPELINE.format(output=tmp_path / "out", damping=law, scene=scene, more=more))
        said = CliRunner().invoke(main, ["run", str(path), "--quiet"])
        summary = tmp_path / "out" / "summary.json"
        return said, json.loads(summary.read_text()) if summary.exists() else None

    return run


def proofs(facts: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    return {proof["what"]: proof for proof in facts["verdict"]["proofs"]}


def refused(said: Result) -> str:
    assert said.exit_code == 2 and said.stderr.startswith("error: "), said.output
    return said.stderr


def test_a_matrix_made_of_the_stiffness_is_proven(attempt: Attempt) -> None:
    said, facts = attempt(BETA * bar().K.toarray())
    assert said.exit_code == 0 and facts is not None, said.output
    assert facts["verdict"]["word"] == "PASS"
    found = proofs(facts)
    assert found["damping"]["state"] == "proven" and found["damping"]["digits"] > 7
    assert found["stability"]["state"] == "proven"


@pytest.mark.parametrize("mode", [0, 3, 7])
@pytest.mark.parametrize("zeta", [-0.017, -1e-6])
def test_a_mode_that_gains_energy_is_named(attempt: Attempt, mode: int, zeta: float) -> None:
    """D = beta K less a share of one mode. With enough beta the diagonal stays positive and shows nothing."""
    body = bar()
    w, Phi = modes(body)
    beta = 0.2 / w[0]
    momentum = body.M @ Phi[:, [mode]]
    D = beta * body.K.toarray() - (beta * w[mode] ** 2 - 2 * zeta * w[mode]) * momentum @ momentum.T
    message = refused(attempt(D)[0])
    assert "damping matrix D is not positive semidefinite" in message
    # Where the file shows a negative diagonal entry, the row is named before any mode is known.
    assert mode > 0 or D.diagonal().min() > 0
    if D.diagonal().min() > 0:
        assert f"the mode at {w[mode] / (2 * np.pi):.6g} Hz" in message.replace("\n", " ")
        assert f"damping ratio is {zeta:.3g}" in message


def test_energy_that_only_a_combination_of_modes_gains_is_found(attempt: Attempt) -> None:
    """Each mode alone loses energy; the sum of two gains some."""
    body = bar()
    w, Phi = modes(body)
    pair = body.M @ Phi[:, [1, 4]] * np.sqrt(w[[1, 4]])
    D = BETA * body.K.toarray() + pair @ np.array([[0.02, -0.03], [-0.03, 0.02]]) @ pair.T
    message = refused(attempt(D)[0])
    assert "takes energy from each mode alone, but gives energy to a motion of several" in message


def test_a_body_too_large_for_a_factor_is_proven_on_its_modes(
    attempt: Attempt, monkeypatch: pytest.MonkeyPatch
) -> None:
    from cmsreduce.pipeline.bodies import body_damping

    monkeypatch.setattr(body_damping, "_FACTORISED", 10)
    body = bar()
    w, Phi = modes(body)
    _, facts = attempt(BETA * body.K.toarray())
    assert facts is not None and "shapes of the mode set" in proofs(facts)["damping"]["remark"]
    beta = 0.2 / w[0]
    momentum = body.M @ Phi[:, [2]]
    D = beta * body.K.toarray() - (beta * w[2] ** 2 + 0.02 * w[2]) * momentum @ momentum.T
    assert f"the mode at {w[2] / (2 * np.pi):.6g} Hz" in refused(attempt(D)[0])


DAMPERS = {
    "to the ground": ({"n3z": 1.0}, "a damper to the ground", "3.3"),
    "not on its line": ({"n3z": 1.0, "n5z": -1.0}, "between two nodes that is not on their line", "5.3"),
}


@pytest.mark.parametrize("stiff", [0.0, BETA], ids=["alone", "beside beta K"])
@pytest.mark.parametrize(("ends", "cause", "dof"), DAMPERS.values(), ids=DAMPERS)
def test_damping_of_the_rigid_motion_of_a_floating_body_is_refused(
    attempt: Attempt, ends: dict[str, float], cause: str, dof: str, stiff: float
) -> None:
    body = bar()
    d = column(body, **ends)
    message = refused(attempt(stiff * body.K.toarray() + 0.01 * d @ d.T)[0])
    assert "damps rigid motion" in message and cause in message and dof in message


def test_a_damper_along_its_line_damps_no_rigid_motion(attempt: Attempt) -> None:
    body = bar()
    d = column(body, n2x=1.0, n5x=-1.0)
    said, facts = attempt(BETA * body.K.toarray() + 3.0 * d @ d.T)
    assert said.exit_code == 0, said.output
    assert facts is not None and "none from rigid ones" in proofs(facts)["damping"]["remark"]


def test_a_damper_to_the_ground_beside_a_spring_to_the_ground_is_fine(attempt: Attempt) -> None:
    """The stiffness holds the body at one end, and a damper to the ground acts at the other."""
    from dataclasses import replace

    body = bar()
    K = body.K.tolil()
    for component in range(1, 7):
        row = int(body.dofs.rows(1, component)[0])
        K[row, row] += 1e7
    d = column(body, n7z=1.0)
    said, facts = attempt(
        BETA * K.toarray() + 3.0 * d @ d.T, body=replace(body, K=sp.csc_array(K)), more="grounded: true"
    )
    assert said.exit_code == 0, said.output
    assert facts is not None and proofs(facts)["damping"]["state"] == "proven"


def test_mass_proportional_damping_of_a_floating_body_is_named(attempt: Attempt) -> None:
    body = bar()
    message = refused(attempt(BETA * body.K.toarray() + 0.3 * body.M.toarray())[0])
    assert "it holds 0.3 times the mass matrix" in message and "rayleigh" in message


def test_the_stiffness_in_the_place_of_the_damping_is_named(attempt: Attempt) -> None:
    message = refused(attempt(2.0 * bar().K.toarray())[0])
    assert "beyond critical" in message and "D is K times 2 s" in message


def test_rayleigh_factors_that_leave_no_vibration_are_refused(attempt: Attempt) -> None:
    message = refused(attempt(law="{rayleigh: {beta: 1}}")[0])
    assert "Rayleigh factors damp every elastic mode beyond critical" in message
    # Modes far above the band may be overdamped: that is how beta K acts.
    said, _ = attempt(law="{rayleigh: {beta: 1e-5}}")
    assert said.exit_code == 0, said.output


LAWS = {
    "modal": ("{modal: 5}", "damping.modal': 5 is 500 %: did you mean 0.05, which is 5 %"),
    "one": ("{modal: 1}", "1 is 100 %"),
    "structural": ("{structural: 2}", "did you mean 0.02, which is 2 %"),
    "per mode": ("{per_mode: [0.01, 3]}", "damping.per_mode[1]': 3 is 300 %"),
    "table": ("{table: [[1 Hz, 0.01], [10 Hz, 2]]}", "2 is 200 %"),
}


@pytest.mark.parametrize(("law", "text"), LAWS.values(), ids=LAWS)
def test_per_cent_without_their_sign_are_refused(attempt: Attempt, law: str, text: str) -> None:
    assert text in refused(attempt(law=law)[0])


@pytest.mark.parametrize(
    ("law", "ratio"),
    [
        ("{modal: 0.5 %}", 0.005),
        ("{structural: 1 %}", 0.005),
        ("{modal: 500 %}", 5.0),
        ("{per_mode: [2%, 0.01]}", 0.02),
    ],
)
def test_per_cent_with_their_sign_are_taken_as_they_are(attempt: Attempt, law: str, ratio: float) -> None:
    said, facts = attempt(law=law)
    assert said.exit_code == 0 and facts is not None, said.output
    noted = any("% of critical damping" in note for note in facts["notes"])
    assert noted == (ratio > 0.3)
    found = proofs(facts)
    assert found["damping"]["state"] == found["stability"]["state"] == "proven"


def test_a_high_ratio_is_noted(attempt: Attempt) -> None:
    _, facts = attempt(law="{modal: 0.5}")
    assert facts is not None
    assert any("50 % of critical damping" in note and "did you mean 0.005" in note for note in facts["notes"])


@pytest.mark.parametrize("scale", [1.0, 1e-6])
def test_a_condensed_damping_matrix_is_not_taken_for_one_that_gains(scale: float) -> None:
    """Guyan condensation of a fine bar leaves the rounding of large parts in D = beta K."""
    from dataclasses import replace

    from cmsreduce.orthogonalise import orthogonalise
    from cmsreduce.reduce import CraigBampton

    fine = line("bar", [0, 0, 0], [0.8, 0, 0], 200)
    kept = np.flatnonzero(np.isin(fine.dofs.node, np.arange(1, 202, 20)))
    rest = np.setdiff1d(np.arange(fine.n), kept)
    K, M = fine.K.toarray(), fine.M.toarray()
    T = np.zeros((fine.n, kept.size))
    T[kept] = np.eye(kept.size)
    T[rest] = -np.linalg.solve(K[np.ix_(rest, rest)], K[np.ix_(rest, kept)])
    K, M = (T.T @ A @ T for A in (K, M))
    D = T.T @ (scale * BETA * fine.K.toarray()) @ T
    coarse = line("bar", [0, 0, 0], [0.8, 0, 0], 10)
    body = replace(coarse, K=sp.csc_array((K + K.T) / 2), M=sp.csc_array((M + M.T) / 2), D=sp.csc_array((D + D.T) / 2))
    modal = orthogonalise(CraigBampton(cutoff_hz=2000.0).reduce(body))
    e = modal.elastic
    np.testing.assert_allclose(modal.zeta[e], scale * BETA * modal.omega[e] / 2, rtol=1e-6)
