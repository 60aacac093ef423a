"""Time and memory of assembling many bodies: a chain, a tree and a closed loop of bodies in modes, joined by hinges.

    python benchmarks/assembly.py [BODIES] [COORDINATES OF EACH] [CONFIGURATIONS]

Prints one Markdown table: coordinates, constraints, seconds (best of three; of the clock and of the processor) and the
peak of memory that assembly adds. With a number of configurations, frequency responses of the chain in so many
configurations together, and in a quarter of them: every hinge at a random angle, 400 frequencies. The error
is the largest difference of the last one from solves with its assembled matrices, relative to its largest response.
"""

from __future__ import annotations

import resource
import sys
import time
import tracemalloc
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import scipy.sparse as sp

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT))

from cmsreduce.assemble import assemble  # noqa: E402
from cmsreduce.linalg.blocks import dense  # noqa: E402
from cmsreduce.model import (  # noqa: E402
    Channel,
    Configuration,
    Interface,
    Joint,
    JointElement,
    JointTerm,
    Matrix,
    Point,
    Scene,
    Substructure,
    System,
    cross_matrix,
)
from cmsreduce.pipeline.system import AssembledModel  # noqa: E402

_RUNS = 3
_RIGID = 6
_HZ = 2 * np.pi
# Frequencies of a body's modes in Hz: from its first bending to those of its static shapes.
_BAND = (0.5, 5e4)
_DAMPING = 0.005
_POINTS = 400


def modal_body(name: str, m: int, ends: int, at: np.ndarray, rng: np.random.Generator) -> Substructure:
    """A free body of m modes: rigid ones about its first interface, and elastic ones of random shape at all of them."""
    omega = np.concatenate([np.zeros(_RIGID), _HZ * np.geomspace(*_BAND, m - _RIGID)])
    motion: dict[str, Matrix] = {}
    places = at + np.vstack([np.zeros(3), rng.uniform(-1, 1, (ends - 1, 3))])
    for k, place in enumerate(places):
        rigid = np.eye(6)
        rigid[:3, 3:] = -cross_matrix(place - at)
        motion[f"face{k}"] = np.hstack([rigid, rng.standard_normal((6, m - _RIGID))])
    faces = {
        label: Interface(label, np.array([-1]), ((1, 2, 3, 4, 5, 6),), place[None], np.eye(3), np.eye(3)[None])
        for label, place in zip(motion, places, strict=True)
    }
    return Substructure(
        name,
        sp.eye_array(m, format="csc"),
        sp.diags_array(omega**2, format="csc"),
        sp.diags_array(2 * _DAMPING * omega, format="csc"),
        None,
        np.eye(m, _RIGID),
        motion,
        dict.fromkeys(motion, np.ones(6, dtype=bool)),
        dict.fromkeys(motion, np.eye(3)),
        dict(zip(motion, places, strict=True)),
        faces,
        omega,
    )


def rig(parents: Sequence[int], m: int, loop: bool) -> tuple[dict[str, Substructure], Scene]:
    """Bodies that each hang on an earlier one by a hinge with a spring and a damper."""
    rng = np.random.default_rng(0)
    bodies: list[Substructure] = []
    joints = []
    used = [0] * (len(parents) + 1)
    for k, parent in enumerate((-1, *parents)):
        # Every body has a face towards its parent, one for each child, and one for the loop.
        ends = 2 + list(parents).count(k)
        at = np.zeros(3) if parent < 0 else bodies[parent].position[f"face{used[parent] + 1}"]
        bodies.append(modal_body(f"body{k}", m, ends, at, rng))
        if parent >= 0:
            used[parent] += 1
            ends_at = Point(f"body{parent}", f"face{used[parent]}"), Point(f"body{k}", "face0")
            element = JointElement(5, 100.0, 0.1, 1e-3)
            joints.append(Joint(f"hinge{k}", *ends_at, frozenset({5}), elements=(element,)))
    if loop:
        first, last = Point("body0", f"face{used[0] + 1}"), Point(f"body{len(parents)}", "face1")
        gap = bodies[-1].position["face1"] - bodies[0].position[first.name]
        joints.append(Joint("closure", first, last, offset=(gap[0], gap[1], gap[2])))
    motor = (Channel("motor", (JointTerm(joints[0].name, 5),), "rotation"),)
    subs = {body.name: body for body in bodies}
    return subs, Scene(tuple(subs), (0.0, 10.0), tuple(joints), actuators=motor, sensors=motor)


