"""Scenes that `cmsreduce export` wrote for MBDyn: read by its grammar, and run unedited but for laws, end and step."""

from __future__ import annotations

import os
import re
import subprocess
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from cmsreduce.errors import WriteError
from cmsreduce.pipeline.results import multibody_scene
from cmsreduce.write import export_scene
from tests.consumers.exported import BALL, BEAM, ROBOT, assembled, finished, linear, pulse
from tests.consumers.predictions import PlaneBeam
from tests.frames import line
from tests.pipeline.study import arm, panel, write_body
from tests.write.targets.test_mbdyn import read

MBDYN = os.environ.get("CMSREDUCE_MBDYN")
runs = pytest.mark.skipif(not MBDYN, reason="CMSREDUCE_MBDYN does not give the path of MBDyn's program")


class Words:
    """Arguments of a card, taken from the left."""

    def __init__(self, text: str) -> None:
        self.left = [word.strip() for word in re.findall(r'(?:"[^"]*"|[^,"])+', text)]

    def take(self) -> str:
        return self.left.pop(0)

    def expect(self, *words: str) -> None:
        for word in words:
            assert self.take() == word

    def vector(self) -> np.ndarray:
        return np.zeros(3) if self.left[0] == "null" and self.take() else np.array([float(self.take()) for _ in "xyz"])

    def matrix(self) -> np.ndarray:
        if self.take() == "eye":
            return np.eye(3)
        found = np.array([float(self.take()) for _ in range(9)]).reshape(3, 3)
        np.testing.assert_allclose(found @ found.T, np.eye(3), atol=1e-14)
        return found


@dataclass
class Deck:
    """Cards of an input file by block: kind and arguments; constants by name."""

    blocks: dict[str, list[tuple[str, Words]]]
    constants: dict[str, float]


def parsed(path: Path) -> Deck:
    """Cards end with a semicolon; what follows # is a comment."""
    text = "\n".join(line.split("#")[0] for line in path.read_text().splitlines())
    assert text.rstrip().endswith(";")
    block, deck = "", Deck({"": []}, {})
    for card in text.split(";")[:-1]:
        kind, _, words = card.strip().partition(":")
        if kind == "begin":
            assert not block
            block = words.strip()
            deck.blocks[block] = []
        elif kind == "end":
            assert words.strip() == block
            block = ""
        elif kind == "set":
            name, value = re.fullmatch(r" const (?:real|integer) (\w+) = (\S+)", words).groups()  # type: ignore[union-attr]
            assert name not in deck.constants
            deck.constants[name] = float(value)
        else:
            deck.blocks[block].append((kind, Words(words)))
    assert not block
    return deck


