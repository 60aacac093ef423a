"""Random scenes: bodies in a tree or a loop of joints, with ground, angles, actuators and sensors, as a pipeline."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cmsreduce.model import cross_matrix
from tests.hard.random_scenes.bodies import UNITS, Body, Tie, beams, random_turn, solid, springs, written

__all__ = ["DOFS", "METHODS", "Face", "Hinge", "Part", "RandomScene", "random_scene"]

METHODS = ("craig-bampton", "macneal-rubin", "benfield-hruda", "augmented", "guyan")
DOFS = ("x", "y", "z", "rx", "ry", "rz")
BALL = ("rx", "ry", "rz")
# Free motions of a joint between points with rotations.
FREE = ((), ("rz",), ("rx",), ("ry", "rz"), BALL, ("z",), ("x", "rz"), ("z", *BALL))


@dataclass
class Face:
    """An interface: position in the body's frame, axes of joints, and the node if it is one."""

    position: np.ndarray
    axes: np.ndarray
    six: bool
    node: int | None = None
    keys: dict[str, Any] = field(default_factory=dict)


@dataclass
class Part:
    """A body of the scene: flexible, or rigid with mass, centre and inertia; where it is as built."""

    name: str
    body: Body | None
    rigid: tuple[float, np.ndarray, np.ndarray] | None
    R: np.ndarray
    t: np.ndarray
    place: dict[str, Any]
    law: tuple[str, Any] = ("", None)
    axes: dict[int, np.ndarray] = field(default_factory=dict)
    faces: dict[str, Face] = field(default_factory=dict)
    used: set[int] = field(default_factory=set)


@dataclass
class Hinge:
    """A joint: (body, face) of both sides, free motions, and springs, dampers and inertias by motion, SI."""

    first: tuple[str, str]
    second: tuple[str, str]
    free: tuple[str, ...]
    offset: np.ndarray | None = None
    elements: dict[str, dict[str, float]] = field(default_factory=dict)


@dataclass
class RandomScene:
    """A scene with all that an independent model of it needs; ``keys`` is the pipeline without its band."""

    parts: dict[str, Part]
    hinges: dict[str, Hinge]
    ground: tuple[str, str] | None
    angles: dict[str, tuple[str, float]]
    actuators: list[dict[str, Any]]
    sensors: list[dict[str, Any]]
    units: str
    keys: dict[str, Any]

    def write(self, folder: Path, band: float) -> Path:
        """Write the pipeline with a band."""
        self.keys["scene"]["band"] = band
        path = folder / "scene.yaml"
        # JSON is YAML.
        path.write_text(json.dumps(self.keys))
        return path


