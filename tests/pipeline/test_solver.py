"""The solver that ran, its proofs and its refusals, in the summary and on the command line."""

from __future__ import annotations

import json
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.linalg as la
from click.testing import CliRunner

from cmsreduce.cli import main
from cmsreduce.config import load_pipeline
from cmsreduce.model import FEModel
from cmsreduce.pipeline import Run, Silent, execute
from tests.pipeline.study import write_body
from tests.solids import block

BAR = """\
name: bar
output: {output}
components:
  bar:
    stiffness: {{file: bar.op4, matrix: KAA}}
    mass: {{file: bar.op4, matrix: MAA}}
    geometry: bar.bdf
    interfaces: {{root: {{nodes: [1, 2, 3, 4, 5, 6, 7, 8, 9]}}}}
    damping: {{modal: 0.01}}
scene:
  band: 1.5 kHz
  ground: bar.root
  actuators: {{push: {{at: bar.252, force: [0, 1, 0]}}}}
  sensors: {{tip: {{at: bar.244, measure: [y, z]}}}}
reduce: {{cutoff: 3}}
solver: {{{solver}}}
"""
CUTOFF_HZ = 4500.0


@pytest.fixture(scope="module")
def bar() -> FEModel:
    """A square bar of 756 dofs along x, whose bending modes come in pairs."""
    return block("bar", [2.7, 0.2, 0.2], [27, 2, 2])


@pytest.fixture(scope="module")
def files(bar: FEModel, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("bar")
    write_body(folder, bar)
    return folder


@pytest.fixture
def run(files: Path, tmp_path: Path) -> Any:
    def with_solver(solver: str) -> tuple[int, str, dict[str, Any]]:
        path = files / f"{tmp_path.name}.yaml"
        path.write_text(BAR.format(output=tmp_path / "out", solver=solver))
        result = CliRunner().invoke(main, ["run", str(path)])
        written = tmp_path / "out" / "summary.json"
        return result.exit_code, result.output, json.loads(written.read_text()) if written.is_file() else {}

    return with_solver


def clamped(body: FEModel, rows: np.ndarray) -> np.ndarray:
    """Frequencies of the body in Hz with all rows held but these, by dense algebra."""
    K, M = (A[rows][:, rows].toarray() for A in (body.K, body.M))
    return np.sqrt(la.eigh(K, M, eigvals_only=True)) / (2 * np.pi)


@pytest.mark.parametrize(
    "backend",
    [pytest.param(name, marks=getattr(pytest.mark, name)) for name in ("pardiso", "cholmod", "mumps")]
    + ["multifrontal", "superlu"],
)
def test_each_solver_finds_the_modes_that_dense_algebra_finds(run, bar, backend):
    code, output, summary = run(f"backend: {backend}, threads: 1")
    assert code == 0, output
    part = summary["components"]["bar"]
    # CHOLMOD has no pivots for a shifted matrix: there SuperLU counts, and PARDISO for fronts without pivots.
    counts = {"cholmod": "superlu", "multifrontal": "pardiso"}.get(backend, "superlu")
    assert set(part["solver"]["backends"]) <= {backend, counts} and backend in part["solver"]["backends"]
    assert part["solver"]["factorisations"] >= 2 and part["solver"]["largest"]["rows"] > 600
    # The dof that is pushed is held with the root.
    held = np.r_[:27, bar.dofs.rows_of(252, [2])]
    below = int(np.count_nonzero(clamped(bar, np.setdiff1d(np.arange(bar.n), held)) <= CUTOFF_HZ))
    assert below > 10
    certificate = part["certificate"]
    assert certificate["counted"] == certificate["found"] == below
    assert certificate["cutoff_hz"] == CUTOFF_HZ and 0 < certificate["frequency_bound"] < 1e-8
    found = summary["system"][0]["frequencies_hz"][:6]
    np.testing.assert_allclose(found, clamped(bar, np.arange(27, bar.n))[:6], rtol=1e-5)


def test_mumps_without_its_interpreter_is_refused(run):
    code, output, _ = run("backend: mumps, python: /nowhere/python3")
    assert code == 2
    assert "there is no interpreter /nowhere/python3" in " ".join(output.split())
    assert "solver.python" in output


def test_a_factor_that_does_not_fit_is_refused(run):
    code, output, summary = run("backend: superlu, memory: 100 kB")
    assert code == 2 and not summary
    assert (
        "'bar'" in output and "0.0000931 GiB" in output.replace("9.31e-05", "0.0000931") and "solver.memory" in output
    )


def test_a_solver_that_is_not_installed_is_refused(run, monkeypatch):
    backends = import_module("cmsreduce.linalg.sparse.factorisation")
    monkeypatch.setattr(backends, "installed", lambda backend: backend == "superlu")
    code, output, _ = run("backend: cholmod")
    assert code == 2 and "'cholmod' is not installed here; installed: superlu" in output


@pytest.mark.pardiso
def test_the_unreduced_body_is_represented_under_the_same_settings(files: Path, tmp_path: Path, monkeypatch) -> None:
    """By modes, as a larger body; without settings it would take SuperLU for so few rows."""
    monkeypatch.setattr(import_module("cmsreduce.pipeline.bodies.reference"), "ALL_MODES_LIMIT", 0)
    path = files / f"{tmp_path.name}.yaml"
    path.write_text(BAR.format(output=tmp_path / "out", solver="backend: pardiso"))
    run = Run(load_pipeline(path), tmp_path / "out", Silent())
    assert run.references["bar"].label == "modes to 2 x cutoff"
    done = run.stages.factorised["bar"]["reference"]
    assert done and {each.backend for each in done} == {"pardiso"}


@pytest.mark.pardiso
@pytest.mark.parametrize(("verify", "until"), [("", "write"), ("verify: {}\n", "write"), ("verify: {}\n", "reduce")])
def test_the_modes_of_the_reference_count_those_of_the_reduction(
    verify: str, until: str, bar: FEModel, files: Path, tmp_path: Path, monkeypatch
) -> None:
    """Where the run makes the reference in any case, the reduction makes no factor; the count is the same."""
    monkeypatch.setattr(import_module("cmsreduce.pipeline.bodies.reference"), "ALL_MODES_LIMIT", 0)
    path = files / f"{tmp_path.name}.yaml"
    path.write_text(BAR.format(output=tmp_path / "out", solver="backend: pardiso") + verify)
    run = Run(load_pipeline(path), tmp_path / "out", Silent())
    execute(run, path, (), None if until == "write" else until, report=False)
    factors, certificate = run.stages.factorised["bar"], run.modal("bar").certificate
    # The dof that is pushed is held with the root.
    free = np.setdiff1d(np.arange(27, bar.n), bar.dofs.rows_of(252, [2]))
    exact = np.count_nonzero(clamped(bar, free) < CUTOFF_HZ)
    assert certificate is not None and certificate.counted == certificate.frequency_hz.size == exact
    counted = verify != "" and until == "write"
    assert ("reference" in factors) == counted
    assert len(factors["reduce"]) == (0 if counted else 2)
