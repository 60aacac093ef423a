"""Folders for 42: read as 42's own scanners read them, and run."""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from types import ModuleType

import numpy as np

__all__ = ["PROGRAM", "Body", "Folder42", "simulated"]

PROGRAM = os.environ.get("CMSREDUCE_42", "")
"""Path of the program 42, in the folder where it was built."""

_NAMES = count()


class Scan:
    """A file as `fscanf` takes it: values in their order, then a comment that must be there, to the end of the line."""

    def __init__(self, path: Path, comment: int) -> None:
        self.lines = path.read_text().splitlines()
        self.at, self.comment = 0, comment

    def skip(self, lines: int = 1) -> str:
        """A line that 42 reads into its buffer."""
        taken = self.lines[self.at : self.at + lines]
        assert len(taken) == lines and all(0 < len(line) < self.comment for line in taken), taken
        self.at += lines
        return taken[-1]

    def section(self) -> None:
        assert self.skip().startswith("*")

    def row(self, number: int) -> list[str]:
        words = self.lines[self.at].split(maxsplit=number)
        assert len(words) == number + 1 and len(words[-1]) < self.comment, words
        self.at += 1
        return words[:number]

    def floats(self, number: int) -> np.ndarray:
        return np.array([float(word) for word in self.row(number)])

    def integer(self) -> int:
        return int(self.row(1)[0])

    def name(self, longest: int = 39) -> str:
        (word,) = self.row(1)
        assert len(word) <= longest
        return word


@dataclass
class Body:
    """A body of 42, and where it is in the scene: origin, and axes as rows."""

    name: str
    mass: float
    inertia: np.ndarray
    nodes: np.ndarray
    flex: str
    origin: np.ndarray = field(default_factory=lambda: np.full(3, np.nan))
    axes: np.ndarray = field(default_factory=lambda: np.full((3, 3), np.nan))


def turned(sequence: str, angles: np.ndarray) -> np.ndarray:
    """Matrix to a frame that is turned about its axes one after the other."""
    C = np.eye(3)
    for digit, angle in zip(sequence, angles, strict=True):
        i, j = (int(digit) % 3, (int(digit) + 1) % 3)
        one = np.eye(3)
        one[i, i] = one[j, j] = np.cos(angle)
        one[i, j], one[j, i] = np.sin(angle), -np.sin(angle)
        C = one @ C
    return C


