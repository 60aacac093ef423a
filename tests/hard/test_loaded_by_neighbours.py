"""Benfield-Hruda modes of bodies whose neighbours hang on few motions: the loading is rounding and nothing else.

Thirty scenes from seeds. A body of beams or of springs carries two others at single points. A neighbour on three
translations, or on fewer, loads the body by no stiffness: what condensation leaves of it, 1e-16 of the stiffness of its
members or the square of that, must not count as strain.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
import scipy.sparse as sp

from cmsreduce.assemble import body_ports
from cmsreduce.linalg.eigen import rigid_body_modes
from cmsreduce.model import DofTable, FEModel, Interface, Joint, Nodes, Point, Scene, rigid_body_shapes
from cmsreduce.orthogonalise import orthogonalise
from cmsreduce.pipeline.bodies import FlexibleBody
from cmsreduce.pipeline.bodies.interface_loading import loading_by_neighbours
from cmsreduce.pipeline.system import AssembledModel
from cmsreduce.reduce import BenfieldHruda
from tests.frames import Section, frame

TRANSLATIONS, ALL = (1, 2, 3), (1, 2, 3, 4, 5, 6)
FREE = [{3, 4, 5}, {2, 3, 4, 5}, {1, 2, 3, 4, 5}, {3}, {0, 4}, {4, 5}, set()]
"""Free motions of a joint: it holds 3, 2 or 1 translations, leaves one rotation free, ..., holds everything."""
EVERY_MODE, FEW_MODES = 1e6, 400.0  # Hz


def springs(name: str, xyz: np.ndarray, points: Mapping[str, int], rng: np.random.Generator) -> FEModel:
    """Point masses without rotations, a spring between every two."""
    N = len(xyz)
    K = np.zeros((3 * N, 3 * N))
    for i in range(N):
        for j in range(i):
            along = (xyz[i] - xyz[j]) / np.linalg.norm(xyz[i] - xyz[j])
            rows, row = np.r_[3 * i : 3 * i + 3, 3 * j : 3 * j + 3], np.r_[along, -along]
            K[np.ix_(rows, rows)] += 10 ** rng.uniform(4, 6) * np.outer(row, row)
    mass = np.repeat(rng.uniform(0.5, 3.0, N), 3)
    faces = {
        face: Interface(face, np.array([node]), (TRANSLATIONS,), xyz[node - 1][None], np.eye(3), np.eye(3)[None])
        for face, node in points.items()
    }
    dofs = DofTable(np.repeat(np.arange(1, N + 1), 3), np.tile(TRANSLATIONS, N))
    nodes = Nodes(np.arange(1, N + 1), xyz, np.tile(np.eye(3), (N, 1, 1)))
    return FEModel(name, sp.csc_array(K), sp.csc_array(np.diag(mass)), dofs, nodes, faces)


def beams(
    name: str, xyz: np.ndarray, points: Mapping[str, int], components: tuple[int, ...], rng: np.random.Generator
) -> FEModel:
    """A tree of bars with up to two more, of aluminium up to ten times softer or stiffer."""
    N = len(xyz)
    bars = {(int(rng.integers(1, i)), i) for i in range(2, N + 1)}
    bars |= {tuple(sorted(map(int, rng.choice(np.arange(1, N + 1), 2, replace=False)))) for _ in range(2)}
    faces = {face: ((node,), components) for face, node in points.items()}
    return frame(name, xyz, sorted(bars), faces, section=Section(E=70e9 * 10 ** rng.uniform(-1, 1)))


def random_scene(seed: int) -> tuple[dict[str, FEModel], Scene]:
    """A body with a neighbour at ``p`` and another at ``q``."""
    rng = np.random.default_rng(seed)
    kinds, components = rng.choice(["beams", "springs"], 3), ALL if rng.integers(2) else TRANSLATIONS
    place = dict(zip("pq", rng.uniform(-1, 1, (2, 3)), strict=True))
    bodies = {}
    for name, kind, points in zip("abc", kinds, ({"p": 1, "q": 2}, {"p": 1}, {"q": 2}), strict=True):
        xyz = rng.uniform(-1, 1, (int(rng.integers(5, 8)), 3))
        for face, node in points.items():
            xyz[node - 1] = place[face]
        made = springs(name, xyz, points, rng) if kind == "springs" else beams(name, xyz, points, components, rng)
        bodies[name] = made
    joints = []
    for other, face in (("b", "p"), ("c", "q")):
        turns = all(len(bodies[name].interfaces[face].components[0]) == 6 for name in ("a", other))
        free = FREE[int(rng.integers(len(FREE)))] if turns else FREE[int(rng.integers(3))]
        joints.append(Joint(f"at {face}", Point("a", face), Point(other, face), frozenset(free)))
    return bodies, Scene(tuple(bodies), (0.0, 100.0), tuple(joints), base="a")


@pytest.mark.parametrize("seed", range(30))
def test_a_loading_that_is_rounding_resists_nothing(seed: int) -> None:
    bodies, scene = random_scene(seed)
    flexible = {}
    for name, body in bodies.items():
        shapes = rigid_body_shapes(body.dofs, body.nodes, body.nodes.xyz.mean(axis=0))
        rigid = rigid_body_modes(body.K, body.M, shapes, body.rounding, name)
        flexible[name] = FlexibleBody(body, body_ports(body, scene), rigid, (), ())
    as_built = scene.configurations[0]
    whole = AssembledModel({name: part.substructure(scene) for name, part in flexible.items()}, scene)
    exact = whole.every_mode(as_built)[0]
    loading = {name: loading_by_neighbours(name, flexible, {}, scene) for name in bodies}
    for cutoff in (EVERY_MODE, FEW_MODES):
        reduced = {}
        for name, part in flexible.items():
            basis = BenfieldHruda(cutoff, loading[name]).reduce(part.body, part.ports.interface, rigid=part.rigid)
            reduced[name] = part.substructure(scene, orthogonalise(basis))
        found = AssembledModel(reduced, scene).every_mode(as_built)[0]
        assert found.size <= exact.size
        # From above, and all of them where every mode is kept.
        assert (found >= (1 - 1e-6) * exact[: found.size]).all()
        if cutoff == EVERY_MODE:
            np.testing.assert_allclose(found, exact, rtol=1e-5)
