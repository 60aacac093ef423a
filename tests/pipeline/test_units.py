"""The assembled system as a Functional Mock-up Unit: run by fmpy, it answers as the matrices of system.h5."""

from __future__ import annotations

import ctypes
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.linalg as la
from click.testing import CliRunner

from cmsreduce.cli import main
from cmsreduce.write import read_system, unit_binary

NAME, NUMBER = "hinge=50", 1


class Reference:
    """M x'' + D x' + K x = B u, as the file has it, and its exact steps for inputs that are constant over a step."""

    def __init__(self, folder: Path, number: int) -> None:
        with h5py.File(folder / "system.h5") as file:
            group = file[f"configuration_{number}"]
            M, K, D, B, C1, C2 = (group[name][()] for name in ("M", "K", "D", "B", "C1", "C2"))
        n = len(M)
        self.A = np.block([[np.zeros((n, n)), np.eye(n)], [-la.solve(M, K), -la.solve(M, D)]])
        self.B = np.vstack([np.zeros_like(B), la.solve(M, B)])
        self.C = np.hstack([C1, C2])

    def outputs(self, h: float, u: np.ndarray) -> np.ndarray:
        """Outputs after each step, from rest."""
        n, m = self.B.shape
        step = la.expm(np.block([[self.A, self.B], [np.zeros((m, n + m))]]) * h)
        x, found = np.zeros(n), []
        for now in u:
            x = step[:n, :n] @ x + step[:n, n:] @ now
            found.append(self.C @ x)
        return np.array(found)


def unit(study: Path, folder: Path, version: str) -> Path:
    path = folder / "study.fmu"
    arguments = ["convert", str(study / "out" / "system.h5"), str(path), "--configuration", NAME, "--dialect", version]
    result = CliRunner().invoke(main, arguments)
    assert result.exit_code == 0, result.output
    return path


def signals(h: float, steps: int) -> tuple[np.ndarray, np.ndarray]:
    """Inputs of motor and thruster at the start of each step, as numbers and as fmpy takes them."""
    t = h * np.arange(steps + 1)
    u = np.column_stack([np.sin(40 * t) + 0.3, np.where(t < 0.05, 2.0, -1.0)])
    named = np.array([(now, *row) for now, row in zip(t, u, strict=True)], dtype=[(c, float) for c in _COLUMNS])
    return u[:-1], named


_DOUBLES = ctypes.POINTER(ctypes.c_double)
_COLUMNS = ("time", "motor", "thruster")
_OUTPUTS = ("gyro.ry", "gyro.rz", "probe")


@pytest.mark.parametrize("version", ["fmi3", "fmi2"])
def test_co_simulation_answers_as_the_system(finished_study: Path, tmp_path: Path, version: str) -> None:
    fmpy = pytest.importorskip("fmpy")
    from fmpy.validation import validate_fmu

    path = unit(finished_study, tmp_path, version)
    if not unit_binary(path):
        pytest.skip("there is no C compiler")
    assert validate_fmu(str(path)) == []
    # Steps longer than most periods are as exact as short ones.
    h, steps = 2e-3, 150
    u, given = signals(h, steps)
    seen = fmpy.simulate_fmu(
        str(path), fmi_type="CoSimulation", stop_time=h * steps, output_interval=h, input=given, output=list(_OUTPUTS)
    )
    expected = Reference(finished_study / "out", NUMBER).outputs(h, u)
    for column, name in enumerate(_OUTPUTS):
        largest = abs(expected[:, column]).max()
        assert largest > 0
        np.testing.assert_allclose(seen[name][1:], expected[:, column], rtol=0, atol=1e-8 * largest)