def structure(deck: Deck) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Place and axes of each structural node that is not a dummy."""
    nodes, seen = {}, set()
    for kind, words in deck.blocks["nodes"]:
        assert kind == "structural"
        label, what = words.take(), words.take()
        assert label in deck.constants and label not in seen
        seen.add(label)
        if what == "dummy":
            assert words.take() in nodes
            continue
        assert what in ("static", "dynamic", "modal")
        nodes[label] = words.vector(), words.matrix()
        words.expect("null", "null")
    return nodes


def end(nodes: dict[str, tuple[np.ndarray, np.ndarray]], words: Words, *orientations: str) -> list[np.ndarray]:
    """Place in the scene of one end of a joint, and its axes."""
    x, R = nodes[words.take()]
    words.expect("position")
    found = [x + R @ words.vector()]
    for name in orientations:
        words.expect(name)
        found.append(R @ words.matrix())
    return found


def test_the_input_holds_together(robot: Path, tmp_path: Path) -> None:
    """Counts, labels, and the geometry: the ends of each joint meet, and modal joints hold nodes where they are."""
    scene = multibody_scene(robot, assembled(robot, 1)[0])
    main, *fem = export_scene(scene, "mbdyn", tmp_path / "mbdyn")
    assert [path.name for path in (main, *fem)] == ["scene.mbd", "arm.fem", "copy.fem", "panel.fem"]
    deck = parsed(main)
    nodes = structure(deck)
    elements = [(kind, words) for kind, words in deck.blocks["elements"] if kind != "drive caller"]
    declared = {kind: int(words.take()) for kind, words in deck.blocks["control data"] if kind[-1] == "s"}
    counted = Counter(kind for kind, _ in elements)
    assert declared == {
        "structural nodes": len(deck.blocks["nodes"]),
        "joints": counted["joint"],
        "forces": counted["force"] + counted["couple"],
        "rigid bodies": counted["body"],
    }
    both = ("position orientation", "rotation orientation")
    met: Counter[str] = Counter()
    for kind, words in elements:
        assert words.take() in deck.constants
        if kind == "body":
            assert words.take() in nodes
            continue
        name = words.take()
        met[name] += 1
        match name:
            case "revolute hinge":
                (x, A), (y, B) = end(nodes, words, "orientation"), end(nodes, words, "orientation")
                np.testing.assert_allclose(x, y, atol=1e-14)
                np.testing.assert_allclose(A[:, 2], B[:, 2], atol=1e-14)
            case "total joint":
                one, other = end(nodes, words, *both), end(nodes, words, *both)
                np.testing.assert_allclose(np.vstack(one), np.vstack(other), atol=1e-14)
            case "total pin joint":
                one = end(nodes, words, *both)
                words.expect("position")
                there = [words.vector()]
                for orientation in both:
                    words.expect(orientation)
                    there.append(words.matrix())
                np.testing.assert_allclose(np.vstack(one), np.vstack(there), atol=1e-14)
            case "modal":
                check_modal(words, nodes, main.parent)
            case "deformable joint" | "deformable axial joint":
                one, other = end(nodes, words, "orientation"), end(nodes, words, "orientation")
                np.testing.assert_allclose(np.vstack(one), np.vstack(other), atol=1e-14)
            case "follower" | "follower internal" | "rod" | "clamp":
                assert words.take() in nodes
            case _:
                pytest.fail(name)
    assert met["modal"] == 3 and met["total joint"] == 2 and met["revolute hinge"] == 1 and met["total pin joint"] == 1
    drives = [words for kind, words in deck.blocks["elements"] if kind == "drive caller"]
    assert [words.left[2] for words in drives] == [f'"{sensor.name}"' for sensor in scene.sensors]
    laws = [words.left[2] for kind, words in deck.blocks[""] if kind == "drive caller"]
    assert laws == [f'"{actuator.name}"' for actuator in scene.actuators]


@pytest.mark.parametrize("program", ["mbdyn", "42"])
@pytest.mark.parametrize("alike", [False, True])
def test_unlike_springs_of_a_ball_are_named(tmp_path: Path, program: str, alike: bool) -> None:
    """MBDyn and 42 take a moment K v along the rotation vector v, which has a potential where all springs are alike."""
    text = re.sub("  ground.*\n", "", BALL).replace(
        "joint: j, dof: rx}}, two: {{joint: j, dof: ry", "at: pod.h, torque: [1, 0, 0]"
    )
    run = finished(tmp_path, re.sub("(20|30) N", "25 N", text) if alike else text)
    export_scene(multibody_scene(run), program, tmp_path / "exported")
    written = "".join(path.read_text() for path in (tmp_path / "exported").iterdir() if path.is_file())
    assert bool(re.search("unlike springs .*not keep the energy", written)) is not alike


def test_a_universal_joint_that_is_turned_about_its_later_axis_is_refused(tmp_path: Path) -> None:
    """A turn about the earlier one changes no axis."""
    for body in (arm(), panel()):
        write_body(tmp_path, body)
    turns = "articulation: [{{shoulder.ry: 20 deg}}, {{shoulder.rz: 30 deg}}]"
    run = finished(tmp_path, re.sub("articulation: .*", turns, ROBOT))
    earlier, later = (multibody_scene(run, assembled(run, number)[0]) for number in (0, 1))
    assert export_scene(earlier, "mbdyn", tmp_path / "earlier")
    with pytest.raises(WriteError, match=r"'shoulder': two rotations .* turns it about rz; MBDyn's total joint"):
        export_scene(later, "mbdyn", tmp_path / "later")


def check_modal(words: Words, nodes: dict[str, tuple[np.ndarray, np.ndarray]], folder: Path) -> None:
    """The frame and the shapes of the file put every node where the card of its structural node does."""
    x, R = nodes[words.take()]
    modes = int(words.take())
    words.expect("from file", "damping from file")
    f = read(folder / words.take().strip('"'))
    assert f[8].shape[0] == modes
    for _ in range(int(words.take())):
        (row,) = np.flatnonzero(f[2] == int(words.take().strip('"')))
        place, axes = nodes[words.take()]
        words.expect("null")
        np.testing.assert_allclose(x + R @ [f[5][row], f[6][row], f[7][row]], place, atol=1e-14)
        np.testing.assert_array_equal(axes, R)
    words.expect("use invariant 9")


def simulated(folder: Path, laws: dict[str, str], **constants: float) -> tuple[np.ndarray, np.ndarray]:
    """Sensors (times, outputs) and modal amplitudes (times, modes) of the scene with other laws, end and step."""
    text = (folder / "scene.mbd").read_text()
    for name, value in constants.items():
        text, changed = re.subn(rf"real {name} = .*?;", f"real {name} = {value!r};", text)
        assert changed == 1
    for name, law in laws.items():
        text, changed = re.subn(rf'(name, "{name}", )[^;]*;', rf"\g<1>{law};", text)
        assert changed == 1
    (folder / "scene.mbd").write_text(text)
    run_mbdyn(folder)
    steps = round(constants["SECONDS"] / constants["STEP"]) + 1
    return values(folder / "scene.drv")[:steps], values(folder / "scene.mod")[:steps]


def values(path: Path) -> np.ndarray:
    """Second column (times, rows); the first one has labels, which repeat at each step."""
    rows = [row.split() for row in path.read_text().splitlines()]
    return np.array([float(row[1]) for row in rows]).reshape(-1, len({row[0] for row in rows}))


def run_mbdyn(folder: Path) -> str:
    assert MBDYN is not None
    done = subprocess.run(
        [MBDYN, "-f", "scene.mbd"], cwd=folder, capture_output=True, text=True, timeout=100, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@runs
@pytest.mark.parametrize("number", [0, 1])
def test_small_motions_in_mbdyn_are_those_of_the_assembled_system(robot: Path, tmp_path: Path, number: int) -> None:
    """Every sensor's answer to every actuator, through joints, springs, dampers and inertias of every kind."""
    name, system = assembled(robot, number)
    scene = multibody_scene(robot, name)
    export_scene(scene, "mbdyn", tmp_path / "mbdyn")
    laws, known = {}, []
    for k, actuator in enumerate(scene.actuators):
        size, period = 1e-4 * (1 + k), 0.15 / (1 + k % 3)
        known.append(pulse(size, period))
        laws[actuator.name] = f"cosine, 0., {2 * np.pi / period!r}, {size / 2!r}, one, 0."
    seen, _ = simulated(tmp_path / "mbdyn", laws, SECONDS=0.2, STEP=5e-4, TOLERANCE=1e-10)
    answer = linear(system, known, 5e-4 * np.arange(len(seen)))
    apart = np.sqrt(((seen - answer) ** 2).mean(axis=0) / (answer**2).mean(axis=0))
    # The rest falls with the square of the step.
    assert apart.max() < 1e-2, dict(zip([sensor.name for sensor in scene.sensors], apart, strict=True))


