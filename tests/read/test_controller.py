"""Controllers from text and from MATLAB files, and files that hold no controller."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from cmsreduce.errors import ReadError
from cmsreduce.read import read_controller

SENSORS, ACTUATORS = ("gyro.ry", "gyro.rz", "probe"), ("motor", "thruster")
A = np.array([[0.0, 1.0], [-100.0, -14.0]])
B = np.array([[0.0, 0.5, 0.0], [100.0, 0.0, -1e-3]])
C = np.array([[3.0, 0.0], [0.0, -2.0]])
D = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 0.25]])

TEXT = """\
# second-order lag
A
0 1
-100, -14     % rows with blanks or commas
B:
0 0.5 0
100 0 -1e-3
C
3 0
0 -2
D =
0 1 0
0 0 0.25
"""


def test_text_and_matlab_give_the_same(tmp_path: Path) -> None:
    text, mat = tmp_path / "k.txt", tmp_path / "k.mat"
    text.write_text(TEXT)
    savemat(mat, {"A": A, "B": B, "C": C, "D": D, "name": "k"})
    for path in (text, mat):
        found = read_controller(path, SENSORS, ACTUATORS)
        for letter, expected in zip("ABCD", (A, B, C, D), strict=True):
            np.testing.assert_array_equal(getattr(found, letter), expected)


def test_a_gain_alone_and_states_without_feedthrough(tmp_path: Path) -> None:
    gain, states = tmp_path / "gain.txt", tmp_path / "states.txt"
    gain.write_text("D\n1 0 0\n0 2 0\n")
    states.write_text(TEXT.partition("D =")[0])
    found = read_controller(gain, SENSORS, ACTUATORS)
    assert found.states == 0 and found.C.shape == (2, 0)
    np.testing.assert_array_equal(found.D, [[1, 0, 0], [0, 2, 0]])
    np.testing.assert_array_equal(read_controller(states, SENSORS, ACTUATORS).D, np.zeros((2, 3)))


BAD = {
    "missing": (None, "k.txt", "no such file"),
    "empty": ("", "k.txt", "empty"),
    "a word among numbers": ("D\n1 2 x\n", "line 2", "no row of numbers"),
    "a short row": ("A\n0 1\n1\n", "line 3", "has 1 numbers"),
    "twice": ("A\n1\nA\n1\n", "line 3", "appears twice"),
    "no output matrix": (TEXT.partition("C\n")[0], "lacks C", "C (actuators x n)"),
    "a state matrix alone with a gain": ("A\n1\nD\n1 0 0\n0 1 0\n", "lacks B, C", "has states"),
    "too few inputs": ("D\n1 0\n0 1\n", "D is 2 x 2, but must be 2 x 3", "gyro.ry, gyro.rz, probe"),
    "a state matrix that is not square": (TEXT.replace("-100, -14 ", "% "), "A is 1 x 2", "must be 1 x 1"),
    "not finite": ("D\n1 0 nan\n0 1 0\n", "D holds", "not finite"),
}


@pytest.mark.parametrize(("text", "first", "second"), BAD.values(), ids=BAD)
def test_what_is_no_controller_is_refused(tmp_path: Path, text: str | None, first: str, second: str) -> None:
    path = tmp_path / "k.txt"
    if text is not None:
        path.write_text(text)
    with pytest.raises(ReadError) as caught:
        read_controller(path, SENSORS, ACTUATORS)
    assert first in str(caught.value) and second in str(caught.value), str(caught.value)


def test_a_file_of_other_matrices_is_refused(tmp_path: Path) -> None:
    savemat(tmp_path / "k.mat", {"KAA": np.eye(3)})
    with pytest.raises(ReadError, match="no controller, it holds KAA"):
        read_controller(tmp_path / "k.mat", SENSORS, ACTUATORS)