def random_scene(seed: int, folder: Path) -> RandomScene:
    """Make a scene of a seed, and write the files of its bodies."""
    rng = np.random.default_rng([25, seed])
    parts: dict[str, Part] = {}
    hinges: dict[str, Hinge] = {}
    for number in range(int(rng.choice([2, 3, 4], p=[0.5, 0.35, 0.15]))):
        _add_part(rng, f"b{number}", parts, hinges)
    units = "mm-t-s" if rng.random() < 0.25 else "m-kg-s"
    base = parts["b0"]
    ground = None
    if base.body is not None and rng.random() < 0.3:
        ground = ("b0", _new_face(rng, base, "ground"))
    method = METHODS[seed % len(METHODS)]
    components = {part.name: _component(rng, part, folder) for part in parts.values()}
    for part in parts.values():
        if part.body is not None and not _holds(part):
            # Other mode sets need constraint modes, and these an interface that holds the body.
            components[part.name]["reduce"] = {"method": "macneal-rubin"}
    angles = _angles(rng, parts, hinges)
    actuators = _channels(rng, parts, hinges, int(rng.integers(1, 4)))
    sensors = _channels(rng, parts, hinges, int(rng.integers(1, 4)))
    for sensor in sensors:
        sensor["rate"] = bool(rng.random() < 0.2)
    scene: dict[str, Any] = {
        "units": units,
        "base": "b0",
        "joints": {name: _joint_keys(hinge) for name, hinge in hinges.items()},
        "actuators": {f"a{k}": _actuator_keys(one) for k, one in enumerate(actuators)},
        "sensors": {f"s{k}": _sensor_keys(one) for k, one in enumerate(sensors)},
    }
    if ground:
        scene["ground"] = ".".join(ground)
    if angles:
        unit = {True: " rad", False: " m"}
        scene["articulation"] = [{f"{n}.{d}": f"{value!r}{unit[d in BALL]}" for n, (d, value) in angles.items()}]
    reduce: dict[str, Any] = {"method": method, "cutoff": float(rng.choice([1.5, 2, 3]))}
    if method == "craig-bampton" and rng.random() < 0.3:
        reduce["residuals"] = ["actuators"]
    keys: dict[str, Any] = {
        "name": f"random-{seed}",
        "output": str(folder / "out"),
        "components": components,
        "scene": scene,
        "reduce": reduce,
        # With many points, joined bodies are represented by their modes near the band.
        "verify": {"frf": {"points": 16 if seed % 4 else 200}, "checks": []},
    }
    if rng.random() < 0.25:
        keys["balance"] = {
            "rank": str(rng.choice(["gregory", "hankel"])),
            "keep": {"fraction": float(rng.choice([1e-2, 1e-4]))},
        }
    return RandomScene(parts, hinges, ground, angles, actuators, sensors, units, keys)


def _add_part(rng: np.random.Generator, name: str, parts: dict[str, Part], hinges: dict[str, Hinge]) -> None:
    """Add a body, hinged to one of the others, and in a loop perhaps to a second one."""
    kind = str(rng.choice(["beams", "springs", "solid", "rigid"], p=[0.4, 0.25, 0.2, 0.15]))
    axis, angle, R = random_turn(rng)
    place: dict[str, Any] = {"rotate": {"axis": axis, "angle": f"{angle} deg"}}
    part = Part(name, None, None, R, np.zeros(3), place)
    if not parts:
        part.body, part.rigid = _of_kind(rng, kind, name, [])
        parts[name] = part
        return
    parent = parts[str(rng.choice(list(parts)))]
    here = _new_face(rng, parent, f"to_{name}")
    at = parent.R @ parent.faces[here].position + parent.t
    more: list[np.ndarray] = []
    target = None
    if kind in ("beams", "springs") and rng.random() < 0.35:
        # The body starts at its joint, so that the place of a second joint is known.
        other = parts[str(rng.choice(list(parts)))]
        face = _new_face(rng, other, f"loop_{name}")
        goal = other.R @ other.faces[face].position + other.t
        if np.linalg.norm(goal - at) > 0.05:
            target, more = (other, face), [np.round(R.T @ (goal - at), 11)]
        else:
            del other.faces[face]
    part.body, part.rigid = _of_kind(rng, kind, name, more)
    root = _new_face(rng, part, "root", node=None if target is None else 0)
    offset = None
    ends = [(parent, here), (part, root)]
    if rng.random() < 0.5:
        ends.reverse()
    first, second = (owner.faces[face] for owner, face in ends)
    if target is None and first.six and second.six and rng.random() < 0.2:
        offset = np.round(rng.uniform(-0.1, 0.1, 3), 3)
        arm = ends[0][0].R @ offset
        at = at + arm if ends[0][0] is parent else at - arm
    part.t = at - R @ part.faces[root].position
    part.place["at"] = [f"{v!r} m" for v in map(float, part.t)]
    parts[name] = part
    hinges[f"h{len(hinges)}"] = _hinge(rng, ends, offset)
    if target is not None:
        assert part.body is not None
        last = _new_face(rng, part, "last", node=len(part.body.xyz) - 1)
        hinges[f"h{len(hinges)}"] = _hinge(rng, [target, (part, last)], None)