class Folder42:
    """The spacecraft of a folder, its bodies placed by the joints.

    Parameters
    ----------
    folder : Path
        Folder that `cmsreduce export --to 42` wrote.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.step = self._simulation()
        scan = Scan(folder / "SC_Scene.txt", 120)
        scan.skip(2)
        assert scan.skip().startswith('"S/C" ')
        scan.row(1)
        assert scan.name() == "PASSIVE_FSW" and scan.floats(1) == self.step
        scan.section()
        assert [scan.name(), scan.name()] == ["ENCKE", "CM"]
        assert not scan.floats(3).any() and not scan.floats(3).any()
        scan.section()
        assert scan.name() == "NQN" and not scan.floats(3).any()
        q = scan.floats(4)
        scan.floats(4)
        scan.section()
        self.flags = [scan.name() for _ in range(6)]
        scan.floats(1)
        for _ in range(3):
            scan.section()
        self.bodies = [self._body(scan) for _ in range(scan.integer())]
        v, s = q[:3], q[3]
        cross = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
        np.testing.assert_allclose(q @ q, 1, rtol=1e-14)
        self.bodies[0].axes = np.eye(3) - 2 * s * cross + 2 * cross @ cross
        self.bodies[0].origin = np.zeros(3)
        for _ in range(3):
            scan.section()
        scan.skip()
        self.joints = [self._joint(scan) for _ in self.bodies[1:]]
        if not self.joints:
            scan.skip(16)
        self._none(scan, 8, flags=2)
        self._none(scan, 4)
        self.thrusters = self._thrusters(scan)
        for lines in (11, 8, 8, 8, 8, 6, 11, 7):
            self._none(scan, lines)
        assert scan.at == len(scan.lines)

    def _simulation(self) -> float:
        scan = Scan(self.folder / "Inp_Sim.txt", 120)
        scan.skip()
        scan.section()
        assert scan.name() == "FAST"
        end, step = scan.floats(2)
        assert scan.floats(1) == step and end > step
        assert scan.integer() == 0 and scan.name() == "FALSE" and scan.name() == "Inp_Cmd.txt"
        scan.section()
        assert scan.integer() == 1
        orbit = scan.row(2)[1]
        scan.section()
        assert scan.integer() == 1
        craft = scan.row(3)[2]
        assert len(craft) < 20 and craft == "SC_Scene.txt" and (self.folder / orbit).is_file()
        scan.section()
        for words in (3, 3, 1, 1, 1, 1, 1, 2, 2, 2, 2, 2, 1, 2, 1, 1, 1, 1, 1, 1, 1):
            scan.row(words)
        for choices in (11, 3):
            scan.section()
            for _ in range(choices):
                scan.name()
        scan.section()
        assert scan.integer() == 0 and scan.at == len(scan.lines)
        outputs = Scan(self.folder / "Inp_ScOutput.txt", 80)
        outputs.skip()
        assert all(float(outputs.row(2)[1]) >= step for _ in range(6))
        return float(step)

    def _body(self, scan: Scan) -> Body:
        name = scan.skip().strip("= ").partition(": ")[2]
        (mass,), diagonal, products = scan.floats(1), scan.floats(3), scan.floats(3)
        inertia = np.diag(diagonal)
        for (i, j), product in zip([(0, 1), (0, 2), (1, 2)], products, strict=True):
            inertia[i, j] = inertia[j, i] = -product
        for _ in range(3):
            assert not scan.floats(3).any()
        assert scan.name() == "Point.obj"
        nodes, flex = scan.name(), scan.name()
        return Body(name, mass, inertia, self._nodes(nodes), flex)

    def _nodes(self, name: str) -> np.ndarray:
        if name == "NONE":
            return np.zeros((1, 3))
        scan = Scan(self.folder / name, 80)
        scan.skip(2)
        number = scan.integer()
        scan.skip()
        rows = [re.fullmatch(r'(\S+) +(\S+) +(\S+) +"([^"]{1,39})"', line) for line in scan.lines[scan.at :]]
        assert len(rows) == number
        return np.array([[float(value) for value in row.groups()[:3]] for row in rows])  # type: ignore[union-attr]

    def _joint(self, scan: Scan) -> dict[str, object]:
        name = scan.skip().strip("= ").partition(": ")[2]
        assert scan.name() == "PASSIVE"
        inner, outer = (int(word) for word in scan.row(2))
        turns, turn_order, kind = scan.row(3)
        slides, slide_order = scan.row(2)
        assert {*turn_order} == {*slide_order} == {*"123"} and (kind == "SPHERICAL") == (turns == "3")
        assert scan.row(3) == ["FALSE"] * 3 and scan.row(3) == ["FALSE"] * 3
        angles, rates, places, speeds = (scan.floats(3) for _ in range(4))
        assert not rates.any() and not speeds.any()
        assert not angles[int(turns) :].any() and not places[int(slides) :].any()
        fixed = [scan.row(4) for _ in range(2)]
        inside, outside = (turned(row[3], np.deg2rad([float(word) for word in row[:3]])) for row in fixed)
        pins = scan.floats(3), scan.floats(3)
        file = scan.name()
        a, b = self.bodies[inner], self.bodies[outer]
        b.axes = outside @ turned(turn_order, np.deg2rad(angles)) @ inside @ a.axes
        along = sum(places[k] * np.eye(3)[int(digit) - 1] for k, digit in enumerate(slide_order))
        b.origin = a.origin + a.axes.T @ (pins[0] + inside.T @ along) - b.axes.T @ pins[1]
        assert inner < outer and np.isfinite(a.origin).all()
        springs = np.zeros((4, 3))
        if file != "NONE":
            elements = Scan(self.folder / file, 80)
            elements.skip(3)
            springs = np.array([elements.floats(3) for _ in range(4)])
        return {
            "name": name,
            "ends": (inner, outer),
            "turns": turn_order[: int(turns)],
            "slides": slide_order[: int(slides)],
            "axes": inside @ a.axes,
            "place": b.origin + b.axes.T @ pins[1],
            "springs": springs,
        }

    def _none(self, scan: Scan, lines: int, flags: int = 0) -> None:
        scan.section()
        assert all(scan.name() == "FALSE" for _ in range(flags))
        assert scan.integer() == 0
        scan.skip(lines)

    def _thrusters(self, scan: Scan) -> list[tuple[str, int, Body, np.ndarray, np.ndarray]]:
        """Actuator, sign, body, place on it, and force along its axes at the largest effort."""
        scan.section()
        found = []
        number = scan.integer()
        for index in range(number):
            title = re.fullmatch(r"====  Thr (\d+): (.*) ([+-])1  ====", scan.skip())
            assert title is not None and int(title[1]) == index and scan.name() == "PROPORTIONAL"
            (force,), axis = scan.floats(1), scan.floats(3)
            body, node = scan.integer(), scan.integer()
            part = self.bodies[body]
            assert node < len(part.nodes) and part.flex == "NONE"
            np.testing.assert_allclose(axis @ axis, 1, rtol=1e-14)
            found.append((title[2], int(title[3] + "1"), part, part.nodes[node], force * axis))
        if not number:
            scan.skip(6)
        return found


def script(folder: Path) -> ModuleType:
    """The script scene.py of a folder."""
    spec = importlib.util.spec_from_file_location(f"scene42_{next(_NAMES)}", folder / "scene.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def simulated(
    folder: Path, laws: Mapping[str, Callable[[float], float]], seconds: float, step: float
) -> tuple[ModuleType, np.ndarray]:
    """Run 42 with other laws, end and step; the script, and the amplitudes of the modes (steps + 1, modes)."""
    changes = {
        "Inp_Sim.txt": [(r".*(?=! Sim Duration)", f"{seconds!r} {step!r} "), (r".*(?=! File Output)", f"{step!r} ")],
        "SC_Scene.txt": [(r".*(?=! FSW Sample Time)", f"{step!r} ")],
        "Inp_ScOutput.txt": [(r"(?<=E  ).*(?=!)", f"{step!r} ")],
    }
    for name, edits in changes.items():
        text = (folder / name).read_text()
        for pattern, value in edits:
            text, made = re.subn(pattern, value, text)
            assert made
        (folder / name).write_text(text)
    scene = script(folder)
    scene.LAWS.update(laws)
    scene.write_commands()
    run(folder)
    return scene, np.loadtxt(folder / "xf.42", ndmin=2)[: round(seconds / step) + 1]


def run(folder: Path) -> str:
    """Run 42 on a folder, with its own models."""
    model = os.path.relpath(Path(PROGRAM).resolve().parent / "Model", folder.resolve())
    done = subprocess.run([PROGRAM, ".", model], cwd=folder, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout[-1000:] + done.stderr
    return done.stdout
