"""MAT 5 files: every kind of value, whole or not at all; state space of a body with shapes that carry no mass."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import control
import numpy as np
import pytest
from scipy.io import loadmat

from cmsreduce.errors import WriteError
from cmsreduce.model import Damping, ModalComponent
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.reduce import CraigBampton
from cmsreduce.write import component_states, write_matlab
from tests.frames import line
from tests.hard.structures import springs


def test_values_come_back(tmp_path: Path) -> None:
    A = np.arange(6.0).reshape(2, 3)
    values = {
        "A": A,
        "column": A[0],
        "number": 2.5,
        "text": "Scheibe",
        "texts": ["motor", "spin.rz"],
        "none": [],
        "parts": [{"A": A, "name": "one"}, {"A": 2 * A, "name": "two"}],
    }
    write_matlab(tmp_path / "file.mat", values)
    back = loadmat(tmp_path / "file.mat")
    np.testing.assert_array_equal(back["A"], A)
    assert back["column"].shape == (3, 1) and back["number"].item() == 2.5
    assert back["text"].item() == "Scheibe"
    assert [cell.item() for cell in back["texts"].ravel()] == ["motor", "spin.rz"]
    assert back["none"].size == 0
    second = back["parts"][1, 0][0, 0]
    np.testing.assert_array_equal(second["A"], 2 * A)
    assert second["name"].item() == "two"


def test_a_file_that_cannot_be_written_leaves_the_old_one(tmp_path: Path) -> None:
    path = tmp_path / "file.mat"
    write_matlab(path, {"a": 1.0})
    before = path.read_bytes()
    # Variables of MATLAB hold numbers and texts.
    with pytest.raises(TypeError):
        write_matlab(path, {"a": object()})
    assert path.read_bytes() == before
    assert [each.name for each in tmp_path.iterdir()] == ["file.mat"]


def bar(**changes: object) -> ModalComponent:
    body = replace(line("bar", [0, 0, 0], [1, 0, 0], 6), damping=Damping(modal=(0.01,)), **changes)  # type: ignore[arg-type]
    return orthogonalise(CraigBampton(4000.0).reduce(body, body.interface_rows("a")))


def test_a_bar_answers_as_the_sum_of_its_modes() -> None:
    component = bar()
    force, row = component.Phi[-1], component.Phi[-4]
    found = component_states(component, {"push": force}, {"gyro": (np.zeros_like(row), row)})
    assert list(found.inputs)[:2] == ["push", "a.1.1"] and next(iter(found.outputs)) == "gyro"
    w = 2 * np.pi * 170.0
    H = control.ss(found.A, found.B, found.C, found.D)(1j * w)[0, 0]
    by_modes = 1j * w * np.sum(force * row / (component.omega**2 - w**2 + 2j * component.zeta * component.omega * w))
    assert abs(H - by_modes) < 1e-9 * abs(by_modes)


def test_shapes_without_mass_are_feedthrough() -> None:
    # The last point has no mass and hangs on a spring of 40.
    body = springs("tip", [(1, 2, 100.0), (2, 3, 40.0)], [1.0, 2.0, 0.0])
    component = orthogonalise(CraigBampton(10.0).reduce(body, [1, 2]))
    assert component.static_count == 1
    force, none = component.Phi[2], np.zeros(component.omega.size)
    found = component_states(component, {"push": force}, {"tip": (force, none)})
    assert found.D[0, 0] == pytest.approx(1 / 40.0, rel=1e-12)
    assert found.A.shape == (4, 4)
    with pytest.raises(WriteError, match="derivative of an input"):
        component_states(component, {"push": force}, {"tip": (none, force)})


def test_structural_damping_is_refused() -> None:
    component = bar()
    damped = replace(component, body=replace(component.body, damping=Damping(structural=0.02)))
    with pytest.raises(WriteError, match="complex stiffness"):
        component_states(damped, {}, {})