def _of_kind(rng: np.random.Generator, kind: str, name: str, more: list[np.ndarray]) -> tuple[Any, Any]:
    if kind == "rigid":
        sides = rng.uniform(0.1, 0.4, 3)
        mass = float(np.round(rng.uniform(2, 30), 3))
        turn = random_turn(rng)[2]
        inertia = turn @ np.diag(mass / 12 * ((sides**2).sum() - sides**2)) @ turn.T
        return None, (mass, np.round(rng.uniform(-0.2, 0.2, 3), 3), np.round((inertia + inertia.T) / 2, 5))
    if kind == "solid":
        return solid(name, rng), None
    return (beams if kind == "beams" else springs)(name, rng, more=more), None


def _new_face(rng: np.random.Generator, part: Part, label: str, node: int | None = None) -> str:
    """Make an interface: a node, a tie of an end of a solid, or a point of a rigid body."""
    frame = random_turn(rng) if rng.random() < 0.4 else None
    axes = np.eye(3) if frame is None else frame[2].T
    if part.body is None:
        at = np.round(rng.uniform(-0.3, 0.3, 3), 3)
        face = Face(at, axes, True, None, {"position": at.tolist()})
    elif part.body.name == part.name and len(part.body.xyz) == 12 and part.body.width == 3:
        face = _solid_face(rng, part, label, axes)
        if frame is not None:
            face.keys.pop("own", None)
    else:
        count = len(part.body.xyz)
        fresh = [k for k in range(count) if k not in part.used] or list(range(count))
        node = int(rng.choice(fresh)) if node is None else node
        part.used.add(node)
        # Axes of the node, unless the interface has its own, are known when the deck is written.
        face = Face(part.body.xyz[node], axes, part.body.width == 6, node, {"node": node + 1})
        face.keys["own"] = frame is None
    if frame is not None:
        face.keys["frame"] = {"axis": frame[0], "angle": f"{frame[1]} deg"}
    part.faces[label] = face
    return label


def _solid_face(rng: np.random.Generator, part: Part, label: str, axes: np.ndarray) -> Face:
    assert part.body is not None
    ends = [nodes for nodes in ([0, 1, 2, 3], [8, 9, 10, 11]) if not part.used & set(nodes)]
    if not ends or rng.random() < 0.25:
        free = [k for k in range(4, 8) if k not in part.used] or [4]
        node = int(rng.choice(free))
        part.used.add(node)
        return Face(part.body.xyz[node], axes, False, node, {"node": node + 1, "own": True})
    nodes = ends[int(rng.integers(len(ends)))]
    part.used |= set(nodes)
    kind = str(rng.choice(["rigid", "average"]))
    at = part.body.xyz[nodes].mean(axis=0)
    keys: dict[str, Any] = {"nodes": [k + 1 for k in nodes], "tie": kind}
    weights = None
    if kind == "average" and rng.random() < 0.5:
        weights = [float(w) for w in rng.integers(1, 5, 4)]
        keys["weights"] = weights
    if rng.random() < 0.5:
        at = np.round(at + rng.uniform(-0.05, 0.05, 3), 3)
        keys["position"] = at
    part.body.ties[label] = Tie(kind, nodes, at, weights)
    return Face(at, axes, True, None, keys)


def _holds(part: Part) -> bool:
    """True if a body does not move while its interfaces are held."""
    rows = [np.hstack([np.eye(3), -cross_matrix(face.position)]) for face in part.faces.values()]
    return any(face.six for face in part.faces.values()) or np.linalg.matrix_rank(np.vstack(rows), 1e-3) == 6


