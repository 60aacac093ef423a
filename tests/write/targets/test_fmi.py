"""Functional Mock-up Units of linear models: their binary steps exactly, their description says units and names."""

from __future__ import annotations

import ctypes
import shutil
import xml.etree.ElementTree as ET
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as la

from cmsreduce.errors import WriteError
from cmsreduce.model import Units
from cmsreduce.write import LinearModel, Port, unit_binary, write_unit

MS = Units.parse("mm-t-ms")
W = np.array([0.0, 2.0, 30.0, 4000.0])
VERSIONS = ["fmi3", "fmi2"]


def model(units: Units | None = None, *, damping: np.ndarray | None = None, m: int = 4) -> LinearModel:
    """A free body of four modes, two loads and two sensors; a third output follows a load without delay."""
    rng, w = np.random.default_rng(5), np.resize(W, m)
    D = np.diag(0.02 * w) if damping is None else damping
    A = np.block([[np.zeros((m, m)), np.eye(m)], [-np.diag(w**2), -D]])
    time = units.time if units else 1.0
    return LinearModel(
        name="left arm",
        about="test",
        A=A,
        B=np.vstack([np.zeros((m, 2)), rng.standard_normal((m, 2))]),
        C=rng.standard_normal((3, 2 * m)),
        D=np.array([[0.0, 0.0], [0.0, 0.0], [0.5, 0.0]]),
        inputs=(Port("push", "force"), Port("spin.rz", "torque")),
        outputs=(Port("spin.rz", "rotation"), Port("tip", "translation rate"), Port("los", "combination")),
        frequency_hz=w / (2 * np.pi) / time,
        units=units,
    )


class Unit:
    """Co-simulation of a unit of version 2.0 through its C functions."""

    def __init__(self, path: Path) -> None:
        binary = unit_binary(path)
        if not binary:
            pytest.skip("there is no C compiler")
        with zipfile.ZipFile(path) as archive:
            root = ET.fromstring(archive.read("modelDescription.xml"))
            library = archive.extract(binary, path.parent / path.stem)
        self.library = ctypes.CDLL(library)
        self.library.fmi2Instantiate.restype = ctypes.c_void_p
        token = root.attrib["guid"].encode()
        instance = self.library.fmi2Instantiate(b"one", 1, token, b"", None, 0, 0)
        assert instance and not self.library.fmi2Instantiate(b"two", 1, b"another", b"", None, 0, 0)
        self.one = ctypes.c_void_p(instance)
        names = [variable.attrib["name"] for variable in root.iter("ScalarVariable")]
        self.number = {name: number for number, name in enumerate(names)}

    def _pass(self, function: str, names: list[str], values: list[float]) -> np.ndarray:
        references = (ctypes.c_uint * len(names))(*(self.number[name] for name in names))
        numbers = (ctypes.c_double * len(names))(*values)
        assert getattr(self.library, function)(self.one, references, ctypes.c_size_t(len(names)), numbers) == 0
        return np.array(numbers)

    def set(self, **values: float) -> None:
        self._pass("fmi2SetReal", [name.replace("__", ".") for name in values], list(values.values()))

    def get(self, *names: str) -> np.ndarray:
        return self._pass("fmi2GetReal", list(names), [0.0] * len(names))

    def step(self, start: float, h: float) -> int:
        return int(self.library.fmi2DoStep(self.one, ctypes.c_double(start), ctypes.c_double(h), 0))


def coupled() -> np.ndarray:
    """Damping that couples the modes, the free motion included."""
    X = np.random.default_rng(8).standard_normal((4, 4))
    return X @ X.T


@pytest.mark.parametrize("damping", [None, np.zeros((4, 4)), coupled()], ids=["modal", "none", "coupled"])
@pytest.mark.parametrize("units", [None, MS], ids=["SI", "ms"])
def test_steps_are_exact(
    tmp_path: Path, damping: np.ndarray | None, units: Units | None, record_property: Callable[[str, object], None]
) -> None:
    """Steps from a hundredth of the shortest period to hundreds of it, against the exponential of SciPy."""
    linear = model(units, damping=damping)
    write_unit(tmp_path / "arm.fmu", linear, "fmi2")
    unit, second = Unit(tmp_path / "arm.fmu"), units.time if units else 1.0
    x, t = np.zeros(8), 0.0
    u = np.array([0.7, -1.2])
    unit.set(push=u[0], spin__rz=u[1])
    # Modes of very different frequencies, scaled so that SciPy's exponential keeps its digits.
    size = np.concatenate([1 / np.maximum(W, 1.0), np.ones(4)])
    for h in (1e-5, 0.3, 0.3, 2e-3, 1.7):
        A, B = linear.A / size[:, None] * size, linear.B / size[:, None]
        F = la.expm(np.block([[A, B], [np.zeros((2, 10))]]) * h)
        x = size * (F[:8, :8] @ (x / size) + F[:8, 8:] @ u)
        assert unit.step(t * second, h * second) == 0
        t += h
        states = unit.get(*(f"q[{k}]" for k in range(1, 5)), *(f"v[{k}]" for k in range(1, 5)))
        np.testing.assert_allclose(states / size, x / size, rtol=0, atol=1e-10 * abs(x / size).max())
        y = linear.C @ x + linear.D @ u
        names = ["spin.rz output", "tip", "los"]
        error = abs(unit.get(*names) - y).max() / abs(y).max()
        record_property("error", float(error))
        assert error <= 1e-10
    assert unit.get("time")[0] == pytest.approx(t * second)
    assert unit.step(t * second, -0.1) == 3