@runs
def test_spin_up_in_mbdyn(tmp_path: Path, record_property: Callable[[str, object], None]) -> None:
    """A pulse of torque through a large angle, against a plane beam in its own three modes, integrated by scipy."""
    length, elements, step = 2.0, 8, 1e-3
    body = line("beam", [0, 0, 0], [length, 0, 0], elements, interfaces={"root": 1})
    write_body(tmp_path, body)
    folder = tmp_path / "mbdyn"
    export_scene(multibody_scene(finished(tmp_path, BEAM)), "mbdyn", folder)
    law = f"cosine, 0., {np.pi!r}, 25., one, 0."
    seen, modes = simulated(folder, {"motor": law}, SECONDS=1.0, STEP=step, TOLERANCE=1e-8)
    plane = np.isin(body.dofs.component, (2, 6))
    K, M = (A.toarray()[np.ix_(plane, plane)] for A in (body.K, body.M))
    model = PlaneBeam.of(K, M, np.linspace(0, length, elements + 1), count=3)
    expected = model.spun_up(pulse(50.0, 2.0), step * np.arange(len(modes)))
    f = read(folder / "beam.fem")
    tip = f[8][:, np.flatnonzero(f[2] == elements + 1)[0], 1]
    assert seen[-1, 0] > 2.0
    deflection = modes @ tip
    c, s = np.cos(seen[:, 0]), np.sin(seen[:, 0])
    path = np.column_stack([length * c - deflection * s, length * s + deflection * c])
    for found, known in ((deflection, expected[:, 2]), (path, expected[:, :2])):
        error = np.sqrt(((found - known) ** 2).mean() / (known**2).mean())
        record_property("error", float(error))
        assert error < 1e-4


@runs
def test_the_exported_scene_runs_unedited(robot: Path, tmp_path: Path) -> None:
    """The first slew as a user starts it: every sensor at every step, and a joint that turns."""
    export_scene(multibody_scene(robot), "mbdyn", tmp_path / "mbdyn")
    assert "terminated normally" in run_mbdyn(tmp_path / "mbdyn")
    constants = parsed(tmp_path / "mbdyn" / "scene.mbd").constants
    seen = np.loadtxt(tmp_path / "mbdyn" / "scene.drv")
    turned = seen[seen[:, 0] == constants["sensor_turned"], 1]
    assert np.isfinite(seen).all() and turned.size > constants["SECONDS"] / constants["STEP"]
    assert abs(turned).max() > 0.1