def test_model_exchange_has_the_derivatives_of_the_system(finished_study: Path, tmp_path: Path) -> None:
    """Directional derivatives of all states and inputs make the system's frequency response."""
    fmpy = pytest.importorskip("fmpy")
    from fmpy.fmi3 import FMU3Model

    path = unit(finished_study, tmp_path, "fmi3")
    if not unit_binary(path):
        pytest.skip("there is no C compiler")
    folder, about = fmpy.extract(str(path), str(tmp_path / "unit")), fmpy.read_model_description(str(path))
    identifier = about.modelExchange.modelIdentifier
    model = FMU3Model(guid=about.guid, unzipDirectory=folder, modelIdentifier=identifier, instanceName="one")
    model.instantiate()
    model.enterInitializationMode()
    model.exitInitializationMode()
    found = {kind: [v for v in about.modelVariables if v.causality == kind] for kind in ("input", "output")}
    states = [unknown.variable.derivative.valueReference for unknown in about.derivatives]
    rates = [unknown.variable.valueReference for unknown in about.derivatives]
    known = states + [v.valueReference for v in found["input"]]
    unknown = rates + [v.valueReference for v in found["output"]]
    J = np.array([model.getDirectionalDerivative(unknown, known, seed.tolist()) for seed in np.eye(len(known))]).T
    adjoint = [model.getAdjointDerivative(unknown, known, seed, len(known)) for seed in np.eye(len(unknown)).tolist()]
    np.testing.assert_array_equal(adjoint, J)
    n = len(states)
    x, dx = np.random.default_rng(3).standard_normal(n), np.zeros(n)
    model.setContinuousStates(x.ctypes.data_as(_DOUBLES), n)
    model.setFloat64([v.valueReference for v in found["input"]], [2.0, -3.0])
    model.getContinuousStateDerivatives(dx.ctypes.data_as(_DOUBLES), n)
    np.testing.assert_allclose(dx, J[:n] @ [*x, 2.0, -3.0], rtol=0, atol=1e-12 * abs(dx).max())
    model.terminate()
    model.freeInstance()
    reference = Reference(finished_study / "out", NUMBER)
    for hertz in (1.0, 14.0, 60.0):
        s = 2j * np.pi * hertz
        seen = J[n:, :n] @ la.solve(s * np.eye(n) - J[:n, :n], J[:n, n:]) + J[n:, n:]
        expected = reference.C @ la.solve(s * np.eye(len(reference.A)) - reference.A, reference.B)
        np.testing.assert_allclose(seen, expected, rtol=0, atol=1e-9 * abs(expected).max())


def test_fmpy_integrates_the_unit(finished_study: Path, tmp_path: Path) -> None:
    fmpy = pytest.importorskip("fmpy")
    path = unit(finished_study, tmp_path, "fmi2")
    if not unit_binary(path):
        pytest.skip("there is no C compiler")
    seen = fmpy.simulate_fmu(
        str(path),
        fmi_type="ModelExchange",
        stop_time=0.01,
        output_interval=1e-3,
        start_values={"motor": 0.7, "thruster": 1.5},
        output=["gyro.ry"],
        relative_tolerance=1e-8,
    )
    expected = Reference(finished_study / "out", NUMBER).outputs(1e-3, np.tile([0.7, 1.5], (10, 1)))[-1, 0]
    assert seen["gyro.ry"][-1] == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ([], "has 2 configurations, and a unit holds one: name it with --configuration (hinge=0, hinge=50)"),
        (["--configuration", "hinge=5"], "there is no configuration 'hinge=5', did you mean 'hinge=50'?"),
        (["--configuration", NAME, "--dialect", "fmi1"], "'fmi1' is no dialect of fmi (its dialects: fmi3, fmi2)"),
    ],
)
def test_bad_input_ends_with_2_and_one_message(
    finished_study: Path, tmp_path: Path, options: list[str], message: str
) -> None:
    system = str(finished_study / "out" / "system.h5")
    result = CliRunner().invoke(main, ["convert", system, str(tmp_path / "x.fmu"), *options])
    assert result.exit_code == 2
    assert message in result.output and result.output.count("error: ") == 1
    assert not list(tmp_path.iterdir())


def test_a_folder_is_made_for_a_unit_of_each_configuration(finished_study: Path, tmp_path: Path) -> None:
    system = str(finished_study / "out" / "system.h5")
    result = CliRunner().invoke(main, ["convert", system, f"{tmp_path}/units/", "--format", "fmi"])
    assert result.exit_code == 0, result.output
    written = sorted(path.name for path in (tmp_path / "units").iterdir())
    assert written == [f"system-{k}.fmu" for k in range(len(read_system(Path(system)).systems))]


def test_a_configuration_is_that_of_a_system(finished_study: Path, tmp_path: Path) -> None:
    arm = str(finished_study / "out" / "arm.h5")
    result = CliRunner().invoke(main, ["convert", arm, str(tmp_path / "x.fmu"), "--configuration", NAME])
    assert result.exit_code == 2 and "--configuration is for system files" in result.output