def test_a_free_body_drifts_without_round_off(tmp_path: Path) -> None:
    linear = model(damping=np.zeros((4, 4)))
    write_unit(tmp_path / "arm.fmu", linear, "fmi2")
    unit = Unit(tmp_path / "arm.fmu")
    unit.set(push=3.0)
    for k in range(1000):
        assert unit.step(float(k), 1.0) == 0
    amplitude = 0.5 * 3.0 * linear.B[4, 0] * 1000.0**2
    assert unit.get("q[1]")[0] == pytest.approx(amplitude, rel=1e-12)


def test_a_state_is_kept_and_restored(tmp_path: Path) -> None:
    write_unit(tmp_path / "arm.fmu", model(), "fmi2")
    unit, state = Unit(tmp_path / "arm.fmu"), ctypes.c_void_p()
    unit.set(push=1.0)
    unit.step(0.0, 0.25)
    assert unit.library.fmi2GetFMUstate(unit.one, ctypes.byref(state)) == 0
    ahead = []
    for _ in range(2):
        unit.set(push=-4.0)
        unit.step(0.25, 0.5)
        ahead.append(unit.get("time", "q[2]", "los"))
        assert unit.library.fmi2SetFMUstate(unit.one, state) == 0
        assert unit.get("time", "push").tolist() == [0.25, 1.0]
    np.testing.assert_array_equal(ahead[0], ahead[1])


@pytest.mark.parametrize("version", VERSIONS)
def test_names_and_units(tmp_path: Path, version: str) -> None:
    """Channels in units of the model, by their SI units; time in seconds."""
    write_unit(tmp_path / "arm.fmu", model(MS), version)
    with zipfile.ZipFile(tmp_path / "arm.fmu") as archive:
        root = ET.fromstring(archive.read("modelDescription.xml"))
    variables = root.find("ModelVariables")
    assert variables is not None
    names = [variable.attrib["name"] for variable in variables]
    assert len(set(names)) == len(names) == 1 + 4 * 4 + 5
    assert names[-5:] == ["push", "spin.rz", "spin.rz output", "tip", "los"]
    typed = variables if version == "fmi3" else [variable[0] for variable in variables]
    unit = {name: entry.attrib.get("unit") for name, entry in zip(names, typed, strict=True)}
    assert [unit[name] for name in names[-5:]] == ["t.mm/ms2", "t.mm2/ms2", "rad", "mm/ms", None]
    base = {entry.attrib["name"]: entry[0].attrib for entry in root.iter("Unit")}
    # 1 t mm / ms^2 = 1e3 kg 1e-3 m / 1e-6 s^2, a millimetre more for the torque; mm / ms = m / s.
    assert float(base["t.mm/ms2"].pop("factor")) == pytest.approx(1e6)
    assert float(base["t.mm2/ms2"].pop("factor")) == pytest.approx(1e3)
    assert base["t.mm/ms2"] == {"kg": "1", "m": "1", "s": "-2"} and base["mm/ms"] == {"m": "1", "s": "-1"}
    experiment = root.find("DefaultExperiment")
    assert experiment is not None
    assert float(experiment.attrib["stopTime"]) == pytest.approx(10 * 2 * np.pi / 2.0 * 1e-3, rel=1e-5)


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("units", [None, MS], ids=["no units", "ms"])
def test_the_checker_of_fmpy_finds_nothing(tmp_path: Path, version: str, units: Units | None) -> None:
    pytest.importorskip("fmpy")
    from fmpy.validation import validate_fmu

    write_unit(tmp_path / "arm.fmu", model(units), version)
    assert validate_fmu(str(tmp_path / "arm.fmu")) == []


@pytest.mark.parametrize("version", VERSIONS)
def test_equal_models_give_equal_bytes(tmp_path: Path, version: str) -> None:
    for name in ("one.fmu", "two.fmu"):
        write_unit(tmp_path / name, model(), version)
    assert (tmp_path / "one.fmu").read_bytes() == (tmp_path / "two.fmu").read_bytes()


def test_without_a_compiler_the_unit_has_its_sources(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: None)
    write_unit(tmp_path / "arm.fmu", model(), "fmi3")
    assert unit_binary(tmp_path / "arm.fmu") == ""
    with zipfile.ZipFile(tmp_path / "arm.fmu") as archive:
        build = ET.fromstring(archive.read("sources/buildDescription.xml"))
        named = {f"sources/{file.attrib['name']}" for file in build.iter("SourceFile")}
        assert named == {"sources/fmi3.c"} <= set(archive.namelist())
        assert {"sources/linear_model.h", "sources/model_data.h"} <= set(archive.namelist())


def test_a_model_too_large_for_exact_steps_is_refused(tmp_path: Path) -> None:
    with pytest.raises(WriteError, match="1002 states are too many for a unit"):
        write_unit(tmp_path / "arm.fmu", model(m=501))
    assert not list(tmp_path.iterdir())