def _hinge(rng: np.random.Generator, ends: list[tuple[Part, str]], offset: np.ndarray | None) -> Hinge:
    first, second = (owner.faces[face] for owner, face in ends)
    hinge = Hinge((ends[0][0].name, ends[0][1]), (ends[1][0].name, ends[1][1]), (), offset)
    if first.six and second.six:
        hinge.free = FREE[int(rng.integers(len(FREE)))]
    elif rng.random() < 0.5 or "tie" in first.keys or "tie" in second.keys:
        hinge.free = BALL
    else:
        # The side with rotations gives its translations alone.
        for face in (first, second):
            if face.six:
                face.keys["dofs"], face.six = 123, False
    able = [d for d in hinge.free if d not in BALL or (first.six and second.six)]
    for dof in able:
        made = {}
        turns = dof in BALL
        if rng.random() < 0.4:
            made["stiffness"] = float(np.round(rng.uniform(1e3, 1e4) * (1 if turns else 100), 1))
        # A spring alone would be a resonance without damping, whose height is rounding.
        if "stiffness" in made or rng.random() < 0.25:
            made["damping"] = float(np.round(rng.uniform(0.1, 1.0) * (1 if turns else 50), 3))
        if turns and rng.random() < 0.25:
            made["inertia"] = float(np.round(rng.uniform(0.01, 0.1), 4))
        if made:
            hinge.elements[dof] = made
    return hinge


def _component(rng: np.random.Generator, part: Part, folder: Path) -> dict[str, Any]:
    """Keys of a body; its files are written."""
    if part.body is None:
        assert part.rigid is not None
        units = str(rng.choice(list(UNITS)))
        length, weight = UNITS[units]
        mass, centre, inertia = part.rigid
        tensor = inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]] * weight * length**2
        keys = {"units": units}
        keys["rigid"] = {"mass": mass * weight, "cg": (centre * length).tolist(), "inertia": tensor.tolist()}
    else:
        laws = [
            ("modal", float(np.round(rng.uniform(0.005, 0.03), 4))),
            ("per_mode", np.round(rng.uniform(0.005, 0.03, 3), 4).tolist()),
            ("table", [[10.0, 0.01], [300.0, 0.03]]),
            ("rayleigh", {"alpha": float(rng.choice([0.0, 2.0])), "beta": 2e-5}),
            ("structural", 0.02),
            ("matrix", 2e-5),
        ]
        part.law = laws[int(rng.integers(len(laws)))]
        keys = written(part.body, folder, rng, damper=2e-5)
        part.axes = keys.pop("frames")
        length = UNITS[keys["units"]][0]
        law, value = part.law
        keys["damping"] = {law: f"{part.name}_D.npz" if law == "matrix" else value}
    keys["place"], keys["interfaces"] = part.place, {}
    for label, face in part.faces.items():
        given = dict(face.keys)
        if given.pop("own", False):
            face.axes = part.axes[face.node]
        if "position" in given:
            given["position"] = [float(f"{v * length:.12g}") for v in face.position]
        keys["interfaces"][label] = given
    return keys


def _joint_keys(hinge: Hinge) -> dict[str, Any]:
    keys: dict[str, Any] = {"connect": [".".join(hinge.first), ".".join(hinge.second)], "free": list(hinge.free)}
    if hinge.offset is not None:
        keys["offset"] = [f"{v!r} m" for v in map(float, hinge.offset)]
    units = {"stiffness": ("N/m", "N*m/rad"), "damping": ("N*s/m", "N*m*s/rad"), "inertia": ("", "kg*m^2")}
    for dof, made in hinge.elements.items():
        for what, value in made.items():
            keys.setdefault(what, {})[dof] = f"{value!r} {units[what][dof in BALL]}"
    return keys


def _angles(rng: np.random.Generator, parts: dict[str, Part], hinges: dict[str, Hinge]) -> dict[str, tuple[str, float]]:
    """Values of joints that are in no loop."""
    found = {}
    for name, hinge in hinges.items():
        rest = [{h.first[0], h.second[0]} for n, h in hinges.items() if n != name]
        reached = {hinge.first[0]}
        while more := {b for pair in rest if pair & reached for b in pair} - reached:
            reached |= more
        motions = [dof for dof in hinge.free if dof in BALL or hinge.offset is not None or _six(parts, hinge)]
        if hinge.second[0] in reached or not motions or rng.random() < 0.4:
            continue
        dof = str(rng.choice(motions))
        value = rng.uniform(-2.5, 2.5) if dof in BALL else rng.uniform(-0.2, 0.2)
        found[name] = (dof, float(np.round(value, 4)))
    return found