def measured(subs: dict[str, Substructure], scene: Scene) -> tuple[float, float, float, System]:
    """Seconds of the clock and of the processor, MiB and the system."""
    configuration = Configuration("as built")
    clock, processor = [], []
    for _ in range(_RUNS):
        start, worked = time.perf_counter(), time.process_time()
        system = assemble(subs, scene, configuration)
        clock.append(time.perf_counter() - start)
        processor.append(time.process_time() - worked)
    tracemalloc.start()
    assemble(subs, scene, configuration)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return min(clock), min(processor), peak / 2**20, system


def responses(bodies: int, m: int, count: int) -> None:
    """Print seconds and memory of the responses of a chain in many configurations."""
    subs, scene = rig(list(range(bodies - 1)), m, loop=False)
    rng, omega = np.random.default_rng(2), _HZ * np.linspace(scene.band[1] / _POINTS, scene.band[1], _POINTS)
    print("| configurations | frequencies | coordinates | processor s | s of each | peak MiB | error |")
    print("|---|---|---|---|---|---|---|")
    for number in (count // 4, count):
        started = time.process_time()
        model = AssembledModel(subs, scene)
        turned = [
            Configuration(str(k), {(joint.name, 5): float(rng.uniform(-np.pi, np.pi)) for joint in scene.joints})
            for k in range(number)
        ]
        found = model.responses(turned, [omega] * number, model.tables(omega))
        worked = time.process_time() - started
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**10
        H = solved(assemble(subs, scene, turned[-1]), omega)
        error = abs(found[-1] - H).max() / abs(H).max()
        figures = f"{worked:.1f} | {worked / number:.3f} | {peak:.0f} | {error:.0e}"
        print(f"| {number} | {_POINTS} | {bodies * m} | {figures} |", flush=True)


def solved(system: System, omega: np.ndarray) -> np.ndarray:
    """Response by a dense solve at every frequency."""
    M, D, K = (dense(A) for A in (system.M, system.D, system.K))
    Y = [np.linalg.solve(K - w**2 * M + 1j * w * D, system.B) for w in omega]
    return np.stack([system.C1 @ y + 1j * w * (system.C2 @ y) for y, w in zip(Y, omega, strict=True)])


def main(bodies: int, m: int) -> None:
    """Print the table of assemblies."""
    rng = np.random.default_rng(1)
    chain = list(range(bodies - 1))
    tree = [int(rng.integers(0, k + 1)) for k in range(bodies - 1)]
    print("| bodies joined as | coordinates | constraints | s | processor s | MiB | T^T T - 1 |")
    print("|---|---|---|---|---|---|---|")
    for name, parents, loop in (("a chain", chain, False), ("a tree", tree, False), ("a closed chain", chain, True)):
        clock, processor, mebibytes, system = measured(*rig(parents, m, loop))
        T = dense(system.T)
        error = abs(T.T @ T - np.eye(system.N)).max()
        figures = f"{clock:.2f} | {processor:.2f} | {mebibytes:.0f} | {error:.1e}"
        print(f"| {name} | {bodies * m} | {T.shape[0] - system.N} | {figures} |")


if __name__ == "__main__":
    given = [int(word) for word in sys.argv[1:]] or [20, 150]
    (responses if len(given) > 2 else main)(*given)
