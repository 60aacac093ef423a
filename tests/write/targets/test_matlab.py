"""MAT 5 files: every kind of value, whole or not at all; state space of a body with shapes that carry no mass."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import control
import numpy as np
import pytest
import scipy.sparse as sp
from scipy.io import loadmat

from cmsreduce.errors import WriteError
from cmsreduce.model import Damping, FloatingFrame, FrameCondition, ModalComponent
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.reduce import CraigBampton
from cmsreduce.write import StateSpace, component_states, read_component, write_component, write_matlab
from cmsreduce.write.targets.state_space import write_abcd
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


def from_file(folder: Path, component: ModalComponent, inputs: dict, outputs: dict, **options: object) -> StateSpace:
    """State space by way of the component file, which is all that it takes."""
    path = folder / "body.h5"
    write_component(path, component, nodes=(), inputs=inputs, outputs=outputs, checks=(), provenance={}, **options)
    return component_states(read_component(path))


def test_a_bar_answers_as_the_sum_of_its_modes(tmp_path: Path) -> None:
    component = bar()
    force, row = component.Phi[-1], component.Phi[-4]
    found = from_file(tmp_path, component, {"push": force}, {"gyro": (np.zeros_like(row), row)})
    assert list(found.inputs)[:2] == ["push", "a.1.1"] and next(iter(found.outputs)) == "gyro"
    w = 2 * np.pi * 170.0
    H = control.ss(found.A, found.B, found.C, found.D)(1j * w)[0, 0]
    by_modes = 1j * w * np.sum(force * row / (component.omega**2 - w**2 + 2j * component.zeta * component.omega * w))
    assert abs(H - by_modes) < 1e-9 * abs(by_modes)


def test_text_holds_the_same_numbers(tmp_path: Path) -> None:
    """Parsed by its grammar: lines of % say name, rows and columns."""
    component = bar()
    force, row = component.Phi[-1], component.Phi[-4]
    found = from_file(tmp_path, component, {"push": force}, {"gyro": (np.zeros_like(row), row)})
    write_abcd(tmp_path / "bar.abcd.txt", read_component(tmp_path / "body.h5"))
    lines = (tmp_path / "bar.abcd.txt").read_text().splitlines()
    assert lines[1].split()[1:3] == ["INPUTS", "push"] and lines[2].split()[1:3] == ["OUTPUTS", "gyro"]
    for letter in "ABCD":
        at = next(k for k, line in enumerate(lines) if line.startswith(f"% {letter} "))
        rows, columns = (int(word) for word in lines[at].split()[2:])
        back = np.array([[float(word) for word in line.split()] for line in lines[at + 1 : at + 1 + rows]])
        assert back.shape == (rows, columns)
        np.testing.assert_array_equal(back, getattr(found, letter))


def test_shapes_without_mass_are_feedthrough(tmp_path: Path) -> None:
    # The last point has no mass and hangs on a spring of 40.
    body = springs("tip", [(1, 2, 100.0), (2, 3, 40.0)], [1.0, 2.0, 0.0])
    component = orthogonalise(CraigBampton(10.0).reduce(body, [1, 2]))
    assert component.static_count == 1
    force, none = component.Phi[2], np.zeros(component.omega.size)
    found = from_file(tmp_path, component, {"push": force}, {"tip": (force, none)})
    assert found.D[0, 0] == pytest.approx(1 / 40.0, rel=1e-12)
    assert found.A.shape == (4, 4)
    with pytest.raises(WriteError, match="derivative of an input"):
        from_file(tmp_path, component, {"push": force}, {"tip": (none, force)})


@pytest.mark.parametrize("law", ["stiffness", "dashpot", "elsewhere"])
def test_a_damped_shape_without_mass_is_no_feedthrough(tmp_path: Path, law: str) -> None:
    """The last point lags behind its load where beta K or a dashpot damps it; a dashpot elsewhere is in the states."""
    body = springs("tip", [(1, 2, 100.0), (2, 3, 40.0)], [1.0, 2.0, 0.0])
    D = 0.01 * body.K.toarray()
    if law == "stiffness":
        body = replace(body, damping=Damping(rayleigh=(0.0, 0.01)))
    else:
        D = np.zeros((3, 3))
        ends = [1, 2] if law == "dashpot" else [0, 1]
        D[np.ix_(ends, ends)] = [[5.0, -5.0], [-5.0, 5.0]]
        body = replace(body, D=sp.csc_array(D))
    component = orthogonalise(CraigBampton(10.0).reduce(body, [1, 2]))
    force, none = component.Phi[2], np.zeros(component.omega.size)
    channels = {"push": force}, {"tip": (force, none)}
    if law != "elsewhere":
        with pytest.raises(WriteError, match="lags behind its load"):
            from_file(tmp_path, component, *channels)
        return
    found = from_file(tmp_path, component, *channels)
    w = 10.0
    expected = np.linalg.inv(body.K.toarray() + 1j * w * D - w**2 * body.M.toarray())[2, 2]
    assert control.ss(found.A, found.B, found.C, found.D)(1j * w) == pytest.approx(expected, rel=1e-9)


def test_structural_damping_is_refused(tmp_path: Path) -> None:
    component = bar()
    damped = replace(component, body=replace(component.body, damping=Damping(structural=0.02)))
    with pytest.raises(WriteError, match="complex stiffness"):
        from_file(tmp_path, damped, {}, {})


def test_the_frame_of_the_file_does_not_matter(tmp_path: Path) -> None:
    """Modes seen from a clamped frame have rigid motion taken off; states are of the modes as ever."""
    component = bar()
    force, row = component.Phi[-1], component.Phi[-4]
    channels = {"push": force}, {"gyro": (np.zeros_like(row), row)}
    removed = np.random.default_rng(2).standard_normal((6, component.elastic_count))
    frame = FloatingFrame(
        FrameCondition("clamped", at="a"), np.zeros(3), np.eye(3), removed, np.array([1] * 6), np.arange(1, 7), 0.0
    )
    plain = from_file(tmp_path, component, *channels)
    framed = from_file(tmp_path, component, *channels, frame=frame)
    for letter in "ABCD":
        expected = getattr(plain, letter)
        np.testing.assert_allclose(getattr(framed, letter), expected, rtol=0, atol=1e-12 * max(abs(expected).max(), 1))