def _six(parts: dict[str, Part], hinge: Hinge) -> bool:
    return all(parts[body].faces[face].six for body, face in (hinge.first, hinge.second))


def _channels(
    rng: np.random.Generator, parts: dict[str, Part], hinges: dict[str, Hinge], count: int
) -> list[dict[str, Any]]:
    """Motions of points, of joints, between points, or sums of motions, with weights along basic axes."""
    found: list[dict[str, Any]] = []
    turns = bool(rng.random() < 0.3)
    while len(found) < count:
        kind = str(rng.choice(["at", "joint", "between", "rows"], p=[0.5, 0.2, 0.15, 0.15]))
        if kind == "joint":
            name = str(rng.choice(list(hinges)))
            able = [d for d in hinges[name].free if d not in BALL or _six(parts, hinges[name])]
            if able:
                found.append({"joint": name, "dof": str(rng.choice(able))})
            continue
        places = [_place(rng, parts) for _ in range(2)]
        vector = np.round(rng.normal(size=3), 3)
        six = _has_rotations(parts, places[0])
        if kind == "at":
            found.append({"at": places[0], "vector": vector, "turns": turns and six})
        elif kind == "between" and _apart(parts, places) > 0.05:
            found.append({"between": places})
        elif kind == "rows" and places[0][1].isdigit() and places[1][1].isdigit():
            rows = {(place, int(rng.integers(3))): float(np.round(rng.normal(), 2)) for place in places}
            found.append({"rows": rows})
    return found


def _place(rng: np.random.Generator, parts: dict[str, Part]) -> tuple[str, str]:
    part = parts[str(rng.choice(list(parts)))]
    if part.body is None:
        return part.name, "cg"
    faces = [label for label in part.faces if label != "ground"]
    if faces and rng.random() < 0.3:
        return part.name, str(rng.choice(faces))
    # Nodes that are tied or held have no motion of their own.
    taken = {k for tie in part.body.ties.values() for k in tie.nodes}
    taken |= {face.node for label, face in part.faces.items() if label == "ground" and face.node is not None}
    return part.name, str(1 + int(rng.choice([k for k in range(len(part.body.xyz)) if k not in taken])))


def _apart(parts: dict[str, Part], places: list[tuple[str, str]]) -> float:
    """Distance of two points as built; zero for points of one body."""
    at = []
    for name, label in places:
        part = parts[name]
        if label in part.faces:
            own = part.faces[label].position
        elif part.body is None:
            assert part.rigid is not None
            own = part.rigid[1]
        else:
            own = part.body.xyz[int(label) - 1]
        at.append(part.R @ own + part.t)
    return float(np.linalg.norm(at[0] - at[1])) if places[0][0] != places[1][0] else 0.0


def _has_rotations(parts: dict[str, Part], place: tuple[str, str]) -> bool:
    part = parts[place[0]]
    if part.body is None:
        return True
    return part.faces[place[1]].six if place[1] in part.faces else part.body.width == 6


def _actuator_keys(one: dict[str, Any]) -> dict[str, Any]:
    if "at" in one:
        return {"at": ".".join(one["at"]), "torque" if one["turns"] else "force": one["vector"].tolist()}
    return _shared_keys(one)


def _sensor_keys(one: dict[str, Any]) -> dict[str, Any]:
    if "at" in one:
        motion = DOFS[3 * one["turns"] + int(abs(one["vector"]).argmax())]
        one["vector"] = np.eye(3)[DOFS.index(motion) % 3]
        return {"at": ".".join(one["at"]), "measure": motion, "rate": one["rate"]}
    return _shared_keys(one) | {"rate": one["rate"]}


def _shared_keys(one: dict[str, Any]) -> dict[str, Any]:
    if "joint" in one:
        return {"joint": one["joint"], "dof": one["dof"]}
    if "between" in one:
        return {"between": [".".join(place) for place in one["between"]]}
    return {"rows": {f"{body}.{node}.{DOFS[dof]}": weight for ((body, node), dof), weight in one["rows"].items()}}
